"""mbpoll, a C program on libmodbus: it reads and writes our servers on TCP and on a pseudo-terminal, and through socat
those on TLS and on RTU over TCP. It writes one value with a single write and several with a multiple one, sends
Report Server ID (11) on serial lines only, and has no ASCII."""

from __future__ import annotations

import subprocess
from contextlib import ExitStack
from pathlib import Path

import pytest

from barewire import ModbusServer
from barewire.modbus import Table
from tests.interop.our_side import our_server, place_of, port_of
from tests.interop.relay import serial_at, tls_from
from tests.interop.services import BITS_AND_REGISTERS, proves

pytestmark = pytest.mark.needs("mbpoll", "openssl", "socat")


def _mbpoll(place: str, *options: str, values: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
    host, colon, port = place.partition(":")
    where = ["-m", "tcp", "-p", port] if colon else ["-m", "rtu", "-b", "115200", "-P", "none"]
    command = ["mbpoll", *where, "-0", "-1", "-q", "-a", "1", *options, host, *values]
    return subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)


def _values(done: subprocess.CompletedProcess[str]) -> list[str]:
    assert done.returncode == 0, done.stderr
    return [line.split()[-1] for line in done.stdout.splitlines() if line.startswith("[")]


@pytest.mark.parametrize(
    "carrier",
    [
        *(proves("mbpoll", "server", carrier, *BITS_AND_REGISTERS, "11") for carrier in ("rtu", "rtu+tcp")),
        *(proves("mbpoll", "server", carrier, *BITS_AND_REGISTERS) for carrier in ("tcp", "tls")),
    ],
)
def test_mbpoll_reads_and_writes_every_table(carrier: str, certificates: Path, exchanged: set[str]) -> None:
    with ExitStack() as stack:
        place, unit = stack.enter_context(our_server(carrier, certificates, exchanged))
        if carrier == "rtu+tcp":
            place = stack.enter_context(serial_at(port_of(place)))
        elif carrier == "tls":
            place = f"127.0.0.1:{stack.enter_context(tls_from(port_of(place), certificates))}"
        assert _mbpoll(place, "-t", "4", "-r", "5", values=("11", "22", "33")).returncode == 0
        assert _mbpoll(place, "-t", "4", "-r", "6", values=("65535",)).returncode == 0
        assert list(unit.holding_registers[5:8]) == [11, 0xFFFF, 33]
        assert _values(_mbpoll(place, "-t", "4:hex", "-r", "5", "-c", "3")) == ["0x000B", "0xFFFF", "0x0021"]
        assert _mbpoll(place, "-t", "4:float", "-B", "-r", "20", values=("1.5",)).returncode == 0
        assert list(unit.holding_registers[20:22]) == [0x3FC0, 0]
        assert _values(_mbpoll(place, "-t", "4:float", "-B", "-r", "20")) == ["1.5"]
        assert _values(_mbpoll(place, "-t", "3", "-r", "4")) == ["1234"]
        assert _mbpoll(place, "-t", "0", "-r", "8", values=("1",)).returncode == 0
        assert _mbpoll(place, "-t", "0", "-r", "9", values=("1", "0", "1")).returncode == 0
        assert list(unit.coils[8:12]) == [1, 1, 0, 1]
        assert _values(_mbpoll(place, "-t", "0", "-r", "8", "-c", "4")) == ["1", "1", "0", "1"]
        assert _values(_mbpoll(place, "-t", "1", "-r", "5", "-c", "3")) == ["0", "1", "0"]
        if "rtu" in carrier:
            server_id = _mbpoll(place, "-u")
            assert "table" in server_id.stdout, server_id


def test_mbpoll_reports_our_exception() -> None:
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table(size=10)}) as host:
        declined = _mbpoll(place_of(host), "-t", "4", "-r", "9", "-c", "2")
        assert declined.returncode == 1
        assert "Illegal data address" in declined.stderr + declined.stdout
