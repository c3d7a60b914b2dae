"""The fixture `enter`: runs a race once and passes the rounds of each contestant to pytest-benchmark.

pytest-benchmark would measure one contestant after the other, minutes apart. So `bench/race.py` runs the contestants in
turns, and each test replays its measured times to pytest-benchmark through the `timer` option: pytest-benchmark makes
the tables, the JSON file and the comparisons. Ratios to the floor go into `extra_info`.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from bench.race import Outcome, Race, run

PEERS = (
    *("pymodbus", "tmodbus", "minimalmodbus", "uModbus", "pyModbusTCP", "modbus-tk"),
    *("crcmod", "fastcrc", "canopen", "pytest-benchmark"),
)
_outcomes: dict[str, Outcome] = {}
_marks: list[float] = []


def replay() -> float:
    """Return the next time of the clock for pytest-benchmark: start and end of each round, as they were measured."""
    return _marks.pop(0) if _marks else 0.0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "enter" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.benchmark(timer=replay))


def pytest_benchmark_update_machine_info(config: pytest.Config, machine_info: dict[str, Any]) -> None:
    """Describe the machine as the page does: without its name, with the versions of the libraries."""
    machine_info.pop("node", None)
    found: dict[str, str | None] = {}
    for name in PEERS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    machine_info["versions"] = found
    machine_info["cores"] = os.cpu_count()
    machine_info["system"] = f"{platform.system()} {platform.release()}"


def pytest_benchmark_update_json(output_json: dict[str, Any]) -> None:
    """Add the contestants that a race does not have, with the reason."""
    output_json["absent"] = {
        group: outcome.missing | {name: f"which failed: {error}" for name, error in outcome.failed.items()}
        for group, outcome in _outcomes.items()
        if outcome.missing or outcome.failed
    }


@pytest.fixture
def enter(benchmark: BenchmarkFixture) -> Callable[[Race, str], None]:
    """Return a function that reports the rounds of a contestant: `enter(race, contestant)`."""

    def report(race: Race, contestant: str) -> None:
        benchmark.group = race.group
        if race.group not in _outcomes:
            _outcomes[race.group] = run(race)
        outcome = _outcomes[race.group]
        if contestant in outcome.missing:
            benchmark.skipped = True
            pytest.skip(f"{contestant}: {outcome.missing[contestant]}")
        if contestant in outcome.failed:
            if contestant.startswith("barewire"):
                raise outcome.failed[contestant]
            benchmark.skipped = True
            pytest.skip(
                f"{contestant} failed: {type(outcome.failed[contestant]).__name__}: {outcome.failed[contestant]}"
            )
        floor = next(iter(race.contestants))
        benchmark.extra_info.update(
            family=race.family, what=race.what, size=race.size, contestant=contestant, floor=floor
        )
        # Ratios of ours to all contestants, of each contestant to the floor and to ours.
        beside = [name for name in outcome.seconds if contestant.startswith("barewire") or name in (floor, "barewire")]
        others = {name: outcome.ratio(contestant, name) for name in beside}
        benchmark.extra_info["ratios"] = others
        seconds = outcome.seconds[contestant]
        _marks[:] = [mark for took in seconds for mark in (0.0, took)]
        benchmark.pedantic(lambda: None, rounds=len(seconds))

    return report
