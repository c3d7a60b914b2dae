"""Modbus/TCP Security: roles, and the errors for certificates that are wrong, expired or missing."""

from __future__ import annotations

import asyncio
import json
import re
import socket
import ssl
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from barewire import AsyncModbusClient, ModbusClient, ModbusServer
from barewire.errors import DecodeError, EncodeError, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.tls import server_context, tls_reason
from barewire.modbus import ModbusException, Table, WriteSingleRegister
from barewire.modbus.server.authorization import role_of
from tests.certificates import tls_url
from tests.helpers import refused, until
from tests.io.peers import answer, peer, read_exactly

pytestmark = pytest.mark.needs("openssl")

ROLES = {
    "Viewer": [{"functions": [1, 2, 3, 4]}],
    "Operator": [{"functions": [1, 2, 3, 4]}, {"functions": [6, 16], "units": "1-9", "addresses": "0-99"}],
}


@pytest.fixture
def host(certificates: Path) -> Iterator[ModbusServer]:
    roles = certificates / "roles.json"
    roles.write_text(json.dumps(ROLES))
    with ModbusServer(tls_url(certificates, "server", roles=str(roles)), units={1: Table()}) as host:
        yield host


def place(host: ModbusServer) -> str:
    return host.url.partition("?")[0].removeprefix("tls://")


def closed_because(host: ModbusServer) -> str:
    """Why the server closed the latest connection."""
    until(lambda: bool(host.connections.closed))
    return host.connections.closed[-1]


def test_a_role_that_may_write_writes(host: ModbusServer, certificates: Path) -> None:
    with ModbusClient(tls_url(certificates, "operator", place(host))) as client:
        client.write_single_register(5, 42)
        client.write_multiple_registers(6, (43, 44))
        assert client.read_holding_registers(5, 3) == (42, 43, 44)
        with pytest.raises(ModbusException) as caught:
            client.write_single_register(100, 1)
        assert caught.value.code == 1
        with pytest.raises(ModbusException):
            client.write_multiple_registers(99, (1, 2))  # the role may not write the second
        with pytest.raises(ModbusException):
            client.at(unit=10).write_single_register(5, 1)


def test_a_role_that_may_only_read_gets_exception_01_for_a_write(host: ModbusServer, certificates: Path) -> None:
    with ModbusClient(tls_url(certificates, "viewer", place(host))) as client:
        assert client.read_holding_registers(5, 1) == (0,)
        with pytest.raises(ModbusException) as caught:
            client.write_single_register(5, 1)
        assert caught.value.code == 1
        assert client.read_holding_registers(5, 1) == (0,)


def test_refusals_are_logged_and_counted(
    host: ModbusServer, certificates: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for name, who in (("viewer", "role 'Viewer'"), ("norole", "a client without a role")):
        with ModbusClient(tls_url(certificates, name, place(host))) as client, pytest.raises(ModbusException):
            client.write_single_register(5, 1)
        request = "WriteSingleRegister(address=5, value=1)"
        text = f": unit 1: {who} may not send {request}, exception 01"
        assert any(message.endswith(text) for message in caplog.messages)
    with socket.create_connection(("127.0.0.1", host.port)) as plain:
        plain.sendall(b"GET / HTTP/1.0\r\n\r\n")
        why = closed_because(host)
    assert f"{host.url.partition('?')[0]}: {why}: closed" in caplog.messages
    counted = host.statistics
    assert (counted.denied, counted.exceptions, counted.opened, counted.broken) == (2, 2, 3, 0)
    until(lambda: counted.refused == 1)


def test_a_certificate_without_a_role_is_refused_by_a_table_of_roles(host: ModbusServer, certificates: Path) -> None:
    with (
        ModbusClient(tls_url(certificates, "norole", place(host))) as client,
        pytest.raises(ModbusException) as caught,
    ):
        client.read_holding_registers(5, 1)
    assert caught.value.code == 1


def test_the_asyncio_client_over_tls(host: ModbusServer, certificates: Path) -> None:
    async def main() -> None:
        async with AsyncModbusClient(tls_url(certificates, "operator", place(host)), in_flight=16) as client:
            await asyncio.gather(*(client.write_single_register(register, register) for register in range(50)))
            assert await client.read_holding_registers(0, 50) == tuple(range(50))
            with pytest.raises(ModbusException):
                await client.ask(WriteSingleRegister(100, 1))

    asyncio.run(main())


def test_an_asyncio_client_receives_all_tls_records_that_arrived_together(certificates: Path) -> None:
    """The answers are in the system's buffer, each in its own record. asyncio decrypts them one after the other into
    slices of the buffer that it gets, so a slice must not be a copy."""
    context = server_context(Endpoint.parse(tls_url(certificates, "server", roles="any")))
    all_said = threading.Event()

    def main(connection: socket.socket) -> None:
        with context.wrap_socket(connection, server_side=True) as tls:
            for request in [read_exactly(tls, 12) for _ in range(16)]:
                tls.sendall(answer(request))
            all_said.set()
            tls.recv(1)

    async def ask(port: int) -> None:
        url = tls_url(certificates, "operator", f"127.0.0.1:{port}", timeout="30")
        async with AsyncModbusClient(url, in_flight=16) as client:
            requests = [asyncio.ensure_future(client.read_holding_registers(register, 1)) for register in range(16)]
            while not all_said.wait(0.0):  # the loop stands still between two checks
                await asyncio.sleep(0)
                all_said.wait(0.05)
            assert await asyncio.gather(*requests) == [(register,) for register in range(16)]

    with peer(main) as port:
        asyncio.run(ask(port))


@pytest.mark.parametrize(
    ("name", "ca", "client_says", "server_says"),
    [
        ("expired", "ca", "the other side refuses our certificate: it has expired", "certificate has expired"),
        (
            "other-ca",
            "ca",
            "refuses our certificate: it does not trust the CA that signed it",
            "unable to get local issuer",
        ),
        (
            "operator",
            "other",
            "the other side's certificate is refused: self-signed certificate in certificate chain",
            "trust the CA that signed",
        ),
        # Refused after the handshake: closed or reset, depending on the system.
        ("odd", "ca", "127.0.0.1:", "the role in the certificate is not one UTF8String"),
    ],
)
def test_a_wrong_client_certificate_is_one_line_on_both_sides(
    host: ModbusServer, certificates: Path, name: str, ca: str, client_says: str, server_says: str
) -> None:
    with (
        refused(PortError, client_says) as caught,
        ModbusClient(tls_url(certificates, name, place(host), ca=ca)) as client,
    ):
        client.read_holding_registers(0, 1)  # in TLS 1.3 a client gets the refusal with its first data
    assert "\n" not in str(caught.value)
    assert server_says in closed_because(host)


@pytest.mark.parametrize(
    ("server", "message"),
    [("expired-server", "certificate has expired"), ("other-ca-server", "unable to get local issuer certificate")],
)
def test_a_wrong_server_certificate_is_an_error_of_the_client(certificates: Path, server: str, message: str) -> None:
    with ModbusServer(tls_url(certificates, server, roles="any"), units={1: Table()}) as host:
        url = tls_url(certificates, "operator", place(host))
        with refused(PortError, message):
            ModbusClient(url)
        with refused(PortError, message):
            asyncio.run(AsyncModbusClient(url).open())


def test_a_certificate_for_another_host_name_is_an_error(host: ModbusServer, certificates: Path) -> None:
    with refused(PortError, "Hostname mismatch, certificate is not valid for 'pump7'"):
        ModbusClient(tls_url(certificates, "operator", place(host), server_name="pump7"))


def test_no_client_connects_without_a_name_to_check(host: ModbusServer, certificates: Path) -> None:
    """asyncio takes an empty name for none, and would accept the certificate of any server."""
    for where, query in ((place(host), {"server_name": ""}), (f":{host.port}", {})):
        url = tls_url(certificates, "operator", where, **query)
        with refused(EncodeError, "server_name="):
            ModbusClient(url)
        with refused(EncodeError, "server_name="):
            asyncio.run(AsyncModbusClient(url).open())
    assert not host.connections.closed


def test_a_client_without_a_certificate_of_its_own(certificates: Path, tmp_path: Path) -> None:
    """Server-only TLS: the server asks for no certificate, and its clients have the role "", that of no role."""
    (tmp_path / "roles.json").write_text('{"": [{"functions": [3]}]}')
    url = f"tls://127.0.0.1:0?cert={certificates}/server.crt&key={certificates}/server.key&client_cert=none"
    with ModbusServer(f"{url}&roles={tmp_path}/roles.json", units={1: Table()}) as host:
        own = f"tls://{place(host)}?ca={certificates}/ca.crt"

        async def main() -> tuple[int, ...]:
            async with AsyncModbusClient(own) as client:
                return await client.read_holding_registers(5, 1)

        assert asyncio.run(main()) == (0,)
        with ModbusClient(own) as client:
            assert client.read_holding_registers(5, 1) == (0,)
            with pytest.raises(ModbusException) as caught:
                client.write_single_register(5, 1)
            assert caught.value.code == 1
        with refused(PortError, "certificate is refused"):
            ModbusClient(f"tls://{place(host)}?ca={certificates}/other.crt")
        # A certificate that is not asked for is not looked at.
        with ModbusClient(tls_url(certificates, "operator", place(host))) as client:
            assert client.read_holding_registers(5, 1) == (0,)


def test_a_client_without_a_certificate_is_refused_by_a_server_that_requires_one(
    host: ModbusServer, certificates: Path
) -> None:
    with (
        refused(PortError, "requires a certificate and received none"),
        ModbusClient(f"tls://{place(host)}?ca={certificates}/ca.crt") as client,
    ):
        client.read_holding_registers(5, 1)  # in TLS 1.3 a client gets the refusal with its first data


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ("", "TLS needs ca=FILE"),
        ("ca={0}/ca.crt&cert={0}/viewer.crt", "cert without key: a certificate of its own needs both"),
        ("ca={0}/ca.crt&key={0}/viewer.key", "key without cert: a certificate of its own needs both"),
        ("ca={0}/ca.crt&client_cert=sometimes", "client_cert='sometimes', expected one of required, none"),
    ],
)
def test_wrong_certificate_options_of_a_client(certificates: Path, query: str, message: str) -> None:
    with refused(EncodeError, message):
        ModbusClient(f"tls://127.0.0.1:1?{query.format(certificates)}", lazy=True)


def test_a_client_without_certificate_is_an_error(host: ModbusServer, certificates: Path) -> None:
    address, _, port = place(host).partition(":")
    context = ssl.create_default_context(cafile=str(certificates / "ca.crt"))
    with (
        socket.create_connection((address, int(port)), 5) as raw,
        context.wrap_socket(raw, server_hostname=address) as client,
        pytest.raises(OSError, match=r"CERTIFICATE_REQUIRED|reset"),
    ):
        client.recv(1)
    assert "the other side showed no certificate" in closed_because(host)


def test_a_peer_without_tls_is_an_error_on_both_sides(host: ModbusServer, certificates: Path) -> None:
    with (
        ModbusClient(f"tcp://{place(host)}?timeout=5") as client,
        pytest.raises(PortError),
    ):
        client.read_holding_registers(0, 1)
    assert "the other side does not use TLS" in closed_because(host)
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as plain, pytest.raises(PortError, match=r"TLS|closed"):
        ModbusClient(tls_url(certificates, "operator", plain.url.removeprefix("tcp://")))


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (ssl.SSLZeroReturnError(6, "TLS/SSL connection has been closed (EOF) (_ssl.c:992)"), "ended the connection"),
        (
            ssl.SSLEOFError(8, "EOF occurred in violation of protocol (_ssl.c:992)"),
            "ended the connection in the middle",
        ),
        (ssl.SSLError(1, "[SSL] record layer failure (_ssl.c:992)"), "TLS failed: record layer failure"),
        (ssl.SSLError(1, "unknown error (_ssl.c:992)"), "TLS failed: unknown error"),
    ],
)
def test_an_error_that_python_has_no_reason_for_has_a_text(error: ssl.SSLError, text: str) -> None:
    assert text in tls_reason(error)


def test_tls_1_1_is_refused(host: ModbusServer, certificates: Path) -> None:
    run = subprocess.run(
        ["openssl", "s_client", "-connect", place(host), "-tls1_1", "-cipher", "ALL:@SECLEVEL=0"],
        input=b"",
        capture_output=True,
        timeout=20,
    )
    assert run.returncode != 0


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("tls://127.0.0.1:0?key={0}/server.key&ca={0}/ca.crt", "TLS needs cert=FILE"),
        (
            "tls://127.0.0.1:0?cert={0}/server.crt&key={0}/server.key",
            "TLS needs ca=FILE: cert, key and ca; or client_cert=none, to ask clients for no certificate",
        ),
        ("tls://127.0.0.1:0?cert={0}/server.crt&key={0}/server.key&ca={0}/none", "ca: there is no file"),
        ("tls://127.0.0.1:0?cert={0}/server.crt&key={0}/viewer.key&ca={0}/ca.crt", "they do not belong together"),
        ("tls://127.0.0.1:0?cert={0}/ca.cnf&key={0}/ca.key&ca={0}/ca.crt", "no certificate and key in PEM"),
        ("tls://127.0.0.1:0?cert={0}/server.crt&key={0}/server.key&ca={0}/ca.cnf", "no certificate in PEM"),
        (
            "tls://127.0.0.1:0?cert={0}/server.crt&key={0}/server.key&ca={0}/ca.crt",
            "roles=FILE is the table of the rights of each role",
        ),
        ("tls://127.0.0.1:0?cert={0}/server.crt&key={0}/server.key&ca={0}/ca.crt&roles={0}/ca.crt", "table of roles"),
    ],
)
def test_wrong_certificate_files_are_an_error_at_construction(certificates: Path, url: str, message: str) -> None:
    with refused(EncodeError, message):
        ModbusServer(url.format(certificates), units={1: Table()})


def test_a_table_of_roles_that_is_not_a_text_is_an_error_of_one_line(certificates: Path, tmp_path: Path) -> None:
    (tmp_path / "roles.json").write_bytes(b'{"Viewer\xff": []}')
    with refused(EncodeError, "not UTF-8 at byte 8"):
        ModbusServer(tls_url(certificates, "server", roles=str(tmp_path / "roles.json")), units={1: Table()})


def test_the_programs_of_the_tls_page_run(tmp_path: Path) -> None:
    page = Path(__file__, "../../../../docs/how-to/tls.md").resolve().read_text(encoding="utf-8")
    shell, table, program = (
        "".join(re.findall(f"```{kind}\n(.*?)```", page, re.S)) for kind in ("sh", "json", "python")
    )
    assert "ModbusClient(" in program
    assert "AsyncModbusClient(" in program
    (tmp_path / "roles.json").write_text(table)
    subprocess.run(["sh", "-e", "-c", shell], cwd=tmp_path, check=True, capture_output=True, timeout=60)
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True, timeout=60)


def der(certificate: Path) -> bytes:
    return ssl.PEM_cert_to_DER_cert(certificate.read_text())


def test_the_role_in_a_certificate(certificates: Path) -> None:
    assert role_of(der(certificates / "operator.crt")) == "Operator"
    assert role_of(der(certificates / "norole.crt")) is None
    with pytest.raises(DecodeError, match="not one UTF8String"):
        role_of(der(certificates / "odd.crt"))


def test_part_of_a_certificate_is_a_decode_error(certificates: Path) -> None:
    whole = der(certificates / "operator.crt")
    for length in range(0, len(whole), 7):
        with pytest.raises(DecodeError):
            role_of(whole[:length])
