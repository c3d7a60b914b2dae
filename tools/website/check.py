"""Checks the HTML of the site: what a page loads comes from the site itself, and every link inside it has a target.

    how-to/tls.html: loads https://fonts.example/x.woff2       scripts, styles, images, fonts, frames
    how-to/tls.html: tsl.html is not there                     a page or a file
    how-to/tls.html: endpoints.html#optoins is not there       an anchor in a page

A link to another server is no request: a reader follows it or not. `make docs-links` asks whether it is alive.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_LOADS = {"src", "srcset", "poster", "data"}
"""Attributes whose URL a browser loads at once; `href` too, of a `link` element or in a drawing."""
_LOADED_LINKS = ("stylesheet", "icon", "preload", "prefetch", "preconnect", "dns-prefetch", "manifest", "modulepreload")
_IN_STYLE = re.compile(r"(?:url\(\s*['\"]?|@import\s+['\"])((?:https?:)?//[^'\")\s]+)")


class _Page(HTMLParser):
    """What one page loads, where its links lead, and its anchors."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.loads: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self._in_style = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self._in_style = tag == "style"
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        self.loads += [given[name] for name in _LOADS & given.keys() if not given[name].startswith("data:")]
        self.loads += _IN_STYLE.findall(given.get("style", ""))
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag in ("use", "image") and "href" in given:
            self.loads.append(given["href"])
        elif tag == "link" and any(word in given.get("rel", "").split() for word in _LOADED_LINKS):
            self.loads.append(given.get("href", ""))

    def handle_endtag(self, tag: str) -> None:
        if tag == "style":
            self._in_style = False

    def handle_data(self, data: str) -> None:
        if self._in_style:
            self.loads += _IN_STYLE.findall(data)


def faults(site: Path) -> list[str]:
    """Return a line for each fault of a built site."""
    pages: dict[str, _Page] = {}
    found = []
    for file in sorted(site.rglob("*")):
        name = file.relative_to(site).as_posix()
        if file.suffix == ".html":
            pages[name] = _Page()
            pages[name].feed(file.read_text(encoding="utf-8"))
        elif file.suffix == ".css":
            found += [f"{name}: loads {url}" for url in _IN_STYLE.findall(file.read_text(encoding="utf-8"))]
    for name, page in pages.items():
        found += [f"{name}: loads {url}" for url in page.loads if urlsplit(url).netloc]
        here = [url for url in [*page.loads, *page.links] if not urlsplit(url).netloc and not urlsplit(url).scheme]
        found += [f"{name}: {url} is not there" for url in _dead(name, here, pages, site)]
    return found


def _dead(name: str, urls: list[str], pages: dict[str, _Page], site: Path) -> Iterator[str]:
    for url in dict.fromkeys(urls):
        parts = urlsplit(url)
        file = (site / name).parent / unquote(parts.path) if parts.path else site / name
        if file.is_dir():
            file /= "index.html"
        if not file.exists():
            yield url
        elif parts.fragment and file.suffix == ".html":
            there = pages.get(file.resolve().relative_to(site.resolve()).as_posix())
            if there and unquote(parts.fragment) not in there.anchors:
                yield url
