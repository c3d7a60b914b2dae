"""A request as one send and one receive: `begin`, then `answered` or the `rest` of the conversation."""

from __future__ import annotations

import pytest

from barewire.conversation import Abandoned, Heard, Listen, play
from barewire.errors import NoAnswer
from barewire.modbus import Bus, ReadHoldingRegisters, WriteOutcomeUnknown, WriteSingleRegister
from barewire.tcp import TcpLine, encode
from tests.helpers import answering
from tests.modbus.client.slow import rtu_bus

READ = ReadHoldingRegisters(10, 1)
VALUE = READ.response((7,))  # type: ignore[call-arg]


def known(bus: Bus, unit: int = 1) -> Bus:
    """Return the bus after its first exchange with the unit, from which on `begin` may send."""
    play(bus.ask(unit, READ), lambda item, now: [(now, encode(unit, VALUE.encode(), item[0] << 8 | item[1]))])
    return bus


def test_a_request_to_a_known_unit_is_sent_at_once_and_counted() -> None:
    bus = known(Bus(TcpLine()))
    assert bus.begin(1, READ) == encode(1, READ.encode(), 2)
    assert bus.begin(1, READ) == encode(1, READ.encode(), 3)
    assert (bus.counters.asked, bus.counters.answered) == (3, 1)


def test_a_unit_that_was_never_asked_and_a_bus_with_gaps_need_the_conversation() -> None:
    assert known(Bus(TcpLine())).begin(2, READ) is None
    for bus in (Bus(TcpLine(), gap=0.1), Bus(TcpLine(), gaps={2: 0.1})):
        assert known(bus).begin(1, READ) is None
        assert bus.counters.asked == 1


def test_a_line_without_numbers_needs_the_conversation() -> None:
    assert known(Bus(TcpLine(any_transaction=True))).begin(1, READ) is None
    bus = rtu_bus()
    with pytest.raises(NoAnswer):
        play(bus.ask(1, READ), answering())
    assert bus.begin(1, READ) is None


def test_a_dead_unit_needs_the_conversation_until_it_answers() -> None:
    bus = known(Bus(TcpLine(), dead_after=1))
    assert bus.begin(1, READ) is not None
    with pytest.raises(NoAnswer, match=r"within 0\.25 s"):
        play(bus.rest(1, READ, 0.25, 5.0), answering(), start=5.0)
    assert bus.begin(1, READ) is None
    bus.answered(1, 6.0)
    assert bus.begin(1, READ) is not None


def test_an_answer_is_recorded_for_its_unit_and_time() -> None:
    bus = known(known(Bus(TcpLine()), 2))
    bus.answered(2, 9.0)
    assert bus.counters.answered == 3
    slow = Bus(TcpLine(), gap=0.5)
    slow.answered(2, 9.0)
    assert (slow.state.units[2].free_at, slow.state.units[2].settled) == (9.5, True)


def test_the_rest_begins_by_listening_until_the_time_out_counted_from_sending() -> None:
    bus = known(Bus(TcpLine()))
    assert bus.begin(1, READ) is not None
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
    assert bus.begin(unit, write) is not None
    with pytest.raises(WriteOutcomeUnknown) as caught:
        play(bus.rest(unit, write, 0.25, 5.0), answering(), start=5.0)
    assert str(caught.value) == (
        f"unit {unit} did not answer Write Single Register within 0.25 s; whether it was carried out is unknown"
    )
    assert (bus.counters.lost, bus.state.units[unit].silent) == (1, 1)


def test_a_write_abandoned_after_it_was_sent_is_outcome_unknown() -> None:
    bus = known(Bus(TcpLine()))
    write = WriteSingleRegister(1, 2)
    assert bus.begin(1, write) is not None
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
    bus, line = known(Bus(TcpLine(), dead_after=5)), TcpLine(number=lambda: 0x1234)
    sibling = bus.sibling_bus(line)
    assert (sibling.line, sibling is bus) == (line, False)
    assert repr(sibling) == f"<Bus: {line!r}>"
    assert sibling.begin(1, READ) == encode(1, READ.encode(), 0x1234)
    assert bus.begin(1, READ) == encode(1, READ.encode(), 2)
    sibling.answered(1, 1.0)
    assert (bus.counters.asked, bus.counters.answered) == (3, 2)
