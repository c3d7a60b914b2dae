"""Decodes recordings of Modbus (captures, logs, dumps) with the sniffer that also decodes live lines.

read_modbus_log(data)        what the recording holds: bytes, times, directions
Sniffer                      for RTU and ASCII
NumberedSniffer              for each TCP connection
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator
from itertools import chain
from typing import Literal, NamedTuple, TypeAlias

from barewire.ascii import AsciiLine
from barewire.errors import EncodeError
from barewire.modbus.adu import Adu, Noise
from barewire.modbus.messages.registry import measure_request, measure_response
from barewire.rtu import RtuLine, Timing
from barewire.tcp import TcpLine
from barewire.tcp.frame import PREFIX
from barewire_workbench.frames.result import ProtocolName
from barewire_workbench.recordings.capture import MODBUS_PORTS, is_capture
from barewire_workbench.recordings.modbus_log import LoggedBytes, ModbusLog, read_modbus_log
from barewire_workbench.sniffer import WINDOW, HeardLine, NumberedSniffer, Sniffer, SnifferEvent

_ANY_BITRATE = Timing(0.0, 0.0, 0.0)
"""The bit rate of a recording is unknown: only pauses end a frame of unknown length."""


SerialProtocol: TypeAlias = Literal["rtu", "ascii"]

_ASCII_BYTES = b"0123456789ABCDEFabcdef:\r\n"


class RecordedTcpLine(TcpLine):
    """One direction of a recorded connection: behind a wrong header it goes on with the next frame that fits.

    A client or server has to close the connection instead (`TcpLine`): it acts on what it reads. `measure` returns the
    length of a PDU of this direction by its function and byte count.

    >>> line = RecordedTcpLine(measure_response)
    >>> line.feed(bytes.fromhex("0001 0001 0003 01 83 02  0002 0000 0003 01 83 02"), 0.0)[1]
    Adu(unit=1, pdu=b'\\x83\\x02', transaction=2)
    """

    def __init__(self, measure: Callable[[bytes], int | None]) -> None:
        super().__init__()
        self._measure = measure

    def feed(self, data: bytes | None, now: float) -> list[Adu | Noise]:
        """Return all whole frames, and what is between them as noise."""
        if not data:
            return []
        events: list[Adu | Noise] = []
        if self._held and (self._begins_frame(data) or self._is_next_header(data)):
            events += self.end()
        length, size = int.from_bytes(data[4:6], "big"), len(data) - PREFIX
        is_message = not self._held and data[2:4] == b"\0\0" and self._measure(data[7:]) == size - 1 > 0
        if is_message and length != size:
            return [*events, Noise(data, "length", f"length {length}, and the whole message has {size} bytes")]
        events += super().feed(data, now)
        while self.broken is not None:
            noise = events.pop()
            assert isinstance(noise, Noise)
            self.broken = None
            size = len(noise.data)
            at = next((at for at in range(1, size - PREFIX) if self._begins_frame(noise.data[at:])), size)
            events.append(Noise(noise.data[:at], noise.reason, noise.text))
            events += super().feed(noise.data[at:], now)
        return events

    def end(self) -> list[Adu | Noise]:
        """Return the held bytes as noise: no more of their frame will come."""
        held, self._held = self._held, b""
        text = f"length {int.from_bytes(held[4:6], 'big')} promises more than the {len(held) - PREFIX} bytes here"
        return [Noise(held, "length", text)] if held else []

    def _is_next_header(self, data: bytes) -> bool:
        """Return whether the bytes are the header that follows the held one: the reader took no more of each frame."""
        if len(data) != len(self._held):
            return False
        number = int.from_bytes(self._held[:2], "big") + 1 & 0xFFFF
        return data.startswith(number.to_bytes(2, "big") + b"\0\0\0") and data[6:7] == self._held[6:7]

    def _begins_frame(self, data: bytes) -> bool:
        """Return whether the bytes begin with a header and a PDU of a known function with that length."""
        size = self._measure(data[7 : int.from_bytes(data[4:6], "big") + PREFIX])
        return (
            len(data) > 7 and data[2:4] == b"\0\0" and size is not None and data[4:6] == (size + 1).to_bytes(2, "big")
        )


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
    return Replayed(log, replay_parts(log, (), window, protocol))


def replay_parts(
    first: ModbusLog, others: Iterable[ModbusLog], window: float = WINDOW, protocol: SerialProtocol | None = None
) -> Iterator[SnifferEvent]:
    """Yield the events of a log that is read part by part."""
    sniffers = LogSniffers(first, window, protocol)
    for log in chain([first], others):
        for item in log.items:
            if isinstance(item, LoggedBytes):
                for _, event in sniffers.feed(item):
                    yield event
    for _, event in sniffers.end():
        yield event


def _as_it_is(line: HeardLine, connection: str, protocol: ProtocolName) -> HeardLine:
    return line


class LogSniffers:
    """The sniffers of a log, one for each serial line and each TCP connection in it: `feed` each item, then `end`.

    Every event comes with the name of its connection. `wrap` may replace each line by one that also keeps what it read.
    """

    def __init__(
        self,
        log: ModbusLog,
        window: float = WINDOW,
        protocol: SerialProtocol | None = None,
        wrap: Callable[[HeardLine, str, ProtocolName], HeardLine] = _as_it_is,
    ) -> None:
        items = [item for item in log.items if isinstance(item, LoggedBytes)]
        self._is_capture = log.form == "capture"
        self._has_protocol = protocol is not None
        self._serial_protocol: SerialProtocol = protocol or "rtu"
        is_known = any(item.protocol in ("rtu", "tcp") for item in items)  # registers with text may look like ASCII
        if (
            protocol is None
            and not self._is_capture
            and not is_known
            and _is_ascii(b"".join(item.data for item in items))
        ):
            self._serial_protocol = "ascii"
        self._window, self._wrap = window, wrap
        self._serial: dict[str, Sniffer] = {}
        self._numbered: dict[str, NumberedSniffer] = {}
        self._directions: dict[str, bool | None] = {}
        self._waiting: dict[str, None] = {}  # the names of those for which something may become due
        self.touched: dict[str, None] = {}
        """The names of the lines and connections that the last `feed` may have changed."""
        self._now = self._swept = items[0].at if items else 0.0

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self._serial)} lines, {len(self._numbered)} connections>"

    def feed(self, item: LoggedBytes) -> Iterator[tuple[str, SnifferEvent]]:
        """Take the next bytes of the log, and yield their events, after those that were due before."""
        now, name = item.at, item.connection
        self._now, self.touched = now, {}
        if now >= self._swept + self._window:
            self._swept, self.touched = now, self._waiting.copy()
            yield from self._sweep(now)
        self.touched[name] = self._waiting[name] = None
        for event in self._numbered_feed(item) if self._is_numbered(item) else self._serial_feed(item):
            yield name, event

    def _sweep(self, now: float) -> Iterator[tuple[str, SnifferEvent]]:
        """Yield what was due before `now`. A log may have a connection for each request, so that most of them are over:
        one for which nothing can become due is passed over until it has bytes again."""
        for name in self.touched:
            if (pair := self._numbered.get(name)) is not None:
                yield from ((name, event) for event in pair.wait(now))
            if (sniffer := self._serial.get(name)) is not None:
                yield from ((name, event) for event in _waited(sniffer, now))
            if all(machine is None or machine.deadline is None for machine in (pair, sniffer)):
                del self._waiting[name]

    def _is_numbered(self, item: LoggedBytes) -> bool:
        return item.protocol == "tcp" and item.from_client is not None and not self._has_protocol

    def _numbered_feed(self, item: LoggedBytes) -> Iterator[SnifferEvent]:
        name = item.connection
        if name not in self._numbered:
            measures = measure_request, measure_response
            lines = [self._wrap(RecordedTcpLine(measure), name, "tcp") for measure in measures]
            self._numbered[name] = NumberedSniffer(*lines, window=self._window)
        if not item.data:
            yield from self._numbered[name].give_up(item.at)
        yield from self._numbered[name].feed(bool(item.from_client), item.data, item.at)

    def _serial_feed(self, item: LoggedBytes) -> Iterator[SnifferEvent]:
        name, protocol = item.connection, self._serial_protocol
        if name not in self._serial:
            line = AsciiLine() if protocol == "ascii" else _rtu_line()
            self._serial[name] = Sniffer(self._wrap(line, name, protocol), window=self._window)
        sniffer = self._serial[name]
        if item.from_client is not self._directions.get(name, item.from_client):
            yield from sniffer.turn(item.at)
        self._directions[name] = item.from_client
        yield from _feed(sniffer, item, self._is_capture)

    def end(self) -> Iterator[tuple[str, SnifferEvent]]:
        """End the log, and yield the events of what is still undecided."""
        self.touched = dict.fromkeys([*self._serial, *self._numbered])
        for name, sniffer in self._serial.items():
            yield from ((name, event) for event in sniffer.end(self._now))
        for name, pair in self._numbered.items():
            yield from ((name, event) for event in pair.end(self._now))


def _rtu_line() -> HeardLine:
    """Return an RTU line that receives both directions, at any bit rate."""
    return RtuLine(_ANY_BITRATE, role="listener")


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
