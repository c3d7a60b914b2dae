"""A response of registers, from bytes on the wire to numbers, whole and through the line."""

from __future__ import annotations

import struct
from collections.abc import Callable

import pytest
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU
from pytest_benchmark.fixture import BenchmarkFixture

from barewire.modbus import ReadHoldingRegisters, ReadHoldingRegistersResponse
from barewire.rtu import RtuLine, Timing, decode, encode
from barewire.rtu.crc import crc16

Read = Callable[[bytes], tuple[int, ...]]


def by_hand(data: bytes) -> tuple[int, ...]:
    """The floor: what one would write for this message alone."""
    if crc16(data[:-2]) != data[-2] | data[-1] << 8 or data[1] != 3 or data[2] != len(data) - 5:
        raise ValueError
    return struct.unpack(f">{data[2] // 2}H", data[3:-2])


def ours(quantity: int) -> Read:
    request = ReadHoldingRegisters(0, quantity)

    def read(data: bytes) -> tuple[int, ...]:
        return request.read_response(decode(data).pdu).registers

    return read


def ours_streamed(quantity: int) -> Read:
    request = ReadHoldingRegisters(0, quantity)
    line = RtuLine(Timing.of(115200))

    def read(data: bytes) -> tuple[int, ...]:
        (adu,) = line.feed(data, 0.0)
        return request.read_response(adu.pdu).registers

    return read


def pymodbus(quantity: int) -> Read:
    framer = FramerRTU(DecodePDU(is_server=False))

    def read(data: bytes) -> tuple[int, ...]:
        _, pdu = framer.handleFrame(data, 0, 0)
        assert pdu is not None
        return tuple(pdu.registers)

    return read


READERS: dict[str, Callable[[int], Read]] = {
    "by hand": lambda quantity: by_hand,
    "barewire": ours,
    "barewire, through the line": ours_streamed,
    "pymodbus": pymodbus,
}


@pytest.mark.parametrize("quantity", [1, 8, 62, 125])
@pytest.mark.parametrize("reader", READERS)
def test_rtu_response(benchmark: BenchmarkFixture, reader: str, quantity: int) -> None:
    benchmark.group = f"RTU response of {quantity} registers"
    frame = encode(1, ReadHoldingRegistersResponse(tuple(range(quantity))).encode())
    assert benchmark(READERS[reader](quantity), frame) == tuple(range(quantity))
