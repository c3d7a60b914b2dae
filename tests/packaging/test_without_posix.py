"""What works on a Python without the parts of Unix: no fcntl, termios, pty, SIGHUP, poll, signals in the loop.

That is what Windows lacks of what barewire uses. Each program runs in a process that has lost these parts after the
standard library was loaded, and in which `sys.platform` is "win32". A serial port
is one without a descriptor, as that of pyserial there: `select` cannot wait for it.
"""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.workbench.cli.helpers import ENVIRONMENT
from tools.rooms import HOUSES

PRELUDE = """
import asyncio, io, multiprocessing, os, select, signal, socket, subprocess, sys, tempfile, threading
import click.testing, rich.console, rich.table, serial  # as they are on this system

for module in ("fcntl", "termios", "tty", "pty", "resource", "grp", "pwd", "syslog"):
    sys.modules[module] = None
for owner, names in (
    (os, "fork forkpty openpty ttyname register_at_fork major minor getuid geteuid killpg setsid uname getloadavg"),
    (signal, "SIGHUP SIGKILL SIGUSR1 SIGUSR2 SIGPIPE SIGALRM sigwait pthread_sigmask setitimer"),
    (select, "poll epoll"),
    (socket, "AF_CAN CAN_RAW CAN_BCM MSG_DONTWAIT SO_REUSEPORT TCP_QUICKACK SCM_RIGHTS"),
):
    for name in names.split():
        if hasattr(owner, name):
            delattr(owner, name)

def no_handler(*_):
    raise NotImplementedError

asyncio.unix_events._UnixSelectorEventLoop.add_signal_handler = no_handler
asyncio.unix_events._UnixSelectorEventLoop.remove_signal_handler = no_handler
class SerialOfWindows(serial.Serial):
    def fileno(self):
        raise io.UnsupportedOperation("fileno")

serial.Serial = SerialOfWindows
sys.platform = "win32"
sys.path[:0] = FOLDERS
""".replace("FOLDERS", repr([*map(str, HOUSES.values())]))
COMMAND = f"{PRELUDE}\nfrom barewire_workbench.cli import main\nmain()"
MODULES = sorted(
    ".".join(file.relative_to(folder).with_suffix("").parts).removesuffix(".__init__")
    for package, folder in HOUSES.items()
    for file in (folder / package).rglob("*.py")
    if file.name != "__main__.py"
)


def python(code: str, *arguments: str, where: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, cwd=where, timeout=120, check=False)


@contextmanager
def ready(*arguments: str, code: str = COMMAND, word: str) -> Iterator[str]:
    """Run a program until the block ends, which must end it with status 0; yield the URL in its first line."""
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    ) as run:
        assert run.stdout is not None
        assert run.stderr is not None
        try:
            first = run.stdout.readline()
            assert word in first, run.stderr.read()
            yield first.split(word)[1].split()[0]
            run.send_signal(signal.SIGTERM)
            assert (run.wait(30), "Traceback" in run.stderr.read()) == (0, False)
        finally:
            run.kill()


def test_every_module_is_imported(tmp_path: Path) -> None:
    code = f"""{PRELUDE}
import importlib
for name in {MODULES!r}:
    importlib.import_module(name)
"""
    done = python(code, where=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


def test_simulate_and_read(tmp_path: Path) -> None:
    with ready("simulate", "adxl", "tcp://127.0.0.1:0", word="ready ") as url:
        done = python(COMMAND, "read", f"{url}?timeout=30", "adxl", "Status", where=tmp_path)
        assert (done.returncode, done.stdout, done.stderr) == (0, "Status = 2 (Starter ready)\n", "")


def test_a_serial_port(tmp_path: Path) -> None:
    simulate = "from barewire_workbench.cli import main\nmain()"
    with ready("simulate", "adxl", "rtu://pty", code=simulate, word="ready ") as url:
        url = f"{url}{'&' if '?' in url else '?'}parity=N&timeout=30"
        done = python(COMMAND, "read", url, "adxl", "Status", where=tmp_path)
        assert (done.returncode, done.stdout, done.stderr) == (0, "Status = 2 (Starter ready)\n", "")
        code = f"{PRELUDE}\nimport barewire\nasync def main():\n async with barewire.AsyncModbusClient({url!r}) as c:\n"
        code += "  await c.read_coils(0, 1)\nasyncio.run(main())"
        done = python(code, where=tmp_path)
        assert "asyncio cannot wait for a serial port on Windows; use ModbusClient there" in done.stderr


def test_gateway(tmp_path: Path) -> None:
    config = tmp_path / "gateway.toml"
    code = f"{PRELUDE}\nimport runpy\nrunpy.run_module('barewire.gateway', run_name='__main__')"
    with ready("simulate", "adxl", "tcp://127.0.0.1:0", word="ready ") as url:
        config.write_text(
            f'[[listen]]\nurl = "tcp://127.0.0.1:0"\n[[backend]]\nname = "a"\nurl = "{url}"\nunits = "1"\n', "utf-8"
        )
        with ready(str(config), code=code, word="listening on ") as served:
            done = python(COMMAND, "read", f"{served}?timeout=30", "adxl", "Status", where=tmp_path)
            assert (done.returncode, done.stdout, done.stderr) == (0, "Status = 2 (Starter ready)\n", "")


@pytest.mark.parametrize("endpoint", ["rtu://pty", "can://socketcan/can0"])
def test_what_is_not_there_is_one_line(endpoint: str, tmp_path: Path) -> None:
    done = python(COMMAND, "simulate", "az3", endpoint, where=tmp_path)
    assert done.returncode == 1
    assert (done.stdout, done.stderr.count("\n")) == ("", 1), done.stderr
    assert done.stderr.startswith("barewire: ")
