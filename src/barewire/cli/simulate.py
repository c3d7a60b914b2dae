"""`barewire simulate`: be one of the machines, or a plain table, on a real port, until somebody says stop."""

from __future__ import annotations

import signal
import threading
import time
from typing import Any

import click

from barewire.cli.arguments import device_argument, endpoint_argument
from barewire.devices.sim import Simulator, simulator
from barewire.errors import EncodeError
from barewire.modbus import Table, Unit
from barewire.shells import Host, open_host
from barewire.shells.endpoint import Endpoint

TABLE = "table"


@click.command()
@device_argument
@endpoint_argument
def simulate(device: str, endpoint: str) -> None:
    """Simulate DEVICE at ENDPOINT until interrupted.

    DEVICE is a name of `barewire devices`, the directory of a description of your own, or `table`: 65,536 coils,
    discrete inputs, holding and input registers.

    A serial ENDPOINT whose path does not exist yet becomes a new pseudo-terminal under that name, which another program
    opens like a serial port; `rtu://pty` makes one without a name. can://socketcand/127.0.0.1:29536/can0 becomes a bus
    of its own if nobody serves that port yet. Once it listens it prints `ready ENDPOINT`.

    \b
    barewire simulate adxl rtu:///tmp/adxl &
    barewire read rtu:///tmp/adxl adxl "Thyristors temperature"
    """
    stop = threading.Event()

    def end(number: int, frame: Any) -> None:
        stop.set()

    signal.signal(signal.SIGINT, end)
    signal.signal(signal.SIGTERM, end)
    host = host_device(device, endpoint)
    print(f"ready {host.url}", flush=True)
    host.run(stop)


def host_device(device: str, endpoint: str, machine: Simulator | None = None) -> Host:
    """The host of a simulated device (or of `machine`, one that exists already) at a URL."""
    at = Endpoint.parse(endpoint)
    if device == TABLE:
        return open_host(endpoint, units=units_at(at, Table(), 1))
    if machine is None:
        node = at.integer("node", 0) or None if at.scheme == "can" else None
        machine = simulator(device, time.monotonic(), node=node)
    if at.scheme == "can":
        if machine.canopen is None:
            raise EncodeError(f"{device} has no CANopen: it speaks Modbus")
        return open_host(endpoint, node=machine.canopen)
    side = machine.device.modbus
    if machine.modbus is None or side is None:
        raise EncodeError(f"{device} has no Modbus: it speaks CANopen")
    return open_host(endpoint, units=units_at(at, machine.modbus, side.unit))


def units_at(at: Endpoint, unit: Unit, default: int) -> dict[int, Unit]:
    """The unit under its address; a directly connected TCP device is also unit 255 and 0 [MB-TCP 4.4.2]."""
    address = at.integer("unit", default)
    return {address: unit, 255: unit, 0: unit} if at.scheme == "tcp" else {address: unit}
