"""The public clients in the model checker (`clients`): threads, tasks, every carrier and every option."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from barewire.conversation import Conversation
from barewire.io.endpoint import UNIT_OPTIONS
from barewire.io.modbus import async_client, client as client_module
from barewire.io.modbus.carriers import ModbusOptions, UnitKeywords
from barewire.modbus import Adu, Bus, EchoLine, Noise, UnitOptions
from barewire.modbus.client import bus
from barewire.rtu import RtuLine
from tests.helpers import part_or_whole
from tests.model.choices import Choices, run_random
from tests.model.client_setups import (
    CARRIERS,
    OPTIONS,
    OTHER_CARRIERS,
    Clients,
    Stretch,
    World,
    default_options,
    errors_at_lines,
    every_option,
)
from tests.model.clients import clients_scenario
from tests.model.one_line import Tally
from tests.model.test_one_line import Forgetful
from tests.model.units import DIAGNOSE, READ, READ_IMAGE, SLOW_ECHO, WRITE

pytestmark = pytest.mark.long
ALL_CARRIERS = [*CARRIERS, *OTHER_CARRIERS]
NOT_PLAYED = {
    *("parity", "stopbits", "bytesize", "rs485", "pace"),  # how a port sends its bits
    *("cert", "key", "ca", "server_name", "roles", "client_cert"),  # TLS, which is inside the port
    *("connections", "idle"),  # of servers
}
"""The options that do not reach anything between the port and the program."""


RUNS = pytest.mark.parametrize("runs", part_or_whole(12, 40))


@RUNS
@pytest.mark.parametrize("carrier", ALL_CARRIERS)
def test_no_answer_is_delivered_to_another_question_with_default_options(carrier: str, runs: int) -> None:
    tally = Tally()
    run_random(clients_scenario(default_options(carrier), tally), runs)
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.exceptions, tally.no_answer, tally.cancelled) > runs // 8


@RUNS
@pytest.mark.parametrize("carrier", ALL_CARRIERS)
def test_nor_to_another_client_of_a_gateway(carrier: str, runs: int) -> None:
    tally = Tally()
    run_random(clients_scenario(replace(default_options(carrier), worlds=("gateway",)), tally), runs)
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.exceptions, tally.no_answer, tally.cancelled) > runs // 8


@pytest.mark.parametrize("in_flight", [2, 16])
def test_nor_with_several_requests_of_a_gateway_under_way(in_flight: int) -> None:
    tally = Tally()
    setup = replace(default_options("TCP"), worlds=("gateway",), workers=(3,), in_flight=(in_flight,))
    run_random(clients_scenario(setup, tally), 20)
    assert not tally.wrong, tally.wrong[0]


@RUNS
@pytest.mark.parametrize("carrier", ALL_CARRIERS)
def test_nor_with_any_option(carrier: str, runs: int) -> None:
    tally = Tally()
    run_random(clients_scenario(every_option(carrier), tally), runs)
    assert not tally.wrong, tally.wrong[0]


@pytest.mark.parametrize("world", ["blocking", "asyncio", "gateway"])
def test_a_run_is_repeated_by_its_choices(world: World) -> None:
    setup = replace(default_options("ASCII"), worlds=(world,), fail_after=(None, 0.05, 0.4))
    play, dice = clients_scenario(setup, Tally()), random.Random(1)
    for _ in range(8):
        first = play(Choices(dice=dice))
        assert play(Choices(first.choices.script)).log == first.log


def test_every_option_of_a_client_is_played() -> None:
    in_urls = {
        option.partition("=")[0]
        for carrier in (CARRIERS | OTHER_CARRIERS).values()
        for option in carrier.url.partition("?")[2].split("&")
    }
    played = {name for options in OPTIONS for name in options} | in_urls - {""}
    assert played - {"units"} == set(ModbusOptions.__annotations__) - NOT_PLAYED
    of_units = [given for options in OPTIONS for given in options.get("units", {}).values()]
    assert {name for given in of_units for name in given} == set(UNIT_OPTIONS) == set(UnitOptions._fields)
    assert set(UnitKeywords.__annotations__) == set(UNIT_OPTIONS)


@pytest.mark.parametrize("world", ["blocking", "asyncio"])
@pytest.mark.parametrize("carrier", ["RTU", "TCP", "TCP, any_transaction"])
@pytest.mark.parametrize("step", part_or_whole(8, 1))
# An exception raised while a generator is freed is only reported.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_exception_at_any_line_neither_loses_a_pending_answer_nor_the_turn_on_the_line(
    carrier: str, world: World, step: int
) -> None:
    tally = Tally()
    setup = replace(errors_at_lines(carrier), worlds=(world,), length=16, stretches=("trouble",))
    for line in range(0, 300, step):
        play = clients_scenario(replace(setup, lines_until_error=(None, None, line)), tally)
        play(Choices(dice=random.Random(line)))
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.cancelled) > 300 / step


def finds(setup: Clients, planted: type[Bus], monkeypatch: pytest.MonkeyPatch) -> bool:
    """Return whether a client with a planted mistake gets a wrong answer within 1000 runs."""
    monkeypatch.setattr(client_module, "Bus", planted)
    monkeypatch.setattr(async_client, "Bus", planted)
    tally = Tally()
    run_random(clients_scenario(setup, tally), 1000, until=lambda: tally.wrong)
    return bool(tally.wrong)


def reads(carrier: str, world: World, *stretches: Stretch) -> Clients:
    """The default alphabet with one kind of question, in which a mistake shows sooner."""
    setup = default_options(carrier)
    return replace(setup, worlds=(world,), line=replace(setup.line, questions=(READ,)), stretches=stretches)


WORLDS: tuple[World, ...] = ("blocking", "asyncio", "gateway")
EVERY_WORLD = pytest.mark.parametrize("world", WORLDS)


def each_once(carriers: Iterable[str], worlds: Sequence[World]) -> list[Any]:
    """Return each carrier with each world. `make test` has each carrier in one world, `make proof` all pairs."""
    pairs = []
    for number, carrier in enumerate(carriers):
        for place, world in enumerate(worlds):
            is_in_proof = place != (number + 1) % len(worlds)
            pairs.append(pytest.param(carrier, world, marks=[pytest.mark.proof] if is_in_proof else []))
    return pairs


@EVERY_WORLD
def test_the_checker_finds_a_client_whose_bus_remembers_nothing(monkeypatch: pytest.MonkeyPatch, world: World) -> None:
    assert finds(reads("RTU", world, "trouble"), Forgetful, monkeypatch)


@pytest.mark.parametrize(
    ("carrier", "world"), each_once(["RTU", "ASCII", "RTU over TCP", "TCP, any_transaction"], WORLDS)
)
def test_the_checker_finds_a_probe_whose_window_is_clipped_as_its_time_out_is(
    carrier: str, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mistake of barewire before this checker played clients with default options."""

    class Clips(Bus):
        def _probe(self, unit: int, timeout: float, now: float) -> Conversation[bytes, float]:
            longest, self._longest_timeout = self._longest_timeout, timeout
            now = yield from super()._probe(unit, timeout, now)
            self._longest_timeout = longest
            return now

    assert finds(reads(carrier, world, "trouble"), Clips, monkeypatch)


@pytest.mark.parametrize(
    ("carrier", "world"),
    # The blocking client gives a TCP connection up when it is interrupted, so that no late answer comes.
    [*each_once(["RTU", "ASCII", "RTU over TCP"], WORLDS[:2]), ("TCP, any_transaction", "asyncio")],
)
def test_the_checker_finds_a_bus_that_forgets_the_oldest_of_seventeen_probes(
    carrier: str, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mistake of barewire before this checker played bursts of cancelled questions."""

    class ForgetsOldest(Bus):
        def _leave_pending(self, now: float) -> None:
            super()._leave_pending(now)
            probes = [pending for pending in self.state.pending if pending.request.function_code == 8]
            if len(probes) > 16:
                self.state.pending.remove(probes[0])

    monkeypatch.setattr(bus, "_MOST_PROBES", 1000)
    assert finds(reads(carrier, world, "burst", "calm"), ForgetsOldest, monkeypatch)


def hunt_as_a_listener(line: RtuLine) -> list[Adu | Noise]:
    line.role, role = "listener", line.role
    events = line._hunt()
    line.role = role
    return events


def test_the_checker_finds_a_line_that_looks_for_frames_in_damaged_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mistake of barewire before this checker damaged any bit of an answer that holds the image of another."""
    monkeypatch.setattr(RtuLine, "_divide", hunt_as_a_listener)
    setup = default_options("RTU")
    setup = replace(setup, line=replace(setup.line, questions=(READ, READ_IMAGE)), stretches=("trouble",))
    assert finds(setup, Bus, monkeypatch)


@EVERY_WORLD
def test_the_checker_finds_a_client_that_forgets_the_echo_when_it_opens_the_port_again(
    monkeypatch: pytest.MonkeyPatch, world: World
) -> None:
    """A mistake of barewire that the checker found only in the hundred thousandth run, as a port hardly ever failed."""
    setup = default_options("RTU, echo")
    line = replace(setup.line, questions=(WRITE, DIAGNOSE), adapters=(SLOW_ECHO,))
    setup = replace(setup, line=line, worlds=(world,), fail_after=(None, None, 0.005, 0.01), stretches=("trouble",))
    tally = Tally()
    run_random(clients_scenario(setup, tally), 60)
    assert not tally.wrong, tally.wrong[0]
    monkeypatch.setattr(EchoLine, "continue_from", lambda line, before: None)
    assert finds(setup, Bus, monkeypatch)


def test_the_checker_finds_a_client_that_expects_the_echo_only_as_the_first_bytes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(EchoLine, "_is_echo", lambda line, event: False)
    assert finds(default_options("RTU, echo"), Bus, monkeypatch)
