"""The command: `python -m tools.micropython build rtu client coils registers --out edition`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tools.micropython import sizes, talks, vectors
from tools.micropython.build import FAMILIES, PARTS, Edition
from tools.micropython.sources import Unknown


def main() -> int:
    """Read the arguments and run a command."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.micropython", description="the small edition, for MicroPython"
    )
    commands = parser.add_subparsers(dest="command", required=True)
    build = commands.add_parser("build", help="write the files of an edition")
    build.add_argument("parts", nargs="+", metavar="PART", help=f"some of {' '.join((*PARTS, *FAMILIES))}")
    build.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="where its files go")
    build.add_argument("--bytecode", action="store_true", help="compile them, with mpy-cross")
    check = commands.add_parser("vectors", help="run the vectors on MicroPython, with two clocks")
    check.add_argument("--program", help="a MicroPython of this machine (default: the one in node)")
    measure = commands.add_parser("sizes", help="measure editions, and write the table into docs/how-to/micropython.md")
    measure.add_argument("--check", action="store_true", help="only compare it")
    talk = commands.add_parser("talks", help="serial lines to mbpoll and to barewire on CPython")
    talk.add_argument("--seconds", type=float, default=10.0, help="how long (default 10)")
    options = parser.parse_args()
    if options.command == "vectors":
        return vectors.main(options.program)
    if options.command == "talks":
        return talks.main(options.seconds)
    if options.command == "sizes":
        return sizes.main(check=options.check)
    try:
        edition = Edition(options.parts)
    except Unknown as error:
        parser.error(str(error))
    edition.write(options.out)
    if options.bytecode:
        sys.stdout.write(f"{sizes.compile_files(edition, options.out)} bytes of bytecode\n")
    sys.stdout.write(f"{len(edition.files)} modules in {options.out}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
