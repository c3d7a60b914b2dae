"""`barewire scan`: the units of a line, the nodes of a bus, the addresses of a unit."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from barewire.errors import BarewireError
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.arguments import duration_or_zero, endpoint_url
from barewire_workbench.cli.output import Output, note, output_option, status_line
from barewire_workbench.scan.addresses import TABLES
from barewire_workbench.scan.units import unit_numbers

if TYPE_CHECKING:
    from barewire.devices import Device
    from barewire_workbench.live.scan_canopen import FoundNode
    from barewire_workbench.live.scan_modbus import FoundUnit, ModbusScan, Progress

_AUTO = "auto"
_ADDRESSES = re.compile(r"(?P<table>[a-z]+)(?::(?P<first>\d{1,5})(?:-(?P<last>\d{1,5}))?)?")


def _numbers(value: str) -> list[int]:
    """The type of `--units`: numbers and ranges."""
    try:
        return unit_numbers(value)
    except ValueError as error:
        raise click.BadParameter(str(error)) from None


def _node_numbers(value: str) -> list[int]:
    """The type of `--nodes`: the same in 1..127."""
    numbers = _numbers(value)
    if not set(numbers) <= set(range(1, 128)):
        raise click.BadParameter(f"{value!r}: expected nodes in 1..127")
    return numbers


def _rates(value: str) -> list[int] | None:
    """The type of `--baudrates` and `--bitrates`: numbers, or None for auto."""
    if value == _AUTO:
        return None
    parts = [part.strip() for part in value.split(",")]
    if not all(part.isdecimal() and int(part[:9]) > 0 and len(part) < 9 for part in parts):
        raise click.BadParameter(f"{value!r}: expected rates in bit/s, such as 9600,19200, or auto")
    return [int(part) for part in parts]


def _formats(value: str) -> list[str] | None:
    """The type of `--formats`: such as 8E1,8N1, or None for auto."""
    return None if value == _AUTO else [part.strip() for part in value.split(",")]


def _address_range(value: str) -> tuple[str, int, int]:
    """The type of `--addresses`: a table, and the addresses to try."""
    match = _ADDRESSES.fullmatch(value)
    if match is None or match["table"] not in TABLES:
        tables = ", ".join(TABLES)
        raise click.BadParameter(f"{value!r}: expected a table and addresses, such as holding:0-999; tables: {tables}")
    first = int(match["first"] or 0)
    last = int(match["last"] or (0xFFFF if match["first"] is None else first))
    if not first <= last <= 0xFFFF:
        raise click.BadParameter(f"{value!r}: expected addresses in 0..65535, the smaller one first")
    return match["table"], first, last


@click.command("scan")
@click.argument("endpoint", type=endpoint_url)
@click.option("--units", type=_numbers, metavar="LIST", help="The units that are asked, such as 1-10,247.  [1-247]")
@click.option("--baudrates", type=_rates, metavar="LIST", help="Of a serial line: auto, or such as 9600,19200.")
@click.option("--formats", type=_formats, metavar="LIST", help="Of a serial line: auto, or such as 8E1,8N1.")
@click.option("--every", is_flag=True, help="Try all other settings too after a unit has answered.")
@click.option("--nodes", type=_node_numbers, metavar="LIST", help="CAN: the nodes that are asked.  [1-127]")
@click.option("--listen", type=duration_or_zero, help="CAN: seconds to listen before anything is sent.  [2]")
@click.option(
    "--bitrates", type=_rates, metavar="LIST", help="CAN: bit rates to try, of an interface that can set them."
)
@click.option(
    "--addresses",
    type=_address_range,
    metavar="TABLE[:FIRST-LAST]",
    help="Find the addresses of the endpoint's unit that can be read.",
)
@click.option("--device", "descriptions", multiple=True, help="Name also this device: the directory of a description.")
@output_option
@click.pass_context
def scan_command(context: click.Context, /, endpoint: str, output: Output, **options: Any) -> None:
    """Find the units of a line, the nodes of a bus, the addresses of a unit.

    A scan only reads. Units are asked for holding register 0, and an exception is an answer too. Those that answer
    are asked what they are (functions 11h and 2B/0Eh); a device of the catalogue is named by what it says. Nodes are
    found by their heartbeats and by object 1000h, and asked for 1018h, 1008h, 1009h and 100Ah.

    Of a serial line the settings that ENDPOINT does not name are tried, the likely ones first, until a unit answers.
    The time-out follows from the baud rate; `timeout` of ENDPOINT sets another one, for devices that take longer than
    0.15 s.

    On a CAN bus a wrong bit rate disturbs the others: --bitrates is for a bus that is not operating.

    Exit status 1 if nothing was found.

    \b
    barewire scan rtu:///dev/ttyUSB0
    barewire scan "rtu:///dev/ttyUSB0?baudrate=9600" --units 1-32
    barewire scan tcp://192.168.1.20 --units 1-10
    barewire scan can://socketcan/can0
    barewire scan "tcp://192.168.1.20?unit=1" --addresses holding:0-999
    """
    place = Endpoint.parse(endpoint)
    _check_options(place, context, options)
    if options["addresses"] is not None:
        found = _scan_addresses(endpoint, options["addresses"], output)
    elif place.framing == "can":
        found = _scan_can(place, options, output)
    else:
        found = _scan_modbus(endpoint, options, output)
    if not found:
        context.exit(1)


@contextmanager
def _status() -> Iterator[Callable[[str], None]]:
    """Yield a function that shows a text in the status line, where stderr is a terminal."""
    with status_line() as show:
        yield show or (lambda text: None)


_OF_MODBUS = ("units", "baudrates", "formats", "every")
_OF_CAN = ("nodes", "listen", "bitrates")


def _check_options(endpoint: Endpoint, context: click.Context, options: dict[str, Any]) -> None:
    """Raise UsageError for an option that has no effect on this endpoint."""
    is_can = endpoint.framing == "can"
    useless: tuple[str, ...] = _OF_MODBUS if is_can else _OF_CAN
    if options["addresses"] is not None:
        if is_can:
            raise click.UsageError("--addresses is for Modbus; an EDS file lists the objects of a node")
        useless = (*_OF_MODBUS, *_OF_CAN, "descriptions")
    for name in useless:
        if context.get_parameter_source(name) is not click.core.ParameterSource.DEFAULT:
            what = "with --addresses" if options["addresses"] else f"for {endpoint.scheme}://"
            flag = "device" if name == "descriptions" else name
            raise click.UsageError(f"--{flag} has no meaning {what}")
    if options["bitrates"] and endpoint.place.startswith(("socketcan/", "socketcand/", "memory/")):
        raise click.UsageError(f"--bitrates: {endpoint.place} has the bit rate that the system gave it")


# Modbus


def _scan_modbus(endpoint: str, options: dict[str, Any], output: Output) -> int:
    from barewire_workbench.live.scan_modbus import scan_modbus

    with _status() as show:
        scan = scan_modbus(
            endpoint,
            options["units"] or range(1, 248),
            baudrates=options["baudrates"],
            formats=options["formats"],
            every=options["every"],
            descriptions=options["descriptions"],
            progress=lambda progress: show(_progress_text(progress)),
        )
        found = list(_shown(scan.run(), output, show))
    _conclude_modbus(scan, found, output)
    return len(found)


def _progress_text(progress: Progress) -> str:
    settings = f"{progress.settings}, " if progress.settings else ""
    return f"{settings}unit {progress.unit}, {_time_text(progress.seconds_left)} left at most"


def _time_text(seconds: float) -> str:
    """Return a time for people.

    >>> _time_text(7.4), _time_text(754)
    ('8 s', '12 min 34 s')
    """
    whole = int(seconds) + (seconds > int(seconds))
    return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60:02d} s"


def _shown(units: Iterator[FoundUnit], output: Output, show: Callable[[str], None]) -> Iterator[FoundUnit]:
    """Print each unit when it is found, and pass it on."""
    for unit in units:
        show("")
        settings = f"  {unit.settings}" if unit.settings else ""
        output.show(f"unit {unit.unit:<3}{settings}  {unit.scanned.why}{_identity_text(unit)}", unit.as_dict)
        yield unit


def _identity_text(found: Any) -> str:
    says = str(found.identity)
    named = f"\n          {found.device.name}: {found.device.title}" if found.device else ""
    return named + (f"\n          says: {says}" if says else "")


def _conclude_modbus(scan: ModbusScan, found: list[FoundUnit], output: Output) -> None:
    """Print what follows from the scan: how many were found, what to type next, or what to try."""
    readable = [unit for unit in found if unit.scanned.answers]
    addresses = {unit.unit for unit in found}
    if len(readable) > 3 and len(readable) == len(addresses) == len(scan.units):
        output.text(f"all {len(readable)} units answer: the server probably does not look at the unit; use the first")
    if scan.unreachable:
        note(f"a gateway answered for {scan.unreachable} units that it reaches no device")
    if scan.closed:
        note(
            f"the server closed the connection after {scan.closed} requests, as some do for units that they do not know"
        )
    if scan.stray and not scan.endpoint.is_serial_port and scan.endpoint.framing == "tcp":
        spoken = f"the other side speaks {scan.protocol}" if scan.protocol else "is this a Modbus server?"
        note(f"{scan.stray} pieces of what came are no answers: {spoken}")
    elif scan.stray:
        note(f"{scan.stray} frames or pieces of noise answer nothing that was asked: is there another master?")
    if not found:
        tried = f" with {', '.join(map(str, scan.tried))}" if scan.tried else ""
        units = f"{len(scan.units)} unit{'' if len(scan.units) == 1 else 's'}"
        note(f"{scan.endpoint}: none of {units} answered{tried}; see docs/how-to/find.md")
        return
    twice = "" if len(addresses) == len(found) else ", some with several settings"
    output.text(f"{len(addresses)} found{twice}")
    for unit in readable[:1]:
        output.text(f"next: {_next_line(unit.url, unit.device)}")


def _next_line(url: str, device: Device | None) -> str:
    if device is None:
        return f'barewire scan "{url}" --addresses holding:0-999'
    drive = device.drive
    name = drive.status_word if drive else next(row.name for row in device.parameters if row.readable)
    return f'barewire read "{url}" {device.name} "{name}"'


def _scan_addresses(endpoint: str, wanted: tuple[str, int, int], output: Output) -> int:
    from barewire import ModbusClient
    from barewire_workbench.live.scan_modbus import scan_addresses

    table, first, last = wanted
    count, example = 0, None
    with ModbusClient(endpoint) as client, _status() as show:
        for found in scan_addresses(
            client, table, first, last, progress=lambda address: show(f"{table}:{address} of {last}")
        ):
            show("")
            output.show(f"{table}:{found}", {"table": table, **found._asdict()})
            if not found.problem:
                count += found.last - found.first + 1
                example = found.first if example is None else example
    if example is None:
        note(f"{endpoint}: nothing can be read at {table}:{first}-{last}")
        return 0
    output.text(f"{count} of {last - first + 1} addresses can be read")
    output.text(f'next: barewire read "{endpoint}" raw {table}:{example}')
    return count


# CANopen


def _scan_can(endpoint: Endpoint, options: dict[str, Any], output: Output) -> int:
    count, example = 0, None
    with _status() as show:
        for bitrate, found in _nodes(endpoint, options, show):
            show("")
            rate = f"  {bitrate} bit/s" if bitrate else ""
            output.show(f"node {found.node:<3}{rate}  {found.why}{_identity_text(found)}", found.as_dict)
            count += 1
            if example is None and found.scanned.answered_after is not None:
                example = found
    if not count:
        asked = len(_asked_nodes(options))
        note(f"{endpoint}: no node sent anything, and none of {asked} answered; see docs/how-to/find.md")
        return 0
    output.text(f"{count} found")
    if example is not None and example.device is not None:
        output.text(f"next: {_next_line(example.url, example.device)}")
    elif example is not None:
        output.text(f'next: barewire read "{example.url}" raw object:1000h:u32')
    return count


def _asked_nodes(options: dict[str, Any]) -> Collection[int]:
    return options["nodes"] or range(1, 128)


def _nodes(
    endpoint: Endpoint, options: dict[str, Any], show: Callable[[str], None]
) -> Iterator[tuple[int | None, FoundNode]]:
    """Yield each node with the bit rate at which it was found. What fails at one bit rate does not end the scan, unless
    it is the last."""
    from barewire_workbench.live.scan_canopen import scan_canopen

    listen = 2.0 if options["listen"] is None else options["listen"]
    *earlier, last = options["bitrates"] or [None]
    for bitrate in (*earlier, last):
        show(f"listening for {listen:g} s")
        nodes = scan_canopen(
            str(endpoint),
            _asked_nodes(options),
            listen=listen,
            bitrate=bitrate,
            descriptions=options["descriptions"],
            progress=lambda node, result: show(f"node {node}, {len(result.nodes)} found"),
        )
        try:
            yield from ((bitrate, node) for node in nodes)
        except BarewireError as error:
            if bitrate == last:
                raise
            note(f"{bitrate} bit/s: {error}")
