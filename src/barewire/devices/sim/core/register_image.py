"""The rows of registers or coils that one Modbus function code reaches, composed of cells when they are read.

        address        16         17         18
        register    [  u32 .....  .... ] [ u8 H | u8 L ]
        cells          A (word 0) A (word 1)   B | C

An image stores nothing, so two function codes that reach one cell return one value. Rules where a manual has none:

* A register or coil that no parameter occupies does not exist: exception 02, also for a gap inside a row.
* Parameters that cannot be read are in no image for reading, those that cannot be written in none for writing:
  exception 02.
* A request is carried out completely or not at all: everything is checked before anything is stored.
* A value of several registers takes effect when its last register is written (CSD MT manual, ch. 10: "when the writing
  of the second part of it is concluded"). Until then reads return the old value.
* Where several parameters share one register (the commands of the ADXL), the first that accepts the value takes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from barewire.codecs import Value
from barewire.devices.sim.core.store import Cell, Declined, MachineStore
from barewire.errors import DecodeError


class CellWord(NamedTuple):
    """The part of a cell that lies at one address: its register number `word`, or a part of a register."""

    cell: Cell
    word: int
    partial: bool


class RegisterImage:
    """The cells that one function code reaches, by address. Coils count as registers that hold 0 or 1."""

    def __init__(self, store: MachineStore, cells: Iterable[Cell]) -> None:
        self.store = store
        self.words: dict[int, list[CellWord]] = {}
        self._waiting: dict[str, dict[int, int]] = {}
        for cell in cells:
            place = cell.parameter.modbus
            if place is not None:
                for word in range(place.words):
                    self.words.setdefault(place.address + word, []).append(CellWord(cell, word, place.partial))

    def _at(self, address: int) -> list[CellWord]:
        found = self.words.get(address)
        if found is None:
            raise Declined("place", f"nothing is described at address {address}")
        return found

    def read(self, address: int, quantity: int) -> tuple[int, ...]:
        """Read `quantity` registers; raises Declined. Each value is read once, so its words belong together."""
        rows = [self._at(address + offset) for offset in range(quantity)]
        known: dict[str, tuple[int, ...]] = {}
        words = []
        for row in rows:
            word = 0
            if row[0].partial:
                for entry in row:
                    if entry.partial:
                        (word,) = self.store.registers(entry.cell, (word,))
            else:
                cell = row[0].cell
                if cell.name not in known:
                    known[cell.name] = self.store.registers(cell)
                word = known[cell.name][row[0].word]
            words.append(word)
        return tuple(words)

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write registers, all or none: raises Declined if an address does not exist or a value is not accepted."""
        rows = [self._at(address + offset) for offset in range(len(words))]
        waiting: dict[str, dict[int, int]] = {}
        commits: list[tuple[Cell, Value]] = []
        for row, word in zip(rows, words):
            if row[0].partial:
                commits += [(entry.cell, self._checked(entry.cell, [word])) for entry in row if entry.partial]
            elif row[0].cell.parameter.modbus is not None and row[0].cell.parameter.modbus.words == 1:
                commits.append(self._first_to_accept([entry.cell for entry in row if not entry.partial], word))
            else:
                cell = row[0].cell
                parts = waiting.setdefault(cell.name, dict(self._waiting.get(cell.name, {})))
                parts[row[0].word] = word
                if row[0].word == len(self.store.registers(cell)) - 1:
                    present = list(self.store.registers(cell))
                    for number, part in parts.items():
                        present[number] = part
                    commits.append((cell, self._checked(cell, present)))
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
                # A veto is about this command; a value out of range may be the command of another parameter.
                if error.reason != "value":
                    raise
                declined = declined or error
        assert declined is not None
        raise declined
