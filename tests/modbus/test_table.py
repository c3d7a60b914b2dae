"""The ready unit: four tables that do not touch each other."""

from __future__ import annotations

import pytest

from barewire.errors import EncodeError
from barewire.modbus import (
    ModbusException,
    ReadCoils,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
    ReadDiscreteInputs,
    ReadExceptionStatus,
    ReadHoldingRegisters,
    ReadInputRegisters,
    ReportServerId,
    Table,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)
from barewire.modbus.functions import AnyRequest
from tests.helpers import refused


def test_what_was_written_is_read() -> None:
    table = Table(20)
    table.handle(WriteSingleCoil(3, True), 0.0)
    table.handle(WriteMultipleCoils(5, (True, False, True)), 0.0)
    table.handle(WriteSingleRegister(3, 0xFFFF), 0.0)
    table.handle(WriteMultipleRegisters(5, (1, 2)), 0.0)
    assert table.handle(ReadCoils(2, 6), 0.0) == ReadCoils.response((False, True, False, True, False, True))  # type: ignore[call-arg]
    assert table.handle(ReadHoldingRegisters(2, 5), 0.0) == ReadHoldingRegisters.response((0, 0xFFFF, 0, 1, 2))  # type: ignore[call-arg]


def test_the_four_tables_do_not_touch_each_other() -> None:
    table = Table(4)
    table.coils[0], table.discrete_inputs[1] = 1, 1
    table.holding_registers[2], table.input_registers[3] = 7, 9
    assert table.handle(ReadCoils(0, 4), 0.0).bits == (True, False, False, False)  # type: ignore[union-attr]
    assert table.handle(ReadDiscreteInputs(0, 4), 0.0).bits == (False, True, False, False)  # type: ignore[union-attr]
    assert table.handle(ReadHoldingRegisters(0, 4), 0.0).registers == (0, 0, 7, 0)  # type: ignore[union-attr]
    assert table.handle(ReadInputRegisters(0, 4), 0.0).registers == (0, 0, 0, 9)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    "request_",
    [
        ReadCoils(3, 2),
        ReadDiscreteInputs(4, 1),
        ReadHoldingRegisters(0, 5),
        ReadInputRegisters(0xFFFF, 125),
        WriteSingleCoil(4, True),
        WriteSingleRegister(4, 0),
        WriteMultipleCoils(3, (True, True)),
        WriteMultipleRegisters(3, (1, 1)),
    ],
)
def test_beyond_the_end_is_02_and_nothing_is_written(request_: AnyRequest) -> None:
    table = Table(4)
    with pytest.raises(ModbusException) as caught:
        table.handle(request_, 0.0)
    assert caught.value.code == 2
    assert not any(table.coils)
    assert not any(table.holding_registers)
    assert (len(table.coils), len(table.holding_registers)) == (4, 4)


def test_what_a_table_cannot_do_is_01() -> None:
    with pytest.raises(ModbusException) as caught:
        Table().handle(ReadExceptionStatus(), 0.0)
    assert caught.value.code == 1


# Who it is -------------------------------------------------------------------------------------------------------

NAMES = ((0, b"ACME"), (1, b"bench"), (2, b"1"))


def identify(read_code: int, object_id: int = 0) -> ReadDeviceIdentificationResponse:
    table = Table(vendor="ACME", product="bench")
    answer = table.handle(ReadDeviceIdentification(read_code, object_id), 0.0)
    assert isinstance(answer, ReadDeviceIdentificationResponse)
    assert answer.read_code == read_code
    assert not answer.more_follows
    return answer


@pytest.mark.parametrize("read_code", [1, 2, 3])
def test_it_names_its_basic_objects_at_every_level(read_code: int) -> None:
    assert identify(read_code).objects == NAMES


@pytest.mark.parametrize("object_id", [0, 1, 2])
def test_a_stream_begins_at_the_object_asked_for(object_id: int) -> None:
    assert identify(1, object_id).objects == NAMES[object_id:]


def test_a_stream_from_an_object_that_does_not_exist_begins_again_at_0() -> None:
    assert identify(1, 9).objects == NAMES


@pytest.mark.parametrize("object_id", [0, 1, 2])
def test_one_object_is_one_object(object_id: int) -> None:
    answer = identify(4, object_id)
    assert answer.objects == (NAMES[object_id],)
    assert answer.conformity == 0x81, "basic, with access to single objects"


def test_one_object_that_does_not_exist_is_02() -> None:
    with pytest.raises(ModbusException) as caught:
        identify(4, 3)
    assert caught.value.code == 2


def test_its_server_id_says_that_it_runs() -> None:
    answer = Table(product="bench").handle(ReportServerId(), 0.0)
    assert answer is not None
    assert answer.encode() == b"\x11\x07\x01\xffbench"


@pytest.mark.parametrize(("vendor", "product"), [("x" * 245, "y"), ("x", "y" * 245), ("x" * 150, "y" * 100)])
def test_a_name_that_could_never_be_sent_is_refused_at_once(vendor: str, product: str) -> None:
    with refused(EncodeError, "bytes"):
        Table(vendor=vendor, product=product)
