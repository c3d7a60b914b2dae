"""What the connections of both clients have in common: their log, the pauses between attempts to connect, what an error
means for them. Logger `barewire.modbus.client`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar

from barewire.errors import BarewireError, NoAnswer, PortError
from barewire.io.engine.connections import BackOff
from barewire.io.log import PortLog
from barewire.modbus.adu import Adu, describe_event
from barewire.modbus.exceptions import ModbusException
from barewire.tcp import TcpLine

if TYPE_CHECKING:
    from barewire.io.endpoint import Endpoint
    from barewire.io.ports.base import Watch
    from barewire.modbus.client.bus import Bus
    from barewire.modbus.client.line_state import PendingAnswer
    from barewire.modbus.framing import LineEvent
    from barewire.modbus.messages.base import Request


class ClientLog(PortLog):
    """The log of one client."""

    def __init__(self, endpoint: Endpoint) -> None:
        super().__init__("barewire.modbus.client", f"{endpoint.scheme}://{endpoint.place}")

    def connected(self) -> None:
        """Log that the port is open."""
        self.info("connected", "connected")

    def not_connected(self, error: PortError, pause: float) -> None:
        """Log that the port could not be opened, and the pause before the next attempt."""
        self.info("not connected", f"not connected: {self.short(error)}; next attempt after {pause:.2f} s")

    def renamed(self, text: str) -> None:
        """Log that an adapter has another name than it had."""
        self.warning("renamed", text)

    def lost(self, why: str) -> None:
        """Log that the connection ended, and why; without a reason the program closed it."""
        self.info("closed", f"connection given up: {self.short(why)}" if why else "closed")

    def no_answer(self, unit: int | None, error: NoAnswer) -> None:
        """Log a request without an answer."""
        self.info(("no answer", unit), str(error))

    def stray(self, event: LineEvent, late: PendingAnswer | None) -> None:
        """Log a frame, or noise, that was discarded because it does not answer the open request."""
        if late is not None and isinstance(event, Adu):
            shown = event.pdu.hex(" ").upper()
            self.info("late", f"late answer discarded: unit {late.unit}, to {late.request}: {shown}")
        else:
            self.info("discarded", f"discarded: {describe_event(event)}")

    def foreign(self, frame: bytes) -> None:
        """Log a frame on a connection with several requests under way that answers none of them: nearly always late."""
        self.info("discarded", f"discarded: no request has this transaction number: {frame[:16].hex(' ').upper()}")


class ConnectionBase:
    """The base class of both connections. `watch` is called with all bytes."""

    harmless: ClassVar[tuple[type[BaseException], ...]] = (BarewireError,)
    """The exceptions by which no received bytes are lost. Others, such as Ctrl-C, come at any line."""

    def __init__(self, endpoint: Endpoint, jitter: Callable[[], float], watch: Watch | None) -> None:
        first, longest = endpoint.pauses
        self.back_off = BackOff(jitter, first=first, longest=longest)
        self._watch = watch
        self._log = ClientLog(endpoint)
        self.endpoint = endpoint
        if endpoint.is_serial_port:
            from barewire.io.adapter import Adapter

            self.endpoint = endpoint._replace(adapter=Adapter(endpoint.place, self._log.renamed))
        self._closed = ""  # why requests are refused, if they are
        self.on_lost: Callable[[str], object] | None = None
        """Called with the reason when the connection is lost, not when the program closes it."""

    def pause_before_opening(self, now: float, patience: float) -> float:
        """Return the seconds until the next attempt to connect. Raises PortError if they are more than `patience`."""
        self._check_not_closed()
        pause = self.back_off.wait(now)
        if pause > patience:
            raise PortError(f"{self.back_off.why}; tried again in {pause:.1f} s")
        return pause

    def _check_not_closed(self) -> None:
        """Raise PortError if the client was closed, which may happen while a request waits, or connects."""
        if self._closed:
            raise PortError(self._closed)

    def _not_opened(self, error: PortError, now: float) -> None:
        self.back_off.failed(now, str(error))
        self._log.not_connected(error, self.back_off.wait(now))

    def _lost(self, why: str) -> None:
        """Log the end of the connection, and report it; without a reason the program closed it."""
        self._log.lost(why)
        if why and self.on_lost is not None:
            try:
                self.on_lost(why)
            except Exception as error:  # a connection is given up in whatever state the program is
                self._log.error("on_lost", f"on_lost raised {type(error).__name__}: {error}", error)

    def _opened(self) -> None:
        self.back_off.reset()
        self._log.connected()

    def _is_lost_by(self, error: BaseException, bus: Bus, unit: int | None, request: Request[Any] | None) -> bool:
        """Complete the error of an exchange and log it. Return whether the connection is of no use after it."""
        if isinstance(error, ModbusException):
            error.add_place(unit, getattr(request, "address", None))
        elif isinstance(error, NoAnswer):
            if self.endpoint.is_serial_port and not bus.counters.answered:
                self._add_settings(error)
            self._log.no_answer(unit, error)
        has_failed = isinstance(error, PortError) or isinstance(error.__cause__, PortError)
        # Bytes may be lost between the port and the line. The frames of a stream without a check sum cannot be found
        # again then.
        has_gap = isinstance(bus.line, TcpLine) and not isinstance(error, self.harmless)
        return has_failed or has_gap or bus.line.broken is not None

    def _add_settings(self, error: NoAnswer) -> None:
        """Add the settings of the port to the error: as long as no unit has answered, they may be the cause."""
        from barewire.io.ports.pty import is_pseudo_terminal
        from barewire.io.ports.serial import SerialSettings

        if not is_pseudo_terminal(self.endpoint.place):
            error.add_context(
                f"the port is set to {SerialSettings.of(self.endpoint)}, with which no unit has answered yet"
            )
