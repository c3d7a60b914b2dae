"""Run the command `barewire` in a process of its own, and simulated devices in others, on real ports."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import BytesIO, TextIOWrapper
from unittest.mock import patch

from barewire.devices.sim import simulator
from barewire.io.endpoint import Endpoint
from barewire_workbench.cli.app import run_command_line
from barewire_workbench.cli.simulate import machine_server
from tests.helpers import BAREWIRE

COMMAND = [BAREWIRE]
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
ENVIRONMENT |= {"COLUMNS": "200", "NO_COLOR": "1"}
"""Without the settings of Python that a user does not have: with PYTHONUNBUFFERED no buffer fails at the end."""


def run_command(*arguments: str, timeout: float = 60) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, timeout=timeout, env=ENVIRONMENT, check=False
    )


def output_of(*arguments: str) -> str:
    """Return the output of a command that must succeed. It is run in this process, which is ten times as fast."""
    done = run_here(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def error_of(*arguments: str, status: int = 1) -> str:
    """Return the one line on stderr of a command that must fail, and print nothing else. It is run in this process."""
    done = run_here(*arguments)
    assert done.returncode == status, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert done.stdout == ""
    return done.stderr


def run_here(
    *arguments: str, environment: dict[str, str] = ENVIRONMENT, one_stream: bool = False
) -> subprocess.CompletedProcess[str]:
    """Run a command in this process. With `one_stream`, stderr is in the output."""
    out, err = (TextIOWrapper(BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    log = logging.getLogger("barewire")
    level = log.level
    with redirect_stdout(out), redirect_stderr(out if one_stream else err), patch.dict(os.environ, environment):
        status = run_command_line([*arguments])
    log.setLevel(level)  # -v lowers it for the process
    out.seek(0)
    err.seek(0)
    return subprocess.CompletedProcess(arguments, status, out.read(), err.read())


@contextmanager
def simulated(*arguments: str, client_option: str = "timeout=30") -> Iterator[list[str]]:
    """Simulate a device in a process of its own; yield the URL of each endpoint, with an option for the client added.

    The long time-out is for a computer that stands still for more than the usual second."""
    command = [*COMMAND, "simulate", *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        urls = []
        try:
            for argument in arguments:
                if "://" in argument:
                    line = process.stdout.readline()
                    assert line.startswith("ready "), process.stderr.read()
                    urls.append(with_option(line.split()[1], client_option))
            yield urls
        finally:
            process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0
        assert process.stderr.read() == ""


@contextmanager
def simulated_at(device: str, url: str, client_option: str = "timeout=30") -> Iterator[str]:
    """Simulate a machine of the catalogue at one endpoint, in threads of this process; yield its URL."""
    endpoint = Endpoint.parse(url)
    unit, node = endpoint.integer("unit", 0) or None, endpoint.integer("node", 0) or None
    with machine_server(url, simulator(device, time.monotonic(), unit=unit, node=node)) as server:
        yield with_option(server.url, client_option)


def with_option(url: str, option: str) -> str:
    """Return the URL with one more option; unchanged if the option is empty."""
    return f"{url}{'&' if '?' in url else '?'}{option}" if option else url


def read_until(endpoint: str, device: str, name: str, expected: str, *write: str) -> str:
    """Repeat `read` until its output contains the expected text, and return that; another process changes the value.

    The command `write` is repeated before each reading."""
    give_up = time.monotonic() + 120
    if write:
        output_of(*write)
    while expected not in (text := output_of("read", endpoint, device, name)):
        assert time.monotonic() < give_up, f"{text.strip()}: never {expected!r}"
        if write:
            output_of(*write)
    return text
