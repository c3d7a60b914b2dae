"""The programs that are measured, the clients in front of them, and what the system says about them."""

from __future__ import annotations

import json
import os
import shutil
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

ROOT = Path(__file__).parent.parent.parent
MBUSD = os.environ.get("MBUSD") or shutil.which("mbusd")
MOSQUITTO = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
"""Debian installs it where the PATH of a usual user does not lead."""
BAUDRATE = 115200


class Program(subprocess.Popen[str]):
    """A program that was started, and the first line that it wrote."""

    first = ""


@contextmanager
def program(*command: str, is_ready: bool = True) -> Iterator[Program]:
    """Start a program; with `is_ready` wait for its first line."""
    running = Program(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=ROOT)
    try:
        if is_ready and running.stdout is not None:
            running.first = running.stdout.readline().strip()
            if not running.first:
                raise OSError(f"{command} has ended")
        yield running
    finally:
        running.terminate()
        running.wait(10)


def remaining_lines(running: Program) -> list[str]:
    """What a program that was terminated has written since its first line."""
    return running.stdout.read().splitlines() if running.stdout is not None else []


def stand_in(name: str, *arguments: object) -> tuple[str, ...]:
    """The command of a program of `stand_ins`."""
    return (sys.executable, "-m", "tools.gateway_lab.stand_ins", name, *map(str, arguments))


def free_port() -> int:
    """A TCP port of the loopback interface on which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def processor_time(running: Program) -> float:
    """Seconds that a program has been on a processor."""
    return int(Path(f"/proc/{running.pid}/schedstat").read_text().split()[0]) / 1e9


def peak_memory(running: subprocess.Popen[Any]) -> float:
    """The largest resident memory of a program, in MiB."""
    for line in Path(f"/proc/{running.pid}/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    raise OSError("no VmHWM")


@contextmanager
def gateway(backend: str, *, more: str = "", prefix: Sequence[str] = ()) -> Iterator[tuple[Program, int]]:
    """A running gateway with this backend, and the port of its listener. `prefix` is a command that starts it."""
    with TemporaryDirectory() as folder:
        file, port = Path(folder) / "gateway.toml", free_port()
        file.write_text(f'[[listen]]\nurl = "tcp://127.0.0.1:{port}?connections=400"\n[[backend]]\n{backend}\n{more}')
        with program(*prefix, sys.executable, "-m", "barewire.gateway", str(file)) as running:
            yield running, port


@contextmanager
def mbusd(path: str, *, wait: int) -> Iterator[tuple[Program, int]]:
    """A running mbusd with a time-out in milliseconds, and its port."""
    assert MBUSD is not None
    port = free_port()
    options = ["-d", "-L", "-", "-v", "0", "-p", path, "-s", str(BAUDRATE), "-A", "127.0.0.1", "-P", str(port)]
    with program(MBUSD, *options, "-C", "128", "-N", "0", "-R", "2", "-W", str(wait), is_ready=False) as running:
        time.sleep(0.3)
        yield running, port


class Load(NamedTuple):
    """What clients got, and what it cost the gateway."""

    right: int
    wrong: int
    declined: int
    lost: int
    """Requests without any response."""
    longest: float
    each: list[int]
    cost: float
    """Seconds of processor time for a request with a right answer."""
    rate: float
    moments: list[float]
    """When each right answer came, by `time.monotonic`."""

    @property
    def summary(self) -> str:
        """The counts in words."""
        return f"{self.right:,} right, {self.declined:,} exceptions, **{self.wrong} wrong, {self.lost} lost**"


def load(
    running: Program | None,
    port: int,
    seconds: float,
    count: int,
    units: tuple[int, int] = (1, 10),
    greedy: int = 1,
    pause: float = 0.0,
    every: float = 0.0,
) -> Load:
    """Let clients read from units first to last; the first client has `greedy` requests open at once. They wait for
    `pause` seconds after an exception, and for `every` seconds after each response."""
    before = processor_time(running) if running else 0.0
    command = stand_in("clients", port, seconds, count, *units, greedy, pause, every)
    output = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    if output.returncode:
        raise OSError(output.stderr)
    rows, moments = json.loads(output.stdout)
    right, wrong, declined, _, lost = (sum(row[place] for row in rows) for place in range(5))
    used = processor_time(running) - before if running else 0.0
    each = [row[0] for row in rows]
    longest = max(row[3] for row in rows)
    return Load(right, wrong, declined, lost, longest, each, used / max(right, 1), right / seconds, moments)


def together(loads: list[Load]) -> Load:
    """The counts of several runs."""
    return loads[0]._replace(
        right=sum(row.right for row in loads),
        wrong=sum(row.wrong for row in loads),
        declined=sum(row.declined for row in loads),
        lost=sum(row.lost for row in loads),
    )


def line(path: str, timeout: float, units: str = "1-10", name: str = "line") -> str:
    """The configuration of a backend on a serial line."""
    return f'name = "{name}"\nurl = "rtu://{path}?baudrate={BAUDRATE}"\nunits = "{units}"\ntimeout = {timeout}'


def median(values: list[float]) -> float:
    """The median."""
    return statistics.median(values)
