"""`barewire diagnose`: what is wrong in a recording, or on a live line or bus, and what follows for the whole of it."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterable

import click

from barewire.errors import BarewireError
from barewire.io.endpoint import Endpoint
from barewire.io.modbus.sniff import listen_with
from barewire.modbus.framing import Line
from barewire.modbus.sniffer import WINDOW
from barewire_workbench.cli.arguments import (
    Choice,
    json_option,
    known_nodes,
    nodes_option,
    output_form,
    ports_option,
    print_json,
    protocol_option,
)
from barewire_workbench.cli.sniff import (
    UnreadPrinter,
    is_can_source,
    live_frames,
    modbus_parts,
    note_cut_lines,
    opened_recording,
    refuse_for_line,
    refuse_for_other,
    seconds_option,
    stopped_by_interrupt,
    window_option,
)
from barewire_workbench.diagnosis.can_log import CanLogDiagnosis
from barewire_workbench.diagnosis.modbus_line import LiveDiagnosis, ModbusLogDiagnosis
from barewire_workbench.diagnosis.verdict import LineVerdict, LogFinding
from barewire_workbench.monitor.recording import read_recording
from barewire_workbench.recordings.modbus_replay import SerialProtocol
from barewire_workbench.recordings.model import RecordedItem
from barewire_workbench.recordings.source import RecordingSource

_SHOWN = 5
"""Findings with the same code and place that are printed; the others are counted."""


@click.command("diagnose")
@click.argument("source", metavar="ENDPOINT|FILE|-")
@json_option
@click.option("--format", "form", type=Choice(["text", "json"]), help="The form of the output; --json is json.")
@click.option("--all", "everything", is_flag=True, help=f"Print every finding, not only the first {_SHOWN} of a kind.")
@seconds_option
@window_option
@protocol_option
@ports_option
@click.option(
    "--device", "devices", multiple=True, metavar="NAME|EDS", help="CAN: the device of a node, for sizes and PDOs."
)
@nodes_option
@click.option("--bus", help="CAN: only this bus of a recording that has several.")
@click.option("--complete", is_flag=True, help="CAN: no frame is missing in the recording: a gap breaks a rule.")
def diagnose_command(
    source: str,
    as_json: bool,
    form: str | None,
    everything: bool,
    seconds: float | None,
    window: float | None,
    protocol: SerialProtocol | None,
    ports: tuple[int, ...],
    devices: tuple[str, ...],
    nodes: tuple[int, ...],
    bus: str | None,
    complete: bool,
) -> int:
    """Say what is wrong in a recording, or on a line or bus.

    First each finding, with its time, its line in the file, and its proof; then verdicts on the line or bus: missing
    bias resistors, an echo, a wrong parity or baud rate, two devices with one address, a turnaround that is too short,
    a dead unit; on CAN a wrong bit rate, two masters, a dead node. A verdict is given with the numbers that show it,
    and with what else it may be. What is not proved is not said.

    A FILE (- is standard input) is any recording that `barewire sniff` reads. A line or bus is listened to until
    Ctrl-C, or for --seconds; nothing is sent.

    The exit status is 0 if nothing is wrong, 1 if something is, was refused or is open, or if the command fails.

    \b
    barewire diagnose poll.log
    barewire diagnose bus.pcapng --json
    mbpoll -v -m rtu /dev/ttyUSB0 2>&1 | barewire diagnose -
    barewire diagnose "rtu:///dev/ttyUSB0?baudrate=9600" --seconds 60
    barewire diagnose can.log --device az3 --node 5
    barewire diagnose can://socketcan/can0
    """
    printer = _Printer(as_json=output_form(form, as_json=as_json) == "json", everything=everything)
    endpoint = Endpoint.parse(source) if "://" in source else None
    recording = None if endpoint is not None else opened_recording(source, seconds)
    is_can = is_can_source(recording, ports) if recording is not None else Endpoint.parse(source).scheme == "can"
    for_modbus: dict[str, object] = {"--window": window, "--port": ports, "--protocol": protocol}
    for_can: dict[str, object] = {"--device": devices, "--node": nodes, "--bus": bus, "--complete": complete}
    refuse_for_other(source, for_modbus if is_can else for_can, "Modbus" if is_can else "a CAN bus")
    if endpoint is not None:
        refuse_for_line(source, ports, protocol)
    if is_can:
        items = read_recording(recording) if recording is not None else live_frames(Endpoint.parse(source), seconds)
        _diagnose_can(items, CanLogDiagnosis(known_nodes(devices, nodes), bus, complete=complete), printer)
    elif recording is not None:
        _diagnose_log(source, recording, WINDOW if window is None else window, ports, protocol, printer)
    else:
        _diagnose_line(Endpoint.parse(source), seconds, WINDOW if window is None else window, printer)
    if recording is not None:
        note_cut_lines(recording)
    return printer.status


class _Printer:
    """Prints findings and verdicts, and knows the exit status that follows from them."""

    def __init__(self, *, as_json: bool, everything: bool) -> None:
        self.status = 0
        self._as_json, self._everything = as_json, everything
        self.unread = UnreadPrinter("no frame", as_json=as_json)
        """Prints the lines that hold no frame."""
        self._kinds: Counter[tuple[str, str]] = Counter()

    def findings(self, findings: Iterable[LogFinding]) -> None:
        """Print findings; of a kind only the first ones, unless all are asked for."""
        for found in findings:
            self.status = 1
            kind = found.finding.code, found.place
            self._kinds[kind] += 1
            if self._as_json:
                print_json(found.as_dict())
            elif self._everything or self._kinds[kind] <= _SHOWN:
                print(found.sentence, flush=True)

    def verdicts(self, verdicts: Iterable[tuple[str, LineVerdict]]) -> None:
        """Print how many findings were not printed, then the verdicts, each with the name of its line or bus."""
        for (code, place), number in self._kinds.items():
            if not self._as_json and not self._everything and number > _SHOWN:
                print(f"{place}  {number - _SHOWN} more [{code}]; --all shows them".lstrip())
        for name, verdict in verdicts:
            self.status = self.status or int(verdict.code != "nothing-wrong")
            if self._as_json:
                print_json(verdict.as_dict() | ({"place": name} if name else {}))
            else:
                print(f"{name}  {verdict.sentence}" if name else verdict.sentence)


# Modbus


def _diagnose_log(
    source: str,
    recording: RecordingSource,
    window: float,
    ports: tuple[int, ...],
    protocol: SerialProtocol | None,
    printer: _Printer,
) -> None:
    first, others = modbus_parts(source, recording, ports, protocol, printer.unread)
    diagnosis = ModbusLogDiagnosis(first, window, protocol)
    printer.findings(diagnosis.findings(others))
    printer.unread.end()
    printer.verdicts(diagnosis.verdicts())


def _diagnose_line(endpoint: Endpoint, seconds: float | None, window: float, printer: _Printer) -> None:
    listeners: list[LiveDiagnosis] = []

    def listener_of(line: Line) -> LiveDiagnosis:
        listeners.append(LiveDiagnosis(line, "ascii" if endpoint.framing == "ascii" else "rtu", window))
        return listeners[0]

    stop = threading.Event()
    with stopped_by_interrupt(stop):
        printer.findings(listen_with(endpoint, listener_of, stop, seconds=seconds))
    printer.verdicts(("", verdict) for verdict in listeners[0].verdicts())


# CAN


def _diagnose_can(items: Iterable[RecordedItem | float], diagnosis: CanLogDiagnosis, printer: _Printer) -> None:
    for item in items:
        printer.findings(diagnosis.feed(item))
    printer.findings(diagnosis.end())
    if diagnosis.only is not None and diagnosis.seen and diagnosis.only not in diagnosis.seen:
        raise BarewireError(f"--bus {diagnosis.only}: no frames on it; there are frames on {', '.join(diagnosis.seen)}")
    printer.unread.items(diagnosis.unread)
    printer.unread.end()
    printer.verdicts(diagnosis.verdicts())
