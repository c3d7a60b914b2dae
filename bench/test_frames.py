"""A response of 1 to 125 registers from bytes on the wire to numbers, and a request from values to bytes.

Whole (one frame, `decode`), streamed (through the line, which must find the end of the frame), and many frames in one
chunk. The floor is code written by hand for this message alone, with our CRC.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from types import ModuleType
from typing import Any

import pytest

import barewire.ascii
import barewire.rtu
import barewire.tcp
from barewire.ascii import AsciiLine
from barewire.modbus import ReadHoldingRegisters, ReadHoldingRegistersResponse
from barewire.rtu import RtuLine, Timing
from barewire.rtu.crc import crc16
from barewire.tcp import TcpLine
from bench.frame_peers import BUILDERS, READERS
from bench.race import Factory, Race, Work, entries

Reader = Callable[[bytes], Any]
QUANTITIES = (1, 8, 62, 125)
ENVELOPES: dict[str, ModuleType] = {"rtu": barewire.rtu, "ascii": barewire.ascii, "tcp": barewire.tcp}


def frame(envelope: str, quantity: int) -> bytes:
    """An answer of unit 1: registers 0, 1, 2 ..."""
    pdu = ReadHoldingRegistersResponse(tuple(range(quantity))).encode()
    if envelope == "tcp":
        return barewire.tcp.encode(1, pdu, 7)
    return bytes(ENVELOPES[envelope].encode(1, pdu))


# By hand


def rtu_by_hand(data: bytes) -> tuple[int, ...]:
    if crc16(data[:-2]) != data[-2] | data[-1] << 8 or data[1] != 3 or data[2] != len(data) - 5:
        raise ValueError
    return struct.unpack(f">{data[2] // 2}H", data[3:-2])


def ascii_by_hand(data: bytes) -> tuple[int, ...]:
    body = bytes.fromhex(data[1:-2].decode())
    if sum(body) & 0xFF or body[1] != 3 or body[2] != len(body) - 4:
        raise ValueError
    return struct.unpack(f">{body[2] // 2}H", body[3:-1])


def tcp_by_hand(data: bytes) -> tuple[int, ...]:
    _, protocol, length, _, code, count = struct.unpack_from(">HHHBBB", data)
    if protocol or length != len(data) - 6 or code != 3 or count != length - 3:
        raise ValueError
    return struct.unpack_from(f">{count // 2}H", data, 9)


HAND: dict[str, Reader] = {"rtu": rtu_by_hand, "ascii": ascii_by_hand, "tcp": tcp_by_hand}


def rtu_request_by_hand() -> bytes:
    body = struct.pack(">BBHH", 1, 3, 107, 10)
    return body + crc16(body).to_bytes(2, "little")


def ascii_request_by_hand() -> bytes:
    body = struct.pack(">BBHH", 1, 3, 107, 10)
    return b":%b%02X\r\n" % (body.hex().upper().encode(), -sum(body) & 0xFF)


def tcp_request_by_hand() -> bytes:
    return struct.pack(">HHHBBHH", 7, 0, 6, 1, 3, 107, 10)


HAND_BUILT = {"rtu": rtu_request_by_hand, "ascii": ascii_request_by_hand, "tcp": tcp_request_by_hand}


# Ours


def ours(envelope: str, quantity: int) -> Reader:
    request, decode = ReadHoldingRegisters(0, quantity), ENVELOPES[envelope].decode
    return lambda data: request.read_response(decode(data).pdu).registers


def _line(envelope: str) -> Any:
    return {"rtu": lambda: RtuLine(Timing.of(115200)), "ascii": AsciiLine, "tcp": TcpLine}[envelope]()


def ours_streamed(envelope: str, quantity: int) -> Reader:
    request, line = ReadHoldingRegisters(0, quantity), _line(envelope)

    def read(data: bytes) -> tuple[int, ...]:
        (adu,) = line.feed(data, 0.0)
        return request.read_response(adu.pdu).registers

    return read


def ours_built(envelope: str) -> Callable[[], bytes]:
    encode = ENVELOPES[envelope].encode
    if envelope == "tcp":
        return lambda: encode(1, ReadHoldingRegisters(107, 10).encode(), 7)
    return lambda: encode(1, ReadHoldingRegisters(107, 10).encode())


# Races


def _reading(make: Callable[[], Reader], data: bytes) -> Factory:
    def factory(_: ExitStack) -> Work:
        return partial(make(), data)

    return factory


def _response(envelope: str, quantity: int) -> Race:
    data = frame(envelope, quantity)
    contestants: dict[str, Factory] = {
        "by hand": _reading(lambda: HAND[envelope], data),
        "barewire": _reading(lambda: ours(envelope, quantity), data),
        "barewire, through the line": _reading(lambda: ours_streamed(envelope, quantity), data),
    }
    for name, make in READERS[envelope].items():
        contestants[name] = _reading(partial(make, envelope, quantity), data)
    expect = tuple(range(quantity))
    return Race(f"{envelope.upper()} response", "registers of one answer", quantity, contestants, expect)


def _request(envelope: str) -> Race:
    right = HAND_BUILT[envelope]()

    def building(make: Callable[[str], Callable[[], bytes]]) -> Factory:
        def factory(_: ExitStack) -> Work:
            work = make(envelope)
            built = bytes(work())
            # On TCP each library has its own transaction numbers.
            assert built[2:] == right[2:] if envelope == "tcp" else built == right, built
            return work

        return factory

    makers = {"by hand": HAND_BUILT.__getitem__, "barewire": ours_built} | BUILDERS[envelope]
    contestants = {name: building(make) for name, make in makers.items()}
    return Race("Building a request", f"read 10 registers, {envelope.upper()}", 10, contestants)


def _chunk(envelope: str, frames: int) -> Race:
    """Return frames of 10 registers, all in one read."""
    data = frames * frame(envelope, 10)
    size = len(data) // frames
    request = ReadHoldingRegisters(0, 10)

    def by_hand(_: ExitStack) -> Work:
        return lambda: [HAND[envelope](data[at : at + size]) for at in range(0, len(data), size)]

    def ours_in_chunk(_: ExitStack) -> Work:
        line = _line(envelope)
        return lambda: [request.read_response(adu.pdu).registers for adu in line.feed(data, 0.0)]

    contestants: dict[str, Factory] = {"by hand": by_hand, "barewire": ours_in_chunk}
    return Race(f"{envelope.upper()} chunk", "frames in one read", frames, contestants, frames * [tuple(range(10))])


@pytest.mark.parametrize(("race", "contestant"), entries(*(_response(e, q) for e in ENVELOPES for q in QUANTITIES)))
def test_response(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)


@pytest.mark.parametrize(("race", "contestant"), entries(*map(_request, ENVELOPES)))
def test_request(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)


@pytest.mark.parametrize(("race", "contestant"), entries(*(_chunk(e, n) for e in ENVELOPES for n in (1, 4, 16, 64))))
def test_chunk(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)
