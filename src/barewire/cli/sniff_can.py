"""CAN for `barewire sniff` and `barewire explain`: sources of frames, and the output of events."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from barewire.canopen.eds import parse
from barewire.cli.arguments import print_json
from barewire.devices.description.load import load
from barewire.errors import EncodeError, PortError
from barewire.explain.can_monitor import (
    KnownNode,
    event_as_dict,
    event_kind,
    event_line,
    is_repeated,
    of_device,
    of_dictionary,
)
from barewire.explain.can_monitor.event_text import EVENT_KINDS
from barewire.explain.can_monitor.events import MonitorEvent
from barewire.explain.can_monitor.recording import BUSES_MAX, BusMonitors, CanRecordingWriter
from barewire.explain.capture.model import Recorded, RecordedItem, Unread
from barewire.io.endpoint import Endpoint

LIVE = "can0"


def known_nodes(devices: Iterable[str], nodes: Iterable[int]) -> list[KnownNode]:
    """`--device az3 --node 5`, as often as there are nodes: a name of the catalogue, a description, or an EDS file."""
    numbers = list(nodes)
    names = list(devices)
    if len(numbers) > len(names):
        raise EncodeError("--node belongs to the --device before it: give a --device for each")
    found = []
    for place, name in enumerate(names):
        number = numbers[place] if place < len(numbers) else None
        if number is not None and not 1 <= number <= 127:
            raise EncodeError(f"--node {number}: expected 1..127")
        found.append(_known(name, number))
    return found


def _known(name: str, node: int | None) -> KnownNode:
    if not name.lower().endswith((".eds", ".dcf")):
        return of_device(load(name), node)
    try:
        document = parse(Path(name).read_bytes())
    except OSError as error:
        raise PortError(f"{name}: {error.strerror or error}") from None
    if node is None:
        raise EncodeError(f"{name}: an EDS fits any node: give its number with --node")
    return of_dictionary(document.dictionary(node), node, name)


def live(endpoint: Endpoint, seconds: float | None) -> Iterator[Recorded | float]:
    """Frames from a bus until Ctrl-C; a time alone when no frame came."""
    from barewire.io.canopen.capture import listen_can

    stop = threading.Event()
    with ending_softly(stop):
        for at, frame in listen_can(endpoint, stop, seconds=seconds):
            yield at if frame is None else Recorded(at, LIVE, frame)


@contextmanager
def ending_softly(stop: threading.Event) -> Iterator[None]:
    """The first Ctrl-C ends the reception, so that the summary is printed; the second one ends the program."""

    def first(number: int, frame: object) -> None:
        stop.set()
        signal.signal(signal.SIGINT, before)

    before = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, first)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def events_of(
    items: Iterable[RecordedItem | float],
    known: Iterable[KnownNode],
    bus: str | None,
    keep: Callable[[bytes], object] | None,
    name: str,
) -> Iterator[tuple[str, MonitorEvent]]:
    """The events of the frames, each with its bus. `keep` gets each frame in the format that `name` selects."""
    monitors, writer, buses = BusMonitors(known, bus), CanRecordingWriter(name), dict[str, None]()
    if keep is not None:
        keep(writer.start)
    for item in items:
        if isinstance(item, float):
            # Reception was not interrupted: a message that did not come by now is missing.
            for one, monitor in monitors.monitors.items():
                for event in monitor.feed(None, item):
                    yield one, event
            continue
        if keep is not None and isinstance(item, Recorded) and bus in (None, item.bus):
            keep(writer.put(item.at, item.bus, item.frame))
        if not isinstance(item, Unread) and len(buses) < BUSES_MAX:
            buses[item.bus] = None
        yield from monitors.feed(item)
    yield from monitors.end()
    if bus is not None and buses and bus not in buses:
        raise EncodeError(f"--bus {bus}: no frames on it, but on {', '.join(buses)}")


def print_events(
    events: Iterable[tuple[str, MonitorEvent]], *, as_json: bool, everything: bool, only: tuple[str, ...]
) -> None:
    """Print a line for each event with news; with `everything` for all events."""
    for name in only:
        if name not in EVENT_KINDS.values():
            raise EncodeError(f"--only {name}: expected one of {', '.join(EVENT_KINDS.values())}")
    several: set[str] = set()
    for bus, event in events:
        several.add(bus)
        if (only and event_kind(event) not in only) or (is_repeated(event) and not everything):
            continue
        if as_json:
            print_json(event_as_dict(event) | ({"bus": bus} if bus else {}))
        else:
            print(f"{bus}  {event_line(event)}" if len(several - {""}) > 1 else event_line(event), flush=True)
