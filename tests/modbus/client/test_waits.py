"""When a bus may send, and how long it waits: settling, turnarounds, gaps, dead units. Times are exact."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from barewire.conversation import Heard, Listen, Send, Wire, play
from barewire.errors import NoAnswer
from barewire.modbus import (
    Bus,
    EchoLine,
    Line,
    ReadHoldingRegisters,
    ReadInputRegisters,
    UnitOptions,
    WriteSingleRegister,
)
from barewire.rtu import RtuLine, Timing, encode
from barewire.tcp import TcpLine, encode as tcp_frame
from tests.helpers import answering
from tests.modbus.client.slow import Clock, Slow, read, rtu_bus

CHARACTER = 1 / 2048
EXACT = Timing(CHARACTER, 1.5 * CHARACTER, 3.5 * CHARACTER)
LATE = encode(1, b"\x03\x02\x00\x0a")


def two_pending() -> Bus:
    """Return a bus of which two answers may come, until 4.0 and 6.0."""
    bus = Bus(RtuLine(EXACT), late_window=4.0)
    for start, request in ((0.0, ReadHoldingRegisters(10, 1)), (2.0, ReadInputRegisters(10, 1))):
        with pytest.raises(NoAnswer):
            play(bus.ask(1, request, timeout=0.5), answering(), start=start)
    assert [pending.until for pending in bus.state.pending] == [4.03, 6.03]
    return bus


# Settling --------------------------------------------------------------------------------------------------------


def test_a_bus_without_pending_answers_is_settled_at_once() -> None:
    with pytest.raises(StopIteration):
        next(rtu_bus().settle())


def test_settling_listens_until_the_last_pending_answer_cannot_come() -> None:
    bus = two_pending()
    settling = bus.settle()
    assert next(settling) == Listen(6.03)
    assert settling.send(Heard(LATE, 3.0)) == Listen(6.03)
    assert len(bus.state.pending) == 1
    assert bus.counters.replies[0].at == 3.0
    with pytest.raises(StopIteration):
        settling.send(Heard(None, 6.03))
    assert bus.state.pending == []


def test_a_bus_is_settled_as_soon_as_every_late_answer_has_come() -> None:
    bus = two_pending()
    settling = bus.settle()
    next(settling)
    assert settling.send(Heard(LATE, 3.0)) == Listen(6.03)
    with pytest.raises(StopIteration):
        settling.send(Heard(encode(1, b"\x04\x02\x00\x0a"), 3.5))
    assert bus.counters.late == 2


# Before a request ------------------------------------------------------------------------------------------------


def on_tcp(item: bytes, now: float) -> list[tuple[float, bytes]]:
    """A unit on TCP that answers every read of one register at once."""
    return [(now, tcp_frame(item[6], b"\x03\x02\x00\x07", item[0] << 8 | item[1]))]


def test_on_tcp_a_request_is_sent_without_listening_first() -> None:
    frame = tcp_frame(1, ReadHoldingRegisters(10, 1).encode(), 1)
    assert next(read(Bus(TcpLine()), 10)) == Send(frame)


@pytest.mark.parametrize("options", [{"options": UnitOptions(gap=0.5)}, {"units": {1: UnitOptions(gap=0.5)}}])
def test_on_tcp_the_gap_of_a_unit_is_kept_too(options: dict[str, Any]) -> None:
    bus, wire = Bus(TcpLine(), **options), Wire(on_tcp)
    for _ in range(3):
        wire.play(read(bus, 10))
    assert wire.now == 1.0


def test_the_gap_is_kept_after_a_time_out_and_after_a_probe() -> None:
    """A unit that needs a pause needs it whatever came before: an answer, silence, or the answer to a probe."""
    slow = Slow([None])
    sent: list[float] = []

    def unit(item: bytes, now: float) -> list[tuple[float, bytes]]:
        sent.append(now)
        return list(slow(item, now))

    bus, clock = rtu_bus(units={1: UnitOptions(gap=0.5)}), Clock(unit)
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 1, timeout=0.3))
    clock.play(read(bus, 2, timeout=0.3))
    assert bus.counters.probes == 1
    assert [later - before >= 0.5 for before, later in pairwise(sent)] == [True, True]


def test_after_the_gap_of_a_unit_the_line_is_idle_too() -> None:
    bus = Bus(RtuLine(EXACT, patience=0.0), options=UnitOptions(gap=0.5))
    play(read(bus, 10), answering((0.0, LATE)))
    conversation = read(bus, 10)
    assert next(conversation) == Listen(float("-inf"))
    step = conversation.send(Heard(None, 0.25))
    free_at = bus.state.units[1].free_at
    assert step == Listen(free_at)
    # A character of another station, just before the gap is over: t3.5 must pass after it.
    assert conversation.send(Heard(b"\xff", free_at - 0.0001)) == Listen(float("-inf"))
    assert conversation.send(Heard(None, free_at)) == Listen(free_at - 0.0001 + 3.5 * CHARACTER)


def test_the_window_is_three_times_the_longest_time_out_of_any_unit() -> None:
    bus = Bus(RtuLine(EXACT), options=UnitOptions(timeout=0.3), units={2: UnitOptions(timeout=2.0)})
    with pytest.raises(NoAnswer):
        play(read(bus, 10, timeout=0.3), answering())
    assert 6.0 < bus.state.pending[0].until < 6.1


def test_a_dead_unit_is_asked_again_exactly_when_its_pause_is_over() -> None:
    bus, wire = Bus(TcpLine(), options=UnitOptions(dead_after=1)), Wire[bytes](lambda item, now: [])
    for now, text in (
        (0.0, "unit 1 did not answer Read Holding Registers within 1 s"),
        (1.5, "unit 1 left 1 requests unanswered: asked again in 0.5 s"),
        (2.0, "unit 1 did not answer Read Holding Registers within 1 s"),
        (4.0, "unit 1 left 2 requests unanswered: asked again in 1.0 s"),
    ):
        wire.now = now
        with pytest.raises(NoAnswer) as caught:
            wire.play(read(bus, 10))
        assert str(caught.value) == text


def test_the_turnaround_of_a_broadcast_is_a_tenth_of_a_second_by_default() -> None:
    assert play(Bus(RtuLine(EXACT)).broadcast(WriteSingleRegister(1, 2)), answering(), start=1.0) == (None, 1.1)


def test_a_request_gives_up_exactly_when_its_time_out_has_passed_on_a_busy_line() -> None:
    waiting = Bus(RtuLine(EXACT, patience=0.0)).wait_until_idle(0.125)
    assert next(waiting) == Listen(float("-inf"))
    assert waiting.send(Heard(b"\xff", 0.0)) == Listen(3.5 * CHARACTER)
    with pytest.raises(NoAnswer, match=r"another station has been sending for 0\.125 s"):
        waiting.send(Heard(b"\xff", 0.125))


@pytest.mark.parametrize("line", ["rtu", "echo", "tcp"])
def test_where_units_or_numbers_are_compared_a_pending_answer_of_one_unit_does_not_delay_another(line: str) -> None:
    lines: dict[str, Callable[[], Line]] = {
        "rtu": lambda: RtuLine(EXACT),
        "echo": lambda: EchoLine(RtuLine(EXACT), echoes=False),
        "tcp": lambda: TcpLine(any_unit=True),
    }
    bus = Bus(lines[line]())
    frame: Callable[[bytes], bytes] = (
        (lambda item: tcp_frame(item[6], b"\x03\x02\x00\x14", item[1]))
        if (line == "tcp")
        else (lambda item: encode(item[0], b"\x03\x02\x00\x14"))
    )
    clock = Wire[bytes](lambda item, now: [] if now < 0.5 else [(now + 0.01, frame(item))])
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10))
    before = clock.now
    assert clock.play(read(bus, 20, unit=2)) == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]
    assert (bus.counters.probes, bus.counters.strays) == (0, 0)
    assert clock.now - before < 0.1


@pytest.mark.parametrize(("unit", "ends"), [(1, 1.0), (2, 0.25)])
def test_a_wrong_response_ends_the_wait_unless_another_answer_of_the_unit_may_come(unit: int, ends: float) -> None:
    bus = Bus(RtuLine(EXACT), late_window=60.0)
    for asked in (1, 2):  # both units have answered before
        play(read(bus, 10, unit=asked), answering((0.25, encode(asked, b"\x03\x02\x00\x0a"))))
    with pytest.raises(NoAnswer):
        play(bus.ask(1, ReadInputRegisters(10, 1)), answering(), start=1.0)
    wire = Wire(answering((0.25, encode(unit, b"\x03\x04\x00\x0a\x00\x0b"))), start=3.0)
    with pytest.raises(NoAnswer, match="byte_count 4"):
        wire.play(read(bus, 10, unit=unit))
    assert wire.now == 3.0 + ends


@pytest.mark.parametrize("place", ["sent", "feed"])
def test_after_a_ctrl_c_inside_the_exchange_its_answer_is_pending(monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    """Python raises KeyboardInterrupt anywhere, also while no frame is being sent or received."""
    bus = rtu_bus()
    conversation = read(bus, 5)
    step = next(conversation)
    while not isinstance(step, Send):
        step = conversation.send(Heard(None, 1.0))

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(type(bus.line), place, interrupted)
    with pytest.raises(KeyboardInterrupt):
        any(conversation.send(heard) is None for heard in (Heard(None, 1.0), Heard(b"\1", 1.1)))
    assert len(bus.state.pending) == 1
