"""`barewire sniff`: decode the traffic of a serial line or a CAN bus, or a recording of one."""

from __future__ import annotations

import signal
import sys
import threading
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO, cast

import click

from barewire.devices import load
from barewire.errors import BarewireError, DecodeError, EncodeError, PortError
from barewire.io.canopen.bus.capture import listen_can
from barewire.io.endpoint import Endpoint
from barewire.io.modbus.sniff import listen
from barewire.modbus.sniffer import (
    WINDOW,
    AmbiguousFrame,
    NoiseSeen,
    RecordingEnds,
    RequestSeen,
    ResponseMissing,
    SnifferEvent,
)
from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame
from barewire_workbench.cli.arguments import (
    Choice,
    Seconds,
    check_not_overwritten,
    format_option,
    json_option,
    known_nodes,
    known_units,
    nodes_option,
    opened_file,
    output_form,
    ports_option,
    print_json,
    protocol_option,
    units_option,
)
from barewire_workbench.cli.recordings.recording_file import RecordingFile, check_ending
from barewire_workbench.frames.modbus_exchanges import ExchangeLines, UnitNames, exchange_as_dict
from barewire_workbench.monitor import event_as_dict, event_kind, event_line, is_repeated
from barewire_workbench.monitor.events import EVENT_KINDS, MonitorEvent
from barewire_workbench.monitor.recording import (
    BUSES_MAX,
    BusMonitors,
    CanRecordingWriter,
    is_can_recording,
    read_recording,
)
from barewire_workbench.pictures.picture import rendered
from barewire_workbench.pictures.recordings import RecordingOptions, recording_picture
from barewire_workbench.recordings.capture import MODBUS_PORTS, PacketBuilder, file_header, is_capture, packet_block
from barewire_workbench.recordings.modbus_log import (
    UNREADABLE,
    LoggedBytes,
    ModbusLog,
    read_modbus_log,
    read_modbus_parts,
)
from barewire_workbench.recordings.modbus_log.reader import is_can_capture
from barewire_workbench.recordings.modbus_replay import Replayed, SerialProtocol, replay_log, replay_parts
from barewire_workbench.recordings.model import Recorded, RecordedItem, Unread
from barewire_workbench.recordings.source import RecordingSource

_FORMATS = "a recording: pcapng, pcap, candump, ASC, BLF, a log of a Modbus program, or lines of bytes in hexadecimal"
_LIVE_BUS = "can0"
_DECISIVE = 0x1_0000
"""Bytes that show whether a recording is of CAN."""

seconds_option = click.option(
    "--seconds", type=Seconds(), metavar="S", help="Stop after this time; without it, at Ctrl-C."
)
window_option = click.option(
    "--window",
    type=Seconds(),
    metavar="S",
    help=f"Modbus: longest time from a request to its response, in seconds; by default {WINDOW:g}.",
)


@click.command("sniff")
@click.argument("source", metavar="ENDPOINT|FILE|-")
@json_option
@click.option(
    "--write", type=click.Path(dir_okay=False), metavar="FILE", help="Write every frame to a .pcapng (CAN: or .log)."
)
@seconds_option
@window_option
@protocol_option
@ports_option
@click.option(
    "--device",
    "devices",
    multiple=True,
    metavar="NAME|EDS",
    help="The device of a node or unit, for names, units and scaled values.",
)
@nodes_option
@units_option
@click.option("--bus", help="CAN: only this bus of a recording that has several.")
@click.option("--only", multiple=True, metavar="KIND", help="CAN: only events such as sdo, pdo, violation, gap.")
@click.option("--complete", is_flag=True, help="CAN: no frame is missing in the recording: a gap is a violation.")
@click.option("--all", "everything", is_flag=True, help="CAN: also every heartbeat, SYNC and unchanged PDO.")
@format_option
@click.option("--picture", type=Choice(["sequence", "states"]), help="Of a FILE: its messages, or a drive's states.")
def sniff_command(
    source: str,
    as_json: bool,
    write: str | None,
    seconds: float | None,
    window: float | None,
    protocol: SerialProtocol | None,
    ports: tuple[int, ...],
    devices: tuple[str, ...],
    nodes: tuple[int, ...],
    units: tuple[int, ...],
    bus: str | None,
    only: tuple[str, ...],
    complete: bool,
    everything: bool,
    form: str | None,
    picture: str | None,
) -> None:
    """Decode the traffic of a line or bus; send nothing.

    Requests without a response and other things that are missing are reported. A FILE (- is standard input) is a
    pcapng or pcap capture, an export of Wireshark, the log of a program (pymodbus, libmodbus, mbpoll -v, Modbus Poll
    and others), lines such as "12.345678 01 03 00 00 ...", or a hex dump; of a CAN bus the output or log of candump,
    an ASC or BLF file of Vector, a capture, or the log of CiA's conformance test tool.

    The command ends with status 1 when the line or bus fails, also when a socketcand server ends: it does not connect
    again, as clients do. The file of --write keeps all frames before.

    \b
    barewire sniff "rtu:///dev/ttyUSB0?baudrate=9600" --write bus.pcapng
    wireshark -o mbrtu.udp.port:5020 bus.pcapng
    barewire sniff bus.pcapng --json
    barewire sniff poll.log --device adxl --unit 1
    barewire sniff can://socketcan/can0 --device az3 --node 5 --write can.log
    barewire sniff bus.pcapng --format svg > exchange.svg
    """
    form = output_form(form, as_json=as_json)
    as_json, is_drawn = form == "json", picture is not None or form in ("html", "svg")
    if is_drawn and ("://" in source or write is not None):
        drawn = f"--picture {picture}" if picture is not None else f"--format {form}"
        raise EncodeError(f"{drawn} draws a recording: {'--write is for frames' if write else f'{source} is none'}")
    endpoint = Endpoint.parse(source) if "://" in source else None
    for kind in only:
        if kind not in EVENT_KINDS.values():
            from barewire.devices.device import suggest  # only errors need it

            hint = suggest(kind, EVENT_KINDS.values())
            raise EncodeError(f"--only {kind}: expected one of {', '.join(EVENT_KINDS.values())}{hint}")
    if write is not None:
        check_not_overwritten("--write", write, source, *devices)
    recording = None if endpoint is not None else opened_recording(source, seconds)
    if is_drawn and recording is not None:
        recording.whole()
    is_can = is_can_source(recording, ports) if recording is not None else Endpoint.parse(source).scheme == "can"
    for_modbus: dict[str, object] = {"--window": window, "--port": ports, "--protocol": protocol, "--unit": units}
    for_can: dict[str, object] = {"--node": nodes, "--bus": bus, "--only": only}
    for_can |= {"--complete": complete, "--all": everything}
    refuse_for_other(source, for_modbus if is_can else for_can, "Modbus" if is_can else "a CAN bus")
    if endpoint is not None:
        refuse_for_line(source, ports, protocol)
    if write is not None:
        check_ending(write, is_can)
    if is_drawn and recording is not None:
        known, number = known_nodes(devices, nodes) if is_can else [], next(iter(nodes if is_can else units), None)
        device = load(devices[0]) if devices and not is_can else None
        names = None if is_can else known_units(devices, units)
        options = RecordingOptions(bus, window or WINDOW, MODBUS_PORTS | set(ports), protocol)
        try:
            name = "standard input" if source == "-" else Path(source).name
            drawing = recording_picture(
                name, recording.whole(), picture, options, known=known, device=device, number=number, names=names
            )
        except DecodeError as error:
            raise BarewireError(f"{source}: {error.text}; expected {_FORMATS}") from None
        print(rendered(form, drawing), end="")
        return
    with ExitStack() as stack:
        if is_can:
            known = known_nodes(devices, nodes)
            for name, found in list(zip(devices, known))[len(nodes) :]:
                click.echo(
                    f"barewire: --device {name}: names are those of node {found.node}; --node gives another", err=True
                )
            items = read_recording(recording) if recording is not None else live_frames(Endpoint.parse(source), seconds)
            file = None if write is None else stack.enter_context(RecordingFile(write))
            monitors = BusMonitors(known, bus, complete=complete)
            events = _can_events(items, monitors, bus, file, write or "")
            _print_can_events(events, as_json=as_json, everything=everything, only=only)
            if recording is not None:
                note_cut_lines(recording)
            return
        names = known_units(devices, units)
        window = WINDOW if window is None else window
        timed = True
        if recording is not None:
            unread = UnreadPrinter("no bytes of a frame", as_json=as_json)
            first, others = modbus_parts(source, recording, ports, protocol, unread)
            timed, exchanges = first.timed, replay_parts(first, others, window, protocol)
        else:
            exchanges = listen(Endpoint.parse(source), threading.Event(), seconds=seconds, window=window)
        file = None if write is None else stack.enter_context(RecordingFile(write))
        _print_exchanges(exchanges, file, as_json, timed=timed, names=names)
        if recording is not None:
            unread.end()
            note_cut_lines(recording)


def refuse_for_other(source: str, options: Mapping[str, object], kind: str) -> None:
    """Raise EncodeError for the first option that is given, because it is for the other kind of line or bus."""
    for option, given in options.items():
        if given:
            raise EncodeError(f"{option} is for {kind}, which {source} is not")


def refuse_for_line(source: str, ports: tuple[int, ...], protocol: SerialProtocol | None) -> None:
    """Raise EncodeError for the options that only a recording has: a line has no ports, and its URL the protocol."""
    for option, given in (("--port", ports), ("--protocol", protocol)):
        if given:
            raise EncodeError(f"{option} is for a recording, which {source} is not")


def opened_recording(source: str, seconds: float | None) -> RecordingSource:
    """Return a recording, for `-` of standard input. Raise BarewireError if it is empty, EncodeError for --seconds."""
    if seconds is not None:
        raise EncodeError("--seconds is for a line; a recording ends by itself")
    if source == "-":
        if sys.stdin is None:  # `<&-`
            raise PortError("-: standard input is closed")
        stream: BinaryIO = sys.stdin.buffer
    else:
        stream = opened_file(source)
        click.get_current_context().call_on_close(stream.close)

    def read(size: int) -> bytes:
        try:
            return cast(BufferedReader, stream).read1(size)
        except KeyboardInterrupt:
            if Path(source).is_file():
                raise
            return b""  # Ctrl-C ends what is still being written
        except OSError as error:
            raise PortError(f"{source}: {error.strerror or error}") from None

    recording = RecordingSource(read)
    if not recording.start:
        raise BarewireError(f"{source}: the {'input' if source == '-' else 'file'} is empty; expected {_FORMATS}")
    return recording


def recording_content(source: str, seconds: float | None) -> bytes:
    """Return the bytes of a whole recording. As `opened_recording`."""
    return opened_recording(source, seconds).whole()


def is_can_source(recording: RecordingSource, ports: Iterable[int] = ()) -> bool:
    """Return whether this is a recording of CAN. Of a pipe, no more is read than is needed to decide that."""
    if is_capture(recording.start):
        return is_can_capture(recording, MODBUS_PORTS.union(ports))
    while not is_can_recording(recording.start):
        if len(recording.start) > _DECISIVE or _has_modbus(recording.start) or not recording.more():
            return False
    return True


def _has_modbus(start: bytes) -> bool:
    try:
        log = read_modbus_log(start[: start.rfind(b"\n") + 1])
    except DecodeError:
        return False
    return any(isinstance(item, LoggedBytes) for item in log.items)


def note_cut_lines(recording: RecordingSource) -> None:
    """Print which lines were too long."""
    if cut := recording.cut:
        lines = f"line {cut[0]}" if len(cut) == 1 else f"{len(cut)} lines, the first of them line {cut[0]},"
        click.echo(f"barewire: the end of {lines} was left out: too many characters", err=True)


# Modbus


def replayed(
    source: str, data: bytes, window: float, ports: tuple[int, ...], protocol: SerialProtocol | None
) -> Replayed:
    """Return the log and the events of a recording of Modbus. Raise BarewireError if it is none."""
    try:
        return replay_log(data, window=window, ports=MODBUS_PORTS | set(ports), protocol=protocol)
    except DecodeError as error:
        raise BarewireError(f"{source}: {error.text}; expected {_FORMATS}") from None


class UnreadPrinter:
    """Prints the lines that hold no frame, as objects or in short on stderr, and the notes about a log."""

    def __init__(self, nothing: str, *, as_json: bool) -> None:
        self._nothing, self._as_json = nothing, as_json
        self._first: dict[bool, Unread] = {}  # by whether they look as if they held bytes
        self._numbers: Counter[bool] = Counter()

    def items(self, items: Iterable[LoggedBytes | RecordedItem]) -> None:
        """Print or count those of the items that are unread."""
        for item in items:
            if not isinstance(item, Unread):
                continue
            if self._as_json:
                print_json({"event": "unread", "line": item.line, "text": item.text, "why": item.why})
            if not item.line:  # several packets at once
                if not self._as_json:
                    click.echo(f"barewire: {item.why}", err=True)
                continue
            self._first.setdefault(item.why == UNREADABLE, item)
            self._numbers[item.why == UNREADABLE] += 1

    def parts(self, parts: Iterable[ModbusLog]) -> Iterator[ModbusLog]:
        """Yield the parts of a log, with their notes and unread lines printed."""
        for log in parts:
            for note in log.notes:
                click.echo(f"barewire: {note}", err=True)
            self.items(log.items)
            yield log

    def end(self) -> None:
        """Print how many lines are unread, unless each was printed."""
        for has_bytes, first in sorted(self._first.items()) if not self._as_json else ():
            number = self._numbers[has_bytes]
            lines = "1 line holds" if number == 1 else f"{number} lines hold"
            text = first.text or first.why
            what = "bytes that cannot be read" if has_bytes else self._nothing
            click.echo(f"barewire: {lines} {what}, the first is line {first.line}: {text}", err=True)


def modbus_parts(
    source: str,
    recording: RecordingSource,
    ports: tuple[int, ...],
    protocol: SerialProtocol | None,
    unread: UnreadPrinter,
) -> tuple[ModbusLog, Iterator[ModbusLog]]:
    """Return the first part of a recording of Modbus, and the others as they come. Raise BarewireError for another."""
    if protocol is not None and is_capture(recording.start):
        raise EncodeError(f"--protocol is for a log or dump: in {source} each packet has its own")

    def read() -> Iterator[ModbusLog]:
        try:
            yield from read_modbus_parts(recording, ports=MODBUS_PORTS | set(ports), protocol=protocol)
        except DecodeError as error:
            raise BarewireError(f"{source}: {error.text}; expected {_FORMATS}") from None

    parts = unread.parts(read())
    return next(parts), parts


def _print_exchanges(
    events: Iterator[SnifferEvent],
    file: RecordingFile | None,
    as_json: bool,
    *,
    timed: bool = True,
    names: UnitNames | None = None,
) -> None:
    """Print each event, and write its frame to the file. Ctrl-C ends it."""
    packets, lines = PacketBuilder(), ExchangeLines(timed=timed, names=names)
    if file is not None:
        file.write(file_header(), frame=False)
    with suppress(KeyboardInterrupt):
        for event in events:
            packet = None if file is None else _packet(packets, event)
            if file is not None and packet is not None:
                file.write(packet_block(event.at, packet))
            if as_json:
                print_json(exchange_as_dict(event, timed=timed, names=names))
            else:
                _print_lines(lines.feed(event))
    if not as_json:
        _print_lines(lines.end())


def _print_lines(lines: list[str]) -> None:
    for line in lines:
        print(line, flush=True)


def _packet(packets: PacketBuilder, event: SnifferEvent) -> bytes | None:
    """Return the frame of an event as a packet; noise becomes a datagram, a missing response nothing."""
    if isinstance(event, ResponseMissing | RecordingEnds):
        return None
    if isinstance(event, NoiseSeen):
        return packets.rtu(event.noise.data, from_client=True)
    from_client = isinstance(event, RequestSeen | AmbiguousFrame)
    number = None if isinstance(event, AmbiguousFrame) else event.transaction
    if number is None:
        return packets.rtu(rtu_frame(event.unit, event.pdu), from_client=from_client)
    return packets.tcp(tcp_frame(event.unit, event.pdu, number), from_client=from_client)


# CAN


def live_frames(endpoint: Endpoint, seconds: float | None) -> Iterator[Recorded | float]:
    """Yield frames from a bus until Ctrl-C; a time alone when no frame was received."""
    stop = threading.Event()
    with stopped_by_interrupt(stop):
        for now, frame in listen_can(endpoint, stop, seconds=seconds):
            yield now if frame is None else Recorded(now, _LIVE_BUS, frame)


@contextmanager
def stopped_by_interrupt(stop: threading.Event) -> Iterator[None]:
    """Let the first Ctrl-C end the reception, so that the summary is printed; the second one ends the program."""

    def end_reception(number: int, frame: object) -> None:
        stop.set()
        signal.signal(signal.SIGINT, before)

    before = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, end_reception)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _can_events(
    items: Iterable[RecordedItem | float],
    monitors: BusMonitors,
    bus: str | None,
    file: RecordingFile | None,
    name: str,
) -> Iterator[tuple[str, MonitorEvent]]:
    """Yield the events of the frames, each with its bus. The file gets each frame in the format that its `name`
    selects."""
    writer, buses = CanRecordingWriter(name), dict[str, None]()
    if file is not None:
        file.write(writer.start, frame=False)
    for item in items:
        if isinstance(item, float):
            # Nothing was received up to now: a message that is due is missing.
            for bus_name, monitor in monitors.monitors.items():
                for event in monitor.feed(None, item):
                    yield bus_name, event
            continue
        if file is not None and isinstance(item, Recorded) and bus in (None, item.bus):
            file.write(writer.put(item.at, item.bus, item.frame))
        if not isinstance(item, Unread) and len(buses) < BUSES_MAX:
            buses[item.bus] = None
        yield from monitors.feed(item)
    yield from monitors.end()
    if bus is not None and buses and bus not in buses:
        raise BarewireError(f"--bus {bus}: no frames on it; there are frames on {', '.join(buses)}")


def _print_can_events(
    events: Iterable[tuple[str, MonitorEvent]], *, as_json: bool, everything: bool, only: tuple[str, ...]
) -> None:
    """Print a line for each event that is not a repetition; with `everything` for all events."""
    buses: set[str] = set()
    for bus, event in events:
        buses.add(bus)
        if (only and event_kind(event) not in only) or (is_repeated(event) and not everything):
            continue
        if as_json:
            print_json(event_as_dict(event) | ({"bus": bus} if bus else {}))
        else:
            print(f"{bus}  {event_line(event)}" if len(buses - {""}) > 1 else event_line(event), flush=True)
