"""The screen of `sniff --live`: a list of exchanges or events, and the chosen one explained below it.

rtu:///dev/ttyUSB0   142 exchanges   7.1/s   3 wrong, 2.1 %   line busy 34 %   following
15:23:01.123  unit 1     12.3 ms  Read Holding Registers, 2 from 0000h -> 23 7
---------------------------------------------------------------------------------------------
request: 01 03 00 00 00 02 C4 0B ...
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding
from textual.widgets import Footer

from barewire.errors import BarewireError, EncodeError
from barewire_workbench.cli.sources import RecordingFile, Source, check_ending
from barewire_workbench.cli.terminal.heard import Filter, HeardRows, Row
from barewire_workbench.cli.terminal.screen import (
    FAINT,
    LAST_BINDINGS,
    WRONG,
    Ask,
    FilterLine,
    Lines,
    OneLine,
    RowList,
    TerminalApp,
    columns,
    run_screen,
)
from barewire_workbench.monitor.recording import CanRecordingWriter
from barewire_workbench.recordings.modbus_writer import ModbusRecordingWriter

_TICK = 0.1
"""Seconds from one look at what was heard to the next."""
_OPENED = 0.3
"""Seconds in which a port that is not there is an error of the command; later the screen shows it."""
_EXAMPLE = "unit=3 function=read errors, any text; Enter: to the list, Esc: all rows"


class SniffScreen(TerminalApp):
    """The screen. `save(rows, name)` writes rows as a recording."""

    CSS = """
    #state { background: $panel; }
    #heading { color: $text-muted; }
    #lower { height: 45%; border-top: solid $primary; }
    #lower:focus { border-top: heavy $primary; }
    """
    BINDINGS: ClassVar[list[Any]] = [
        Binding("e", "errors", "Errors"),
        Binding("space", "follow", "Pause/follow"),
        Binding("d", "diagnosis", "Diagnosis"),
        Binding("w", "save", "Write"),
        *LAST_BINDINGS,
    ]
    HELP = """
arrows, PgUp, PgDn, Home, End: choose a row; the list stops there, and
           goes on from the last one
space      stop the list, or follow the newest row again
Tab        to the explanation, to scroll it, and back
/          filter: unit=3, node=5, function=3, function=read, errors, any text;
           of several words all must fit. Enter: to the list, Esc: all rows
e          only what is wrong
d          the diagnosis of the whole line, or the explanation again
w          write the rows that are shown as a recording
?, q       these keys; quit
"""
    TITLE = "barewire sniff --live"

    def __init__(self, heard: HeardRows, source: str, save: Callable[[Sequence[Row], str], None]) -> None:
        super().__init__()
        self.heard, self.source = heard, source
        self.following = True
        self.dropped = 0
        self.chosen_rows = Filter()
        self._save = save
        self._rows: deque[Row] = deque()
        self._shown: deque[Row] = deque()
        self._below: object = self  # the row that is explained; of none at first
        self._lines_below: list[tuple[str, bool]] | None = None
        self._diagnosing = False
        self._widths = {"time": 12 if heard.live else 4, "station": 4, "what": 5}

    def compose(self) -> ComposeResult:
        """Make the parts of the screen."""
        self._state, self._heading = OneLine(id="state"), OneLine(id="heading")
        self._list, self._lower = RowList(self._draw), Lines(id="lower")
        yield from (self._state, self._heading, self._list, self._lower, FilterLine(_EXAMPLE), Footer())

    def on_mount(self) -> None:
        """Begin to look at what is heard."""
        self._list.focus()
        self.set_interval(_TICK, self.look)
        self.look()

    # The list

    def look(self) -> None:
        """Take what was heard since the last look, and show it."""
        before = len(self._shown)
        gone = 0
        for row in self.heard.take():
            for name, text in self._cells(row).items():
                self._widths[name] = max(self._widths[name], len(text))
            if len(self._rows) >= self.heard.limit:
                oldest = self._rows.popleft()
                self.dropped += 1
                if self._shown and self._shown[0] is oldest:
                    self._shown.popleft()
                    gone += 1
            self._rows.append(row)
            if self.chosen_rows.fits(row):
                self._shown.append(row)
        if gone or len(self._shown) != before:
            place = len(self._shown) - 1 if self.following else self._list.place - gone
            self._list.show(self._shown, place)
        self._show_state()
        self._show_below()

    def _draw(self, row: Row, width: int) -> Text:
        cells = [(text, self._widths[name]) for name, text in self._cells(row).items()]
        left = width - sum(size + 1 for _, size in cells)
        return columns(width, *cells, (shortened(row.text, left), 0), style=WRONG if row.wrong else None)

    def _cells(self, row: Row) -> dict[str, str]:
        """Return the narrow columns of a row; without a time if the recording has none."""
        time = {"time": self._time(row.at)} if self.heard.timed else {}
        return time | {"station": row.station, "what": row.what}

    def _time(self, at: float) -> str:
        """Return a time of day; of a recording, its own."""
        return datetime.fromtimestamp(at).strftime("%H:%M:%S.%f")[:-3] if self.heard.live else f"{at:.6f}"

    def _with_time(self, line: str, at: float) -> str:
        """Return a line that has its time as seconds, with the time of the list."""
        return line.replace(f"{at:.6f}", self._time(at), 1)

    def _show_state(self) -> None:
        heard = self.heard
        state = Text()
        share = f", {100 * heard.errors / heard.total:.1f} %" if heard.errors else ""
        parts: list[tuple[str, Any]] = [
            (f"{heard.total} {heard.noun}", ""),
            (f"{heard.per_second('rows'):.1f}/s", ""),
            (f"{heard.errors} wrong{share}", WRONG if heard.errors else ""),
        ]
        if heard.has_load:
            parts.append((f"busy {100 * heard.per_second('busy'):.0f} %", ""))
        if dropped := self.dropped + heard.dropped:
            parts.append((f"{dropped} dropped", WRONG))
        if self.chosen_rows != Filter():
            parts.append((f"{len(self._shown)} shown", "reverse"))
        if heard.error is not None:
            parts.append((str(heard.error), WRONG))
        elif heard.ended:
            parts.append(("ended", "bold"))
        else:
            parts.append(("following" if self.following else "paused", "bold"))
        for text, style in parts:
            state.append(text, style).append("  ")
        state.append(self.source, FAINT)
        self._state.show(state)
        names = ({"time": "time"} if heard.timed else {}) | heard.heading
        heading = [(text, self._widths[name]) for name, text in names.items()]
        self._heading.show(columns(self.size.width, *heading, (heard.noun, 0)))

    # Below the list

    def _show_below(self) -> None:
        row = self._list.chosen
        if self._diagnosing:
            self._lower.border_title = f"diagnosis: {self.heard.found} findings"
            found = list(self.heard.findings)  # at once: the thread goes on
            findings = [(self._with_time(finding.sentence, finding.at), True) for finding in reversed(found)]
            lines = [*((verdict, "[nothing-wrong]" not in verdict) for verdict in self.heard.verdicts), *findings]
            if lines != self._lines_below:
                self._lines_below = lines
                self._lower.show(lines)
        elif row is not self._below:
            self._below = row
            self._lower.border_title = "explanation"
            lines = [("nothing was heard yet", False)]
            if row is not None:
                (line, wrong), *frames = explained_lines(row)
                lines = [(self._with_time(line, row.at), wrong), *frames]
            self._lower.show(lines)

    def on_row_list_moved(self, event: RowList.Moved) -> None:
        """Stay at the row that was chosen; follow again from the last one."""
        self.following = self._list.place == len(self._shown) - 1
        self._show_state()
        self._show_below()

    # Keys

    def action_follow(self) -> None:
        """Follow the newest row, or stop that."""
        self.following = not self.following
        if self.following:
            self._list.show(self._shown, len(self._shown) - 1)
        self.look()

    def action_diagnosis(self) -> None:
        """Show the diagnosis of the line, or the explanation again."""
        self._diagnosing = not self._diagnosing
        self._below, self._lines_below = self, None
        self._show_below()

    def action_errors(self) -> None:
        """Show only what is wrong, or all."""
        self._choose(self.chosen_rows._replace(errors=not self.chosen_rows.errors))

    def filter_by(self, text: str) -> None:
        """Show the rows that a text asks for."""
        try:
            self._choose(Filter.parse(text))
        except EncodeError as error:
            self.notify(str(error), severity="error", timeout=2)

    def _choose(self, chosen: Filter) -> None:
        self.chosen_rows = chosen
        before = self._list.chosen
        self._shown = deque(row for row in self._rows if chosen.fits(row))
        place = next((place for place, row in enumerate(self._shown) if row is before), len(self._shown) - 1)
        self._list.show(self._shown, place)
        self.look()

    def action_save(self) -> None:
        """Write what is shown as a recording."""
        rows = [row for row in self._shown if row.origin]
        title = f"Write {len(rows)} rows as a recording"
        self.push_screen(Ask(title, [("File name:", False)], text=""), lambda name: self._saved(rows, name))

    def _saved(self, rows: Sequence[Row], name: str | None) -> None:
        if not name:
            return
        try:
            self._save(rows, name)
        except BarewireError as error:
            self.notify(str(error), severity="error")
        else:
            self.notify(f"{name} written")


def shortened(text: str, width: int) -> str:
    """Return "request -> answer" in a width, with the end of the request left out rather than the answer."""
    request, arrow, answer = text.partition(" -> ")
    if len(text) <= width or not arrow:
        return text
    room = max(width // 2, width - len(arrow) - len(answer)) - 1
    return f"{request[:room]}…{arrow}{answer}" if room < len(request) else text


def explained_lines(row: Row) -> list[tuple[str, bool]]:
    """Return the row as `barewire sniff` prints it, then each of its frames as `barewire explain` does."""
    lines = [(row.line, row.wrong)]
    for word, explanation in row.explained():
        lines.append((word, False))
        verdict_at = len(explanation.fields)
        lines += [(line, at >= verdict_at and not explanation.valid) for at, line in enumerate(explanation.lines())]
    return lines


def watch_traffic(heard: HeardRows, traffic: Source, read: Callable[[HeardRows], None]) -> int:
    """Show what a thread reads until the user ends it. Then raise the error that has ended it before."""
    thread = threading.Thread(target=heard.run, args=(read,), name=traffic.name, daemon=True)
    thread.start()
    thread.join(_OPENED)
    if heard.error is not None and not heard.total:
        raise heard.error
    try:
        status = run_screen(SniffScreen(heard, traffic.name, partial(save_rows, is_can=traffic.is_can)))
    finally:
        error = heard.error
        traffic.stop.set()  # what it reads may end within a line now, which is no error
        thread.join(5)
    if error is not None:
        raise error
    return status


def save_rows(rows: Sequence[Row], name: str, *, is_can: bool) -> None:
    """Write the frames of rows as a recording. Raises BarewireError."""
    check_ending(name, is_can)
    if Path(name).exists():
        raise EncodeError(f"{name}: the file is there already")
    items = {id(item): item for row in rows for item in row.origin}  # a late answer has its request in two rows
    with RecordingFile(name) as file:
        can, modbus = CanRecordingWriter(name), ModbusRecordingWriter()
        file.write(can.start if is_can else modbus.start, frame=False)
        for item in sorted(items.values(), key=lambda item: item.at):
            file.write(can.put(item.at, item.bus, item.frame) if is_can else modbus.put(item))
