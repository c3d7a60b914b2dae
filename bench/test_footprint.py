"""Fixed costs: time and memory of an import, time and memory of an idle connection.

Each import runs in a new interpreter (`-I -S` and explicit paths, so nothing is loaded beforehand), which measures its
own seconds and the growth of its resident memory. The contestants are interleaved as in every race.
"""

from __future__ import annotations

import asyncio
import gc
import os
import socket
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable
from contextlib import ExitStack
from statistics import median
from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from bench.race import Factory, Many, Race, Work, entries

LOOK = """
import sys
sys.path[:0] = {path!r}
import time
def resident():
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * {page}
    except OSError:
        return 0
before = resident()
start = time.perf_counter()
try:
    {statement}
except ImportError as error:
    sys.exit(str(error))
print(time.perf_counter() - start, resident() - before)
"""
PATH = [entry for entry in sys.path if entry and os.path.isdir(entry)]

IMPORTS = {
    "pymodbus.client": "import pymodbus.client",
    "minimalmodbus": "import minimalmodbus",
    "pyModbusTCP.client": "import pyModbusTCP.client",
    "uModbus client": "import umodbus.client.tcp",
    "tmodbus": "import tmodbus",
    "asyncio": "import asyncio",
    "barewire.rtu": "import barewire.rtu",
    "barewire.ascii": "import barewire.ascii",
    "barewire.tcp": "import barewire.tcp",
    "barewire.codecs": "import barewire.codecs",
    "barewire.modbus messages": "from barewire.modbus import ReadHoldingRegisters",
    "barewire blocking TCP client": "from barewire import ModbusClient; import barewire.io.ports.network",
    "barewire blocking TCP client, a URL and its first message": "from barewire import ModbusClient; "
    "ModbusClient('tcp://127.0.0.1:1', lazy=True); import barewire.io.ports.network; "
    "from barewire.modbus import ReadHoldingRegisters",
    "barewire asyncio client": "from barewire import AsyncModbusClient",
    "can": "import can",
    "canopen": "import canopen",
    "barewire CANopen client": "from barewire import CanopenClient",
    "barewire CANopen client, and can": (
        "from barewire import CanopenClient; import barewire.io.ports.can.python_can, can"
    ),
}
_memory: dict[str, list[int]] = {}


class Imported(Many):
    """The import in a new interpreter. The start of the interpreter is not measured."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(self._look)

    def _look(self, count: int) -> float:
        page = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096
        look = LOOK.format(path=PATH, page=page, statement=IMPORTS[self.name])
        done = subprocess.run([sys.executable, "-I", "-S", "-c", look], capture_output=True, text=True, check=False)
        if done.returncode:
            raise ImportError(done.stderr.strip().splitlines()[-1])
        seconds, memory = done.stdout.split()
        _memory.setdefault(self.name, []).append(int(memory))
        return float(seconds)

    measures_itself = True


def _imported(name: str) -> Callable[[ExitStack], Work]:
    return lambda _: Imported(name)


RACE = Race("Import", "in a new interpreter", "each", {n: _imported(n) for n in IMPORTS}, rounds=9, turn=0.0)


@pytest.mark.parametrize(("race", "contestant"), entries(RACE))
def test_import(enter: Callable[[Race, str], None], benchmark: BenchmarkFixture, race: Race, contestant: str) -> None:
    enter(race, contestant)
    benchmark.extra_info["memory"] = median(_memory[contestant])


# Connections that do nothing -------------------------------------------------------------------------------------


class Silent(asyncio.Protocol):
    """An empty protocol: the cost of a connection in asyncio itself."""


async def _raw() -> tuple[int, Callable[[], Any]]:
    server = await asyncio.get_running_loop().create_server(Silent, "127.0.0.1", 0, backlog=1024)
    return server.sockets[0].getsockname()[1], server.close


async def _with_asyncio() -> tuple[int, Callable[[], Any]]:
    from barewire import AsyncModbusServer
    from barewire.modbus import Table

    server = AsyncModbusServer("tcp://127.0.0.1:0", {1: Table(100)})
    await server.start()
    return server.port, lambda: asyncio.ensure_future(server.close())


async def _in_a_thread() -> tuple[int, Callable[[], Any]]:
    from barewire import ModbusServer
    from barewire.modbus import Table

    host = ModbusServer("tcp://127.0.0.1:0", units={1: Table(100)})
    host.start()
    return int(host.url.rpartition(":")[2]), host.close


async def _connected(port: int, count: int) -> list[socket.socket]:
    clients = [socket.socket() for _ in range(count)]
    for client in clients:
        client.setblocking(False)
        await asyncio.get_running_loop().sock_connect(client, ("127.0.0.1", port))
    return clients


async def _all_that_came() -> int:
    """Return bytes that Python has allocated, once the number is stable: the server may run in another thread."""
    before = -1
    for _ in range(100):
        await asyncio.sleep(0.05)
        gc.collect()
        held = tracemalloc.get_traced_memory()[0]
        if held == before:
            break
        before = held
    return before


async def _grown(make: Callable[[], Any], count: int) -> tuple[float, float]:
    """Return seconds and bytes for each of `count` idle connections, measured apart: tracing memory takes time."""
    port, close = await make()
    clients = await _connected(port, 1)
    start = time.perf_counter()
    clients += await _connected(port, count)
    took = time.perf_counter() - start
    await asyncio.sleep(0.05)
    tracemalloc.start()
    empty = await _all_that_came()
    more = await _connected(port, count)
    grown = await _all_that_came() - empty
    # This includes the clients' sockets and their list: measure the same number of sockets alone and subtract them.
    before = tracemalloc.get_traced_memory()[0]
    spare = [socket.socket() for _ in range(count)]
    grown -= tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    for client in clients + more + spare:
        client.close()
    close()
    await asyncio.sleep(0.05)
    return took / count, grown / count


_held: dict[tuple[str, int], list[float]] = {}


def _idle(contestant: str, make: Callable[[], Any], count: int) -> Factory:
    class Idle(Many):
        measures_itself = True

    def grown(_: int) -> float:
        took, held = asyncio.run(_grown(make, count))
        _held.setdefault((contestant, count), []).append(held)
        return took

    return lambda closing: Idle(grown)


SERVERS = {"asyncio": _raw, "barewire, asyncio": _with_asyncio, "barewire": _in_a_thread}


def _idle_race(count: int) -> Race:
    contestants = {contestant: _idle(contestant, make, count) for contestant, make in SERVERS.items()}
    return Race("Idle connections", "one more", count, contestants, rounds=3, turn=0.0)


@pytest.mark.parametrize(("race", "contestant"), entries(*map(_idle_race, (10, 100, 400))))
def test_idle_connection(
    enter: Callable[[Race, str], None], benchmark: BenchmarkFixture, race: Race, contestant: str
) -> None:
    enter(race, contestant)
    assert isinstance(race.size, int)
    benchmark.extra_info["memory"] = median(_held[contestant, race.size])
