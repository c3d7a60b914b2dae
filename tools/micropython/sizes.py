"""The sizes of editions as bytecode, and the table of them in docs/how-to/micropython.md."""

from __future__ import annotations

import re
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


def main(*, check: bool = False) -> int:
    """Write the table into the page. With `check` return 1 if the page is wrong by a tenth, as it is after many changes
    of the stack, or the first edition too large."""
    sizes = {parts: _size(parts) for parts in EDITIONS}
    names = {EDITIONS[-1]: "all of them"}
    rows = [(names.get(parts, f"`{parts}`"), *size) for parts, size in sizes.items()]
    lines = [f"| {name} | {modules} | {size:,} |" for name, modules, size in rows]
    table = "\n".join(["| parts | modules | bytes of bytecode |", "|---|--:|--:|", *lines]) + "\n"
    sys.stdout.write(table)
    head, rest = PAGE.read_text().split(BEGIN)
    said = [int(number.replace(",", "")) for number in re.findall(r" ([\d,]+) \|\n", rest.split(END)[0])]
    if not check:
        PAGE.write_text(head + BEGIN + "\n" + table + "\n" + END + rest.split(END)[1])
    elif any(abs(old - size) > size / 10 for old, (_, _, size) in zip(said, rows, strict=True)):
        sys.stdout.write(f"{PAGE.relative_to(ROOT)} has other sizes: python -m tools.micropython sizes\n")
        return 1
    if rows[0][2] > LARGEST:
        sys.stdout.write(f"{EDITIONS[0]}: more than {LARGEST} bytes of bytecode\n")
        return 1
    return 0
