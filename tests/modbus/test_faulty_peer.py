"""A client against a peer that does everything wrong, row by row: right values, or an error that says what was heard.

Each row is one that other clients were measured with. Nothing wrong is ever delivered, and the question after it works.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import pytest

from barewire.conversation import Abandoned, Conversation, Heard, Send
from barewire.errors import NoAnswer
from barewire.modbus import Bus, EchoLine, Line, ModbusException, ReadHoldingRegisters, Server, Table
from barewire.rtu import RtuLine, Timing, encode
from barewire.tcp import TcpLine
from barewire.tcp import encode as encode_tcp
from tests.helpers import refused

TIMING = Timing.of(19200)
Reply = list[tuple[float, bytes]]


class Unit:
    """Answers as a good unit does (each register holds its own address), except where `row` says otherwise."""

    def __init__(self, row: Callable[[bytes], Reply], line: Line, wrong: int = 1) -> None:
        table = Table(size=256)
        for address in range(256):
            table.holding_registers[address] = address
        self.server = Server(line, {1: table}, serial=not line.numbered)
        self.row, self.wrong = row, wrong
        self.now = 0.0
        self.coming: Reply = []

    def good(self, request: bytes) -> bytes:
        replies = self.server.feed(request, self.now)
        return replies[0].data if replies else b""

    def play(self, conversation: Conversation[bytes, Any]) -> Any:
        """Carry a conversation out in virtual time."""
        try:
            step = next(conversation)
            while True:
                item = None
                if isinstance(step, Send):
                    self.say(step.item)
                elif self.coming and self.coming[0][0] <= max(step.until, self.now):
                    when, item = self.coming.pop(0)
                    self.now = max(self.now, when)
                else:
                    self.now = max(self.now, step.until)
                step = conversation.send(Heard(item, self.now))
        except StopIteration as stop:
            return stop.value

    def say(self, request: bytes) -> None:
        self.wrong -= 1
        good = self.good(request)
        replies = self.row(good) if self.wrong >= 0 else [(0.01, good)]
        begin = max([self.now, *(when for when, _ in self.coming)])  # one answer behind the other
        self.coming += [(begin + after, data) for after, data in replies]


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
    "pauses of 20 ms inside": lambda good: [(0.02 * at, good[at : at + 1]) for at in range(len(good))],
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


def ask(bus: Bus, address: int) -> Conversation[bytes, Any]:
    return bus.ask(1, ReadHoldingRegisters(address, 1))


def unit_of(row: Callable[[bytes], Reply]) -> Unit:
    return Unit(row, RtuLine(TIMING, role="server", units=(1,)))


@pytest.mark.parametrize("row", SURVIVED.values(), ids=SURVIVED)
def test_the_right_answer_is_found_and_so_is_the_next(row: Callable[[bytes], Reply]) -> None:
    unit, bus = unit_of(row), Bus(RtuLine(TIMING))
    assert unit.play(ask(bus, 18)).registers == (18,)
    assert unit.play(ask(bus, 20)).registers == (20,)


@pytest.mark.parametrize(("row", "said"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_told_and_never_taken(row: Callable[[bytes], Reply], said: str) -> None:
    unit, bus = unit_of(row), Bus(RtuLine(TIMING))
    with refused(NoAnswer, said):
        unit.play(ask(bus, 18))
    assert unit.play(ask(bus, 20)).registers == (20,)


def test_a_local_echo() -> None:
    request = rtu("03 0012 0001")
    unit, bus = unit_of(lambda good: [(0.001, request), (0.02, good)]), Bus(EchoLine(RtuLine(TIMING)))
    assert unit.play(ask(bus, 18)).registers == (18,)
    assert unit.play(ask(bus, 20)).registers == (20,)


def test_a_local_echo_that_nobody_said_anything_of() -> None:
    request = rtu("03 0012 0001")
    unit, bus = unit_of(lambda good: [(0.001, request), (0.02, good)]), Bus(RtuLine(TIMING))
    assert unit.play(ask(bus, 18)).registers == (18,)


def test_an_exception_is_told_at_once() -> None:
    unit, bus = unit_of(lambda good: [(0.01, good)]), Bus(RtuLine(TIMING))
    with pytest.raises(ModbusException):
        unit.play(ask(bus, 999))
    assert unit.now < 0.1


@pytest.mark.parametrize("late", [1.2, 1.5, 2.0, 2.9])
def test_a_late_answer_is_nobodys(late: float) -> None:
    unit, bus = unit_of(lambda good: [(late, good)]), Bus(RtuLine(TIMING))
    with pytest.raises(NoAnswer):
        unit.play(ask(bus, 16))
    for address in (17, 18, 19):
        assert unit.play(ask(bus, address)).registers == (address,)


# Cancellation at every point -----------------------------------------------------------------------------------------


def abandoned_after(steps: int, unit: Unit, conversation: Generator[Any, Any, Any]) -> bool:
    """Carry the first `steps` turns of a conversation out, then abandon it. False if it ended before."""
    try:
        step = next(conversation)
        for _ in range(steps):
            item = None
            if isinstance(step, Send):
                unit.say(step.item)
            elif unit.coming and unit.coming[0][0] <= max(step.until, unit.now):
                unit.now, item = unit.coming.pop(0)
            else:
                unit.now = max(unit.now, step.until)
            step = conversation.send(Heard(item, unit.now))
        if isinstance(step, Send):
            unit.say(step.item)  # nobody knows how much of it went out; here: all of it
        conversation.throw(Abandoned("cancelled"))
    except StopIteration:
        return False
    except Abandoned:
        return True
    raise AssertionError("an abandoned conversation goes on")


def slowly(good: bytes) -> Reply:
    """The answer in three pieces."""
    return [(0.3, good[:3]), (0.31, good[3:6]), (0.32, good[6:])]


@pytest.mark.parametrize("recovery", ["probe", "wait"])
@pytest.mark.parametrize("carrier", ["rtu", "tcp"])
def test_abandoned_at_every_point_of_an_exchange_the_next_one_is_right(recovery: Any, carrier: str) -> None:
    steps = 0
    goes_on = True
    while goes_on:
        line: Line = TcpLine() if carrier == "tcp" else RtuLine(TIMING, role="server", units=(1,))
        unit = Unit(slowly, line, wrong=2)
        bus = Bus(TcpLine() if carrier == "tcp" else RtuLine(TIMING), recovery=recovery)
        goes_on = abandoned_after(steps, unit, ask(bus, 100))
        assert unit.play(ask(bus, 200)).registers == (200,)
        assert unit.play(ask(bus, 201)).registers == (201,)
        steps += 1
    assert steps > 4


# The same for TCP ----------------------------------------------------------------------------------------------------


def tcp(number: int, pdu: str, unit: int = 1) -> bytes:
    return encode_tcp(unit, bytes.fromhex(pdu), number)


TCP_SURVIVED: dict[str, Callable[[bytes], Reply]] = {
    "another transaction first": lambda good: [(0.01, tcp(999, "03 02 0063") + good)],
    "another unit first": lambda good: [(0.01, tcp(1, "03 02 0063", 9)), (0.02, good)],
    "another function first": lambda good: [(0.01, tcp(1, "04 02 0063")), (0.02, good)],
    "byte by byte": lambda good: [(0.01 * at, good[at : at + 1]) for at in range(len(good))],
    "twice": lambda good: [(0.01, good + good)],
}


@pytest.mark.parametrize("row", TCP_SURVIVED.values(), ids=TCP_SURVIVED)
def test_tcp_the_right_answer_is_found_and_so_is_the_next(row: Callable[[bytes], Reply]) -> None:
    unit, bus = Unit(row, TcpLine()), Bus(TcpLine())
    assert unit.play(ask(bus, 18)).registers == (18,)
    assert unit.play(ask(bus, 20)).registers == (20,)


@pytest.mark.parametrize(
    ("reply", "said"),
    [
        (tcp(1, "03 04 0012 0013"), "byte_count 4 where 2 was asked"),
        (tcp(1, "04 02 0012"), "function 04 where 03"),
        (tcp(2, "03 02 0012"), "a frame from unit 1, function 03"),
        (bytes.fromhex("0001 0001 0005 01 03 02 0012"), "protocol identifier is 00 01, Modbus has 00 00"),
        (bytes.fromhex("0001 0000 0000 01 03 02 0012"), "length is 00 00"),
    ],
)
def test_tcp_what_does_not_fit_is_told_and_never_taken(reply: bytes, said: str) -> None:
    unit, bus = Unit(lambda good: [(0.01, reply)], TcpLine()), Bus(TcpLine())
    with refused(NoAnswer, said):
        unit.play(ask(bus, 18))
    if bus.line.broken is None:
        assert unit.play(ask(bus, 20)).registers == (20,)
    else:
        assert unit.now < 0.1  # told at once, not after the time-out


def test_tcp_a_late_answer_is_nobodys_and_nothing_is_sent_but_the_question() -> None:
    unit, bus = Unit(lambda good: [(1.5, good)], TcpLine()), Bus(TcpLine())
    with pytest.raises(NoAnswer):
        unit.play(ask(bus, 16))
    assert unit.play(ask(bus, 17)).registers == (17,)
    assert (bus.counters.asked, bus.counters.probes) == (2, 0)
