"""Where the races on a CAN bus take place, each contestant beside a neutral responder of its own (`can_responder`).

    socket pair     16 bytes a frame through a pair of sockets, as through a raw CAN socket, on any Linux
    vcan            a virtual CAN interface of the kernel for each contestant
    python-can      its virtual bus; there the responder is a thread

On the socket pair python-can runs its own code for SocketCAN, on a socket that is one end of the pair.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from typing import Any
from unittest.mock import patch

import can

from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.python_can import CanPort
from barewire.io.ports.can.socketcan import SocketCanPort
from bench.can_responder import FRAME, serve

_numbers = count()


class Place:
    """One end of a bus of its own; a neutral responder is at the other."""

    def raw(self) -> socket.socket:
        """Return a socket of 16 bytes a frame."""
        raise NotImplementedError

    def python_can(self) -> can.BusABC:
        """Return a bus of python-can."""
        raise NotImplementedError

    def ours(self) -> Any:
        """Return the port that barewire uses here."""
        raise NotImplementedError

    def over_python_can(self) -> Any:
        """Return barewire's port over python-can."""
        raise NotImplementedError


def _responder(closing: ExitStack, place: str, **options: Any) -> None:
    command = [sys.executable, "-m", "bench.can_responder", place]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, **options)
    closing.callback(process.wait)
    closing.callback(process.kill)
    assert process.stdout is not None
    closing.callback(process.stdout.close)
    assert process.stdout.readline() == b"ready\n"


class SocketPair(Place):
    """A pair of sockets."""

    def __init__(self, closing: ExitStack) -> None:
        self.socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        closing.callback(self.socket.close)
        for end in (self.socket, other):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)  # python-can does not wait for room: a block
        with other:
            _responder(closing, str(other.fileno()), pass_fds=[other.fileno()])

    def raw(self) -> socket.socket:
        return self.socket

    @contextmanager
    def _is_opened(self) -> Iterator[None]:
        """Let python-can open this socket."""
        module = "can.interfaces.socketcan.socketcan"
        with patch(f"{module}.create_socket", lambda: self.socket), patch(f"{module}.bind_socket"):
            yield

    def python_can(self) -> can.BusABC:
        with self._is_opened():
            return can.Bus(interface="socketcan", channel="pair")

    def over_python_can(self) -> CanPort:
        with self._is_opened():
            return CanPort(Endpoint.parse("can://socketcan/pair"))

    def ours(self) -> SocketCanPort:
        return SocketCanPort(Endpoint.parse("can://socketcan/pair"), opened=self.socket)


class Vcan(Place):
    """A virtual CAN interface of the kernel."""

    def __init__(self, closing: ExitStack) -> None:
        if not hasattr(socket, "AF_CAN"):
            raise ImportError("Python without SocketCAN")
        try:
            socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
        except OSError:
            raise ImportError("a kernel without SocketCAN: see bench/README.md") from None
        self.name = f"bench{next(_numbers)}"
        subprocess.run(["ip", "link", "add", self.name, "type", "vcan"], check=True)
        closing.callback(subprocess.run, ["ip", "link", "del", self.name], check=True)
        subprocess.run(["ip", "link", "set", self.name, "up"], check=True)
        _responder(closing, self.name)

    def raw(self) -> socket.socket:
        port = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        port.bind((self.name,))
        return port

    def python_can(self) -> can.BusABC:
        return can.Bus(interface="socketcan", channel=self.name)

    def over_python_can(self) -> CanPort:
        return CanPort(Endpoint.parse(f"can://socketcan/{self.name}"))

    def ours(self) -> SocketCanPort:
        return SocketCanPort(Endpoint.parse(f"can://socketcan/{self.name}"))


class Virtual(Place):
    """The virtual bus of python-can."""

    def __init__(self, closing: ExitStack) -> None:
        self.name = f"bench{next(_numbers)}"
        bus, ended = self.python_can(), threading.Event()

        def receive() -> bytes:
            while not ended.is_set():
                message = bus.recv(0.05)
                if message is not None:
                    return FRAME.pack(message.arbitration_id, message.dlc, bytes(message.data))
            return b""

        def send(frame: bytes) -> None:
            identifier, length, data = FRAME.unpack(frame)
            bus.send(can.Message(arbitration_id=identifier, is_extended_id=False, data=data[:length]))

        thread = threading.Thread(target=serve, args=(receive, send))
        thread.start()
        closing.callback(bus.shutdown)
        closing.callback(thread.join)
        closing.callback(ended.set)

    def python_can(self) -> can.BusABC:
        return can.Bus(interface="virtual", channel=self.name)

    def ours(self) -> CanPort:
        return CanPort(Endpoint.parse(f"can://virtual/{self.name}"))


PLACES = {"a socket pair": SocketPair, "vcan": Vcan, "python-can's virtual bus": Virtual}
