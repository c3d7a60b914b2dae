"""The framing state of one ASCII line: ':' begins, CR LF ends, and a second between characters is too long.

    waiting --':'--> inside --CR LF--> frame or noise --> waiting               [MB-SERIAL 2.5.2]
                     inside --':'----> what came so far was noise, begin again
                     inside --1 s----> noise

Characters travel with 7 data bits by the standard and with 8 on many devices. When a port that reads 8 bits hears a
line of 7 with parity, the parity bit comes as bit 7: `data_bits=7` takes it off.
"""

from __future__ import annotations

from barewire.ascii.frame import LONGEST, decode, encode
from barewire.errors import DecodeError, EncodeError, Reason
from barewire.modbus.adu import Adu, Noise

COLON, LF = 0x3A, 0x0A


class AsciiLine:
    """One line. `character_timeout` is the longest pause between two characters of a frame, in seconds.

    >>> line = AsciiLine()
    >>> line.feed(b":01040FB10002", now=0.0), line.feed(b"39\\r\\n", now=0.1)
    ([], [Adu(unit=1, pdu=b'\\x04\\x0f\\xb1\\x00\\x02', transaction=None)])
    """

    numbered = False
    broken = None

    def __init__(self, *, character_timeout: float = 1.0, data_bits: int = 8) -> None:
        if data_bits not in (7, 8):
            raise EncodeError(f"{data_bits} data bits: ASCII characters have 7 or 8", "data_bits")
        self._held = bytearray()
        self._last = 0.0
        self._unit = 0
        self._timeout = character_timeout
        self._mask = 0x7F if data_bits == 7 else 0xFF

    @property
    def quiet_at(self) -> float:
        """ASCII keeps no silence: the delimiters say where frames are."""
        return 0.0

    @property
    def deadline(self) -> float | None:
        """When the pause inside a frame becomes too long."""
        return self._last + self._timeout if self._held else None

    @property
    def held(self) -> bytes:
        """The characters of a frame whose end has not come."""
        return bytes(self._held)

    def request(self, unit: int, pdu: bytes) -> bytes:
        """The frame of a request."""
        self._unit = unit
        return encode(unit, pdu)

    def response(self, to: Adu, pdu: bytes) -> bytes:
        """The frame of an answer."""
        return encode(to.unit, pdu)

    def sent(self, now: float) -> None:
        """Nothing to remember."""

    def answers(self, adu: Adu) -> bool:
        """From the unit that was asked last."""
        return adu.unit == self._unit

    def feed(self, data: bytes | None, now: float) -> list[Adu | Noise]:
        """Frames and noise in the order in which they came."""
        events: list[Adu | Noise] = []
        if self._held and now >= self._last + self._timeout:
            events.append(self._drop("silence", f"no character for {self._timeout:g} s inside a frame"))
        if not data:
            return events
        self._last = now
        for character in data:
            character &= self._mask
            if character == COLON and self._held:
                inside = self._held[0] == COLON
                events.append(self._drop("delimiter", "':' before the frame ended" if inside else "no ':' before it"))
            self._held.append(character)
            if character == LF and self._held[-2:-1] == b"\r":
                events.append(self._end())
            elif len(self._held) >= LONGEST:
                # Not even the longest frame is longer: nothing that comes can complete it.
                events.append(self._drop("long", f"{LONGEST} characters without CR LF"))
        return events

    def _drop(self, reason: Reason, text: str) -> Noise:
        noise = Noise(bytes(self._held), reason, text)
        self._held.clear()
        return noise

    def _end(self) -> Adu | Noise:
        """CR LF came: a frame, or noise that says why it is none."""
        data = bytes(self._held)
        self._held.clear()
        try:
            return decode(data)
        except DecodeError as error:
            return Noise(data, error.reason, error.text)
