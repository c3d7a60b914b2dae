"""The services of a CANopen bus by hand: `barewire canopen nmt`, `heartbeat`, `sync`, `lss`, `emcy` and `pdo`."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from barewire.errors import EncodeError, NoAnswer, PortError, Refused, shown
from barewire_workbench.cli.arguments import Choice, CommandGroup, duration, endpoint_argument, is_eds, load_device
from barewire_workbench.cli.output import Output, file_content, note, output_option

if TYPE_CHECKING:
    from barewire import CanopenClient
    from barewire.canopen import EmcyEvent, NodeState, PdoConfig, PdoReceived, RemotePdo
    from barewire.canopen.lss.messages import LssAddress
    from barewire.canopen.object_dictionary import ObjectDictionary
    from barewire.devices import Device
    from barewire.io.canopen.bus.subscriber import Stream

_seconds_option = click.option("--for", "seconds", type=duration, metavar="S", help="End after S seconds.")
_count_option = click.option("--count", type=click.IntRange(min=1), help="End after so many messages.")


@contextmanager
def _client(endpoint: str) -> Iterator[CanopenClient]:
    if not endpoint.startswith("can:"):
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: CANopen is on a CAN bus: expected can://")
    from barewire import CanopenClient

    with CanopenClient(endpoint) as client:
        yield client


def _node_of(client: CanopenClient, endpoint: str, argument: str = "") -> int:
    """Return the node of an endpoint. `argument` is what a command takes in place of it, for the error."""
    if client.node_id is None:
        raise EncodeError(f"endpoint {shown(endpoint, 200)}: expected {argument}the node, such as ?node=5")
    return client.node_id


def _events(stream: Stream[Any], seconds: float | None, count: int | None) -> Iterator[Any]:
    """Yield the events of a stream until the time is over, or so many have come, or Ctrl-C. What happens to the bus is
    a line on stderr."""
    from barewire.canopen import ErrorFrame
    from barewire.io import BusDown, BusUp, FramesLost

    until = None if seconds is None else time.monotonic() + seconds
    left = count
    try:
        while left is None or left:
            event = stream.get(None if until is None else max(0.0, until - time.monotonic()))
            if event is None:
                return
            if isinstance(event, (ErrorFrame, FramesLost, BusDown, BusUp)):
                note(event.text if isinstance(event, ErrorFrame) else repr(event))
                continue
            yield event
            left = None if left is None else left - 1
    except KeyboardInterrupt:
        if seconds is None and count is None:
            return  # how it is meant to end
        raise


# NMT

_COMMANDS = {"start": 0x01, "stop": 0x02, "preop": 0x80, "reset": 0x81, "reset-comm": 0x82}
_STATES = {"start": 0x05, "stop": 0x04, "preop": 0x7F, "reset": 0x00, "reset-comm": 0x00}
"""The state that a node reports after the command; 0: its boot-up message."""


@click.command("nmt")
@endpoint_argument
@click.argument("command", type=Choice(list(_COMMANDS)))
@click.argument("node", required=False, metavar="[NODE|all]")
@click.option("--wait", type=duration, default=2.0, show_default=True, help="Seconds to wait for heartbeats.")
@click.option("--verify", is_flag=True, help="Ask a node without heartbeat for its state; status 1 if none tells it.")
@output_option
def nmt_command(endpoint: str, command: str, node: str | None, wait: float, verify: bool, output: Output) -> int:
    """Send an NMT command, and show the states that nodes report afterwards.

    NODE is by default that of ENDPOINT; `all` is every node. A node does not confirm the command: its heartbeat, or its
    boot-up message after a reset, shows its state. Exit status 1 if it reports another state than that of the command;
    with --verify also if there is no such node: one that sends nothing is asked by node guarding.

    \b
    barewire canopen nmt can://socketcan/can0 start 5 --verify
    barewire canopen nmt can://socketcan/can0 reset-comm all
    """
    from barewire.canopen import NmtCommand, NodeState

    with _client(endpoint) as client:
        if node is None:
            number = _node_of(client, endpoint, "NODE or all behind the command, or here ")
        elif node.isdecimal() and 1 <= int(node[:4]) <= 127:
            number = int(node)
        elif node == "all":
            number = 0
        else:
            raise EncodeError(f"node {shown(node)}: expected a number in 1..127, or all")
        reports: dict[int, NodeState] = {}
        keys = [(0x700 + sender, False) for sender in ([number] if number else range(1, 128))]
        with client.frames(*keys) as stream:
            bus = client.nmt if number == 0 else client.node(number).nmt
            bus.send(NmtCommand(_COMMANDS[command]))
            for frame in _events(stream, wait, None):
                if not frame.remote and len(frame.data) == 1:
                    state = NodeState.decode(frame)
                    reports[state.node] = state
                    if number and state.state == _STATES[command]:
                        break
        guarded = ""
        if verify and number and not reports:
            try:
                reports[number] = client.node(number).nmt.state(timeout=wait)
            except NoAnswer:
                guarded = ", and it did not answer"
            except PortError as error:  # socketcand carries no remote frames
                guarded = f", and it cannot be asked: {error}"
    for reported in sorted(reports):
        state = reports[reported]
        text = "booted" if state.is_boot_up else state.name
        output.show(f"node {reported}: {text}", {"node": reported, "state": state.state, "text": text})
    if not reports:
        addressed = f"node {number}" if number else "the nodes"
        told = f"no heartbeat came within {wait:g} s{guarded}"
        note(f"{command} was sent to {addressed}, which no node confirms; {told}, so the state is not known")
        return int(verify)
    return int(any(not _is_reached(command, state) for state in reports.values()))


def _is_reached(command: str, state: NodeState) -> bool:
    # After its boot-up message a node goes on to pre-operational, some of them to operational.
    return command.startswith("reset") or state.state == _STATES[command]


@click.command("heartbeat")
@endpoint_argument
@_seconds_option
@_count_option
@output_option
def heartbeat_command(endpoint: str, seconds: float | None, count: int | None, output: Output) -> None:
    """Show the nodes that send heartbeats, their states and each change of them, until Ctrl-C; with ?node= in ENDPOINT
    that node. Nothing is sent.

    \b
    barewire canopen heartbeat can://socketcan/can0 --for 2
    node 5: pre-operational
    """
    from barewire.canopen import NodeState

    is_silent = True
    with _client(endpoint) as client:
        streamed = client.nmt.heartbeats() if client.node_id is None else client.node().nmt.heartbeats()
        with streamed as stream:
            for event in _events(stream, seconds, count):
                is_silent, state = False, NodeState(event.node, event.state or 0).name
                text = state if event.kind in ("active", "state") else event.kind
                output.show(f"node {event.node}: {text}", {"node": event.node, "state": event.state, "text": text})
    if is_silent:
        note("no heartbeat came: a node sends none while its heartbeat time (1017h) is 0")


# SYNC


@click.command("sync")
@endpoint_argument
@click.option("--every", type=duration, metavar="S", help="Send one every S seconds, until Ctrl-C.")
@click.option("--count", type=click.IntRange(min=1), help="With --every: end after so many.")
def sync_command(endpoint: str, every: float | None, count: int | None) -> None:
    """Send SYNC, at which nodes send and take over their synchronous PDOs: once, or with --every again and again.

    A bus has one that sends SYNC: see `barewire sniff` first.

    \b
    barewire canopen sync can://socketcan/can0
    barewire canopen sync can://socketcan/can0 --every 0.1 --count 50
    """
    if every is None and count is not None:
        raise click.UsageError("--count: expected --every, the seconds between two SYNC")
    with _client(endpoint) as client:
        begin, sent = time.monotonic(), 0
        try:
            while sent < (count or (1 if every is None else math.inf)):
                time.sleep(max(0.0, begin + sent * (every or 0.0) - time.monotonic()))
                client.sync.send()
                sent += 1
        except KeyboardInterrupt:
            if count is not None:
                raise
    note(f"{sent} SYNC sent")


# LSS


@click.group("lss", cls=CommandGroup)
def lss_command() -> None:
    """Give devices their node-IDs and bit rates (CiA 305)."""


def _address(context: click.Context, parameter: click.Parameter, text: str | None) -> LssAddress | None:
    from barewire.canopen.lss.messages import LssAddress

    if text is None:
        return None
    try:
        parts = [int(part, 16) for part in text.split("-")]
    except ValueError:
        parts = []
    if len(parts) != 4 or not all(0 <= part < 1 << 32 for part in parts):
        raise click.BadParameter(f"{shown(text)}: expected VENDOR-PRODUCT-REVISION-SERIAL, hexadecimal")
    return LssAddress(*parts)


_address_option = click.option(
    "--address", callback=_address, metavar="ADDRESS", help="The device: VENDOR-PRODUCT-REVISION-SERIAL, hexadecimal."
)
_only_option = click.option("--only-device", is_flag=True, help="The device is the only one on the bus.")


@contextmanager
def _in_configuration(client: CanopenClient, address: LssAddress | None, only_device: bool) -> Iterator[None]:
    """Switch one device to configuration, and back."""
    from barewire.canopen import LssState

    if (address is None) != only_device:
        raise EncodeError("expected --address, which `barewire canopen lss find` shows, or --only-device")
    client.lss.switch_global(LssState.WAITING)
    try:
        if address is None:
            client.lss.switch_global(LssState.CONFIGURATION)
        elif not client.lss.switch_selective(address):
            raise NoAnswer(f"no device with the LSS address {address} answered")
        yield
    finally:
        client.lss.switch_global(LssState.WAITING)


@lss_command.command("find")
@endpoint_argument
@output_option
def find_command(endpoint: str, output: Output) -> int:
    """Find a device without a node-ID, by Fastscan.

    Only one is found at a time: give it a node-ID with `assign`, and find the next. Exit status 1 if there is none.

    \b
    barewire canopen lss find can://socketcan/can0
    00000360-00000001-00010002-0000004D
    """
    from barewire.canopen import LssState

    with _client(endpoint) as client:
        client.lss.switch_global(LssState.WAITING)
        try:
            address = client.lss.fastscan()
        finally:
            client.lss.switch_global(LssState.WAITING)
    if address is None:
        note("no device without a node-ID answered")
        return 1
    output.show(address, {"address": str(address), **address._asdict()})
    return 0


@lss_command.command("assign")
@endpoint_argument
@click.argument("nodes", nargs=-1, required=True, type=click.IntRange(1, 127), metavar="NODE...")
@_address_option
@click.option("--no-store", is_flag=True, help="The devices forget it when they are switched off.")
@output_option
def assign_command(
    endpoint: str, nodes: tuple[int, ...], address: LssAddress | None, no_store: bool, output: Output
) -> int:
    """Give node-IDs to the devices that have none, in the order in which they are found.

    With --address, give one to this device, which may have another one. Exit status 1 if a NODE is left over.

    \b
    barewire canopen lss assign can://socketcan/can0 5 6 7
    barewire canopen lss assign can://socketcan/can0 9 --address 360-1-10002-4D
    """
    with _client(endpoint) as client:
        if address is not None:
            if len(nodes) != 1:
                raise EncodeError(f"--address is one device: expected one NODE, not {len(nodes)}")
            with _in_configuration(client, address, only_device=False):
                client.lss.configure_node(nodes[0])
                if not no_store:
                    client.lss.store_configuration()
            text = f"node {nodes[0]}: {address}{'' if no_store else ', stored'}; it has it after reset-comm"
            output.show(text, {"node": nodes[0], "address": str(address), "stored": not no_store})
            return 0
        assigned = client.lss.assign_node_ids(nodes, store=not no_store)
    for device in assigned:
        booted = "booted" if device.booted else "no boot-up message came"
        stored = ", stored" if device.stored else ", not stored: it has it until it is switched off"
        fields = {"node": device.node, "address": str(device.address), "booted": device.booted, "stored": device.stored}
        output.show(f"node {device.node}: {device.address}, {booted}{stored}", fields)
    if len(assigned) < len(nodes):
        note(f"no further device without a node-ID: {len(nodes) - len(assigned)} of {len(nodes)} were not given")
        return 1
    return 0


@lss_command.command("bitrate")
@endpoint_argument
@click.argument("rate", type=int, metavar="BITS_PER_SECOND")
@_address_option
@_only_option
@output_option
def bitrate_command(endpoint: str, rate: int, address: LssAddress | None, only_device: bool, output: Output) -> None:
    """Set and store the bit rate of a device, which has it after it was switched off and on.

    \b
    barewire canopen lss bitrate can://socketcan/can0 500000 --address 360-1-10002-4D
    """
    from barewire.canopen.lss.messages import LSS_BIT_RATES

    entry = next((entry for entry, known in LSS_BIT_RATES.items() if known == rate), None)
    if entry is None:
        raise EncodeError(f"{rate} bit/s: expected one of {', '.join(map(str, LSS_BIT_RATES.values()))}")
    with _client(endpoint) as client, _in_configuration(client, address, only_device):
        client.lss.configure_bit_timing(entry)
        client.lss.store_configuration()
    output.show(f"{rate} bit/s, stored; from the next power-on", {"bitrate": rate, "stored": True})


@lss_command.command("store")
@endpoint_argument
@_address_option
@_only_option
@output_option
def store_command(endpoint: str, address: LssAddress | None, only_device: bool, output: Output) -> None:
    """Let a device store its node-ID and its bit rate."""
    with _client(endpoint) as client, _in_configuration(client, address, only_device):
        client.lss.store_configuration()
    output.show("stored", {"stored": True})


# Emergencies


@click.command("emcy")
@endpoint_argument
@click.option("--history", is_flag=True, help="Read the errors that the node has recorded (1003h), and end.")
@_seconds_option
@_count_option
@output_option
def emcy_command(endpoint: str, history: bool, seconds: float | None, count: int | None, output: Output) -> None:
    """Show the errors that nodes report, until Ctrl-C; with ?node= in ENDPOINT those of that node.

    Nothing is sent, except with --history, which needs the node.

    \b
    barewire canopen emcy can://socketcan/can0
    node 5: 8130h life guarding or heartbeat error; register 11h (generic, communication); 02 00 00 00 00
    """
    with _client(endpoint) as client:
        if history:
            _show_history(client, _node_of(client, endpoint), output)
            return
        streamed = client.emergencies() if client.node_id is None else client.node().emergencies()
        with streamed as stream:
            for event in _events(stream, seconds, count):
                output.show(_emcy_text(event), _emcy_fields(event))


def _show_history(client: CanopenClient, node: int, output: Output) -> None:
    from barewire.canopen.emcy import error_text, register_names

    upload = client.node(node).sdo.upload
    register = upload(0x1001, size=1)[0]
    bits = ", ".join(register_names(register)) or "no error"
    output.show(f"register {register:02X}h ({bits})", {"node": node, "register": register, "bits": bits})
    for sub in range(1, upload(0x1003, size=1)[0] + 1):
        word = int.from_bytes(upload(0x1003, sub, size=4)[:4], "little")
        code, info = word & 0xFFFF, word >> 16
        fields = {"node": node, "code": code, "text": error_text(code), "info": info}
        output.show(f"{sub}: {code:04X}h {error_text(code)}; {info:04X}h", fields)


def _emcy_text(event: EmcyEvent) -> str:
    message = event.message
    if message.code == 0:
        gone = ", ".join(f"{code:04X}h" for code in event.gone) or "nothing that was heard"
        active = ", ".join(f"{code:04X}h" for code in event.active)
        return f"node {message.node}: error gone: {gone}" + (f"; left: {active}" if active else "; no error left")
    from barewire.canopen.emcy import register_names

    bits = ", ".join(register_names(message.register))
    register = f"register {message.register:02X}h{bits and f' ({bits})'}"
    return f"node {message.node}: {message.code:04X}h {message.text}; {register}; {message.info.hex(' ').upper()}"


def _emcy_fields(event: EmcyEvent) -> dict[str, object]:
    message = event.message
    return {
        "node": message.node,
        "code": message.code,
        "text": message.text,
        "register": message.register,
        "info": message.info.hex(" ").upper(),
        "gone": list(event.gone),
        "active": list(event.active),
    }


# PDOs

_ABSENT = (0x0602_0000, 0x0609_0011)
"""Abort codes: the object, or the sub-index, does not exist. Another one does not say whether there is such a PDO."""
_ALWAYS_TRIED = 4
"""PDOs whose records a device may leave out without being the last: those of the predefined connection set."""


@click.command("pdo")
@endpoint_argument
@click.argument("device", required=False)
@click.option("--own", is_flag=True, help="With an EDS or DCF: read the mapping from the node, not from the file.")
@_seconds_option
@_count_option
@output_option
def pdo_command(
    endpoint: str, device: str | None, own: bool, seconds: float | None, count: int | None, output: Output
) -> None:
    """Show the PDOs of a node, those that it sends and those that are sent to it, with names, until Ctrl-C.

    DEVICE has the names: an EDS or DCF file, a name of `barewire devices`, or a description. With a file nothing is
    sent: the mapping is that of the file. Otherwise it is read from the node.

    \b
    barewire canopen pdo "can://socketcan/can0?node=5" drive.dcf
    barewire canopen pdo "can://socketcan/can0?node=5" az3 --count 10
    """
    names: Device | ObjectDictionary | None = None
    with _client(endpoint) as client:
        if device is not None and is_eds(device):
            number, names = _dictionary(client, endpoint, device)
        else:
            number = _node_of(client, endpoint)
            names = None if device is None else load_device(device)
        pdos = _pdos_of_file(number, names) if device and is_eds(device) and not own else None
        pdos = _pdos_of_node(client, number, names) if pdos is None else pdos
        if not pdos:
            raise EncodeError(f"node {number} has no PDO that is switched on")
        output.text(*(f"{_title(pdo.pdo)} {pdo.key[0]:03X}h: {_mapped(pdo)}{_when(pdo.pdo)}" for pdo in pdos))
        is_silent = True
        with client.pdos(*pdos) as stream:
            for event in _events(stream, seconds, count):
                is_silent = False
                output.show(_pdo_text(event), _pdo_fields(event))
    if is_silent:
        waiting = ", ".join(_title(pdo.pdo) for pdo in pdos if pdo.pdo.direction == "TPDO" and "SYNC" in _when(pdo.pdo))
        hint = f"; for a SYNC wait {waiting}: barewire canopen sync" if waiting else ""
        note(f"no PDO came; a node sends them when it is operational: barewire canopen nmt{hint}")


def _dictionary(client: CanopenClient, endpoint: str, file: str) -> tuple[int, ObjectDictionary]:
    from barewire.canopen.eds import parse

    document = parse(file_content(file))
    node = client.node_id or document.node_id
    if node is None:
        raise EncodeError(f"{file}: an EDS has no node-ID: give it with the endpoint, such as {endpoint}?node=5")
    return node, document.dictionary(node)


def _pdos_of_file(node: int, objects: Any) -> list[RemotePdo]:
    from barewire.canopen import pdos_of

    refused: list[str] = []
    pdos = pdos_of(objects, node, refused=refused)
    for why in refused:
        note(f"left out: {why}")
    return [remote for pdo in pdos for remote in _remote(pdo, node, objects)]


def _remote(pdo: PdoConfig, node: int, objects: Any) -> list[RemotePdo]:
    """Return the PDO in a list if it is on and has a mapping. Why it cannot be used, is printed."""
    from barewire.canopen import RemotePdo

    if pdo.multiplexed is not None or pdo.cob_entry(node).bit31:
        return []
    try:
        return [RemotePdo.of(node, pdo, objects)]
    except EncodeError as error:
        note(f"left out: {error}")
        return []


def _pdos_of_node(client: CanopenClient, number: int, names: Any) -> list[RemotePdo]:
    from barewire.io.canopen.objects import objects_of

    node, objects = client.node(number), objects_of(names)
    pdos: list[RemotePdo] = []
    unknown: Refused | None = None
    directions: Sequence[Any] = ("TPDO", "RPDO")
    for direction in directions:
        for place in range(1, 513):
            try:
                config = node.pdo.read_config(direction, place)
            except Refused as error:
                if error.code not in _ABSENT:
                    unknown = unknown or error
                if place > _ALWAYS_TRIED:
                    break
                continue
            pdos += _remote(config, number, objects)
    if not pdos and unknown is not None:
        raise unknown
    return pdos


def _title(pdo: PdoConfig) -> str:
    return f"{pdo.direction}{pdo.number}"


def _when(pdo: PdoConfig) -> str:
    """Return when a PDO is sent, or takes effect; empty if that is at any time.   [CiA 301, transmission types]

    >>> from barewire.canopen import PdoConfig
    >>> [_when(PdoConfig("TPDO", 1, (), type=kind)) for kind in (0, 1, 5, 255)]
    ['; at a SYNC, if it has changed', '; at every SYNC', '; once in 5 SYNC', '']
    """
    if pdo.type > 240:
        return {252: "; on request, with the values of the last SYNC", 253: "; on request"}.get(pdo.type, "")
    if pdo.direction == "RPDO":
        return "; takes effect at the next SYNC"
    if pdo.type == 0:
        return "; at a SYNC, if it has changed"
    return "; at every SYNC" if pdo.type == 1 else f"; once in {pdo.type} SYNC"


def _mapped(pdo: RemotePdo) -> str:
    return ", ".join(entry.name for entry in pdo.mapping.entries) or "nothing"


def _pdo_text(event: PdoReceived) -> str:
    from barewire.devices.parameter import show

    title = _title(event.source.pdo)
    if event.values is None:
        return f"{title}: {event.data.hex(' ').upper()}: {event.why}"
    types = {entry.name: entry.type or "" for entry in event.source.mapping.entries}
    return f"{title}: " + "; ".join(f"{name} = {show(value, types[name])}" for name, value in event.values.items())


def _pdo_fields(event: PdoReceived) -> dict[str, object]:
    fields = {"node": event.node, "pdo": _title(event.source.pdo), "data": event.data.hex(" ").upper()}
    return fields | ({"error": event.why} if event.values is None else {"values": event.values})
