"""The TCP port by itself: waiting, polling, and both after the system has taken over the time-out."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Iterator

import pytest

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.async_links import Mailbox
from barewire.io.ports.network import TcpPort, UdpPort, listening_socket
from tests.io.peers import peer
from tests.io.ports.receiving import receiving

SOON, LONG = 0.05, 30.0


@pytest.fixture
def ends() -> Iterator[tuple[TcpPort, socket.socket]]:
    """A port, and the socket at its other end."""
    other: list[socket.socket] = []
    there, done = threading.Event(), threading.Event()

    def hold(connection: socket.socket) -> None:
        other.append(connection)
        there.set()
        done.wait(60)

    with peer(hold) as number:
        port = TcpPort("127.0.0.1", number)
        assert there.wait(10)
        yield port, other[0]
        port.close()
        done.set()


def exchanged(ends: tuple[TcpPort, socket.socket], times: int, timeout: float) -> None:
    """Often enough that the system keeps the time-out."""
    port, other = ends
    for number in range(times):
        port.send(bytes([number]))
        assert other.recv(1) == bytes([number])
        other.sendall(bytes([number]))
        assert port.receive(timeout) == bytes([number])


@pytest.mark.parametrize("times", [0, 1, 3])
def test_receive_waits_exactly_for_its_time_out(ends: tuple[TcpPort, socket.socket], times: int) -> None:
    port, other = ends
    exchanged(ends, times, LONG)
    assert port.receive(0.0) is None  # it does not wait for half a minute
    for _ in range(3):
        assert port.receive(SOON) is None
    assert port.receive(0.0) is None
    other.sendall(b"x")
    assert port.receive(LONG) == b"x"
    assert port.receive(2 * SOON) is None


@pytest.mark.parametrize("times", [0, 3])
def test_the_peer_closes_the_connection_during_receive(ends: tuple[TcpPort, socket.socket], times: int) -> None:
    port, other = ends
    exchanged(ends, times, LONG)
    hanging_up = threading.Timer(SOON, other.shutdown, [socket.SHUT_RDWR])
    hanging_up.start()
    with pytest.raises(PortError, match="the other side closed the connection"):
        port.receive(LONG)
    hanging_up.join()


@pytest.mark.parametrize("times", [0, 3])
def test_another_thread_closes_the_port_during_receive(ends: tuple[TcpPort, socket.socket], times: int) -> None:
    port, _ = ends
    exchanged(ends, times, 2 * LONG)
    thread, errors = receiving(port)
    thread.join(SOON)
    port.close()
    thread.join(LONG)
    assert errors == [f"{port.name}: the port was closed"]
    thread.join()


@pytest.mark.parametrize("times", [0, 3])
def test_a_closed_port_raises_that_it_was_closed(ends: tuple[TcpPort, socket.socket], times: int) -> None:
    port, _ = ends
    exchanged(ends, times, LONG)
    port.close()
    for timeout in (LONG, 0.0):
        with pytest.raises(PortError, match="the port was closed"):
            port.receive(timeout)
    with pytest.raises(PortError, match="the port was closed"):
        port.send(b"x")


@pytest.mark.parametrize("times", [0, 3])
def test_sending_more_than_the_system_takes_at_once(
    ends: tuple[TcpPort, socket.socket], times: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is sent as the peer reads, and given up if the peer never does. Both leave the port usable."""
    port, other = ends
    exchanged(ends, times, LONG)
    much = bytes(1 << 24)
    found = bytearray()

    def read() -> None:
        while len(found) < len(much):
            found.extend(other.recv(1 << 20))

    reading = threading.Thread(target=read)
    reading.start()
    port.send(much)
    reading.join(30)
    assert bytes(found) == much
    exchanged(ends, 1, LONG)
    assert port.receive(0.0) is None
    monkeypatch.setattr("barewire.io.ports.network.CONNECT_TIMEOUT", 0.1)

    def send_more() -> None:
        """A system may hold 16 MiB and more for a socket that was read quickly before; but not 256."""
        for _ in range(16):
            port.send(much)

    with pytest.raises(PortError, match="timed out"):
        send_more()


def test_data_for_a_cancelled_task_is_received_by_the_next_task() -> None:
    """Also when both happen in the same round of the loop, in either order."""

    async def main(cancelled_first: bool) -> None:
        box = Mailbox("somewhere")
        waiting = asyncio.ensure_future(box.receive(LONG))
        await asyncio.sleep(0)
        if cancelled_first:
            waiting.cancel()
        box.put(b"one")
        box.put(b"two")
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        assert [await box.receive(LONG), await box.receive(0.0), await box.receive(0.0)] == [b"one", b"two", None]
        box.fail("gone")

    for cancelled_first in (True, False):
        asyncio.run(main(cancelled_first))


def test_data_before_the_end_of_a_connection_is_received_first() -> None:
    async def main() -> None:
        box = Mailbox("somewhere")
        waiting = asyncio.ensure_future(box.receive(LONG))
        await asyncio.sleep(0)
        box.put(b"one")
        box.put(b"two")
        box.fail("gone")
        assert [await waiting, await box.receive(LONG)] == [b"one", b"two"]
        with pytest.raises(PortError, match="gone"):
            await box.receive(LONG)

    asyncio.run(main())


@pytest.mark.parametrize("scheme", ["tcp", "udp"])
def test_an_address_of_ipv6_is_named_as_in_its_url(scheme: str) -> None:
    listener, url = listening_socket(Endpoint.parse(f"{scheme}://[::1]:0"))
    with listener:
        place = url.removeprefix(f"{scheme}://")
        with pytest.raises(PortError) as taken:
            listening_socket(Endpoint.parse(url))
        assert str(taken.value).startswith(f"{place}: ")
        port = (TcpPort if scheme == "tcp" else UdpPort)("::1", listener.getsockname()[1])
        assert port.name == place
        port.close()
