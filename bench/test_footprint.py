"""What it costs to be there at all: time and memory of an import, memory and time of a connection that is idle.

Each import is a new interpreter (`-I -S`, nothing of the environment is loaded beforehand, with the paths given), which
measures itself: seconds, and how much its resident memory grew. Interleaved like everything here.
"""

from __future__ import annotations

import asyncio
import gc
import os
import socket
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from contextlib import ExitStack
from statistics import median
from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from bench.race import Many, Race, Work, entries

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
    "barewire blocking TCP client": "from barewire.shells import open_modbus; import barewire.shells.tcp_socket",
    "barewire blocking TCP client, with its first message": "from barewire.shells import open_modbus; "
    "import barewire.shells.tcp_socket; from barewire.modbus import ReadHoldingRegisters",
    "barewire asyncio client": "from barewire.shells import open_async",
}
_memory: dict[str, list[int]] = {}


class Imported(Many):
    """The import in a new interpreter; what is measured there counts, not the start of the interpreter."""

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


@pytest.mark.parametrize(("race", "who"), entries(RACE))
def test_import(enter: Callable[[Race, str], None], benchmark: BenchmarkFixture, race: Race, who: str) -> None:
    enter(race, who)
    benchmark.extra_info["memory"] = median(_memory[who])


# Connections that do nothing -------------------------------------------------------------------------------------


class Silent(asyncio.Protocol):
    """The least that can be connected to: what asyncio itself takes for a connection."""


async def _raw() -> tuple[int, Callable[[], Any]]:
    server = await asyncio.get_running_loop().create_server(Silent, "127.0.0.1", 0, backlog=1024)
    return server.sockets[0].getsockname()[1], server.close


async def _ours() -> tuple[int, Callable[[], Any]]:
    from barewire.modbus import Table
    from barewire.shells import serve_tcp

    server = await serve_tcp({1: Table(100)}, port=0)
    return server.port, lambda: asyncio.ensure_future(server.close())


async def _grown(make: Callable[[], Any], count: int) -> tuple[float, float]:
    """Bytes and seconds for each of so many idle connections; the clients' sockets are opened before it is looked."""
    port, close = await make()
    loop = asyncio.get_running_loop()
    clients = [socket.socket() for _ in range(count + 1)]
    for client in clients:
        client.setblocking(False)
    await loop.sock_connect(clients[0], ("127.0.0.1", port))
    await asyncio.sleep(0.01)
    gc.collect()
    tracemalloc.start()
    start = loop.time()
    for client in clients[1:]:
        await loop.sock_connect(client, ("127.0.0.1", port))
    await asyncio.sleep(0)
    took = loop.time() - start
    await asyncio.sleep(0.05)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    for client in clients:
        client.close()
    close()
    await asyncio.sleep(0.05)
    return grown / count, took / count


@pytest.mark.parametrize("count", [10, 100, 400])
@pytest.mark.parametrize("who", ["asyncio", "barewire"])
def test_idle_connection(benchmark: BenchmarkFixture, who: str, count: int) -> None:
    make = {"asyncio": _raw, "barewire": _ours}[who]
    benchmark.group = f"Idle connections: {count}"
    benchmark.extra_info.update(family="Idle connections", what="one more", size=count, who=who, floor="asyncio")
    found: list[tuple[float, float]] = []
    benchmark.pedantic(lambda: found.append(asyncio.run(_grown(make, count))), rounds=3)
    benchmark.extra_info["memory"] = median(memory for memory, _ in found)
    benchmark.extra_info["ratios"] = {who: {"median": 1.0, "q1": 1.0, "q3": 1.0}}
