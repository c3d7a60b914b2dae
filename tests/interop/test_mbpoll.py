"""mbpoll, a C program on libmodbus, as a stranger: it polls and writes our servers on TCP and on a pseudo-terminal."""

from __future__ import annotations

import subprocess

import pytest

from barewire.modbus import Table
from barewire.shells import open_host

pytestmark = pytest.mark.needs("mbpoll")


def _where(url: str) -> list[str]:
    place = url.partition("://")[2].partition("?")[0]
    if url.startswith("tcp"):
        host, _, port = place.partition(":")
        return ["-m", "tcp", "-p", port, host]
    return ["-m", "rtu", "-b", "115200", "-P", "none", place]


def _mbpoll(url: str, *options: str, values: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
    *where, target = _where(url)
    command = ["mbpoll", *where, "-0", "-1", "-q", "-a", "1", *options, target, *values]
    return subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)


@pytest.mark.parametrize("url", ["tcp://127.0.0.1:0", "rtu://pty?baudrate=115200&parity=N"])
def test_it_reads_and_writes_every_table(url: str) -> None:
    table = Table()
    table.input_registers[4] = 1234
    table.discrete_inputs[6] = 1
    with open_host(url, units={1: table}) as host:
        assert _mbpoll(host.url, "-t", "4", "-r", "5", values=("11", "22", "33")).returncode == 0
        assert list(table.holding_registers[5:8]) == [11, 22, 33]
        read = _mbpoll(host.url, "-t", "4", "-r", "5", "-c", "3")
        assert [line.split()[-1] for line in read.stdout.splitlines() if line.startswith("[")] == ["11", "22", "33"]
        assert "1234" in _mbpoll(host.url, "-t", "3", "-r", "4", "-c", "1").stdout
        assert _mbpoll(host.url, "-t", "0", "-r", "8", values=("1",)).returncode == 0
        assert table.coils[8] == 1
        assert "[6]: \t1" in _mbpoll(host.url, "-t", "1", "-r", "6", "-c", "1").stdout


def test_it_is_told_of_an_exception() -> None:
    with open_host("tcp://127.0.0.1:0", units={1: Table(size=10)}) as host:
        refused = _mbpoll(host.url, "-t", "4", "-r", "9", "-c", "2")
        assert refused.returncode == 1
        assert "Illegal data address" in refused.stderr + refused.stdout
