"""`read_response` returns a response only if it fits its request; otherwise the error names what does not fit."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.errors import DecodeError
from barewire.modbus import (
    Diagnostics,
    ModbusException,
    ReadCoils,
    ReadCoilsResponse,
    ReadDeviceIdentification,
    ReadHoldingRegisters,
    ReadHoldingRegistersResponse,
    ReadInputRegisters,
    ReportServerId,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)
from barewire.modbus.messages.registry import AnyRequest
from tests.helpers import every_case, modest, refused, unhex


def test_bits_are_cut_to_the_quantity_of_the_request() -> None:
    assert ReadCoils(0, 10).read_response(unhex("01 02 CD FF")) == ReadCoilsResponse(
        (True, False, True, True, False, False, True, True, True, True)
    )


def test_a_counter_is_not_an_echo() -> None:
    assert Diagnostics(0x0B).read_response(unhex("08 000B 0011")).count == 17


def test_another_number_of_registers_is_a_mismatch() -> None:
    assert ReadHoldingRegisters(0, 2).read_response(unhex("03 04 0001 0002")) == ReadHoldingRegistersResponse((1, 2))


@every_case(
    ("request_", "pdu", "at", "text"),
    [
        (ReadHoldingRegisters(0, 2), "04 04 0001 0002", 0, "function 04 where 03 (Read Holding Registers)"),
        (ReadInputRegisters(0, 2), "03 04 0001 0002", 0, "function 03 where 04 (Read Input Registers)"),
        (ReadHoldingRegisters(0, 2), "84 02", 0, "function 84 where 03"),
        (ReadHoldingRegisters(0, 2), "03 02 0001", 1, "byte_count 2 where 4 was asked (Read Holding Registers)"),
        (ReadHoldingRegisters(0, 2), "03 06 0001 0002 0003", 1, "byte_count 6 where 4 was asked"),
        (ReadCoils(0, 9), "01 01 FF", 1, "byte_count 1 where 2 was asked (Read Coils)"),
        (ReadCoils(0, 8), "01 02 FFFF", 1, "byte_count 2 where 1 was asked"),
        (WriteSingleCoil(5, True), "05 0006 FF00", 1, "address 6 where 5 was asked (Write Single Coil)"),
        (WriteSingleCoil(5, True), "05 0005 0000", 3, "value False where True was asked"),
        (WriteSingleRegister(5, 7), "06 0006 0007", 1, "address 6 where 5 was asked"),
        (WriteSingleRegister(5, 7), "06 0005 0008", 3, "value 8 where 7 was asked"),
        (WriteMultipleCoils(5, (True,) * 9), "0F 0006 0009", 1, "address 6 where 5 was asked"),
        (WriteMultipleCoils(5, (True,) * 9), "0F 0005 0008", 3, "quantity 8 where 9 was asked"),
        (WriteMultipleRegisters(5, (1, 2)), "10 0006 0002", 1, "address 6 where 5 was asked"),
        (WriteMultipleRegisters(5, (1, 2)), "10 0005 0001", 3, "quantity 1 where 2 was asked"),
        (Diagnostics(0x0B), "08 000C 0011", 1, "sub_function 12 where 11 was asked (Diagnostics)"),
        (Diagnostics(0x00, b"\xa5\x37"), "08 0000 A538", 3, "data A5 38 where A5 37 was asked (Diagnostics)"),
        (Diagnostics(0x01, b"\xff\x00"), "08 0001 0000", 3, "data 00 00 where FF 00 was asked"),
        (ReadDeviceIdentification(1), "2B 0E 02 02 00 00 00", 2, "read_code 2 where 1 was asked"),
        (ReportServerId(), "07 00", 0, "function 07 where 11 (Report Server ID)"),
    ],
)
def test_a_response_to_another_request_is_a_mismatch(request_: AnyRequest, pdu: str, at: int, text: str) -> None:
    with refused(DecodeError, text) as caught:
        request_.read_response(unhex(pdu))
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == ("mismatch", at)


@pytest.mark.parametrize("code", [1, 2, 3, 4, 6, 11, 99, 0, 255])
def test_an_exception_response_to_the_function_is_raised(code: int) -> None:
    with pytest.raises(ModbusException) as caught:
        ReadHoldingRegisters(0, 2).read_response(bytes([0x83, code]))
    assert (caught.value.code, caught.value.function_code) == (code, 3)


@pytest.mark.parametrize("pdu", ["83", "83 02 00"])
def test_a_truncated_exception_response_is_a_decode_error(pdu: str) -> None:
    with pytest.raises(DecodeError):
        ReadHoldingRegisters(0, 2).read_response(unhex(pdu))


@modest
@given(st.one_of(st.binary(max_size=20), st.binary(max_size=8).map(lambda rest: b"\x03\x04" + rest)))
def test_any_bytes_are_the_response_or_raise(pdu: bytes) -> None:
    is_response = pdu[:2] == b"\x03\x04" and len(pdu) == 6
    try:
        answer = ReadHoldingRegisters(0, 2).read_response(pdu)
    except (DecodeError, ModbusException):
        answer = None
    assert (answer is not None) == is_response
    assert answer is None or answer.encode() == pdu
