"""What every envelope delivers: a letter with its address, or noise.

    RTU      | unit | PDU                    | CRC |
    ASCII  : | unit | PDU                    | LRC | CR LF
    TCP      | transaction | 0 | length | unit | PDU                    |
                                          '------- ADU, as seen here --'        [MB-APP 4.1]

The PDU (protocol data unit) is the function code and its data, 1 to 253 bytes, the same in all three.
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.errors import EncodeError, Reason

PDU_LIMIT = 253
BROADCAST = 0


class Adu(NamedTuple):
    """One whole frame without its envelope. `transaction` is TCP's number, None where there is none."""

    unit: int
    pdu: bytes
    transaction: int | None = None


class Noise(NamedTuple):
    """Bytes that are no frame, with the reason. On a bus that is weather: reported, counted, never raised.

    Every byte that a line is fed comes out of it in exactly one `Adu` or one `Noise`, or is still held.
    """

    data: bytes
    reason: Reason
    text: str = ""


def check_unit(unit: int) -> None:
    """A unit address is one byte; EncodeError otherwise. 0 is broadcast, 248..255 are reserved on serial lines."""
    if not 0 <= unit <= 255:
        raise EncodeError(f"unit {unit}: expected 0..255", "unit")


def check_pdu(pdu: bytes) -> None:
    """1 to 253 bytes; EncodeError otherwise [MB-APP 4.1]."""
    if not 1 <= len(pdu) <= PDU_LIMIT:
        raise EncodeError(f"a PDU of {len(pdu)} bytes: expected 1..{PDU_LIMIT}", "pdu")
