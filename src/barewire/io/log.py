"""The log of what happens on ports: the standard `logging`, with a limit so that no peer can flood it.

    barewire.modbus.client     barewire.canopen.client      what a request did not tell its caller, connections, frames
    barewire.modbus.server     barewire.canopen.server      clients, refusals, errors in the code of the application
                               barewire.canopen.bus         the port of a bus, and the frames on it
                               barewire.canopen.gateway

    ERROR      the code of the application raised an error, or a server ended
    WARNING    something was refused or failed, and no exception reports it to the program
    INFO       the usual course: connections, time-outs (also an exception), late answers
    DEBUG      all bytes and frames; a port shows them if DEBUG is on when it is opened

Of each *kind* of line there are at most ten in 60 seconds. The next line of this kind ends with the number of those
left out: "(490 more like this in the last 60 s)". There are at most 250 kinds in 60 seconds; all others share one
limit of ten. A line has at most 1000 characters, and the text of an error in a traceback as well.

`logging` takes 5 ms to load. A program that has not imported it has not switched on INFO, so it is loaded only for a
line of level WARNING or ERROR. docs/how-to/logging.md has the lines.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import Any

_DEBUG, _INFO, _WARNING, _ERROR = 10, 20, 30, 40
"""The levels of `logging`."""
LINES = 10
"""Lines of one kind that are written in each interval."""
INTERVAL = 60.0
"""Seconds."""
_KINDS = 250
"""Kinds with a limit of their own: those of errors contain the unit and the class of the error."""
_OTHERS = object()
"""The kind of all lines whose kind is not among those."""
_LONGEST = 1000
"""Characters of a line, without its place."""


class _Kind:
    """The lines of one kind since `since`."""

    def __init__(self, since: float) -> None:
        self.since = since
        self.written = 0
        self.left_out = 0
        self.level, self.text = 0, ""
        """Of the latest line that was left out."""


class PortLog:
    """The log of one server, bus or client. `place`, a URL, is the beginning of each line."""

    def __init__(self, name: str, place: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.name = name
        self.place = place
        self._clock = clock
        self._kinds: dict[Hashable, _Kind] = {}

    def info(self, kind: Hashable, text: str) -> None:
        """Log a line of level INFO."""
        if "logging" in sys.modules:
            self._log(_INFO, kind, text)

    def warning(self, kind: Hashable, text: str) -> None:
        """Log a line of level WARNING."""
        self._log(_WARNING, kind, text)

    def error(self, kind: Hashable, text: str, error: BaseException | None = None) -> None:
        """Log a line of level ERROR, with the traceback of `error`."""
        self._log(_ERROR, kind, text, error)

    def watch(self, peer: str = "") -> Callable[[Any, Any], Any] | None:
        """Return a function that logs "sent" or "received", and bytes or a frame; None unless DEBUG is on now."""
        if "logging" not in sys.modules:
            return None
        import logging

        logger = logging.getLogger(self.name)
        if not logger.isEnabledFor(_DEBUG):
            return None
        place = f"{self.place}: {peer}" if peer else self.place

        def show(direction: str, item: Any) -> None:
            with suppress(Exception):
                shown = item.hex(" ").upper() if isinstance(item, (bytes, bytearray)) else item
                logger.debug("%s: %s %s", place, direction, shown)

        return show

    def short(self, why: object) -> str:
        """Return the text of an error without its beginning, which is the place that the line has already."""
        return str(why).removeprefix(f"{self.place}: ").removeprefix(f"{self.place.partition('://')[2]}: ")

    def flush(self) -> None:
        """Log how many lines were left out. Called when a server, bus or client is closed."""
        kinds, self._kinds = self._kinds, {}
        for kind in kinds.values():
            self._finish(kind, self._clock())

    def _forget(self, now: float) -> None:
        """Forget the kinds whose interval is over."""
        while self._kinds:
            kind = next(iter(self._kinds))
            if now - self._kinds[kind].since < INTERVAL:
                return
            self._finish(self._kinds.pop(kind), now)

    def _finish(self, kind: _Kind, now: float) -> None:
        """Log how many lines of this kind were left out."""
        if kind.left_out:
            kind.left_out -= 1  # the latest one is written now
            self._write(kind.level, kind.text, self._more(kind, now))

    def _log(self, level: int, kind: Hashable, text: str, error: BaseException | None = None) -> None:
        with suppress(Exception):  # handlers and filters are code of the application
            import logging

            if not logging.getLogger(self.name).isEnabledFor(level):
                return
            now, text = self._clock(), _cut(text)
            if kind not in self._kinds and len(self._kinds) >= _KINDS:
                self._forget(now)
                if len(self._kinds) >= _KINDS:
                    kind = _OTHERS
            counted = self._kinds.get(kind)
            more = ""
            if counted is None or now - counted.since >= INTERVAL:
                if counted is not None:
                    more = self._more(counted, now)
                    del self._kinds[kind]  # it goes to the end: the kinds are in the order of their times
                counted = self._kinds[kind] = _Kind(now)
            if counted.written >= LINES:
                counted.left_out += 1
                counted.level, counted.text = level, text
                return
            counted.written += 1
            self._write(level, text, more, error)

    @staticmethod
    def _more(kind: _Kind, now: float) -> str:
        seconds = round(now - kind.since)
        interval = f"{seconds} s" if seconds > 1 else "second"
        return f" ({kind.left_out} more like this in the last {interval})" if kind.left_out else ""

    def _write(self, level: int, text: str, more: str, error: BaseException | None = None) -> None:
        import logging

        with suppress(Exception):
            shown = None if error is None else _with_short_text(error)
            logging.getLogger(self.name).log(level, "%s: %s%s", self.place, text, more, exc_info=shown)


def _cut(text: str) -> str:
    """Return the text, or its beginning and how long it is."""
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}... ({len(text)} characters)"


def _with_short_text(error: BaseException) -> BaseException:
    """Return the error, or one with the same traceback that `logging` can show in a short text."""
    try:
        text = str(error)
    except Exception:
        return error  # the traceback says that it has no text
    if len(text) <= _LONGEST:
        return error
    return Exception(_cut(f"{type(error).__name__}: {text}")).with_traceback(error.__traceback__)


def watch_both(
    first: Callable[[Any, Any], Any] | None, second: Callable[[Any, Any], Any] | None
) -> Callable[[Any, Any], Any] | None:
    """Return one function that calls both, or the one that there is."""
    if first is None or second is None:
        return first or second
    show_first, show_second = first, second

    def both(direction: Any, item: Any) -> None:
        show_first(direction, item)
        show_second(direction, item)

    return both
