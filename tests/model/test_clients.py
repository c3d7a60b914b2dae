"""The public clients in the model checker (`clients`): threads, tasks, every carrier and every option."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from barewire.io.modbus import async_connection, connection
from barewire.io.modbus.options import ModbusOptions
from barewire.modbus import EchoLine
from tests.model.choices import Choices, run_random
from tests.model.client_setups import (
    CARRIERS,
    OPTIONS,
    OTHER_CARRIERS,
    Clients,
    World,
    default_options,
    errors_at_lines,
    every_option,
)
from tests.model.clients import clients_scenario
from tests.model.one_line import Tally
from tests.model.test_one_line import Forgetful

pytestmark = pytest.mark.long
ALL_CARRIERS = [*CARRIERS, *OTHER_CARRIERS]
NOT_PLAYED = {
    *("parity", "stopbits", "bytesize", "rs485", "pace"),  # how a port sends its bits
    *("cert", "key", "ca", "server_name", "roles", "client_cert"),  # TLS, which is inside the port
    *("connections", "idle"),  # of servers
}
"""The options that do not reach anything between the port and the program."""


@pytest.mark.parametrize("carrier", ALL_CARRIERS)
def test_no_answer_is_delivered_to_another_question_with_default_options(carrier: str) -> None:
    tally = Tally()
    run_random(clients_scenario(default_options(carrier), tally), 40)
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.exceptions, tally.no_answer, tally.cancelled) > 20


@pytest.mark.parametrize("carrier", ALL_CARRIERS)
def test_nor_with_any_option(carrier: str) -> None:
    tally = Tally()
    run_random(clients_scenario(every_option(carrier), tally), 40)
    assert not tally.wrong, tally.wrong[0]


def test_every_option_of_a_client_is_played() -> None:
    in_urls = {
        option.partition("=")[0]
        for carrier in (CARRIERS | OTHER_CARRIERS).values()
        for option in carrier.url.partition("?")[2].split("&")
    }
    played = {name for options in OPTIONS for name in options} | in_urls - {""}
    assert played - {"gaps"} == set(ModbusOptions.__annotations__) - NOT_PLAYED


@pytest.mark.parametrize("world", ["blocking", "asyncio"])
@pytest.mark.parametrize("carrier", ["RTU", "TCP", "TCP, any_transaction"])
def test_an_exception_at_any_line_neither_loses_a_pending_answer_nor_the_turn_on_the_line(
    carrier: str, world: World
) -> None:
    tally = Tally()
    setup = replace(errors_at_lines(carrier), worlds=(world,), length=16, stretches=("trouble",))
    for line in range(300):
        play = clients_scenario(replace(setup, lines_until_error=(None, None, line)), tally)
        play(Choices(dice=random.Random(line)))
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.cancelled) > 300


def wrong_of(setup: Clients, runs: int) -> list[str]:
    """Return the wrong answers of a client with a planted mistake."""
    tally = Tally()
    run_random(clients_scenario(setup, tally), runs)
    return tally.wrong


@pytest.mark.parametrize("world", ["blocking", "asyncio"])
def test_the_checker_finds_a_client_whose_bus_remembers_nothing(monkeypatch: pytest.MonkeyPatch, world: World) -> None:
    monkeypatch.setattr(connection, "Bus", Forgetful)
    monkeypatch.setattr(async_connection, "Bus", Forgetful)
    assert wrong_of(replace(default_options("RTU"), worlds=(world,)), 10)


def test_the_checker_finds_a_client_that_expects_the_echo_only_as_the_first_bytes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(EchoLine, "_is_echo", lambda line, event: False)
    assert wrong_of(default_options("RTU, echo"), 200)
