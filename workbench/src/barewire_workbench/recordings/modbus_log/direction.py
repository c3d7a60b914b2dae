"""Decides for a whole log what its lines leave open: decimal or hexadecimal, the protocol, who is the client.

Whole frames decide: those with a good CRC, a good LRC, or a header with the right length. What they do not prove stays
None, and the sniffer judges each frame by its shape.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from barewire import ascii, rtu, tcp
from barewire.errors import DecodeError
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import measure_request, measure_response
from barewire.modbus.sniffer import shapes
from barewire_workbench.frames.result import ProtocolName
from barewire_workbench.recordings.modbus_log.model import LogEntry, LoggedBytes
from barewire_workbench.recordings.model import Unread

_RARE = 4
"""One of so many pieces at least is a frame in a log of Modbus TCP."""
_MOST_BYTES = 260
"""A longer piece is not one frame."""
PROTOCOLS: tuple[ProtocolName, ...] = ("rtu", "tcp", "ascii")


def frame_pdu(protocol: ProtocolName, data: bytes) -> bytes | None:
    """Return the PDU if the bytes are exactly one frame of that protocol.

    >>> frame_pdu("rtu", bytes.fromhex("018302C0F1")), frame_pdu("tcp", bytes.fromhex("018302C0F1"))
    (b'\\x83\\x02', None)
    """
    try:
        if protocol == "rtu":
            return rtu.decode(data).pdu if len(data) <= _MOST_BYTES else None
        if protocol == "tcp":
            return tcp.decode(data).pdu
        return ascii.decode(data if data.endswith(b"\n") else data.rstrip(b"\r\n") + b"\r\n").pdu
    except DecodeError:
        return None


def frames_by_protocol(pieces: Iterable[bytes]) -> dict[ProtocolName, int]:
    """Return how many of the pieces are one whole frame, for each protocol."""
    counts: dict[ProtocolName, int] = dict.fromkeys(PROTOCOLS, 0)
    for data in pieces:
        for protocol in PROTOCOLS:
            pdu = frame_pdu(protocol, data)
            counts[protocol] += pdu is not None and (protocol != "tcp" or _has_its_length(pdu))
    return counts


def _has_its_length(pdu: bytes) -> bool:
    """Return whether a PDU has the length of its function. A header of TCP has no checksum: an RTU request of two
    registers from address 0 with a wrong CRC has one, 01 03 | 00 00 | 00 02."""
    if pdu[0] & EXCEPTION_BIT:
        return len(pdu) == 2
    sizes = measure_request(pdu), measure_response(pdu)
    return pdu[0] != 0 and (len(pdu) in sizes or sizes == (None, None))


def common_protocol(pieces: Sequence[bytes]) -> ProtocolName | None:
    """Return the protocol of most pieces; None if no piece is a frame."""
    counts = frames_by_protocol(pieces)
    best = max(counts, key=lambda protocol: counts[protocol])
    if best == "tcp" and _RARE * counts[best] < len(pieces):
        return None  # frames of another protocol in pieces, one of which looks like a header of TCP
    return best if counts[best] else None


def is_decimal(entries: list[LogEntry]) -> bool:
    """Return whether the digits of the entries are decimal numbers and not hexadecimal ones.

    Raises DecodeError if they are frames in neither or in both.
    """
    as_decimal = [entry.decimal for entry in entries if entry.decimal is not None]
    as_hex = [entry.data for entry in entries if entry.data is not None]
    if len(as_hex) == len(entries) and len(as_decimal) < len(entries):
        return False
    if len(as_hex) < len(entries) and len(as_decimal) == len(entries):
        return True
    frames = [sum(frames_by_protocol(pieces).values()) for pieces in (as_hex, as_decimal)]
    if frames[0] == frames[1] and as_hex != as_decimal:
        line = next((entry.line for entry in entries if entry.decimal is not None), entries[0].line)
        text = f"line {line}: hexadecimal or decimal? no frame of the log decides it; write hexadecimal numbers with 0x"
        raise DecodeError("value", b"", 0, text)
    return frames[1] > frames[0]


def recorder_is_client(entries: Sequence[LogEntry], protocol: ProtocolName | None) -> bool | None:
    """Return whether the recording program is the client: it sent requests, or received responses. None if no frame
    shows it, for requests and responses to a write are equal."""
    votes = 0
    for entry in entries:
        pdu = None if entry.data is None or protocol is None else frame_pdu(protocol, entry.data)
        if entry.sent is None or not pdu:
            continue
        request, response = shapes(pdu)
        if request != response:
            votes += 1 if request == entry.sent else -1
    return None if votes == 0 else votes > 0


def with_transactions(items: list[LoggedBytes | Unread], open_numbers: set[bytes]) -> list[LoggedBytes | Unread]:
    """Return the pieces of Modbus TCP with their direction: the first frame with a transaction number is a request,
    the next one its response, unless its shape tells. A piece of several frames becomes several. `open_numbers` are
    those of the requests without a response, before and after."""
    done: list[LoggedBytes | Unread] = []
    for item in items:
        if isinstance(item, Unread) or item.protocol != "tcp" or item.from_client is not None:
            done.append(item)
            continue
        for data in _frames(item.data):
            pdu = frame_pdu("tcp", data)
            if pdu is None:
                done.append(item._replace(data=data))
                continue
            request, response = shapes(pdu)
            is_request = request if request != response else data[:2] not in open_numbers
            if is_request:
                open_numbers.add(data[:2])
            else:
                open_numbers.discard(data[:2])
            done.append(item._replace(data=data, from_client=is_request))
    return done


def _frames(data: bytes) -> list[bytes]:
    """Return the frames of a piece by the lengths in their headers."""
    frames: list[bytes] = []
    while len(data) >= 8 and data[2:4] == b"\x00\x00":
        size = 6 + int.from_bytes(data[4:6], "big")
        frames.append(data[:size])
        data = data[size:]
    return [*frames, data] if data else frames
