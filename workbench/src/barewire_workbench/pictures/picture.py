"""A picture: one set of data with four forms, text, JSON, SVG and HTML.

        lines()      the picture in characters               for a terminal, and for readers without a screen
        as_dict()    its data                                for programs
        as_svg()     one file, its tiles in rows             for documents and slides
        as_html()    one page, its tiles in rows that fit    for a browser, with the text and the data below
                     the page

The SVG and the page need nothing but themselves: no script, no font, no other file. Parts that belong together light
each other up when the pointer is on one of them or the keyboard has chosen it, by rules of CSS (`:has`).
"""

from __future__ import annotations

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, Literal, get_args

from barewire.errors import EncodeError
from barewire_workbench.pictures.drawing import Tile, stylesheet, text_lines, themed, xml_text

PictureForm = Literal["text", "json", "html", "svg"]
PICTURE_FORMS: tuple[PictureForm, ...] = get_args(PictureForm)
"""The words of the option `--format`."""

_MARGIN = 16
SVG_WIDTH = 920
"""The width of an SVG, unless one tile is wider."""


class Picture(ABC):
    """A picture. A subclass has its data, and draws them in tiles.

    `title` is what the picture shows, in one line; `caption` is how to read it. `links` is the number of groups that
    light up together: their elements have the classes f0, f1, ...
    """

    kind: ClassVar[str]
    title: str
    caption: str
    links = 0

    @abstractmethod
    def lines(self) -> list[str]:
        """Return the picture in characters."""

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Return the data for `json.dumps`."""

    @abstractmethod
    def tiles(self) -> Sequence[Tile]:
        """Return the parts of the drawing."""

    @property
    def role(self) -> str:
        """The role of the drawing for a screen reader: a group if parts of it can be chosen, else one image."""
        return "group" if self.links else "img"

    def html_body(self) -> str:
        """Return the drawing as HTML, without title and caption."""
        tiles = "".join(
            ('<span class="break"></span>' if tile.starts_row else "")
            + f'<svg width="{tile.width}" height="{tile.height}" viewBox="0 0 {tile.width} {tile.height}" '
            f'role="{self.role}" aria-label="{xml_text(tile.label)}">{tile.body}</svg>'
            for tile in self.tiles()
        )
        return f'<div class="tiles" role="group" tabindex="0" aria-label="{xml_text(self.title)}">{tiles}</div>'

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.title}>"


def _link_rules(picture: Picture, scope: str) -> str:
    """Return the rules that light up what belongs to the part under the pointer, or chosen by the keyboard."""
    if not picture.links:
        return ""
    chosen = [f"{scope}:has(.f{number}:hover,.f{number}:focus)" for number in range(picture.links)]
    parts = ",".join(f"{part} .f{number}" for number, part in enumerate(chosen))
    boxes = ",".join(f"{part} rect.f{number}" for number, part in enumerate(chosen))
    outline = "{outline:2px solid @accent;outline-offset:-2px}"
    return themed(f"{parts}{outline}\n{boxes}{{stroke:@accent;stroke-width:2.5}}", scope)


def as_svg(picture: Picture) -> str:
    """Return the picture as one SVG file: title, tiles in rows, caption."""
    tiles = picture.tiles()
    width = max([SVG_WIDTH, *(tile.width + 2 * _MARGIN for tile in tiles)])
    y = _MARGIN + 18
    head = []
    for line in text_lines(picture.title, width - 2 * _MARGIN, 17):
        head.append(f'<text x="{_MARGIN}" y="{y}" class="title">{xml_text(line)}</text>')
        y += 22
    body, y = _rows(tiles, width, y, picture.role)
    for line in text_lines(picture.caption, width - 2 * _MARGIN):
        body.append(f'<text x="{_MARGIN}" y="{y + 14}" class="soft">{xml_text(line)}</text>')
        y += 18
    height = math.ceil(y + _MARGIN)
    style = stylesheet("svg.bw") + "\nsvg.bw .title{font-size:17px;font-weight:600}\n" + _link_rules(picture, "svg.bw")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="bw" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" role="{picture.role}" aria-labelledby="bw-title bw-desc">\n'
        f'<title id="bw-title">{xml_text(picture.title)}</title>\n'
        f'<desc id="bw-desc">{xml_text(" ".join([picture.caption, *(tile.label for tile in tiles[:_SAID])]))}</desc>\n'
        f"<style>{style}</style>\n"
        f'<rect class="paper" width="{width}" height="{height}"/>\n' + "\n".join([*head, *body]) + "\n</svg>\n"
    )


_SAID = 40
"""The most tiles whose labels the description of an SVG repeats."""


def _rows(tiles: Iterable[Tile], width: int, y: int, role: str) -> tuple[list[str], int]:
    """Return the tiles in rows, from `y` down, and the `y` below the last row."""
    parts: list[str] = []
    x, tallest = _MARGIN, 0
    for tile in tiles:
        if x > _MARGIN and (tile.starts_row or x + tile.width > width - _MARGIN):
            x, y, tallest = _MARGIN, y + tallest + 12, 0
        parts.append(
            f'<g transform="translate({x} {y})" role="{role}" aria-label="{xml_text(tile.label)}">{tile.body}</g>'
        )
        x, tallest = x + tile.width, max(tallest, tile.height)
    return parts, y + tallest + 8


_PAGE_SHAPES = """
html{color-scheme:light dark}
body{font:16px/1.5 system-ui,"Segoe UI",Roboto,"DejaVu Sans",sans-serif;padding:16px;max-width:1248px;margin:0 auto}
@media (max-width:640px){.bw .wide{display:none}.bw th,.bw td{padding:4px 6px 4px 2px}}
"""
"""Rules of a page of its own. Other pages, as those of the documentation, have theirs."""

_FIGURE_SHAPES = """
.bw{margin:0 0 32px}
.bw h1,.bw h2{font-size:1.25rem;margin:0 0 8px}
.bw .tiles{overflow-x:auto;display:flex;flex-wrap:wrap;row-gap:12px;align-items:flex-start;padding:4px 0}
.bw .tiles svg{flex:none}
.bw .break{flex-basis:100%}
.bw .scroll{overflow-x:auto}
.bw table{border-collapse:collapse;font-size:15px;margin:8px 0}
.bw th,.bw td{border-bottom:1px solid;padding:4px 10px 4px 6px;text-align:left;vertical-align:top}
.bw td.m,.bw th.m,.bw .bytes,.bw pre{font-family:ui-monospace,Menlo,Consolas,"DejaVu Sans Mono",monospace}
.bw pre{font-size:13px;line-height:1.35;overflow-x:auto;border:1px solid;padding:8px}
.bw summary{cursor:pointer;padding:4px 0}
.bw :focus-visible{outline:3px solid;outline-offset:1px}
.bw .bytes{display:flex;flex-wrap:wrap;gap:8px 4px;margin:8px 0}
.bw .bytes .field{border:1px solid;border-radius:4px;padding:2px 8px;text-align:center}
.bw .bytes .name{display:block;font:13px system-ui,"Segoe UI",Roboto,"DejaVu Sans",sans-serif}
.bw .bytes .hex{font-size:17px;overflow-wrap:anywhere}
.bw .number{display:inline-block;min-width:1.6em;text-align:center;border-radius:4px;font-weight:600}
.bw .verdict{font-weight:600;margin:8px 0;overflow-wrap:anywhere}
.bw td{overflow-wrap:anywhere}
.bw td.m{overflow-wrap:break-word}
.bw td:last-child{min-width:8em}
"""

_FIGURE_PAINTS = """
{s}{background:@paper;color:@ink}
{s} .soft{color:@soft}
{s} .good{color:@good}
{s} .bad{color:@bad}
{s} table,{s} th,{s} td{border-color:@grid}
{s} pre{border-color:@grid}
{s} a{color:@accent}
{s} :focus-visible{outline-color:@accent}
{s} .bytes .field{border-color:@line}
"""


def page_style(*, follows_page: bool = False) -> str:
    """Return the style sheet of `html_fragment`s; a page needs it once.

    With `follows_page` it leaves the rest of the page as it is, and follows its `data-theme`, as `drawing.themed` does.
    """
    page = [] if follows_page else [_PAGE_SHAPES, themed("body{margin:0;background:@paper;color:@ink}", "")]
    figures = themed(_FIGURE_PAINTS, ".bw", follows_page=follows_page)
    # The rules for narrow pages have the same weight as those of the figures, so they must stand behind them.
    return "\n".join([_FIGURE_SHAPES, *page, figures, stylesheet(".bw", follows_page=follows_page)])


def html_fragment(picture: Picture, mark: str = "bw-0", *, heading: int = 2) -> str:
    """Return the picture as an element `figure` for a page that has `page_style`.

    `mark` is its id on that page, `heading` the level of its title: h2.
    """
    rules = _link_rules(picture, f"#{mark}")
    style = f"<style>{rules}</style>" if rules else ""
    text = xml_text("\n".join(picture.lines()))
    # A "</script>" in a text would end the element.
    data = json.dumps(picture.as_dict(), ensure_ascii=False, default=str).replace("<", "\\u003c")
    return (
        f'<figure class="bw" id="{mark}" aria-labelledby="{mark}-title">{style}'
        f'<h{heading} id="{mark}-title">{xml_text(picture.title)}</h{heading}>{picture.html_body()}'
        f'<figcaption class="soft">{xml_text(picture.caption)}</figcaption>'
        f'<details><summary>As text</summary><pre tabindex="0">{text}</pre></details>'
        f'<script type="application/json" class="data">{data}</script></figure>'
    )


def as_html(*pictures: Picture) -> str:
    """Return one page with the pictures, one below the other. It loads nothing."""
    title = xml_text(pictures[0].title if pictures else "barewire")
    figures = "\n".join(
        html_fragment(picture, f"bw-{number}", heading=2 if number else 1) for number, picture in enumerate(pictures)
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta name="color-scheme" content="light dark">\n<title>{title}</title>\n<style>{page_style()}</style>\n'
        f"</head>\n<body>\n<main>\n{figures}\n</main>\n</body>\n</html>\n"
    )


def rendered(form: str, *pictures: Picture) -> str:
    """Return pictures in one form; of SVG, which has room for one, the first.

    Raises EncodeError for another form.
    """
    if form == "svg":
        return as_svg(pictures[0])
    if form == "html":
        return as_html(*pictures)
    if form == "json":
        return "\n".join(json.dumps(picture.as_dict(), ensure_ascii=False) for picture in pictures) + "\n"
    if form == "text":
        return "\n\n".join("\n".join([picture.title, "", *picture.lines()]) for picture in pictures) + "\n"
    raise EncodeError(f"format {form!r}: expected one of {', '.join(PICTURE_FORMS)}", "format")
