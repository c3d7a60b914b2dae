"""Probes (08/00): what their answers prove, and what happens without one."""

from __future__ import annotations

import pytest

from barewire.conversation import Abandoned, Wire
from barewire.errors import NoAnswer
from barewire.modbus import Diagnostics, ReadHoldingRegisters
from tests.modbus.client.slow import Clock, InTime, Slow, read, rtu_bus, sending


def test_exception_88_to_a_probe_proves_as_much_as_its_echo() -> None:
    bus = rtu_bus()
    slow = Slow([1.5], function_08="declined")
    clock = Clock(slow)
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10))
    clock.play(read(bus, 20))
    assert slow.asked[1][1] == 0x08
    assert bus.counters.probes == 1


def test_a_unit_that_ignores_probes_is_asked_after_the_late_window() -> None:
    bus = rtu_bus(late_window=3.5)
    clock = Clock(Slow([None], function_08="ignored"))
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10))
    for _ in range(2):
        with pytest.raises(NoAnswer) as caught:
            clock.play(read(bus, 20))
        assert str(caught.value) == (
            "unit 1 did not answer a probe within 1 s, and the answer to an earlier request may still come: "
            "Read Holding Registers was not sent"
        )
    clock.now = 3.6
    assert clock.play(read(bus, 20)) == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]
    assert bus.counters.probes == 2


def test_the_late_exception_to_a_probe_does_not_prove_what_a_later_probe_asks_for() -> None:
    """Answers in order, each within 0.8 s of its request, and no function 08."""
    bus = rtu_bus(late_window=0.9)
    clock = Wire(InTime([0.35, 0.80, 0.002, 0.002, 0.002], function_08="declined"))
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 1, timeout=0.3))
    for address in (2, 3, 4, 5):
        try:
            answer = clock.play(read(bus, address, timeout=0.3))
        except NoAnswer:
            continue
        assert answer == ReadHoldingRegisters(address, 1).response((address,))  # type: ignore[call-arg]
    assert clock.play(read(bus, 6, timeout=0.3)) == ReadHoldingRegisters(6, 1).response((6,))  # type: ignore[call-arg]


def test_a_probe_abandoned_while_being_sent_leaves_a_pending_answer() -> None:
    bus = rtu_bus(late_window=2.0)
    clock = Clock(Slow([None]))
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10))
    conversation = read(bus, 20)
    sending(conversation, clock.now)
    with pytest.raises(Abandoned):
        conversation.throw(Abandoned())
    assert bus.counters.probes == 1
    # When it left is unknown: within the time-out, so its answer can come until the window after that.
    assert [pending.until - clock.now for pending in bus.state.pending][1:] == [
        pytest.approx(1.0 + 2.0 + 0.03)
    ]  # and the silence of the line


def test_each_probe_has_a_number_of_its_own() -> None:
    bus = rtu_bus(late_window=60.0)
    slow = Slow([None] * 40, function_08="ignored")
    clock = Clock(slow)
    for _ in range(20):
        with pytest.raises(NoAnswer):
            clock.play(read(bus, 10))
    probes = [data for data in slow.asked if data[1] == 8]
    assert len(probes) == len(set(probes)) == 18


def test_the_probes_of_a_dead_unit_do_not_fill_the_memory() -> None:
    bus = rtu_bus(late_window=30.0)
    slow = Slow([None] * 100, function_08="ignored")
    clock = Clock(slow)
    for _ in range(50):
        with pytest.raises(NoAnswer):
            clock.play(read(bus, 10))
        assert len(bus.state.pending) <= 1 + 16


def test_the_number_of_a_probe_is_not_that_of_a_pending_08_of_the_caller() -> None:
    asked: list[bytes] = []

    def silent(item: bytes, now: float) -> list[tuple[float, bytes]]:
        asked.append(item)
        return []

    first = Clock(silent)
    numbers: list[bytes] = []
    for own in (None, 0):
        bus = rtu_bus(late_window=60.0)
        if own is not None:
            with pytest.raises(NoAnswer):
                first.play(bus.ask(1, Diagnostics(0, numbers[own])))
        for _ in range(2):
            with pytest.raises(NoAnswer):
                first.play(read(bus, 10))
        numbers.append(asked[-1][4:6])
    assert numbers[0] != numbers[1]
