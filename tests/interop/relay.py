"""Connections to other programs: pseudo-terminals, socat where a program lacks a carrier, a loop for asyncio servers.

relayed()                       pty ===== pty              a serial line; any program may open either end
serial_at(port)                 pty ===== TCP port         connects a program for serial ports to our rtu+tcp server
serial_server(path)             TCP port ===== pty         connects our rtu+tcp client to a program for serial ports
tls_from(port), tls_before(port)     TCP ===== TLS         connects a program without TLS
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import select
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import TypeVar

from barewire.errors import PortError
from barewire.io.ports.pty import PseudoTerminal

T = TypeVar("T")


@contextlib.contextmanager
def relayed() -> Iterator[tuple[str, str]]:
    """Connect two pseudo-terminals; yield the paths of the two ends."""
    ends, stop = (PseudoTerminal(), PseudoTerminal()), threading.Event()

    def carry(source: PseudoTerminal, target: PseudoTerminal) -> None:
        with contextlib.suppress(PortError):
            while not stop.is_set():
                if data := source.receive(0.05):
                    target.send(data)

    threads = [threading.Thread(target=carry, args=pair, daemon=True) for pair in (ends, ends[::-1])]
    for thread in threads:
        thread.start()
    try:
        yield ends[0].path, ends[1].path
    finally:
        stop.set()
        for thread in threads:
            thread.join(2)
        for end in ends:
            end.close()


@contextlib.contextmanager
def _socat(here: str, there: str) -> Iterator[str]:
    """Run socat between two addresses; yield the port or the path that it opened for `here`."""
    command = ["socat", "-d", "-d", here, there]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        assert process.stderr is not None
        reader = threading.Thread(target=process.stderr.read, daemon=True)
        try:
            output = []
            for line in process.stderr:
                output.append(line)
                if found := re.search(r"listening on .*:(\d+)$|PTY is (\S+)$", line.strip()):
                    break
            else:
                raise AssertionError("".join(output))
            reader.start()  # socat logs every connection, and a full pipe would block it
            yield found[1] or found[2]
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait(5)
            if reader.ident is not None:
                reader.join(5)


@contextlib.contextmanager
def serial_at(port: int) -> Iterator[str]:
    """Yield the path of a serial port whose other end is connected to a TCP port."""
    with _socat("PTY,raw,echo=0", f"TCP:127.0.0.1:{port},nodelay") as path:
        held = os.open(path, os.O_RDWR | os.O_NOCTTY)  # else socat ends when the first program closes the port
        try:
            yield path
        finally:
            os.close(held)


@contextlib.contextmanager
def serial_server() -> Iterator[tuple[str, int]]:
    """Run a transparent serial server for one connection at a time; yield the path of its serial port and its TCP port.

    Not socat: its process for a connection that has ended would take the first bytes of the next connection.
    """
    line, stop = PseudoTerminal(), threading.Event()
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        while not stop.is_set():
            if select.select([listener], [], [], 0.05)[0]:
                with listener.accept()[0] as connection, contextlib.suppress(OSError):
                    carry(connection)

    def carry(connection: socket.socket) -> None:
        while not stop.is_set():
            ready = select.select([line.fileno(), connection.fileno()], [], [], 0.05)[0]
            if connection.fileno() in ready:
                if not (data := connection.recv(4096)):
                    return
                line.send(data)
            if line.fileno() in ready:
                connection.sendall(line.receive(0.0) or b"")

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield line.path, listener.getsockname()[1]
    finally:
        stop.set()
        thread.join(5)
        listener.close()
        line.close()


@contextlib.contextmanager
def tls_from(port: int, certificates: Path) -> Iterator[int]:
    """Yield a TCP port whose connections go through TLS to a TLS server."""
    there = f"OPENSSL:127.0.0.1:{port},{_files(certificates, 'operator')}"
    with _socat("TCP-LISTEN:0,bind=127.0.0.1,reuseaddr,fork,nodelay", there) as taken:
        yield int(taken)


@contextlib.contextmanager
def tls_before(port: int, certificates: Path) -> Iterator[int]:
    """Yield a TLS port whose connections go to a server without TLS."""
    here = f"OPENSSL-LISTEN:0,bind=127.0.0.1,reuseaddr,fork,{_files(certificates, 'server')}"
    with _socat(here, f"TCP:127.0.0.1:{port},nodelay") as taken:
        yield int(taken)


def _files(where: Path, name: str) -> str:
    return f"cert={where}/{name}.crt,key={where}/{name}.key,cafile={where}/ca.crt,verify=1"


@contextlib.contextmanager
def in_its_own_loop(serve: Callable[[], AbstractAsyncContextManager[T]]) -> Iterator[T]:
    """Run an asyncio server in a thread with its own loop; yield the value that `serve` yields."""
    ready, given, loops, ends = threading.Event(), list[T](), list[asyncio.AbstractEventLoop](), list[asyncio.Event]()

    async def main() -> None:
        loops.append(asyncio.get_running_loop())
        ends.append(asyncio.Event())
        async with serve() as value:
            given.append(value)
            ready.set()
            await ends[0].wait()

    def run() -> None:
        try:
            asyncio.run(main())
        finally:
            ready.set()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert ready.wait(10)
    assert given, "the server did not start"
    try:
        yield given[0]
    finally:
        loops[0].call_soon_threadsafe(ends[0].set)
        thread.join(10)
