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
from barewire.shells.faults import LATE, parse_faults
from barewire.shells.faulty import open_faulty

TABLE = "table"


@click.command()
@device_argument
@endpoint_argument
@click.option("--fault", metavar="KIND[:P],...", help="Spoil answers: see below.")
@click.option("--seed", type=int, help="The same faults each time, with the same answers.")
@click.option("--late", default=LATE, show_default=True, metavar="S", help="Seconds that the fault `late` takes.")
def simulate(device: str, endpoint: str, fault: str | None, seed: int | None, late: float) -> None:
    """Simulate DEVICE at ENDPOINT until interrupted.

    DEVICE is a name of `barewire devices`, the directory of a description of your own, or `table`: 65,536 coils,
    discrete inputs, holding and input registers.

    A serial ENDPOINT whose path does not exist yet becomes a new pseudo-terminal under that name, which another program
    opens like a serial port; `rtu://pty` makes one without a name. can://socketcand/127.0.0.1:29536/can0 becomes a bus
    of its own if nobody serves that port yet. Once it listens it prints `ready ENDPOINT`.

    \b
    barewire simulate adxl rtu:///tmp/adxl &
    barewire read rtu:///tmp/adxl adxl "Thyristors temperature"
    barewire simulate az3 rtu:///tmp/az3 --fault late:0.05,drop,flip:0.01 --seed 7

    A fault strikes each answer with the probability P, 0.1 if not given, and is told in a line:

    \b
    late        the answer comes --late seconds later
    noise       bytes that are no answer come before it; on CAN a frame of a stranger
    wrong-unit  the right answer with the address of another unit or node
    drop        no answer
    flip        one bit is another                                  (not on CAN)
    exception   exception 06 in its place; on CAN an SDO abort
    split       the answer in two parts with 20 ms between          (not on CAN)
    """
    stop = threading.Event()

    def end(number: int, frame: Any) -> None:
        stop.set()

    host = host_device(device, endpoint) if fault is None else _spoiled(device, endpoint, fault, seed, late)
    # Only now: opening a port may wait for somebody, and an interrupt must end that as well.
    for number in (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        signal.signal(number, end)
    print(f"ready {host.url}", flush=True)
    host.run(stop)


def _spoiled(device: str, endpoint: str, fault: str, seed: int | None, late: float) -> Host:
    def told(kind: str) -> None:
        print(f"fault {kind}", flush=True)

    return open_faulty(
        endpoint, lambda url: host_device(device, url), parse_faults(fault), seed=seed, late=late, told=told
    )


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
    if at.is_serial_port and not 1 <= address <= 247:
        raise EncodeError(f"unit {address}: a unit on a serial line has an address in 1..247")
    return {address: unit, 255: unit, 0: unit} if at.envelope == "tcp" else {address: unit}
