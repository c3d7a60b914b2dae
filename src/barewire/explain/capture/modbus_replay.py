"""Decodes recordings of Modbus (captures, logs, dumps) with the sniffer that also decodes live lines.

read_modbus_log(data)        what the recording holds: bytes, times, directions
Sniffer                      for RTU and ASCII
NumberedSniffer              for each TCP connection
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Literal, NamedTuple, TypeAlias

from barewire.ascii import AsciiLine
from barewire.errors import EncodeError
from barewire.explain.capture.modbus_log import LoggedBytes, ModbusLog, read_modbus_log
from barewire.explain.capture.modbus_packets import MODBUS_PORTS
from barewire.explain.capture.pcapng import is_capture
from barewire.modbus.adu import Adu
from barewire.modbus.framing import Line
from barewire.modbus.sniffer import WINDOW, NoiseSeen, NumberedSniffer, Sniffer, SnifferEvent
from barewire.rtu import RtuLine, Timing
from barewire.tcp import TcpLine

_ANY_BITRATE = Timing(0.0, 0.0, 0.0)
"""The bit rate of a recording is unknown: only pauses end a frame of unknown length."""


SerialProtocol: TypeAlias = Literal["rtu", "ascii"]

_ASCII_BYTES = b"0123456789ABCDEFabcdef:\r\n"


class Replayed(NamedTuple):
    """The log of a recording and its events, in order."""

    log: ModbusLog
    events: Iterator[SnifferEvent]


def replay(
    data: bytes,
    *,
    window: float = WINDOW,
    ports: Container[int] = MODBUS_PORTS,
    protocol: SerialProtocol | None = None,
) -> Iterator[SnifferEvent]:
    """Return the events of a recording, in order. `protocol` is that of a log or dump; by default its bytes tell.

    >>> [type(event).__name__ for event in replay(b"1.0 01 83 02 C0 F1")]
    ['ResponseSeen']

    Raises DecodeError if the bytes are not a recording, EncodeError for a protocol of a capture, which has its own.
    """
    return replay_log(data, window=window, ports=ports, protocol=protocol).events


def replay_log(
    data: bytes,
    *,
    window: float = WINDOW,
    ports: Container[int] = MODBUS_PORTS,
    protocol: SerialProtocol | None = None,
) -> Replayed:
    """Return the log of a recording too, with the lines that cannot be read. As `replay`."""
    if protocol is not None and is_capture(data):
        text = "a protocol is stated for a log or dump; in a capture each packet has its own"
        raise EncodeError(text, "protocol")
    log = read_modbus_log(data, ports=ports, protocol=protocol)
    return Replayed(log, _events(log, window, protocol))


def _events(log: ModbusLog, window: float, protocol: SerialProtocol | None) -> Iterator[SnifferEvent]:
    items = [item for item in log.items if isinstance(item, LoggedBytes)]
    is_capture = log.form == "capture"
    is_ascii = protocol == "ascii"
    if protocol is None and not is_capture:
        is_ascii = _is_ascii(b"".join(item.data for item in items))
    serial: dict[str, Sniffer] = {}
    numbered: dict[str, NumberedSniffer] = {}
    directions: dict[str, bool | None] = {}
    now = swept = items[0].at if items else 0.0
    for item in items:
        now, name = item.at, item.connection
        if now >= swept + window:
            swept = now
            for pair in numbered.values():
                yield from pair.wait(now)
            for sniffer in serial.values():
                yield from _waited(sniffer, now)
        if item.protocol == "tcp" and item.from_client is not None and protocol is None:
            pair = numbered.setdefault(name, NumberedSniffer(TcpLine(), TcpLine(), window=window))
            if not item.data:
                yield from pair.give_up(now)
            yield from pair.feed(item.from_client, item.data, now)
            continue
        if name not in serial:
            serial[name] = Sniffer(AsciiLine() if is_ascii else _rtu_line(), window=window)
        sniffer = serial[name]
        if item.from_client is not directions.get(name, item.from_client):
            yield from _turned(sniffer, now)
        directions[name] = item.from_client
        yield from _feed(sniffer, item, is_capture)
    for sniffer in serial.values():
        yield from sniffer.end(now)
    for pair in numbered.values():
        yield from pair.end(now)


def _rtu_line() -> Line:
    """Return an RTU line that receives both directions, at any bit rate."""
    return RtuLine(_ANY_BITRATE, role="listener")


def _turned(sniffer: Sniffer, now: float) -> Iterator[SnifferEvent]:
    """End the bytes of one direction when the other station begins, however short the silence was."""
    if (deadline := sniffer.line.deadline) is not None:
        for event in sniffer.feed(None, deadline):
            yield event._replace(at=now) if isinstance(event, NoiseSeen) and event.at > now else event


def _waited(sniffer: Sniffer, now: float) -> Iterator[SnifferEvent]:
    """Feed the deadlines before `now`."""
    while (deadline := sniffer.deadline) is not None and deadline < now:
        yield from sniffer.feed(None, deadline)


def _feed(sniffer: Sniffer, item: LoggedBytes, is_datagram: bool) -> Iterator[SnifferEvent]:
    """Feed the deadlines before the bytes, then the bytes. A datagram is a complete frame, or noise."""
    yield from _waited(sniffer, item.at)
    if not item.data:  # the program that recorded it says that nothing came
        yield from sniffer.give_up(item.at)
        return
    yield from sniffer.feed(item.data, item.at, item.from_client)
    if is_datagram and (deadline := sniffer.line.deadline) is not None:
        yield from sniffer.feed(None, deadline)


def _is_ascii(data: bytes) -> bool:
    """Return whether these are bytes of an ASCII line, wherever the recording begins, and whatever noise is in it.

    No function code of RTU is a character of ASCII frames. Registers with text may consist of such characters, but
    these make no frame with a correct LRC.

    >>> _is_ascii(b"FB1000239\\r\\n"), _is_ascii(bytes.fromhex("01 83 02 C0 F1"))
    (True, False)
    """
    others = len(data.translate(None, _ASCII_BYTES))
    if not others or 2 * others > len(data):
        return bool(data) and not others
    return any(isinstance(event, Adu) for event in AsciiLine().feed(data, 0.0))
