"""Draws docs/pictures/*.svg with the commands that docs/reference/pictures.md names, and those of the course: run
`make pictures`. The screens of the terminal are drawn by `tools/screens.py`.

`tests/website/test_pictures_of_pages.py` fails when a picture is not the one that its command draws today.
"""

from __future__ import annotations

import shlex
import sys
from contextlib import chdir, redirect_stdout
from io import StringIO
from pathlib import Path

from barewire_workbench.cli.app import run_command_line
from tools.screens import SCREENS

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "docs" / "pictures"
PAGE = ROOT / "docs" / "reference" / "pictures.md"

COMMANDS = {
    "frame.svg": 'barewire explain rtu "01 03 04 00 17 00 07 0B F5" --format svg',
    "frame-broken.svg": 'barewire explain rtu "01 03 00 00 00 02 0B C4" --format svg',
    "frame-can.svg": 'barewire explain can "585#4B41600037060000" --format svg',
    "levels.svg": 'barewire explain rtu "01 03 00 00 00 02 C4 0B" --picture levels --format svg',
    "levels-ascii.svg": 'barewire explain ascii ":010300000002FA" --picture levels --format svg',
    "can-frame.svg": 'barewire explain can "605#4041600000000000" --picture levels --format svg',
    "exchange-modbus.svg": "barewire sniff line.log --format svg",
    "exchange-canopen.svg": "barewire vectors show sdo-blocks-1 --format svg",
    "registers.svg": "barewire steps float 1.1 --order CDAB --format svg",
    "path.svg": "barewire steps statusword 0250h 0231h 0233h 0237h --format svg",
    "states.svg": "barewire sniff drive.log --picture states --format svg",
}
"""File -> the command whose output it is, run in the folder of the pictures."""

COURSE = {
    "lab-01-character.svg": 'barewire explain rtu "41" --picture levels --line 19200,8N1 --format svg',
    "lab-02-parity.svg": 'barewire explain rtu "31" --picture levels --format svg',
    "lab-03-request.svg": 'barewire explain rtu "01 04 00 31 00 02 20 04" --format svg',
    "lab-04-frame.svg": 'barewire explain rtu "01 04 00 31 00 02 20 04" --picture levels --format svg',
    "lab-05-ascii.svg": 'barewire explain ascii ":010400310002C8" --format svg',
    "lab-05-tcp.svg": 'barewire explain tcp "00 01 00 00 00 06 01 04 00 31 00 02" --format svg',
    "lab-06-registers.svg": "barewire steps float 24.5 --order CDAB --format svg",
    "lab-07-bits.svg": 'barewire explain can "185#3706" --picture levels --format svg',
    "lab-07-sdo.svg": 'barewire explain can "605#4000100000000000" --format svg',
    "lab-08-node.svg": "barewire sniff node.log --format svg",
    "lab-09-states.svg": "barewire steps statusword 1270h 1231h 1233h 1637h --format svg",
    "lab-10-late.svg": "barewire sniff line-2.log --format svg",
}
"""The same for the pages of docs/tutorial. line-2.log is one of `barewire lab 10 recordings`."""

ALL = COMMANDS | COURSE


def drawn(command: str) -> str:
    """Return what a command prints."""
    output = StringIO()
    with chdir(FOLDER), redirect_stdout(output):
        status = run_command_line(shlex.split(command)[1:])
    if status:
        raise RuntimeError(f"{command}: exit status {status}")
    return output.getvalue()


def main() -> None:
    """Write every picture, and remove those without a command."""
    for name, command in ALL.items():
        (FOLDER / name).write_text(drawn(command), encoding="utf-8")
    for name, draw in SCREENS.items():
        (FOLDER / name).write_text(draw(), encoding="utf-8")
    for path in FOLDER.glob("*.svg"):
        if path.name not in ALL and path.name not in SCREENS:
            path.unlink()
    sys.stdout.write(f"docs/pictures: {len(ALL) + len(SCREENS)} pictures\n")


if __name__ == "__main__":
    main()
