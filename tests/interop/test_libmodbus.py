"""libmodbus, the C library of most gateways, as a stranger: every call of its client against our servers, and its
server under our client. The two programs stand beside this file and are compiled here."""

from __future__ import annotations

import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from barewire.modbus import ModbusException, Table
from barewire.shells import ModbusClient, open_host, open_modbus
from tests.helpers import refused
from tests.interop.relay import relayed

pytestmark = pytest.mark.needs("libmodbus", "cc")

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The client and the server, compiled without a warning."""
    where = tmp_path_factory.mktemp("libmodbus")
    made = {}
    for name in ("client", "server"):
        source, made[name] = HERE / f"libmodbus_{name}.c", where / name
        flags = ["-D_GNU_SOURCE", "-std=c11", "-Wall", "-Wextra", "-Werror", "-o", str(made[name])]
        subprocess.run(["cc", *flags, str(source), "-lmodbus"], check=True, timeout=60)
    return made


@pytest.mark.parametrize("kind", ["tcp", "tcp_pi", "rtu"])
def test_every_call_of_their_client(programs: dict[str, Path], kind: str) -> None:
    table = Table(10000)
    table.input_registers[4] = 1234
    table.discrete_inputs[6] = 1
    table.exception_status = 0x5A
    url = "rtu://pty?baudrate=115200&parity=N" if kind == "rtu" else "tcp://127.0.0.1:0"
    with open_host(url, units={1: table}) as host:
        place = host.url.partition("://")[2].partition("?")[0]
        where = [place] if kind == "rtu" else place.split(":")
        done = subprocess.run(
            [str(programs["client"]), kind, *where], capture_output=True, text=True, timeout=30, check=False
        )
    assert done.stderr == ""
    assert done.stdout.splitlines()[-1] == "all"
    assert table.coils[20] == 1


@contextmanager
def their_server(programs: dict[str, Path], kind: str) -> Iterator[str]:
    """Their server in a process of its own; gives the endpoint."""
    with relayed() as (theirs, ours), socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        taken.close()
        where = str(port) if kind == "tcp" else theirs
        with subprocess.Popen([str(programs["server"]), kind, where], stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                assert process.stdout.readline() == "ready\n"
                yield f"tcp://127.0.0.1:{port}" if kind == "tcp" else f"rtu://{ours}?baudrate=115200&parity=N"
            finally:
                process.kill()


@pytest.mark.parametrize("kind", ["tcp", "rtu"])
def test_their_server_under_our_client(programs: dict[str, Path], kind: str) -> None:
    with their_server(programs, kind) as endpoint:
        for _ in range(2):
            with open_modbus(f"{endpoint}{'&' if '?' in endpoint else '?'}unit=1&timeout=2") as client:
                use(client)


def use(client: ModbusClient) -> None:
    client.write_multiple_registers(10, (1, 2, 3))
    client.write_single_register(11, 20)
    assert client.read_holding_registers(10, 3) == (1, 20, 3)
    client.mask_write_register(12, 0x00F2, 0x0025)
    assert client.read_holding_registers(12, 1) == (0x0007,)
    assert client.read_write_multiple_registers(10, 2, 13, (9,)) == (1, 20)
    assert client.read_input_registers(99, 1) == (1234,)
    assert client.read_discrete_inputs(5, 3) == (False, True, False)
    client.write_multiple_coils(0, (True, False, True, True))
    client.write_single_coil(1, True)
    assert client.read_coils(0, 4) == (True, True, True, True)
    assert b"LMB" in client.report_server_id()
    with refused(ModbusException, "illegal data address"):
        client.read_holding_registers(99, 2)
    with refused(ModbusException, "busy"):
        client.read_holding_registers(50, 1)
    assert client.read_holding_registers(10, 1) == (1,)
