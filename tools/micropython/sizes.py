"""The sizes of editions as bytecode, and the table of them in docs/how-to/micropython.md."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from tools.micropython.build import FAMILIES, PARTS, Edition
from tools.micropython.sources import ROOT

PAGE = ROOT / "docs" / "how-to" / "micropython.md"
BEGIN, END = "<!-- sizes: made by python -m tools.micropython sizes -->\n", "<!-- end of sizes -->"
EDITIONS = (
    "rtu client coils registers",
    "rtu server coils registers",
    "rtu client server coils registers",
    "ascii client coils registers",
    "tcp client coils registers",
    "tcp server coils registers",
    "sdo",
    " ".join((*PARTS, *FAMILIES)),
)
LARGEST = 40_000
"""Bytes of bytecode that the first edition may have."""


def compile_files(edition: Edition, folder: Path) -> int:
    """Put bytecode in the place of the files of an edition, and return its bytes."""
    total = 0
    for path in edition.files:
        source, target = folder / path, (folder / path).with_suffix(".mpy")
        subprocess.run([_mpy_cross(), "-s", path, "-o", str(target), str(source)], check=True)
        source.unlink()
        total += target.stat().st_size
    return total


def _size(parts: str) -> tuple[int, int]:
    """Return the number of modules of an edition, and the bytes of their bytecode."""
    edition = Edition(parts.split())
    with tempfile.TemporaryDirectory() as folder:
        edition.write(Path(folder))
        return len(edition.files), compile_files(edition, Path(folder))


def _mpy_cross() -> str:
    """Return the compiler of the package mpy-cross, which is beside this Python."""
    beside = Path(sys.executable).with_name("mpy-cross")
    return str(beside) if beside.exists() else "mpy-cross"


def table() -> str:
    """Return the table of all editions."""
    rows = [(parts, *_size(parts)) for parts in EDITIONS]
    lines = ["| parts | modules | bytes of bytecode |", "|---|--:|--:|"]
    names = {EDITIONS[-1]: "all of them"}
    lines += [f"| {names.get(parts, f'`{parts}`')} | {modules} | {size:,} |" for parts, modules, size in rows]
    if rows[0][2] > LARGEST:
        raise SystemExit(f"{rows[0][0]}: {rows[0][2]} bytes of bytecode, more than {LARGEST}")
    return "\n".join(lines) + "\n"


def main(*, check: bool = False) -> int:
    """Write the table into the page, or with `check` only compare it. Return 1 if it differs."""
    text = PAGE.read_text()
    head, rest = text.split(BEGIN)
    now = head + BEGIN + "\n" + table() + "\n" + END + rest.split(END)[1]
    if check and now != text:
        sys.stdout.write(f"{PAGE.relative_to(ROOT)} has other sizes: python -m tools.micropython sizes\n")
        return 1
    PAGE.write_text(now)
    sys.stdout.write(table())
    return 0
