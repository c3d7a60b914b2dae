"""Simulated machines: the three of the catalogue with their behaviour, and any other described device without.

        machine = simulator("az3")            a description of your own:  simulator(load("my_device/"))
        machine.modbus.handle(request, now)   a `barewire.modbus.server.server.Unit`; None for a machine without Modbus
        machine.canopen.feed(frame, now)      frames in, frames out, a `deadline`; None for a machine without CAN
        machine.tick(now)                     time is passed in: nothing here reads a clock

Both buses read and write one store: a value that is written over Modbus is read over CANopen, and values that change by
themselves change between requests.

Simulated: every parameter of the description, at its address or object, with its type, rights and range; the function
codes, limits and exceptions of each device; the CiA 402 states and status words; ramps and trapezoids of the right
duration; a soft start that takes the acceleration time; PDOs, SYNC, heartbeat and NMT of the AZ3; saved parameters and
power-off. Simplified: currents, torques, temperatures and their curves. Only stored: what the heads of `adxl`,
`az3` and `csd_mt.machine` list. What the manuals leave open is decided in one place, and documented there. A supply
that fails or a switch that is passed is set with `set_environment`; `environment_properties` lists what there is.

In reading order:

    store             every parameter with its value, its rights and its hooks
    modbus, canopen   the adapters through which the buses access the store
    machine           `Simulator` joins them: any device without behaviour
    trajectory        motion in closed form
    cia402_axis       states of a drive, and the motion that they allow
    adxl              the soft starter; adxl_motor: its motor
    az3               the servo drive; az3_motion: its units, limits, brake and measured values
    csd_mt/           the stepper drive
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal, TypedDict, Unpack, overload

from barewire.devices.description.load import load
from barewire.devices.device import Device
from barewire.devices.sim.adxl import Adxl
from barewire.devices.sim.az3 import Az3
from barewire.devices.sim.csd_mt.machine import CsdMt
from barewire.devices.sim.machine import MachineUnits, Simulator

_SIMULATORS: dict[str, type[Simulator]] = {"adxl": Adxl, "az3": Az3, "csd-mt": CsdMt}
"""The machines with behaviour, by the name of their description."""


class _DeliverySettings(TypedDict, total=False):
    """The addresses of a machine, where they are not those of its description."""

    node: int | None
    bitrate: int | None
    unit: int | None


@overload
def simulator(device: Literal["adxl"], now: float = 0.0, **delivered: Unpack[_DeliverySettings]) -> Adxl: ...
@overload
def simulator(device: Literal["az3"], now: float = 0.0, **delivered: Unpack[_DeliverySettings]) -> Az3: ...
@overload
def simulator(device: Literal["csd-mt"], now: float = 0.0, **delivered: Unpack[_DeliverySettings]) -> CsdMt: ...
@overload
def simulator(device: str | Path | Device, now: float = 0.0, **delivered: Unpack[_DeliverySettings]) -> Simulator: ...
def simulator(
    device: str | Path | Device,
    now: float = 0.0,
    *,
    node: int | None = None,
    bitrate: int | None = None,
    unit: int | None = None,
) -> Simulator:
    """Return the simulator of a device, given by its name, its path or its description. `now`: the time in seconds.

    `node`, `bitrate` (CANopen, bit/s) and `unit` (Modbus) replace the settings of the description at delivery.

    >>> machine = simulator("csd-mt")
    >>> type(machine).__name__, machine.canopen
    ('CsdMt', None)
    """
    described = device if isinstance(device, Device) else load(device)
    # A user's description may have the name of a shipped one, but not the parameters that its simulator needs.
    shipped = described.name in _SIMULATORS and described is load(described.name)
    simulator_class = _SIMULATORS[described.name] if shipped else Simulator
    settings = described.canopen
    if settings is not None:
        settings = settings._replace(node=node or settings.node, bitrate=bitrate or settings.bitrate)
        described = replace(described, canopen=settings)
    machine = simulator_class(described, now)
    if unit is not None:
        machine.readdress(unit)
    return machine


__all__ = ["simulator", "Simulator", "MachineUnits", "Adxl", "Az3", "CsdMt"]
