"""Arguments, options, output and signals that several commands share.

The bodies import what they need: `barewire read` must not load the EDS parser or the CAN monitor.
"""

from __future__ import annotations

import errno
import json
import math
import os
import signal
import stat
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import click

from barewire.errors import BarewireError, EncodeError, PortError, shown
from barewire.io.endpoint import Endpoint

if TYPE_CHECKING:
    from barewire import ModbusClient
    from barewire_workbench.frames.modbus_exchanges import UnitNames
    from barewire_workbench.monitor import KnownNode


class EndpointArgument(click.ParamType[str]):
    """A URL. It is checked before any port is opened, and passed on as text."""

    name = "endpoint"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the URL itself."""
        try:
            endpoint = Endpoint.parse(value)
            if endpoint.scheme == "can":
                with suppress(PortError):  # python-can is missing: opening the bus reports that
                    from barewire.io.ports.can.interfaces import check_interface

                    check_interface(endpoint)
        except EncodeError as error:
            if ctx is not None and "://" not in value and _is_device(value):
                usage = " ".join([ctx.command_path, *ctx.command.collect_usage_pieces(ctx)])
                self.fail(f"{shown(value)} is a device: expected {usage}", param, ctx)
            self.fail(str(error), param, ctx)
        return str(value)


def _is_device(name: str) -> bool:
    """Return whether a text is the name of a device instead of a URL: the arguments are probably swapped."""
    from barewire.devices import names  # only errors need it

    return name.lower() in (*names(), "raw", "table") or os.path.isdir(name)  # Path.is_dir raises for a long one


class CommandGroup(click.Group):
    """A group of commands. A command that does not exist is an error with the nearest one."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that the arguments name."""
        names = self.list_commands(ctx)
        if args[0] not in names and not args[0].startswith("-"):
            from barewire.devices.device import suggest  # only errors need it

            hint = suggest(args[0], names)
            ctx.fail(f"unknown command {shown(args[0])}: expected one of {', '.join(names)}{hint}")
        return super().resolve_command(ctx, args)


class Choice(click.Choice[str]):
    """One of a few words. A wrong one is an error with the nearest."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the word."""
        if value in self.choices:
            return str(value)
        from barewire.devices.device import suggest  # only errors need it

        hint = suggest(str(value), self.choices)
        self.fail(f"{shown(value)}: expected one of {', '.join(self.choices)}{hint}", param, ctx)


class Seconds(click.ParamType[float]):
    """A number of seconds, above 0 unless it `may_be_zero`, and below 1000000."""

    name = "seconds"

    def __init__(self, *, may_be_zero: bool = False) -> None:
        self.may_be_zero = may_be_zero

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not 0 <= number < 1e6 or not (number or self.may_be_zero):
            self.fail(f"{shown(value)}: expected seconds, {'0 or more' if self.may_be_zero else 'above 0'}", param, ctx)
        return number


endpoint_argument = click.argument("endpoint", type=EndpointArgument())
device_argument = click.argument("device")
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
nodes_option = click.option(
    "--node", "nodes", type=int, multiple=True, help="CAN: the node-ID of that --device, one for each."
)
units_option = click.option(
    "--unit", "units", type=int, multiple=True, help="Modbus: the unit of that --device; without it, every unit."
)

protocol_option = click.option(
    "--protocol",
    type=Choice(["rtu", "ascii"]),
    help="Of a log or hex dump of a serial line; by default its bytes tell.",
)
ports_option = click.option(
    "--port",
    "ports",
    type=click.IntRange(1, 65535),
    multiple=True,
    help="TCP port of servers in a capture, besides 502.",
)


def print_timing(endpoint: str) -> None:
    """Print the times of a line on stderr, for `--timing`. Raises EncodeError for a CAN bus."""
    from barewire.io.modbus.carriers import modbus_endpoint, timing_in_words

    print(f"barewire: {endpoint} {timing_in_words(modbus_endpoint(endpoint))}", file=sys.stderr)


@contextmanager
def late_response_awaited(machine: Callable[[], object], no_wait: bool) -> Iterator[None]:
    """After the block, wait until no late response of a serial line is expected any more, unless `no_wait`: the next
    command has no memory of the requests of this one. The error of the block, or a line on stderr, says how long that
    took. Ctrl-C in the block or while waiting ends the command at once; the line says that too. `machine` returns the
    MachineClient, which must still be open, or None."""
    failure: BarewireError | None = None
    try:
        yield
    except BarewireError as error:
        failure = error
        raise
    except (KeyboardInterrupt, click.exceptions.Exit):
        if not no_wait and _pending_client(machine()) is not None:
            _print_note("interrupted before a response that the next command could take for its own")
        no_wait = True
        raise
    finally:
        text = "" if no_wait else _wait_for_late_response(machine())
        if text and failure is not None:
            failure.add_context(text)
        elif text:
            _print_note(text)


def _print_note(text: str) -> None:
    with suppress(OSError):
        print(f"barewire: {text}", file=sys.stderr, flush=True)


def _pending_client(machine: object) -> ModbusClient | None:
    """Return the client of a machine, if a response on its serial line is pending."""
    from barewire import ModbusClient

    client = getattr(machine, "client", None)
    return client if isinstance(client, ModbusClient) and client.bus.state.pending else None


def _wait_for_late_response(machine: object) -> str:
    """Wait, and return what was done in words; an empty text if no response was pending, or the port has failed."""
    client = _pending_client(machine)
    if client is None:
        return ""
    start = time.monotonic()
    try:
        client.settle()
    except BarewireError:
        return ""
    except KeyboardInterrupt:
        pass
    waited = f"waited {time.monotonic() - start:.1f} s more for a late response"
    return f"{waited}, which the next command could take for its own (--no-wait: do not wait)"


def output_form(form: str | None, *, as_json: bool) -> str:
    """Return the form of the output that `--format` and `--json` ask for. Raise EncodeError if they are at odds."""
    if as_json and form not in (None, "json"):
        raise EncodeError(f"--json and --format {form}: give one of them")
    return "json" if as_json else form or "text"


def print_json(fields: Any) -> None:
    """Print one object on one line, and flush it."""
    print(json.dumps(_without_nan(fields), ensure_ascii=False, allow_nan=False), flush=True)


def _without_nan(value: Any) -> Any:
    """Return the same value with text in place of NaN and the infinities, for which JSON has no numbers."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    return [_without_nan(item) for item in value] if isinstance(value, (list, tuple)) else value


def text_with_notes(error: Exception) -> str:
    """Return the text of an error, with its notes: which names were being read, what was written before."""
    text = str(error)
    return "; ".join([text, *(note for note in getattr(error, "__notes__", []) if note not in text)])


def opened_file(path: str | Path) -> BinaryIO:
    """Return a file to read. Raise PortError if it cannot be opened, or is a device, which may have no end."""
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            raise OSError(errno.EINVAL, "a device, not a file")
        return Path(path).open("rb")
    except OSError as error:
        raise PortError(f"{path}: {error.strerror or error}") from None


def file_content(path: str | Path) -> bytes:
    """Return the bytes of a file. Raise PortError if it cannot be read; as `opened_file`."""
    with opened_file(path) as file:
        try:
            return file.read()
        except OSError as error:
            raise PortError(f"{path}: {error.strerror or error}") from None


def check_not_overwritten(option: str, target: str | Path, *sources: str) -> None:
    """Raise EncodeError if the file that an option names for writing is one of those that are read."""
    for source in sources:
        if os.path.isfile(target) and os.path.exists(source) and os.path.samefile(source, target):
            raise EncodeError(f"{option} {target}: {source} is the same file, which would be overwritten")


@contextmanager
def unfinished_as_json(as_json: bool) -> Iterator[None]:
    """With `--json`, print the early end of a conformance run as the last object. The error is raised in any case."""
    from barewire_workbench.live.unfinished import Unfinished

    try:
        yield
    except Unfinished as error:
        if as_json:
            print_json({"unfinished": str(error), "not_run": error.not_run})
        raise


def known_nodes(devices: Iterable[str], nodes: Iterable[int]) -> list[KnownNode]:
    """Return the nodes of `--device az3 --node 5`, given once for each node. A device is a name of the catalogue, the
    path of a description, or an EDS or DCF file."""
    numbers = list(nodes)
    names = list(devices)
    if len(numbers) > len(names):
        raise EncodeError("--node without --device: give a --device for each --node")
    found = []
    for place, name in enumerate(names):
        number = numbers[place] if place < len(numbers) else None
        if number is not None and not 1 <= number <= 127:
            raise EncodeError(f"--node {number}: expected 1..127")
        found.append(_known_node(name, number))
    return found


def _known_node(name: str, node: int | None) -> KnownNode:
    from barewire_workbench.monitor import of_device, of_dictionary

    if not name.lower().endswith((".eds", ".dcf")):
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

    names, numbers = list(devices), list(units)
    if len(numbers) > len(names):
        raise EncodeError("--unit without --device: give a --device for each --unit")
    if len(names) > len(numbers) + 1:
        raise EncodeError(f"--device {names[-1]}: with several devices, give a --unit for each")
    found: dict[int | None, RegisterNames] = {}
    for place, name in enumerate(names):
        unit = numbers[place] if place < len(numbers) else None
        if unit is not None and not 0 <= unit <= 255:
            raise EncodeError(f"--unit {unit}: expected 0..255")
        device = load(name)
        if device.modbus is None:
            raise EncodeError(f"--device {name}: {device.name} has no Modbus")
        found[unit] = RegisterNames(device)
    return UnitNames(found) if found else None


# Signals


class EndedBySignal(KeyboardInterrupt):
    """A signal ends this process, with the exit status `status`."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.status = 128 + number


_ENDING_SIGNALS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


@contextmanager
def ended_by_signals(*, interrupt: bool = False) -> Iterator[Callable[[], None]]:
    """Within the block, the first signal that would end the process raises `EndedBySignal`; later ones are ignored.

    SIGTERM and SIGHUP are such signals, with `interrupt` SIGINT (Ctrl-C) too. Yield a function that makes the block
    ignore the first one as well. After a signal, SIGTERM and SIGHUP stay ignored behind the block; Ctrl-C does not.
    """
    is_ignored = has_ended = False

    def ignore() -> None:
        nonlocal is_ignored
        is_ignored = True

    # The handler stays when the signals are ignored: Python prints a warning if SIG_IGN replaces it just after a
    # signal was received.
    def end(number: int, _: object) -> None:
        nonlocal is_ignored, has_ended
        if not is_ignored:
            is_ignored = has_ended = True
            raise EndedBySignal(number)

    # SIGHUP stays ignored under nohup, SIGINT in background jobs of a shell.
    signals = (*_ENDING_SIGNALS, signal.SIGINT) if interrupt else _ENDING_SIGNALS
    handlers = {ending: signal.getsignal(ending) for ending in signals}
    previous = {ending: handler for ending, handler in handlers.items() if handler is not signal.SIG_IGN}
    for number in previous:
        signal.signal(number, end)
    try:
        yield ignore
    finally:
        for number, before in previous.items():
            if not has_ended or number == signal.SIGINT:
                signal.signal(number, before)
