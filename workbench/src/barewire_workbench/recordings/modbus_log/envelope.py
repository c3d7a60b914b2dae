"""RTU frames inside the frames of another protocol: Solarman V5, which loggers of inverters speak on TCP port 8899.

    A5  17 00   10 45    00 00     B4 50 BC 83   02 00 ...         01 03 00 3C 00 14 85 C9   53   15
    |   length  control  sequence  logger        15 bytes (or 14)  an RTU frame              sum  end

Length and the number of the logger are sent low byte first. The control code is 45h in a request, 15h in a response.
The sum is that of all bytes between the first one and itself. A logger that has no RTU frame to return sends two bytes
in its place. The protocol is not published by its maker; this is what the logs of several clients agree on.
"""

from __future__ import annotations

from typing import NamedTuple

ENVELOPE_START, _END = 0xA5, 0x15
_AROUND, _TO_PAYLOAD = 13, 11
"""Bytes around the payload, and before it."""
_HEADS = {b"\x10\x45": (True, 15), b"\x10\x15": (False, 14)}
"""Whether the client sends this control code, and the bytes of its payload before the RTU frame."""


class Envelope(NamedTuple):
    """What a frame of Solarman V5 says; `inner` is the RTU frame, or what stands in its place."""

    from_client: bool
    logger: int
    inner: bytes


def envelope_size(data: bytes, at: int = 0) -> int | None:
    """Return the size of the frame of Solarman V5 that begins here; None if none does.

    >>> envelope_size(bytes.fromhex("A51000101500C9C22576F80201032D0000790800007106D6630600BD15"))
    29
    """
    if data[at : at + 1] != bytes((ENVELOPE_START,)) or data[at + 3 : at + 5] not in _HEADS:
        return None
    end = at + _AROUND + int.from_bytes(data[at + 1 : at + 3], "little")
    if end > len(data) or data[end - 1] != _END or sum(data[at + 1 : end - 2]) & 0xFF != data[end - 2]:
        return None
    return end - at


def opened(data: bytes) -> Envelope | None:
    """Return the content of bytes that are one frame of Solarman V5.

    >>> opened(bytes.fromhex("A51000101500C9C22576F80201032D0000790800007106D6630600BD15"))
    Envelope(from_client=False, logger=4168492482, inner=b'\\x06\\x00')
    """
    if envelope_size(data) != len(data):
        return None
    from_client, head = _HEADS[data[3:5]]
    return Envelope(from_client, int.from_bytes(data[7:11], "little"), data[_TO_PAYLOAD + head : -2])
