"""What both screens of the terminal have: a list that scrolls, text below it, questions, the end by a signal."""

from __future__ import annotations

import asyncio
import os
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from io import BufferedReader, RawIOBase, TextIOWrapper
from select import select
from typing import Any, ClassVar

from rich.style import Style
from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Vertical, VerticalScroll
from textual.events import Click, Key, MouseScrollDown, MouseScrollUp
from textual.geometry import Size
from textual.message import Message
from textual.screen import ModalScreen
from textual.scroll_view import ScrollView
from textual.strip import Strip
from textual.widgets import Input, Static

from barewire.errors import EncodeError
from barewire_workbench.cli.ending import ending_signals_call

WRONG = Style(color="red", bold=True)
FAINT = Style(dim=True)


def columns(width: int, *cells: tuple[str, int], style: Style | None = None) -> Text:
    """Return cells side by side, each with its width; the last one, with width 0, takes what is left."""
    line = Text(no_wrap=True)
    for text, size in cells:
        cell = Text(text.replace("\n", " "))
        cell.truncate(size or max(1, width - line.cell_len), overflow="ellipsis", pad=True)
        line.append_text(cell).append(" " if size else "")
    line.stylize(style or "")
    return line


class RowList(ScrollView):
    """A list of any length with one chosen row; only the rows that are seen are drawn, each by `draw(row, width)`."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {"row-list--chosen"}
    BINDINGS: ClassVar[list[Any]] = [
        Binding("up,k", "move(-1)", show=False),
        Binding("down,j", "move(1)", show=False),
        Binding("pageup", "move_page(-1)", show=False),
        Binding("pagedown", "move_page(1)", show=False),
        Binding("home", "move(-1000000000)", show=False),
        Binding("end", "move(1000000000)", show=False),
    ]
    DEFAULT_CSS = """
    RowList { height: 1fr; overflow-x: hidden; scrollbar-size-vertical: 1; }
    RowList > .row-list--chosen { background: $surface-lighten-1; }
    RowList:focus > .row-list--chosen { background: $surface-lighten-3; }
    """

    class Moved(Message):
        """The user has chosen another row."""

        def __init__(self, source: RowList) -> None:
            super().__init__()
            self.source = source

    def __init__(self, draw: Callable[[Any, int], Text], **options: Any) -> None:
        super().__init__(**options)
        self.rows: Sequence[Any] = ()
        self.place = 0
        self._draw = draw

    @property
    def chosen(self) -> Any:
        """The chosen row; None without rows."""
        return self.rows[self.place] if self.place < len(self.rows) else None

    def show(self, rows: Sequence[Any], place: int) -> None:
        """Show rows, and choose one of them, or the nearest."""
        self.rows = rows
        self.virtual_size = Size(0, len(rows))
        self.place = max(0, min(place, len(rows) - 1))
        height = max(1, self.size.height)
        top = int(self.scroll_offset.y)
        if not top <= self.place < top + height:
            self.scroll_to(y=self.place if self.place < top else self.place - height + 1, animate=False, force=True)
        self.refresh()

    def render_line(self, y: int) -> Strip:
        """Return one line of what is seen."""
        place, width = y + int(self.scroll_offset.y), self.scrollable_content_region.width
        if place >= len(self.rows):
            return Strip.blank(width, self.rich_style)
        line = Strip(self._draw(self.rows[place], width).render(self.app.console)).adjust_cell_length(width)
        style = self.get_component_rich_style("row-list--chosen") if place == self.place else self.rich_style
        return line.apply_style(style)

    def action_move(self, rows: int) -> None:
        """Choose the row so many below."""
        self.show(self.rows, max(0, self.place + rows))
        self.post_message(self.Moved(self))

    def action_move_page(self, pages: int) -> None:
        """Choose the row so many pages below."""
        self.action_move(pages * max(1, self.size.height - 1))

    def on_click(self, event: Click) -> None:
        """Choose the row below the mouse."""
        self.action_move(event.y + int(self.scroll_offset.y) - self.place)

    def on_mouse_scroll_up(self, event: MouseScrollUp) -> None:
        """Move with the wheel."""
        event.stop()
        self.action_move(-3)

    def on_mouse_scroll_down(self, event: MouseScrollDown) -> None:
        """Move with the wheel."""
        event.stop()
        self.action_move(3)


class OneLine(Static):
    """One line, cut at its end. It is drawn again only when it changes."""

    DEFAULT_CSS = "OneLine { height: 1; text-wrap: nowrap; text-overflow: ellipsis; }"
    _shown: Text | None = None

    def show(self, text: Text) -> None:
        """Show a text."""
        if text != self._shown:
            self._shown = text
            self.update(text)


class Lines(VerticalScroll):
    """Text that scrolls."""

    DEFAULT_CSS = "Lines { scrollbar-size-vertical: 1; } Lines > Static { width: 1fr; }"

    def compose(self) -> ComposeResult:
        """Make the text."""
        self._text = Static("", markup=False)
        yield self._text

    def show(self, lines: Iterable[tuple[str, bool]]) -> None:
        """Show lines, those that are wrong in red."""
        text = Text("\n").join(Text(line, style=WRONG if wrong else "") for line, wrong in lines)
        self._text.update(text)
        self.scroll_home(animate=False)


class Ask(ModalScreen[Any]):
    """A question: lines, and a text to type or a key to press. Returns the text, or the key; None for Escape."""

    DEFAULT_CSS = """
    Ask { align: center middle; }
    Ask > Vertical { width: 76; max-width: 96%; height: auto; max-height: 90%; border: round $primary;
      background: $surface; padding: 0 1; }
    Ask Lines { height: auto; max-height: 18; }
    """

    def __init__(
        self, title: str, lines: Sequence[tuple[str, bool]], *, keys: str = "", text: str | None = None
    ) -> None:
        super().__init__()
        self._title, self._lines, self._keys, self._text = title, lines, keys, text
        self._is_answered = False

    def _answer(self, answer: str | None) -> None:
        """Return this, once: more keys may have come before the box is gone."""
        if not self._is_answered:
            self._is_answered = True
            self.dismiss(answer)

    def compose(self) -> ComposeResult:
        """Make the box."""
        with Vertical() as box:
            box.border_title = self._title
            box.border_subtitle = "Esc: back" if self._text is None else "Enter: go on, Esc: back"
            yield Lines()
            if self._text is not None:
                yield Input(self._text, select_on_focus=False, compact=True)

    def on_mount(self) -> None:
        """Show the lines."""
        self.query_one(Lines).show(self._lines)
        self.query_one(Lines if self._text is None else Input).focus()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Keep the text from the screen below, where it would be a filter."""
        event.stop()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Return the text."""
        event.stop()
        self._answer(event.value)

    def on_key(self, event: Key) -> None:
        """Return a key, or nothing."""
        is_answer = self._text is None and (not self._keys or event.key in self._keys)
        if event.key == "escape" or is_answer:
            event.stop()
            self._answer(None if event.key == "escape" else event.key)


class FilterLine(Input):
    """The line for a filter, which is seen while there is one."""

    DEFAULT_CSS = "FilterLine { display: none; } FilterLine.asked { display: block; }"

    def __init__(self, example: str) -> None:
        super().__init__(placeholder=example, compact=True)


LAST_BINDINGS = (Binding("question_mark", "help", "Help", key_display="?"), Binding("q", "quit", "Quit"))


class TerminalApp(App[None]):
    """A screen of barewire. `HELP` has its keys; a screen adds `LAST_BINDINGS` to its own."""

    ENABLE_COMMAND_PALETTE = False
    HELP: ClassVar[str] = ""
    BINDINGS: ClassVar[list[Any]] = [
        Binding("slash", "filter", "Filter", key_display="/"),
        Binding("escape", "filter(False)", show=False),
        Binding("ctrl+c", "quit", show=False, priority=True),
    ]

    def filter_by(self, text: str) -> None:
        """Show only what fits a text."""

    def action_filter(self, asked: bool = True) -> None:
        """Ask for a filter, or end it."""
        line = self.query_one(FilterLine)
        line.set_class(asked, "asked")
        if asked:
            line.focus()
        else:
            line.value = ""
            self.filter_by("")
            self.query(RowList).first().focus()

    def on_input_changed(self, event: Input.Changed) -> None:
        """Filter with each key."""
        self.filter_by(event.value)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Go back to the list."""
        event.input.set_class(bool(event.value), "asked")
        self.query(RowList).first().focus()

    def action_help(self) -> None:
        """Show the keys."""
        self.push_screen(Ask("Keys", [(line, False) for line in self.HELP.strip().splitlines()]))


def run_screen(app: App[None]) -> int:
    """Run a screen until the user or a signal ends it; return the exit status. The terminal is as before then."""

    async def run() -> None:
        loop = asyncio.get_running_loop()
        with ending_signals_call(lambda: loop.call_soon_threadsafe(app.exit)):
            await app.run_async()

    asyncio.run(run())
    return app.return_code or 0


def check_terminal(option: str, *, keys: bool = True) -> None:
    """Raise EncodeError unless this process has a terminal; with `keys` also as its input."""
    streams = (*((("input", sys.__stdin__),) if keys else ()), ("output", sys.stdout), ("error", sys.__stderr__))
    for name, stream in streams:
        if stream is None or not stream.isatty():
            raise EncodeError(f"{option} needs a terminal, and standard {name} is none")


def keys_beside_pipe(option: str, stop: threading.Event) -> None:
    """Let the screen read the keys of the terminal where standard input is a pipe, which stays what `sys.stdin` reads,
    until `stop`."""
    check_terminal(option, keys=False)
    if sys.stdin is None or sys.stdin.isatty():
        raise EncodeError(f"{option} of -: standard input is the terminal, which is needed for the keys")
    try:
        terminal = os.open("/dev/tty", os.O_RDWR)
    except OSError:
        raise EncodeError(f"{option} of -: there is no terminal for the keys") from None
    pipe = os.dup(0)
    os.dup2(terminal, 0)
    os.close(terminal)
    sys.stdin = TextIOWrapper(BufferedReader(_Pipe(pipe, stop)))


class _Pipe(RawIOBase):
    """A pipe that ends when it is told to: nothing wakes up a thread that waits in `read`."""

    def __init__(self, descriptor: int, stop: threading.Event) -> None:
        self._descriptor, self._stop = descriptor, stop

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        while not self._stop.is_set():
            if select([self._descriptor], [], [], 0.1)[0]:
                return os.readv(self._descriptor, [buffer])
        return 0
