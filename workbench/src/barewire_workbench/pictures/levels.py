"""A picture of the levels on a serial line: one character, or a whole frame with its silences.

    byte 0, 01h: unit
             start 0   1   2   3   4   5   6   7  parity stop
          1 -.   .---.                           .-------
             |   |   |                           |
          0  '---'   '---------------------------'
             0   1   0   0   0   0   0   0   0   1   1

An idle line has level 1. A character begins with a start bit of level 0, which the receiver recognises as an edge;
then come the data bits, the lowest first, a parity bit if the format has one, and stop bits of level 1. Silence is
level 1 for longer; 3.5 characters of it separate the frames of RTU [MB-SERIAL 2.5.1.1].
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from barewire.errors import EncodeError
from barewire.rtu import Timing
from barewire_workbench.frames.result import Explanation, counted
from barewire_workbench.pictures.colours import TINTS
from barewire_workbench.pictures.drawing import Drawing, Tile, text_lines, text_wave
from barewire_workbench.pictures.fields import field_characters
from barewire_workbench.pictures.picture import Picture
from barewire_workbench.wire.uart import CharacterFormat, character_levels

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

    @property
    def title(self) -> str:
        """The number of characters, the format and the baud rate."""
        return f"Levels on the line: {counted(len(self.data), 'character')}, {self.form}, {self.baudrate} bit/s"

    @property
    def caption(self) -> str:
        """How to read the levels."""
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

    @property
    def left_out(self) -> str:
        """What is not drawn, in words; empty if everything is."""
        missing = len(self.data) - CHARACTERS_DRAWN
        return f"The last {counted(missing, 'character')} are not drawn." if missing > 0 else ""

    @property
    def bit_names(self) -> list[str]:
        """The names of the bits of a character, in the order on the line."""
        parity = ["par"] if self.form.parity != "N" else []
        return ["start", *map(str, range(self.form.data_bits)), *parity, *["stop"] * self.form.stop_bits]

    def lines(self) -> list[str]:
        """Return three lines for the levels of each character, with its bits above and below."""
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
        return [*lines, *filter(None, ["", self.left_out] if self.left_out else [])]

    @property
    def _silence_text(self) -> str:
        return f"at least {self.silence}: {1e3 * self.timing.t35:.3f} ms"

    def _heading(self, place: int) -> str:
        name = f": {self.names[place]}" if self.names[place] else ""
        return f"byte {place}, {self.data[place]:02X}h{name}"

    def as_dict(self) -> dict[str, Any]:
        """Return the levels as data; the first level of `levels` is sent first."""
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
        """Return a tile for the idle line, one for each character, and one for the silence at the end."""
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
            drawing.path(f"M{bit * _BIT} 22V120", "l" if bit in (0, len(levels)) else "g")
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
    found: list[tuple[int, str]] = []
    for field in explanation.fields:
        if not field.length:
            continue
        if explanation.protocol != "ascii":
            found += [(byte, field.name) for byte in bytes.fromhex(field.hex)]
        else:
            found += [(code, field.name) for character in field_characters(field) for code in _codes(character)]
    return found


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
    found = frame_bytes(explanation)
    is_ascii = explanation.protocol == "ascii"
    wide = next((byte for byte, _ in found if form is not None and byte >> form.data_bits), None)
    if wide is not None:
        raise EncodeError(f"byte {wide:02X}h does not fit the {form.data_bits if form else 8} data bits of {form}")
    form = form or CharacterFormat(7 if is_ascii else 8, "E", 1)
    data, names = bytes(byte for byte, _ in found), [name for _, name in found]
    return LevelsPicture(data, form, baudrate, names, "" if is_ascii else "t3.5")
