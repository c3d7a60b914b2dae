"""The static types of simulators: checked by mypy --strict, not by pytest."""

from __future__ import annotations

from typing import assert_type

from barewire import ModbusServer
from barewire.devices import load
from barewire.devices.sim import Adxl, Az3, CsdMt, Simulator, simulator
from barewire.devices.sim.canopen import CanopenAdapter
from barewire.devices.sim.modbus import ModbusAdapter


def of_simulators_by_name() -> None:
    assert_type(simulator("adxl"), Adxl)
    assert_type(simulator("az3", node=5), Az3)
    assert_type(simulator("csd-mt", 1.0, unit=7), CsdMt)
    assert_type(simulator("az3").canopen, CanopenAdapter)
    with ModbusServer("rtu://pty", units={1: simulator("adxl").modbus, 2: simulator("csd-mt").modbus}):
        pass


def of_any_device(name: str) -> None:
    """A description may have one bus only."""
    assert_type(simulator(name), Simulator)
    assert_type(simulator(load("adxl")).modbus, ModbusAdapter | None)
    assert_type(simulator(load("adxl")).canopen, CanopenAdapter | None)
    ModbusServer("rtu://pty", units={1: simulator(name).modbus})  # type: ignore[dict-item]
