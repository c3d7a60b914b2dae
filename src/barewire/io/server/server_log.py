"""The lines in the log of a Modbus server: logger `barewire.modbus.server`. Those of connections: `connection_limits`.

    unit 7: ReadInputRegisters(address=3, quantity=2): its code failed, exception 04: ValueError: no sensor
    Traceback (most recent call last): ...

The client gets exception 04 only, the program gets the traceback.
"""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import TYPE_CHECKING

from barewire.io.log import PortLog

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from barewire.io.endpoint import Endpoint
    from barewire.modbus.messages.registry import AnyRequest


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
            who = f"role {role!r}" if role else "a client without a role"
            self.warning("denied", f"{peer}: unit {unit}: {who} may not send {request}, exception 01")


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
    found = sorted(units)
    if len(found) > 16:
        return f"{len(found)} units"
    return f"unit{'' if len(found) == 1 else 's'} {', '.join(map(str, found)) or 'none'}"
