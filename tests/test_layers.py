"""Which room may import which, checked against every import in src/barewire, and the size of files and folders.

An import counts wherever it stands: at the top, inside a function, under `TYPE_CHECKING`, or as a string given to
`import_module`. To allow a new arrow, change ALLOWED and give the reason in docs/explanation/decisions.md.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import pytest

import barewire
from tools import rooms

ROOT = Path(__file__).parent.parent
SRC = ROOT / "src"
HOME = SRC / "barewire"
FILES = sorted(HOME.rglob("*.py"))

BASE = {"errors", "conversation", "codecs", "_callbacks", "_lazy", "_html"}
PROTOCOLS = {"modbus", "rtu", "ascii", "tcp", "canopen"}
MEANING = BASE | PROTOCOLS | {"devices"}

# room -> what it may import besides itself. "modbus.adu" means that module only, "modbus" the whole room.
ALLOWED: dict[str, set[str]] = {
    "errors": set(),
    "_lazy": set(),
    "_html": set(),
    "_callbacks": {"errors"},
    "conversation": {"errors"},
    "codecs": {"errors"},
    "modbus": BASE,
    "canopen": BASE,
    "rtu": BASE | {"modbus.adu", "modbus.framing", "modbus.messages"},
    "ascii": BASE | {"modbus.adu", "modbus.framing"},
    "tcp": BASE | {"modbus.adu", "modbus.framing"},
    "devices": BASE | {"modbus", "canopen"},
    "explain": MEANING,
    "vectors": MEANING | {"explain"},
    "io": MEANING | {"explain", "vectors"},
    "cli": MEANING
    | {"explain", "vectors", "io", *barewire.__all__},  # what the front door offers, a command may take there
    "__init__": MEANING | {"io"},  # the front door: names of all rooms, each loaded when it is first used
    "__main__": {"cli"},
}

# Rooms that may use clocks and sockets. Below them, time is an argument and bytes are passed in.
OUTSIDE = {"io", "cli", "__main__"}
CLOCKS_AND_SOCKETS = {
    *("time", "sched", "random", "secrets", "logging", "signal"),
    *("socket", "socketserver", "select", "selectors", "ssl", "serial", "can"),
    *("threading", "asyncio", "concurrent", "multiprocessing", "subprocess"),
}

# The only third-party packages, and the files that may import them.
THIRD_PARTY = {
    "serial": "io/ports/*serial*.py",
    "can": "io/*.py",
    "click": "cli/*.py",
    "rich": "cli/*.py",
    "matplotlib": "cli/plot.py",
}

# Libraries that do what barewire is written to do. Tests and bench compare with them; src must not use them.
FIELDBUS_LIBRARIES = {
    *("pymodbus", "minimalmodbus", "umodbus", "modbus_tk", "pyModbusTCP", "tmodbus", "async_modbus", "modbus"),
    *("canopen", "canmatrix", "cantools", "eds_utils", "crcmod", "crcmodplus", "fastcrc", "crc", "crccheck"),
    *("crcengine", "libscrc", "construct", "bitstring", "bitstruct"),
}


def imports(source: str, module: str, is_package: bool) -> Iterator[tuple[int, str]]:
    """Yield every (line, dotted name) that the source imports, relative ones resolved against `module`."""
    package = module.split(".") if is_package else module.split(".")[:-1]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            start = ".".join([*above, *([node.module] if node.module else [])])
            yield from ((node.lineno, f"{start}.{alias.name}") for alias in node.names)
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in ("import_module", "__import__") and isinstance(node.args[0].value, str):
                yield node.lineno, node.args[0].value


def within(name: str, allowed: set[str]) -> bool:
    return any(name == room or name.startswith(room + ".") for room in allowed)


def broken_rules(source: str, path: str) -> list[str]:
    """Return what the file `path` (relative to src/barewire) must not import, each with the rule that it breaks."""
    parts = ("barewire", *path.removesuffix(".py").split("/"))
    is_package = parts[-1] == "__init__"
    module = ".".join(parts[:-1] if is_package else parts)
    room = "explain" if parts[1].startswith("explain") else parts[1]
    if room not in ALLOWED:
        return [f"{path}:1: the room {room!r} is not in ALLOWED of tests/test_layers.py"]
    found = []
    for line, name in sorted(imports(source, module, is_package)):
        top, _, rest = name.partition(".")
        rule = ""
        if top == "barewire":
            if not within(rest, {room, *ALLOWED[room]} - {"__init__"}):
                rule = f"{room} may import {', '.join(sorted(ALLOWED[room])) or 'nothing of barewire'}"
        elif top in FIELDBUS_LIBRARIES:
            rule = "no fieldbus or checksum library in src"
        elif room not in OUTSIDE and top in CLOCKS_AND_SOCKETS:
            rule = "clocks, sockets, threads, random numbers and logs are for io and cli only"
        elif top in THIRD_PARTY:
            if not fnmatch(path, THIRD_PARTY[top]):
                rule = f"{top} belongs in {THIRD_PARTY[top]}"
        elif top not in sys.stdlib_module_names:
            rule = f"the standard library only, and {', '.join(THIRD_PARTY)} in their files"
        if rule:
            found.append(f"{path}:{line}: imports {name} -- {rule}")
    return found


def test_every_import_is_allowed() -> None:
    found: list[str] = []
    for file in FILES:
        found += broken_rules(file.read_text(encoding="utf-8"), file.relative_to(HOME).as_posix())
    assert not found, "src/barewire/" + "\nsrc/barewire/".join(found)


def oversized(root: Path) -> list[str]:
    """Return the Python files with more than 400 lines, and the folders of `src` with more than 16 of them."""
    found = []
    for top in ("src", "tests", "tools", "bench"):
        files = sorted((root / top).rglob("*.py"))
        for file in files:
            lines = len(file.read_text(encoding="utf-8").splitlines())
            if lines > 400:
                found.append(f"{file.relative_to(root).as_posix()}: {lines} lines, at most 400")
        for folder, count in Counter(file.parent for file in files).items():
            if top == "src" and count > 16:
                found.append(f"{folder.relative_to(root).as_posix()}: {count} files, at most 16")
    return found


def test_files_have_at_most_400_lines_and_folders_of_src_16_files() -> None:
    assert oversized(ROOT) == []


def test_a_long_file_and_a_full_folder_are_found(tmp_path: Path) -> None:
    for top in ("src", "tests", "tools", "bench"):
        folder = tmp_path / top / "room"
        folder.mkdir(parents=True)
        (folder / "whole.py").write_text("\n" * 400)
        (folder / "long.py").write_text("\n" * 401)
        for number in range(14):
            (folder / f"file_{number}.py").touch()
    long = [f"{top}/room/long.py: 401 lines, at most 400" for top in ("src", "tests", "tools", "bench")]
    assert oversized(tmp_path) == long
    for top in ("src", "tests"):
        (tmp_path / top / "room" / "one_more.py").touch()
    assert oversized(tmp_path) == [long[0], "src/room: 17 files, at most 16", *long[1:]]


HEAVY = [
    *("asyncio", "dataclasses", "inspect", "socket", "ssl", "threading", "logging", "subprocess"),
    *("serial", "can", "click", "rich"),
]


@pytest.mark.parametrize("room", ["codecs", "rtu", "ascii", "tcp"])
def test_importing_a_room_of_bytes_loads_no_heavy_module(room: str) -> None:
    """A program that only needs frames loads nothing else.

    `-S -E` keeps out what an environment loads by itself (path hooks, coverage).
    """
    look = f"import sys; sys.path.insert(0, {str(SRC)!r}); import barewire.{room}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-S", "-E", "-c", look], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    loaded = set(run.stdout.split())
    too_heavy = [name for name in HEAVY if name in loaded]
    assert not too_heavy, f"import barewire.{room} loads {', '.join(too_heavy)}"
    ours = sorted(name.split(".")[1] for name in loaded if name.startswith("barewire."))
    other_rooms = set(ours) - {room, "modbus", *BASE}
    assert not other_rooms, f"import barewire.{room} loads the rooms {', '.join(sorted(other_rooms))}"


def test_no_files_import_each_other() -> None:
    """Directly or by way of others; imports inside functions and for type checking count."""
    assert rooms.circles(rooms.file_imports()) == []


def test_no_rooms_import_each_other() -> None:
    assert [rooms.circles(rooms.rooms(room)) for room in ("", *rooms.INSIDE)] == [[]] * (1 + len(rooms.INSIDE))


def test_the_drawing_in_architecture_is_up_to_date() -> None:
    assert rooms.PAGE.read_text(encoding="utf-8") == rooms.page(), "run python tools/rooms.py"


def test_circles_are_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": {"e"}, "e": {"d"}, "f": {"a"}}
    assert sorted(rooms.circles(graph)) == [["a", "b", "c"], ["d", "e"]]


# Every rule is seen to fail -------------------------------------------------------------------------------------------

REFUSED = {
    "errors import nothing": ("errors.py", "from barewire import codecs"),
    "codecs import no protocol": ("codecs/order.py", "from barewire.modbus.adu import Adu"),
    "codecs import no conversations": ("codecs/order.py", "import barewire.conversation"),
    "modbus imports no framing": ("modbus/client/bus.py", "from barewire.rtu import frame"),
    "modbus imports no framing, relative": ("modbus/client/bus.py", "from ...tcp.line import TcpLine"),
    "modbus imports no canopen": ("modbus/client/bus.py", "from ...canopen.frame import CanFrame"),
    "canopen imports no modbus": ("canopen/sdo/client/upload.py", "from ....modbus import Bus"),
    "a framing imports no other": ("ascii/line.py", "from ..rtu import crc"),
    "a framing imports no server": (
        "rtu/line.py",
        "from barewire.modbus.server.server import Server",
    ),
    "a framing imports no whole room": ("rtu/line.py", "from barewire.modbus import Adu"),
    "only rtu imports messages": ("tcp/line.py", "from barewire.modbus.messages import registry"),
    "devices import no framing": ("devices/plan.py", "from barewire.rtu.line import RtuLine"),
    "devices import no io": ("devices/sim/az3/machine.py", "from barewire.io.engine import blocking"),
    "explain imports no io": ("explain/api.py", "from ..io import endpoint"),
    "explain imports no cli": ("explain/modbus/frames.py", "from ...cli import table"),
    "io imports no cli": ("io/engine/blocking.py", "from barewire.cli import main"),
    "the front door offers no command": ("__init__.py", "from .cli import main"),
    "an unknown room": ("profinet/frame.py", "import struct"),
    "no clock": ("modbus/client/bus.py", "import time"),
    "no clock, from": ("canopen/nmt/heartbeat.py", "from time import monotonic"),
    "no asyncio, inside a function": ("rtu/timing.py", "def now():\n    import asyncio"),
    "no logging, for types only": ("devices/description/load.py", "if TYPE_CHECKING:\n    from logging import Logger"),
    "no socket, as a string": ("tcp/frame.py", "import importlib\nimportlib.import_module('socket')"),
    "no threads, as a submodule": ("devices/description/load.py", "import concurrent.futures"),
    "pyserial in its file only": ("io/engine/blocking.py", "import serial"),
    "pyserial in its file only, cli": ("cli/read.py", "from serial.tools import list_ports"),
    "python-can in io only": ("cli/scan.py", "import can"),
    "click in cli only": ("io/ports/trace.py", "import click"),
    "rich in cli only": ("explain/api.py", "from rich.table import Table"),
    "no other third party": ("io/engine/asyncio.py", "import trio"),
    "no fieldbus library": ("io/gateway.py", "from pymodbus.client import ModbusTcpClient"),
    "no canopen of PyPI": ("io/ports/can/python_can.py", "import canopen"),
    "no checksum library": ("rtu/crc.py", "import crcmod.predefined"),
}

ACCEPTED = {
    "the standard library": ("codecs/layout.py", "from __future__ import annotations\nimport struct, re, enum"),
    "its own room": ("rtu/line.py", "from barewire.rtu.frame import decode\nfrom .crc import crc16"),
    "its own door": ("canopen/sdo/__init__.py", "from .messages import X\nfrom .client import upload"),
    "errors for all": ("tcp/frame.py", "from barewire.errors import DecodeError\nfrom .. import errors"),
    "adu and framing for a framing": ("ascii/line.py", "from ..modbus.adu import Adu\nfrom ..modbus import framing"),
    "messages for rtu": ("rtu/line.py", "from barewire.modbus.messages.registry import length"),
    "ports for io": ("io/ports/serial.py", "import serial\nimport time\nfrom serial.tools import list_ports"),
    "click and rich for commands": ("cli/read.py", "import click\nfrom rich.table import Table\nfrom ..io import x"),
    "everything below for io": ("io/gateway.py", "from barewire import rtu, canopen, devices\nimport can"),
    "the command": ("__main__.py", "from barewire.cli import main"),
}  # fmt: skip


@pytest.mark.parametrize(("path", "source"), REFUSED.values(), ids=REFUSED)
def test_a_wrong_import_is_found(path: str, source: str) -> None:
    (found,) = broken_rules(source, path)
    assert found.startswith(f"{path}:{len(source.splitlines()) if 'profinet' not in path else 1}: ")


@pytest.mark.parametrize(("path", "source"), ACCEPTED.values(), ids=ACCEPTED)
def test_an_allowed_import_is_accepted(path: str, source: str) -> None:
    assert broken_rules(source, path) == []
