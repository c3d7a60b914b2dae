"""The counters of a unit on a serial line. No function reads them over the line here; a program may.

on the line               counted in                                                        [MB-SERIAL, appendix A]
-----------               ----------
not a frame (CRC, LRC)    bus errors
a good frame              bus messages
for this unit, or all     server messages
no response sent          no responses
exception sent            exceptions
"""

from __future__ import annotations

from typing import Any

from barewire.modbus.messages.base import Request, Response

ANSWERED: tuple[type[Request[Any]], ...] = ()
"""The requests about the line that are answered from the counters: none."""


class SerialCounters:
    """The counters of one unit, which begin at 0."""

    def __init__(self, *, has_delimiter: bool = False) -> None:
        self.bus_messages = 0
        self.bus_errors = 0
        self.server_messages = 0
        self.no_responses = 0
        self.exceptions = 0
        self.overruns = 0

    def frame(self) -> None:
        """Count a good frame."""
        self.bus_messages += 1

    def damaged(self) -> None:
        """Count what is not a frame."""
        self.bus_errors += 1

    def overrun(self) -> None:
        """Count a character that the port lost."""
        self.overruns += 1

    def received(self, *, broadcast: bool = False) -> None:
        """Count a request for this unit."""
        self.server_messages += 1

    def ignored(self) -> None:
        """Count a request that is not carried out."""
        self.no_responses += 1

    def finished(self, request: Any, exception: int | None, *, answered: bool) -> None:
        """Count the end of a request."""
        self.exceptions += exception is not None
        self.no_responses += not answered

    def accepts(self, pdu: bytes) -> bool:
        """Return True: every request is carried out."""
        return True

    def answer(self, request: Any) -> Response | None:
        """Return nothing: there are no requests about the line."""
        return None
