"""The stepper drive of the tests in this folder; one with another `bench` has its own."""

from __future__ import annotations

import pytest

from tests.devices.sim.bench import CsdBench


@pytest.fixture
def bench() -> CsdBench:
    bench = CsdBench()
    bench.write("Velocity Total Sample", 1)  # the shown velocity is the mean of this number of milliseconds
    return bench
