"""Names of the Modbus services, as docs/reference/interop.md lists them, and the mark of a test that proves some."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.modbus import Diagnostics
from barewire.modbus.messages.diagnostics import SUB_FUNCTIONS

BITS_AND_REGISTERS = ("01", "02", "03", "04", "05", "06", "0F", "10")
DIAGNOSTICS = tuple(f"08/{sub:02X}" for sub in SUB_FUNCTIONS)
EVERY = (*BITS_AND_REGISTERS, "07", *DIAGNOSTICS, "0B", "0C", "11", "14", "15", "16", "17", "18", "2B/0E")
"""Every public function that another program supports."""
NO_PEER = {
    "2B/0D": "CANopen General Reference: no available program supports it, in any direction. Its bytes are compared "
    "with those of two manuals (`vectors/`); both dialects are exchanged between our own client and our own server "
    "over every carrier, and tshark recognises its MEI type.",
}
"""Public functions that no other program supports, with the evidence that replaces a peer."""
PUBLIC = (*EVERY, *NO_PEER)

TCP_LIKE = ("tcp", "udp", "tls")
CARRIERS = ("rtu", "ascii", *TCP_LIKE, "rtu+tcp", "ascii+tcp")


def service(request: Any) -> str:
    """Return the service of a request: 03, 08/0A, 2B/0E."""
    if isinstance(request, Diagnostics):
        return f"08/{request.sub_function:02X}"
    pdu: bytes = request.encode()
    return f"2B/{pdu[1]:02X}" if pdu[0] == 0x2B else f"{pdu[0]:02X}"


def without(*services: str) -> tuple[str, ...]:
    """Return every service but these."""
    return tuple(code for code in EVERY if code not in services)


def proves(peer: str, role: str, carrier: str, *services: str) -> Any:
    """Return a carrier as parameter of a test, with the mark of the services that the test proves over it."""
    return pytest.param(carrier, marks=pytest.mark.evidence(peer, role, carrier, *services))
