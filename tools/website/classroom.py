"""Makes the material of a class from the labs: `python -m tools.website.classroom` writes build/site/class.

    docs/tutorial/03-….md  ---.---  03-….html         the page as screens to project, one step on each
    LABS[3]: tasks  ----------+---  03-…-sheet.html   the tasks with room to write, and what to look up: A4, to print
    LABS[3]: solutions  -----------  solutions.md     a page of the site: each solution as the command checks it

Each page is one file that loads nothing, so that it can be copied to any computer and opened there. A library for
slides was weighed (reveal.js, and sphinx-revealjs around it): it brings transitions, notes and themes, which a lab does
not need, and does not make an output of 25 lines fit the screen, which it does. class.js has the keys and that.
"""

from __future__ import annotations

import re
import sys
from base64 import b64encode
from collections.abc import Iterator
from html import escape
from math import inf
from pathlib import Path
from typing import NamedTuple

from markdown_it import MarkdownIt
from markdown_it.token import Token

from barewire_workbench.cli.labs import LABS
from barewire_workbench.cli.labs.model import Lab, LabExercise
from tools.pictures import drawn
from tools.website.source import ROOT

TARGET = ROOT / "build" / "site" / "class"
SOLUTIONS = "class/solutions.md"
TABLE_PLACE = (
    "The table of the labs, with the screens and the sheet of each, is on this page of the site: "
    "`make docs`, then `build/site/how-to/teach.html`."
)
_PAGES = ROOT / "docs" / "tutorial"
_STATIC = ROOT / "docs" / "_static"

_ROOM = 13.0
"""Lines of text that fit a screen in large type."""
_COLUMNS = 100
"""Longer lines of a block are continued below."""
_WRITING_LINES = 3
_FIXED = re.compile(
    r"`([^`]+)`|((?:\b[0-9A-F]{2} ){2,}[0-9A-F]{2}\b|\b[0-9A-F]{3}#[0-9A-F]+\b|\b(?:[01] ){3,}[01]\b|\b[01]{8,}\b)"
)
"""What stands in fixed type in a task: commands, frames, bits."""
_LIVE = {"9.5": ["barewire drive rtu:///tmp/az3 az3 move 3000 --velocity 60000 --enable"], "10.4": []}
"""Exercises whose machine must run, and what to type before the check."""


class Block(NamedTuple):
    """A paragraph, list, table, picture or block of code of a page."""

    html: str
    lines: float
    """How many lines of text it is as high as; infinite for the list of the exercises, which is not shown."""
    language: str = ""
    leads_on: bool = False
    """Ends with a colon: it belongs to the block behind it."""


class Section(NamedTuple):
    """A heading of a page with what is below it."""

    title: str
    blocks: list[Block]


def sections(lab: Lab) -> list[Section]:
    """Return the page of a lab, read from its Markdown."""
    markdown = MarkdownIt("commonmark").enable("table")
    for kind, rule in (("fence", _fence), ("image", _image)):
        markdown.add_render_rule(kind, rule)
    found: list[Section] = []
    for tokens in _top_level(markdown.parse((_PAGES / lab.page).read_text(encoding="utf-8"))):
        for link in (child for token in tokens for child in token.children or [] if child.type == "link_open"):
            link.attrSet("href", _address(str(link.attrGet("href"))))
        html = markdown.renderer.render(tokens, markdown.options, {})
        first = tokens[0]
        if first.type == "heading_open":
            found.append(Section(re.sub(r"</?h.>", "", html).strip(), []))
        elif first.type == "table_open":
            found[-1].blocks.append(Block(f'<div class="table-wrapper">{html}</div>', 1.2 * html.count("<tr>")))
        elif first.type == "fence":
            lists_exercises = first.content.startswith(f"$ barewire lab {lab.number}\n")
            lines = inf if lists_exercises else _code_lines(first.content)
            found[-1].blocks.append(Block(html, lines, first.info.strip()))
        elif first.type != "html_block":
            text = "".join(token.content for token in tokens if token.type == "inline")
            lines = sum(map(_picture_lines, re.findall(r"!\[.*?\]\((.*?)\)", text)))
            lines = lines or len(text) / 75 + 0.6 * html.count("<li>") + 0.8
            found[-1].blocks.append(Block(html, lines, leads_on=text.endswith(":")))
    return found


def _address(link: str) -> str:
    """Return a link of a page of the course as one from here: to the screens of a lab, to other pages of the site."""
    if "://" in link:
        return link
    folder = "" if "/" in link or link in (lab.page for lab in LABS.values()) else "../tutorial/"
    return folder + re.sub(r"\.md(?=#|$)", ".html", link)


def _top_level(tokens: list[Token]) -> Iterator[list[Token]]:
    held: list[Token] = []
    for token in tokens:
        held.append(token)
        if token.level == 0 and token.nesting <= 0:
            yield held
            held = []


def _fence(renderer: object, tokens: list[Token], at: int, options: object, env: object) -> str:
    return _code(tokens[at].content)


def _code(text: str) -> str:
    columns = min(_COLUMNS, max(map(len, text.splitlines())))
    shown = re.sub(r"^\$ .*$", lambda command: f"<b>{command[0]}</b>", escape(text.rstrip(), quote=False), flags=re.M)
    return f'<div class="highlight"><pre style="--columns:{columns}">{shown}</pre></div>\n'


def _code_lines(text: str) -> float:
    """Return the height of a block, whose type is smaller the longer its lines are."""
    lines = text.splitlines()
    size = min(0.8, 65 / min(_COLUMNS, max(map(len, lines))))
    return 1 + size * sum(1 + len(line) // (_COLUMNS + 1) for line in lines)


def _image(renderer: object, tokens: list[Token], at: int, options: object, env: object) -> str:
    token = tokens[at]
    data = b64encode((_PAGES / str(token.attrGet("src"))).read_bytes()).decode()
    return f'<img src="data:image/svg+xml;base64,{data}" alt="{escape(token.content)}">'


def _picture_lines(path: str) -> float:
    width, height = re.findall(r'(?:width|height)="(\d+)"', (_PAGES / path).read_text(encoding="utf-8"))[:2]
    return 28 * int(height) / int(width)


def screens(lab: Lab) -> list[tuple[str, str]]:
    """Return the screens of a lab: title and content of each. The list of the exercises becomes a screen for each."""
    found = []
    for section in sections(lab):
        for part, blocks in enumerate(_portions(section.blocks), 1):
            if blocks[0].lines == inf:
                found += [(f"Exercise {exercise.number}", _exercise(lab, exercise)) for exercise in lab.exercises]
            else:
                number = f" <span>{part}</span>" if part > 1 else ""
                found.append((section.title + number, "".join(block.html for block in blocks)))
    return found


def _portions(blocks: list[Block]) -> Iterator[list[Block]]:
    """Yield as many blocks as fit a screen; one with a colon at its end stays with the next one."""
    held: list[Block] = []
    for block in blocks:
        if held and sum(other.lines for other in [*held, block]) > _ROOM:
            leading = [held.pop()] if held[-1].leads_on else []
            if held:
                yield held
            held = leading
        held.append(block)
    if held:
        yield held


def _exercise(lab: Lab, exercise: LabExercise) -> str:
    form = f'<p class="form">answer: {escape(exercise.form, quote=False)}</p>'
    command = _code(f"barewire lab {lab.number} check {exercise.number} ANSWER")
    return f'<p class="task">{_task(exercise)}</p>\n{form}\n{command}'


def _task(exercise: LabExercise) -> str:
    """Return the text of a task with frames and commands in fixed type."""
    return _FIXED.sub(lambda found: f"<code>{found[1] or found[2]}</code>", escape(exercise.task, quote=False))


def projected(lab: Lab) -> str:
    """Return the page to project."""
    pages = screens(lab)
    parts = []
    for number, (title, content) in enumerate(pages, 1):
        heading = f"h{1 if number == 1 else 2}"
        keys = "arrow keys; F: full screen; " if number == 1 else ""
        place = f'<p class="at">{keys}{number} / {len(pages)}</p>'
        parts.append(f'<section id="{number}">\n<{heading}>{title}</{heading}>\n{content}{place}\n</section>\n')
    return _page(f"Lab {lab.number}: {lab.title}", "screens", "".join(parts), "site.js", "class.js")


def sheet(lab: Lab) -> str:
    """Return the sheet to print: the tasks, and the drawings and tables of the page."""
    parts = [
        '<p class="name">Name <span></span> Date <span></span></p>\n',
        f"<h1>Lab {lab.number}: {lab.title}</h1>\n<p>{lab.goal}</p>\n",
        *(f"<p>In a terminal: <code>{escape(command, quote=False)}</code></p>\n" for command in lab.devices),
    ]
    for exercise in lab.exercises:
        form = escape(exercise.form, quote=False)
        check = f"<code>barewire lab {lab.number} check {exercise.number} ANSWER</code>"
        room = '<div class="room"></div>' * _WRITING_LINES
        parts.append(
            f'<div class="task"><h2>{exercise.number}</h2><p>{_task(exercise)} <i>Answer: {form}.</i></p>\n'
            f"{room}<p>{check}</p></div>\n"
        )
    parts.append("<h2>To look up</h2>\n")
    for section in sections(lab):
        shown = [block.html for block in section.blocks if block.language == "text" or "<table>" in block.html]
        parts += [f"<h3>{section.title}</h3>\n", *shown] if shown else []
    return _page(f"Lab {lab.number}, sheet", "sheet", "".join(parts), "site.js")


def _page(title: str, kind: str, content: str, *scripts: str) -> str:
    return (
        f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>\n{_static('class.css')}</style>\n"
        f'<body class="{kind}">\n<main>\n{content}</main>\n'
        f"<script>\n{''.join(map(_static, scripts))}</script>\n</body>\n</html>\n"
    )


def _static(name: str) -> str:
    return (_STATIC / name).read_text(encoding="utf-8")


def solutions() -> str:
    """Return the page of the solutions. Each is checked while it is written; a wrong one is a RuntimeError."""
    lines = [
        *("---", "orphan: true", "nosearch: true", "---", "", "# Solutions", ""),
        "One solution of each exercise, as the command checks it. Only [Teach a class](../how-to/teach.md) links here.",
        "",
    ]
    for lab in LABS.values():
        lines += [f"## {lab.number}. {lab.title}", ""]
        for exercise in lab.exercises:
            command = f'barewire lab {lab.number} check {exercise.number} "{exercise.solution}"'
            lines += [f"**{exercise.number}** {exercise.task}", ""]
            if exercise.number in _LIVE:
                lines += ["```sh", "# terminal 1: until Ctrl-C", lab.devices[-1], "```", ""]
                lines += ["```sh", "# terminal 2", *_LIVE[exercise.number], command, "```", ""]
            else:
                lines += ["```console", f"$ {command}", drawn(command).rstrip(), "```", ""]
    return "\n".join(lines)


def table() -> str:
    """Return the table of the teacher's page: each lab with its minutes and its two pages."""
    rows = ["| lab | minutes | exercises | | |", "|---|---|---|---|---|"]
    for lab in LABS.values():
        name = lab.page.removesuffix(".md")
        to_project = f'<a href="../class/{name}.html">to project</a>'
        to_print = f'<a href="../class/{name}-sheet.html">to print</a>'
        page = f"[{lab.number}. {lab.title}](../tutorial/{lab.page})"
        rows.append(f"| {page} | {lab.minutes} | {len(lab.exercises)} | {to_project} | {to_print} |")
    return "\n".join(rows)


def build(target: Path = TARGET) -> None:
    """Write both pages of each lab."""
    target.mkdir(parents=True, exist_ok=True)
    for lab in LABS.values():
        name = lab.page.removesuffix(".md")
        (target / f"{name}.html").write_text(projected(lab), encoding="utf-8")
        (target / f"{name}-sheet.html").write_text(sheet(lab), encoding="utf-8")


if __name__ == "__main__":
    build()
    sys.stdout.write(f"{TARGET.relative_to(ROOT)}: {len(LABS)} labs to project and to print\n")
