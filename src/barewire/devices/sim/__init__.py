"""Simulated machines: the three of the catalogue, behaving, and any other that somebody describes.

        machine = simulator("az3")            a user's own:  simulator(load("my_device/"))
        machine.modbus.handle(request, now)   a `barewire.modbus.server.server.Unit`, or None if it is not on Modbus
        machine.canopen.feed(frame, now)      frames in, frames out, a `deadline`; None if it is not on CAN
        machine.tick(now)                     time is what it is told: nothing here looks at a clock

A simulator behaves; it does not merely answer. Both faces look into one store, so a value that is written over Modbus
is read over CANopen, and what moves by itself moves while nobody asks.

What is real: every parameter of the description, at its place, with its type, rights and range; function codes, limits
and refusals of each device; the CiA 402 states and status words; ramps and trapezoids that last as long as they must; a
soft start that takes the acceleration time; PDOs, SYNC, heartbeat and NMT of the AZ3; stored parameters and power-off.
What is drawn: currents, torques, temperatures and their curves. What is only stored: everything that the head of
`adxl`, `az3` and `csd_mt` lists. What the manuals leave open is decided in one place, and said there. The world around
a machine (a supply that fails, a switch that is passed) is set by hand, on attributes that the same heads name.

Files, from the store upwards:

    store       every value once                    modbus_face, canopen_face    how the buses see it
    image       registers composed of values        simulator                    any device, without behaviour
    trajectory  motion in closed form               axis                         CiA 402 states and motion
    addressed   a machine under the unit address that it has now
    adxl: adxl_face, adxl_values, adxl_motor, adxl_memory           az3: az3_values, az3_motion, az3_service
    csd_mt: csd_mt_world and the files that its head draws; profile

I know: descriptions, requests, frames, time as a number.  I never know: envelopes, ports, clocks.
Who may import me: shells, cli, bench, tests.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from barewire.devices.description.load import load
from barewire.devices.device import Device
from barewire.devices.sim.adxl.machine import Adxl
from barewire.devices.sim.az3.machine import Az3
from barewire.devices.sim.core.simulator import MachineUnits, Simulator
from barewire.devices.sim.csd_mt.machine import CsdMt

_SIMULATORS: dict[str, type[Simulator]] = {"adxl": Adxl, "az3": Az3, "csd-mt": CsdMt}
"""The machines that have been taught to move, by the name of their description."""


def simulator(
    device: str | Path | Device,
    now: float = 0.0,
    *,
    node: int | None = None,
    bitrate: int | None = None,
    unit: int | None = None,
) -> Simulator:
    """The simulator of a device, by its name, its path or its description.

    `node`, `bitrate` (CANopen) and `unit` (Modbus) are how it is delivered, if not as the description has it.

    >>> machine = simulator("csd-mt")
    >>> type(machine).__name__, machine.canopen
    ('CsdMt', None)
    """
    described = device if isinstance(device, Device) else load(device)
    # A description of somebody's own may have the name of one of ours; only ours has the parameters we move.
    kind = (
        _SIMULATORS[described.name]
        if described.name in _SIMULATORS and described is load(described.name)
        else Simulator
    )
    side = described.canopen
    if side is not None:
        side = side._replace(node=node or side.node, bitrate=bitrate or side.bitrate)
        described = replace(described, canopen=side)
    machine = kind(described, now)
    if unit is not None:
        machine.readdress(unit)
    return machine


__all__ = ["simulator", "Simulator", "MachineUnits", "Adxl", "Az3", "CsdMt", "_SIMULATORS"]
