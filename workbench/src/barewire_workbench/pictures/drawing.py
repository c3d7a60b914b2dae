"""The colours of the pictures, and the elements of SVG as text: a drawing collects them, a tile is a part of a picture.

        Drawing().text(10, 20, "unit", "h")        <text x="10" y="20" class="h">unit</text>

Coordinates are pixels, y grows downwards. An element never states a colour: its classes are those of the style sheet.
Every colour has a role. Text of one role is drawn only on the backgrounds that `TEXT_ON` lists, where its contrast is
at least 4.5 (WCAG 2.1, 1.4.3), and no meaning is carried by colour alone: parts also have numbers, names or patterns.

The style sheet states the light colours first and the dark ones in `@media (prefers-color-scheme: dark)`, without
variables: drawing programs that know neither still show the light picture.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from html import escape
from typing import NamedTuple

TINTS = 6
"""The number of tints, for parts that lie next to each other."""

COLOURS: dict[str, tuple[str, str]] = {
    "paper": ("#ffffff", "#14181d"),
    "ink": ("#1b1f24", "#e8edf2"),
    "soft": ("#4d5660", "#aab4bf"),
    "line": ("#6a737d", "#8b96a2"),
    "grid": ("#cfd6dd", "#39424c"),
    "accent": ("#0a4fa8", "#82c3ff"),
    "good": ("#0f5f28", "#6bdc84"),
    "bad": ("#a10f2b", "#ff8f88"),
    "mark": ("#ffd33d", "#6b5300"),
    "tint0": ("#dcebff", "#1c3a5e"),
    "tint1": ("#dcf5e0", "#17432a"),
    "tint2": ("#fdf0c4", "#4b3c08"),
    "tint3": ("#f3e3fb", "#47265a"),
    "tint4": ("#ffe3e0", "#5a2424"),
    "tint5": ("#d9f3f2", "#124648"),
}
"""Role -> the colour in light and in dark."""

TEXT_ON: dict[str, tuple[str, ...]] = {
    "ink": ("paper", "mark", *(f"tint{number}" for number in range(TINTS))),
    "soft": ("paper",),
    "accent": ("paper",),
    "good": ("paper",),
    "bad": ("paper",),
    "paper": ("accent",),
}
"""Role of a text -> the backgrounds on which it is drawn."""

_SHAPES = """
{s} text{font:13px system-ui,"Segoe UI",Roboto,"DejaVu Sans",sans-serif}
{s} .m{font-family:ui-monospace,Menlo,Consolas,"DejaVu Sans Mono",monospace}
{s} text.m{white-space:pre}
{s} .s{font-size:12px}
{s} .b{font-size:15px}
{s} .h{font-weight:600}
{s} .c{text-anchor:middle}
{s} .e{text-anchor:end}
{s} .w{fill:none;stroke-width:2.5;stroke-linejoin:round}
{s} .l{fill:none;stroke-width:1.2}
{s} .d{stroke-dasharray:4 4}
{s} .o{fill:none;stroke-width:1.2}
{s} .p{fill:none;stroke-width:3.5}
{s} .thin{stroke-width:1.8}
"""

_PAINTS = """
{s} .paper{fill:@paper}
{s} text{fill:@ink}
{s} text.soft{fill:@soft}
{s} text.accent{fill:@accent}
{s} text.good{fill:@good}
{s} text.bad{fill:@bad}
{s} text.on{fill:@paper}
{s} .dot{fill:@accent}
{s} .tip{fill:@line}
{s} .w{stroke:@ink}
{s} .l,{s} .o{stroke:@line}
{s} .g{fill:none;stroke:@grid}
{s} .p{stroke:@accent}
{s} .wrong{stroke:@bad}
{s} .wrongtip{fill:@bad}
{s} .mark{fill:@mark}
""" + "".join(f"{{s}} .t{number}{{fill:@tint{number};background:@tint{number}}}\n" for number in range(TINTS))


def stylesheet(scope: str, *, follows_page: bool = False) -> str:
    """Return the style sheet for the elements inside `scope`, a CSS selector.

    >>> "@media (prefers-color-scheme:dark)" in stylesheet(".bw")
    True
    """
    return _SHAPES.replace("{s}", scope).strip() + "\n" + themed(_PAINTS, scope, follows_page=follows_page)


def themed(rules: str, scope: str, *, follows_page: bool = False) -> str:
    """Return rules of CSS with the light colours, and those with the dark ones for a system that is set to dark.

    With `follows_page` an attribute `data-theme` of an element around the scope, "light" or "dark", is stronger than
    the setting of the system: pages of documentation have such a switch.
    """
    sheets = [painted(rules, scope, 0), f"@media (prefers-color-scheme:dark){{{painted(rules, scope, 1)}}}"]
    if follows_page:
        for place, theme in enumerate(("light", "dark")):
            sheets.append(painted(rules, f'[data-theme="{theme}"] {scope}', place))
    return "\n".join(sheets)


def painted(rules: str, scope: str, place: int) -> str:
    """Return rules of CSS with a scope for `{s}` and the colours for `@role`: light ones at place 0, dark ones at 1.

    >>> painted("{s} p{color:@ink}", ".bw", 1)
    '.bw p{color:#e8edf2}'
    """
    return re.sub(r"@(\w+)", lambda role: COLOURS[role[1]][place], rules.replace("{s}", scope)).strip()


# Elements -----------------------------------------------------------------------------------------------------------


_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_LETTER = 0.56
"""The mean width of a character in a proportional font, in units of its size."""
LETTER_FIXED = 0.61
"""The width of a character in a fixed-width font."""


class Tile(NamedTuple):
    """A part of a picture that stays in one piece: a narrow page shows fewer tiles side by side.

    `label` says in words what the tile shows, for screen readers. `starts_row`: it begins a row of its own.
    """

    width: int
    height: int
    body: str
    label: str
    starts_row: bool = False


def xml_text(text: object) -> str:
    """Return a text for XML: `<`, `&` and quotes are escaped, and characters that XML does not have become a dot.

    >>> xml_text("a < b\\x00")
    'a &lt; b·'
    """
    return escape(_NOT_XML.sub("·", str(text)))


def text_width(text: str, size: float = 13, *, fixed: bool = False) -> float:
    """Return about how many pixels wide a text is."""
    return len(text) * size * (LETTER_FIXED if fixed else _LETTER)


def text_lines(text: str, width: float, size: float = 13, *, fixed: bool = False) -> list[str]:
    """Return a text as lines that are at most `width` pixels wide; a longer word is cut.

    >>> text_lines("Read Holding Registers, 2 from 0000h", 150)
    ['Read Holding', 'Registers, 2 from', '0000h']
    """
    most = max(int(width / (size * (LETTER_FIXED if fixed else _LETTER))), 1)
    lines, line = [], ""
    for word in text.split():
        pieces = [word[start : start + most] for start in range(0, len(word), most)]
        for piece in pieces:
            if line and len(line) + 1 + len(piece) > most:
                lines.append(line)
                line = piece
            else:
                line = f"{line} {piece}" if line else piece
    return [*lines, line] if line else lines or [""]


def number_text(value: float) -> str:
    """Return a coordinate with at most one decimal."""
    return f"{value:.1f}".removesuffix(".0")


def text_wave(levels: Sequence[int], width: int, before: int = 1) -> list[str]:
    """Return the levels of bits as three lines of characters, `width` of them for each bit.

    >>> print(*text_wave((0, 1, 1, 0), 4), sep="\\n")
    .   .-------.
    |   |       |
    '---'       '---
    """
    lines = ["", "", ""]
    for level, previous in zip(levels, (before, *levels)):
        high, low = ("-", " ") if level else (" ", "-")
        edges = (".", "|", "'") if level != previous else (high, " ", low)
        for number, (edge, fill) in enumerate(zip(edges, (high, " ", low))):
            lines[number] += edge + (width - 1) * fill
    return [line.rstrip() for line in lines]


class Drawing:
    """Collects elements of SVG in order: later ones lie over earlier ones. `css` has the classes of an element."""

    def __init__(self) -> None:
        self._parts: list[str] = []

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self._parts)} parts>"

    def __str__(self) -> str:
        return "".join(self._parts)

    def _add(self, element: str, css: str, content: object = None, **attributes: float | str) -> None:
        values = "".join(
            f' {name}="{value if isinstance(value, str) else number_text(value)}"' for name, value in attributes.items()
        )
        ending = "/>" if content is None else f">{xml_text(content)}</{element}>"
        self._parts.append(f"<{element}{values}{_class(css)}{ending}")

    def text(self, x: float, y: float, text: object, css: str = "") -> None:
        """Add a text; `y` is its base line."""
        self._add("text", css, text, x=x, y=y)

    def row(self, places: Sequence[float], y: float, characters: str, css: str = "") -> None:
        """Add a row of single characters, each at its own place."""
        self._add("text", css, characters, x=" ".join(map(number_text, places)), y=y)

    def box(self, x: float, y: float, width: float, height: float, css: str = "", round_: float = 0) -> None:
        """Add a rectangle, with round corners of this radius."""
        corners = {"rx": round_} if round_ else {}
        self._add("rect", css, x=x, y=y, width=width, height=height, **corners)

    def dot(self, x: float, y: float, radius: float, css: str = "dot") -> None:
        """Add a disc."""
        self._add("circle", css, cx=x, cy=y, r=radius)

    def line(self, points: Sequence[tuple[float, float]], css: str = "l") -> None:
        """Add a line through points."""
        self._add("path", css, d="M" + "L".join(f"{number_text(x)} {number_text(y)}" for x, y in points))

    def vertical(self, x: float, top: float, bottom: float, css: str = "l") -> None:
        """Add a vertical line."""
        self._add("path", css, d=f"M{number_text(x)} {number_text(top)}V{number_text(bottom)}")

    def horizontal(self, y: float, left: float, right: float, css: str = "l") -> None:
        """Add a horizontal line."""
        self._add("path", css, d=f"M{number_text(left)} {number_text(y)}H{number_text(right)}")

    def wave(self, x: float, levels: Sequence[int], width: float, high: float, low: float, before: int = 1) -> None:
        """Add the levels of bits, each `width` wide, as one line; `before` is the level on the left of it."""
        path, previous = f"M{number_text(x)} {number_text(high if before else low)}", before
        for place, level in enumerate(levels, start=1):
            if level != previous:
                path += f"V{number_text(high if level else low)}"
            path, previous = f"{path}H{number_text(x + place * width)}", level
        self._add("path", "w", d=path)

    def arrow(self, x: float, y: float, direction: str, css: str = "tip") -> None:
        """Add the head of an arrow with its tip at (x, y); `direction` is "left", "right", "up" or "down"."""
        length, half = 9, 4.5
        across, down = {"left": (1, 0), "right": (-1, 0), "up": (0, 1), "down": (0, -1)}[direction]
        corners = [(x + across * length + down * half, y + down * length + across * half),
                   (x + across * length - down * half, y + down * length - across * half)]  # fmt: skip
        points = "L".join(f"{number_text(a)} {number_text(b)}" for a, b in [(x, y), *corners])
        self._add("path", css, d=f"M{points}Z")

    @contextmanager
    def group(self, css: str = "", label: str = "", *, focus: bool = False) -> Iterator[None]:
        """Put what is added inside into a group, with a label for screen readers, and `focus` from the keyboard."""
        said = f' role="img" aria-label="{xml_text(label)}"' if label else ""
        stop = ' tabindex="0"' if focus else ""
        self._parts.append(f"<g{_class(css)}{stop}{said}>")
        yield
        self._parts.append("</g>")


def _class(css: str) -> str:
    return f' class="{css}"' if css else ""
