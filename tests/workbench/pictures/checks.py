"""Checks that every picture passes: well-formed, self-contained, the same data in every form."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from xml.etree import ElementTree

from barewire_workbench.pictures.picture import Picture, as_html, as_svg

SVG = "{http://www.w3.org/2000/svg}"
_VOID = {"meta", "br", "rect", "path", "circle"}


class _Page(HTMLParser):
    """Reads a page: its elements must be closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str, str | None]] = []
        self.texts: list[str] = []
        self.data = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value) for name, value in attrs]
        if tag not in _VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in _VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            self.data += data
        elif self.open and self.open[-1] != "style":
            self.texts.append(data)


def svg_texts(picture: Picture) -> list[str]:
    """Check the SVG of a picture, and return its texts."""
    text = as_svg(picture)
    root = ElementTree.fromstring(text)
    assert root.tag == f"{SVG}svg"
    assert root.findtext(f"{SVG}title") == picture.title
    assert root.findtext(f"{SVG}desc")
    assert_self_contained(text)
    width, height = float(root.get("width", "0")), float(root.get("height", "0"))
    for element in root.iter():
        assert not {"fill", "stroke", "style"} & set(element.attrib), "colours are in the style sheet only"
    assert width >= 300
    assert height >= 60
    return [element.text or "" for element in root.iter(f"{SVG}text")]


def html_texts(picture: Picture) -> list[str]:
    """Check the page of a picture, and return its texts."""
    text = as_html(picture)
    page = _Page()
    page.feed(text)
    page.close()
    assert page.open == []
    assert json.loads(page.data) == json.loads(json.dumps(picture.as_dict()))
    assert_self_contained(text)
    ids = [value for _, name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    assert {name for _, name, _ in page.attributes} >= {"lang", "aria-labelledby", "aria-label"}
    return page.texts


def assert_self_contained(text: str) -> None:
    """Nothing is loaded: no address but the name of the SVG name space, no reference of CSS or HTML."""
    text = text.replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?:|//\w|url\(|@import|\ssrc=|\shref=|<link|<image|<use", text)


def check(picture: Picture) -> None:
    """Check every form of a picture."""
    svg_texts(picture)
    html_texts(picture)
    assert all("\n" not in line and line == line.rstrip() for line in picture.lines())
    assert repr(picture)


def contrast(text: str, background: str) -> float:
    """Return the contrast of two colours, 1 to 21.   [WCAG 2.1, contrast ratio]

    >>> round(contrast("#000000", "#ffffff"))
    21
    """
    lighter, darker = sorted((_luminance(text), _luminance(background)), reverse=True)
    return (lighter + 0.05) / (darker + 0.05)


def _luminance(colour: str) -> float:
    channels = [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in channels)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue
