"""What a small machine pays: memory, start, processor time, bytes on disk; `make small` writes docs/reference/small.md.

Each contestant of `small_programs.py` is a program of its own, which imports what it needs and nothing else; the rounds
alternate, and each number is the median.

    memory     the largest resident memory, VmHWM of /proc/PID/status
    start      processor time from the start of the program to its first answer
    request    processor time for one request, one at a time, all threads of the program together
    disk       the files of the installed distribution and of those that it needs; as sources with bytecode, and as
               bytecode only without docstrings and assertions

libmodbus takes part if it can be compiled against, mbusd if it is in PATH or named by the variable MBUSD, tmodbus on
Python 3.12 or later. What does not take part is named on the page, with the reason.

    python -m bench.small [ROUNDS]
"""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from random import Random
from statistics import median
from tempfile import TemporaryDirectory
from typing import NamedTuple

from bench import small_programs as programs
from bench.servers import start as start_server
from tools import recipe_parts

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "reference" / "small.md"
BEGIN, END = "<!-- made by bench/small.py -->\n", "<!-- end -->\n"
MBUSD = os.environ.get("MBUSD") or shutil.which("mbusd")
COUNT, COUNT_ON_LINE = 2000, 200
REQUEST = bytes.fromhex("0001 0000 0006 01 03 0000 000A")
ANSWER_SIZE = 29


class Cost(NamedTuple):
    """Bytes of memory, and seconds of processor time up to the first answer and for a request."""

    memory: float
    start: float
    request: float


Measure = Callable[[], Cost]


# Clients measure themselves


def run_client(*command: str) -> Cost:
    """Run a client to its end; return what it has measured. Raises ImportError if it does not work."""
    process = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    if process.returncode:
        lines = process.stderr.strip().splitlines()
        raise ImportError(lines[-1] if lines else f"status {process.returncode}")
    return Cost(**json.loads(process.stdout))


def client(text: str, end: str, place: object, count: int) -> Measure:
    code = f"place = {str(place)!r}\ncount = {count}\n{text}{end}"
    return lambda: run_client(sys.executable, "-W", "ignore", "-c", code)


def floor(code: str) -> Measure:
    """A program that does nothing with Modbus: the cost of the interpreter, or of a part of it."""

    def measure() -> Cost:
        with started(sys.executable, "-c", f"{code}\nprint('ready', flush=True)\ninput()") as process:
            return Cost(peak_memory(process.pid), processor_time(process.pid), 0.0)

    return measure


# Servers and gateways are measured from outside


def processor_time(pid: int) -> float:
    """Seconds that all threads of a process have been on a processor."""
    threads = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(thread.read_text().split()[0]) for thread in threads) / 1e9


def peak_memory(pid: int) -> float:
    """The largest resident memory of a process, in bytes."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024.0 for line in lines if line.startswith("VmHWM:"))


class Program(subprocess.Popen[str]):
    """A program that was started, and the first line that it wrote."""

    first = ""


@contextmanager
def started(*command: str, says_when: bool = True) -> Iterator[Program]:
    """Start a program, and wait for its first line; end it afterwards."""
    process = Program(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        if says_when and process.stdout is not None and process.stderr is not None:
            process.first = process.stdout.readline().strip()
            if not process.first:
                raise ImportError(process.stderr.read().strip().splitlines()[-1])
        yield process
    finally:
        process.kill()
        process.communicate()


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


def connected(port: int) -> socket.socket:
    """Return a connection. mbusd does not say when it listens."""
    for _ in range(200):
        try:
            return socket.create_connection(("127.0.0.1", port), 10.0)
        except ConnectionRefusedError:
            time.sleep(0.02)
    raise OSError(f"nothing listens on port {port}")


def asked(process: Program, port: int, count: int) -> Cost:
    """Ask a server or gateway; return what that cost it."""

    def ask(connection: socket.socket) -> None:
        connection.sendall(REQUEST)
        received = b""
        while len(received) < ANSWER_SIZE:
            received += (data := connection.recv(4096))
            if not data or received[7] & 0x80:
                raise OSError(f"answered with {received.hex(' ')}")

    with connected(port) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        ask(connection)
        start = processor_time(process.pid)
        for _ in range(count):
            ask(connection)
        return Cost(peak_memory(process.pid), start, (processor_time(process.pid) - start) / count)


def server(text: str) -> Measure:
    def measure() -> Cost:
        port = free_port()
        with started(sys.executable, "-W", "ignore", "-c", f"place = '{port}'\n{text}") as process:
            return asked(process, port, COUNT)

    return measure


def program_server(*command: str) -> Measure:
    """A server that is a program of its own, with its port as the last argument."""

    def measure() -> Cost:
        port = free_port()
        with started(*command, str(port)) as process:
            return asked(process, port, COUNT)

    return measure


def own_gateway(backend: str, count: int) -> Measure:
    def measure() -> Cost:
        with TemporaryDirectory() as folder:
            port, config = free_port(), Path(folder) / "gateway.toml"
            listen = f'[[listen]]\nurl = "tcp://127.0.0.1:{port}"\n'
            config.write_text(f'{listen}[[backend]]\nname = "line"\nunits = "1"\nurl = "{backend}"\n')
            with started(sys.executable, "-m", "barewire.gateway", str(config)) as process:
                return asked(process, port, count)

    return measure


def mbusd(path: str) -> Measure:
    if MBUSD is None:
        raise ImportError("the program mbusd is not in PATH, and MBUSD does not name it")
    program = MBUSD

    def measure() -> Cost:
        port = free_port()
        options = ["-d", "-L", "-", "-v", "0", "-p", path, "-s", "115200", "-A", "127.0.0.1", "-P", str(port)]
        with started(program, *options, "-N", "0", "-W", "500", says_when=False) as process:
            return asked(process, port, COUNT_ON_LINE)

    return measure


# libmodbus


def compiled(source: Path, folder: Path) -> str:
    """Compile a program with libmodbus, and return its path."""
    program = folder / source.stem
    command = ["cc", "-O2", "-o", str(program), str(source), "-lmodbus"]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise ImportError("there is no C compiler, or no libmodbus to compile with (libmodbus-dev)") from error
    return str(program)


# The rounds


class Table(NamedTuple):
    title: str
    costs: Mapping[str, Cost]
    missing: Mapping[str, str]


def race(title: str, contestants: Mapping[str, Callable[[], Measure]], rounds: int) -> Table:
    """Measure every contestant once in each round, in another order each time; the first round warms up."""
    missing: dict[str, str] = {}
    measures: dict[str, Measure] = {}
    for name, make in contestants.items():
        try:
            measures[name] = make()
            measures[name]()
        except ImportError as error:
            missing[name] = str(error)
            measures.pop(name, None)
    found: dict[str, list[Cost]] = {name: [] for name in measures}
    order, draw = list(measures), Random(0)
    for _ in range(rounds):
        draw.shuffle(order)
        for name in order:
            found[name].append(measures[name]())
    costs = {name: Cost(*(median(column) for column in zip(*rows))) for name, rows in found.items()}
    return Table(title, costs, missing)


def tables(rounds: int) -> Iterator[Table]:
    """Run all races."""
    with ExitStack() as closing:
        folder = Path(closing.enter_context(TemporaryDirectory()))
        recipe_parts.install(folder, recipe_parts.parts())  # compiled, as it would be installed
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(folder), os.environ.get("PYTHONPATH"))))
        field = closing.enter_context(started(sys.executable, "-c", programs.FIELD)).first
        port = start_server("raw", closing)
        reads, serves = ROOT / "bench" / "libmodbus_reads.c", ROOT / "tests" / "interop" / "libmodbus_server.c"

        def clients(texts: Mapping[str, str], end: str, place: object, count: int) -> dict[str, Callable[[], Measure]]:
            return {name: lambda text=text: client(text, end, place, count) for name, text in texts.items()}

        def in_c(place: object, count: int) -> dict[str, Callable[[], Measure]]:
            def make() -> Measure:
                program = compiled(reads, folder)
                return lambda: run_client(program, str(place), str(count))

            return {"libmodbus (C)": make}

        interpreter = {"python -c pass": lambda: floor("pass")}
        standard = {"the standard modules of ours": lambda: floor("import dataclasses, socket, threading, typing")}
        with_asyncio = {"python -c 'import asyncio'": lambda: floor("import asyncio")}
        yield race(
            "Blocking clients, TCP",
            interpreter | standard | clients(programs.BLOCKING_TCP, programs.MEASURED, port, COUNT) | in_c(port, COUNT),
            rounds,
        )
        on_line = clients(programs.BLOCKING_RTU, programs.MEASURED, field, COUNT_ON_LINE)
        yield race("Blocking clients, RTU", interpreter | on_line | in_c(field, COUNT_ON_LINE), rounds)
        asking = clients(programs.ASYNCIO_TCP, programs.MEASURED_ASYNC, port, COUNT)
        yield race("Clients for asyncio, TCP", with_asyncio | asking, rounds)
        serving = {name: lambda text=text: server(text) for name, text in programs.SERVERS_TCP.items()}
        in_c_too = {"libmodbus (C)": lambda: program_server(compiled(serves, folder), "tcp")}
        yield race("Servers, TCP", interpreter | with_asyncio | serving | in_c_too, rounds)
        to_line = {
            "barewire": lambda: own_gateway(f"rtu://{field}?baudrate=115200", COUNT_ON_LINE),
            "mbusd (C)": lambda: mbusd(field),
        }
        yield race("Gateways, TCP to RTU", with_asyncio | to_line, rounds)


# Bytes on disk


def needed(name: str) -> set[str]:
    """Return a distribution and those that it needs, without extras."""
    required = distribution(name).requires or []
    names = [re.split(r"[^A-Za-z0-9._-]", line, maxsplit=1)[0] for line in required if "extra ==" not in line]
    return {name}.union(*map(needed, names))


def files_of(names: Iterable[str], into: Path) -> None:
    """Copy the files of installed distributions, without bytecode and commands."""
    for name in names:
        for file in distribution(name).files or []:
            if ".." not in file.parts and "__pycache__" not in file.parts:
                target = into / file
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(str(file.locate()), target)


def size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


BASE, DEVICES, CANOPEN = "python3-barewire", "python3-barewire-devices", "python3-barewire-canopen"
PARTS = {
    "barewire": recipe_parts.parts(),
    "barewire, Modbus alone": [BASE],
    "barewire, Modbus with names and units": [BASE, DEVICES],
    "barewire, Modbus with names and units, gateway": [BASE, DEVICES, "barewire-gateway"],
    "barewire, Modbus with names and units, CANopen": [BASE, DEVICES, CANOPEN],
}
"""The packages of the recipes for OpenWrt and Yocto, together as one installs them."""


def disk() -> Iterator[str]:
    """Yield the rows of the table of sizes."""
    yield "| | with sources | bytecode only |"
    yield "|---|---:|---:|"
    choices: list[tuple[str, Callable[[Path, bool], object]]] = []
    for title, packages in PARTS.items():

        def install(into: Path, bytecode: bool, packages: Collection[str] = packages) -> None:
            recipe_parts.install(into, packages, bytecode=bytecode)

        choices.append((title, install))
    for name in ("pymodbus", "tmodbus", "minimalmodbus", "pyModbusTCP"):

        def copy(into: Path, bytecode: bool, name: str = name) -> None:
            files_of(needed(name), into)
            recipe_parts.compile_files(into, bytecode=bytecode)

        choices.append((name, copy))
    for title, fill in choices:
        cells = []
        try:
            if not title.startswith("barewire") and len(needed(title)) > 1:
                title += f", with {', '.join(sorted(needed(title) - {title}))}"
            for bytecode in (False, True):
                with TemporaryDirectory() as folder:
                    fill(Path(folder), bytecode)
                    cells.append(f"{size(Path(folder)) / 1e6:.2f} MB")
        except PackageNotFoundError as error:
            cells = [f"{error.name} is not installed", ""]
        yield f"| {title} | {' | '.join(cells)} |"
    for title, path in (("libmodbus (C)", library("libmodbus.so.5")), ("mbusd (C)", MBUSD)):
        if path is not None:
            yield f"| {title} | {Path(path).resolve().stat().st_size / 1e6:.2f} MB | |"


def library(name: str) -> str | None:
    """Return the path of a shared library."""
    output = subprocess.run(["/sbin/ldconfig", "-p"], capture_output=True, text=True, check=False).stdout
    return next((line.split()[-1] for line in output.splitlines() if line.split()[:1] == [name]), None)


# The page


def in_markdown(table: Table) -> Iterator[str]:
    ours = next(cost for name, cost in table.costs.items() if name.startswith("barewire"))
    yield from (f"### {table.title}", "")
    yield "| | peak memory | start to first answer | one request | x barewire |"
    yield "|---|---:|---:|---:|---:|"
    for name, cost in table.costs.items():
        request = [f"{1e6 * cost.request:.0f} µs", f"{cost.request / ours.request:.2f}"] if cost.request else ["", ""]
        yield f"| {name} | {cost.memory / 2**20:.1f} MiB | {1e3 * cost.start:.1f} ms | {' | '.join(request)} |"
    yield ""
    for name, why in table.missing.items():
        yield from (f"Missing: {name}, {why}.", "")


def version(name: str) -> str:
    try:
        return f"{name} {distribution(name).version}"
    except PackageNotFoundError:
        return f"no {name}"


def main() -> int:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 9
    lines = [
        f"CPython {platform.python_version()}, {platform.system()} on {platform.machine()}, {os.cpu_count()} cores;",
        ", ".join(map(version, ("pymodbus", "tmodbus", "minimalmodbus", "pyModbusTCP", "pyserial"))) + ".",
        f"Medians of {rounds} rounds.",
        "",
    ]
    for table in tables(rounds):
        rows = [*in_markdown(table)]
        sys.stdout.write("\n".join(rows) + "\n")
        lines += rows
    lines += ["### Bytes on disk", "", *disk(), ""]
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n{chr(10).join(lines)}\n{END}{rest.partition(END)[2]}", encoding="utf-8")
    sys.stdout.write("docs/reference/small.md is written\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
