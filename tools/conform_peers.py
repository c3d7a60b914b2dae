"""Servers of peer libraries, tested with the conformance batteries: `python tools/conform_page.py --measure`.

    name, version, {battery: endpoint}      each server has a hundred registers and coils for unit 1

A library that is not installed is reported as missing. Every process that is started here is ended here.
"""

from __future__ import annotations

import importlib.util
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from pathlib import Path

from tests.interop.relay import relayed

ROOT = Path(__file__).parent.parent
LINE = "baudrate=115200&parity=N"
PYMODBUS = """
import asyncio, sys
from pymodbus import FramerType
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

async def serve(kind, place):
    bits = [SimData(0, values=[False] * 100, datatype=DataType.BITS)]
    registers = [SimData(0, values=[0] * 100, datatype=DataType.REGISTERS)]
    device = SimDevice(id=1, simdata=(bits, bits, registers, registers))
    if kind == "tcp":
        server = ModbusTcpServer(device, address=("127.0.0.1", int(place)))
    else:
        server = ModbusSerialServer(device, framer=FramerType(kind), port=place, baudrate=115200, parity="N")
    await server.serve_forever(background=True)
    print("ready", flush=True)
    await asyncio.sleep(600)

asyncio.run(serve(*sys.argv[1:]))
"""
PYMODBUSTCP = """
import sys, time
from pyModbusTCP.server import DataBank, DeviceIdentification, ModbusServer
bank = DataBank(coils_size=100, d_inputs_size=100, h_regs_size=100, i_regs_size=100)
about = DeviceIdentification(vendor_name=b"a", product_code=b"b", major_minor_revision=b"1")
ModbusServer("127.0.0.1", int(sys.argv[2]), no_block=True, data_bank=bank, device_id=about).start()
print("ready", flush=True)
time.sleep(600)
"""


@contextmanager
def running(command: list[str]) -> Iterator[str]:
    """Run a program that prints a line when it is ready; yield the line. The program is killed at the end."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        try:
            assert process.stdout is not None
            ready = process.stdout.readline()
            if not ready.startswith("ready"):
                raise RuntimeError(f"{command[0]} did not start")
            yield ready.strip()
        finally:
            process.kill()


@contextmanager
def server(kind: str, command: Callable[[str, str], list[str]]) -> Iterator[tuple[str, str]]:
    """Run a server on a port of its own; yield the line that it printed, and the endpoint."""
    with ExitStack() as stack:
        if kind == "tcp":
            with socket.create_server(("127.0.0.1", 0)) as taken:
                place = str(taken.getsockname()[1])
            url = f"tcp://127.0.0.1:{place}"
        else:
            place, ours = stack.enter_context(relayed())
            url = f"{kind}://{ours}?{LINE}"
        ready = stack.enter_context(running(command(kind, place)))
        time.sleep(0.3)  # some print the line a little before they are ready
        yield ready, url


def _python(program: str) -> Callable[[str, str], list[str]]:
    return lambda kind, place: [sys.executable, "-c", program, kind, place]


@contextmanager
def libmodbus() -> Iterator[Path | None]:
    """Compile the C program of tests/interop and yield its file; None without a compiler or the library."""
    with tempfile.TemporaryDirectory() as where:
        program = Path(where) / "server"
        source = ROOT / "tests" / "interop" / "libmodbus_server.c"
        flags = ["-D_GNU_SOURCE", "-std=c11", "-o", str(program), str(source), "-lmodbus"]
        compiler = shutil.which("cc")
        done = compiler and subprocess.run([compiler, *flags], capture_output=True, timeout=60, check=False)
        yield program if done and done.returncode == 0 else None


Measure = Callable[[str], dict[str, str]]


def measured(measure: Measure) -> Iterator[tuple[str, str, dict[str, str]]]:
    """For each installed library and each battery whose carrier it supports: its name, the battery, the results."""
    for name, module, program, kinds in (
        ("pymodbus", "pymodbus", PYMODBUS, ("tcp", "rtu", "ascii")),
        ("pyModbusTCP", "pyModbusTCP", PYMODBUSTCP, ("tcp",)),
    ):
        if importlib.util.find_spec(module) is None:
            sys.stderr.write(f"{name} is not installed\n")
            continue
        for kind in kinds:
            with server(kind, _python(program)) as (_, url):
                yield f"{name} {version(name)}", kind, measure(url)
    with libmodbus() as program_of_c:
        if program_of_c is None:
            sys.stderr.write("libmodbus or a C compiler is not installed\n")
            return
        for kind in ("tcp", "rtu"):
            with server(kind, lambda kind, place: [str(program_of_c), kind, place]) as (ready, url):
                yield f"libmodbus {ready.partition(' ')[2]}".strip(), kind, measure(url)
