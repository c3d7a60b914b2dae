"""`barewire simulate`: be one of the machines, or a plain table, on a real port, until somebody says stop."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

import click

from barewire.cli.arguments import EndpointArgument, device_argument
from barewire.devices.sim import MachineUnits, Simulator, simulator
from barewire.devices.value_text import parse_value
from barewire.errors import EncodeError
from barewire.io.endpoint import Endpoint
from barewire.io.fault_injection.faults import LATE, parse_faults
from barewire.io.server.base import ThreadedServer
from barewire.io.server.can import CanopenServer
from barewire.io.server.modbus import ModbusServer
from barewire.modbus import Table, Unit

TABLE = "table"


@click.command()
@device_argument
@click.argument("endpoints", type=EndpointArgument(), nargs=-1, required=True, metavar="ENDPOINT...")
@click.option(
    "--set", "values", multiple=True, metavar="NAME=VALUE", help="What it shows, also where a master may not."
)
@click.option("--world", multiple=True, metavar="NAME=VALUE", help="What is around it: see below.")
@click.option("--fault", metavar="KIND[:P],...", help="Spoil answers: see below.")
@click.option("--seed", type=int, help="The same faults each time, with the same answers.")
@click.option("--late", default=LATE, show_default=True, metavar="S", help="Seconds that the fault `late` takes.")
def simulate(
    device: str,
    endpoints: tuple[str, ...],
    values: tuple[str, ...],
    world: tuple[str, ...],
    fault: str | None,
    seed: int | None,
    late: float,
) -> None:
    """Simulate DEVICE at ENDPOINT until interrupted; at several of them it is the same machine, with the same values.

    DEVICE is a name of `barewire devices`, the directory of a description of your own, or `table`: 65,536 coils,
    discrete inputs, holding and input registers.

    A serial ENDPOINT whose path does not exist yet becomes a new pseudo-terminal under that name, which another program
    opens like a serial port; `rtu://pty` makes one without a name. can://socketcand/127.0.0.1:29536/can0 becomes a bus
    of its own if nobody serves that port yet. Once it listens it prints `ready ENDPOINT`.

    \b
    barewire simulate adxl rtu:///tmp/adxl &
    barewire read rtu:///tmp/adxl adxl "Thyristors temperature"
    barewire simulate az3 rtu:///tmp/az3 can://socketcand/127.0.0.1:29536/can0
    barewire simulate my-meter tcp://127.0.0.1:1502 --set "Current=4.2"
    barewire simulate az3 rtu:///tmp/az3 --fault late:0.05,drop,flip:0.01 --seed 7

    A fault strikes each answer with the probability P, 0.1 if not given, and is told in a line:

    \b
    late        the answer comes --late seconds later
    noise       bytes that are no answer come before it; on CAN a frame of a stranger
    wrong-unit  the right answer with the address of another unit or node
    drop        no answer
    flip        one bit is another                                  (not on CAN)
    exception   exception 06 in its place; on CAN an SDO abort
    split       the answer in two parts with 20 ms between          (not on CAN, not over UDP)

    What --world sets, as often as wanted. For adxl line=0, i1=1, limits=3, remotes=1, preheats=1, selects-motor=1,
    inhibited=1, start-delay=2, kick-time=0.5, torque-limit=0.7; for az3 volts=0; for csd-mt (in steps of the shaft
    from where it stands at first, 12800 a revolution):

    \b
    I0=30000:31000   a switch at input I0 that is ON there (I1=-50000: is ON above); I3=on, I3=off a level
    walls=-60000:60000   where the mechanics end          pull-out=20000   the load: faster, and steps are lost
    volts=0              the power section                ambient=60       °C around the drive
    encoder=4000, index=100, friction=100000, model=S4

    Faults are for every carrier: tcp, tls (before it is encrypted), udp, rtu, ascii, rtu+tcp, ascii+tcp and can.
    """
    stop = threading.Event()

    def end(number: int, frame: Any) -> None:
        stop.set()

    if "?order=" in device:
        raise EncodeError(f"{device!r}: the order is the machine's own: --set its register, if it has one")
    faults = None if fault is None else parse_faults(fault)
    machine = None if device == TABLE else delivered(device, [Endpoint.parse(endpoint) for endpoint in endpoints])
    _preset(device, machine, values, world)
    spoiled: dict[str, Any] = {}
    if faults is not None:
        spoiled = {"faults": faults, "fault_seed": seed, "fault_delay": late, "on_fault": _print_fault}
    table = Table()
    hosts = [host_device(device, endpoint, machine, table, **spoiled) for endpoint in endpoints]
    # Only now: opening a port may wait for somebody, and an interrupt must end that as well.
    for number in (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        signal.signal(number, end)
    for host in hosts:
        print(f"ready {host.url}", flush=True)
    _serve(hosts, stop)


def _serve(hosts: list[ThreadedServer], stop: threading.Event) -> None:
    """All of them until `stop`; the end of one is the end of all."""
    first, *others = hosts
    with ExitStack() as stack:
        for host in others:
            host.on_end = stop.set
            stack.enter_context(host)
        first.run(stop)
    for host in others:
        if host.failure is not None:
            raise host.failure


def _print_fault(kind: str) -> None:
    print(f"fault {kind}", flush=True)


def _preset(device: str, machine: Simulator | None, values: tuple[str, ...], world: tuple[str, ...]) -> None:
    for text in world:
        if machine is None:
            raise EncodeError(f"--world {text!r}: there is nothing around a {device}")
        machine.set_environment(text)
    for text in values:
        name, equals, value = text.partition("=")
        if not equals:
            raise click.UsageError(f"--set {text!r}: expected NAME=VALUE")
        if machine is None:
            raise EncodeError(f"--set {text!r}: {device} has no names")
        cell = machine.store.cell(machine.device.find(name).name)
        if cell.measured is not None:
            raise EncodeError(f"--set {text!r}: this simulator moves {cell.name} by itself")
        cell.set(cell.free.check(parse_value(cell.parameter, value)))


def host_device(
    device: str, endpoint: str, machine: Simulator | None = None, table: Table | None = None, **faults: Any
) -> ThreadedServer:
    """The server of a simulated device (or of `machine`, one that exists already) at a URL. `faults` are the options of
    that name of `ModbusServer`."""
    at = Endpoint.parse(endpoint)
    if device == TABLE:
        return ModbusServer(endpoint, units_at(at, table or Table(), 1), **faults)
    if machine is None:
        machine = delivered(device, [at])
    if at.scheme == "can":
        if machine.canopen is None:
            raise EncodeError(f"{device} has no CANopen: it speaks Modbus")
        return CanopenServer(endpoint, device=machine.canopen, **faults)
    units = MachineUnits(machine, *((255, 0) if at.framing == "tcp" else ()))
    _check_unit(at, machine.address)
    return ModbusServer(endpoint, units, **faults)


def delivered(device: str, places: Sequence[Endpoint]) -> Simulator:
    """The machine as its endpoints want it: unit address, node-ID and bit rate of the bus, where they say one."""
    told = {key: at.integer(key, 0) for at in places for key in ("unit", "node", "bitrate") if key in at.options}
    machine = simulator(
        device, time.monotonic(), unit=told.get("unit"), node=told.get("node"), bitrate=told.get("bitrate")
    )
    if machine.canopen is not None:
        machine.canopen.bus_bitrate = machine.canopen.bitrate
    return machine


def _check_unit(at: Endpoint, address: int) -> None:
    if at.is_serial_port and not 1 <= address <= 247:
        raise EncodeError(f"unit {address}: a unit on a serial line has an address in 1..247")


def units_at(at: Endpoint, unit: Unit, default: int) -> dict[int, Unit]:
    """The unit under its address; a directly connected TCP device is also unit 255 and 0 [MB-TCP 4.4.2]."""
    address = at.integer("unit", default)
    _check_unit(at, address)
    return {address: unit, 255: unit, 0: unit} if at.framing == "tcp" else {address: unit}
