"""A request as one send and one receive: `begin`, then `answered` or the `rest` of the conversation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from barewire.conversation import DEFAULT_TIMEOUT, Abandoned, Heard, Listen, play
from barewire.errors import NoAnswer
from barewire.modbus import (
    Bus,
    ReadHoldingRegisters,
    Request,
    UnitOptions,
    WriteOutcomeUnknown,
    WriteSingleRegister,
)
from barewire.rtu import RtuLine, Timing, encode as rtu_encode
from barewire.tcp import TcpLine, encode
from tests.helpers import answering
from tests.modbus.client.slow import rtu_bus

READ = ReadHoldingRegisters(10, 1)
VALUE = READ.response((7,))  # type: ignore[call-arg]


def begin(bus: Bus, unit: int = 1, request: Request[Any] = READ, now: float = 5.0) -> bytes | None:
    """Return the frame of a request with a time-out of 0.25 s, if it may be sent at once."""
    return bus.begin(unit, request, 0.25, now)


def known_rtu() -> Bus:
    """Return the bus of an RTU line at 19200 bit/s after its first exchange, which ends about 1.0."""
    bus = Bus(RtuLine(Timing.of(19200)))
    play(bus.ask(1, READ), lambda item, now: [(now, rtu_encode(1, VALUE.encode()))], start=1.0)
    return bus


def known(bus: Bus, unit: int = 1) -> Bus:
    """Return the bus after its first exchange with the unit, from which on `begin` may send."""
    play(bus.ask(unit, READ), lambda item, now: [(now, encode(unit, VALUE.encode(), item[0] << 8 | item[1]))])
    return bus


def test_a_request_to_a_known_unit_is_sent_at_once_and_counted() -> None:
    bus = known(Bus(TcpLine()))
    assert begin(bus) == encode(1, READ.encode(), 2)
    assert begin(bus) == encode(1, READ.encode(), 3)
    assert (bus.counters.asked, bus.counters.answered) == (3, 1)


def test_a_unit_that_was_never_asked_needs_the_conversation() -> None:
    assert begin(known(Bus(TcpLine())), 2) is None


def test_a_unit_that_needs_a_pause_needs_the_conversation_and_others_do_not() -> None:
    bus = known(known(Bus(TcpLine(), units={2: UnitOptions(gap=0.5)})), 2)
    assert begin(bus, 2) is None
    assert bus.counters.asked == 2
    assert begin(bus, 1) is not None


def test_a_line_without_numbers_needs_the_conversation_while_an_answer_is_pending() -> None:
    bus = rtu_bus()
    with pytest.raises(NoAnswer):
        play(bus.ask(1, READ), answering(), start=5.0)
    assert begin(bus, now=6.0) is None
    play(bus.settle(), answering(), start=6.0)
    assert begin(bus, now=20.0) == rtu_encode(1, READ.encode())


def heard_before(bus: Bus) -> None:
    """Overhear a whole frame, behind which others may have arrived."""
    bus.overhear(rtu_encode(2, VALUE.encode()), 5.0)


def half_a_frame_before(bus: Bus) -> None:
    bus.line.feed(b"\x02\x03", 5.0)


def sent_before(bus: Bus) -> None:
    """Leave a request open whose exchange was interrupted."""
    assert begin(bus) is not None


def new_connection(bus: Bus) -> None:
    bus.continue_on(RtuLine(Timing(0.0, 0.0, 0.0)))


@pytest.mark.parametrize("happens", [heard_before, half_a_frame_before, sent_before, new_connection])
def test_a_line_without_numbers_needs_the_conversation_if_it_may_not_be_idle(happens: Callable[[Bus], None]) -> None:
    bus = known_rtu()
    happens(bus)
    assert begin(bus, now=9.0) is None


def test_a_line_without_numbers_needs_the_conversation_until_its_silence_is_over() -> None:
    bus = known_rtu()
    assert begin(bus, now=bus.line.quiet_at - 1e-4) is None
    assert begin(bus, now=bus.line.quiet_at) == rtu_encode(1, READ.encode())
    bus.sent(7.0)
    assert bus.line.quiet_at == pytest.approx(7.0 + Timing.of(19200).t35)


def test_an_answer_without_a_number_is_pending_before_its_request_is_sent() -> None:
    bus = known_rtu()
    assert begin(bus) is not None
    bus.overhear(b"", 5.5)  # the next request
    assert [(pending.unit, pending.request) for pending in bus.state.pending] == [(1, READ)]
    assert bus.state.pending[0].until > 5.5 + 3 * DEFAULT_TIMEOUT  # when it was sent is not known


def test_a_dead_unit_needs_the_conversation_until_it_answers() -> None:
    bus = known(Bus(TcpLine(), options=UnitOptions(dead_after=1)))
    assert begin(bus) is not None
    with pytest.raises(NoAnswer, match=r"within 0\.25 s"):
        play(bus.rest(1, READ, 0.25, 5.0), answering(), start=5.0)
    assert begin(bus) is None
    bus.answered(1, 6.0)
    assert begin(bus) is not None


def test_an_answer_is_recorded_for_its_unit_and_time() -> None:
    bus = known(known(Bus(TcpLine()), 2))
    bus.answered(2, 9.0)
    assert bus.counters.answered == 3
    slow = Bus(TcpLine(), options=UnitOptions(gap=0.5))
    slow.answered(2, 9.0)
    assert (slow.state.units[2].free_at, slow.state.units[2].settled) == (9.5, True)


def test_the_rest_begins_by_listening_until_the_time_out_counted_from_sending() -> None:
    bus = known(Bus(TcpLine()))
    assert begin(bus) is not None
    rest = bus.rest(1, READ, 0.25, 5.0)
    assert next(rest) == Listen(5.25)
    with pytest.raises(StopIteration) as done:
        rest.send(Heard(encode(1, VALUE.encode(), 2), 5.1))
    assert done.value.value == VALUE
    assert (bus.counters.asked, bus.counters.answered) == (2, 2)


@pytest.mark.parametrize("unit", [1, 3])
def test_the_rest_without_a_response_names_its_unit_request_and_time_out(unit: int) -> None:
    bus = known(Bus(TcpLine()), unit)
    write = WriteSingleRegister(1, 2)
    assert begin(bus, unit, write) is not None
    with pytest.raises(WriteOutcomeUnknown) as caught:
        play(bus.rest(unit, write, 0.25, 5.0), answering(), start=5.0)
    assert str(caught.value) == (
        f"unit {unit} did not answer Write Single Register within 0.25 s; whether it was carried out is unknown"
    )
    assert (bus.counters.lost, bus.state.units[unit].silent) == (1, 1)


def test_a_write_abandoned_after_it_was_sent_is_outcome_unknown() -> None:
    bus = known(Bus(TcpLine()))
    write = WriteSingleRegister(1, 2)
    assert begin(bus, 1, write) is not None
    rest = bus.rest(1, write, 0.25, 5.0)
    next(rest)
    with pytest.raises(WriteOutcomeUnknown) as caught:
        rest.throw(Abandoned("the cable was unplugged"))
    assert str(caught.value) == (
        "unit 1, Write Single Register: the cable was unplugged; whether it was carried out is unknown"
    )
    assert isinstance(caught.value.__cause__, Abandoned)
    assert bus.counters.lost == 1


def test_a_sibling_shares_units_and_counters_and_has_its_own_line() -> None:
    bus, line = known(Bus(TcpLine(), options=UnitOptions(dead_after=5))), TcpLine(number=lambda: 0x1234)
    sibling = bus.sibling_bus(line)
    assert (sibling.line, sibling is bus) == (line, False)
    assert repr(sibling) == f"<Bus: {line!r}>"
    assert begin(sibling) == encode(1, READ.encode(), 0x1234)
    assert begin(bus) == encode(1, READ.encode(), 2)
    sibling.answered(1, 1.0)
    assert (bus.counters.asked, bus.counters.answered) == (3, 2)
