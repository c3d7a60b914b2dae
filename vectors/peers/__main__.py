"""Runs the adapter of one program in Python: `python vectors/peers NAME [ARGUMENTS]`.

NAME is a folder beside this file. Its main.py imports the modules of its own folder and those of shared/.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROGRAMS = {file.parent.name: file for file in sorted(HERE.glob("*/main.py"))}

if len(sys.argv) < 2 or sys.argv[1] not in PROGRAMS:
    sys.exit(f"vectors/peers: expected the name of a program: {', '.join(PROGRAMS)}")

program = PROGRAMS[sys.argv.pop(1)]
sys.path[:1] = [str(program.parent), str(HERE / "shared")]
runpy.run_path(str(program), run_name="__main__")
