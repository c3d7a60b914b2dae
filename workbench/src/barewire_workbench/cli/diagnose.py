"""`barewire diagnose`: what is wrong in a recording, or on a live line or bus, and what follows for the whole of it."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterable

import click

from barewire.errors import BarewireError
from barewire.io.endpoint import Endpoint
from barewire.modbus.framing import Line
from barewire_workbench.cli.arguments import Choice, json_option, known_nodes, nodes_option
from barewire_workbench.cli.output import Output, output_form
from barewire_workbench.cli.sources import (
    Source,
    UnreadPrinter,
    check_bus,
    ports_option,
    protocol_option,
    seconds_option,
    stopped_by_interrupt,
    window_option,
)
from barewire_workbench.diagnosis.can_log import CanLogDiagnosis
from barewire_workbench.diagnosis.modbus_log import LiveDiagnosis, ModbusLogDiagnosis
from barewire_workbench.diagnosis.modbus_noise import has_no_reading
from barewire_workbench.diagnosis.texts import (
    NO_WHOLE_FRAMES,
    is_text,
    limited_to_the_frames,
    verdict_of_words,
    verdict_without_bytes,
)
from barewire_workbench.diagnosis.verdict import LineVerdict, LogFinding
from barewire_workbench.live.listen import listen_with
from barewire_workbench.recordings.modbus_log.posted import PROSE
from barewire_workbench.recordings.modbus_replay import SerialProtocol
from barewire_workbench.recordings.model import Unread
from barewire_workbench.sniffer import WINDOW

_TEXT_MAX = 0x8000
"""Bytes of the longest text whose words are judged beside its bytes; a longer one is a log."""
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
    printer = _Printer(Output(output_form(form, as_json=as_json)), everything=everything)
    traffic = Source(source, seconds, ports, protocol)
    traffic.check_options(
        for_modbus={"--window": window, "--port": ports, "--protocol": protocol},
        for_can={"--device": devices, "--node": nodes, "--bus": bus, "--complete": complete},
    )
    window = WINDOW if window is None else window
    if traffic.is_can:
        _diagnose_can(traffic, CanLogDiagnosis(known_nodes(devices, nodes), bus, complete=complete), printer)
    elif traffic.endpoint is None:
        _diagnose_log(traffic, window, printer)
    else:
        _diagnose_line(traffic.endpoint, seconds, window, printer)
    traffic.note_cut_lines()
    return printer.status


class _Printer:
    """Prints findings and verdicts, and keeps the exit status that follows from them."""

    def __init__(self, output: Output, *, everything: bool) -> None:
        self.status = 0
        self.unread = UnreadPrinter("no frame", output)
        """Prints the lines that hold no frame."""
        self._output, self._everything = output, everything
        self._kinds: Counter[tuple[str, str]] = Counter()

    def findings(self, findings: Iterable[LogFinding]) -> None:
        """Print findings; of a kind only the first ones, unless all are asked for."""
        for finding in findings:
            self.status = 1
            kind = finding.finding.code, finding.place
            self._kinds[kind] += 1
            if self._output.as_json or self._everything or self._kinds[kind] <= _SHOWN:
                self._output.show(finding.sentence, finding.as_dict)

    def verdicts(self, verdicts: Iterable[tuple[str, LineVerdict]]) -> None:
        """Print how many findings were not printed, then the verdicts, each with the name of its line or bus."""
        for (code, place), number in self._kinds.items():
            if not self._everything and number > _SHOWN:
                self._output.text(f"{place}  {number - _SHOWN} more [{code}]; --all shows them".lstrip())
        for name, verdict in verdicts:
            self.status = self.status or int(verdict.code != "nothing-wrong")
            where = {"place": name} if name else {}
            self._output.show(f"{name}  {verdict.sentence}".lstrip(), verdict.as_dict() | where)


def _with_words(
    traffic: Source, verdicts: list[tuple[str, LineVerdict]], unread: Iterable[Unread]
) -> list[tuple[str, LineVerdict]]:
    """Return the verdicts and the one on the words of a short text; nothing more for a line or bus, or a capture. What
    else it may be is left out where people wrote sentences: these say more than a list of causes."""
    if traffic.endpoint is not None or len(traffic.recording.start) >= _TEXT_MAX:
        return verdicts
    text = traffic.recording.start.decode("utf-8", "replace")
    whole = ["", *text.splitlines()]  # an unread line is kept in part
    lines = [whole[item.line] if item.line < len(whole) else item.text for item in unread]
    if any(map(PROSE.search, lines)):
        verdicts = [(name, verdict._replace(otherwise="")) for name, verdict in verdicts]
    words = verdict_of_words(text, {verdict.code for _, verdict in verdicts})
    verdicts = [(name, limited_to_the_frames(verdict, lines, words)) for name, verdict in verdicts]
    return verdicts if words is None else [*verdicts, ("", words)]


# Modbus


def _diagnose_log(traffic: Source, window: float, printer: _Printer) -> None:
    text = traffic.recording.start.decode("utf-8", "replace")
    words = verdict_without_bytes(text)
    try:
        first, others = traffic.modbus_parts(printer.unread)
    except BarewireError:
        is_long = len(traffic.recording.start) >= _TEXT_MAX
        if words is None or (is_long and words.code == "not-seen"):  # a recording may be meant: which line is none
            raise
        printer.verdicts([("", words)])
        return
    if words is not None and is_text(first):
        printer.verdicts([("", words)])
        return
    is_whole = len(traffic.recording.start) < _TEXT_MAX and traffic.name != "-"  # a pipe may go on
    if is_whole:
        first = first._replace(items=(*first.items, *(item for part in others for item in part.items)))
    diagnosis = ModbusLogDiagnosis(first, window, traffic.protocol, whole=is_whole)
    findings = diagnosis.findings(others)
    if words is not None and words.text == NO_WHOLE_FRAMES and len(text) < _TEXT_MAX:
        listed = list(findings)
        has_frames = any(line.counts.frames for line in diagnosis.lines.values())
        if not has_frames and all(has_no_reading(found.finding) for found in listed):
            printer.verdicts([("", words)])
            return
        findings = iter(listed)
    printer.findings(findings)
    printer.unread.end()
    unread = (item for item in first.items if isinstance(item, Unread))
    printer.verdicts(_with_words(traffic, diagnosis.verdicts(), unread))


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


def _diagnose_can(traffic: Source, diagnosis: CanLogDiagnosis, printer: _Printer) -> None:
    for item in traffic.can_items():
        printer.findings(diagnosis.feed(item))
    printer.findings(diagnosis.end())
    check_bus(diagnosis.only, diagnosis.seen)
    printer.unread.items(diagnosis.unread)
    printer.unread.end()
    printer.verdicts(_with_words(traffic, diagnosis.verdicts(), diagnosis.unread))
