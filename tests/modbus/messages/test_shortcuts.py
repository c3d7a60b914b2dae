"""The shortcuts of register messages give the results of the general path; subclasses use their own checks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import pytest
from hypothesis import given, strategies as st

from barewire.codecs import Layout, from_registers
from barewire.errors import BarewireError, DecodeError, EncodeError
from barewire.modbus import (
    Functions,
    ModbusException,
    ReadHoldingRegisters,
    ReadHoldingRegistersResponse,
    ReadInputRegisters,
    ReadInputRegistersResponse,
    Request,
    Response,
    Server,
    Table,
    Unit,
    register,
)
from barewire.modbus.messages.base import Message
from barewire.modbus.messages.registers import READ_REGISTERS_LIMIT
from barewire.modbus.messages.registry import unregister
from barewire.tcp import TcpLine, decode as tcp_decode, encode as tcp_frame
from tests.helpers import modest

READS = [ReadHoldingRegisters, ReadInputRegisters]
ANSWERS = [ReadHoldingRegistersResponse, ReadInputRegistersResponse]
PDUS = st.binary(max_size=9) | st.builds(
    lambda code, address, quantity, rest: bytes([code, 0, address]) + quantity.to_bytes(2, "big") + rest,
    st.sampled_from([3, 4]), st.integers(0, 255), st.integers(0, 130) | st.integers(0, 0xFFFF),
    st.sampled_from([b"", b"", b"", b"\0"]),
)  # fmt: skip
"""Any bytes, and nearly valid requests."""


def outcome_of(function: Callable[..., Any], *args: Any) -> object:
    """Return the value, or the type and text of the error."""
    try:
        return function(*args)
    except (BarewireError, ModbusException) as error:
        return type(error), str(error), vars(error)


@pytest.mark.parametrize("cls", READS)
@modest
@given(pdu=PDUS)
def test_the_decode_shortcut_gives_the_result_of_the_general_path(cls: type[ReadHoldingRegisters], pdu: bytes) -> None:
    general_path = Message.decode.__func__  # type: ignore[attr-defined]
    assert outcome_of(cls.decode, pdu) == outcome_of(general_path, cls, pdu)


@pytest.mark.parametrize("cls", READS)
@modest
@given(
    quantity=st.integers(1, 4),
    pdu=st.builds(
        lambda code, count, rest: bytes([code, count]) + rest,
        st.sampled_from([3, 3, 4, 4, 0x83, 0x84]), st.integers(0, 9), st.binary(max_size=9),
    ) | st.integers(0, 4).flatmap(lambda n: st.binary(min_size=2 * n, max_size=2 * n).map(
        lambda rest: bytes([3 + n % 2, len(rest)]) + rest)),
)  # fmt: skip
def test_the_response_shortcut_gives_the_result_of_the_general_path(
    cls: type[ReadHoldingRegisters], quantity: int, pdu: bytes
) -> None:
    request = cls(0, quantity)
    assert outcome_of(request.read_response, pdu) == outcome_of(Request.read_response, request, pdu)


def test_both_paths_agree_for_every_quantity() -> None:
    for cls in READS:
        for quantity in range(1, READ_REGISTERS_LIMIT + 1):
            row = tuple(range(0xFFFF, 0xFFFF - quantity, -1))
            pdu = cls.response(row).encode()  # type: ignore[call-arg]
            assert pdu == cls.response.layout.pack(cls.function_code, 2 * quantity, tail=from_registers(row))
            assert cls(0, quantity).read_response(pdu) == cls.response(row)  # type: ignore[call-arg]


@pytest.mark.parametrize("cls", ANSWERS)
@modest
@given(row=st.lists(st.sampled_from([0, 7, 0xFFFF, -1, 0x10000, 1 << 70, 0.5, "1", None, b"2", True]), min_size=1))
def test_the_encode_shortcut_gives_the_result_of_the_general_path(
    cls: type[ReadHoldingRegistersResponse], row: list[Any]
) -> None:
    def general_path() -> bytes:
        return cls.layout.pack(cls.function_code, 2 * len(row), tail=from_registers(row))

    assert outcome_of(lambda: cls(tuple(row)).encode()) == outcome_of(
        lambda: general_path() if cls(tuple(row)) else b""
    )


def test_a_row_that_was_lengthened_after_creation_is_refused_by_encode() -> None:
    row = [1]
    response = ReadHoldingRegistersResponse(row)  # type: ignore[arg-type]
    row += [2] * READ_REGISTERS_LIMIT
    with pytest.raises(EncodeError):
        tcp_frame(1, response.encode())


# Subclasses of a user -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SwappedResponse(ReadHoldingRegistersResponse):
    """Registers with the less significant byte first."""

    function_code: ClassVar[int] = 0x64

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        cls.check_function(pdu)
        return cls(tuple(int.from_bytes(pdu[start : start + 2], "little") for start in range(2, len(pdu), 2)))


@dataclass(frozen=True, slots=True)
class ReadSwapped(ReadHoldingRegisters):
    """Another function code, and even addresses only."""

    function_code: ClassVar[int] = 0x64
    response: ClassVar[type[Response]] = SwappedResponse

    def __post_init__(self) -> None:
        ReadHoldingRegisters.__post_init__(self)
        if self.address % 2:
            raise EncodeError(f"address = {self.address}: expected an even one", "address")


@dataclass(frozen=True, slots=True)
class WideResponse(ReadHoldingRegistersResponse):
    """A response with a byte count of two bytes and one more attribute."""

    age: int = 9

    function_code: ClassVar[int] = 0x65
    layout: ClassVar[Layout] = Layout(">BH", "function_code", "byte_count", tail="registers", count="byte_count")


@dataclass(frozen=True, slots=True)
class ReadWide(ReadHoldingRegisters):
    """A request with one more byte."""

    hurry: int = 1

    function_code: ClassVar[int] = 0x65
    layout: ClassVar[Layout] = Layout(">BHHB", "function_code", "address", "quantity", "hurry")
    response: ClassVar[type[Response]] = WideResponse


def test_a_subclass_decodes_with_its_own_checks() -> None:
    assert ReadSwapped.decode(bytes.fromhex("64 0002 0001")) == ReadSwapped(2, 1)
    with pytest.raises(DecodeError, match="address = 3: expected an even one"):
        ReadSwapped.decode(bytes.fromhex("64 0003 0001"))
    with pytest.raises(DecodeError):
        ReadWide.decode(bytes.fromhex("65 0003 0001"))
    assert ReadWide.decode(bytes.fromhex("65 0003 0001 02")) == ReadWide(3, 1, 2)
    assert ReadSwapped(0, 2).read_response(bytes.fromhex("64 04 0100 0200")) == SwappedResponse((1, 2))
    assert WideResponse((1, 2)).encode() == bytes.fromhex("65 0004 0001 0002")


@pytest.mark.parametrize("request_", [ReadSwapped(2, 2), ReadWide(2, 2)], ids=["swapped", "wide"])
def test_a_table_answers_a_subclass_with_its_own_response_class(request_: ReadHoldingRegisters) -> None:
    table = Table()
    table.holding_registers[2:4] = table.holding_registers.__class__("H", [5, 6])
    response: Any = table.handle(request_, 0.0)
    assert response == request_.response((5, 6))  # type: ignore[call-arg]
    assert repr(response)
    assert hash(response) == hash(request_.response((5, 6)))  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("cls", "asked"), [(ReadSwapped, "64 0002 0002"), (ReadWide, "65 0002 0002 01")], ids=["swapped", "wide"]
)
def test_a_server_treats_a_subclass_as_another_function(cls: type[ReadHoldingRegisters], asked: str) -> None:
    """A table does not support it, although its base class is supported; `Functions` does if it is in `own`."""
    register(cls)
    try:
        own: Any = {cls: lambda request: request.response((5, 6))}
        units: dict[int, Unit] = {
            1: Table(),
            2: Functions(read_holding_registers=lambda *_: [1, 2]),
            3: Functions(own=own),
        }
        server = Server(TcpLine(), units, serial=False)
        pdus = []
        for unit in units:
            (reply,) = server.feed(tcp_frame(unit, bytes.fromhex(asked)), 0.0)
            pdus.append(tcp_decode(reply.data).pdu)
        declined = bytes([cls.function_code | 0x80, 1])
        assert pdus == [declined, declined, cls.response((5, 6)).encode()]  # type: ignore[call-arg]
        assert server.statistics.failures == []
    finally:
        unregister(cls)
