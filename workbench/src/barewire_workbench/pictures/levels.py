"""Pictures of a frame's levels: the characters on a serial line with their silences, and the bits of a CAN frame.

    byte 0, 01h: unit
             start 0   1   2   3   4   5   6   7  parity stop
          1 -.   .---.                           .-------
             |   |   |                           |
          0  '---'   '---------------------------'
             0   1   0   0   0   0   0   0   0   1   1

An idle line has level 1. A character begins with a start bit of level 0, which the receiver recognises as an edge;
then come the data bits, the lowest first, a parity bit if the format has one, and stop bits of level 1. Silence is
level 1 for longer; 3.5 characters of it separate the frames of RTU [MB-SERIAL 2.5.1.1].

    protocol     fields    levels
    rtu          yes       the characters of a serial line, 8E1, with the silence on both sides
    ascii        yes       the characters of a serial line, 7E1
    can          yes       the bits of the frame on the bus; not of CAN FD and of error frames
    tcp          yes       -
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple

from barewire.canopen.frame import AnyFrame, CanFrame
from barewire.errors import EncodeError, shown
from barewire.rtu import Timing
from barewire_workbench.frames.result import Explanation, counted
from barewire_workbench.pictures.drawing import TINTS, Drawing, Tile, text_lines, text_wave
from barewire_workbench.pictures.fields import FieldsPicture, field_characters
from barewire_workbench.pictures.picture import Picture
from barewire_workbench.wire import CanBit, CanBits, CharacterFormat, can_bits, character_levels

CHARACTERS_DRAWN = 300
"""The most characters in a picture; the longest frame of RTU has 256."""

_BIT, _HIGH, _LOW, _TILE = 32, 54, 92, 138
_CELL = 4


class LevelsPicture(Picture):
    """The levels of characters that follow one another. `names` has the name of the field of each byte, if known.

    `silence` is what is on both sides of a frame, "t3.5" for RTU; without it the line is idle for an unknown time.

    >>> picture = LevelsPicture(b"\\x01", CharacterFormat(8, "E", 1), 19200, ["unit"])
    >>> print(*picture.lines(), sep="\\n")
    8E1 at 19200 bit/s: a bit lasts 52.1 us, a character of 11 bits 0.573 ms
    <BLANKLINE>
    byte 0, 01h: unit
           start 0   1   2   3   4   5   6   7   par stop
      1 ---.   .---.                           .-------
           |   |   |                           |
      0    '---'   '---------------------------'
             0   1   0   0   0   0   0   0   0   1   1
    """

    kind = "levels"

    def __init__(
        self,
        data: bytes,
        form: CharacterFormat,
        baudrate: int,
        names: Sequence[str] = (),
        silence: str = "",
    ) -> None:
        self.timing = Timing.of(baudrate, form.bits)
        self.data, self.form, self.baudrate, self.silence = data, form, baudrate, silence
        self.names = [*names, *[""] * len(data)][: len(data)]
        self.title = f"Levels on the line: {counted(len(data), 'character')}, {form}, {baudrate} bit/s"
        missing = len(data) - CHARACTERS_DRAWN
        self.left_out = f"The last {counted(missing, 'character')} are not drawn." if missing > 0 else ""
        self.caption = self._caption()
        parity_name = ["par"] if form.parity != "N" else []
        self.bit_names = ["start", *map(str, range(form.data_bits)), *parity_name, *["stop"] * form.stop_bits]

    def _caption(self) -> str:
        parity = {"N": "no parity bit", "E": "a parity bit that makes the number of ones even",
                  "O": "a parity bit that makes the number of ones odd"}[self.form.parity]  # fmt: skip
        text = (
            f"A character: a start bit 0, {self.form.data_bits} data bits with the lowest first, {parity}, "
            f"{counted(self.form.stop_bits, 'stop bit')} 1. A bit lasts {1e6 / self.baudrate:.1f} us, a character "
            f"{1e3 * self.timing.character:.3f} ms"
        )
        number = len(self.data)
        text += f", all {number} of them {1e3 * self.timing.duration(number):.3f} ms." if number > 1 else "."
        return text + (f" {self.left_out}" if self.left_out else "")

    def lines(self) -> list[str]:
        lines = [
            f"{self.form} at {self.baudrate} bit/s: a bit lasts {1e6 / self.baudrate:.1f} us, "
            f"a character of {self.form.bits} bits {1e3 * self.timing.character:.3f} ms"
        ]
        quiet = [f"silence, {self._silence_text}"] if self.silence else []
        lines += ["", *quiet] if quiet else []
        names = f"       start {''.join(f'{name:<{_CELL}}' for name in self.bit_names[1:])}".rstrip()
        for place, byte in enumerate(self.data[:CHARACTERS_DRAWN]):
            levels = character_levels(byte, self.form)
            high, edge, low = text_wave(levels, _CELL)
            lines += [
                "",
                self._heading(place),
                names,
                f"  1 ---{high}",
                f"       {edge}",
                f"  0    {low}",
                "       " + "".join(f"  {level} " for level in levels).rstrip(),
            ]
        lines += ["", *quiet] if quiet else []
        return [*lines, "", self.left_out] if self.left_out else lines

    @property
    def _silence_text(self) -> str:
        return f"at least {self.silence}: {1e3 * self.timing.t35:.3f} ms"

    def _heading(self, place: int) -> str:
        name = f": {self.names[place]}" if self.names[place] else ""
        return f"byte {place}, {self.data[place]:02X}h{name}"

    def as_dict(self) -> dict[str, Any]:
        return {
            "picture": self.kind,
            "format": str(self.form),
            "baudrate": self.baudrate,
            "bit_seconds": 1 / self.baudrate,
            "silence": self.silence,
            "silence_seconds": self.timing.t35 if self.silence else None,
            "bits": self.bit_names,
            "characters": [
                {
                    "offset": place,
                    "byte": byte,
                    "field": self.names[place],
                    "levels": "".join(map(str, character_levels(byte, self.form))),
                }
                for place, byte in enumerate(self.data)
            ],
        }

    def tiles(self) -> Sequence[Tile]:
        characters, number = [], -1
        for place in range(min(len(self.data), CHARACTERS_DRAWN)):
            if not place or not self.names[place] or self.names[place] != self.names[place - 1]:
                number += 1
            characters.append(self._character(place, f"t{number % TINTS}"))
        return [self._idle(), *characters, self._idle()]

    def _idle(self) -> Tile:
        drawing = Drawing()
        width = 150 if self.silence else 60
        label = f"silence, {self._silence_text}" if self.silence else "the line is idle, level 1"
        drawing.text(2, _HIGH + 5, "1", "m")
        drawing.text(2, _LOW + 5, "0", "m")
        drawing.line([(14, _HIGH), (width, _HIGH)], "w d")
        drawing.line([(14, _LOW), (width, _LOW)], "g")
        if self.silence:
            drawing.text(14, 14, "silence", "h")
            drawing.text(14, _HIGH - 8, f"at least {self.silence}", "s")
            drawing.text(14, _HIGH + 20, f"{1e3 * self.timing.t35:.3f} ms", "s")
        else:
            drawing.text(14, 14, "idle", "h")
        return Tile(width, _TILE, str(drawing), label)

    def _character(self, place: int, tint: str) -> Tile:
        drawing = Drawing()
        byte = self.data[place]
        levels, names = character_levels(byte, self.form), self.bit_names
        width = _BIT * len(levels)
        middles = [_BIT * (bit + 0.5) for bit in range(len(levels))]
        drawing.text(3, 14, text_lines(self._heading(place), width - 6)[0], "h")
        drawing.box(0, 22, width, 98, tint)
        for bit in range(len(levels) + 1):
            drawing.vertical(bit * _BIT, 22, 120, "l" if bit in (0, len(levels)) else "g")
        for middle, name in zip(middles, names):
            drawing.text(middle, 38, name, "s c")
        drawing.wave(0, levels, _BIT, _HIGH, _LOW)
        drawing.row(middles, 112, "".join(map(str, levels)), "m c")
        value = byte & (1 << self.form.data_bits) - 1
        drawing.text(3, 134, f"{value:0{self.form.data_bits}b}b = {byte:02X}h", "m s")
        said = ", ".join(f"{name} {level}" for name, level in zip(names, levels))
        return Tile(width, _TILE, str(drawing), f"{self._heading(place)}: {said}")


def frame_bytes(explanation: Explanation) -> list[tuple[int, str]]:
    """Return each byte of a frame with the name of its field; of an ASCII frame, each character.

    >>> from barewire_workbench import explain
    >>> frame_bytes(explain("rtu", bytes.fromhex("07 41")))[:2]
    [(7, 'unit'), (65, 'function code')]
    """
    named: list[tuple[int, str]] = []
    for field in explanation.fields:
        if not field.length:
            continue
        if explanation.protocol != "ascii":
            named += [(byte, field.name) for byte in bytes.fromhex(field.hex)]
        else:
            named += [(code, field.name) for character in field_characters(field) for code in _codes(character)]
    return named


def _codes(character: str) -> bytes:
    """Return a character as `field_characters` shows it."""
    if character in _LINE_ENDS:
        return _LINE_ENDS[character]
    return character.encode("latin-1", "replace").decode("unicode_escape", "replace").encode("latin-1", "replace")


_LINE_ENDS = {"CR": b"\r", "LF": b"\n"}


def frame_levels(explanation: Explanation, form: CharacterFormat | None = None, baudrate: int = 19200) -> LevelsPicture:
    """Return the levels of a frame on a serial line: 8E1 for RTU and 7E1 for ASCII unless `form` is another.

    >>> from barewire_workbench import explain
    >>> frame_levels(explain("rtu", bytes.fromhex("01 03 00 00 00 02 C4 0B"))).title
    'Levels on the line: 8 characters, 8E1, 19200 bit/s'

    Raises EncodeError if a byte has more bits than a character of this `form`.
    """
    named = frame_bytes(explanation)
    is_ascii = explanation.protocol == "ascii"
    wide = next((byte for byte, _ in named if form is not None and byte >> form.data_bits), None)
    if wide is not None:
        raise EncodeError(f"byte {wide:02X}h does not fit the {form.data_bits if form else 8} data bits of {form}")
    form = form or CharacterFormat(7 if is_ascii else 8, "E", 1)
    data, names = bytes(byte for byte, _ in named), [name for _, name in named]
    return LevelsPicture(data, form, baudrate, names, "" if is_ascii else "t3.5")


# A CAN frame --------------------------------------------------------------------------------------------------------


_CAN_BIT, _RECESSIVE_AT, _DOMINANT_AT, _CAN_TILE = 24, 56, 92, 140
_BITS_IN_TILE = 15
_SHORT = {"CRC delimiter": "del", "ACK slot": "ACK", "ACK delimiter": "del"}
_PART_NAMES = {"end": "delimiters, ACK, EOF"}
_TOGETHER = {"start": "arbitration", "end": "ACK"}
"""Part -> the part with which it shares a tile."""


class CanFramePicture(Picture):
    """All bits of a frame in the order on the bus. With a bit rate, also how long it takes.

    >>> from barewire.canopen import CanFrame
    >>> from barewire_workbench.wire import can_bits
    >>> print(*CanFramePicture(can_bits(CanFrame.parse("705#05"))).lines()[:8], sep="\\n")
    56 bits from SOF to the end of EOF, 4 of them stuff bits
    <BLANKLINE>
    SOF, identifier = 705h, RTR
                0 1 1 1 0 0 0 0 0 1 1 0 1 0
    recessive 1 . .-----.         .---. .-.
                | |     |         |   | | |
    dominant  0 '-'     '---------'   '-' '-
                                  s
    """

    kind = "can-frame"

    def __init__(self, sent: CanBits, bitrate: int | None = None) -> None:
        self.sent, self.bitrate = sent, bitrate
        self.title = f"CAN frame {sent.frame} on the bus"
        self._counts = f"{len(sent.bits)} bits from SOF to the end of EOF, {sent.stuff_count} of them stuff bits"
        if bitrate is not None:
            self._counts += f"; {1e6 * sent.duration(bitrate):.0f} us at {bitrate} bit/s"
        self.caption = (
            f"{self._counts}. Level 1 is recessive, level 0 dominant. A bit marked s, with a frame, is a stuff bit: "
            "the sender inserts it after five equal bits, and the receivers remove it. "
            "The ACK slot is dominant because a receiver has confirmed the frame."
        )

    def lines(self) -> list[str]:
        lines, before = [self._counts], 1
        for _, bits in self._groups():
            levels = [bit.level for bit in bits]
            high, edge, low = text_wave(levels, 2, before)
            marks = "".join("s " if bit.is_stuff else "  " for bit in bits).rstrip()
            lines += [
                "",
                self._heading(bits),
                "            " + " ".join(map(str, levels)),
                f"recessive 1 {high}",
                f"            {edge}",
                f"dominant  0 {low}",
                *([f"            {marks}"] if marks else []),
            ]
            before = levels[-1]
        return [line.rstrip() for line in lines]

    def as_dict(self) -> dict[str, Any]:
        sent = self.sent
        return {
            "picture": self.kind,
            "frame": str(sent.frame),
            "crc": sent.crc,
            "bitrate": self.bitrate,
            "seconds": None if self.bitrate is None else sent.duration(self.bitrate),
            "fields": [
                {"name": field.name, "part": field.part, "value": field.value, "levels": field.levels}
                for field in sent.fields
            ],
            "levels": sent.levels,
            "stuff": [place for place, bit in enumerate(sent.bits) if bit.is_stuff],
        }

    def _groups(self) -> Iterator[tuple[int, list[CanBit]]]:
        """Yield the bits of each tile, and the number of its part of the frame: a long part has several tiles."""
        for number, (_, group) in enumerate(groupby(self.sent.bits, self._tile_key)):
            bits = list(group)
            size = -(-len(bits) // -(-len(bits) // _BITS_IN_TILE))  # equal pieces, none longer than a tile
            for start in range(0, len(bits), size):
                yield number, bits[start : start + size]

    def _tile_key(self, bit: CanBit) -> str:
        """Return the part that a bit is drawn in: some parts share one, others have several."""
        if bit.part == "data" or bit.field == "identifier extension":
            return bit.field
        if bit.field == "RTR" and self.sent.frame.extended:
            return "control"
        return "ACK" if bit.field == "CRC delimiter" else _TOGETHER.get(bit.part, bit.part)

    def _heading(self, bits: Sequence[CanBit]) -> str:
        values = {field.name: field for field in self.sent.fields}
        names = []
        for name in dict.fromkeys(bit.field for bit in bits):
            field = values[name]
            is_number = field.width > 1 and name != "EOF"
            names.append(f"{name} = {field.value:0{-(-field.width // 4)}X}h" if is_number else name)
        return ", ".join(names)

    def tiles(self) -> Sequence[Tile]:
        tiles, before = [self._axis()], 1
        for number, bits in self._groups():
            tiles.append(self._tile(bits, before, f"t{number % TINTS}"))
            before = bits[-1].level
        return tiles

    def _axis(self) -> Tile:
        drawing = Drawing()
        drawing.text(0, _RECESSIVE_AT + 4, "recessive 1", "s")
        drawing.text(0, _DOMINANT_AT + 4, "dominant 0", "s")
        drawing.line([(72, _RECESSIVE_AT), (96, _RECESSIVE_AT)], "w d")
        return Tile(96, _CAN_TILE, str(drawing), "the idle bus is recessive, level 1")

    def _tile(self, bits: Sequence[CanBit], before: int, tint: str) -> Tile:
        drawing = Drawing()
        width = _CAN_BIT * len(bits)
        middles = [_CAN_BIT * (place + 0.5) for place in range(len(bits))]
        drawing.box(0, 22, width, 96, tint)
        headings = (self._heading(bits), _PART_NAMES.get(bits[-1].part, bits[-1].field))
        drawing.text(3, 14, next((text for text in headings if 7.6 * len(text) <= width - 6), ""), "h")
        alone = len({bit.field for bit in bits}) == 1
        for place, bit in enumerate(bits):
            if bit.is_stuff:
                drawing.box(place * _CAN_BIT, 22, _CAN_BIT, 96, "mark")
                drawing.box(place * _CAN_BIT + 1, 23, _CAN_BIT - 2, 94, "l d")
                drawing.text(middles[place], 133, "s", "h c")
        start = 0
        for name, group in groupby(bits, lambda bit: bit.field):
            size = len(list(group))
            drawing.vertical(start * _CAN_BIT, 22, 118)
            if not alone:
                drawing.text(middles[start] if size == 1 else start * _CAN_BIT + 3, 36, _label(name, size * _CAN_BIT),
                             "s c" if size == 1 else "s")  # fmt: skip
            start += size
        drawing.wave(0, [bit.level for bit in bits], _CAN_BIT, _RECESSIVE_AT, _DOMINANT_AT, before)
        drawing.row(middles, 112, "".join(str(bit.level) for bit in bits), "m c")
        said = " ".join(f"{bit.level}{' (stuff bit)' if bit.is_stuff else ''}" for bit in bits)
        return Tile(width, _CAN_TILE, str(drawing), f"{self._heading(bits)}: {said}")

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.sent.frame}, {counted(len(self.sent.bits), 'bit')}>"


def _label(name: str, width: float) -> str:
    """Return the name of a field, or a short form where there is no room for it."""
    forms = (name, _SHORT.get(name, ""), name.split()[0])
    return next((form for form in forms if form and len(form) * 12 * 0.62 <= width), "")


# The pictures that a frame has --------------------------------------------------------------------------------------


class SerialLine(NamedTuple):
    """The baud rate and the character format of a serial line."""

    baudrate: int
    form: CharacterFormat

    @classmethod
    def parse(cls, text: str) -> SerialLine:
        """Return the line with this name.

        >>> SerialLine.parse("9600,8N1")
        SerialLine(baudrate=9600, form=CharacterFormat(data_bits=8, parity='N', stop_bits=1))

        Raises EncodeError for any other text, and for a baud rate outside 1 to 10000000.
        """
        rate, _, form = text.partition(",")
        if not re.fullmatch("[0-9]{1,8}", rate.strip()) or not 1 <= int(rate) <= 10_000_000 or not form:
            raise EncodeError(f"line {shown(text)}: expected baud rate and format of the characters, such as 9600,8N1")
        return cls(int(rate), CharacterFormat.parse(form))


def frame_pictures(
    explanation: Explanation, frame: AnyFrame | None = None, line: SerialLine | None = None
) -> dict[str, Picture]:
    """Return the pictures of a frame by name: "fields", and "levels" where they exist.

    `frame` is that of "can". The levels of a serial `line` are those of 19200,8E1 for RTU and 19200,7E1 for ASCII
    unless another is given.

    >>> from barewire_workbench import explain
    >>> list(frame_pictures(explain("rtu", bytes.fromhex("01 03 00 00 00 02 C4 0B"))))
    ['fields', 'levels']

    Raises EncodeError if a byte has more bits than a character of the line.
    """
    pictures: dict[str, Picture] = {"fields": FieldsPicture(explanation)}
    if explanation.protocol in ("rtu", "ascii"):
        pictures["levels"] = frame_levels(explanation, *(() if line is None else (line.form, line.baudrate)))
    elif isinstance(frame, CanFrame):
        try:
            pictures["levels"] = CanFramePicture(can_bits(frame))
        except EncodeError:  # no controller can send it; its fields are still worth a picture
            return pictures
    return pictures
