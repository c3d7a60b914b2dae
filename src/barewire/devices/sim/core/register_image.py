"""What a function code of Modbus reaches: rows of registers or coils, composed out of cells when they are read.

        address        16         17         18
        register    [  u32 .....  .... ] [ u8 H | u8 L ]
        cells          A (word 0) A (word 1)   B | C

An image stores nothing, so a value that two function codes reach is one value. Its laws, where a manual is silent:

* A register or coil that no parameter occupies does not exist: exception 02, for a gap inside a row as well.
* What may not be read is not in an image for reading, what may not be written in none for writing: exception 02.
* A request is carried out as a whole or not at all: everything is checked before anything is stored.
* A value of several registers takes effect when its last register is written (CSD MT manual, ch. 10: "when the writing
  of the second part of it is concluded"). The registers before wait, and are read back only then.
* Where several parameters share one register (the commands of the ADXL), the first that accepts the value takes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from barewire.codecs import Value
from barewire.devices.sim.core.store import Cell, Declined, MachineStore
from barewire.errors import DecodeError


class Piece(NamedTuple):
    """What a cell has at an address: its register number `word`, or a part of the register."""

    cell: Cell
    word: int
    partial: bool


class Image:
    """The cells that one function code reaches, by address. Coils count as registers that hold 0 or 1."""

    def __init__(self, store: MachineStore, cells: Iterable[Cell]) -> None:
        self.store = store
        self.pieces: dict[int, list[Piece]] = {}
        self._waiting: dict[str, dict[int, int]] = {}
        for cell in cells:
            place = cell.parameter.modbus
            if place is not None:
                for word in range(place.words):
                    self.pieces.setdefault(place.address + word, []).append(Piece(cell, word, place.partial))

    def _at(self, address: int) -> list[Piece]:
        found = self.pieces.get(address)
        if found is None:
            raise Declined("place", f"nothing is described at address {address}")
        return found

    def read(self, address: int, quantity: int) -> tuple[int, ...]:
        """So many registers, or Declined. Each value is asked for once, so its words belong together."""
        rows = [self._at(address + offset) for offset in range(quantity)]
        known: dict[str, tuple[int, ...]] = {}
        words = []
        for row in rows:
            word = 0
            if row[0].partial:
                for piece in row:
                    if piece.partial:
                        (word,) = self.store.registers(piece.cell, (word,))
            else:
                cell = row[0].cell
                if cell.name not in known:
                    known[cell.name] = self.store.registers(cell)
                word = known[cell.name][row[0].word]
            words.append(word)
        return tuple(words)

    def write(self, address: int, words: Sequence[int]) -> None:
        """Take registers, all or none: Declined if one of them has no place or no right value."""
        rows = [self._at(address + offset) for offset in range(len(words))]
        waiting: dict[str, dict[int, int]] = {}
        commits: list[tuple[Cell, Value]] = []
        for row, word in zip(rows, words):
            if row[0].partial:
                commits += [(piece.cell, self._checked(piece.cell, [word])) for piece in row if piece.partial]
            elif row[0].cell.parameter.modbus is not None and row[0].cell.parameter.modbus.words == 1:
                commits.append(self._first_to_accept([piece.cell for piece in row if not piece.partial], word))
            else:
                cell = row[0].cell
                parts = waiting.setdefault(cell.name, dict(self._waiting.get(cell.name, {})))
                parts[row[0].word] = word
                if row[0].word == len(self.store.registers(cell)) - 1:
                    now = list(self.store.registers(cell))
                    for place, part in parts.items():
                        now[place] = part
                    commits.append((cell, self._checked(cell, now)))
                    parts.clear()
        self._waiting |= waiting
        for cell, value in commits:
            cell.put(value)

    def _checked(self, cell: Cell, words: Sequence[int]) -> Value:
        try:
            value = self.store.value(cell, words)
        except DecodeError as error:
            raise Declined("value", str(error)) from None
        cell.check(value)
        return value

    def _first_to_accept(self, cells: Sequence[Cell], word: int) -> tuple[Cell, Value]:
        declined: Declined | None = None
        for cell in cells:
            if cell.parameter.modbus is not None and cell.parameter.modbus.words > 1:
                continue
            try:
                return cell, self._checked(cell, [word])
            except Declined as error:
                # A veto is an answer about this command; an unfit value may be another parameter's command.
                if error.why != "value":
                    raise
                declined = declined or error
        assert declined is not None
        raise declined
