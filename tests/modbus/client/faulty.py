"""A faulty peer in virtual time: rows of wrong answers, shared by the tests of clients and docs/reference/conform.md.

    SURVIVED       the right answer comes too: it is found, and so is the next one
    REFUSED        it never comes: an error describes what was received, and the next request gets its right answer
    ASCII_...      the same over ASCII
    TCP_...        the same over TCP, where answers are numbered

`outcome` plays one row and returns its result as one word.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from barewire.ascii import encode as encode_ascii
from barewire.conversation import Abandoned, Conversation, Heard, Listen, Wire
from barewire.errors import NoAnswer
from barewire.modbus import Bus, Line, ReadHoldingRegisters, Server, Table
from barewire.rtu import RtuLine, Timing, encode
from barewire.tcp import encode as encode_tcp

TIMING = Timing.of(19200)
Reply = list[tuple[float, bytes]]


class Unit(Wire[bytes]):
    """Answers correctly (each register holds its own address), except where `row` replaces the answer."""

    def __init__(self, row: Callable[[bytes], Reply], line: Line, wrong: int = 1) -> None:
        table = Table(size=256)
        for address in range(256):
            table.holding_registers[address] = address
        self.server = Server(line, {1: table}, serial=not line.numbered)
        self.row, self.wrong = row, wrong
        super().__init__(self.reply)

    def good(self, request: bytes) -> bytes:
        replies = self.server.feed(request, self.now)
        return replies[0].data if replies else b""

    def reply(self, request: bytes, now: float) -> Reply:
        self.wrong -= 1
        good = self.good(request)
        replies = self.row(good) if self.wrong >= 0 else [(0.01, good)]
        begin = max([now, *(arrival for arrival, _ in self.coming)])  # one answer after the other
        return [(begin + after, data) for after, data in replies]


def rtu(pdu: str, unit: int = 1) -> bytes:
    return encode(unit, bytes.fromhex(pdu))


SURVIVED: dict[str, Callable[[bytes], Reply]] = {
    "FF before the answer": lambda good: [(0.01, b"\xff" + good)],
    "00 before the answer": lambda good: [(0.01, b"\x00" + good)],
    "another unit first, then the right one": lambda good: [(0.01, rtu("03 02 00 63", 7)), (0.05, good)],
    "an answer of two registers first": lambda good: [(0.01, rtu("03 04 0001 0002")), (0.05, good)],
    "an answer of another function first": lambda good: [(0.01, rtu("04 02 0063")), (0.05, good)],
    "an exception of another function first": lambda good: [(0.01, rtu("84 02")), (0.05, good)],
    "a damaged answer, then a good one": lambda good: [(0.01, good[:-1] + b"\x55"), (0.2, good)],
    "pauses of 20 ms inside": lambda good: [(0.02 * place, good[place : place + 1]) for place in range(len(good))],
    "noise behind the answer": lambda good: [(0.01, good + b"\x00\x13")],
}
REFUSED: dict[str, tuple[Callable[[bytes], Reply], str]] = {
    "two registers for one": (lambda good: [(0.01, rtu("03 04 0012 0013"))], "byte_count 4 where 2 was asked"),
    "function 04 for 03": (lambda good: [(0.01, rtu("04 02 0012"))], "function 04 where 03"),
    "exception 84 for 03": (lambda good: [(0.01, rtu("84 02"))], "function 84 where 03"),
    "only another unit": (lambda good: [(0.01, rtu("03 02 0012", 7))], "a frame from unit 7, function 03"),
    "a damaged answer": (lambda good: [(0.01, good[:-1] + bytes([good[-1] ^ 1]))], "CRC is"),
    "half an answer": (lambda good: [(0.01, good[:4])], "4 bytes"),
    "nothing": (lambda good: [], "did not answer Read Holding Registers within 1 s"),
}


def colon(pdu: str, unit: int = 1) -> bytes:
    return encode_ascii(unit, bytes.fromhex(pdu))


def wrong_lrc(frame: bytes) -> bytes:
    return frame[:-3] + (b"1" if frame[-3:-2] == b"0" else b"0") + frame[-2:]


ASCII_SURVIVED: dict[str, Callable[[bytes], Reply]] = {
    "characters before the answer": lambda good: [(0.01, b"\xff\x0003" + good)],
    "half of it, then all of it": lambda good: [(0.01, good[:7]), (0.3, good)],
    "another unit first, then the right one": lambda good: [(0.01, colon("03 02 0063", 7)), (0.05, good)],
    "an answer of two registers first": lambda good: [(0.01, colon("03 04 0001 0002")), (0.05, good)],
    "an exception of another function first": lambda good: [(0.01, colon("84 02")), (0.05, good)],
    "a damaged answer, then a good one": lambda good: [(0.01, wrong_lrc(good)), (0.2, good)],
    "pauses inside": lambda good: [(0.05 * place, good[place : place + 1]) for place in range(len(good))],
    "lower-case digits": lambda good: [(0.01, good.lower())],
    "noise behind the answer": lambda good: [(0.01, good + b"\x00:01")],
}
ASCII_REFUSED: dict[str, tuple[Callable[[bytes], Reply], str]] = {
    "two registers for one": (lambda good: [(0.01, colon("03 04 0012 0013"))], "byte_count 4 where 2 was asked"),
    "function 04 for 03": (lambda good: [(0.01, colon("04 02 0012"))], "function 04 where 03"),
    "only another unit": (lambda good: [(0.01, colon("03 02 0012", 7))], "a frame from unit 7, function 03"),
    "a wrong LRC": (lambda good: [(0.01, wrong_lrc(good))], "LRC is"),
    "no colon": (lambda good: [(0.01, good[1:])], "an ASCII frame begins with ':'"),
    "no end": (lambda good: [(0.01, good[:-2])], "without an end"),
    "a G": (lambda good: [(0.01, good[:3] + b"G" + good[4:])], "is not a hexadecimal digit"),
    "an RTU frame": (lambda good: [(0.01, rtu("03 02 0012"))], "without an end"),
}


def tcp(number: int, pdu: str, unit: int = 1) -> bytes:
    return encode_tcp(unit, bytes.fromhex(pdu), number)


TCP_SURVIVED: dict[str, Callable[[bytes], Reply]] = {
    "another transaction first": lambda good: [(0.01, tcp(999, "03 02 0063") + good)],
    "another unit first": lambda good: [(0.01, tcp(1, "03 02 0063", 9)), (0.02, good)],
    "another function first": lambda good: [(0.01, tcp(1, "04 02 0063")), (0.02, good)],
    "byte by byte": lambda good: [(0.01 * place, good[place : place + 1]) for place in range(len(good))],
    "twice": lambda good: [(0.01, good + good)],
}
TCP_REFUSED: dict[str, tuple[bytes, str]] = {
    "two registers for one": (tcp(1, "03 04 0012 0013"), "byte_count 4 where 2 was asked"),
    "function 04 for 03": (tcp(1, "04 02 0012"), "function 04 where 03"),
    "another transaction": (tcp(2, "03 02 0012"), "a frame from unit 1, function 03, transaction 2"),
    "another protocol": (
        bytes.fromhex("0001 0001 0005 01 03 02 0012"),
        "protocol identifier is 00 01, Modbus has 00 00",
    ),
    "length 0": (bytes.fromhex("0001 0000 0000 01 03 02 0012"), "length is 00 00"),
}


def ask(bus: Bus, address: int) -> Conversation[bytes, Any]:
    return bus.ask(1, ReadHoldingRegisters(address, 1))


def unit_of(row: Callable[[bytes], Reply], wrong: int = 1) -> Unit:
    return Unit(row, RtuLine(TIMING, role="server", units=(1,)), wrong)


def outcome(unit: Unit, bus: Bus) -> str:
    """Read registers 18 and 20: "right" if both are right, "error" if the first read raised, "wrong" otherwise."""
    try:
        first = unit.play(ask(bus, 18)).registers
    except NoAnswer:
        first = None
    if bus.line.broken is not None:
        return "error" if first is None else "wrong"
    second = unit.play(ask(bus, 20)).registers
    if second != (20,) or first not in (None, (18,)):
        return "wrong"
    return "error" if first is None else "right"


def abandon_when_sent(unit: Unit, conversation: Conversation[bytes, Any]) -> None:
    """Run a conversation until its request is sent, then abandon it, as a cancelled task does."""
    step = next(conversation)
    while isinstance(step, Listen):
        unit.now = max(unit.now, step.until)
        step = conversation.send(Heard(None, unit.now))
    for item in step.items:
        unit.coming += unit.reply(item, unit.now)
    conversation.send(Heard(None, unit.now))
    with suppress(Abandoned):
        conversation.throw(Abandoned("cancelled"))
