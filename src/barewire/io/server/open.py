"""Servers and simulators on real ports: give a host something that answers and a URL, and it listens there.

    host = open_host("tcp://127.0.0.1:0", units={1: Table()})
    host.url            the URL that clients use: the port number, the pseudo-terminal that was made
    host.run(stop)      serves until the event is set; or host.start() / host.close() in a thread of its own

One class for each kind of port, in a file of its own, loaded when it is asked for:

    host_tcp       tcp:// without asyncio          host_network   tls, udp, rtu+tcp, ascii+tcp, with asyncio inside
    host_serial    rtu, ascii on a serial line     host_can       a node on a CAN bus

The same machine may have several hosts, each in its thread: one of them at a time enters it (`sharing`).
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Self

from barewire.errors import BarewireError, EncodeError, PortError
from barewire.io.endpoint import Endpoint

if TYPE_CHECKING:
    from barewire.io.endpoint import Turn
    from barewire.io.server.locking import CanopenNode
    from barewire.modbus import Unit

LOOK = 0.1
"""Seconds between two looks at whether to stop."""


class Host(ABC):
    """What all hosts share: a thread to run in, and an end. `url` is where clients find it.

    A host serves once: what was its port may be anybody's afterwards. `run` and `start` raise PortError then.
    """

    url: str

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.url}>"

    def __init__(self) -> None:
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._beginning = threading.Lock()
        self._has_begun = False
        self._served_by = 0  # the thread
        self._over = threading.Event()  # the port is given back
        self.failure: BarewireError | None = None
        """Why a host that ran in its own thread ended early."""
        self.on_end: Callable[[], None] | None = None
        """Called when the thread of this host ends, for whatever reason."""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(self, stop: threading.Event) -> None:
        """Serve until `stop` is set or the host is closed, then give the port back."""
        self._begin()
        self._serve_alone(stop)

    @abstractmethod
    def _serve(self, stop: threading.Event) -> None:
        """Serve until it `is_over`."""

    @abstractmethod
    def _give_back(self) -> None:
        """Give the port back. Called once."""

    def is_over(self, stop: threading.Event) -> bool:
        """Whether to stop: because of this event, or because the host is closed."""
        return stop.is_set() or self._stop.is_set()

    def _begin(self) -> None:
        with self._beginning:
            if self._has_begun:
                raise PortError(f"{self.url}: a host serves once: this one has begun, or was closed")
            self._has_begun = True

    def _serve_alone(self, stop: threading.Event) -> None:
        self._served_by = threading.get_ident()
        try:
            self._serve(stop)
        finally:
            self._give_back()
            self._over.set()

    def start(self) -> None:
        """Serve in a thread."""
        self._begin()
        self._thread = threading.Thread(target=self._run, name=self.url, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._serve_alone(self._stop)
        except BarewireError as error:
            self.failure = error
        finally:
            if self.on_end is not None:
                self.on_end()

    def close(self) -> None:
        """Stop serving and wait until the port is given back, 5 s at most; also of a host that nobody started.

        Who closes it while it serves them, as a unit might, does not wait for itself: it stops after that.
        """
        with self._beginning:
            has_begun, self._has_begun = self._has_begun, True
        self._stop.set()
        if not has_begun:
            self._give_back()
            self._over.set()
        elif self._served_by != threading.get_ident():
            self._over.wait(5.0)
            if self._thread is not None:
                self._thread.join(timeout=5.0)


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
        from barewire.io.server.can import CanHost

        return CanHost(endpoint, node)
    if units is None:
        raise EncodeError(f"endpoint {url!r}: there is nothing here that speaks Modbus")
    from barewire.io.server.locking import SharedUnits

    shared = SharedUnits(units)
    if endpoint.is_serial_port:
        from barewire.io.server.serial import SerialHost

        return SerialHost(endpoint, shared)
    if endpoint.scheme == "tcp":
        from barewire.io.server.tcp import TcpHost

        return TcpHost(endpoint, shared)
    from barewire.io.server.asyncio_thread import NetworkHost

    return NetworkHost(endpoint, shared)
