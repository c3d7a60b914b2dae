"""The limits of the fields: the lowest and the highest value are accepted, one beyond is refused."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.errors import EncodeError
from barewire.modbus import (
    CanopenReference,
    CanopenReferenceResponse,
    Diagnostics,
    DiagnosticsResponse,
    ExceptionResponse,
    ExtendedExceptionResponse,
    GetCommEventCounterResponse,
    GetCommEventLogResponse,
    MaskWriteRegister,
    Message,
    ReadCoils,
    ReadCoilsResponse,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
    ReadDiscreteInputs,
    ReadExceptionStatusResponse,
    ReadFifoQueue,
    ReadFifoQueueResponse,
    ReadFileRecord,
    ReadHoldingRegisters,
    ReadHoldingRegistersResponse,
    ReadInputRegisters,
    ReadWriteMultipleRegisters,
    ReadWriteMultipleRegistersResponse,
    ReportServerIdResponse,
    WriteFileRecord,
    WriteMultipleCoils,
    WriteMultipleCoilsResponse,
    WriteMultipleRegisters,
    WriteMultipleRegistersResponse,
    WriteSingleCoil,
    WriteSingleCoilResponse,
    WriteSingleRegister,
)
from barewire.modbus.messages.combined import masked
from tests.helpers import refused, unhex


@pytest.mark.parametrize(
    ("make", "field", "low", "high"),
    [
        pytest.param(lambda n: ReadCoils(n, 1), "address", 0, 0xFFFF, id="ReadCoils"),
        pytest.param(lambda n: ReadCoils(0, n), "quantity", 1, 2000, id="ReadCoils"),
        pytest.param(lambda n: ReadDiscreteInputs(0, n), "quantity", 1, 2000, id="ReadDiscreteInputs"),
        pytest.param(lambda n: ReadHoldingRegisters(n, 1), "address", 0, 0xFFFF, id="ReadHoldingRegisters"),
        pytest.param(lambda n: ReadHoldingRegisters(0, n), "quantity", 1, 125, id="ReadHoldingRegisters"),
        pytest.param(lambda n: ReadInputRegisters(0, n), "quantity", 1, 125, id="ReadInputRegisters"),
        pytest.param(lambda n: WriteSingleCoil(n, True), "address", 0, 0xFFFF, id="WriteSingleCoil"),
        pytest.param(lambda n: WriteSingleRegister(n, 0), "address", 0, 0xFFFF, id="WriteSingleRegister"),
        pytest.param(lambda n: WriteSingleRegister(0, n), "value", 0, 0xFFFF, id="WriteSingleRegister"),
        pytest.param(lambda n: WriteMultipleCoilsResponse(0, n), "quantity", 1, 1968, id="coils written"),
        pytest.param(lambda n: WriteMultipleRegistersResponse(0, n), "quantity", 1, 123, id="registers written"),
        pytest.param(lambda n: ReadExceptionStatusResponse(n), "status", 0, 0xFF, id="exception status"),
        pytest.param(lambda n: ReadDeviceIdentification(n, 0), "read_code", 1, 4, id="identification"),
        pytest.param(lambda n: ReadDeviceIdentification(1, n), "object_id", 0, 0xFF, id="identification"),
        pytest.param(lambda n: GetCommEventCounterResponse(n, 0), "status", 0, 0xFFFF, id="event counter"),
        pytest.param(lambda n: GetCommEventCounterResponse(0, n), "event_count", 0, 0xFFFF, id="event counter"),
        pytest.param(lambda n: GetCommEventLogResponse(0, 0, n, b""), "message_count", 0, 0xFFFF, id="event log"),
        pytest.param(lambda n: ReadFileRecord(((n, 0, 1),)), "file", 1, 0xFFFF, id="ReadFileRecord"),
        pytest.param(lambda n: ReadFileRecord(((1, n, 1),)), "record", 0, 9999, id="ReadFileRecord"),
        pytest.param(lambda n: WriteFileRecord(((n, 0, (0,)),)), "file", 1, 0xFFFF, id="WriteFileRecord"),
        pytest.param(lambda n: WriteFileRecord(((1, n, (0,)),)), "record", 0, 9999, id="WriteFileRecord"),
        pytest.param(lambda n: MaskWriteRegister(n, 0, 0), "address", 0, 0xFFFF, id="MaskWriteRegister"),
        pytest.param(lambda n: MaskWriteRegister(0, n, 0), "and_mask", 0, 0xFFFF, id="MaskWriteRegister"),
        pytest.param(lambda n: MaskWriteRegister(0, 0, n), "or_mask", 0, 0xFFFF, id="MaskWriteRegister"),
        pytest.param(lambda n: ReadWriteMultipleRegisters(n, 1, 0, (0,)), "read_address", 0, 0xFFFF, id="read/write"),
        pytest.param(lambda n: ReadWriteMultipleRegisters(0, n, 0, (0,)), "read_quantity", 1, 125, id="read/write"),
        pytest.param(lambda n: ReadWriteMultipleRegisters(0, 1, n, (0,)), "write_address", 0, 0xFFFF, id="read/write"),
        pytest.param(lambda n: ReadFifoQueue(n), "address", 0, 0xFFFF, id="ReadFifoQueue"),
        pytest.param(lambda n: CanopenReference.read(n, 0, count=1), "node", 1, 127, id="CanopenReference"),
        pytest.param(lambda n: CanopenReference.read(1, n, count=1), "index", 0, 0xFFFF, id="CanopenReference"),
        pytest.param(lambda n: CanopenReference.read(1, 0, n, count=1), "sub_index", 0, 0xFF, id="CanopenReference"),
        pytest.param(lambda n: CanopenReference(1, 0, 0, n, 1), "start", 0, 0xFFFF, id="CanopenReference"),
        pytest.param(lambda n: ExtendedExceptionResponse(n), "abort_code", 0, 0xFFFFFFFF, id="SDO abort"),
        pytest.param(lambda n: ExceptionResponse(n, 1), "function_code", 0x80, 0xFF, id="exception"),
        pytest.param(lambda n: ExceptionResponse(0x83, n), "exception_code", 0, 0xFF, id="exception"),
    ],
)
def test_both_limits_are_accepted_and_one_beyond_is_refused(make: Any, field: str, low: int, high: int) -> None:
    for value in (low, high):
        assert decode_of(make(value)) == make(value)
    for value in (low - 1, high + 1):
        with refused(EncodeError, f"{field} = {value}: expected {low}..{high}") as caught:
            make(value)
        assert isinstance(caught.value, EncodeError)
        assert caught.value.field == field


def decode_of(message: Message) -> Message:
    return type(message).decode(message.encode())


@pytest.mark.parametrize(
    ("make", "high"),
    [
        pytest.param(lambda n: WriteMultipleCoils(0, (True,) * n), 1968, id="WriteMultipleCoils"),
        pytest.param(lambda n: WriteMultipleRegisters(0, (0,) * n), 123, id="WriteMultipleRegisters"),
        pytest.param(lambda n: ReadCoilsResponse((True,) * n), 2000, id="ReadCoilsResponse"),
        pytest.param(lambda n: ReadHoldingRegistersResponse((0,) * n), 125, id="ReadHoldingRegistersResponse"),
    ],
)
def test_rows_have_at_least_one_value_and_at_most_as_many_as_fit(make: Any, high: int) -> None:
    for quantity in (1, high):
        assert len(make(quantity).encode()) <= 253
    for quantity in (0, high + 1):
        with refused(EncodeError, f"quantity = {quantity}: expected 1..{high}"):
            make(quantity)


@pytest.mark.parametrize("value", [-1, 0x10000, 1.5])
def test_each_register_is_checked_when_the_message_is_made(value: int) -> None:
    with refused(EncodeError, f"register 1 of 2: {value!r} is not a whole number in 0..65535"):
        WriteMultipleRegisters(0, (0, value))


@pytest.mark.parametrize(
    ("make", "low", "high", "name"),
    [
        pytest.param(lambda n: ReadWriteMultipleRegisters(0, 1, 0, (0,) * n), 1, 121, "write_quantity", id="17"),
        pytest.param(lambda n: ReadWriteMultipleRegistersResponse((0,) * n), 1, 125, "quantity", id="17 answered"),
        pytest.param(lambda n: ReadFifoQueueResponse((0,) * n), 0, 31, "fifo_count", id="18 answered"),
        pytest.param(lambda n: GetCommEventLogResponse(0, 0, 0, bytes(n)), 0, 64, "events", id="0C answered"),
    ],
)
def test_row_limits_of_the_rarer_functions(make: Any, low: int, high: int, name: str) -> None:
    for quantity in (low, high):
        assert len(make(quantity).encode()) <= 253
        assert decode_of(make(quantity)) == make(quantity)
    for quantity in {low - 1, high + 1} - {-1}:
        with refused(EncodeError, f"{name} = {quantity}: expected {low}..{high}"):
            make(quantity)


def test_file_requests_accept_as_many_groups_as_fit() -> None:
    assert len(ReadFileRecord(((1, 0, 1),) * 35).encode()) == 2 + 245
    with refused(EncodeError, "byte_count = 252: expected 7..245"):
        ReadFileRecord(((1, 0, 1),) * 36)
    with refused(EncodeError, "byte_count = 0: expected 7..245"):
        ReadFileRecord(())
    with refused(EncodeError, "length = 0: expected 1..125"):
        ReadFileRecord(((1, 0, 0),))
    assert len(WriteFileRecord(((1, 0, (0,) * 122),)).encode()) == 253
    with refused(EncodeError, "byte_count = 253: expected 9..251"):
        WriteFileRecord(((1, 0, (0,) * 123),))
    with refused(EncodeError, "byte_count = 0: expected 9..251"):
        WriteFileRecord(())
    with refused(EncodeError, "register 0 of 1: 65536"):
        WriteFileRecord(((1, 0, (0x10000,)),))


def test_a_read_of_records_whose_answer_would_not_fit_is_refused() -> None:
    ReadFileRecord(((1, 0, 124),))
    with refused(EncodeError, "the answer would have 254 bytes: more than the 253 of a PDU"):
        ReadFileRecord(((1, 0, 125),))


@pytest.mark.parametrize(
    ("sub_function", "data"),
    [(0x01, "0001"), (0x01, "00FF"), (0x02, "0001"), (0x03, "0D0A"), (0x04, "0100"), (0x0B, "0001"), (0x14, "FFFF")],
)
def test_diagnostics_refuses_data_that_its_sub_function_does_not_allow(sub_function: int, data: str) -> None:
    with refused(EncodeError, f"for sub-function {sub_function:02X}: expected") as caught:
        Diagnostics(sub_function, unhex(data))
    assert isinstance(caught.value, EncodeError)
    assert caught.value.field == "data"
    DiagnosticsResponse(sub_function, unhex(data))


def test_a_reserved_sub_function_may_have_any_data() -> None:
    assert decode_of(Diagnostics(0x99, b"\x01\x02\x03")) == Diagnostics(0x99, b"\x01\x02\x03")


def test_canopen_data_is_as_long_as_its_count() -> None:
    CanopenReference.write_to(1, 0x2000, 0, bytes(241))
    CanopenReference.write_to(1, 0x2000, 0, bytes(242), dialect="schneider")
    with refused(EncodeError, "data length = 242: expected 0..241"):
        CanopenReference.write_to(1, 0x2000, 0, bytes(242))
    with refused(EncodeError, "3 bytes of data for a count of 4"):
        CanopenReference(1, 0x2000, count=4, data=b"abc", write=True)
    with refused(EncodeError, "0 bytes of data for a count of 4"):
        CanopenReferenceResponse(1, 0x2000, count=4)
    with refused(EncodeError, "dialect 'nanotec': expected one of cia309, schneider"):
        CanopenReference(1, 0x2000, dialect="nanotec")  # type: ignore[arg-type]


def test_a_mask_write_sets_the_bits_of_the_or_mask_where_and_is_0() -> None:
    assert masked(0xABCD, ~0b110 & 0xFFFF, 0b010) == 0xABCB


def test_a_written_row_may_be_any_sequence() -> None:
    assert WriteMultipleRegisters(0, [1, 2]) == WriteMultipleRegisters(0, (1, 2))
    assert WriteMultipleCoils(0, (1, 0)) == WriteMultipleCoils(0, (True, False))


def test_an_object_longer_than_any_pdu_is_refused_at_once() -> None:
    ReadDeviceIdentificationResponse(1, 1, ((0, bytes(244)),)).encode()
    with refused(EncodeError, "object 00h has 245 bytes: more than 244 never fit a PDU"):
        ReadDeviceIdentificationResponse(1, 1, ((0, bytes(245)),))


def test_objects_that_do_not_fit_together_are_refused() -> None:
    with refused(EncodeError, "a PDU of 254 bytes: expected 1..253"):
        ReadDeviceIdentificationResponse(1, 1, ((0, bytes(200)), (1, bytes(43)))).encode()


@pytest.mark.parametrize("length", [0, 1, 2, 3, 250])
def test_query_data_may_have_any_length(length: int) -> None:
    echo = Diagnostics(0x00, bytes(length))
    assert decode_of(echo) == echo
    assert echo.read_response(echo.encode()) == DiagnosticsResponse(0x00, bytes(length))


def test_query_data_of_251_bytes_is_refused() -> None:
    with refused(EncodeError, "data length = 251: expected 0..250"):
        Diagnostics(0x00, bytes(251))


def test_a_server_id_of_252_bytes_is_refused() -> None:
    assert len(ReportServerIdResponse(bytes(251)).encode()) == 253
    with refused(EncodeError, "byte_count = 252: expected 0..251"):
        ReportServerIdResponse(bytes(252))


@pytest.mark.parametrize("value", [2, -1, 0xFF00, None, "on", 0.5])
def test_a_coil_value_other_than_true_or_false_is_refused(value: Any) -> None:
    """For example FF00h, the value on the wire."""
    for make in (WriteSingleCoil, WriteSingleCoilResponse):
        with refused(EncodeError, f"value = {value!r}: expected True or False") as caught:
            make(0, value)
        assert isinstance(caught.value, EncodeError)
        assert caught.value.field == "value"
    with refused(EncodeError, f"bit 1 of 2: {value!r} is not True or False"):
        WriteMultipleCoils(0, (True, value))
    with refused(EncodeError, f"bit 1 of 2: {value!r} is not True or False"):
        ReadCoilsResponse((True, value)).encode()


def test_a_coil_value_may_be_0_or_1() -> None:
    one: Any = 1  # declared as bool; programs without a type checker pass numbers
    assert WriteSingleCoil(0, one) == WriteSingleCoil(0, True)
    assert WriteSingleCoil(0, one - 1).read_response(unhex("05 0000 0000")) == WriteSingleCoilResponse(0, False)
