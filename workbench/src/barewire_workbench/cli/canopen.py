"""`barewire canopen`: a device compared with its DCF and configured, a network booted."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from barewire.canopen.eds import parse
from barewire.errors import EncodeError, shown
from barewire_workbench.cli.arguments import CommandGroup, endpoint_argument, file_content, json_option, print_json
from barewire_workbench.cli.canopen_boot import boot_command

if TYPE_CHECKING:
    from barewire.canopen.configuration.configure import ConfigureProgress
    from barewire.canopen.configuration.settings import Difference
    from barewire.io.canopen.dcf_node import DcfNode
    from barewire.io.canopen.methods.operations import BlockingBusRunner


@click.group("canopen", cls=CommandGroup)
def canopen_command() -> None:
    """Compare a CANopen device with its DCF, configure it, and boot a network."""


canopen_command.add_command(boot_command)

file_argument = click.argument("file", type=click.Path(path_type=Path))


@canopen_command.command("diff")
@endpoint_argument
@file_argument
@json_option
def diff_command(endpoint: str, file: Path, as_json: bool) -> int:
    """Compare a device with FILE, its DCF. Nothing is written.

    The node is that of ENDPOINT (?node=5), or else that of FILE. Only values that FILE has as a ParameterValue are
    compared, and what identifies the device. Exit status 1 if anything differs.

    \b
    barewire canopen diff can://socketcan/can0 pump.dcf
    1017h:00 Producer heartbeat time: device 0, configuration 500
    """
    with _node(endpoint, file) as node:
        with _progress() as progress:
            found = node.diff(progress=progress)
        _print(found, node.number, as_json)
        if not found and not as_json:
            print(f"node {node.number}: no differences")
    return int(bool(found))


@canopen_command.command("configure")
@endpoint_argument
@file_argument
@click.option("--dry-run", is_flag=True, help="Write nothing: print what would be written.")
@click.option("--store", is_flag=True, help="Then store all parameters in the device (1010h:01).")
@json_option
def configure_command(endpoint: str, file: Path, dry_run: bool, store: bool, as_json: bool) -> None:
    """Write the values of FILE, a DCF, to a device where they differ.

    The node is that of ENDPOINT (?node=5), or else that of FILE. PDOs that change are off meanwhile, all values are
    read back, and 1020h gets the date of FILE. A device of another type is not configured.

    \b
    barewire canopen configure can://socketcan/can0 pump.dcf --dry-run
    barewire canopen configure can://socketcan/can0 pump.dcf --store
    """
    with _node(endpoint, file) as node:
        with _progress() as progress:
            result = node.configure(dry_run=dry_run, store=store, progress=progress)
        _print(result.changes, node.number, as_json)
        if as_json:
            return
        for text in result.left_out:
            print(f"not written: {text}")
        verb = "would be written" if dry_run else "written"
        count = f"{len(result.changes)} value{'s' if len(result.changes) != 1 else ''}"
        if not result.changes:
            count = "nothing" if result.left_out else "no differences, nothing"
        print(f"node {node.number}: {count} {verb}{', stored' if result.stored else ''}")


@contextmanager
def _node(endpoint: str, file: Path) -> Iterator[DcfNode[BlockingBusRunner]]:
    if not endpoint.startswith("can://"):
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: a DCF is for CANopen: expected can://")
    described = parse(file_content(file))
    if not described.objects:
        raise EncodeError(f"{file}: the file describes no object: expected a DCF")
    from barewire import CanopenClient

    with CanopenClient(endpoint) as client:
        try:
            node = client.node(dcf=described)
        except EncodeError as error:
            error.add_context(str(file))
            raise
        yield node


@contextmanager
def _progress() -> Iterator[ConfigureProgress | None]:
    """Yield a function that shows the present step in one line of the terminal; None if stderr is not one."""
    if not sys.stderr.isatty():
        yield None
        return

    def show(done: int, total: int, step: str) -> None:
        print(f"\r\x1b[K{done + 1}/{total} {step}"[:120], end="", file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def _print(found: Iterable[Difference], node: int, as_json: bool) -> None:
    for one in found:
        if as_json:
            entry = one.entry
            place, present, wanted = f"{entry.index:04X}h:{entry.sub:02X}", _plain(one.present), _plain(one.wanted)
            fields = {"node": node, "object": place, "name": entry.name, "device": present, "configuration": wanted}
            print_json(fields | ({"reason": one.reason} if one.reason else {}))
        else:
            print(one)


def _plain(value: object) -> object:
    return value.hex(" ").upper() if isinstance(value, bytes) else value
