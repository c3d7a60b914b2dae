"""The framing state of one ASCII line: ':' begins a frame, CR LF ends it, a pause of a second makes it invalid.

    waiting --':'--> inside --CR LF--> frame or noise --> waiting               [MB-SERIAL 2.5.2]
                     inside --':'----> the characters so far were noise, a frame begins again
                     inside --1 s----> noise

Function 08/03 can replace the LF by another character, see below.

The standard has 7 data bits, many devices use 8. If a port set to 8 bits receives a line of 7 bits with parity, the
parity bit arrives as bit 7: `data_bits=7` removes it.

The character that ends a frame behind CR: LF, or the character that function 08/03 set for a unit.

    08 00 03 | character | 00        request, with the current ending
    08 00 03 | character | 00        response, with the current ending; from here on CR and this character
    08 00 01 | 00 or FF  | 00        restart: from its response on CR LF again                   [MB-APP 6.8.1]

The line derives the character from the frames that it sends and receives: if the same message of a unit passes twice,
it was a request and its response, unless both were sent by this side (a repeated request). A restart also takes effect
without a response, because a unit in listen only mode sends none. CR LF always ends a received frame as well, because
other units on the line still use it.
"""

from __future__ import annotations

from barewire.ascii.frame import LONGEST, decode, encode
from barewire.errors import DecodeError, EncodeError, Reason
from barewire.modbus.adu import Adu, Noise

COLON, LF = 0x3A, 0x0A
_CHANGE, _RESTART = b"\x08\x00\x03", b"\x08\x00\x01"
_ALL = 0


class Delimiters:
    """The endings of the units of one line.

    >>> endings = Delimiters()
    >>> for sent in (True, False):
    ...     endings.passed(7, bytes.fromhex("08 0003 3B00"), sent=sent)
    >>> chr(endings.of(7)), chr(endings.of(8)), 0x3B in endings.accepted
    (';', '\\n', True)
    """

    def __init__(self) -> None:
        self.accepted = {LF}
        """The characters that end a received frame behind CR."""
        self._of: dict[int, int] = {}
        self._asked: dict[int, tuple[bytes, bool]] = {}

    def of(self, unit: int) -> int:
        """Return the character that ends a frame to or from this unit."""
        return self._of.get(unit, self._of.get(_ALL, LF))

    def passed(self, unit: int, pdu: bytes, *, sent: bool) -> None:
        """Record a message to or from this unit. `sent`: this side transmitted it; otherwise it was received."""
        asked, was_sent = self._asked.pop(unit, (b"", False))
        is_answer = asked == pdu and not (sent and was_sent)
        if is_answer or (asked[:3] == _RESTART and pdu[:1] != b"\x88"):
            self._apply(unit, asked)
            if is_answer:
                return
        elif asked and pdu[:1] == b"\x88":
            self.accepted = {LF, *self._of.values()}  # declined
        if pdu[:3] in (_CHANGE, _RESTART) and len(pdu) == 5:
            if unit == _ALL:
                self._of.clear()
                self._apply(_ALL, pdu)  # a broadcast has no response
            else:
                self._asked[unit] = (pdu, sent)
                if pdu[:3] == _CHANGE and pdu[3] != COLON:
                    self.accepted.add(pdu[3])

    def _apply(self, unit: int, pdu: bytes) -> None:
        """Apply a request that took effect."""
        character = pdu[3] if pdu[:3] == _CHANGE else LF
        if character != COLON:
            self._of[unit] = character
            self.accepted = {LF, *self._of.values()}


_SEVEN_BITS = bytes(byte & 0x7F for byte in range(256))


class AsciiLine:
    """One line.

    >>> line = AsciiLine()
    >>> line.feed(b":01040FB10002", now=0.0), line.feed(b"39\\r\\n", now=0.1)
    ([], [Adu(unit=1, pdu=b'\\x04\\x0f\\xb1\\x00\\x02', transaction=None)])

        character_timeout    the longest pause between two characters of a frame, in seconds (default 1)
        data_bits            8 (default), or 7 to remove a parity bit that the port delivers as bit 7
    """

    numbered = False
    broken = None
    has_delimiter = True
    """Function 08/03 has an effect on this line: it changes the character that ends a frame."""

    def __init__(self, *, character_timeout: float = 1.0, data_bits: int = 8) -> None:
        if data_bits not in (7, 8):
            raise EncodeError(f"{data_bits} data bits: ASCII characters have 7 or 8", "data_bits")
        self._held = bytearray()
        self._last = 0.0
        self._unit = 0
        self._timeout = character_timeout
        self._seven = data_bits == 7
        self._delimiters = Delimiters()

    def __repr__(self) -> str:
        return "<AsciiLine>"

    @property
    def quiet_at(self) -> float:
        """0: delimiters mark the frames, so no silence is needed before sending."""
        return 0.0

    @property
    def delay(self) -> float:
        """0: a frame is returned with its delimiter."""
        return 0.0

    @property
    def deadline(self) -> float | None:
        """When the pause inside a frame becomes too long; None between frames."""
        return self._last + self._timeout if self._held else None

    @property
    def held(self) -> bytes:
        """The characters of a frame that has not ended."""
        return bytes(self._held)

    def request(self, unit: int, pdu: bytes) -> bytes:
        """Return the frame of a request."""
        self._unit = unit
        return self._encode(unit, pdu)

    def response(self, to: Adu, pdu: bytes) -> bytes:
        """Return the frame of a response."""
        return self._encode(to.unit, pdu)

    def _encode(self, unit: int, pdu: bytes) -> bytes:
        frame = encode(unit, pdu)
        delimiter = self._delimiters.of(unit)
        self._delimiters.passed(unit, pdu, sent=True)
        return frame if delimiter == LF else frame[:-1] + bytes((delimiter,))

    def sent(self, now: float) -> None:
        """Do nothing: no silence is needed on this line."""

    def answers(self, adu: Adu) -> bool:
        """Whether the frame comes from the unit of the last request."""
        return adu.unit == self._unit

    def feed(self, data: bytes | None, now: float) -> list[Adu | Noise]:
        """Return the frames and the noise in `data`, in the order of arrival. None means that only time has passed."""
        events: list[Adu | Noise] = []
        if self._held and now >= self._last + self._timeout:
            events.append(self._drop("silence", f"no character for {self._timeout:g} s inside a frame"))
        if not data:
            return events
        self._last = now
        if self._seven:
            data = data.translate(_SEVEN_BITS)
        at = 0
        while at < len(data):
            if not self._held and (stop := self._whole(data, at)):
                events.append(self._read(data[at:stop]))
                at = stop
                continue
            after_cr = self._held[-1:] == b"\r"
            stop = at + 1 if after_cr else self._quiet_until(data, at)
            piece = data[at:stop]
            at = stop
            if piece == b":" and self._held:
                inside = self._held[0] == COLON
                events.append(self._drop("delimiter", "':' before the frame ended" if inside else "no ':' before it"))
            self._held += piece
            if after_cr and piece[0] in self._delimiters.accepted:
                events.append(self._end())
            elif len(self._held) >= LONGEST:
                # The longest frame is not longer than this, so no further character can complete it.
                events.append(self._drop("long", f"{LONGEST} characters without CR LF"))
        return events

    def _whole(self, data: bytes, at: int) -> int:
        """Return the end of the frame that begins at `at` if all of it is in `data`, the usual case; 0 otherwise."""
        if data[at] != COLON:
            return 0
        end = data.find(b"\r", at, at + LONGEST - 1)
        if not 0 < end < len(data) - 1 or data[end + 1] not in self._delimiters.accepted:
            return 0
        return end + 2 if data.find(b":", at + 1, end) < 0 else 0

    def _quiet_until(self, data: bytes, at: int) -> int:
        """Return the end of the characters that can be added at once: the next ':' or CR, or the longest frame.

        A ':' or CR at `at` is taken alone.
        """
        stop = min(len(data), at + LONGEST - len(self._held))
        for mark in (b":", b"\r"):
            found = data.find(mark, at, stop)
            stop = stop if found < 0 else found
        return max(stop, at + 1)

    def _drop(self, reason: Reason, text: str) -> Noise:
        noise = Noise(bytes(self._held), reason, text)
        self._held.clear()
        return noise

    def _end(self) -> Adu | Noise:
        """End the held characters, which have their delimiter: they are a frame, or noise with the reason."""
        data = bytes(self._held)
        self._held.clear()
        return self._read(data)

    def _read(self, data: bytes) -> Adu | Noise:
        try:
            adu = decode(data if data[-1] == LF else data[:-1] + b"\n")
        except DecodeError as error:
            return Noise(data, error.reason, error.text)
        self._delimiters.passed(adu.unit, adu.pdu, sent=False)
        return adu
