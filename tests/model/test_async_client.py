"""The asyncio client in the model checker (`async_client`)."""

from __future__ import annotations

import pytest

from barewire.io.modbus import async_connection
from barewire.modbus import EchoLine
from tests.model.async_client import ON_RTU, ON_TCP, WITH_ECHO, Tasks, tasks_scenario
from tests.model.choices import run_random
from tests.model.one_line import Tally
from tests.model.test_one_line import Forgetful

pytestmark = pytest.mark.long


@pytest.mark.parametrize("setup", [ON_TCP, ON_RTU, WITH_ECHO], ids=["TCP", "RTU", "RTU with echo"])
def test_no_answer_is_delivered_to_another_task(setup: Tasks) -> None:
    tally = Tally()
    run_random(tasks_scenario(setup, tally), 200)
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.exceptions, tally.no_answer, tally.cancelled) > 50


def test_the_checker_finds_a_client_that_expects_the_echo_only_as_the_first_bytes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(EchoLine, "_is_echo", lambda line, event: False)
    tally = Tally()
    run_random(tasks_scenario(WITH_ECHO, tally), 400)
    assert tally.wrong


def test_the_checker_finds_a_client_whose_bus_remembers_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(async_connection, "Bus", Forgetful)
    tally = Tally()
    run_random(tasks_scenario(ON_RTU, tally), 50)
    assert tally.wrong
