"""The check of the built HTML reports every request to another server, and every link without a target."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.website.check import faults


def site(folder: Path, body: str, style: str = "") -> Path:
    (folder / "sub").mkdir()
    (folder / "sub" / "there.html").write_text('<h1 id="top">There</h1><a name="old"></a>')
    (folder / "site.css").write_text(style)
    (folder / "index.html").write_text(f"<!doctype html><html><body>{body}</body></html>")
    return folder


@pytest.mark.parametrize(
    "body",
    [
        '<a href="sub/there.html#top">x</a> <a href="sub/there.html#old">x</a> <a href="site.css">x</a>',
        '<a href="https://example.org/x.html">a reader may follow it</a> <a href="mailto:a@example.org">x</a>',
        '<h2 id="here">x</h2><a href="#here">x</a> <a href="#">x</a>',
        '<img src="data:image/png;base64,AA"> <link rel="stylesheet" href="site.css">',
        '<link rel="canonical" href="https://example.org/">',
    ],
)
def test_good_pages_have_no_fault(body: str, tmp_path: Path) -> None:
    assert faults(site(tmp_path, body)) == []


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ('<script src="https://cdn.example/a.js"></script>', "index.html: loads https://cdn.example/a.js"),
        ('<img src="//cdn.example/a.png">', "index.html: loads //cdn.example/a.png"),
        ('<link rel="preconnect" href="https://f.example">', "index.html: loads https://f.example"),
        ('<link rel="icon" href="https://f.example/i">', "index.html: loads https://f.example/i"),
        ('<style>@import "https://f.example/f.css";</style>', "index.html: loads https://f.example/f.css"),
        ('<p style="background: url(https://f.example/b)">', "index.html: loads https://f.example/b"),
        ('<a href="their.html">x</a>', "index.html: their.html is not there"),
        ('<a href="sub/there.html#bottom">x</a>', "index.html: sub/there.html#bottom is not there"),
        ('<a href="#gone">x</a>', "index.html: #gone is not there"),
        ('<img src="gone.svg">', "index.html: gone.svg is not there"),
    ],
)
def test_a_fault_is_reported(body: str, fault: str, tmp_path: Path) -> None:
    assert faults(site(tmp_path, body)) == [fault]


def test_a_style_sheet_loads_nothing_from_elsewhere(tmp_path: Path) -> None:
    font = "@font-face { src: url('https://fonts.example/x.woff2') }"
    assert faults(site(tmp_path, "", font)) == ["site.css: loads https://fonts.example/x.woff2"]
