"""`barewire replay`: play a recording of a CAN bus against a device or our SDO client, and list the differences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import click

from barewire.devices.device import Device
from barewire.errors import BarewireError, DecodeError, EncodeError
from barewire_workbench.cli.arguments import Choice, duration, is_eds
from barewire_workbench.cli.output import Output, file_content, note, note_refused_pdos, output_option
from barewire_workbench.frames.result import counted
from barewire_workbench.monitor.recording import is_timed, read_recording
from barewire_workbench.recordings.model import Recorded, RecordedItem, Unread
from barewire_workbench.replay.client_replay import ClientReplay
from barewire_workbench.replay.peer_replay import COUNTERPART_WINDOW, STEPS_MAX, PeerReplay, PlayedDevice
from barewire_workbench.replay.played import PLAYED_KINDS, Played, nodes_of, values_of


@click.command("replay")
@click.argument("file", type=click.Path())
@click.option(
    "--against",
    required=True,
    metavar="EDS|NAME|client",
    help="The device: an EDS or DCF file, or a simulated one; or our SDO client.",
)
@click.option(
    "--node",
    type=click.IntRange(1, 127),
    metavar="N",
    help="Its node-ID; by default the only node that answers in the recording.",
)
@click.option("--bus", help="Only this bus of a recording that has several.")
@click.option(
    "--only",
    type=Choice(PLAYED_KINDS),
    multiple=True,
    metavar="KIND",
    help=f"Only frames of this kind: {', '.join(PLAYED_KINDS)}.",
)
@click.option("--values", is_flag=True, help="Give a device of an EDS the recorded values when they are read.")
@click.option(
    "--window",
    type=duration,
    default=COUNTERPART_WINDOW,
    show_default=True,
    metavar="S",
    help="The longest time between a recorded frame and that of the device, in seconds; of a client its time-out.",
)
@click.option("--all", "everything", is_flag=True, help="Also frames that are the same, and repeated differences.")
@output_option
def replay_command(
    file: str,
    against: str,
    node: int | None,
    bus: str | None,
    only: tuple[str, ...],
    values: bool,
    window: float,
    everything: bool,
    output: Output,
) -> int:
    """Play a recording of a CAN bus against a device or an SDO client.

    The FILE is a recording as `barewire sniff` takes it (candump, ASC, BLF, pcapng, pcap), or the log of the CANopen
    conformance test tool of CiA. The frames that others sent are given to the device at the times of the recording, but
    in virtual time: an hour takes seconds, and no bus is needed. What the device sends is compared with what the
    recorded one sent:

    \b
    different   it sends another frame with the same identifier
    missing     it does not send a frame of the recording
    extra       it sends a frame that the recording does not have

    With `--against client` the other side is played: our SDO client makes the transfers of the recorded client, gets
    the recorded responses, and its requests are compared with the recorded ones.

    Exit status 1 if there is a difference. The first difference of an SDO transfer is printed and the rest of it
    counted, and so is the same difference again.

    \b
    barewire replay drive.log --against drive.eds --node 5
    barewire replay drive.log --against az3 --only sdo
    barewire replay drive.log --against client --node 5
    """
    is_client = against == "client"
    if is_client and (values or any(kind != "sdo" for kind in only)):
        raise EncodeError("--against client compares SDO requests: --values and other kinds than sdo are for a device")
    device = None if is_client or is_eds(against) else _described(against)
    if values and device is not None:
        raise EncodeError(f"--values is for an EDS: the simulated {device.name} computes its own")
    data = file_content(file)
    items, timed = _items(file, data, bus), is_timed(data)
    number = _node(file, items, node)
    comparisons: Iterable[Played]
    if is_client:
        client = ClientReplay(number, timeout=window, timed=timed)
        comparisons = client.play(items)
    else:
        played = _of_eds(against, number) if device is None else _simulated(device, number)
        peer = PeerReplay(played, number, window=window, timed=timed)
        comparisons = peer.play(items, values_of(items, number) if values else {})
    outcomes = _printed(comparisons, only, output, everything=everything, timed=timed)
    counts = {outcome: outcomes.count(outcome) for outcome in ("same", "different", "missing", "extra")}
    if is_client:
        totals = {"transfers": client.transfers, "left_out": client.left_out, "received": client.received}
        text = _client_summary(client, number, counts)
    else:
        totals = {"received": peer.received, "cut_short": peer.cut_short}
        text = _summary(peer, number, counts)
    output.show(text, {"event": "summary", "node": number, **totals, **counts})
    return int(counts["same"] < len(outcomes) or not outcomes)


def _totals(counts: dict[str, int], what: str) -> str:
    recorded = counts["same"] + counts["different"] + counts["missing"]
    text = f"{counted(recorded, f'recorded {what}')}: {counts['same']} same, {counts['different']} different"
    return f"{text}, {counts['missing']} missing; {counts['extra']} extra"


def _printed(
    comparisons: Iterable[Played], only: tuple[str, ...], output: Output, *, everything: bool, timed: bool
) -> list[str]:
    """Print the differences, and return the outcome of each comparison."""
    outcomes: list[str] = []
    for played in comparisons:
        if only and played.kind not in only:
            continue
        outcomes.append(played.outcome)
        if everything or not (played.repeated or played.outcome == "same"):
            output.show(_line(played, timed=timed), _fields(played))
    return outcomes


def _items(file: str, data: bytes, bus: str | None) -> list[RecordedItem]:
    """Return the items of one bus. Raises BarewireError for a file that is no recording, or has several buses."""
    try:
        items = list(read_recording(data))
    except DecodeError as error:
        raise BarewireError(f"{file}: {error.text}") from None
    buses = {item.bus: None for item in items if isinstance(item, Recorded)}
    if not buses:
        raise BarewireError(f"{file}: the recording has no frames")
    if bus is None and len(buses) > 1:
        raise EncodeError(f"{file}: there are frames on {', '.join(buses)}: select one with --bus")
    if bus is not None and bus not in buses:
        raise BarewireError(f"--bus {bus}: no frames on it; there are frames on {', '.join(buses)}")
    for item in items:
        if isinstance(item, Unread):
            note(f"{file}: line {item.line} is skipped: {item.why}: {item.text}")
    return [item for item in items if not isinstance(item, Unread) and bus in (None, item.bus)]


def _node(file: str, items: Sequence[RecordedItem], node: int | None) -> int:
    """Return the node to compare with. Raises EncodeError if the recording does not tell it."""
    answering = nodes_of(items)
    if node is not None:
        if answering and node not in answering:
            listed = ", ".join(map(str, answering))
            note(f"{file}: node {node} does not answer in the recording; node {listed} does")
        return node
    if len(answering) != 1:
        listed = f"nodes {', '.join(map(str, answering))} answer" if answering else "no node answers"
        raise EncodeError(f"{file}: {listed} in the recording: give the node-ID of the device with --node")
    return answering[0]


def _described(name: str) -> Device:
    """Return a device of the catalogue, or one of your own. Raises EncodeError if it has no CANopen."""
    from barewire.devices import load

    if Path(name).is_file():
        raise EncodeError(f"--against {name}: expected a file that ends in .eds or .dcf, or the name of a device")
    device = load(name)
    if device.canopen is None:
        raise EncodeError(f"--against {name}: {device.name} has no CANopen")
    return device


def _simulated(device: Device, node: int) -> PlayedDevice:
    from barewire.devices.sim import simulator

    machine = simulator(device, 0.0, node=node).canopen
    assert machine is not None
    return machine


def _of_eds(name: str, node: int) -> PlayedDevice:
    """Return a node with the objects of an EDS. Why PDOs of it are switched off, is printed on stderr."""
    from barewire.canopen import LocalNode, pdos_of
    from barewire.canopen.eds import parse

    refused: list[str] = []
    objects = parse(file_content(name)).dictionary(node)
    if not list(objects):
        raise BarewireError(f"{name}: there are no objects in it: expected an EDS or DCF file")
    device = LocalNode(node, objects, pdos_of(objects, node, refused=refused))
    note_refused_pdos(name, refused)
    return device


def _line(played: Played, *, timed: bool) -> str:
    """Return a comparison as a line: the time or the line of the file, the outcome, the frames with their meaning."""
    place = f"{played.at:.6f}" if timed or not played.line else f"line {played.line}"
    outcome = played.outcome if played.outcome == "same" else played.outcome.upper()
    return f"{place}  {outcome:<9}  {played.text}"


def _fields(played: Played) -> dict[str, object]:
    """Return a comparison for JSON. Frames are in the notation of candump."""
    frames = {"recorded": played.recorded, "sent": played.sent, "request": played.request}
    return {
        **{"event": played.outcome, "at": played.at, "kind": played.kind},
        **{name: None if frame is None else str(frame) for name, frame in frames.items()},
        **{"text": played.text, "line": played.line, "repeated": played.repeated},
    }


def _client_summary(replay: ClientReplay, node: int, counts: dict[str, int]) -> str:
    left_out = f", {replay.left_out} left out" if replay.left_out else ""
    transfers = f"{counted(replay.transfers, 'transfer')} with node {node}{left_out}"
    return f"{transfers}; {_totals(counts, 'request')}; the client received {counted(replay.received, 'frame')}"


def _summary(replay: PeerReplay, node: int, counts: dict[str, int]) -> str:
    text = _totals(counts, "frame").replace(":", f" of node {node}:", 1)
    text += f"; the device received {counted(replay.received, 'frame')}"
    if replay.not_received:
        text += f", {replay.not_received} not, while the recorded one was off or booting"
    if replay.restarts:
        text += f"; it was switched off and on {counted(replay.restarts, 'time')}"
    if replay.cut_short:
        pauses = counted(replay.cut_short, "pause")
        text += f"; {pauses} of the recording cut short: the device was due more than {STEPS_MAX} times in each"
    return text
