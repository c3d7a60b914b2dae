"""Which room may import which, checked against every import of both packages.

`barewire`, the stack, imports nothing of `barewire_workbench`. An import counts wherever it stands: at the top, inside
a function, under `TYPE_CHECKING`, or as a string given to `import_module`. To allow a new arrow, change STACK or
WORKBENCH and give the reason in docs/explanation/decisions.md.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from fnmatch import fnmatch

import pytest

import barewire
from tests.helpers import every_case
from tools import rooms

SRC = rooms.HOUSES["barewire"]

BASE = {"errors", "conversation", "codecs", "_callbacks", "_lazy", "_html"}
PROTOCOLS = {"modbus", "rtu", "ascii", "tcp", "canopen"}
MEANING = BASE | PROTOCOLS | {"devices"}

# room -> what it may import besides itself. "modbus.adu" means that module only, "modbus" the whole room.
STACK: dict[str, set[str]] = {
    "errors": set(),
    "_lazy": set(),
    "_html": set(),
    "_callbacks": {"errors"},
    "conversation": {"errors"},
    "codecs": {"errors", "_lazy"},
    "modbus": BASE,
    "canopen": BASE,
    "rtu": BASE | {"modbus.adu", "modbus.framing", "modbus.messages"},
    "ascii": BASE | {"modbus.adu", "modbus.framing"},
    "tcp": BASE | {"modbus.adu", "modbus.framing"},
    "devices": BASE | {"modbus", "canopen"},
    "io": MEANING,
    "gateway": MEANING | {"io"},
    "__init__": MEANING | {"io"},  # the front door: names of all rooms, each loaded when it is first used
    "__main__": set(),  # it finds the command by its name among the installed ones
}
FROM_STACK = {f"barewire.{room}" for room in MEANING}
# what the front door offers, a command may take there
FROM_STACK_AND_PORTS = FROM_STACK | {"barewire.gateway", "barewire.io"}
FROM_STACK_AND_PORTS |= {f"barewire.{name}" for name in barewire.__all__}
WORKBENCH: dict[str, set[str]] = {
    "sniffer": set(),
    "frames": {"sniffer"},
    "wire": set(),
    "conform": set(),
    "scan": set(),
    "settings": {"eds"},
    "eds": set(),
    "recordings": {"frames", "sniffer"},
    "steps": {"frames", "wire"},
    "monitor": {"frames", "recordings"},
    "diagnosis": {"frames", "monitor", "recordings", "sniffer", "wire"},
    "pictures": {"frames", "monitor", "recordings", "sniffer", "steps", "wire"},
    "replay": {"frames", "monitor", "recordings", "sniffer"},
    "ascii_gateway": set(),
    "vectors": {"ascii_gateway", "conform", "recordings"},
    "vendor": set(),
    "api": {"diagnosis", "frames", "recordings"},
    "value_log": set(),
    "live": {"ascii_gateway", "conform", "scan", "settings", "sniffer", "value_log", "vectors"},
    "__init__": {"api", "frames"},
}
OFFERED = {"explain", "explain_exchange", "explain_text", "Explanation", "FrameRole", "__version__"}  # by its door
WORKBENCH["cli"] = OFFERED | set(WORKBENCH) - {"__init__"}

ALLOWED = {f"barewire.{room}": {f"barewire.{other}" for other in below} for room, below in STACK.items()}
for room, below in WORKBENCH.items():
    stack = FROM_STACK_AND_PORTS if room in ("live", "cli") else FROM_STACK
    ALLOWED[f"barewire_workbench.{room}"] = stack | {f"barewire_workbench.{other}" for other in below}

# Rooms that may use clocks and sockets. Below them, time is an argument and bytes are passed in.
OUTSIDE = {"barewire.io", "barewire.gateway", "barewire_workbench.live", "barewire_workbench.cli"}
CLOCKS_AND_SOCKETS = {
    *("time", "sched", "random", "secrets", "logging", "signal"),
    *("socket", "socketserver", "select", "selectors", "ssl", "serial", "can"),
    *("threading", "asyncio", "concurrent", "multiprocessing", "subprocess"),
}

# The only third-party packages, and the files that may import them.
PORT_LIST = "barewire_workbench/live/ports.py"
THIRD_PARTY = {
    "serial": ("barewire/io/ports/*serial*.py", PORT_LIST),
    "can": ("barewire/io/*.py", PORT_LIST),
    "aiomqtt": ("barewire/gateway/publish/publisher.py",),
    "microdot": ("barewire/gateway/page.py", "barewire_workbench/cli/panels/server.py"),
    "prometheus_client": ("barewire/gateway/status.py",),
    "click": ("barewire_workbench/cli/*.py",),
    "rich": ("barewire_workbench/cli/*.py",),
    "textual": ("barewire_workbench/cli/terminal/*.py",),
    "matplotlib": ("barewire_workbench/cli/plot.py",),
}

# Libraries that do what barewire is written to do. Tests and bench compare with them; the packages must not use them.
FIELDBUS_LIBRARIES = {
    *("pymodbus", "minimalmodbus", "umodbus", "modbus_tk", "pyModbusTCP", "tmodbus", "async_modbus", "modbus"),
    *("canopen", "canmatrix", "cantools", "eds_utils", "crcmod", "crcmodplus", "fastcrc", "crc", "crccheck"),
    *("crcengine", "libscrc", "construct", "bitstring", "bitstruct"),
}


def imports(nodes: Iterable[ast.AST], module: str, is_package: bool) -> Iterator[tuple[int, str]]:
    """Yield every (line, dotted name) that the nodes import, relative ones resolved against `module`."""
    package = module.split(".") if is_package else module.split(".")[:-1]
    for node in nodes:
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


def broken_rules(nodes: Iterable[ast.AST], path: str) -> list[str]:
    """Return what the file `path`, such as barewire/rtu/crc.py, must not import, each with the rule that it breaks."""
    parts = path.removesuffix(".py").split("/")
    is_package = parts[-1] == "__init__"
    module = ".".join(parts[:-1] if is_package else parts)
    room = ".".join(parts[:2])
    if room not in ALLOWED:
        return [f"{path}:1: the room {room!r} is not in STACK or WORKBENCH of tests/test_layers.py"]
    found = []
    for line, name in sorted(imports(nodes, module, is_package)):
        top = name.partition(".")[0]
        rule = ""
        if top in rooms.HOUSES:
            if not within(name, {room, *ALLOWED[room]}):
                rule = f"{room} may import {', '.join(sorted(ALLOWED[room])) or 'nothing of ours'}"
        elif top in FIELDBUS_LIBRARIES:
            rule = "no fieldbus or checksum library in the packages"
        elif room not in OUTSIDE and top in CLOCKS_AND_SOCKETS:
            rule = "clocks, sockets, threads, random numbers and logs are for io, live and cli only"
        elif top in THIRD_PARTY:
            if not any(fnmatch(path, files) for files in THIRD_PARTY[top]):
                rule = f"{top} belongs in {' and '.join(THIRD_PARTY[top])}"
        elif top not in sys.stdlib_module_names:
            rule = f"the standard library only, and {', '.join(THIRD_PARTY)} in their files"
        if rule:
            found.append(f"{path}:{line}: imports {name} -- {rule}")
    return found


def test_every_import_is_allowed() -> None:
    found: list[str] = []
    for module, file in rooms.files().items():
        path = file.relative_to(rooms.HOUSES[module.partition(".")[0]])
        if len(path.parts) > 1:
            found += broken_rules(rooms.loading_nodes(file), path.as_posix())
    assert not found, "\n".join(found)


def test_a_package_names_each_of_its_files() -> None:
    """The docstring of a package is the reading order of its files."""
    missing = []
    for module, file in rooms.files().items():
        if file.name != "__init__.py":
            continue
        order = set(re.findall(r"\w+", ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""))
        inside = {name.rpartition(".")[2] for name in rooms.files() if name.rpartition(".")[0] == module}
        missing += [f"{module}: {name}" for name in inside - order if not name.startswith("_")]
    assert not missing


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
    drawn = [*rooms.INSIDE, *(f"{package}.{room}" for package, inside in rooms.INSIDE.items() for room in inside)]
    assert {package: rooms.circles(rooms.rooms(package)) for package in drawn} == {package: [] for package in drawn}


def test_the_drawing_in_architecture_is_up_to_date() -> None:
    assert rooms.PAGE.read_text(encoding="utf-8") == rooms.page(), "run python tools/rooms.py"


def test_circles_are_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": {"e"}, "e": {"d"}, "f": {"a"}}
    assert sorted(rooms.circles(graph)) == [["a", "b", "c"], ["d", "e"]]


# Every rule is seen to fail -------------------------------------------------------------------------------------------

REFUSED = {
    "errors import nothing": ("barewire/errors.py", "from barewire import codecs"),
    "codecs import no protocol": ("barewire/codecs/order.py", "from barewire.modbus.adu import Adu"),
    "codecs import no conversations": ("barewire/codecs/order.py", "import barewire.conversation"),
    "modbus imports no framing": ("barewire/modbus/client/bus.py", "from barewire.rtu import frame"),
    "modbus imports no framing, relative": ("barewire/modbus/client/bus.py", "from ...tcp.line import TcpLine"),
    "modbus imports no canopen": ("barewire/modbus/client/bus.py", "from ...canopen.frame import CanFrame"),
    "canopen imports no modbus": ("barewire/canopen/sdo/client.py", "from ...modbus import Bus"),
    "a framing imports no other": ("barewire/ascii/line.py", "from ..rtu import crc"),
    "a framing imports no server": (
        "barewire/rtu/line.py",
        "from barewire.modbus.server.server import Server",
    ),
    "a framing imports no whole room": ("barewire/rtu/line.py", "from barewire.modbus import Adu"),
    "only rtu imports messages": ("barewire/tcp/line.py", "from barewire.modbus.messages import registry"),
    "devices import no framing": ("barewire/devices/modbus_access.py", "from barewire.rtu.line import RtuLine"),
    "devices import no io": ("barewire/devices/sim/az3.py", "from barewire.io.engine import blocking"),
    "the workbench has no ports": ("barewire_workbench/api.py", "from barewire.io import endpoint"),
    "frames import no cli": ("barewire_workbench/frames/modbus.py", "from ...cli import table"),
    "the stack does not know the workbench": (
        "barewire/io/engine/blocking.py",
        "from barewire_workbench.cli import main",
    ),
    "the front door offers no command": ("barewire/__init__.py", "from barewire_workbench.cli import main"),
    "an unknown room": ("barewire/profinet/frame.py", "import struct"),
    "no clock": ("barewire/modbus/client/bus.py", "import time"),
    "no clock, from": ("barewire/canopen/nmt/error_control.py", "from time import monotonic"),
    "no asyncio, inside a function": ("barewire/rtu/frame.py", "def now():\n    import asyncio"),
    "no logging, for types only": (
        "barewire/devices/description/load.py",
        "if TYPE_CHECKING:\n    from logging import Logger",
    ),
    "no socket, as a string": ("barewire/tcp/frame.py", "import importlib\nimportlib.import_module('socket')"),
    "no threads, as a submodule": ("barewire/devices/description/load.py", "import concurrent.futures"),
    "pyserial in its file only": ("barewire/io/engine/blocking.py", "import serial"),
    "pyserial in its file only, cli": ("barewire_workbench/cli/read.py", "from serial.tools import list_ports"),
    "python-can in io only": ("barewire_workbench/cli/scan.py", "import can"),
    "click in cli only": ("barewire/io/ports/base.py", "import click"),
    "rich in cli only": ("barewire_workbench/api.py", "from rich.table import Table"),
    "no other third party": ("barewire/io/engine/asyncio.py", "import trio"),
    "no fieldbus library": ("barewire/io/gateway.py", "from pymodbus.client import ModbusTcpClient"),
    "no canopen of PyPI": ("barewire/io/ports/can/python_can.py", "import canopen"),
    "no checksum library": ("barewire/rtu/crc.py", "import crcmod.predefined"),
}

ACCEPTED = {
    "the standard library": ("barewire/codecs/layout.py", "from __future__ import annotations\nimport re, enum"),
    "its own room": ("barewire/rtu/line.py", "from barewire.rtu.frame import decode\nfrom .crc import crc16"),
    "its own door": ("barewire/canopen/sdo/__init__.py", "from .messages import X\nfrom .client import upload"),
    "errors for all": ("barewire/tcp/frame.py", "from barewire.errors import DecodeError\nfrom .. import errors"),
    "messages for a framing": ("barewire/tcp/line.py", "from ..modbus.adu import A\nfrom ..modbus import framing"),
    "messages for rtu": ("barewire/rtu/line.py", "from barewire.modbus.messages.registry import length"),
    "ports for io": ("barewire/io/ports/serial.py", "import serial\nimport time\nfrom serial.tools import list_ports"),
    "click for commands": ("barewire_workbench/cli/read.py", "import click, rich.table\nfrom barewire.io import X"),
    "everything below for io": ("barewire/io/gateway.py", "from barewire import rtu, canopen, devices\nimport can"),
    "ports for live": ("barewire_workbench/live/scan.py", "from barewire.io.endpoint import Endpoint\nimport time"),
}  # fmt: skip


@every_case(("path", "source"), REFUSED.values())
def test_a_wrong_import_is_found(path: str, source: str) -> None:
    (found,) = broken_rules(rooms.nodes_that_load(source), path)
    assert found.startswith(f"{path}:{len(source.splitlines()) if 'profinet' not in path else 1}: ")


@pytest.mark.parametrize(("path", "source"), ACCEPTED.values(), ids=ACCEPTED)
def test_an_allowed_import_is_accepted(path: str, source: str) -> None:
    assert broken_rules(rooms.nodes_that_load(source), path) == []
