"""Servers in a process with few free file descriptors, and how many connections a server accepts at a time."""

from __future__ import annotations

import contextlib
import gc
import re
import socket
import ssl
import subprocess
import sys
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from barewire import ModbusClient, ModbusServer, Table
from barewire.io.endpoint import Endpoint
from barewire.io.ports import tls
from barewire.io.ports.tls import TlsSession
from barewire.io.server import asyncio_network
from barewire.io.server.limits import BATCH, Acceptor, ConnectionTable
from tests.certificates import tls_url
from tests.helpers import until

SERVER = """
import asyncio, logging, os, resource, sys
from contextlib import suppress
from barewire import AsyncModbusServer, ModbusServer, Table

logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s")
resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))


def obey(server):
    print(server.url, flush=True)
    for order in sys.stdin:  # "take": all descriptors that are left; "release": those
        taken = []
        if order == "take\\n":
            with suppress(OSError):
                while True:
                    taken.append(os.dup(0))
        print(len(taken), flush=True)
        if order == "take\\n":
            sys.stdin.readline()
            for number in taken:
                os.close(number)
            print("released", flush=True)


async def serve():
    async with AsyncModbusServer(sys.argv[2], {1: Table()}) as server:
        await asyncio.to_thread(obey, server)


if sys.argv[1] == "asyncio":
    asyncio.run(serve())
else:
    with ModbusServer(sys.argv[2], {1: Table()}) as server:
        obey(server)
"""


class Starved:
    """A server in a process of its own, with 64 descriptors."""

    def __init__(self, way: str, url: str) -> None:
        pipe = subprocess.PIPE
        command = [sys.executable, "-c", SERVER, way, url]
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
        self.url = self.read()
        host, _, port = re.sub(r"^.*//|\?.*$", "", self.url).rpartition(":")
        self.address = host, int(port)

    def read(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def order(self, word: str) -> str:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{word}\n")
        self._process.stdin.flush()
        return self.read()

    def end(self) -> str:
        """End the server; return its log."""
        try:
            return self._process.communicate(timeout=60)[1]
        finally:
            self._process.kill()
            self._process.wait()


@pytest.fixture
def idle() -> Iterator[contextlib.ExitStack]:
    """The connections of clients that only connect."""
    with contextlib.ExitStack() as stack:
        yield stack


def urls(scheme: str, certificates: Path | None) -> tuple[str, str]:
    """The URL of a server, and the options of its clients."""
    if certificates is None:
        return f"{scheme}://127.0.0.1:0", ""
    return tls_url(certificates, "server", roles="any"), tls_url(certificates, "operator").partition("?")[2] + "&"


def check_log(log: str) -> None:
    assert "Traceback" not in log, log
    assert "asyncio" not in log, log
    assert len(log.splitlines()) < 60, log


def serves_new_clients(server: Starved, options: str) -> None:
    for _ in range(5):
        with ModbusClient(f"{server.url.partition('?')[0]}?{options}timeout=20") as client:
            assert client.read_holding_registers(0, 1) == (0,)


SCHEMES = [
    "tcp",
    "rtu+tcp",
    pytest.param("ascii+tcp", marks=pytest.mark.proof),  # as RTU over TCP, with another framer
    pytest.param("tls", marks=pytest.mark.needs("openssl")),
]
every_scheme = pytest.mark.parametrize("scheme", SCHEMES)
both = pytest.mark.parametrize("way", ["asyncio", "thread"])


@pytest.fixture
def files(scheme: str, request: pytest.FixtureRequest) -> Path | None:
    return request.getfixturevalue("certificates") if scheme == "tls" else None


@both
@every_scheme
def test_more_idle_connections_than_descriptors_keep_no_client_out(
    way: str, scheme: str, files: Path | None, idle: contextlib.ExitStack
) -> None:
    url, options = urls(scheme, files)
    server = Starved(way, url)
    try:
        for _ in range(100):
            idle.enter_context(socket.create_connection(server.address, timeout=20))
        serves_new_clients(server, options)
    finally:
        log = server.end()
    check_log(log)
    (lowered,) = re.findall(r"INFO .*: at most (\d+) connections instead of 1024: \d+ file descriptors are left", log)
    assert 30 <= int(lowered) < 64


@both
@every_scheme
def test_descriptors_that_the_rest_of_the_program_takes_keep_no_client_out(
    way: str, scheme: str, files: Path | None, idle: contextlib.ExitStack
) -> None:
    url, options = urls(scheme, files)
    server = Starved(way, url)
    try:
        serves_new_clients(server, options)
        for _ in range(8):
            idle.enter_context(socket.create_connection(server.address, timeout=20))
        serves_new_clients(server, options)  # so all eight are accepted
        assert int(server.order("take")) > 20
        for _ in range(3):  # the first may get the descriptor of a client that left meanwhile
            idle.enter_context(socket.create_connection(server.address, timeout=20))
        serves_new_clients(server, options)
        assert server.order("release") == "released"
        serves_new_clients(server, options)
    finally:
        log = server.end()
    check_log(log)
    assert "there was no room for another connection: too many open files: closed" in log


@both
@pytest.mark.parametrize("scheme", ["tcp", "rtu+tcp"])
def test_a_server_without_any_descriptor_serves_again_when_there_are_some(way: str, scheme: str) -> None:
    server = Starved(way, f"{scheme}://127.0.0.1:0")
    try:
        serves_new_clients(server, "")
        assert int(server.order("take")) > 20
        with ModbusClient(f"{server.url}?timeout=20") as client:  # it waits to be accepted
            assert server.order("release") == "released"
            assert client.read_holding_registers(0, 1) == (0,)
    finally:
        log = server.end()
    check_log(log)


class Listener:
    """A listener at which some clients wait."""

    def __init__(self, waiting: int) -> None:
        self.waiting = waiting
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.fileno, self.setblocking, self.close = self._socket.fileno, self._socket.setblocking, self._socket.close

    def accept(self) -> tuple[socket.socket, tuple[str, int]]:
        if not self.waiting:
            raise BlockingIOError
        self.waiting -= 1
        return socket.socket(), ("192.0.2.1", 1024)


def test_all_that_wait_are_accepted_together_but_not_without_end() -> None:
    listener: Any = Listener(2 * BATCH + 1)
    acceptor = Acceptor(listener, ConnectionTable(Endpoint.parse("tcp://host")))
    sizes = []
    while listener.waiting:
        batch = acceptor.accept()
        sizes.append(len(batch))
        for connection, _ in batch:
            assert connection.getblocking() is False
            connection.close()
    assert sizes == [BATCH, BATCH, 1]
    with pytest.raises(BlockingIOError):
        acceptor.accept()
    listener.close()


# TLS handshakes -------------------------------------------------------------------------------------------------------


@pytest.mark.needs("openssl")
def test_the_tls_session_of_a_client_that_left_is_freed_at_once(
    certificates: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python's search for circles of references does not know how much memory OpenSSL has, and comes too late."""
    sessions: weakref.WeakSet[TlsSession] = weakref.WeakSet()

    def session(context: ssl.SSLContext) -> TlsSession:
        sessions.add(found := TlsSession(context))
        return found

    monkeypatch.setattr(tls, "TlsSession", session)
    with ModbusServer(tls_url(certificates, "server", roles="any"), {1: Table()}) as server:
        gc.disable()
        try:
            with socket.create_connection(("127.0.0.1", server.port), timeout=20):
                until(lambda: len(sessions) == 1)
            until(lambda: not sessions)
        finally:
            gc.enable()


@pytest.mark.needs("openssl")
def test_half_handshakes_have_a_limit_and_keep_no_client_out(
    certificates: Path, monkeypatch: pytest.MonkeyPatch, idle: contextlib.ExitStack
) -> None:
    monkeypatch.setattr(asyncio_network, "_HANDSHAKES", 3)
    monkeypatch.setattr(asyncio_network, "_SHORTEST", 0.05)
    with ModbusServer(tls_url(certificates, "server", roles="any"), {1: Table()}) as server:
        for number in range(3):
            idle.enter_context(socket.create_connection(("127.0.0.1", server.port), timeout=20))
            until(lambda: server.statistics.opened == number + 1)  # noqa: B023 - it is called at once
        url = tls_url(certificates, "operator", server.url.partition("?")[0].removeprefix("tls://"), timeout="20")
        with ModbusClient(url) as client:
            assert client.read_holding_registers(0, 1) == (0,)
        assert server.connections.closed[0].endswith("the oldest of 3 TLS handshakes under way")
