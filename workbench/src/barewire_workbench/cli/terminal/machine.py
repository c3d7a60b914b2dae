"""The screen of `panel --terminal`: values by group, the frames of the line, a scope, writes with a confirmation.

It shows what `PanelLine` polls, as the page for browsers does, and nothing else is polled than what it shows.
"""

from __future__ import annotations

import asyncio
import re
from contextlib import ExitStack
from typing import Any, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Container, Vertical
from textual.widgets import Footer

from barewire.devices.cia402 import state_of
from barewire.errors import BarewireError
from barewire_workbench.cli.panels.description import description, planned_frames, value_to_write
from barewire_workbench.cli.panels.line import NOT_ASKED, KeptFrame, PanelLine, running
from barewire_workbench.cli.terminal.scope import MOST_TRACES, Scope
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
from barewire_workbench.frames.result import counted

_TICK = 0.2
"""Seconds from one look at what was polled to the next."""
_ONLY_READS = "this panel only shows: start it with --write to write"


class MachineScreen(TerminalApp):
    """The screen of one machine. Without `writable` nothing is written."""

    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (120, "-wide")]  # noqa: RUF012  # no ClassVar in its base
    CSS = """
    #state { background: $panel; }
    #groups { color: $text-muted; }
    .-wide #both { layout: horizontal; }
    .-wide #right { width: 45%; height: 1fr; border-left: solid $primary; }
    .-narrow #right { height: 45%; }
    #frames { border-top: solid $primary; height: 1fr; }
    #below { border-top: solid $primary; height: 1fr; }
    .-wide #below { height: 2fr; }
    #scope { display: none; border-top: solid $primary; height: 2fr; }
    .-scope #scope { display: block; }
    .-scope #frames, .-narrow .-scope #below { display: none; }
    #frames:focus, #below:focus { border-top: heavy $primary; }
    """
    BINDINGS: ClassVar[list[Any]] = [
        Binding("left", "group(-1)", show=False),
        Binding("g,right", "group(1)", "Group"),  # a list has the key of its own: it shows no other use of it
        Binding("enter", "write", "Write"),
        Binding("c", "command", "Command"),
        Binding("space", "hold", show=False),  # with it 80 columns do not have all
        Binding("d", "diagnosis", "Diagnosis"),
        Binding("p", "plot", "Plot"),
        Binding("s", "scope", "Scope"),
        Binding("t", "span", show=False),
        Binding("r", "read", show=False),
        *LAST_BINDINGS,
    ]
    HELP = """
g, left, right another group of values; only what is shown is polled
arrows, PgUp, PgDn, Home, End: choose a value, or a frame
Tab           values, frames, explanation
Enter         write the value; its frame is shown before it is sent
c             commands of a drive, from the state in which it is
/             only values with this text in their name; Esc: all
space         stop the list of frames, or go on
d             the diagnosis of the last frames, or the explanation again
p             draw the chosen value over time, or no longer; four at most
s, t          the scope instead of the frames; 60, 600 or 10 seconds of it
r             read a setting of a menu, whose numbers are written for that
?, q          these keys; quit
"""
    TITLE = "barewire panel --terminal"

    def __init__(self, line: PanelLine, *, writable: bool) -> None:
        super().__init__()
        self.line, self.writable = line, writable
        self._device = description(line.device, line.endpoint)
        ramp, groups = self._device["ramp"], self._device["groups"]
        self._rows = {row["name"]: row for rows in groups.values() for row in rows}
        if ramp:
            self._rows |= {row["name"]: row for row in ramp["settings"]}
            names = (ramp["status"], ramp["start"], ramp["stop"], *(row["name"] for row in ramp["settings"]))
            self._device["groups"] = groups = {"Ramp": [self._rows[name] for name in names]} | groups
        self._names: list[str] = [*groups]
        self._group = 0 if ramp else self._names.index(self._device["first"])
        self._scope = Scope(ramp["traces"] if ramp else ())
        self._polls = 0
        self._text = ""
        self._values: dict[str, tuple[Any, str, str]] = {}  # value, text, why there is none
        self._revision = 0
        self._found: dict[str, Any] = {"exchanges": 0, "verdicts": [], "findings": []}
        self._diagnosing = False
        self._is_alive = False
        self._holding = False
        self._newest: KeptFrame | None = None
        self._message: tuple[str, bool] = ("", False)
        self._looking = ExitStack()
        self._polled: list[str] = []
        self._below: object = None

    def compose(self) -> ComposeResult:
        """Make the parts of the screen."""
        self._state, self._groups = OneLine(id="state"), OneLine(id="groups")
        self._list, self._frames = RowList(self._draw_value, id="values"), RowList(self._draw_frame, id="frames")
        self._lower = Lines(id="below")
        yield from (self._state, self._groups)
        self._both = Container(id="both", classes="-scope" if self._scope.names else "")
        with self._both:
            yield self._list
            with Vertical(id="right"):
                yield from (self._frames, self._scope, self._lower)
        yield FilterLine("a part of the name")
        yield Footer(compact=True)

    def on_mount(self) -> None:
        """Begin to look at the first group."""
        self._list.focus()
        self._show_group()
        self.set_interval(_TICK, self.look)

    def on_unmount(self) -> None:
        """Have nothing polled any more."""
        self._looking.close()

    # Values and frames

    def _show_group(self) -> None:
        """Show a group, and have it polled, with the traces of the scope and the status of a drive."""
        rows = [row for row in self._device["groups"][self._names[self._group]] if self._text in row["name"].lower()]
        self._list.show(rows, 0)
        self._look_at_shown()

    def _look_at_shown(self) -> None:
        moving = self._device["drive"] or self._device["ramp"]
        self._polled = [row["name"] for row in self._list.rows if row["access"] != "wo"] + self._scope.names
        self._polled += [moving["status"]] if moving else []
        self._looking.close()
        self._looking.enter_context(self.line.look_at(self._polled))
        self._revision = 0
        self.look()

    def look(self) -> None:
        """Take what was polled since the last look, and show it."""
        changes = self.line.changes_since(self._revision, self._polled)
        self._revision = changes["revision"]
        if changes["values"] or changes["alive"] != self._is_alive:
            self._values |= changes["values"]
            self._is_alive = changes["alive"]
            self._list.refresh()
        if changes["polls"] != self._polls or not self._is_alive:
            self._polls = changes["polls"]
            cells = {name: self._values.get(name, (None, "…", "")) for name in self._scope.names}
            numbers = {name: cell[0] for name, cell in cells.items() if self._is_alive and cell[0] is not None}
            self._scope.take(changes["at"], numbers, {name: cell[2] or cell[1] for name, cell in cells.items()})
        if not self._holding and len(frames := list(self.line.frames)) and frames[-1] is not self._newest:
            self._newest = frames[-1]
            self._frames.show(frames, len(frames) - 1)
        self._found = changes["diagnosis"] or self._found
        self._frames.border_title = "frames, held" if self._holding else "frames"
        self._show_state(changes)
        self._show_below()

    def _show_state(self, changes: dict[str, Any]) -> None:
        state = Text()
        if changes["alive"]:
            state.append("connected", "green").append(f"  {self.motor_state or ''}", "bold")
        elif changes["problem"] == NOT_ASKED:
            state.append(NOT_ASKED, FAINT)
        else:
            state.append(f"no answer for {changes['for']:.0f} s: {changes['problem']}", WRONG)
        text, wrong = self._message
        state.append(f"  {text}", WRONG if wrong else "bold")
        for verdict, _ in self._found["verdicts"][:1]:
            state.append(f"  {verdict}", WRONG)
        state.append(f"  {counted(self.line.polls, 'poll')}  ")
        state.append(f"{self._device['device']} at {self.line.endpoint}", FAINT)
        self._state.show(state)
        names = Text()
        for place in range(self._group, self._group + len(self._names)):
            name = self._names[place % len(self._names)]
            names.append(f" {name} ", "reverse" if place == self._group else "").append(" ")
        self._groups.show(names)

    @property
    def drive_state(self) -> str | None:
        """The state in the status word of a drive; None for another machine, and before it was read."""
        drive = self._device["drive"]
        value = self._values.get(drive["status"], (None,))[0] if drive else None
        if not isinstance(value, int):
            return None
        try:
            return state_of(value).value
        except BarewireError:
            return f"{value:04X}h is no state of CiA 402"

    @property
    def motor_state(self) -> str | None:
        """The state of a drive, or the status of a motor with a ramp."""
        ramp = self._device["ramp"]
        return self._values.get(ramp["status"], (None, ""))[1] if ramp else self.drive_state

    def _draw_value(self, row: dict[str, Any], width: int) -> Text:
        _, text, problem = self._values.get(row["name"], (None, "not read" if "menu" in row else "…", ""))
        if row["access"] == "wo":
            text = "write only"
        limits = f"{row['range']} {row['unit']}".strip() if row["range"] else ""
        side = max(10, (width - 4) // 4)
        name = row["name"], width - 2 * side - 5
        style = WRONG if problem else None if self._is_alive else FAINT  # values of a machine that is silent are old
        return columns(width, name, (problem or text, side), (limits, side), (row["access"], 0), style=style)

    def _draw_frame(self, frame: KeptFrame, width: int) -> Text:
        arrow = "→" if frame.direction == "sent" else "←"
        verdict = frame.explanation.verdict.removeprefix("valid: ")
        style = None if frame.explanation.valid else WRONG
        return columns(width, (arrow, 1), (f"{frame.digits}  {verdict}", 0), style=style)

    def _show_below(self) -> None:
        """Show what is known of the chosen value; of the chosen frame, if the list of frames has the focus."""
        if self._lower.has_focus:
            return
        chosen = self._frames.chosen if self._frames.has_focus else self._list.chosen
        key: object = None
        if isinstance(chosen, KeptFrame):
            key = chosen.number
        elif chosen is not None:
            key = chosen["name"], self._values.get(chosen["name"])
        if self._diagnosing:
            key = self._found
        if key == self._below:
            return
        self._below = key
        if self._diagnosing:
            self._lower.border_title = f"diagnosis of the last {self._found['exchanges']} exchanges"
            lines = [f"verdict: {text}: {evidence}" for text, evidence in self._found["verdicts"]]
            lines += [sentence for _, sentence in reversed(self._found["findings"])]
            self._lower.show([(line, True) for line in lines] or [("nothing wrong", False)])
        elif isinstance(chosen, KeptFrame):
            self._lower.border_title = f"{chosen.direction}: {chosen.digits}"
            self._lower.show((text, not chosen.explanation.valid) for text in chosen.explanation.lines())
        elif chosen is not None:
            self._lower.border_title = chosen["name"]
            self._lower.show(self._about(chosen))

    def _about(self, row: dict[str, Any]) -> list[tuple[str, bool]]:
        """Return what is known of a parameter."""
        _, text, problem = self._values.get(row["name"], (None, "…", ""))
        access = {"ro": "read only", "wo": "write only"}.get(row["access"], "read and write")
        facts = [row["place"], row["type"], access]
        lines = [(problem or text, bool(problem)), (", ".join(facts), False)]
        if row["range"]:
            lines.append((f"range {row['range']} {row['unit']}".strip(), False))
        lines += [(f"{number} = {name}", False) for number, name in row["values"].items()]
        return lines + ([(row["note"], False)] if row["note"] else [])

    # Keys

    def on_row_list_moved(self, event: RowList.Moved) -> None:
        """Explain what was chosen; a frame stays in the list while it is looked at."""
        self._holding = self._holding or event.source.id == "frames"
        self._show_below()

    def on_descendant_focus(self) -> None:
        """Explain what is chosen in the list that has the focus now."""
        self._show_below()

    def action_group(self, step: int) -> None:
        """Show another group."""
        self._group = (self._group + step) % len(self._names)
        self._show_group()

    def action_diagnosis(self) -> None:
        """Show the diagnosis of the last frames, or the explanation again."""
        self._diagnosing = not self._diagnosing
        self._show_below()

    def action_scope(self) -> None:
        """Show the scope instead of the frames, or the frames again."""
        self._both.toggle_class("-scope")

    def action_span(self) -> None:
        """Show another time in the scope."""
        self._scope.next_span()

    def action_plot(self) -> None:
        """Draw the chosen value over time, or no longer."""
        row = self._list.chosen
        if row is None or not self._list.has_focus:
            return
        if row["access"] == "wo" or "menu" in row or not re.match(r"[uif]\d", row["type"]):
            self.say(f"{row['name']} is no number that is polled", wrong=True)
        elif row["name"] not in self._scope.names and len(self._scope.names) == MOST_TRACES:
            self.say(f"{MOST_TRACES} values are drawn: p removes one of them", wrong=True)
        else:
            self._scope.switch(row["name"])
            self._both.add_class("-scope")
            self._look_at_shown()

    def action_read(self) -> None:
        """Read the chosen setting of a menu."""
        row = self._list.chosen
        if row is None or "menu" not in row:
            self.say("r reads a setting behind the numbers of a menu; other values are polled", wrong=True)
        elif self.writable:
            self.run_worker(self._send(row["name"], row["name"], None))
        else:
            self.say(_ONLY_READS, wrong=True)

    def action_hold(self) -> None:
        """Stop the list of frames, or go on."""
        self._holding = not self._holding

    def filter_by(self, text: str) -> None:
        """Show the values with a text in their name."""
        self._text = text.lower()
        self._show_group()

    # Writes

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show a result in the first line, until the next one."""
        self._message = text, wrong
        self.look()

    def action_write(self) -> None:
        """Write the chosen value."""
        row = self._list.chosen
        if row is None or not self._list.has_focus:
            return
        if row["access"] == "ro":
            self.say(f"{row['name']} is read only", wrong=True)
        else:
            self._begin_write(row["name"])

    def action_command(self) -> None:
        """Offer the commands that leave the state of a drive."""
        drive = self._device["drive"]
        steps = [step for step in drive["transitions"] if step[1] == self.drive_state] if drive else []
        if not steps:
            self.say("the state of the drive is not known" if drive else "this machine is no drive", wrong=True)
            return
        lines = [
            (f"{place}  {command} -> {target}, transition {number}", False)
            for place, (number, _, target, command, _) in enumerate(steps, 1)
        ]

        def give(key: str | None) -> None:
            if key is not None:
                self._begin_write(drive["control"], f"0x{steps[int(key) - 1][4]:04X}")

        keys = "".join(str(place) for place in range(1, len(steps) + 1))
        self.push_screen(Ask(f"Commands: {self.drive_state}", lines, keys=keys), give)

    def _begin_write(self, name: str, text: str | None = None) -> None:
        if self.writable:
            self.run_worker(self.write(name, text))
        else:
            self.say(_ONLY_READS, wrong=True)

    async def write(self, name: str, text: str | None = None) -> None:
        """Ask for the value, unless it is given, show the frames, and write once the user has said yes."""
        device, problem = self.line.device, list[tuple[str, bool]]()
        about = self._rows[name]
        while True:
            typed = text
            if typed is None:
                first = next(iter(about["values"]), "") if about["access"] == "wo" else ""
                typed = await self.push_screen_wait(Ask(f"Write {name}", problem + self._about(about), text=first))
            if typed is None:
                return
            try:
                parameter, value, values = value_to_write(device, name, typed, self.line.menus)
                frames = planned_frames(self.line.endpoint, device, values)
                break
            except BarewireError as error:
                problem, text = [(str(error), True)], None
        lines = [(f"{name} = {parameter.text(value)}, would be sent:", False)]
        lines += [(row, False) for digits, verdict in frames for row in (digits, f"  {verdict}")]
        if await self.push_screen_wait(Ask(f"Write {name}?", [*lines, ("y: send", False)], keys="y")) is None:
            return
        await self._send(name, f"{name} = {parameter.text(value)}", value)

    async def _send(self, name: str, about: str, value: Any) -> None:
        """Have a value written, or a setting of a menu read (None), and say what came of it."""
        try:
            result = await asyncio.wrap_future(self.line.write(name, value))
        except BarewireError as error:
            self.say(str(error), wrong=True)
        else:
            self.say(f"{about}, {result}")


def show_machine(line: PanelLine, *, writable: bool) -> int:
    """Show a machine until the user ends it; return the exit status."""
    with running(line):
        return run_screen(MachineScreen(line, writable=writable))
