"""Retries: what is repeated without a response, how often, and what is not."""

from __future__ import annotations

import pytest

from barewire.conversation import Abandoned, Heard
from barewire.errors import NoAnswer
from barewire.modbus import (
    Bus,
    Diagnostics,
    RawRequest,
    ReadHoldingRegisters,
    UnitOptions,
    WriteOutcomeUnknown,
    WriteSingleRegister,
)
from barewire.tcp import TcpLine
from tests.helpers import refused
from tests.modbus.client.slow import Clock, Slow, read, rtu_bus


def test_a_write_without_answer_is_outcome_unknown_and_not_repeated() -> None:
    bus = rtu_bus()
    slow = Slow([None, None, None])
    with pytest.raises(WriteOutcomeUnknown, match="whether it was carried out is unknown"):
        Clock(slow).play(bus.ask(1, WriteSingleRegister(1, 2), retries=2))
    assert len(slow.asked) == 1


@pytest.mark.parametrize("sub_function", range(0x16))
def test_diagnostics_are_repeated_only_if_they_have_no_effect(sub_function: int) -> None:
    """Not a restart, not the commands that clear counters; nor a reserved sub-function, whose effect is not known."""
    bus = rtu_bus(recovery="wait")
    slow = Slow([None] * 3)
    request = Diagnostics(sub_function)
    has_effect = sub_function not in (0x00, 0x02, *range(0x0B, 0x13))
    assert (request.writes, RawRequest(request.encode()).writes) == (has_effect, has_effect)
    if sub_function == 0x04:  # its result is silence
        return
    with pytest.raises(WriteOutcomeUnknown if has_effect else NoAnswer):
        Clock(slow).play(bus.ask(1, request, retries=2))
    assert len(slow.asked) == (1 if has_effect else 3)


def test_a_write_is_repeated_with_repeat_writes() -> None:
    bus = rtu_bus()
    slow = Slow([None])
    Clock(slow).play(bus.ask(1, WriteSingleRegister(1, 2), retries=2, repeat_writes=True))
    assert [data[1] for data in slow.asked] == [0x06, 0x08, 0x06]


@pytest.mark.parametrize("retries", [0, 1, 3])
def test_a_read_is_repeated_as_often_as_retries(retries: int) -> None:
    slow = Slow([None] * 10)
    with pytest.raises(NoAnswer, match="did not answer") as caught:
        Clock(slow).play(rtu_bus(recovery="wait").ask(1, ReadHoldingRegisters(9, 1), retries=retries))
    assert len(slow.asked) == 1 + retries
    attempts = f"; {1 + retries} attempts" if retries else ""
    assert str(caught.value) == f"unit 1 did not answer Read Holding Registers within 1 s{attempts}"


def test_the_last_of_the_retries_may_succeed() -> None:
    slow = Slow([None, None, 0.01])
    assert Clock(slow).play(rtu_bus(recovery="wait").ask(1, ReadHoldingRegisters(9, 1), retries=2)) is not None


def test_the_first_attempt_sends_a_probe_like_a_request_without_retries() -> None:
    bus = rtu_bus(late_window=60.0)
    clock = Clock(Slow([None]))
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10))
    clock.play(bus.ask(1, ReadHoldingRegisters(20, 1), retries=1))
    assert bus.counters.probes == 1
    assert clock.now < 1.2


def test_a_broken_line_ends_the_retries() -> None:
    """After an invalid header no byte can be trusted, so the client has to connect again first."""
    asked = []

    def peer(request: bytes, now: float) -> list[tuple[float, bytes]]:
        asked.append(request)
        return [(now + 0.1, bytes.fromhex("0001 1234 0003 01"))]

    text = "unit 1 did not answer Read Holding Registers: protocol identifier is 12 34, Modbus has 00 00"
    with refused(NoAnswer, text) as caught:
        Clock(peer).play(Bus(TcpLine()).ask(1, ReadHoldingRegisters(9, 1), retries=3))
    assert str(caught.value).endswith("; nothing after it can be trusted")
    assert len(asked) == 1


def test_a_request_that_was_not_sent_costs_no_retry() -> None:
    """The unit ignores function 08 and loses one answer: a request with retries waits for the end of the window."""
    bus = rtu_bus()
    slow = Slow([None], function_08="ignored")
    clock = Clock(slow)
    answer = clock.play(bus.ask(1, ReadHoldingRegisters(20, 1), retries=1))
    assert answer == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]
    assert clock.now < 3.1
    assert [data[1] for data in slow.asked] == [3, 8, 3]


@pytest.mark.parametrize(("of_bus", "given", "asked"), [(0, None, 1), (2, None, 3), (2, 0, 1), (2, 1, 2), (0, 2, 3)])
def test_a_request_has_the_retries_of_the_bus_unless_it_is_given_others(
    of_bus: int, given: int | None, asked: int
) -> None:
    slow = Slow([None] * 10)
    bus = rtu_bus(recovery="wait", retries=of_bus)
    with pytest.raises(NoAnswer):
        Clock(slow).play(bus.ask(1, ReadHoldingRegisters(9, 1), retries=given))
    assert len(slow.asked) == asked


def test_a_write_that_is_abandoned_is_not_repeated() -> None:
    bus = Bus(TcpLine(), options=UnitOptions(dead_after=1))
    asking = bus.ask(1, WriteSingleRegister(7, 7), retries=1, repeat_writes=True)
    next(asking)
    asking.send(Heard(None, 0.0))
    with pytest.raises(WriteOutcomeUnknown):
        asking.throw(Abandoned("cancelled"))
    assert bus.counters.asked == 1
