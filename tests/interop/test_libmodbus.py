"""libmodbus, the C library of most gateways: every call of its client against our servers, and our clients against its
server. The two C programs are beside this file and are compiled here.

It supports TCP and RTU. socat connects the same programs through TLS, and its RTU through TCP. Function 07 is possible
as a raw request only.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from barewire import ModbusClient
from barewire.modbus import ModbusException, WriteMultipleRegisters
from tests.helpers import free_port, refused
from tests.interop.exchanges import Answers, exchange_all
from tests.interop.our_side import RecordingClient, client_url, our_server, port_of, with_both
from tests.interop.relay import relayed, serial_at, serial_server, tls_before, tls_from
from tests.interop.services import BITS_AND_REGISTERS, proves

pytestmark = pytest.mark.needs("libmodbus", "cc", "openssl", "socat")

HERE = Path(__file__).parent
SERVED = (*BITS_AND_REGISTERS, "11", "16", "17")


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Compile the client and the server without a warning; return their files."""
    where = tmp_path_factory.mktemp("libmodbus")
    made = {}
    for name in ("client", "server"):
        source, made[name] = HERE / f"libmodbus_{name}.c", where / name
        flags = ["-D_GNU_SOURCE", "-std=c11", "-Wall", "-Wextra", "-Werror", "-o", str(made[name])]
        subprocess.run(["cc", *flags, str(source), "-lmodbus"], check=True, timeout=60)
    return made


CARRIERS = ("tcp", "rtu", "rtu+tcp", "tls")
ASKED = [proves("libmodbus", "server", carrier, *SERVED, "07") for carrier in CARRIERS]


@pytest.mark.parametrize("carrier", [*ASKED, pytest.param("tcp_pi", marks=ASKED[0].marks)])
def test_every_call_of_their_client(
    programs: dict[str, Path], carrier: str, certificates: Path, exchanged: set[str]
) -> None:
    ours = "tcp" if carrier == "tcp_pi" else carrier
    with ExitStack() as stack:
        place, unit = stack.enter_context(our_server(ours, certificates, exchanged))
        if carrier == "rtu+tcp":
            place = stack.enter_context(serial_at(port_of(place)))
        elif carrier == "tls":
            place = f"127.0.0.1:{stack.enter_context(tls_from(port_of(place), certificates))}"
        kind = carrier.partition("+")[0].replace("tls", "tcp")
        command = [str(programs["client"]), kind, *([place] if kind == "rtu" else place.split(":"))]
        done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert done.stderr == ""
    assert done.stdout.splitlines()[-1] == "all"
    assert unit.coils[20] == 1
    assert list(unit.holding_registers[2000:2123]) == list(range(1000, 1123))


@contextmanager
def their_server(programs: dict[str, Path], carrier: str, certificates: Path) -> Iterator[tuple[str, str]]:
    """Run libmodbus's server in a process of its own; yield PATH or HOST:PORT for our client, and its version."""
    with ExitStack() as stack:
        if carrier == "rtu":
            theirs, place = stack.enter_context(relayed())
        elif carrier == "rtu+tcp":
            theirs, port = stack.enter_context(serial_server())
        else:
            port = free_port()
            theirs = str(port)
        kind = carrier.partition("+")[0].replace("tls", "tcp")
        command = [str(programs["server"]), kind, theirs]
        process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        stack.callback(process.kill)
        assert process.stdout is not None
        ready, version = process.stdout.readline().split()
        assert ready == "ready"
        if carrier == "tls":
            port = stack.enter_context(tls_before(port, certificates))
        yield place if carrier == "rtu" else f"127.0.0.1:{port}", version


ANSWERED = [proves("libmodbus", "client", carrier, *SERVED) for carrier in CARRIERS]


@pytest.mark.parametrize("carrier", [*ANSWERED, pytest.param("tcp_pi", marks=ANSWERED[0].marks)])
def test_our_clients_use_their_server(
    programs: dict[str, Path], carrier: str, certificates: Path, exchanged: set[str]
) -> None:
    with their_server(programs, carrier, certificates) as (place, version):
        answers = Answers(registers=100, coils=100, server_id=b"\xb4\xffLMB" + version.encode())

        async def talk(client: RecordingClient) -> None:
            await exchange_all(client, answers, SERVED)
            with refused(ModbusException, "busy"):
                await client.read_holding_registers(50, 1)
            assert await client.read_holding_registers(10, 1) == (1,)

        ours = "tcp" if carrier == "tcp_pi" else carrier
        with_both(client_url(ours, place, certificates), exchanged, talk)


@pytest.mark.parametrize("carrier", ["rtu", "rtu+tcp"])
def test_their_server_carries_out_our_broadcast(programs: dict[str, Path], carrier: str, certificates: Path) -> None:
    with (
        their_server(programs, carrier, certificates) as (place, _),
        ModbusClient(client_url(carrier, place, certificates)) as client,
    ):
        client.broadcast(WriteMultipleRegisters(70, (7, 8)))
        assert client.read_holding_registers(69, 3) == (0, 7, 8)
