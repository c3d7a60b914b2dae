"""Runs every example of the documentation.

In docstrings of both packages: each `>>>`, by doctest. In README.md, docs/ and the other Markdown files: each fenced
block, according to the word behind its three backticks.

    python    run as it is; with `>>>` in it, as a doctest. One namespace for the whole file, from top to bottom.
    console   each `$ barewire ...` is run and its output compared with the lines below it. A line `...` stands for
              any number of lines. Without lines below, its exit status must be 0. Other commands (pip, make, socat)
              are not run.
    sh        with a first line `# terminal N`: typed into a terminal by tests/test_terminals.py.
    output    behind such a block: what its commands print, compared there.
    others    are pictures, tables, data: not run.

The blocks of a file share an empty working directory, so one block can write a file that the next one reads. A block
that cannot run here has the reason in the line before it:

    <!-- test: skip (needs a drive on /dev/ttyUSB0) -->

A block with `<!-- test: needs NAME -->` before it runs where that package of Python is installed.
"""

from __future__ import annotations

import doctest
import importlib
import re
import shlex
import traceback
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.helpers import every_case
from tests.workbench.cli.helpers import run_here
from tools import rooms

pytestmark = pytest.mark.long

ROOT = Path(__file__).parent.parent
MODULES = {name: file for name, file in rooms.files().items() if ">>> " in file.read_text(encoding="utf-8")}
PAGES = [
    *ROOT.glob("*.md"),
    *ROOT.glob("workbench/*.md"),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "vectors").glob("*.md")),
]


def named(file: Path) -> str:
    return file.relative_to(ROOT).as_posix()


# Docstrings ------------------------------------------------------------------------------------------------------


@every_case("name", MODULES)
def test_docstring_examples_run(name: str) -> None:
    module = importlib.import_module(name)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    output: list[str] = []
    for example in doctest.DocTestFinder(exclude_empty=True).find(module, name):
        runner.run(example, out=output.append)
    assert runner.tries, f"{named(MODULES[name])}: contains >>> but no docstring that doctest can find"
    assert not runner.failures, "\n" + "".join(output)


# Markdown --------------------------------------------------------------------------------------------------------


class Block(NamedTuple):
    """One fenced block: the word behind the backticks, the line of the file where its text begins, the text."""

    language: str
    line: int
    text: str
    skip: bool


def blocks(page: str) -> Iterator[Block]:
    fence, language, start, skip = "", "", 0, False
    held: list[str] = []
    for number, line in enumerate(page.splitlines(), start=1):
        opening = re.match(r" {0,3}(```+|~~~+)\s*(\w*)", line)
        if fence:
            if line.strip() == fence:
                yield Block(language, start, "\n".join(held) + "\n", skip)
                fence, skip = "", False
            else:
                held.append(line)
        elif opening:
            fence, language, start, held = opening[1], opening[2], number + 1, []
        elif line.strip():
            needed = re.match(r"<!-- test: needs (\w+)", line.strip())
            skip = find_spec(needed[1]) is None if needed else line.strip().startswith("<!-- test: skip")


def run_python(block: Block, page: str, names: dict[str, Any]) -> str:
    """Run a block; return the error as text, or an empty text."""
    if re.search(r"^\s*>>> ", block.text, re.MULTILINE):
        output: list[str] = []
        runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
        example = doctest.DocTestParser().get_doctest(block.text, names, page, page, block.line - 1)
        runner.run(example, out=output.append, clear_globs=False)
        names.update(example.globs)  # doctest works on a copy
        return "".join(output)
    try:
        # Empty lines before it, so that a traceback counts lines as the page does.
        exec(compile("\n" * (block.line - 1) + block.text, page, "exec", dont_inherit=True), names)
    except Exception as error:
        lines = [entry.lineno for entry in traceback.extract_tb(error.__traceback__) if entry.filename == page]
        if isinstance(error, SyntaxError) and error.filename == page:
            lines.append(error.lineno)
        shown = "".join(traceback.format_exception_only(error)).strip()
        return f"{page}:{lines[-1] if lines else block.line}: {shown}\n"
    return ""


class Command(NamedTuple):
    line: int
    words: list[str]
    expected: list[str]


def commands(block: Block) -> Iterator[Command]:
    """Yield each `$ ` line (continued after a backslash) with the output below it."""
    lines = list(enumerate(block.text.splitlines(), start=block.line))
    while lines:
        number, typed = lines.pop(0)
        if not typed.startswith("$ "):
            continue
        while typed.endswith("\\") and lines:
            typed = typed[:-1] + lines.pop(0)[1].removeprefix("> ")
        expected = []
        while lines and not lines[0][1].startswith("$ "):
            expected.append(lines.pop(0)[1].rstrip())
        while expected and not expected[-1]:
            expected.pop()
        yield Command(number, shlex.split(typed[2:], comments=True), expected)


def fits(expected: list[str], got: list[str]) -> bool:
    """Return whether the lines are equal; an expected line `...` matches any number of lines."""
    pattern = "".join("(.*\n)*?" if line.strip() == "..." else re.escape(line) + "\n" for line in expected)
    return re.fullmatch(pattern, "".join(line + "\n" for line in got)) is not None


def run_console(block: Block, page: str) -> str:
    """Run the barewire commands of a block; return the error as text, or an empty text."""
    # A terminal of 100 columns without colours, the same on every machine.
    terminal = {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb", "PYTHONUTF8": "1"}
    for line, words, expected in commands(block):
        if words[:1] != ["barewire"]:
            continue
        if {"|", ">", ">>", "<", "&", "&&", ";"} & set(words):
            return f"{page}:{line}: no shell runs this, so no pipes: write the command alone, or mark the block\n"
        try:
            run = run_here(*words[1:], environment=terminal, one_stream=True)
        except TimeoutError as error:
            return f"{page}:{line}: {error}\n"
        got = [line.rstrip() for line in run.stdout.rstrip().splitlines()]
        if not fits(expected, got) if expected else run.returncode != 0:
            return (
                f"{page}:{line}: $ {shlex.join(words)}\n"
                + "".join(f"  page  | {line}\n" for line in expected)
                + "".join(f"  really| {line}\n" for line in got)
                + f"  (exit status {run.returncode})\n"
            )
    return ""


def run_page(text: str, page: str) -> str:
    """Run all blocks of a page in order and in the current directory; return all errors as text."""
    names: dict[str, Any] = {"__name__": "__page__"}
    wrong = ""
    for block in blocks(text):
        if block.skip:
            continue
        if block.language in ("python", "pycon"):
            wrong += run_python(block, page, names)
        elif block.language == "console":
            wrong += run_console(block, page)
        elif block.text.lstrip().startswith(">>> "):
            wrong += f"{page}:{block.line}: an example that is not run; begin the block with ```python\n"
    return wrong


@pytest.mark.parametrize("file", PAGES, ids=named)
def test_examples_of_a_page_run(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    wrong = run_page(file.read_text(encoding="utf-8"), named(file))
    assert not wrong, "\n" + wrong


@every_case("file", PAGES)
def test_links_of_a_page_lead_to_files(file: Path) -> None:
    """Each link to a file of this repository has an existing target."""
    gone = []
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1):
        for target in re.findall(r"\]\(([^)#\s]+)", line):
            if "://" not in target and not target.startswith("mailto:") and not (file.parent / target).exists():
                gone.append(f"{named(file)}:{number}: {target} is not there")
    assert not gone, "\n" + "\n".join(gone)


MAPS = [ROOT / "ARCHITECTURE.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs" / "explanation").glob("*.md"))]
TREE = [
    f"/{named(file)}"
    for top in ("src", "workbench", "tests", "tools", "bench", "docs", "vectors", ".ci")
    for file in (ROOT / top).rglob("*")
    if "node_modules" not in file.parts
]


@pytest.mark.parametrize("file", MAPS, ids=named)
def test_files_named_on_a_map_exist(file: Path) -> None:
    """Each `room/file.py` of a page that leads through the code is the end of a path."""
    paths = re.findall(r"`([\w./-]+\.(?:py|toml|json))`", file.read_text(encoding="utf-8"))
    assert not [path for path in paths if not any(entry.endswith(f"/{path}") for entry in TREE)]


SCRIPTS = ["Makefile", "pyproject.toml", ".ci/run", "tests/pyodide/run"]
BUILT = ("/build", ".egg-info")
"""What `make clean` removes."""


@pytest.mark.parametrize("script", SCRIPTS)
def test_paths_in_a_script_exist(script: str) -> None:
    text = (ROOT / script).read_text(encoding="utf-8")
    # The braces of a shell: tests/workbench/{frames,steps} are two paths.
    text = re.sub(r"([\w./-]+/)\{([\w,]+)\}", lambda m: " ".join(m[1] + name for name in m[2].split(",")), text)
    paths = re.findall(r"(?<![\w./{}])(?:src|workbench|tests|tools|bench|docs|vectors|\.ci)/[\w./*-]+", text)
    assert not [path for path in paths if not path.endswith(BUILT) and not any(ROOT.glob(path.rstrip("/.")))]


# The functions above ---------------------------------------------------------------------------------------------

GOOD_PAGE = """\
```python
def double(number):
    return 2 * number
```

```python
>>> double(21)
42
>>> seen = double(4)
```

<!-- test: skip (needs hardware) -->

```python
raise OSError
```

```python
assert seen == 8
```

```text
>> a picture
```
"""


def test_blocks_share_one_namespace() -> None:
    assert run_page(GOOD_PAGE, "page.md") == ""
    assert [block.skip for block in blocks(GOOD_PAGE)] == [False, False, True, False, False]


@pytest.mark.parametrize(
    ("page", "reported"),
    [
        ("text\n\n```python\none = 1\nassert one == 2\n```\n", "page.md:5: AssertionError"),
        ("```python\none =\n```\n", "page.md:2:"),
        ("text\n```python\n>>> 1 + 1\n3\n```\n", 'File "page.md", line 3'),
        ("```\n>>> 1 + 1\n2\n```\n", "page.md:2: an example that is not run"),
        ("```console\n$ barewire explain | less\n```\n", "page.md:2: no shell runs this"),
        ("```console\n$ make x\n$ barewire \\\n    no-such-command\n```\n", "page.md:3: $ barewire no-such-command"),
        ("```console\n$ barewire --help\nsurprise\n```\n", "page.md:2: $ barewire --help\n  page  | surprise"),
    ],
)  # fmt: skip
def test_a_wrong_example_is_reported(page: str, reported: str) -> None:
    assert reported in run_page(page, "page.md")


def test_dots_stand_for_any_number_of_lines() -> None:
    assert fits(["a", "...", "d"], ["a", "b", "c", "d"])
    assert fits(["a", "..."], ["a"])
    assert not fits(["a", "...", "d"], ["a", "b"])
    assert not fits(["a.c"], ["abc"])
    assert not fits(["a"], ["a", "b"])
