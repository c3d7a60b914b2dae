"""Wrong values of requests: one EncodeError that names the field, the value and what was expected."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import FrozenInstanceError
from typing import Any

import pytest

from barewire.errors import EncodeError
from barewire.modbus import (
    CanopenReference,
    CanopenReferenceResponse,
    Diagnostics,
    DiagnosticsResponse,
    GetCommEventLogResponse,
    RawRequest,
    ReadCoils,
    ReadCoilsResponse,
    ReadDeviceIdentificationResponse,
    ReadDiscreteInputsResponse,
    ReadFifoQueueResponse,
    ReadFileRecord,
    ReadFileRecordResponse,
    ReadHoldingRegisters,
    ReadHoldingRegistersResponse,
    ReadInputRegistersResponse,
    ReadWriteMultipleRegisters,
    ReadWriteMultipleRegistersResponse,
    ReportServerIdResponse,
    WriteFileRecord,
    WriteFileRecordResponse,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from tests.helpers import every_case, refused

WITH_REGISTERS: list[Callable[[Any], Any]] = [
    lambda values: WriteMultipleRegisters(0, values),
    lambda values: ReadWriteMultipleRegisters(0, 1, 0, values),
    lambda values: WriteFileRecord(((1, 0, values),)),
]


@every_case("values", [b"abc", bytearray(b"abc"), "abc", 1, None, 1.5])
@every_case("message", WITH_REGISTERS)
def test_registers_are_a_list_of_numbers(message: Callable[[Any], Any], values: Any) -> None:
    with refused(EncodeError, f"registers = {values!r}: expected a list of whole numbers in 0..65535"):
        message(values)


@pytest.mark.parametrize("values", [b"\1\0", "ab", 1, None])
def test_coils_are_a_list_of_bits(values: Any) -> None:
    with refused(EncodeError, f"bits = {values!r}: expected a list of True and False"):
        WriteMultipleCoils(0, values)


@pytest.mark.parametrize("message", WITH_REGISTERS)
def test_lists_tuples_and_ranges_are_registers(message: Callable[[Any], Any]) -> None:
    assert message([5, 6]).encode() == message((5, 6)).encode() == message(range(5, 7)).encode()


@pytest.mark.parametrize("value", ["0", 1.0, None, "x"])
def test_numbers_are_whole_numbers(value: Any) -> None:
    with refused(EncodeError, f"address = {value!r}: expected a whole number in 0..65535"):
        ReadHoldingRegisters(value, 1)
    with refused(EncodeError, f"quantity = {value!r}: expected a whole number in 1..2000"):
        ReadCoils(0, value)
    with refused(EncodeError, f"value = {value!r}: expected a whole number in 0..65535"):
        WriteSingleRegister(0, value)


def test_a_whole_number_out_of_range_is_refused_with_the_range() -> None:
    with refused(EncodeError, "address = 65536: expected 0..65535"):
        ReadHoldingRegisters(65536, 1)


def test_no_attribute_of_a_message_can_be_set_or_deleted() -> None:
    message = ReadHoldingRegisters(0, 2)
    for name in ("address", "adress"):
        with pytest.raises(FrozenInstanceError, match=f"cannot assign to field '{name}'"):
            setattr(message, name, 5)
        with pytest.raises(FrozenInstanceError, match=f"cannot delete field '{name}'"):
            delattr(message, name)


RESPONSES_WITH_REGISTERS: list[Callable[[Any], Any]] = [
    ReadHoldingRegistersResponse,
    ReadInputRegistersResponse,
    ReadWriteMultipleRegistersResponse,
    ReadFifoQueueResponse,
    lambda values: ReadFileRecordResponse((values,)),
]


@every_case("values", [b"abc", bytearray(b"abc"), "abc", 1, None, 1.5, {1: 2}])
@every_case("message", RESPONSES_WITH_REGISTERS)
def test_registers_of_a_response_are_a_list_of_numbers(message: Callable[[Any], Any], values: Any) -> None:
    """Two bytes are one register, and not two."""
    with refused(EncodeError, f"registers = {values!r}: expected a list of whole numbers in 0..65535"):
        message(values)


@every_case("values", [b"\1\0", "ab", 1, None, {1: 2}])
@every_case("message", [ReadCoilsResponse, ReadDiscreteInputsResponse])
def test_bits_of_a_response_are_a_list_of_bits(message: Callable[[Any], Any], values: Any) -> None:
    with refused(EncodeError, f"bits = {values!r}: expected a list of True and False"):
        message(values)


WITH_GROUPS: list[tuple[Callable[[Any], Any], str, str]] = [
    (ReadFileRecord, "places", "(file, record, length)"),
    (WriteFileRecord, "records", "(file, record, registers)"),
    (WriteFileRecordResponse, "records", "(file, record, registers)"),
    (lambda objects: ReadDeviceIdentificationResponse(1, 1, objects), "objects", "(object_id, value)"),
]


@every_case("groups", [[(1,)], [(1, 2, 3, 4)], [1], [(1, 2, 3), ()], 1, None, "abc", b"abc", {1: 2}])
@every_case(("message", "name", "expected"), WITH_GROUPS)
def test_groups_are_a_list_of_tuples(message: Callable[[Any], Any], name: str, expected: str, groups: Any) -> None:
    with refused(EncodeError, f"{name} = {groups!r}: expected a list of {expected}"):
        message(groups)


def test_groups_of_a_response_are_a_list() -> None:
    with refused(EncodeError, "records = 5: expected a list of lists of registers"):
        message: Any = 5
        ReadFileRecordResponse(message)


WITH_BYTES: list[tuple[Callable[[Any], Any], str]] = [
    (lambda data: Diagnostics(0, data), "data"),
    (lambda data: DiagnosticsResponse(0, data), "data"),
    (ReportServerIdResponse, "data"),
    (lambda events: GetCommEventLogResponse(0, 0, 0, events), "events"),
    (lambda data: CanopenReference.write_to(1, 0x1000, 0, data), "data"),
    (lambda data: CanopenReferenceResponse(1, 0x1000, count=2, data=data), "data"),
    (lambda value: ReadDeviceIdentificationResponse(1, 1, ((0, value),)), "value"),
]


@every_case("data", ["ab", "", (1, 2), [], 1, None, 1.5, [1, 2]])
@every_case(("message", "name"), WITH_BYTES)
def test_data_are_bytes(message: Callable[[Any], Any], name: str, data: Any) -> None:
    with refused(EncodeError, f"{name} = {data!r}: expected bytes"):
        message(data)


@every_case(("message", "name"), WITH_BYTES)
def test_what_has_bytes_becomes_bytes(message: Callable[[Any], Any], name: str) -> None:
    """A message can be in a set, and does not change."""
    for data in (bytearray(b"ab"), memoryview(b"ab")):
        made = message(data)
        assert made == message(b"ab")
        assert hash(made) == hash(message(b"ab"))
        assert made.encode() == message(b"ab").encode()


def test_the_dialect_of_a_reference_is_one_of_the_known() -> None:
    with refused(EncodeError, "dialect []: expected one of cia309, schneider"):
        dialect: Any = []
        CanopenReference.read(1, 0x1000, count=2, dialect=dialect)


def test_a_request_as_bytes_has_any_function_code_without_bit_7() -> None:
    """Also 00, which is not valid: a gateway passes it on, and the unit declines it."""
    assert RawRequest(b"\0\1").encode() == b"\0\1"
    assert RawRequest(b"\x7f").function_code == 0x7F
    with refused(EncodeError, "function code 80h: a request has 00h..7Fh"):
        RawRequest(b"\x80")
