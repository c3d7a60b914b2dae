"""How long an answer stays pending, with the default options: no shorter time-out, and no number of them, ends that."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

import pytest

from barewire.conversation import Abandoned, Conversation, Listen, Wire
from barewire.errors import NoAnswer
from barewire.modbus import Bus, Diagnostics, ReadCoils, ReadHoldingRegisters, ReadInputRegisters, Request, UnitOptions
from barewire.modbus.framing import Line
from barewire.rtu import RtuLine
from barewire.tcp import TcpLine
from tests.modbus.client.slow import TIMING, InTime, Slow, read, rtu_bus

LINES: dict[str, tuple[Callable[[], Line], Callable[[], Line]]] = {
    "rtu": (lambda: RtuLine(TIMING), lambda: RtuLine(TIMING, role="server", units=(1, 2))),
    "tcp, any_transaction": (lambda: TcpLine(any_transaction=True), TcpLine),
}


def outcomes(bus: Bus, wire: Wire[bytes], addresses: range, timeout: float) -> list[int | None]:
    """Return the value of each read, whose right value is its address; None without an answer."""
    values: list[int | None] = []
    for address in addresses:
        try:
            response: Any = wire.play(read(bus, address, timeout=timeout))
        except NoAnswer:
            values.append(None)
        else:
            values.append(response.registers[0])
    return values


def none_wrong(values: list[int | None], addresses: range) -> bool:
    return all(value in (None, address) for value, address in zip(values, addresses, strict=True))


def abandoned(conversation: Conversation[bytes, object], at: float) -> Conversation[bytes, None]:
    """Run a conversation until `at`, and abandon it then."""
    step = next(conversation)
    while True:
        heard = yield Listen(min(step.until, at)) if isinstance(step, Listen) else step
        if heard.now >= at:
            with pytest.raises(Abandoned):
                conversation.throw(Abandoned())
            return
        step = conversation.send(heard)


@pytest.mark.parametrize("lines", LINES.values(), ids=LINES)
@pytest.mark.parametrize("rest", [0.001, 0.015, 0.1])
def test_a_probe_shortly_before_the_end_of_the_window_is_pending_for_a_whole_window(
    lines: tuple[Callable[[], Line], Callable[[], Line]], rest: float
) -> None:
    """The unit declines 08 and answers all in order, within 0.8 s of its request; the first answer is lost."""
    client_line, server_line = lines
    bus = Bus(client_line())
    wire = Wire(InTime([None, 0.6, 0.58, 0.4, 0.3, 0.3, 0.1], server_line(), function_08="declined"))
    assert outcomes(bus, wire, range(1, 2), timeout=0.3) == [None]
    wire.now = 0.9 - rest
    addresses = range(2, 9)
    values = outcomes(bus, wire, addresses, timeout=0.3)
    assert none_wrong(values, addresses), values
    assert bus.counters.probes > 1


def test_the_window_of_a_request_with_a_short_time_out_is_that_of_the_bus() -> None:
    """The unit is as slow for it as for the others: 0.8 s."""
    bus, wire = rtu_bus(), Wire(InTime([0.1, 0.8, 0.8, 0.002], function_08="ignored"))
    assert outcomes(bus, wire, range(1), timeout=0.3) == [0]
    wire.now = 10.0
    assert outcomes(bus, wire, range(1, 2), timeout=0.05) == [None]
    assert bus.state.pending[0].until == pytest.approx(10.0 + 0.9, abs=0.04)
    addresses = range(2, 5)
    assert none_wrong(outcomes(bus, wire, addresses, timeout=0.3), addresses)


def test_the_usual_time_out_counts_from_the_first_request_on() -> None:
    bus = rtu_bus(options=UnitOptions(timeout=1.0))
    assert outcomes(bus, Wire(Slow([None])), range(1), timeout=0.05) == [None]
    assert bus.state.pending[0].until == pytest.approx(3.0, abs=0.04)


@pytest.mark.parametrize("cancelled", [1, 15, 16, 17, 18, 30])
@pytest.mark.parametrize("function_08", ["echoed", "declined"])
def test_no_number_of_cancelled_requests_makes_the_bus_forget_one(cancelled: int, function_08: Any) -> None:
    """A unit that is busy for 0.75 s answers everything then, in order."""
    bus = rtu_bus()
    unit = Slow([0.75] + [0.003] * 100, function_08=function_08)
    wire = Wire(unit)
    for _ in range(cancelled):
        wire.play(abandoned(bus.ask(1, ReadHoldingRegisters(200, 1), timeout=0.3), wire.now + 0.02))
    probes = bus.counters.probes
    addresses = range(1, 20)
    values = outcomes(bus, wire, addresses, timeout=0.3)
    assert none_wrong(values, addresses), values
    assert values[-1] == addresses[-1]
    assert probes == min(cancelled - 1, 16)


@pytest.mark.parametrize("seed", [8, 39, 43, 51, 72, 85])
def test_the_seventeenth_probe_of_a_slow_unit_displaces_none(seed: int) -> None:
    """Reads cancelled quickly, and a unit whose answers are late by changing times, within the window."""
    random = Random(seed)
    function_08, cancelled = random.choice(("declined", "echoed")), random.choice((17, 18, 19))
    pause, longest = random.choice((0.02, 0.01, 0.03)), random.choice((0.85, 0.6, 0.4))
    delays = [
        random.uniform(0.3, longest) if random.random() < 0.9 else random.choice((0.01, None)) for _ in range(200)
    ]
    bus, wire = rtu_bus(), Wire(InTime(delays, function_08=function_08))  # type: ignore[arg-type]
    for _ in range(cancelled):
        wire.play(abandoned(bus.ask(1, ReadHoldingRegisters(200, 1), timeout=0.3), wire.now + pause))
    addresses = range(1, 20)
    values = outcomes(bus, wire, addresses, timeout=0.3)
    assert none_wrong(values, addresses), values


def test_what_is_pending_is_bounded_by_units_and_functions() -> None:
    """One request of each function and unit, and sixteen probes of a unit: the rest waits for the window."""
    bus = rtu_bus()
    wire = Wire(Slow([None] * 2000, function_08="ignored"))
    requests: list[Request[Any]] = [
        ReadCoils(0, 1),
        ReadHoldingRegisters(0, 1),
        ReadInputRegisters(0, 1),
        Diagnostics(0, b"\0\1"),
    ]
    for turn in range(400):
        request = requests[turn % 4]
        conversation = bus.ask(1 + turn // 4 % 2, request, timeout=0.3)
        wire.play(abandoned(conversation, wire.now + 0.001 * (1 + turn % 7)))
        for unit in (1, 2):
            codes = [pending.request.function_code for pending in bus.state.of_unit(unit)]
            assert codes.count(8) <= 17
            assert all(codes.count(code) <= 1 for code in (1, 3, 4))
