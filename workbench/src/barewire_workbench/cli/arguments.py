"""Arguments and options that several commands share.

The bodies import what they need: `barewire read` must not load the EDS parser or the CAN monitor. The types are
functions: click 8.1 has no generic `ParamType`, and names the option of a `BadParameter` itself.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from barewire.errors import EncodeError, PortError, shown, suggest
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.output import file_content, note

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from barewire.devices import Device
    from barewire.io.machine import MachineClient
    from barewire_workbench.frames.modbus_exchanges import UnitNames
    from barewire_workbench.monitor import KnownNode


def endpoint_url(value: str) -> str:
    """The type of an ENDPOINT: a URL, which is checked before any port is opened, and passed on as text, with its
    scheme in small letters.

    >>> endpoint_url("TCP://127.0.0.1")
    'tcp://127.0.0.1'
    """
    try:
        endpoint = Endpoint.parse(value)
        if endpoint.scheme == "can":
            with suppress(PortError):  # python-can is missing: opening the bus reports that
                from barewire.io.ports.can.interfaces import check_interface

                check_interface(endpoint)
    except EncodeError as error:
        if "://" not in value and _is_device(value):  # the arguments are probably swapped
            context = click.get_current_context()
            usage = " ".join([context.command_path, *context.command.collect_usage_pieces(context)])
            raise click.BadParameter(f"{shown(value)} is a device: expected {usage}") from None
        raise click.BadParameter(f"{error}{_url_hint(value)}") from None
    return endpoint.scheme + value[len(endpoint.scheme) :]


def _url_hint(value: str) -> str:
    """Return the URL that was probably meant, for an endpoint without a scheme.

    >>> for value in ("/dev/ttyUSB0", "COM3", "192.168.1.20:1502", "can0"):
    ...     print(_url_hint(value))
    ; did you mean 'rtu:///dev/ttyUSB0'?
    ; did you mean 'rtu://COM3'?
    ; did you mean 'tcp://192.168.1.20:1502'?
    ; did you mean 'can://socketcan/can0'?
    """
    forms = {
        r"/dev/[^?]+(\?.*)?|COM\d+(\?.*)?": "rtu://",
        r"(\d+\.){3}\d+(:\d+)?(\?.*)?|localhost(:\d+)?(\?.*)?": "tcp://",
        r"v?can\d+(\?.*)?": "can://socketcan/",
    }
    for form, start in forms.items():
        if re.fullmatch(form, value, re.IGNORECASE):
            return f"; did you mean {start + value!r}?"
    return ""


def _is_device(name: str) -> bool:
    from barewire.devices import names  # only errors need it

    # Path.is_dir raises for a long name.
    return name.lower() in (*names(), "raw", "table") or os.path.isdir(name) or is_eds(name)


_SECONDS = {"ms": 0.001, "s": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0, "d": 86400.0}


def _complete_device(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the devices that begin with this; if there is none, let the shell complete the path of a file."""
    from click.shell_completion import CompletionItem

    from barewire.devices import names

    known = [CompletionItem(name) for name in (*names(), "raw") if name.startswith(incomplete.lower())]
    return known or [CompletionItem(incomplete, type="file")]


def duration(value: str) -> float:
    """The type of a time: seconds, or with one of the units ms, s, m, min, h, d; above 0, and below 1000000 s.

    >>> duration("10"), duration("1.5h"), duration("200ms")
    (10.0, 5400.0, 0.2)
    """
    match = re.fullmatch(r"(.*?) *(ms|s|min|m|h|d)", str(value).strip())  # a default is a number
    number = _number(match[1]) * _SECONDS[match[2]] if match else _number(value)
    if not 0 < number < 1e6:
        raise click.BadParameter(f"{shown(value)}: expected seconds, above 0, below 1000000, such as 200ms, 15m, 12h")
    return number


def duration_or_zero(value: str) -> float:
    """The type of a time in seconds that may be 0."""
    number = _number(value)
    if not 0 <= number < 1e6:
        raise click.BadParameter(f"{shown(value)}: expected seconds, 0 or more")
    return number


def _number(value: str) -> float:
    try:
        return float(value)
    except ValueError:
        return math.nan  # which is in no range


class Choice(click.Choice):  # type: ignore[type-arg]  # generic since click 8.2
    """One of a few words. A wrong one is an error with the nearest."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the word."""
        if value in self.choices:
            return str(value)
        hint = suggest(str(value), self.choices)
        self.fail(f"{shown(value)}: expected one of {', '.join(self.choices)}{hint}", param, ctx)


class CommandGroup(click.Group):
    """A group of commands. A command that does not exist is an error with the nearest one."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that the arguments name."""
        names = self.list_commands(ctx)
        if args[0] not in names and not args[0].startswith("-"):
            hint = suggest(args[0], names)
            ctx.fail(f"unknown command {shown(args[0])}: expected one of {', '.join(names)}{hint}")
        return super().resolve_command(ctx, args)


endpoint_argument = click.argument("endpoint", type=endpoint_url)
device_argument = click.argument("device", shell_complete=_complete_device)
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object a line.")
format_option = click.option(
    "--format", "form", type=Choice(["text", "json", "html", "svg"]), help="The form of the output; --json is json."
)
timing_option = click.option(
    "--timing", is_flag=True, help="Print the silences and pauses of the line on stderr, in ms."
)
no_wait_option = click.option(
    "--no-wait",
    is_flag=True,
    help="After a time-out on a serial line, do not wait for a late response; the next command may get it.",
)
no_check_option = click.option(
    "--no-check", is_flag=True, help="Do not ask first whether the machine is a DEVICE, as far as it can tell."
)
nodes_option = click.option(
    "--node",
    "nodes",
    type=click.IntRange(1, 127),
    multiple=True,
    help="CAN: the node-ID of that --device, one for each.",
)
units_option = click.option(
    "--unit",
    "units",
    type=click.IntRange(0, 255),
    multiple=True,
    help="Modbus: the unit of that --device; without it, every unit.",
)


def check_no_file_name(names: Iterable[str]) -> None:
    """Raise EncodeError for a name that is a file: `--csv` takes none."""
    for name in names:
        if name.lower().endswith((".csv", ".json", ".db")):
            hint = f"into a file: > {name}, or barewire watch ... --to {name}"
            raise EncodeError(f"{shown(name)} is no NAME; --csv and --json print on stdout, {hint}")


def check_machine(machine: MachineClient, no_check: bool, *, before_write: bool = False) -> bool:
    """Ask a machine what it is, unless `no_check`, and return whether there is no more to ask. Raises WrongDevice for
    another one; before a write NoAnswer too."""
    if no_check:
        return True
    from barewire.errors import NoAnswer
    from barewire_workbench.live.check_device import WrongDevice, check_device

    try:
        return check_device(machine, before_write=before_write)
    except WrongDevice as error:
        error.add_context("--no-check goes on")
        raise
    except NoAnswer as error:
        error.add_context("it was asked what it is before the write; --no-check does not ask")
        raise


def print_timing(endpoint: str, device: Device | None = None) -> None:
    """Print the times of a line on stderr, for `--timing`. Raises EncodeError for a CAN bus."""
    from barewire.io.machine import serial_settings
    from barewire.io.modbus.carriers import modbus_endpoint, timing_in_words

    settings = serial_settings(device, endpoint) if device else {}
    note(f"{endpoint} {timing_in_words(modbus_endpoint(endpoint, settings))}")


def known_nodes(devices: Iterable[str], nodes: Iterable[int]) -> list[KnownNode]:
    """Return the nodes of `--device az3 --node 5`, given once for each node. A device is a name of the catalogue, the
    path of a description, or an EDS or DCF file."""
    return [_known_node(name, node) for name, node in _pairs("--node", devices, nodes)]


def _pairs(option: str, devices: Iterable[str], numbers: Iterable[int]) -> list[tuple[str, int | None]]:
    """Return each --device with its number, or with None behind the last one."""
    names, given = list(devices), list(numbers)
    if len(given) > len(names):
        raise EncodeError(f"{option} without --device: give a --device for each {option}")
    return [(name, given[place] if place < len(given) else None) for place, name in enumerate(names)]


def is_eds(name: str) -> bool:
    """Return whether a name is that of an EDS or DCF file."""
    return name.lower().endswith((".eds", ".dcf"))


def load_device(name: str, endpoint: str = "") -> Device:
    """Return the device of a description, or of an EDS or DCF file for the node of an endpoint.

    Raises EncodeError for an EDS whose node-ID neither file nor endpoint gives; without an endpoint it is 1.
    """
    if not is_eds(name):
        from barewire.devices import load

        return load(name)
    from barewire.canopen.eds import parse
    from barewire_workbench.eds.device import device_of_eds

    document = parse(file_content(name))
    if not document.objects:
        raise EncodeError(f"{name}: the file describes no object: expected an EDS or DCF")
    is_can = endpoint.startswith("can:")
    node = (Endpoint.parse(endpoint).integer("node", 0) if is_can else 0) or document.node_id
    if node is None and is_can:
        raise EncodeError(
            f"{name}: an EDS has no node-ID: give it with the endpoint, such as {endpoint.partition('?')[0]}?node=5"
        )
    return device_of_eds(document, name, node or 1)


def _known_node(name: str, node: int | None) -> KnownNode:
    from barewire_workbench.monitor import of_device, of_dictionary

    if not is_eds(name):
        from barewire.devices import load

        return of_device(load(name), node)
    from barewire.canopen.eds import parse

    document = parse(file_content(name))
    node = node or document.node_id  # of a DCF
    if node is None:
        raise EncodeError(f"{name}: an EDS has no node-ID: give it with --node")
    return of_dictionary(document.dictionary(node), node, name)


def known_units(devices: Iterable[str], units: Iterable[int]) -> UnitNames | None:
    """Return the devices of `--device adxl --unit 1`, given once for each unit; None without a device. One device
    without a unit is at all other units."""
    from barewire.devices import load
    from barewire_workbench.frames.modbus_exchanges import RegisterNames, UnitNames

    pairs = _pairs("--unit", devices, units)
    without_unit = [name for name, unit in pairs if unit is None]
    if len(without_unit) > 1:
        raise EncodeError(f"--device {without_unit[-1]}: with several devices, give a --unit for each")
    names: dict[int | None, RegisterNames] = {}
    for name, unit in pairs:
        device = load(name)
        if device.modbus is None:
            raise EncodeError(f"--device {name}: {device.name} has no Modbus")
        names[unit] = RegisterNames(device)
    return UnitNames(names) if names else None
