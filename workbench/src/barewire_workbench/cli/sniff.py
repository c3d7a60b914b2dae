"""`barewire sniff`: decode the traffic of a serial line or a CAN bus, or a recording of one."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import click

from barewire.devices import load
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.cli.arguments import (
    Choice,
    format_option,
    json_option,
    known_nodes,
    known_units,
    nodes_option,
    units_option,
)
from barewire_workbench.cli.output import Output, check_not_overwritten, needs_extra, note, output_form, print_json
from barewire_workbench.cli.sources import (
    Source,
    UnreadPrinter,
    can_events,
    check_ending,
    ports_option,
    protocol_option,
    recording_file,
    seconds_option,
    window_option,
)
from barewire_workbench.diagnosis.can_log import CanLogDiagnosis
from barewire_workbench.frames.known_node import KnownNode
from barewire_workbench.frames.modbus_exchanges import Exchanges, UnitNames, exchange_as_dict
from barewire_workbench.live.listen import listen
from barewire_workbench.monitor import event_as_dict, event_kind, event_line, is_repeated
from barewire_workbench.monitor.events import EVENT_KINDS, MonitorEvent
from barewire_workbench.monitor.recording import BusMonitors
from barewire_workbench.pictures.picture import Picture, rendered
from barewire_workbench.pictures.recordings import RecordingOptions, recording_picture
from barewire_workbench.recordings.modbus_replay import SerialProtocol, replay_parts
from barewire_workbench.recordings.modbus_writer import ModbusRecordingWriter
from barewire_workbench.sniffer import WINDOW


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
@click.option(
    "--only",
    type=Choice([*dict.fromkeys(EVENT_KINDS.values())]),
    multiple=True,
    metavar="KIND",
    help="CAN: only events such as sdo, pdo, violation, gap.",
)
@click.option("--complete", is_flag=True, help="CAN: no frame is missing in the recording: a gap is a violation.")
@click.option("--all", "everything", is_flag=True, help="CAN: also every heartbeat, SYNC and unchanged PDO.")
@format_option
@click.option("--picture", type=Choice(["sequence", "states"]), help="Of a FILE: its messages, or a drive's states.")
@click.option("--live", is_flag=True, help="A screen in the terminal: a list, the chosen exchange explained, filters.")
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
    live: bool,
) -> int:
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
    barewire sniff "rtu:///dev/ttyUSB0?baudrate=9600" --live

    --live needs textual: pip install barewire[terminal]. Its keys are shown; ? explains them.
    """
    stop = threading.Event()
    if live:
        if as_json or form is not None or picture is not None:
            raise EncodeError("--live is a screen: expected no --json, --format or --picture beside it")
        _prepare_screen(source, stop)
    form = output_form(form, as_json=as_json)
    is_drawn = picture is not None or form in ("html", "svg")
    if is_drawn and ("://" in source or write is not None):
        drawn = f"--picture {picture}" if picture is not None else f"--format {form}"
        raise EncodeError(f"{drawn} draws a recording: {'--write is for frames' if write else f'{source} is none'}")
    if write is not None:
        check_not_overwritten("--write", write, source, *devices)
    # A picture shows the whole recording: all of it may be read to know its kind.
    traffic = Source(source, seconds, ports, protocol, whole=is_drawn, stop=stop)
    traffic.check_options(
        for_modbus={"--window": window, "--port": ports, "--protocol": protocol, "--unit": units},
        for_can={"--node": nodes, "--bus": bus, "--only": only, "--complete": complete, "--all": everything},
    )
    if write is not None:
        check_ending(write, traffic.is_can)
    known = known_nodes(devices, nodes) if traffic.is_can else []
    names = None if traffic.is_can else known_units(devices, units)
    window = WINDOW if window is None else window
    if is_drawn:
        device = load(devices[0]) if devices and not traffic.is_can else None
        number = next(iter(nodes if traffic.is_can else units), None)
        options = RecordingOptions(bus, window, traffic.ports, protocol)
        drawing = _drawing(traffic, picture, options, known=known, device=device, number=number, names=names)
        print(rendered(form, drawing), end="")
        return 0
    output, status = Output(form), 0
    if traffic.is_can:
        for name, node in list(zip(devices, known))[len(nodes) :]:
            note(f"--device {name}: names are those of node {node.node}; --node gives another")

        def is_shown(event: MonitorEvent) -> bool:
            return (not only or event_kind(event) in only) and (everything or not is_repeated(event))

        if live:
            status = _live_can(traffic, known, bus, write, is_shown, complete=complete)
        else:
            _sniff_can(traffic, BusMonitors(known, bus, complete=complete), bus, write, output, is_shown)
    elif live:
        status = _live_modbus(traffic, seconds, window, write, names)
    else:
        _sniff_modbus(traffic, seconds, window, write, names, output)
    traffic.note_cut_lines()
    return status


def _drawing(traffic: Source, picture: str | None, options: RecordingOptions, **shown: Any) -> Picture:
    """Return the picture of a recording; `shown` are the nodes, device and names of `recording_picture`."""
    title = "standard input" if traffic.name == "-" else Path(traffic.name).name
    try:
        return recording_picture(title, traffic.recording.whole(), picture, options, **shown)
    except DecodeError as error:
        raise traffic.not_a_recording(error) from None


# Modbus


def _sniff_modbus(
    traffic: Source,
    seconds: float | None,
    window: float,
    write: str | None,
    names: UnitNames | None,
    output: Output,
) -> None:
    unread = UnreadPrinter("no bytes of a frame", output)
    timed = True
    if traffic.endpoint is None:
        first, others = traffic.modbus_parts(unread)
        timed, events = first.timed, replay_parts(first, others, window, traffic.protocol)
    else:
        events = listen(traffic.endpoint, traffic.stop, seconds=seconds, window=window)
    exchanges = Exchanges(timed=timed, names=names)
    with recording_file(write) as file, suppress(KeyboardInterrupt):  # Ctrl-C ends the reception
        writer = ModbusRecordingWriter()
        if file is not None:
            file.write(writer.start, frame=False)
        for event in events:
            if file is not None and (packet := writer.put(event)):
                file.write(packet)
            if output.as_json:
                print_json(exchange_as_dict(event, timed=timed, names=names))
            else:
                output.text(*exchanges.feed(event))
    output.text(*exchanges.end())
    unread.end()


# CAN


def _sniff_can(
    traffic: Source,
    monitors: BusMonitors,
    bus: str | None,
    write: str | None,
    output: Output,
    is_shown: Callable[[MonitorEvent], bool],
) -> None:
    """Print the events that are to be shown."""
    buses: set[str] = set()
    with recording_file(write) as file:
        for bus_name, event in can_events(traffic.can_items(), monitors, bus, file):
            buses.add(bus_name)
            if not is_shown(event):
                continue
            place = f"{bus_name}  " if len(buses - {""}) > 1 else ""
            output.show(f"{place}{event_line(event)}", partial(_event_fields, event, bus_name))


def _event_fields(event: MonitorEvent, bus: str) -> dict[str, object]:
    return event_as_dict(event) | ({"bus": bus} if bus else {})


# On a screen


def _prepare_screen(source: str, stop: threading.Event) -> None:
    """Raise PortError without Textual, EncodeError without a terminal. If standard input is read, the keys are those of
    the terminal, and the input ends with `stop`."""
    with needs_extra("--live", "terminal", "textual"):
        from barewire_workbench.cli.terminal.screen import check_terminal, keys_beside_pipe
    if source == "-":
        keys_beside_pipe("--live", stop)
    else:
        check_terminal("--live")


def _live_modbus(
    traffic: Source, seconds: float | None, window: float, write: str | None, names: UnitNames | None
) -> int:
    from barewire_workbench.cli.terminal.heard import HeardRows, hear_modbus
    from barewire_workbench.cli.terminal.sniffing import watch_traffic

    with recording_file(write) as file:
        read = partial(hear_modbus, traffic=traffic, seconds=seconds, window=window, names=names, file=file)
        return watch_traffic(HeardRows(live=traffic.endpoint is not None), traffic, read)


def _live_can(
    traffic: Source,
    known: Iterable[KnownNode],
    bus: str | None,
    write: str | None,
    is_shown: Callable[[MonitorEvent], bool],
    *,
    complete: bool,
) -> int:
    from barewire_workbench.cli.terminal.heard import HeardRows, KeepingMonitors, hear_can
    from barewire_workbench.cli.terminal.sniffing import watch_traffic

    monitors = KeepingMonitors(known, bus, complete=complete)
    diagnosis = CanLogDiagnosis(known, bus, complete=complete)
    with recording_file(write) as file:
        read = partial(hear_can, traffic=traffic, monitors=monitors, diagnosis=diagnosis, is_shown=is_shown, file=file)
        return watch_traffic(HeardRows(live=traffic.endpoint is not None), traffic, read)
