"""The log of errors in the code of units: the client gets exception 04 only, the program gets the traceback.

    unit 7: ReadInputRegisters(address=3, quantity=2): its code failed, exception 04: no sensor
    Traceback (most recent call last): ...

The logger is `barewire.modbus.server`. A unit may fail with every request, so each unit is logged once per second; the
next text has the number of errors between.

Depends on: logging, loaded with the first error.  Used by: the Modbus servers.
"""

from __future__ import annotations

from contextlib import suppress
from time import monotonic
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barewire.modbus.messages.registry import AnyRequest

_INTERVAL = 1.0
"""Seconds between two texts for one unit."""


class FailureLog:
    """Logs the errors of the units of one server. It is the `on_failure` of `barewire.modbus.Server`."""

    def __init__(self) -> None:
        self._next: dict[int, float] = {}  # by unit: when it may be logged again
        self._left_out: dict[int, int] = {}  # by unit: errors since the last one logged

    def __call__(self, unit: int, request: AnyRequest | None, error: Exception) -> None:
        now = monotonic()
        if now < self._next.get(unit, now):
            self._left_out[unit] = self._left_out.get(unit, 0) + 1
            return
        self._next[unit] = now + _INTERVAL
        count = self._left_out.pop(unit, 0)
        more = f" ({count} more since the last one logged)" if count else ""
        with suppress(Exception):  # texts of the application, and its handlers of the log, may fail as well
            self._log(unit, request, error, more)

    @staticmethod
    def _log(unit: int, request: AnyRequest | None, error: Exception, more: str) -> None:
        import logging

        try:
            why = str(error)
        except Exception:
            why = type(error).__name__
        place = f"unit {unit}" if request is None else f"unit {unit}: {request}"
        logger = logging.getLogger("barewire.modbus.server")
        logger.error("%s: its code failed, exception 04: %s%s", place, why, more, exc_info=error)
