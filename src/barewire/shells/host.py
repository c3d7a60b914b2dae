"""Servers and simulators on real ports: give a host something that answers and a URL, and it listens there.

    host = open_host("tcp://127.0.0.1:0", units={1: Table()})
    host.url            the URL that clients use: the port number, the pseudo-terminal that was made
    host.run(stop)      serves until the event is set; or host.start() / host.close() in a thread of its own

One class for each kind of port: a server on TCP or UDP (asyncio inside), one on a serial line, a node on a CAN bus. The
same machine may have several hosts, each in its thread: one of them at a time enters it (`sharing`).
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Self

from barewire.canopen import CanFrame
from barewire.errors import BarewireError, EncodeError, PortError
from barewire.modbus import Server, Unit
from barewire.shells.aio_server import server_at
from barewire.shells.blocking import Port
from barewire.shells.can_reopen import Reopening, taker
from barewire.shells.can_run import Action, Ears, begin
from barewire.shells.carriers import modbus_line, open_serial
from barewire.shells.endpoint import PSEUDO_TERMINAL, Endpoint, Turn, socketcand_address
from barewire.shells.pseudo_terminal import PseudoTerminal
from barewire.shells.sharing import CanopenNode, SharedNode, SharedUnits
from barewire.shells.socketcand_hub import SocketcandHub
from barewire.shells.tcp_socket import reason

_LOOK = 0.1
"""Seconds between two looks at whether to stop."""


class Host(ABC):
    """What all hosts share: a thread to run in, and an end. `url` is where clients find it."""

    url: str

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.url}>"

    def __init__(self) -> None:
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.failure: BarewireError | None = None
        """Why a host that ran in its own thread ended early."""
        self.on_end: Callable[[], None] | None = None
        """Called when the thread of this host ends, for whatever reason."""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @abstractmethod
    def run(self, stop: threading.Event) -> None:
        """Serve until `stop` is set, then give the port back."""

    def start(self) -> None:
        """Serve in a thread."""
        self._thread = threading.Thread(target=self._run, name=self.url, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.run(self._stop)
        except BarewireError as error:
            self.failure = error
        finally:
            if self.on_end is not None:
                self.on_end()

    def close(self) -> None:
        """Stop serving and wait until the port is given back."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)


class NetworkHost(Host):
    """A server on a TCP or UDP port: tcp, tls, udp, rtu+tcp, ascii+tcp. Port 0 takes a free one."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, Unit]) -> None:
        super().__init__()
        self.server = server_at(endpoint, units)
        host, port = endpoint.host_and_port
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            if endpoint.scheme == "udp":
                self._listener = socket.socket(family, socket.SOCK_DGRAM)
                self._listener.bind((host, port))
            else:
                self._listener = socket.create_server((host, port), family=family)
        except OSError as error:
            raise PortError(f"{host}:{port}: {reason(error)}") from None
        shown = f"[{host}]" if ":" in host else host
        self.url = str(endpoint._replace(place=f"{shown}:{self._listener.getsockname()[1]}"))

    def run(self, stop: threading.Event) -> None:
        """Serve until `stop` is set."""
        asyncio.run(self._serve(stop))

    async def _serve(self, stop: threading.Event) -> None:
        await self.server.listen(self._listener)
        async with self.server:
            while not stop.is_set():
                await asyncio.sleep(_LOOK)


class SerialHost(Host):
    """A Modbus server on a serial line; on a new pseudo-terminal if the URL says `pty` or a path that is not there."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, Unit]) -> None:
        super().__init__()
        self._line = modbus_line(endpoint, "server", units)
        self._server = Server(self._line, units, serial=True)
        self.port: Port[bytes]
        if endpoint.place == PSEUDO_TERMINAL or not os.path.exists(endpoint.place):
            from barewire.shells.serial_port import SerialSettings

            if endpoint.turn is not None:
                raise EncodeError(f"endpoint {str(endpoint)!r}: a new pseudo-terminal has no direction to turn", "turn")
            link = None if endpoint.place == PSEUDO_TERMINAL else endpoint.place
            pace = SerialSettings.of(endpoint).timing if endpoint.integer("pace", 1) else None
            terminal = PseudoTerminal(link, pace)
            self.port = terminal
            self.url = str(endpoint._replace(place=terminal.name))
        else:
            self.port = open_serial(endpoint)
            self.url = str(endpoint)

    def run(self, stop: threading.Event) -> None:
        """Serve until `stop` is set."""
        clock = time.monotonic
        try:
            while not stop.is_set():
                deadline = self._server.deadline
                wait = _LOOK if deadline is None else min(_LOOK, max(0.0, deadline - clock()))
                data = self.port.receive(wait)
                for reply in self._server.feed(data, clock()):
                    time.sleep(max(0.0, reply.at - clock()))
                    self.port.send(reply.data)
                    # Who hears us at once may speak a silence later: that must not be too early for us.
                    self._line.sent(self.port.sent_at if isinstance(self.port, PseudoTerminal) else clock())
        finally:
            self.port.close()


class CanHost(Host):
    """A CANopen node on a bus. A port that fails is opened anew; for the node the bus has only been silent.

    `do` does something with the node from outside and says at once what comes of it. What is changed without that is
    seen within a tenth of a second. `others` counts what came and is no frame of CANopen: reports of the controller,
    CAN FD.
    """

    def __init__(self, endpoint: Endpoint, node: CanopenNode) -> None:
        from barewire.shells.can_bus import CanPort

        super().__init__()
        _check_node(endpoint, node)
        self._node = SharedNode(node)
        self.others = 0
        self._turn = threading.RLock()  # what is said goes out in the order in which it was said
        self._hub = _hub(endpoint)
        self.dial: Callable[[], Port[CanFrame]] = lambda: CanPort(endpoint)
        self.port: Port[CanFrame] = self.dial()
        self.url = str(endpoint)

    def run(self, stop: threading.Event) -> None:
        """Be a node until `stop` is set."""
        clock, reopening, ears = time.monotonic, Reopening(self.dial, stop), Ears(self._node)
        try:
            with self._turn:
                self._send(begin(self._node, clock()))
            while not stop.is_set():
                deadline = self._node.deadline
                wait = _LOOK if deadline is None else min(_LOOK, max(0.0, deadline - clock()))
                try:
                    item = taker(self.port)(wait)
                except PortError as error:
                    opened = reopening.reopen(self.port, str(error))
                    if opened is None:
                        return
                    self.port, item = opened
                self.others += not (item is None or isinstance(item, CanFrame))
                with self._turn:
                    self._send(ears.hear(item, clock()))
        finally:
            self.port.close()
            if self._hub is not None:
                self._hub.close()

    def do(self, action: Action) -> None:
        """`action(now)` while nobody else is in the node. The frames that it returns are said, and what is due then.

        host.do(lambda now: device.error(0x4210, now))
        """
        with self._turn:
            self._send(self._node.do(action, time.monotonic()))

    def _send(self, frames: list[CanFrame]) -> None:
        for frame in frames:
            # A bus without anybody else to acknowledge is no reason for a device to die.
            with contextlib.suppress(PortError):
                self.port.send(frame)


def _check_node(endpoint: Endpoint, node: CanopenNode) -> None:
    """A node-ID in the URL must be the one that the device has: it is a client that is told there whom to ask."""
    told, has = endpoint.integer("node", 0), getattr(node, "node", None)
    has = getattr(has, "node", has)  # a simulated machine has a whole node, which has the number
    if told and isinstance(has, int) and has != told:
        raise EncodeError(f"endpoint {str(endpoint)!r}: node {told} is asked for, and the device is node {has}", "node")


def _hub(endpoint: Endpoint) -> SocketcandHub | None:
    """The bus itself, for a socketcand endpoint on this machine that nobody serves yet."""
    interface, _, channel = endpoint.place.partition("/")
    host, port = socketcand_address(channel)
    if interface != "socketcand" or host not in ("127.0.0.1", "localhost", "::1"):
        return None
    try:
        socket.create_connection((host, port), timeout=1.0).close()
    except ConnectionRefusedError:
        return SocketcandHub(host, port)
    return None


def open_host(
    url: str, *, units: Mapping[int, Unit] | None = None, node: CanopenNode | None = None, turn: Turn | None = None
) -> Host:
    """The host for a URL: `units` for Modbus, `node` for can. The port is taken at once, and served once the host is
    started: by `with`, `start()` or `run(stop)`. `turn(sending)` turns the direction of a two-wire line.

    Raises EncodeError for a URL that does not fit what is to be hosted, PortError for a port that cannot be had.
    """
    endpoint = Endpoint.parse(url).turned_by(turn)
    if endpoint.scheme == "can":
        if node is None:
            raise EncodeError(f"endpoint {url!r}: there is nothing here that speaks CANopen")
        return CanHost(endpoint, node)
    if units is None:
        raise EncodeError(f"endpoint {url!r}: there is nothing here that speaks Modbus")
    shared = SharedUnits(units)
    return SerialHost(endpoint, shared) if endpoint.is_serial_port else NetworkHost(endpoint, shared)
