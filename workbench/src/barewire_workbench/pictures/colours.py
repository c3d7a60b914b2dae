"""The colours of the pictures, light and dark, and the style sheet that is made of them.

Every colour has a role. Text of one role is drawn only on the backgrounds that `TEXT_ON` lists, where its contrast is
at least 4.5 (WCAG 2.1, 1.4.3), and no meaning is carried by colour alone: parts also have numbers, names or patterns.

The style sheet states the light colours first and the dark ones in `@media (prefers-color-scheme: dark)`, without
variables: drawing programs that know neither still show the light picture.
"""

from __future__ import annotations

import re

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

    With `follows_page` an attribute `data-theme` of an element around the picture, "light" or "dark", is stronger than
    the setting of the system: pages of documentation have such a switch.

    >>> "@media (prefers-color-scheme:dark)" in stylesheet(".bw")
    True
    """
    light, dark = (painted(_PAINTS, scope, place) for place in (0, 1))
    rules = [_SHAPES.replace("{s}", scope), light, f"@media (prefers-color-scheme:dark){{{dark}}}"]
    if follows_page:
        rules += [painted(_PAINTS, f'[data-theme="{name}"] {scope}', place)
                  for place, name in enumerate(("light", "dark"))]  # fmt: skip
    return "\n".join(rule.strip() for rule in rules)


def painted(rules: str, scope: str, place: int) -> str:
    """Return rules of CSS with a scope for `{s}` and the colours for `@role`: light ones at place 0, dark ones at 1.

    >>> painted("{s} p{color:@ink}", ".bw", 1)
    '.bw p{color:#e8edf2}'
    """
    return re.sub(r"@(\w+)", lambda found: COLOURS[found[1]][place], rules.replace("{s}", scope)).strip()


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours, 1 to 21.   [WCAG 2.1, contrast ratio]

    >>> round(contrast("#000000", "#ffffff"))
    21
    """
    lighter, darker = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (lighter + 0.05) / (darker + 0.05)


def _luminance(colour: str) -> float:
    channels = [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in channels)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue
