"""A picture of a CAN frame, bit by bit, as it is on the bus.

An example:

    SOF, identifier, RTR
                 0 1 1 0 0 0 0 0 1 0 1 ...      level of each bit, in the order on the bus
    recessive 1  . .---.
                 | |   |
    dominant  0  '-'   '---------
                               s                a stuff bit: the receivers remove it
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

from barewire_workbench.frames.result import counted
from barewire_workbench.pictures.colours import TINTS
from barewire_workbench.pictures.drawing import Drawing, Tile, text_wave
from barewire_workbench.pictures.picture import Picture
from barewire_workbench.wire.can_bits import CanBit, CanBits

_BIT, _HIGH, _LOW, _TILE = 24, 56, 92, 140
_BITS_IN_TILE = 15
_SHORT = {"CRC delimiter": "del", "ACK slot": "ACK", "ACK delimiter": "del"}
_PART_NAMES = {"end": "delimiters, ACK, EOF"}
_TOGETHER = {"start": "arbitration", "end": "ACK"}
"""Part -> the part with which it shares a tile."""


class CanFramePicture(Picture):
    """All bits of a frame in the order on the bus. With a bit rate, also how long it takes.

    >>> from barewire.canopen import CanFrame
    >>> from barewire_workbench.wire.can_bits import can_bits
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

    @property
    def title(self) -> str:
        """The frame."""
        return f"CAN frame {self.sent.frame} on the bus"

    @property
    def caption(self) -> str:
        """How to read the bits."""
        return (
            f"{self._counts}. Level 1 is recessive, level 0 dominant. A bit marked s, with a frame, is a stuff bit: "
            "the sender inserts it after five equal bits, and the receivers remove it. "
            "The ACK slot is dominant because a receiver has confirmed the frame."
        )

    @property
    def _counts(self) -> str:
        text = f"{len(self.sent.bits)} bits from SOF to the end of EOF, {self.sent.stuff_count} of them stuff bits"
        if self.bitrate is not None:
            text += f"; {1e6 * self.sent.duration(self.bitrate):.0f} us at {self.bitrate} bit/s"
        return text

    def lines(self) -> list[str]:
        """Return five lines for each part of the frame: name, levels, wave."""
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
        """Return fields and bits as data. `levels` has the stuff bits, at the places `stuff`; the fields do not."""
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
        for number, (_, found) in enumerate(groupby(self.sent.bits, self._tile_key)):
            bits = list(found)
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
        """Return a tile for each part of the frame."""
        tiles, before = [self._axis()], 1
        for number, bits in self._groups():
            tiles.append(self._tile(bits, before, f"t{number % TINTS}"))
            before = bits[-1].level
        return tiles

    def _axis(self) -> Tile:
        drawing = Drawing()
        drawing.text(0, _HIGH + 4, "recessive 1", "s")
        drawing.text(0, _LOW + 4, "dominant 0", "s")
        drawing.line([(72, _HIGH), (96, _HIGH)], "w d")
        return Tile(96, _TILE, str(drawing), "the idle bus is recessive, level 1")

    def _tile(self, bits: Sequence[CanBit], before: int, tint: str) -> Tile:
        drawing = Drawing()
        width = _BIT * len(bits)
        middles = [_BIT * (place + 0.5) for place in range(len(bits))]
        drawing.box(0, 22, width, 96, tint)
        headings = (self._heading(bits), _PART_NAMES.get(bits[-1].part, bits[-1].field))
        drawing.text(3, 14, next((text for text in headings if 7.6 * len(text) <= width - 6), ""), "h")
        alone = len({bit.field for bit in bits}) == 1
        for place, bit in enumerate(bits):
            if bit.is_stuff:
                drawing.box(place * _BIT, 22, _BIT, 96, "mark")
                drawing.box(place * _BIT + 1, 23, _BIT - 2, 94, "l d")
                drawing.text(middles[place], 133, "s", "h c")
        start = 0
        for name, found in groupby(bits, lambda bit: bit.field):
            size = len(list(found))
            drawing.path(f"M{start * _BIT} 22V118", "l")
            if not alone:
                drawing.text(middles[start] if size == 1 else start * _BIT + 3, 36, _label(name, size * _BIT),
                             "s c" if size == 1 else "s")  # fmt: skip
            start += size
        drawing.wave(0, [bit.level for bit in bits], _BIT, _HIGH, _LOW, before)
        drawing.row(middles, 112, "".join(str(bit.level) for bit in bits), "m c")
        said = " ".join(f"{bit.level}{' (stuff bit)' if bit.is_stuff else ''}" for bit in bits)
        return Tile(width, _TILE, str(drawing), f"{self._heading(bits)}: {said}")

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.sent.frame}, {counted(len(self.sent.bits), 'bit')}>"


def _label(name: str, width: float) -> str:
    """Return the name of a field, or a short form where there is no room for it."""
    forms = (name, _SHORT.get(name, ""), name.split()[0])
    return next((form for form in forms if form and len(form) * 12 * 0.62 <= width), "")
