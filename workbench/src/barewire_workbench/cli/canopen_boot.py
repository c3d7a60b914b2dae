"""`barewire canopen boot`: a network booted by its manager, as DCFs describe it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from barewire.errors import BarewireError, EncodeError, shown
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.arguments import endpoint_argument, file_content, json_option, print_json

if TYPE_CHECKING:
    from barewire.canopen import BootEvent, BootResult, DeviceConfiguration, NetworkList
    from barewire.canopen.eds import Eds
    from barewire.canopen.object_dictionary import ObjectDictionary

_STARTUP, _HEARTBEAT = 0x1F80, 0x1017
_FROM_FILES = (0x1F20, 0x1F22, 0x1F58)
"""Objects of a manager that are domains: a stored DCF, a concise DCF, a program."""
_BOOT_TIME = 10.0


@click.command("boot")
@endpoint_argument
@click.argument("files", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="FILE...")
@click.option("--dry-run", is_flag=True, help="Send no command and write nothing: print what would be written.")
@click.option("--no-start", is_flag=True, help="Configure the nodes and leave them pre-operational.")
@click.option("--boot-time", type=click.FloatRange(0), metavar="SECONDS",
              help="For mandatory nodes; 0: no limit. By default 1F89h of the manager, or 10.")  # fmt: skip
@json_option
def boot_command(
    endpoint: str, files: Sequence[Path], dry_run: bool, no_start: bool, boot_time: float | None, as_json: bool
) -> int:
    """Boot a network as its CANopen manager (CiA 302-2): reset, check, configure and start its nodes.

    Each FILE is the DCF of a node, which must boot. One FILE may be the DCF of the manager, with the nodes in 1F80h to
    1F89h, what they must be, and their concise DCFs in 1F22h; then the DCF of a node takes the place of its
    configuration there. The nodes are those of the files: ?node= of ENDPOINT is refused if it is another one. The nodes
    are not watched afterwards.

    Exit status 1 if the network is not ready: a mandatory node has not booted.

    \b
    barewire canopen boot can://socketcan/can0 left.dcf right.dcf --dry-run
    barewire canopen boot can://socketcan/can0 manager.dcf
    """
    if not endpoint.startswith("can://"):
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: a DCF is for CANopen: expected can://")
    network = _network_of(files)
    asked = Endpoint.parse(endpoint).integer("node", 0)
    numbers = [slave.node for slave in network.slaves]
    if asked and numbers != [asked]:
        found = ", ".join(map(str, numbers)) or "no nodes"
        text = f"node {asked} is requested; boot boots the nodes of the files, which are {found}: leave out node="
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: {text}", "node")
    if no_start:
        network = replace(network, start_slaves=False)
    if boot_time is not None:
        network = replace(network, boot_time=boot_time)
    from barewire import CanopenClient

    def tell(event: BootEvent) -> None:
        if as_json:
            _print_result(event.node, event.kind, str(event), event.result)
        elif event.kind != "ready":  # the last line says it
            print(event, flush=True)

    with CanopenClient(endpoint) as client, _progress() as progress:
        booted = client.nmt.boot(network, on_event=tell, progress=progress, dry_run=dry_run)
    known = {result.node for result in booted.results}
    for result in booted.results if dry_run else ():
        if as_json:
            _print_result(result.node, "checked" if result.ok else "failed", str(result), result)
        else:
            print(result)
    for slave in network.slaves:
        if slave.node not in known and not slave.mandatory:
            text = f"node {slave.node}: optional, and it sent no boot-up message"
            _print_result(slave.node, "absent", text, None) if as_json else print(text)
    if not as_json:
        verb = ("could be" if booted.ready else "would not be") if dry_run else "is" if booted.ready else "is not"
        print(f"the network {verb} ready")
    elif dry_run or not booted.ready:
        print_json({"node": 0, "event": "ready" if booted.ready else "not ready"})
    return 0 if booted.ready else 1


def _print_result(node: int, event: str, text: str, result: BootResult | None) -> None:
    fields = {"node": node, "event": event, "text": text}
    if result is not None:
        fields |= {"error": None if result.error is None else result.error.name, "configured": result.configured}
        fields |= {} if result.planned is None else {"planned": list(result.planned)}
    print_json(fields)


def _network_of(files: Sequence[Path]) -> NetworkList:
    """Return the network that the files describe."""
    from barewire.canopen import NetworkList, device_configuration, network_list, slave_of

    network: NetworkList | None = None
    configurations: dict[int, DeviceConfiguration] = {}
    for file in files:
        described = _parsed(file)
        with _context(file):
            if _STARTUP in described.objects and int(described.dictionary().get(_STARTUP)) & 1:
                if network is not None:
                    raise EncodeError("a second file with 1F80h: expected the DCF of one manager")
                network = network_list(_manager_objects(described, file.parent), described.node_id)
                continue
            configuration = device_configuration(described)
            if configuration.node in configurations:
                raise EncodeError(f"a second DCF of node {configuration.node}")
            configurations[configuration.node] = configuration
    if network is None:
        slaves = [slave_of(one, mandatory=True, heartbeat=_heartbeat(one)) for one in configurations.values()]
        return NetworkList(slaves, boot_time=_BOOT_TIME)
    slaves = []
    for slave in network.slaves:
        own = configurations.pop(slave.node, None)
        slaves.append(slave if own is None else replace(slave, configuration=own, date=slave_of(own).date, concise=()))
    for node in configurations:
        raise EncodeError(f"node {node} has a DCF, but the manager does not list it (1F81h:{node:02X})")
    return replace(network, slaves=slaves)


def _parsed(file: Path) -> Eds:
    from barewire.canopen.eds import parse

    described = parse(file_content(file))
    if not described.objects:
        raise EncodeError(f"{file}: the file describes no object: expected a DCF")
    return described


@contextmanager
def _context(file: Path) -> Iterator[None]:
    try:
        yield
    except BarewireError as error:
        error.add_context(str(file))
        raise


def _manager_objects(described: Eds, folder: Path) -> ObjectDictionary:
    """Return the objects of a manager. A domain may be in a file of its own, which DownloadFile names."""
    objects = described.dictionary()
    for index in _FROM_FILES:
        for sub in objects.subs(index):
            name = described.get(f"{index:X}sub{sub:X}", "DownloadFile")
            if name:
                objects.set(index, sub, file_content(folder / name.strip()))
    return objects


def _heartbeat(configuration: DeviceConfiguration) -> float:
    """Return the seconds after which a node counts as silent: twice its heartbeat time, if its DCF has one."""
    times = [one.value for one in configuration.settings if one.place == (_HEARTBEAT, 0)]
    return 2 * times[0] / 1000 if times and isinstance(times[0], int) else 0.0


@contextmanager
def _progress() -> Iterator[Callable[[int, str], None] | None]:
    """Yield a function that shows the present step in one line of the terminal; None if stderr is not one."""
    if not sys.stderr.isatty():
        yield None
        return

    def show(node: int, step: str) -> None:
        print(f"\r\x1b[Knode {node}: {step}"[:120], end="", file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)
