"""The base classes of servers: how they start, how they end, and the log of those of Modbus.

    server.start(), server.close()     in a thread of its own; so does `with server:`
    server.run(stop)                   in the caller's thread, until the event is set or the server is closed
    await server.start()               in the running loop; so does `async with server:`

A server serves once: after that its port may belong to another program, so a second `run` or `start` raises PortError.

An error in the code of a unit, in the log of `barewire.modbus.server`; the client gets exception 04 only:

    unit 7: ReadInputRegisters(address=3, quantity=2): its code failed, exception 04: ValueError: no sensor
    Traceback (most recent call last): ...
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Self

from barewire.errors import BarewireError, PortError
from barewire.io.log import PortLog

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Collection, Iterable

    from barewire.io.endpoint import Endpoint
    from barewire.io.fault_injection.faults import Faults
    from barewire.modbus.messages.registry import AnyRequest

POLL_INTERVAL = 0.1
"""Seconds between two checks whether to stop."""
_CLOSING = 5.0
"""Seconds that `close` waits for the port to be free."""


class ThreadedServer(ABC):
    """A server in a thread. Its constructor opens the port."""

    url: str
    """The URL for clients, with the port number or the pseudo-terminal that it got."""
    _logger: str
    """The name of its logger."""

    def __init__(self) -> None:
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._starting = threading.Lock()
        self._has_started = False
        self._served_by = 0  # the identity of the thread
        self._released = threading.Event()
        self.failure: BaseException | None = None
        """The error that ended a server that runs in its own thread."""
        self.on_end: Callable[[], None] | None = None
        """Called when the thread of the server ends, for whatever reason."""
        self.faults: Faults[Any] | None = None
        """The model of the faults in its answers, which may be given others; None without the argument `faults`."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.url}>"

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def run(self, stop: threading.Event) -> None:
        """Serve until `stop` is set or the server is closed, then release the port."""
        self._begin()
        self._serve_once(stop)

    def start(self) -> None:
        """Serve in a thread."""
        self._begin()
        self._thread = threading.Thread(target=self._run, name=self.url, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving and wait until the port is free, 5 s at most. A server that was never started is closed as well.

        While a unit is handling a request the server cannot end; if that takes longer than 5 s, it ends afterwards.
        If a unit calls it, in the serving thread, it does not wait; the server ends after the call of the unit.
        """
        with self._starting:
            has_started, self._has_started = self._has_started, True
        self._stop.set()
        if not has_started:
            self._release()
            self._released.set()
        elif self._served_by != threading.get_ident():
            until = time.monotonic() + _CLOSING
            self._released.wait(_CLOSING)
            if self._thread is not None:
                self._thread.join(timeout=max(0.0, until - time.monotonic()))

    def is_over(self, stop: threading.Event) -> bool:
        """Return whether the server must stop: the event is set, or the server is closed."""
        return stop.is_set() or self._stop.is_set()

    def _is_over_in(self, stop: threading.Event, seconds: float) -> bool:
        """Wait for so many seconds. Return whether the server must stop, as soon as it must."""
        until = time.monotonic() + seconds
        while not self.is_over(stop) and (left := until - time.monotonic()) > 0.0:
            self._stop.wait(min(left, POLL_INTERVAL))
        return self.is_over(stop)

    @abstractmethod
    def _serve(self, stop: threading.Event) -> None:
        """Serve until it `is_over`."""

    @abstractmethod
    def _release(self) -> None:
        """Release the port. Called once."""

    def _begin(self) -> None:
        with self._starting:
            if self._has_started:
                raise _serves_once(self.url)
            self._has_started = True

    def _serve_once(self, stop: threading.Event) -> None:
        self._served_by = threading.get_ident()
        try:
            self._serve(stop)
        finally:
            self._release()
            self._released.set()

    def _run(self) -> None:
        try:
            self._serve_once(self._stop)
        except BarewireError as error:
            self.failure = error
            PortLog(self._logger, self.url.partition("?")[0]).error("ended", f"ended: {error}")
        except BaseException as error:
            self.failure = error
            text = f"ended: its code failed: {type(error).__name__}: {error}"
            PortLog(self._logger, self.url.partition("?")[0]).error("ended", text, error)
            raise
        finally:
            if self.on_end is not None:
                self.on_end()


class AsyncServer(ABC):
    """A server in the running loop. Its constructor opens nothing."""

    url: str
    """The URL for clients. After `start` it has the number of the port that the system chose for port 0."""
    _has_started = _is_closed = False
    _opened: asyncio.Future[None] | None = None  # done when `start` has ended, well or not

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.url}>"

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def failure(self) -> BaseException | None:
        """The error that ended the server, or None."""
        return None

    async def start(self) -> None:
        """Open the port and begin to serve. Raises PortError if that fails, or if the server has run or was closed.

        If it fails, is cancelled, or the server is closed meanwhile, nothing stays open.
        """
        if self._has_started:
            raise _serves_once(self.url)
        import asyncio  # not at the top: the servers without asyncio do not need it

        self._has_started = True
        opened = self._opened = asyncio.get_running_loop().create_future()
        try:
            await self._open()
            if self._is_closed:
                raise PortError(f"{self.url}: closed while it started")
        except BaseException:
            await self._release()
            raise
        finally:
            opened.set_result(None)

    async def close(self) -> None:
        """Stop serving, close all connections and release the port. It waits for a `start` that is under way."""
        self._has_started = self._is_closed = True
        if self._opened is not None and not self._opened.done():
            from asyncio import wait

            await wait([self._opened])
        await self._release()

    @abstractmethod
    async def _open(self) -> None:
        """Open the port and begin to serve. Called once."""

    @abstractmethod
    async def _release(self) -> None:
        """Release what `_open` opened, also if it failed. May be called twice."""


def _serves_once(url: str) -> PortError:
    return PortError(f"{url}: a server serves once: this one has run, or was closed")


class ServerLog(PortLog):
    """The log of one server. `failed` is the `on_failure` of `barewire.modbus.Server`."""

    _is_serving = False
    _units: Collection[int] = ()

    def serving(self, url: str, units: Collection[int]) -> None:
        """Log that the server has begun. Each line begins with this URL from now on, without its options."""
        self._is_serving, self._units = True, units
        self.place = url.partition("?")[0]
        self.info("serving", f"serving {units_in_words(units)}")

    def stopped(self) -> None:
        """Log that the server was closed, if it has begun."""
        if self._is_serving:
            self._is_serving = False
            self.info("closed", "closed")
            self.flush()

    def failed(self, unit: int, request: AnyRequest | None, error: BaseException) -> None:
        """Log an error in the code of a unit, with its traceback. One that `ends_program` is raised again."""
        if ends_program(error):
            raise error
        try:
            why = f"{type(error).__name__}: {error}"
        except Exception:
            why = type(error).__name__
        place = f"unit {unit}" if request is None else f"unit {unit}: {request}"
        # On TCP a client may choose any of 256 numbers, and one unit answers for those that are not served.
        served = None
        with suppress(Exception):  # the units may be an object of the application
            served = unit if unit in self._units else None
        self.error((served, type(request), type(error)), f"{place}: its code failed, exception 04: {why}", error)

    def refused(self, unit: int, request: AnyRequest | None, peer: str, role: str | None = None) -> None:
        """Log a request that the client's role does not permit, or that is for a unit which is not served."""
        if request is None:
            self.info("unit", f"{peer}: unit {unit} is not served, exception 0B")
        else:
            client = f"role {role!r}" if role else "a client without a role"
            self.warning("denied", f"{peer}: unit {unit}: {client} may not send {request}, exception 01")


def ends_program(error: BaseException) -> bool:
    """Return whether an error in the code of a unit has to end the program.

    Ctrl-C, and `sys.exit` in the handler of a signal, are raised in whatever code the main thread is running. In other
    threads they, and everywhere `asyncio.CancelledError` and the like, are errors of the unit: its code is not awaited.
    """
    is_in_main_thread = threading.current_thread() is threading.main_thread()
    return is_in_main_thread and isinstance(error, (KeyboardInterrupt, SystemExit))


def server_log(endpoint: Endpoint) -> ServerLog:
    """Return the log of a server at this endpoint."""
    return ServerLog("barewire.modbus.server", f"{endpoint.scheme}://{endpoint.place}")


def units_in_words(units: Iterable[int]) -> str:
    """Name the units of a server.

    >>> units_in_words([1]), units_in_words([7, 1]), units_in_words(range(1, 100))
    ('unit 1', 'units 1, 7', '99 units')
    """
    addresses = sorted(units)
    if len(addresses) > 16:
        return f"{len(addresses)} units"
    return f"unit{'' if len(addresses) == 1 else 's'} {', '.join(map(str, addresses)) or 'none'}"
