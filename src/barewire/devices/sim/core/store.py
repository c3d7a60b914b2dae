"""What a simulated machine remembers: every value once, by the name of its parameter, whatever wire asks for it.

        Modbus face: images --.                                  .-- the machine's own side
                               >--  stranger's door    own door <
        CANopen face: objects -'    put(value)          store[name] = value
                                    rights, limits,     no rights: a status word is read-only
                                    vetoes, hooks       to everybody but its owner

A `Cell` is one parameter with its value. Three things can be hung on it: `measured` computes the value at the moment of
reading, `veto` may decline a write before anything is stored, `after` is what the write brings about. A bit of an
object whose whole word is described as well (the coils of the AZ3) has no state of its own: its cell looks into the
cell of the word.

I know: values and their rights.  I never know: requests, frames, time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Literal

from barewire.codecs import Value, get_bit, set_bit
from barewire.codecs.numbers import Number
from barewire.devices.device import fold
from barewire.devices.parameter import Parameter
from barewire.errors import BarewireError, EncodeError

Why = Literal["place", "value", "state"]


class Declined(BarewireError):
    """The machine says no, in no protocol's words: there is no such place, no such value, or not now."""

    def __init__(self, why: Why, text: str) -> None:
        super().__init__(text)
        self.why: Why = why


class Cell:
    """One parameter and its value."""

    def __init__(self, parameter: Parameter) -> None:
        self.parameter = parameter
        # What is held need not lie within the limits of what may be written: a command register holds 0 at rest, and
        # 0 is no command. So the limits are checked at the stranger's door and not when a value is shown.
        self.free = replace(parameter, minimum=None, maximum=None)
        self.default: Value = _default(parameter)
        self.held: Value = self.default
        self.measured: Callable[[], Value] | None = None
        self.veto: Callable[[Value], None] | None = None
        self.after: Callable[[Value], None] | None = None
        self.whole: Cell | None = None
        """The cell of the word that this one is a bit of."""
        self.parts: list[Cell] = []
        """The cells that are bits of this one."""

    @property
    def name(self) -> str:
        """The parameter's name."""
        return self.parameter.name

    @property
    def _bit(self) -> int:
        place = self.parameter.object
        assert place is not None
        assert place.bit is not None
        return place.bit

    # The machine's own door

    def get(self) -> Value:
        """The value as it is now."""
        if self.measured is not None:
            return self.measured()
        if self.whole is not None:
            return get_bit(int(self.whole.get()), self._bit)
        return self.held

    def set(self, value: Value) -> None:
        """Another value, without rights, limits and hooks."""
        if self.whole is None:
            self.held = value
        else:
            self.whole.held = set_bit(int(self.whole.held), self._bit, bool(value))

    def shown(self) -> Value:
        """The value as the wire can say it: on a step of its scale, within the limits of its type."""
        value = self.get()
        if isinstance(value, (str, bytes)) or self.parameter.type in ("bool", "f32", "f64"):
            return value
        kind = Number(self.parameter.type)
        step = self.parameter.scale
        steps = min(max(round(Fraction(value) / step), int(kind.minimum)), int(kind.maximum))
        return self.free.from_raw(steps)

    # The stranger's door

    def check(self, value: Value) -> None:
        """Declined for a value out of range, or one that the machine does not want now. Changes nothing."""
        try:
            self.parameter.to_raw(value)
        except EncodeError as error:
            raise Declined("value", str(error)) from None
        if self.veto is not None:
            self.veto(value)

    def put(self, value: Value) -> None:
        """Store a value that has been checked, and let it act."""
        if self.whole is not None:
            self.whole.put(set_bit(int(self.whole.held), self._bit, bool(value)))
            return
        before, self.held = self.held, value
        for part in self.parts:
            self._keep_or_tell(part, int(before))
        if self.after is not None:
            self.after(value)

    def _keep_or_tell(self, part: Cell, before: int) -> None:
        """One bit of a word that was written: a read-only one stays as it was, a changed one acts."""
        was, now = get_bit(before, part._bit), get_bit(int(self.held), part._bit)
        if was != now and not part.parameter.writable:
            self.held = set_bit(int(self.held), part._bit, was)
        elif was != now and part.after is not None:
            part.after(now)


class MachineStore:
    """All cells of a machine, by name.

    >>> from barewire.devices.description.load import load
    >>> store = MachineStore(load("az3").parameters)
    >>> store["RESET POSITION"] = True
    >>> store["coil word 0"]
    2048
    """

    def __init__(self, parameters: Iterable[Parameter]) -> None:
        self.cells = {fold(parameter.name): Cell(parameter) for parameter in parameters}
        self.words_reversed: Callable[[], bool] = lambda: False
        """Asked whether values of several registers now lie the other way round than described."""
        wholes: dict[tuple[int, int], Cell] = {}
        for cell in self:
            place = cell.parameter.object
            if place is not None and place.bit is None:
                wholes.setdefault((place.index, place.sub), cell)
        for cell in self:
            place = cell.parameter.object
            if place is not None and place.bit is not None and (place.index, place.sub) in wholes:
                cell.whole = wholes[place.index, place.sub]
                cell.whole.parts.append(cell)
                cell.set(cell.default)

    def __iter__(self) -> Iterator[Cell]:
        return iter(self.cells.values())

    def cell(self, name: str) -> Cell:
        """The cell of a parameter."""
        return self.cells[fold(name)]

    def __getitem__(self, name: str) -> Value:
        return self.cell(name).get()

    def __setitem__(self, name: str, value: Value) -> None:
        self.cell(name).set(value)

    def number(self, name: str) -> float:
        """The value of a parameter that is a number."""
        return float(self.cell(name).get())

    def whole(self, name: str) -> int:
        """The value of a parameter that is a whole number."""
        return int(self.cell(name).get())

    def measure(self, name: str, read: Callable[[], Value]) -> None:
        """From now on the value is computed when it is asked for."""
        self.cell(name).measured = read

    def after(self, name: str, act: Callable[[Value], None]) -> None:
        """What a write from outside brings about."""
        self.cell(name).after = act

    def veto(self, name: str, check: Callable[[Value], None]) -> None:
        """`check` may raise Declined before a write from outside is stored."""
        self.cell(name).veto = check

    def restore(self, values: dict[str, Value] | None = None) -> None:
        """Every cell as at delivery, then those of `values`, which is what `snapshot` gave. No hook is called."""
        for cell in sorted(self, key=lambda cell: cell.whole is not None):  # words first, then the bits in them
            cell.set(cell.default)
        for name, value in (values or {}).items():
            self[name] = value

    def snapshot(self, wanted: Callable[[Cell], bool]) -> dict[str, Value]:
        """What is held in the cells that are wanted."""
        return {cell.name: cell.held for cell in self if cell.whole is None and wanted(cell)}

    # Registers

    def registers(self, cell: Cell, old: Sequence[int] = ()) -> tuple[int, ...]:
        """The registers that show the value; for half a register or a bit, `old` is what else the register holds."""
        words = cell.free.to_registers(cell.shown(), old)
        return words[::-1] if self._is_reversed(cell) else words

    def value(self, cell: Cell, registers: Sequence[int]) -> Value:
        """The value that these registers mean for the cell."""
        return cell.free.from_registers(registers[::-1] if self._is_reversed(cell) else registers)

    def _is_reversed(self, cell: Cell) -> bool:
        return cell.parameter.type != "text" and self.words_reversed()


def _default(parameter: Parameter) -> Value:
    """What a cell holds when nobody has said anything: the described default, or nothing at all."""
    if parameter.default is not None and parameter.access != "wo":
        return parameter.default
    if parameter.type == "text":
        return ""
    return False if parameter.type == "bool" else 0
