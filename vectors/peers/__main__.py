"""Runs the adapter of one program in Python.

    barewire vectors check --adapter "python vectors/peers NAME"

NAME is a folder beside this file. Its main.py imports the modules of its own folder and those of shared/. If the
program is one that `python -m tools.peers build` makes, main.py is given the library or program, and its version.
"""

from __future__ import annotations

import runpy
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROGRAMS = {file.parent.name: file for file in sorted(HERE.glob("*/main.py"))}

if len(sys.argv) != 2 or sys.argv[1] not in PROGRAMS:
    sys.exit(f"vectors/peers: expected the name of a program: {', '.join(PROGRAMS)}")

program = PROGRAMS[sys.argv.pop(1)]
peer = tomllib.loads((program.parent / "peer.toml").read_text(encoding="utf-8"))
if "product" in peer:
    product = program.parent / "build" / peer["product"]
    if not product.exists():
        sys.exit(f"vectors/peers: {peer['name']} is not built: python -m tools.peers build {peer['name']}")
    sys.argv += [str(product), peer["version"]]
sys.path[:1] = [str(program.parent), str(HERE / "shared")]
runpy.run_path(str(program), run_name="__main__")
