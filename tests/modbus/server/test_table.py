"""Table: the unit of four independent tables in memory."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.errors import EncodeError
from barewire.modbus import (
    Diagnostics,
    MaskWriteRegister,
    ModbusException,
    ReadCoils,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
    ReadDiscreteInputs,
    ReadExceptionStatus,
    ReadFifoQueue,
    ReadFileRecord,
    ReadHoldingRegisters,
    ReadInputRegisters,
    ReadWriteMultipleRegisters,
    ReportServerId,
    Table,
    WriteFileRecord,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)
from barewire.modbus.messages.registry import AnyRequest
from tests.helpers import every_case, refused


def test_written_values_are_read_back() -> None:
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
def test_beyond_the_end_is_exception_02_and_nothing_is_written(request_: AnyRequest) -> None:
    table = Table(4)
    with pytest.raises(ModbusException) as caught:
        table.handle(request_, 0.0)
    assert caught.value.code == 2
    assert not any(table.coils)
    assert not any(table.holding_registers)
    assert (len(table.coils), len(table.holding_registers)) == (4, 4)


def test_an_unsupported_request_is_exception_01() -> None:
    with pytest.raises(ModbusException) as caught:
        Table().handle(Diagnostics(0), 0.0)
    assert caught.value.code == 1


# Identification --------------------------------------------------------------------------------------------------

NAMES = ((0, b"ACME"), (1, b"bench"), (2, b"1"))


def read_identification(read_code: int, object_id: int = 0) -> ReadDeviceIdentificationResponse:
    table = Table(vendor="ACME", product="bench")
    answer = table.handle(ReadDeviceIdentification(read_code, object_id), 0.0)
    assert isinstance(answer, ReadDeviceIdentificationResponse)
    assert answer.read_code == read_code
    assert not answer.more_follows
    return answer


@pytest.mark.parametrize("read_code", [1, 2, 3])
def test_the_basic_objects_are_returned_at_every_level(read_code: int) -> None:
    assert read_identification(read_code).objects == NAMES


@pytest.mark.parametrize("object_id", [0, 1, 2])
def test_a_stream_begins_at_the_object_asked_for(object_id: int) -> None:
    assert read_identification(1, object_id).objects == NAMES[object_id:]


def test_a_stream_from_an_object_that_does_not_exist_begins_again_at_0() -> None:
    assert read_identification(1, 9).objects == NAMES


@pytest.mark.parametrize("object_id", [0, 1, 2])
def test_individual_access_returns_one_object(object_id: int) -> None:
    answer = read_identification(4, object_id)
    assert answer.objects == (NAMES[object_id],)
    assert answer.conformity == 0x81, "basic, with individual access"


def test_an_unknown_individual_object_is_exception_02() -> None:
    with pytest.raises(ModbusException) as caught:
        read_identification(4, 3)
    assert caught.value.code == 2


def test_the_server_id_has_run_indicator_ff() -> None:
    answer = Table(product="bench").handle(ReportServerId(), 0.0)
    assert answer is not None
    assert answer.encode() == b"\x11\x07\x01\xffbench"


@pytest.mark.parametrize(("vendor", "product"), [("x" * 245, "y"), ("x", "y" * 245)])
def test_a_name_that_is_too_long_is_refused(vendor: str, product: str) -> None:
    with refused(EncodeError, "bytes"):
        Table(vendor=vendor, product=product)


@every_case(
    ("options", "text"),
    [
        ({"size": -1}, "size = -1: expected 0..65536"),
        ({"size": 65537}, "size = 65537: expected 0..65536"),
        ({"objects": {3: 5}}, "object 03h is 5: expected text or bytes"),
        ({"files": {0: (1,)}}, "file = 0: expected 1..65535"),
        ({"files": {70000: (1,)}}, "file = 70000: expected 1..65535"),
        ({"files": 5}, "files = 5: expected a dict, such as {1: [0, 0]}"),
        ({"files": [[1]]}, "files = [[1]]: expected a dict, such as {1: [0, 0]}"),
        ({"files": {1: 5}}, "file 1 = 5: expected a list of registers"),
        ({"files": {1: "ab"}}, "file 1"),
        ({"files": {"1": [0]}}, "file"),
        ({"objects": 5}, "objects = 5: expected a dict, such as {128: 'serial 42'}"),
        ({"objects": ["x"]}, "objects = ['x']: expected a dict, such as {128: 'serial 42'}"),
        ({"objects": {"80": "x"}}, "object '80': expected a number in 00h..06h or 80h..FFh"),
        ({"files": {1: (0,) * 10001}}, "file 1: 10001 records, a file has at most 10000"),
        ({"files": {1: (0, 70000)}}, "file 1: register 1 of 2: 70000 is not a whole number in 0..65535"),
    ],
)
def test_objects_and_files_that_could_never_be_read_are_refused(options: dict[str, Any], text: str) -> None:
    with refused(EncodeError, text):
        Table(**options)


# The rarer functions ---------------------------------------------------------------------------------------------


def test_a_mask_write_changes_the_bits_outside_the_and_mask() -> None:
    table = Table(4)
    table.holding_registers[3] = 0x12
    table.handle(MaskWriteRegister(3, 0xF2, 0x25), 0.0)
    assert table.holding_registers[3] == 0x17


def test_function_17_writes_before_it_reads_and_does_neither_beyond_the_end() -> None:
    table = Table(4)
    answer = table.handle(ReadWriteMultipleRegisters(0, 3, 1, (7, 8)), 0.0)
    assert answer == ReadWriteMultipleRegisters.response((0, 7, 8))  # type: ignore[call-arg]
    for request in (ReadWriteMultipleRegisters(3, 2, 0, (9,)), ReadWriteMultipleRegisters(0, 1, 3, (9, 9))):
        with pytest.raises(ModbusException) as caught:
            table.handle(request, 0.0)
        assert caught.value.code == 2
    assert list(table.holding_registers) == [0, 7, 8, 0]


def test_a_queue_is_read_and_not_emptied() -> None:
    table = Table(4)
    table.queues[0x4DE] = [440, 4740]
    for _ in range(2):
        assert table.handle(ReadFifoQueue(0x4DE), 0.0) == ReadFifoQueue.response((440, 4740))  # type: ignore[call-arg]


def test_a_queue_of_32_is_exception_03_and_no_queue_is_exception_02() -> None:
    table = Table(4)
    table.queues[0] = [0] * 32
    for address, code in ((0, 3), (1, 2)):
        with pytest.raises(ModbusException) as caught:
            table.handle(ReadFifoQueue(address), 0.0)
        assert caught.value.code == code


def test_files_are_read_and_written_group_by_group() -> None:
    table = Table(4, files={4: [0] * 10, 3: range(20)})
    table.handle(WriteFileRecord(((4, 7, (1, 2, 3)), (3, 0, (99,)))), 0.0)
    answer = table.handle(ReadFileRecord(((4, 6, 4), (3, 0, 2))), 0.0)
    assert answer == ReadFileRecord.response(((0, 1, 2, 3), (99, 1)))  # type: ignore[call-arg]


@pytest.mark.parametrize(
    "request_",
    [
        ReadFileRecord(((4, 0, 1), (5, 0, 1))),
        ReadFileRecord(((4, 9, 2),)),
        WriteFileRecord(((4, 0, (7,)), (5, 0, (7,)))),
        WriteFileRecord(((4, 0, (7,)), (4, 9, (7, 7)))),
    ],
)
def test_an_unknown_file_or_record_is_exception_02_and_nothing_is_written(request_: AnyRequest) -> None:
    table = Table(4, files={4: [0] * 10})
    with pytest.raises(ModbusException) as caught:
        table.handle(request_, 0.0)
    assert caught.value.code == 2
    assert not any(table.files[4])


def test_the_exception_status_is_set_by_the_application() -> None:
    table = Table(4)
    table.exception_status = 0x6D
    assert table.handle(ReadExceptionStatus(), 0.0) == ReadExceptionStatus.response(0x6D)  # type: ignore[call-arg]


def test_objects_of_all_levels_are_returned() -> None:
    table = Table(objects={4: "a table", 0x80: b"\x01"})
    answer = table.handle(ReadDeviceIdentification(3, 4), 0.0)
    assert isinstance(answer, ReadDeviceIdentificationResponse)
    assert (answer.conformity, answer.objects) == (0x83, ((4, b"a table"), (0x80, b"\x01")))
