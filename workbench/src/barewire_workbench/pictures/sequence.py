"""A sequence diagram: the messages between stations, and their times.

       time        client          unit 1
       1.000000       |-------------->|        Read Holding Registers, 2 from 0000h   03 00 00 00 02
       1.012300       |<--------------|        2 registers, after 12.3 ms             03 04 00 17 00 07

Time runs downwards. Messages come as an iterator of any length: the picture keeps the first ones, and counts the rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice, pairwise
from statistics import median
from typing import Any, NamedTuple

from barewire_workbench.frames.result import counted
from barewire_workbench.pictures.drawing import LETTER_FIXED, Drawing, Tile, text_lines
from barewire_workbench.pictures.picture import Picture

MESSAGES_DRAWN = 100
"""The most messages in a picture."""
STATIONS_DRAWN = 7
"""The most stations with a line of their own; messages of others are drawn at the last line."""
_OTHERS = "others"

_SPANS = {1: 420, 2: 420, 3: 320}
_SPAN = 240
_PAUSE = 4
"""A time that is longer than the median by this factor is drawn as a pause, unless others are far longer."""
_HEX_SHOWN = 16
_COLUMN = 16


class SequenceMessage(NamedTuple):
    """A message from `source` to `target`, or, without a target, an event at `source`: a missing answer, noise.

    `at` is in seconds, None if it is not known; `data` are its bytes. `wrong` marks what should not be.
    """

    source: str
    target: str
    text: str
    data: bytes = b""
    at: float | None = None
    wrong: bool = False


class SequencePicture(Picture):
    """Messages between stations. `stations` is the order of their lines; those that are not in it follow as they come.

    >>> read = SequenceMessage("client", "unit 1", "read 2 registers", bytes.fromhex("0300000002"), 1.0)
    >>> answer = SequenceMessage("unit 1", "client", "23 7", bytes.fromhex("030400170007"), 1.0123)
    >>> print(*SequencePicture("an exchange", [read, answer]).lines(), sep="\\n")
    time      client          unit 1
    1.000000    |-------------->|       read 2 registers   03 00 00 00 02
    1.012300    |<--------------|       23 7   03 04 00 17 00 07
    """

    kind = "sequence"

    def __init__(self, title: str, messages: Iterable[SequenceMessage], stations: Sequence[str] = ()) -> None:
        source = iter(messages)
        self.title = title
        self.messages = tuple(islice(source, MESSAGES_DRAWN))
        self.left_out = sum(1 for _ in source)
        self.timed = any(message.at is not None for message in self.messages)
        order = dict.fromkeys(stations)
        for message in self.messages:
            order |= dict.fromkeys((message.source, message.target or message.source))
        used = [name for name in order if any(name in message[:2] for message in self.messages)]
        self.stations = tuple(used if len(used) <= STATIONS_DRAWN else [*used[: STATIONS_DRAWN - 1], _OTHERS])
        self._left_out_text = ""
        if self.left_out:
            total = counted(len(self.messages) + self.left_out, "message")
            drawn = f"The first {len(self.messages)} of {total} are drawn"
            self._left_out_text = f"{drawn}; {self.left_out} are left out."
        reading = "Messages in their order; their times are not known."
        if self.timed:
            reading = "Time runs downwards, in seconds and not to scale; a dashed piece of its axis is a longer pause."
        self.caption = f"{reading} {self._left_out_text}".strip()

    def _place(self, name: str) -> int:
        return self.stations.index(name) if name in self.stations else len(self.stations) - 1

    def lines(self) -> list[str]:
        times = ["" if message.at is None else f"{message.at:.6f}" for message in self.messages]
        wide = max(map(len, ["time", *times]))
        lines = [f"{'time':<{wide}}  " + "".join(f"{name:<{_COLUMN}}" for name in self.stations).rstrip()]
        for message, at in zip(self.messages, times):
            digits = _digits(message.data)
            text = "   ".join(filter(None, (f"{'! ' if message.wrong else ''}{message.text}", digits)))
            lines.append(f"{at:<{wide}}  {self._arrow(message)}    {text}".rstrip())
        return [*lines, self._left_out_text] if self.left_out else lines

    def _arrow(self, message: SequenceMessage) -> str:
        row = list((" " * 2 + "|" + " " * (_COLUMN - 3)) * len(self.stations))
        start = 2 + _COLUMN * self._place(message.source)
        if not message.target:
            row[start] = "x" if message.wrong else "*"
        else:
            end = 2 + _COLUMN * self._place(message.target)
            low, high = sorted((start, end))
            row[low + 1 : high] = "-" * max(high - low - 1, 0)
            if end > start:
                row[end - 1] = ">"
            elif end < start:
                row[end + 1] = "<"
            else:
                row[start] = "*"
        return "".join(row)[: 3 + _COLUMN * (len(self.stations) - 1)] + " " * 3

    def as_dict(self) -> dict[str, Any]:
        return {
            "picture": self.kind,
            "title": self.title,
            "stations": list(self.stations),
            "messages": [
                {
                    "at": message.at,
                    "source": message.source,
                    "target": message.target or None,
                    "text": message.text,
                    "hex": message.data.hex(" ").upper(),
                    "wrong": message.wrong,
                }
                for message in self.messages
            ],
            "left_out": self.left_out,
        }

    def tiles(self) -> Sequence[Tile]:
        drawing, front = Drawing(), Drawing()
        span = _SPANS.get(len(self.stations), _SPAN)
        axis = self._axis
        places = [axis + 64 + span * number for number in range(len(self.stations))]
        ends = [self._place(message.target or message.source) for message in self.messages]
        notes = any(not message.target and end == len(places) - 1 for message, end in zip(self.messages, ends))
        width = round((places[-1] if places else axis) + (span - 40 if notes or len(places) < 2 else 70))
        y, previous, pauses = 44.0, 32.0, self._pauses()
        for message, pause in zip(self.messages, pauses):
            y += 34 if pause else 10
            with front.group(label=self._said(message)):
                moment, y = self._message(front, message, places, span, y)
            if self.timed:
                drawing.line([(axis, previous), (axis, moment)], "l d" if pause else "l")
            if pause:
                drawing.text(axis - 8, (previous + moment) / 2 + 5, _span_text(pause), "s soft e")
            previous = moment
        bottom = y + 22
        for name, x in zip(self.stations, places):
            drawing.box(x - 55, 6, 110, 26, "o t0", 6)
            drawing.text(x, 24, text_lines(name, 104)[0], "h c")
            drawing.vertical(x, 32, round(bottom))
        if self.timed:
            drawing.text(8, 24, "time, s", "s soft")
            drawing.line([(axis, previous), (axis, bottom)])
        said = f"{counted(len(self.messages), 'message')} between {', '.join(self.stations) or 'no stations'}"
        return [Tile(max(width, 320), round(bottom) + 10, f"{drawing}{front}", said)]

    @property
    def _axis(self) -> int:
        """Where the time axis is: there is room for the longest time on its left."""
        longest = max((len(f"{message.at:.6f}") for message in self.messages if message.at is not None), default=0)
        return round(longest * 13 * LETTER_FIXED) + 24 if longest else 0

    def _pauses(self) -> list[float]:
        """Return for each message the seconds since the one before, if that is a pause; 0 otherwise."""
        times = [message.at for message in self.messages]
        steps = [
            0.0 if before is None or after is None else after - before
            for before, after in pairwise([*times[:1], *times])
        ]
        # Most messages follow at their usual distance; beside one silence of minutes, seconds are not worth a pause.
        usual = median([step for step in steps if step > 0] or [0.0])
        least = max(_PAUSE * usual, max(steps, default=0.0) / 8)
        return [step if step > least else 0.0 for step in steps]

    def _message(
        self, drawing: Drawing, message: SequenceMessage, places: Sequence[int], span: int, top: float
    ) -> tuple[float, float]:
        """Draw a message below `top`; return where its moment is on the time axis, and where the next may begin."""
        source = places[self._place(message.source)]
        target = places[self._place(message.target)] if message.target else source
        room = abs(target - source) - 24 if target != source else span - 60
        left = min(source, target) + 12
        texts = text_lines(f"{'✗ ' if message.wrong else ''}{message.text}", room)[:4]
        css = "bad" if message.wrong else ""
        digits = _digits(message.data, max(int((room + 6) / (3 * 12 * 0.61)), 3))
        y = top + 14
        for text in texts:
            if target != source:
                drawing.box(left - 2, y - 12, min(len(text) * 7.6, room) + 4, 16, "paper")
            drawing.text(left, y, text, css)
            y += 16
        arrow = y - 6
        if target == source:
            drawing.dot(source, top + 10, 5, "wrongtip" if message.wrong else "dot")
        else:
            drawing.line([(source, arrow), (target, arrow)], "p thin wrong" if message.wrong else "p thin")
            drawing.arrow(target, arrow, "right" if target > source else "left", "wrongtip" if message.wrong else "dot")
        moment = arrow if target != source else top + 10
        if message.at is not None:
            drawing.text(self._axis - 8, moment + 4, f"{message.at:.6f}", "m s e")
            drawing.line([(self._axis - 5, moment), (self._axis + 5, moment)])
        if digits:
            y += 8 if target != source else 0
            drawing.text(left, y, digits, "m s soft")
            y += 6
        return moment, y

    def _said(self, message: SequenceMessage) -> str:
        at = "" if message.at is None else f"at {message.at:.6f} s, "
        stations = f"{message.source} to {message.target}" if message.target else message.source
        return f"{at}{stations}: {message.text}"


def _digits(data: bytes, most: int = _HEX_SHOWN) -> str:
    pairs = data.hex(" ").upper()
    return pairs if len(data) <= most else f"{data[: most - 1].hex(' ').upper()} ..."


def _span_text(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds >= 0.9995 else f"{1e3 * seconds:.3g} ms"
