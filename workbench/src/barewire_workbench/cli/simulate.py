"""`barewire simulate`: simulate a machine or a plain table on real ports until interrupted."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import click

from barewire import EncodeError, ModbusServer, Table
from barewire.devices.description.load import DEVICE_FILE
from barewire.devices.sim import MachineUnits, Simulator, simulator
from barewire.errors import shown
from barewire.io.canopen.bus.port import inside_one_process
from barewire.io.endpoint import Endpoint
from barewire.io.fault_injection.faults import LATE, Fault, faults_at, faults_on_can, parse_faults
from barewire.io.machine import serial_settings
from barewire.io.ports.pty import is_pseudo_terminal
from barewire.io.server.base import ThreadedServer
from barewire.modbus import Unit
from barewire_workbench.cli.arguments import device_argument, duration_or_zero, endpoint_url, is_eds
from barewire_workbench.cli.output import note_refused_pdos
from barewire_workbench.cli.value_text import parse_value
from barewire_workbench.replay.recorded import is_recorded
from barewire_workbench.replay.unit_replay import recorded_units

_TABLE = "table"


@click.command("simulate")
@device_argument
@click.argument("endpoints", type=endpoint_url, nargs=-1, required=True, metavar="ENDPOINT...")
@click.option("--set", "values", multiple=True, metavar="NAME=VALUE", help="Set a parameter, also a read-only one.")
@click.option("--world", multiple=True, metavar="NAME=VALUE", help="Set a property of the environment: see above.")
@click.option("--fault", metavar="KIND[=VALUE][:P][@WHICH],...", help="Disturb responses: see above.")
@click.option("--seed", type=int, help="Seed of the faults, to repeat them.")
@click.option(
    "--late",
    type=duration_or_zero,
    default=LATE,
    show_default=True,
    metavar="S",
    help="Delay of the fault `late` in seconds.",
)
@click.option("--panel", is_flag=True, help="Serve a page of the machine for browsers; see barewire panel --help.")
def simulate_command(
    device: str,
    endpoints: tuple[str, ...],
    values: tuple[str, ...],
    world: tuple[str, ...],
    fault: str | None,
    seed: int | None,
    late: float,
    panel: bool,
) -> None:
    """Simulate a device on real ports until interrupted.

    DEVICE is a name of `barewire devices`, the directory of your own description, a file that `barewire record` wrote,
    an EDS or DCF of a CANopen device (its objects with their defaults, on one can:// endpoint), or `table`: 65,536
    coils, discrete inputs, holding and input registers. Several endpoints lead to the same machine, with the same
    values.

    A serial ENDPOINT whose path outside /dev does not exist becomes a new pseudo-terminal with that name, which another
    program opens like a serial port; `rtu://pty` becomes one without a name. can://socketcand/127.0.0.1:29536/can0
    becomes a new bus if no server listens on that port. When an endpoint listens, `ready ENDPOINT` is printed.

    \b
    barewire simulate adxl rtu:///tmp/adxl & sleep 1
    barewire read rtu:///tmp/adxl adxl "Thyristors temperature"
    barewire simulate az3 rtu:///tmp/az3 can://socketcand/127.0.0.1:29536/can0
    barewire simulate my-meter tcp://127.0.0.1:1502 --set "Current=4.2"
    barewire simulate az3 rtu:///tmp/az3 --fault late:0.05,drop,flip:0.01 --seed 7 & sleep 1
    barewire read "rtu:///tmp/az3?retries=5" az3 "STATUS WORD"
    barewire simulate table tcp://127.0.0.1:1502 --fault exception=04@20,drop@every=3
    barewire simulate pump.toml rtu:///tmp/line
    barewire simulate drive.eds "can://socketcand/127.0.0.1:29536/can0?node=5"

    --panel serves a page at the last ENDPOINT, of which it is a client: on a serial line give another program another
    ENDPOINT. The page writes values, sets properties of the environment as --world does, and has a switch for each
    fault of that line.

    --fault disturbs responses, and prints `fault KIND` for each. It works on tcp, tls (before encryption), udp, rtu,
    ascii, rtu+tcp, ascii+tcp and can. KIND hits one response in ten, KIND:P those with the probability P; what follows
    an @ selects the responses: by an address that the request touches, or by their number.

    \b
    late=S             the response is sent after S seconds; without S: see --late
    noise              bytes that are not a frame precede it; on CAN a frame of another node
    wrong-unit         the response has the address of another unit or node
    wrong-transaction  it has another transaction number            (tcp, tls, udp)
    drop               the response is not sent
    flip               one bit of it is inverted                    (not on CAN)
    exception=CODE     an exception is sent instead, 06 without CODE (hexadecimal); on CAN an SDO abort
    split              it is sent in two parts, 20 ms apart         (not on CAN, not over UDP)
    paced=S            it is sent byte by byte, S seconds apart, 0.005 without S   (as split)

    \b
    --fault drop:0.05,late                one response in 20 is lost, one in 10 late
    --fault exception=04@20               requests that touch address 20 (14h) of any table get exception 04
    --fault paced@holding:20-29           those that touch holding registers 20 to 29; coil:, discrete:, input:
    --fault drop@every=3                  each third response is lost
    --fault late=2@nth=5                  the fifth one is late
    --fault wrong-unit@20@every=2         each second one of those that touch address 20
    --fault drop:0.5@every=2              half of the second, the fourth ..., by dice

    --world sets a property of the environment; positions are in steps of the shaft from its first one, 12800 a
    revolution:

    \b
    adxl    line=off              no supply
            alarm=OVERHEATED      an alarm that lasts; alarm= ends it
            i1=on                 input 1 is closed; i2, i3
            limits=3, remotes=1   LIM1 to LIM4 and REM1 to REM4, as bits
            preheats=on, selects-motor=on, inhibited=on         status 1, 14, 11
            start-delay=2, kick-time=0.5, torque-limit=0.7      status 3, 4, 7 in a start
    az3     volts=0               no high voltage
            fault=7305            a fault that lasts; fault=0 ends it
    csd-mt  I0=30000:31000        input I0 is ON between these positions (I1=-50000: ON above); I2, I3, I4
            I3=on, I3=off         the input is fixed
            walls=-60000:60000    the mechanical end stops
            pull-out=20000        the speed above which steps are lost, from the load
            volts=0               the power section has no supply
            ambient=60            °C around the drive
            encoder=4000, index=100, friction=100000, model=S4
    """
    stop = threading.Event()

    def end(number: int, frame: object) -> None:
        stop.set()

    if "?order=" in device:
        raise EncodeError(
            f"{shown(device)}: a simulated device has its own byte order; --set its register, if it has one"
        )
    for number, endpoint in enumerate(endpoints):
        _check_reachable(endpoint)
        bus = Endpoint.parse(endpoint)
        if bus.scheme == "can" and any(bus.place == Endpoint.parse(other).place for other in endpoints[:number]):
            raise EncodeError(f"endpoint {shown(endpoint, 200)}: the device is on this bus already: expected it once")
    if panel and (device == _TABLE or is_eds(device) or _recorded(device) is not None):
        raise click.UsageError(f"--panel: {shown(device)}: expected a machine with a description")
    faults = None if fault is None else _checked_faults(fault, late, list(map(Endpoint.parse, endpoints)))
    is_described = is_eds(device)
    recorded = None if is_described else _recorded(device)
    is_machine = device != _TABLE and recorded is None and not is_described
    machine = _configured_machine(device, list(map(Endpoint.parse, endpoints))) if is_machine else None
    _set_initial_state(device, machine, values, world)
    disturbed: dict[str, Any] = {}
    if faults is not None or panel:  # the page puts faults into answers later
        disturbed = {"faults": faults or (), "fault_seed": seed, "fault_delay": late, "on_fault": _print_fault}
    server_at: Callable[[str], ThreadedServer]
    if machine is not None:
        server_at = partial(machine_server, machine=machine, **disturbed)
    elif is_described:
        if len(endpoints) != 1 or Endpoint.parse(endpoints[0]).scheme != "can":
            raise EncodeError(f"{device}: the device of an EDS is on one CAN bus: expected one endpoint, can://...")
        server_at = partial(_eds_server, file=device, **disturbed)
    elif recorded is not None:
        server_at = partial(_recorded_server, units=recorded, **disturbed)
    else:
        server_at = partial(_table_server, table=Table(), **disturbed)
    servers = []
    with ExitStack() as opened:  # if one cannot be opened, those before it are closed, and a link of rtu://PATH removed
        for endpoint in endpoints:
            servers.append(server_at(endpoint))
            opened.callback(servers[-1].close)
        opened.pop_all()
    # Only now: opening a port may wait, and there Ctrl-C must raise KeyboardInterrupt.
    for number in (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        signal.signal(number, end)
    for server in servers:
        print(f"ready {server.url}", flush=True)
    if panel and machine is not None:
        _serve_with_panel(servers, machine)
    else:
        _serve(servers, stop)


def _serve(servers: list[ThreadedServer], stop: threading.Event) -> None:
    """Run all servers until `stop`; if one fails, all end."""
    first, *others = servers
    with ExitStack() as stack:
        for server in others:
            server.on_end = stop.set
            stack.enter_context(server)
        first.run(stop)
    for server in others:
        if server.failure is not None:
            raise server.failure


def _serve_with_panel(servers: list[ThreadedServer], machine: Simulator) -> None:
    """Run all servers, and the page of the machine, until a signal. Raises the error of a server that failed."""
    from barewire_workbench.cli.panel import serve_panel
    from barewire_workbench.cli.panels.world import SimulatedWorld

    line = servers[-1]
    assert line.faults is not None
    with ExitStack() as stack:
        for server in servers:
            stack.enter_context(server)
        serve_panel(machine.device, line.url, writable=True, world=SimulatedWorld(machine, line.faults))
    for server in servers:
        if server.failure is not None:
            raise server.failure


def _checked_faults(text: str, late: float, endpoints: Sequence[Endpoint]) -> tuple[Fault, ...]:
    """Return the faults of --fault. Raises UsageError for a wrong text, and for faults that an endpoint cannot have."""
    try:
        faults = parse_faults(text)
        for endpoint in endpoints:
            if endpoint.scheme == "can":
                faults_on_can(faults, delay=late)
            else:
                faults_at(endpoint, faults, delay=late)
    except EncodeError as error:
        raise click.UsageError(f"--fault {text}: {error}" if len(text) < 60 else str(error)) from None
    return faults


def _print_fault(kind: str) -> None:
    print(f"fault {kind}", flush=True)


def _set_initial_state(device: str, machine: Simulator | None, values: tuple[str, ...], world: tuple[str, ...]) -> None:
    """Apply --world and --set."""
    for text in world:
        if machine is None:
            raise EncodeError(f"--world {shown(text)}: a {device} has no environment")
        machine.set_environment(text)
    for text in values:
        name, equals, value = text.partition("=")
        if not equals:
            raise click.UsageError(f"--set {shown(text)}: expected NAME=VALUE")
        if machine is None:
            raise EncodeError(f"--set {shown(text)}: a {device} has no named values")
        cell = machine.store.cell(machine.device.find(name).name)
        if cell.measured is not None:
            raise EncodeError(f"--set {shown(text)}: the simulator computes {cell.name} itself")
        cell.set(cell.free.check(parse_value(cell.parameter, value)))


def _tcp_units(endpoint: Endpoint) -> tuple[int, ...]:
    """Return the further unit addresses of a device on TCP that is not a gateway [MB-TCP 4.4.2]."""
    return (255, 0) if endpoint.framing == "tcp" else ()


def _table_server(url: str, table: Table, **faults: Any) -> ThreadedServer:
    """Return a server for a table, unit 1 unless the endpoint gives another."""
    endpoint = Endpoint.parse(url)
    address = endpoint.integer("unit", 1)
    _check_unit(endpoint, address)
    return ModbusServer(url, dict.fromkeys((address, *_tcp_units(endpoint)), table), **faults)


def _recorded(device: str) -> Mapping[int, Unit] | None:
    """Return the units of a file of `barewire record`; None if the device is something else."""
    path = Path(device)
    if os.path.isfile(path) and path.name != DEVICE_FILE:  # False for a name that is too long
        if is_recorded(path.read_text("utf-8", errors="replace")):
            return recorded_units(path)
        text = "expected a file that `barewire record` wrote, or the directory of a description"
        raise EncodeError(f"{device}: {text}")
    if path.suffix == ".toml" and not os.path.exists(path):
        raise EncodeError(f"{device}: no such file: expected a recording, which `barewire record` writes")
    return None


def _recorded_server(url: str, units: Mapping[int, Unit], **faults: Any) -> ThreadedServer:
    """Return a server for recorded units. One unit alone has the further addresses of a device on TCP."""
    endpoint = Endpoint.parse(url)
    if "unit" in endpoint.options:
        raise EncodeError(f"{shown(url, 200)}: recorded units have their own addresses: {', '.join(map(str, units))}")
    if len(units) == 1:
        (unit,) = units.values()
        units = {**dict.fromkeys(_tcp_units(endpoint), unit), **units}
    return ModbusServer(url, units, **faults)


def _eds_server(url: str, file: str, **faults: Any) -> ThreadedServer:
    """Return a server for the node that an EDS describes. Why PDOs of it are switched off, is printed on stderr."""
    from barewire import CanopenServer  # needs python-can

    server = CanopenServer(url, eds=file, **faults)
    note_refused_pdos(file, server.refused_pdos)
    return server


def machine_server(url: str, machine: Simulator, **faults: Any) -> ThreadedServer:
    """Return a server for a simulated machine at a URL. `faults` are the options of that name of `ModbusServer`."""
    endpoint = Endpoint.parse(url)
    if endpoint.scheme == "can":
        if machine.canopen is None:
            raise EncodeError(f"{machine.device.name} has no CANopen: expected a Modbus endpoint")
        from barewire import CanopenServer  # needs python-can

        return CanopenServer(url, device=machine.canopen, **faults)
    units = MachineUnits(machine, *_tcp_units(endpoint))
    _check_unit(endpoint, machine.address)
    is_real_port = os.path.exists(endpoint.place) and not is_pseudo_terminal(endpoint.place)
    settings = serial_settings(machine.device, url) if is_real_port else {}
    return ModbusServer(url, units, **settings, **faults)


def _configured_machine(device: str, endpoints: Sequence[Endpoint]) -> Simulator:
    """Return a machine with the unit address, node-ID and bit rate that its endpoints give."""
    keys = ("unit", "node", "bitrate")
    given = {key: endpoint.integer(key, 0) for endpoint in endpoints for key in keys if key in endpoint.options}
    machine = simulator(
        device, time.monotonic(), unit=given.get("unit"), node=given.get("node"), bitrate=given.get("bitrate")
    )
    if machine.canopen is not None:
        machine.canopen.bus_bitrate = machine.canopen.bitrate
    return machine


def _check_reachable(url: str) -> None:
    place = Endpoint.parse(url).place
    if url.lower().startswith("can:") and (remark := inside_one_process(place)):
        instead = f"use can://socketcand/127.0.0.1:29536/{place.partition('/')[2]}"
        raise click.UsageError(f"{shown(url, 200)}: {remark}, no other program reaches it; {instead}")


def _check_unit(endpoint: Endpoint, address: int) -> None:
    if endpoint.is_serial_port and not 1 <= address <= 247:
        raise EncodeError(f"unit {address}: a unit on a serial line has an address from 1 to 247")
