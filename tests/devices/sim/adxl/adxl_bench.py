"""Helpers of the soft starter's tests."""

from __future__ import annotations

from barewire.devices.sim import Adxl
from tests.devices.sim.bench import Bench


def starter(bench: Bench) -> Adxl:
    assert isinstance(bench.machine, Adxl)
    return bench.machine


def set_parameter(bench: Bench, menu: int, number: int, value: int) -> None:
    bench.write("Menu number selection", menu)
    bench.write("Parameter number selection", number)
    bench.write("Parameter value", value)
