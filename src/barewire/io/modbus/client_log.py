"""The lines that the log of a Modbus client has, blocking or asyncio: logger `barewire.modbus.client`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barewire.io.log import PortLog
from barewire.modbus.adu import Adu, describe_event

if TYPE_CHECKING:
    from barewire.errors import NoAnswer, PortError
    from barewire.io.endpoint import Endpoint
    from barewire.modbus.client.line_state import PendingAnswer
    from barewire.modbus.framing import LineEvent


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
