"""The modules that an import loads, in a fresh interpreter.

`bench/test_footprint.py` measures time and memory of imports; here only the names of modules are compared.
"""

from __future__ import annotations

import ast
import subprocess
import sys

import pytest

from barewire import ModbusServer
from barewire.errors import REASONS
from barewire.modbus import Table
from tools import rooms

pytestmark = pytest.mark.long

SRC = rooms.HOUSES["barewire"]

DOOR = {"barewire", "barewire._lazy"}
ENVELOPE = {*DOOR, "barewire.errors", "barewire.modbus", "barewire.modbus.adu"}
ENVELOPE |= {"barewire.modbus.messages"}  # only the list of message names
HEAVY = {"asyncio", "dataclasses", "inspect", "ast", "dis", "tokenize", "copy", "weakref", "threading"}
HEAVY |= {"ssl", "socket", "logging", "tomllib", "subprocess", "json"}
HEAVY |= {"enum", "re"} if sys.version_info >= (3, 13) else set()  # before, `typing` loads both
"""Modules that a room of pure bytes must not load."""


def loaded(statement: str) -> set[str]:
    """Return the modules that a statement adds. With `-I -S` nothing of the environment is loaded before it."""
    look = f"import sys; sys.path[:0] = {[*map(str, rooms.HOUSES.values())]}; there = set(sys.modules); {statement}; "
    look += "print(*(set(sys.modules) - there))"
    run = subprocess.run([sys.executable, "-I", "-S", "-c", look], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return set(run.stdout.split())


@pytest.mark.parametrize(
    ("room", "needs"),
    [
        ("codecs", {*DOOR, "barewire.errors"}),
        ("rtu", ENVELOPE),
        ("ascii", ENVELOPE),
        ("tcp", ENVELOPE),
    ],
)
def test_a_light_room_loads_no_other_room(room: str, needs: set[str]) -> None:
    names = "Text" if room == "codecs" else "decode, encode"  # names of `rtu` are loaded when they are first used
    found = loaded(f"from barewire.{room} import {names}")
    assert not HEAVY & found
    files = {name for name in found if name.startswith(f"barewire.{room}")}
    assert {name for name in found if name.startswith("barewire")} - files == needs


def test_the_rtu_line_is_loaded_when_it_is_first_used() -> None:
    assert "barewire.rtu.line" not in loaded("import barewire.rtu")
    assert "barewire.rtu.line" in loaded("import barewire.rtu; barewire.rtu.RtuLine")


def test_the_rtu_line_loads_no_message_and_nothing_that_only_messages_need() -> None:
    """`dataclasses`, and with it `inspect`, `ast` and `tokenize`, is loaded with the first message."""
    found = loaded("from barewire.rtu import RtuLine, Timing; RtuLine(Timing.of(9600)).feed(b'', 0.0)")
    assert not HEAVY & found
    assert files(found, "barewire.modbus") == {"adu", "exceptions", "messages", "messages.base", "messages.registry"}
    assert files(found, "barewire.codecs") == {"layout", "order"}


NO_CLIENT_NEEDS = {"asyncio", "ssl", "logging", "tomllib", "fractions", "subprocess", "json", "pathlib", "random"}
NO_CLIENT_NEEDS |= {"urllib.parse", "ipaddress"}
BLOCKING = "from barewire import ModbusClient; import barewire.io.ports.network"
MESSAGE = "from barewire.modbus import ReadHoldingRegisters"
CLIENT_FILES = {"adu", "client", "client.bus", "client.fair_queue", "client.line_state", "messages", "exceptions"}
OTHER_ROOMS = ("barewire.canopen", "barewire.devices", "barewire_workbench", "barewire.ascii", "barewire.rtu")


def files(found: set[str], room: str) -> set[str]:
    """Return the files of a room among the modules."""
    return {name.removeprefix(f"{room}.") for name in found if name.startswith(f"{room}.")}


def check_not_loaded(found: set[str], room: str, *names: str) -> None:
    """Assert that these files of a room exist, and that none of them was loaded. A file that has moved never is."""
    assert {f"{room}.{name}" for name in names} <= set(rooms.files())
    assert not set(names) & found


def test_the_blocking_tcp_client_loads_no_loop_no_devices_and_no_other_bus() -> None:
    found = loaded(BLOCKING)
    assert not NO_CLIENT_NEEDS & found
    assert not set(OTHER_ROOMS) & found
    # No message is loaded before one is sent, not even the bus's own probes, and no codec.
    assert "barewire.codecs" not in found
    assert files(found, "barewire.modbus") == CLIENT_FILES


def test_a_client_with_an_answer_has_loaded_no_more() -> None:
    """Over a real connection: the URL is parsed, the name looked up, a register read."""
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table(1)}) as host:
        asked = f"ModbusClient('{host.url}?timeout=30').read_holding_registers(0, 1)"
        found = loaded(f"from barewire import ModbusClient; {asked}")
    assert not NO_CLIENT_NEEDS & found
    assert not set(OTHER_ROOMS) & found


def test_the_first_message_loads_its_file_and_the_base_of_messages() -> None:
    found = loaded(MESSAGE)
    assert not HEAVY & found - loaded("import dataclasses")
    assert files(found, "barewire.modbus") == {"adu", "exceptions", "messages", "messages.base", "messages.registers"}
    whole = {"barewire", "barewire._lazy", "barewire.errors", "barewire.modbus"}
    assert {name for name in found if name.startswith("barewire") and name.count(".") < 2} == {
        *whole,
        "barewire.codecs",
    }


def test_the_asyncio_client_loads_asyncio_and_little_more() -> None:
    """asyncio itself loads other modules in each version. Beyond them only the files of the blocking client load."""
    found = loaded("import asyncio; there = set(sys.modules); from barewire import AsyncModbusClient")
    assert not (NO_CLIENT_NEEDS - {"asyncio", "ssl", "logging", "subprocess"}) & found - {"pathlib", "random"}
    assert not set(OTHER_ROOMS) & found
    assert "barewire.codecs" not in found
    assert files(found, "barewire.modbus") == CLIENT_FILES


def test_the_tcp_server_loads_no_asyncio() -> None:
    server = "ModbusServer('tcp://127.0.0.1:0', units={1: Table()}).close()"
    found = loaded(f"from barewire import ModbusServer, Table; {server}")
    assert not NO_CLIENT_NEEDS & found
    assert not [name for name in found if name.startswith(OTHER_ROOMS)]
    assert {"server.tcp", "server.limits"} < files(found, "barewire.io")
    assert not [
        name for name in files(found, "barewire.io") if any(word in name for word in ("async", "canopen", "tls"))
    ]


SDO = {"client", "channel", "transfer", "messages"}
CANOPEN = "from barewire import CanopenClient"


def test_the_canopen_client_loads_what_carries_an_object_and_no_other_service() -> None:
    """`typing` and `dataclasses` are allowed here: python-can, which every opened bus needs, loads both."""
    found = loaded(CANOPEN)
    assert not found & {
        "can",
        "asyncio",
        "tomllib",
        "fractions",
        "decimal",
        "datetime",
        "pathlib",
        "difflib",
        "logging",
    }
    assert not [
        name for name in found if name.startswith(("barewire.devices", "barewire.modbus", "barewire_workbench"))
    ]
    sdo, others = files(found, "barewire.canopen.sdo"), files(found, "barewire.canopen")
    assert sdo >= SDO
    assert "server" not in sdo
    services = ("eds", "device", "object_dictionary", "emcy", "sync", "time_stamp", "pdo")
    check_not_loaded({name.partition(".")[0] for name in others}, "barewire.canopen", *services)
    check_not_loaded(others, "barewire.canopen", "bus_scan", "nmt.error_control", "nmt.master")


def test_a_canopen_method_loads_its_file_when_it_is_called() -> None:
    found = files(
        loaded("from barewire.io.canopen.bus_methods import SyncMethods as Sync; Sync.events.__wrapped__(None)"),
        "barewire.canopen",
    )
    assert "sync" in found
    check_not_loaded(found, "barewire.canopen", "bus_scan", "emcy", "nmt.error_control")


def test_a_line_loads_the_messages_of_a_function_when_its_code_comes() -> None:
    def families(statement: str) -> set[str]:
        found = loaded(f"from barewire.rtu import RtuLine, Timing; line = RtuLine(Timing.of(9600)); {statement}")
        return files(found, "barewire.modbus.messages") - {"base", "registry"}

    assert families("pass") == set()
    assert families("line.feed(bytes.fromhex('01 03 02 00 63'), 0.0)") == {"registers"}
    assert families("line.feed(bytes.fromhex('01 83 02'), 0.0)") == {"exception_response"}


@pytest.mark.parametrize("statement", ["from barewire import *", "import barewire_workbench.cli"])
def test_nothing_but_its_own_command_loads_the_vectors(statement: str) -> None:
    found = loaded(statement)
    assert not [name for name in found if "vectors" in name or name == "zipfile"]


def test_a_client_or_server_loads_no_other() -> None:
    for name, others in {
        "io.Endpoint": ("engine", "modbus", "canopen", "server"),
        "ModbusClient": ("engine.asyncio", "modbus.async_client", "canopen", "server"),
        "AsyncModbusClient": ("modbus.client", "canopen", "server"),
        "AsyncModbusServer": ("modbus.client", "modbus.async_client", "canopen", "fault_injection"),
    }.items():
        room, _, what = f"barewire.{name}".rpartition(".")
        found = files(loaded(f"from {room} import {what}"), "barewire.io")
        check_not_loaded(found, "barewire.io", *others)


def test_a_method_loads_the_file_of_its_message_only() -> None:
    found = loaded(
        "from barewire import ModbusClient; "
        "client = ModbusClient('tcp://127.0.0.1:1', lazy=True)\n"
        "try: client.read_holding_registers(0, 1)\nexcept OSError: pass"
    )
    assert "barewire.modbus.messages.registers" in found
    assert "barewire.modbus.messages.files" not in found


def test_a_device_of_the_catalogue_is_loaded_without_the_checks_and_without_a_bus() -> None:
    found = loaded("from barewire.devices import load; load('az3')")
    assert files(found, "barewire.devices") == {
        *("description", "description.build", "description.load", "device", "parameter"),
    }
    assert not files(found, "barewire.modbus") | files(found, "barewire.canopen")


def test_reading_by_name_over_modbus_loads_no_canopen() -> None:
    found = loaded("from barewire.devices import load, read_modbus; load('az3')")
    assert not [name for name in found if name.startswith("barewire.canopen")]


def test_a_drive_on_modbus_loads_no_canopen() -> None:
    found = loaded("from barewire.devices import Drive, ModbusAccess, load; load('csd-mt'); import barewire.io.drive")
    assert not [name for name in found if name.startswith("barewire.canopen")]


def test_the_reasons_are_those_of_their_type() -> None:
    """`Reason` exists for type checkers only, so the test reads it from the source."""
    tree = ast.parse((SRC / "barewire" / "errors.py").read_text(encoding="utf-8"))
    literals = [
        node.value.slice
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and node.targets[0].id == "Reason"
        and isinstance(node.value, ast.Subscript)
    ]
    assert [ast.literal_eval(literal) for literal in literals] == [REASONS]
