"""A client with a faulty peer, row by row: right values, or an error that lists what was received.

Other clients were measured with the same rows. No wrong value is delivered, and the next request works.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import pytest

from barewire.ascii import AsciiLine
from barewire.conversation import Abandoned, Heard, Send
from barewire.errors import NoAnswer
from barewire.modbus import Bus, EchoLine, Line, ModbusException, ReadHoldingRegisters
from barewire.rtu import RtuLine
from barewire.tcp import TcpLine
from tests.helpers import refused
from tests.modbus.client.faulty import (
    ASCII_REFUSED,
    ASCII_SURVIVED,
    REFUSED,
    SURVIVED,
    TCP_REFUSED,
    TCP_SURVIVED,
    TIMING,
    Reply,
    Unit,
    ask,
    rtu,
    unit_of,
)


@pytest.mark.parametrize("row", SURVIVED.values(), ids=SURVIVED)
def test_the_answer_is_found_and_so_is_the_next_one(row: Callable[[bytes], Reply]) -> None:
    unit, bus = unit_of(row), Bus(RtuLine(TIMING))
    assert unit.play(ask(bus, 18)).registers == (18,)
    assert unit.play(ask(bus, 20)).registers == (20,)


@pytest.mark.parametrize(("row", "text"), REFUSED.values(), ids=REFUSED)
def test_a_wrong_answer_is_in_the_error_and_never_returned(row: Callable[[bytes], Reply], text: str) -> None:
    unit, bus = unit_of(row), Bus(RtuLine(TIMING))
    with refused(NoAnswer, text):
        unit.play(ask(bus, 18))
    assert unit.play(ask(bus, 20)).registers == (20,)


def test_a_local_echo() -> None:
    request = rtu("03 0012 0001")
    unit, bus = unit_of(lambda good: [(0.001, request), (0.02, good)]), Bus(EchoLine(RtuLine(TIMING)))
    assert unit.play(ask(bus, 18)).registers == (18,)
    assert unit.play(ask(bus, 20)).registers == (20,)


def test_an_unconfigured_local_echo() -> None:
    request = rtu("03 0012 0001")
    unit, bus = unit_of(lambda good: [(0.001, request), (0.02, good)]), Bus(RtuLine(TIMING))
    assert unit.play(ask(bus, 18)).registers == (18,)


def test_an_exception_response_is_raised_at_once() -> None:
    unit, bus = unit_of(lambda good: [(0.01, good)]), Bus(RtuLine(TIMING))
    with pytest.raises(ModbusException):
        unit.play(ask(bus, 999))
    assert unit.now < 0.1


def line_of(carrier: str, role: str) -> Line:
    if carrier == "tcp":
        return TcpLine()
    if carrier == "ascii":
        return AsciiLine()
    return RtuLine(TIMING, role="server", units=(1,)) if role == "server" else RtuLine(TIMING)


@pytest.mark.parametrize("late", [1.2, 1.5, 2.0, 2.9])
@pytest.mark.parametrize("carrier", ["rtu", "ascii"])
def test_a_late_answer_is_not_delivered(carrier: str, late: float) -> None:
    unit, bus = Unit(lambda good: [(late, good)], line_of(carrier, "server")), Bus(line_of(carrier, "client"))
    with pytest.raises(NoAnswer):
        unit.play(ask(bus, 16))
    for address in (17, 18, 19):
        assert unit.play(bus.ask(1, ReadHoldingRegisters(address, 1), retries=1)).registers == (address,)


def test_a_late_answer_after_another_units_frame_is_not_delivered() -> None:
    unit, bus = unit_of(lambda good: [(0.2, rtu("03 02 0063", 7)), (1.5, good)]), Bus(RtuLine(TIMING))
    with refused(NoAnswer, "a frame from unit 7"):
        unit.play(ask(bus, 16))
    assert unit.play(ask(bus, 17)).registers == (17,)
    assert bus.counters.late == 1


# Cancellation at every point -----------------------------------------------------------------------------------------


def abandoned_after(steps: int, unit: Unit, conversation: Generator[Any, Any, Any]) -> bool:
    """Run the first `steps` steps of a conversation, then abandon it. False if it ended before."""
    try:
        step = next(conversation)
        for _ in range(steps):
            item = None
            if isinstance(step, Send):
                unit.coming += unit.reply(step.item, unit.now)
            elif unit.coming and unit.coming[0][0] <= max(step.until, unit.now):
                unit.now, item = unit.coming.pop(0)
            else:
                unit.now = max(unit.now, step.until)
            step = conversation.send(Heard(item, unit.now))
        if isinstance(step, Send):
            unit.coming += unit.reply(step.item, unit.now)  # any part of it may have been sent; here: all of it
        conversation.throw(Abandoned("cancelled"))
    except StopIteration:
        return False
    except Abandoned:
        return True
    raise AssertionError("an abandoned conversation continued")


def in_three_pieces(good: bytes) -> Reply:
    """The answer in three pieces."""
    return [(0.3, good[:3]), (0.31, good[3:6]), (0.32, good[6:])]


@pytest.mark.parametrize("recovery", ["probe", "wait"])
@pytest.mark.parametrize("carrier", ["rtu", "ascii", "tcp"])
def test_the_exchange_after_one_abandoned_at_any_point_is_right(recovery: Any, carrier: str) -> None:
    steps = 0
    was_abandoned = True
    while was_abandoned:
        unit = Unit(in_three_pieces, line_of(carrier, "server"), wrong=2)
        bus = Bus(line_of(carrier, "client"), recovery=recovery)
        was_abandoned = abandoned_after(steps, unit, ask(bus, 100))
        assert unit.play(ask(bus, 200)).registers == (200,)
        assert unit.play(ask(bus, 201)).registers == (201,)
        steps += 1
    assert steps > 4


# The same for ASCII --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("row", ASCII_SURVIVED.values(), ids=ASCII_SURVIVED)
def test_over_ascii_the_answer_is_found_and_so_is_the_next_one(row: Callable[[bytes], Reply]) -> None:
    unit, bus = Unit(row, AsciiLine()), Bus(AsciiLine())
    assert unit.play(ask(bus, 18)).registers == (18,)
    assert unit.play(ask(bus, 20)).registers == (20,)


@pytest.mark.parametrize(("row", "text"), ASCII_REFUSED.values(), ids=ASCII_REFUSED)
def test_over_ascii_a_wrong_answer_is_in_the_error_and_never_returned(row: Callable[[bytes], Reply], text: str) -> None:
    unit, bus = Unit(row, AsciiLine()), Bus(AsciiLine())
    with refused(NoAnswer, text):
        unit.play(ask(bus, 18))
    assert unit.play(ask(bus, 20)).registers == (20,)


# The same for TCP ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("row", TCP_SURVIVED.values(), ids=TCP_SURVIVED)
def test_over_tcp_the_answer_is_found_and_so_is_the_next_one(row: Callable[[bytes], Reply]) -> None:
    unit, bus = Unit(row, TcpLine()), Bus(TcpLine())
    assert unit.play(ask(bus, 18)).registers == (18,)
    assert unit.play(ask(bus, 20)).registers == (20,)


@pytest.mark.parametrize(("reply", "text"), TCP_REFUSED.values(), ids=TCP_REFUSED)
def test_over_tcp_a_wrong_answer_is_in_the_error_and_never_returned(reply: bytes, text: str) -> None:
    unit, bus = Unit(lambda good: [(0.01, reply)], TcpLine()), Bus(TcpLine())
    with refused(NoAnswer, text):
        unit.play(ask(bus, 18))
    if bus.line.broken is None:
        assert unit.play(ask(bus, 20)).registers == (20,)
    else:
        assert unit.now < 0.1  # reported at once, not after the time-out


def test_over_tcp_a_late_answer_is_not_delivered_and_no_probe_is_sent() -> None:
    unit, bus = Unit(lambda good: [(1.5, good)], TcpLine()), Bus(TcpLine())
    with pytest.raises(NoAnswer):
        unit.play(ask(bus, 16))
    assert unit.play(ask(bus, 17)).registers == (17,)
    assert (bus.counters.asked, bus.counters.probes) == (2, 0)
