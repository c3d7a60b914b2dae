"""The framing state of one TCP connection: the length in the header gives the end of a frame.

TCP may deliver several frames in one read, or one frame in several reads, but never loses or changes a byte. So an
invalid header (protocol not 0, length outside 2..254) means that the stream is not Modbus, or that its frames are no
longer aligned. No later byte can be trusted: the line is *broken*, reports the bytes as noise, and `io` closes the
connection.
"""

from __future__ import annotations

from collections.abc import Callable

from barewire.errors import DecodeError
from barewire.modbus.adu import Adu, Noise, received_adu
from barewire.tcp.frame import BEGINNING, HEADER, LENGTHS, LONGEST, PREFIX, SHORTEST, check_header, decode, encode


class TcpLine:
    """One connection. Each request has the next transaction number, and its response the same one.

    >>> line = TcpLine()
    >>> line.request(1, b"\\x07").hex(" ")
    '00 01 00 00 00 02 01 07'
    >>> line.feed(bytes.fromhex("00 01 00 00 00 03 01 07 6D 00"), now=0.0)
    [Adu(unit=1, pdu=b'\\x07m', transaction=1)]
    >>> line.held
    b'\\x00'

        any_unit           accept responses with another unit than their request, a fault of some gateways
        any_transaction    accept responses with another transaction number. A late response then looks like the
                           right one, so the line is not `numbered`, and needs the precautions of a serial line
        number             a function that returns the next transaction number (default: counted up from 1)
    """

    def __init__(
        self, *, any_unit: bool = False, any_transaction: bool = False, number: Callable[[], int] | None = None
    ) -> None:
        self.numbered = not any_transaction
        self.any_unit = any_unit
        self._held = b""
        self._transaction = 0
        self._unit = 0
        self._number = number
        self.broken: DecodeError | None = None
        """The error after which no received byte can be trusted; None before."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}>"

    @property
    def quiet_at(self) -> float:
        """0: TCP needs no silence before sending."""
        return 0.0

    @property
    def delay(self) -> float:
        """0: a frame is returned with its last byte."""
        return 0.0

    @property
    def deadline(self) -> float | None:
        """None: TCP has no limit for gaps."""
        return None

    @property
    def held(self) -> bytes:
        """The beginning of a frame that has not ended."""
        return self._held

    def request(self, unit: int, pdu: bytes) -> bytes:
        """Return the frame of a request, with the next transaction number."""
        number = self._number() if self._number is not None else self._transaction + 1 & 0xFFFF
        self._transaction = number
        self._unit = unit
        return encode(unit, pdu, number)

    def response(self, to: Adu, pdu: bytes) -> bytes:
        """Return the frame of a response, with the unit and transaction of its request [MB-TCP 4.4.2.3]."""
        return encode(to.unit, pdu, to.transaction or 0)

    def sent(self, now: float) -> None:
        """Do nothing: no silence is needed on this line."""

    def answers(self, adu: Adu) -> bool:
        """Whether the frame has the transaction number and the unit of the last request."""
        is_right_number = not self.numbered or adu.transaction == self._transaction
        return is_right_number and (self.any_unit or adu.unit == self._unit)

    def answer_in(self, data: bytes, now: float) -> bytes | None:
        """Return the PDU if these bytes are exactly one response to the last request; None if `feed` must decode them.

        The state does not change.

        >>> line = TcpLine()
        >>> line.request(1, b"\\x07") and line.answer_in(bytes.fromhex("00 01 00 00 00 03 01 07 6D"), now=0.0)
        b'\\x07m'
        """
        size = len(data)
        if SHORTEST <= size <= LONGEST and not self._held and self.broken is None:
            transaction, protocol, length, unit = HEADER.unpack_from(data)
            if transaction == self._transaction and length == size - PREFIX and unit == self._unit and not protocol:
                return data[7:]
        return None

    def feed(self, data: bytes | None, now: float) -> list[Adu | Noise]:
        """Return all whole frames. After an invalid header all bytes are Noise."""
        if not data:
            return []
        if not self._held and self.broken is None and SHORTEST <= len(data) <= LONGEST:
            # The usual case: one read is one frame.
            transaction, protocol, length = BEGINNING.unpack_from(data)
            if protocol == 0 and PREFIX + length == len(data):
                return [received_adu((data[PREFIX], bytes(data[7:]), transaction))]
        held = self._held + data
        events: list[Adu | Noise] = []
        at, end = 0, len(held)
        while end - at >= PREFIX and self.broken is None:
            transaction, protocol, length = BEGINNING.unpack_from(held, at)
            if protocol or length not in LENGTHS:
                try:
                    check_header(held[at : at + PREFIX])
                except DecodeError as error:
                    self.broken = error
                break
            next_at = at + PREFIX + length
            if next_at > end:
                break
            events.append(received_adu((held[at + PREFIX], held[at + 7 : next_at], transaction)))
            at = next_at
        if self.broken is not None and at < end:
            events.append(Noise(held[at:], self.broken.reason, self.broken.text))
            at = end
        self._held = held[at:]
        return events


class DatagramLine(TcpLine):
    """The same frames over UDP: one datagram is one frame, so no bytes are held and the line never breaks.

    >>> DatagramLine().feed(bytes.fromhex("00 01 00 00 00 03 01"), now=0.0)
    [Noise(data=b'\\x00\\x01\\x00\\x00\\x00\\x03\\x01', reason='short', text='length 3 promises 9 bytes, got 7')]
    """

    def feed(self, data: bytes | None, now: float) -> list[Adu | Noise]:
        """Return one datagram as a frame, or as noise with the reason."""
        if not data:
            return []
        try:
            return [decode(data)]
        except DecodeError as error:
            return [Noise(data, error.reason, error.text)]
