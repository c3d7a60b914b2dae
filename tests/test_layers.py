"""Who may import whom: the picture of ARCHITECTURE.md as a dict, held against every import in src/barewire.

Read here is what the source says, wherever it says it: at the top, inside a function, under `TYPE_CHECKING`, or
as a string given to `import_module`. Whoever needs an arrow that is not in the picture changes the picture, and
says why in ARCHITECTURE.md.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import pytest

SRC = Path(__file__).parent.parent / "src"
HOME = SRC / "barewire"
FILES = sorted(HOME.rglob("*.py"))

BASE = {"errors", "conversation", "codecs", "_lazy", "frozen", "record"}
PROTOCOLS = {"modbus", "rtu", "ascii", "tcp", "canopen"}
MEANING = BASE | PROTOCOLS | {"devices"}

# room -> what it may import besides itself. "modbus.adu" means that module only, "modbus" the whole room.
PICTURE: dict[str, set[str]] = {
    "errors": set(),
    "_lazy": set(),
    "frozen": set(),
    "record": set(),
    "conversation": {"errors", "record"},
    "codecs": {"errors", "record"},
    "modbus": BASE,
    "canopen": BASE,
    "rtu": BASE | {"modbus.adu", "modbus.framing", "modbus.messages"},
    "ascii": BASE | {"modbus.adu", "modbus.framing"},
    "tcp": BASE | {"modbus.adu", "modbus.framing"},
    "devices": BASE | {"modbus", "canopen"},
    "explain": MEANING,
    "io": MEANING | {"explain"},
    "cli": MEANING | {"explain", "io", "__version__"},
    "__init__": {"errors", "conversation"},  # the map: loaded before every room, so it loads none
    "__main__": {"cli"},
}

# Rooms with clocks, sockets and a face. Below them time is an argument, and bytes come in from outside.
OUTSIDE = {"io", "cli", "__main__"}
CLOCKS_AND_SOCKETS = {
    *("time", "sched", "random", "secrets", "logging", "signal"),
    *("socket", "socketserver", "select", "selectors", "ssl", "serial", "can"),
    *("threading", "asyncio", "concurrent", "multiprocessing", "subprocess"),
}

# The only third-party names, and the files that may say them.
DOORS = {
    "serial": "io/ports/*serial*.py",
    "can": "io/*.py",
    "click": "cli/*.py",
    "rich": "cli/*.py",
    "matplotlib": "cli/plot.py",
}

# Whatever does our work for us. In tests and bench they are peers and referees; in src they would be a crutch.
CRUTCHES = {
    *("pymodbus", "minimalmodbus", "umodbus", "modbus_tk", "pyModbusTCP", "tmodbus", "async_modbus", "modbus"),
    *("canopen", "canmatrix", "cantools", "eds_utils", "crcmod", "crcmodplus", "fastcrc", "crc", "crccheck"),
    *("crcengine", "libscrc", "construct", "bitstring", "bitstruct"),
}


def imports(source: str, module: str, is_package: bool) -> Iterator[tuple[int, str]]:
    """Every (line, dotted name) that the source imports, relative ones resolved against `module`."""
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
    return any(name == one or name.startswith(one + ".") for one in allowed)


def broken_rules(source: str, path: str) -> list[str]:
    """What the file `path` (relative to src/barewire) must not import, one line each, with the rule it breaks."""
    parts = ("barewire", *path.removesuffix(".py").split("/"))
    is_package = parts[-1] == "__init__"
    module = ".".join(parts[:-1] if is_package else parts)
    room = "explain" if parts[1].startswith("explain") else parts[1]
    if room not in PICTURE:
        return [f"{path}:1: the room {room!r} is not in the picture (PICTURE in tests/test_layers.py)"]
    found = []
    for line, name in sorted(imports(source, module, is_package)):
        top, _, rest = name.partition(".")
        rule = ""
        if top == "barewire":
            if not within(rest, {room, *PICTURE[room]} - {"__init__"}):
                rule = f"{room} may import {', '.join(sorted(PICTURE[room])) or 'nothing of barewire'}"
        elif top in CRUTCHES:
            rule = "no fieldbus or checksum library in src: we do that work ourselves"
        elif room not in OUTSIDE and top in CLOCKS_AND_SOCKETS:
            rule = "clocks, sockets, threads, chance and logs live in io and cli only"
        elif top in DOORS:
            if not fnmatch(path, DOORS[top]):
                rule = f"{top} belongs in {DOORS[top]}"
        elif top not in sys.stdlib_module_names:
            rule = f"the standard library only ({', '.join(DOORS)} at their doors)"
        if rule:
            found.append(f"{path}:{line}: imports {name} -- {rule}")
    return found


def test_every_import_is_in_the_picture() -> None:
    found: list[str] = []
    for file in FILES:
        found += broken_rules(file.read_text(encoding="utf-8"), file.relative_to(HOME).as_posix())
    assert not found, "src/barewire/" + "\nsrc/barewire/".join(found)


def test_no_file_has_more_than_400_lines() -> None:
    counts = {file: len(file.read_text(encoding="utf-8").splitlines()) for file in FILES}
    long = [f"{file.relative_to(SRC.parent)}: {lines} lines" for file, lines in counts.items() if lines > 400]
    assert not long, "more than 400 lines, time for two files:\n" + "\n".join(long)


HEAVY = [
    *("asyncio", "dataclasses", "inspect", "socket", "ssl", "threading", "logging", "subprocess"),
    *("serial", "can", "click", "rich"),
]


@pytest.mark.parametrize("room", ["codecs", "rtu", "ascii", "tcp"])
def test_light_rooms_stay_light(room: str) -> None:
    """A small machine that only wants the frames does not pay for anything else.

    `-S -E` keeps out what an environment loads by itself (path hooks, coverage), so that only our imports are seen.
    """
    assert (HOME / room / "__init__.py").exists(), f"the room {room} has no door yet"
    look = f"import sys; sys.path.insert(0, {str(SRC)!r}); import barewire.{room}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-S", "-E", "-c", look], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    loaded = set(run.stdout.split())
    too_heavy = [name for name in HEAVY if name in loaded]
    assert not too_heavy, f"import barewire.{room} loads {', '.join(too_heavy)}"
    ours = sorted(name.split(".")[1] for name in loaded if name.startswith("barewire."))
    strangers = set(ours) - {room, "modbus", *BASE}
    assert not strangers, f"import barewire.{room} loads the rooms {', '.join(sorted(strangers))}"


# Every rule can fail -------------------------------------------------------------------------------------------

BAD = {
    "errors know nobody": ("errors.py", "from barewire import codecs"),
    "codecs never heard of a protocol": ("codecs/order.py", "from barewire.modbus.adu import Adu"),
    "codecs hold no conversations": ("codecs/order.py", "import barewire.conversation"),
    "modbus knows no envelope": ("modbus/client/bus.py", "from barewire.rtu import frame"),
    "modbus knows no envelope, relative": ("modbus/client/bus.py", "from ...tcp.line import TcpLine"),
    "modbus and canopen are strangers": ("modbus/client/exchange.py", "from ...canopen.frame import CanFrame"),
    "canopen and modbus are strangers": ("canopen/sdo/client/upload.py", "from ....modbus import ask"),
    "envelopes are strangers": ("ascii/line.py", "from ..rtu import crc"),
    "an envelope does not read letters": (
        "rtu/line.py",
        "from barewire.modbus.server.server import Server",
    ),
    "an envelope does not use the door": ("rtu/line.py", "from barewire.modbus import Adu"),
    "only rtu counts": ("tcp/line.py", "from barewire.modbus.messages import registry"),
    "devices know no envelope": ("devices/plan.py", "from barewire.rtu.line import RtuLine"),
    "devices know no shell": ("devices/sim/az3/machine.py", "from barewire.io.engine import blocking"),
    "explain knows no shell": ("explain/api.py", "from ..io import endpoint"),
    "an explain package is the same room": ("explain/modbus/frames.py", "from ...cli import table"),
    "io know no command": ("io/engine/blocking.py", "from barewire.cli import main"),
    "the map loads no room": ("__init__.py", "from .modbus import ask"),
    "a new room is drawn first": ("profinet/frame.py", "import struct"),
    "time is an argument": ("modbus/client/bus.py", "import time"),
    "time is an argument, from": ("canopen/nmt/heartbeat.py", "from time import monotonic"),
    "inside a function": ("rtu/timing.py", "def now():\n    import asyncio"),
    "for types only": ("devices/description/load.py", "if TYPE_CHECKING:\n    from logging import Logger"),
    "as a string": ("tcp/frame.py", "import importlib\nimportlib.import_module('socket')"),
    "as a submodule": ("devices/description/load.py", "import concurrent.futures"),
    "serial has one door": ("io/engine/blocking.py", "import serial"),
    "serial has one door, cli": ("cli/read.py", "from serial.tools import list_ports"),
    "can is for io": ("cli/scan.py", "import can"),
    "click is for commands": ("io/ports/trace.py", "import click"),
    "rich is for commands": ("explain/api.py", "from rich.table import Table"),
    "no other third party": ("io/engine/asyncio.py", "import trio"),
    "no fieldbus library": ("io/gateway.py", "from pymodbus.client import ModbusTcpClient"),
    "the canopen of PyPI": ("io/ports/python_can.py", "import canopen"),
    "no checksum library": ("rtu/crc.py", "import crcmod.predefined"),
}

GOOD = {
    "the standard library": ("codecs/layout.py", "from __future__ import annotations\nimport struct, re, enum"),
    "its own room": ("rtu/line.py", "from barewire.rtu.frame import decode\nfrom .crc import crc16"),
    "its own door": ("canopen/sdo/__init__.py", "from .messages import X\nfrom .client import upload"),
    "errors for all": ("tcp/frame.py", "from barewire.errors import DecodeError\nfrom .. import errors"),
    "adu and line for envelopes": ("ascii/line.py", "from ..modbus.adu import Adu\nfrom ..modbus import framing"),
    "functions for rtu": ("rtu/line.py", "from barewire.modbus.messages.registry import length"),
    "ports for io": ("io/ports/serial.py", "import serial\nimport time\nfrom serial.tools import list_ports"),
    "a face for commands": ("cli/read.py", "import click\nfrom rich.table import Table\nfrom ..io import endpoint"),
    "everything below for io": ("io/gateway.py", "from barewire import rtu, canopen, devices\nimport can"),
    "the way in": ("__main__.py", "from barewire.cli import main"),
}  # fmt: skip


@pytest.mark.parametrize(("path", "source"), BAD.values(), ids=BAD)
def test_a_wrong_import_is_found(path: str, source: str) -> None:
    (found,) = broken_rules(source, path)
    assert found.startswith(f"{path}:{len(source.splitlines()) if 'profinet' not in path else 1}: ")


@pytest.mark.parametrize(("path", "source"), GOOD.values(), ids=GOOD)
def test_an_allowed_import_is_accepted(path: str, source: str) -> None:
    assert broken_rules(source, path) == []
