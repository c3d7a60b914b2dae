"""`barewire canopen`: a device compared with its DCF and configured, a network booted. The rest: `canopen_services`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from barewire.canopen.eds import parse
from barewire.errors import BarewireError, EncodeError, shown
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.arguments import CommandGroup, endpoint_argument
from barewire_workbench.cli.canopen_services import (
    emcy_command,
    heartbeat_command,
    lss_command,
    nmt_command,
    pdo_command,
    sync_command,
)
from barewire_workbench.cli.output import Output, file_content, output_option, print_json, status_line

if TYPE_CHECKING:
    from barewire.canopen import BootEvent, BootResult, DeviceConfiguration, NetworkList
    from barewire.canopen.configuration.configure import ConfigureProgress
    from barewire.canopen.configuration.settings import Difference
    from barewire.canopen.eds import Eds
    from barewire.canopen.object_dictionary import ObjectDictionary
    from barewire.io.canopen.node import DcfNode
    from barewire.io.canopen.operations import BlockingBusRunner


@click.group("canopen", cls=CommandGroup)
def canopen_command() -> None:
    """Configure devices, boot a network; NMT, LSS, emergencies, PDOs."""


for _command in (nmt_command, heartbeat_command, sync_command, lss_command, emcy_command, pdo_command):
    canopen_command.add_command(_command)


_file_argument = click.argument("file", type=click.Path(path_type=Path))


@canopen_command.command("diff")
@endpoint_argument
@_file_argument
@output_option
def diff_command(endpoint: str, file: Path, output: Output) -> int:
    """Compare a device with FILE, its DCF. Nothing is written.

    The node is that of ENDPOINT (?node=5), or else that of FILE. Only values that FILE has as a ParameterValue are
    compared, and what identifies the device. Exit status 1 if anything differs.

    \b
    barewire canopen diff can://socketcan/can0 pump.dcf
    1017h:00 Producer heartbeat time: device 0, configuration 500
    """
    with _node(endpoint, file) as node:
        with status_line() as show:
            differences = node.diff(progress=_numbered(show))
        _print(differences, node.number, output)
        if not differences:
            output.text(f"node {node.number}: no differences")
    return int(bool(differences))


@canopen_command.command("configure")
@endpoint_argument
@_file_argument
@click.option("--dry-run", is_flag=True, help="Write nothing: print what would be written.")
@click.option("--store", is_flag=True, help="Then store all parameters in the device (1010h:01).")
@output_option
def configure_command(endpoint: str, file: Path, dry_run: bool, store: bool, output: Output) -> None:
    """Write the values of FILE, a DCF, to a device where they differ.

    The node is that of ENDPOINT (?node=5), or else that of FILE. PDOs that change are off meanwhile, all values are
    read back, and 1020h gets the date of FILE. A device of another type is not configured.

    \b
    barewire canopen configure can://socketcan/can0 pump.dcf --dry-run
    barewire canopen configure can://socketcan/can0 pump.dcf --store
    """
    with _node(endpoint, file) as node:
        configure_node(node, output, dry_run=dry_run, store=store)


def configure_node(node: DcfNode[BlockingBusRunner], output: Output, *, dry_run: bool, store: bool) -> None:
    """Write the values of its DCF to a node where they differ, and print them."""
    with status_line() as show:
        result = node.configure(dry_run=dry_run, store=store, progress=_numbered(show))
    _print(result.changes, node.number, output)
    output.text(*(f"not written: {text}" for text in result.left_out))
    verb = "would be written" if dry_run else "written"
    count = f"{len(result.changes)} value{'s' if len(result.changes) != 1 else ''}"
    if not result.changes:
        count = "nothing" if result.left_out else "no differences, nothing"
    output.text(f"node {node.number}: {count} {verb}{', stored' if result.stored else ''}")


@contextmanager
def _node(endpoint: str, file: Path) -> Iterator[DcfNode[BlockingBusRunner]]:
    _check_bus(endpoint)
    described = parsed_file(file)
    from barewire import CanopenClient

    with CanopenClient(endpoint) as client:
        with _context(file):
            node = client.node(dcf=described)
        yield node


def _check_bus(endpoint: str) -> None:
    if not endpoint.startswith("can://"):
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: a DCF is for CANopen: expected can://")


def parsed_file(file: Path) -> Eds:
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


def _numbered(show: Callable[[str], None] | None) -> ConfigureProgress | None:
    """Return a function that shows a step with its number."""
    return None if show is None else lambda done, total, step: show(f"{done + 1}/{total} {step}")


def _print(differences: Iterable[Difference], node: int, output: Output) -> None:
    for difference in differences:
        output.show(difference, _fields(difference, node))


def _fields(difference: Difference, node: int) -> dict[str, object]:
    entry = difference.entry
    place, present, wanted = (
        f"{entry.index:04X}h:{entry.sub:02X}",
        _plain(difference.present),
        _plain(difference.wanted),
    )
    fields = {"node": node, "object": place, "name": entry.name, "device": present, "configuration": wanted}
    return fields | ({"reason": difference.reason} if difference.reason else {})


def _plain(value: object) -> object:
    return value.hex(" ").upper() if isinstance(value, bytes) else value


# A network

_STARTUP, _HEARTBEAT = 0x1F80, 0x1017
_FROM_FILES = (0x1F20, 0x1F22, 0x1F58)
"""Objects of a manager that are domains: a stored DCF, a concise DCF, a program."""
_BOOT_TIME = 10.0


@canopen_command.command("boot")
@endpoint_argument
@click.argument("files", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="FILE...")
@click.option("--dry-run", is_flag=True, help="Send no command and write nothing: print what would be written.")
@click.option("--no-start", is_flag=True, help="Configure the nodes and leave them pre-operational.")
@click.option("--boot-time", type=click.FloatRange(0), metavar="SECONDS",
              help="For mandatory nodes; 0: no limit. By default 1F89h of the manager, or 10.")  # fmt: skip
@output_option
def boot_command(
    endpoint: str, files: Sequence[Path], dry_run: bool, no_start: bool, boot_time: float | None, output: Output
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
    _check_bus(endpoint)
    network = _network_of(files)
    endpoint_node = Endpoint.parse(endpoint).integer("node", 0)
    numbers = [slave.node for slave in network.slaves]
    if endpoint_node and numbers != [endpoint_node]:
        listed = ", ".join(map(str, numbers)) or "no nodes"
        text = f"node {endpoint_node} is requested; boot boots the nodes of the files, which are {listed}"
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: {text}: leave out node=", "node")
    if no_start:
        network = replace(network, start_slaves=False)
    if boot_time is not None:
        network = replace(network, boot_time=boot_time)
    from barewire import CanopenClient

    def tell(event: BootEvent) -> None:
        if output.as_json or event.kind != "ready":  # the last line says it
            output.show(event, _boot_fields(event.node, event.kind, str(event), event.result))

    with CanopenClient(endpoint) as client, status_line() as show:
        progress = None if show is None else lambda node, step: show(f"node {node}: {step}")
        booted = client.nmt.boot(network, on_event=tell, progress=progress, dry_run=dry_run)
    for result in booted.results if dry_run else ():
        kind = "checked" if result.ok else "failed"
        output.show(result, _boot_fields(result.node, kind, str(result), result))
    known = {result.node for result in booted.results}
    for slave in network.slaves:
        if slave.node not in known and not slave.mandatory:
            text = f"node {slave.node}: optional, and it sent no boot-up message"
            output.show(text, _boot_fields(slave.node, "absent", text, None))
    verb = ("could be" if booted.ready else "would not be") if dry_run else "is" if booted.ready else "is not"
    output.text(f"the network {verb} ready")
    if output.as_json and (dry_run or not booted.ready):
        print_json({"node": 0, "event": "ready" if booted.ready else "not ready"})
    return 0 if booted.ready else 1


def _boot_fields(node: int, event: str, text: str, result: BootResult | None) -> dict[str, object]:
    fields: dict[str, object] = {"node": node, "event": event, "text": text}
    if result is not None:
        fields |= {"error": None if result.error is None else result.error.name, "configured": result.configured}
        fields |= {} if result.planned is None else {"planned": list(result.planned)}
    return fields


def _network_of(files: Sequence[Path]) -> NetworkList:
    """Return the network that the files describe."""
    from barewire.canopen import NetworkList, device_configuration, network_list, slave_of

    network: NetworkList | None = None
    configurations: dict[int, DeviceConfiguration] = {}
    for file in files:
        described = parsed_file(file)
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
        slaves = [
            slave_of(configuration, mandatory=True, heartbeat=_heartbeat(configuration))
            for configuration in configurations.values()
        ]
        return NetworkList(slaves, boot_time=_BOOT_TIME)
    slaves = []
    for slave in network.slaves:
        own = configurations.pop(slave.node, None)
        slaves.append(slave if own is None else replace(slave, configuration=own, date=slave_of(own).date, concise=()))
    for node in configurations:
        raise EncodeError(f"node {node} has a DCF, but the manager does not list it (1F81h:{node:02X})")
    return replace(network, slaves=slaves)


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
    times = [setting.value for setting in configuration.settings if setting.place == (_HEARTBEAT, 0)]
    return 2 * times[0] / 1000 if times and isinstance(times[0], int) else 0.0
