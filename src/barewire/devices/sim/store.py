"""The values of a simulated machine: each stored once, by the name of its parameter, for both buses; and its clock.

        Modbus adapter: images --.                                 .-- the machine's own code
                                 >--  from outside     from inside <
        CANopen adapter: objects-'    put(value)       store[name] = value
                                      rights, limits,  neither: a status word is read-only
                                      vetoes, hooks    except for the machine itself

A `Cell` is one parameter with its value. It has three hooks: `measured` computes the value when it is read, `veto` may
decline a write before anything is stored, `after` is called after a write. A bit of an object whose whole word is
described as well (the coils of the AZ3) has no value of its own: its cell reads and writes the cell of the word.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Literal, Protocol

from barewire.codecs import Value, get_bit, set_bit
from barewire.codecs.numbers import Number
from barewire.devices.parameter import Parameter
from barewire.errors import BarewireError, EncodeError, fold


class MachineClock:
    """The time of one machine in seconds, as it was last passed in. All parts of the machine share one clock.

    >>> clock = MachineClock()
    >>> clock.advance(5.0)
    >>> clock.advance(7.5)
    >>> clock.now, clock.uptime
    (7.5, 2.5)
    """

    def __init__(self, now: float = 0.0) -> None:
        self.now = now
        self.on_since: float | None = None
        """The time of power-on: the first time that was passed in, or the last power cycle."""

    def advance(self, now: float) -> None:
        """Set the time. A time before the present one is ignored."""
        if self.on_since is None:
            self.on_since = now
        self.now = max(self.now, now)

    @property
    def uptime(self) -> float:
        """Seconds since power-on."""
        return 0.0 if self.on_since is None else self.now - self.on_since


class SimulatedMachine(Protocol):
    """The part of a machine that the bus adapters use: values, clock, and resets from a bus."""

    store: MachineStore
    clock: MachineClock

    def tick(self, now: float) -> None:
        """Advance to the time `now`: carry out everything that is due until then."""

    def reset(self) -> None:
        """Restore every value as at power-on (NMT reset node)."""

    def reset_communication(self) -> None:
        """React to an NMT reset communication; the saved values of 1000h to 1FFFh have been restored."""


DeclineReason = Literal["place", "value", "signature", "state"]
"""place: no such address or object; value: no such value; signature: not the value that stores or restores; state: not
in the present state of the machine."""


class Declined(BarewireError):
    """The machine declines a read or a write. Each adapter translates `reason` into its protocol's code."""

    def __init__(self, reason: DeclineReason, text: str) -> None:
        super().__init__(text)
        self.reason: DeclineReason = reason


class Cell:
    """One parameter and its value."""

    def __init__(self, parameter: Parameter) -> None:
        self.parameter = parameter
        # A held value need not lie within the limits of writes: a command register holds 0 at rest, and 0 is no
        # command. So limits are checked for writes from outside, and not when a value is read.
        self.free = replace(parameter, minimum=None, maximum=None)
        """The parameter without limits."""
        self.default: Value = _default(parameter)
        self.held: Value = self.default
        self.measured: Callable[[], Value] | None = None
        self.veto: Callable[[Value], None] | None = None
        self.after: Callable[[Value], None] | None = None
        self.whole: Cell | None = None
        """The cell of the word that contains this bit; None for a value of its own."""
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

    # From inside the machine

    def get(self) -> Value:
        """Return the value as it is now."""
        if self.measured is not None:
            return self.measured()
        if self.whole is not None:
            return get_bit(int(self.whole.get()), self._bit)
        return self.held

    def set(self, value: Value) -> None:
        """Store a value. Rights and limits are not checked, and no hook is called."""
        if self.whole is None:
            self.held = value
        else:
            self.whole.held = set_bit(int(self.whole.held), self._bit, bool(value))

    def shown(self) -> Value:
        """Return the value as a bus can carry it: rounded to a step of its scale, clamped to the range of its type."""
        value = self.get()
        if isinstance(value, (str, bytes)) or self.parameter.type in ("bool", "f32", "f64"):
            return value
        number = Number(self.parameter.type)
        step = self.parameter.scale
        steps = min(max(round(Fraction(value) / step), int(number.minimum)), int(number.maximum))
        return self.free.from_raw(steps)

    # From outside

    def check(self, value: Value) -> None:
        """Raise Declined for a value that is out of range or vetoed. Changes nothing."""
        try:
            self.parameter.to_raw(value)
        except EncodeError as error:
            raise Declined("value", str(error)) from None
        if self.veto is not None:
            self.veto(value)

    def put(self, value: Value) -> None:
        """Store a value that has been checked, and call the hooks."""
        if self.whole is not None:
            self.whole.put(set_bit(int(self.whole.held), self._bit, bool(value)))
            return
        before, self.held = self.held, value
        for part in self.parts:  # the bits first, since a read-only one changes the word back
            self._write_bit(part, int(before))
        if self.after is not None:
            self.after(value)

    def _write_bit(self, part: Cell, before: int) -> None:
        """Write one bit of a word: a read-only bit keeps its value, a bit that changes calls its hook."""
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
        self.saved: dict[str, Value] = {}
        """The values in non-volatile memory, by name."""
        self.words_reversed: Callable[[], bool] = lambda: False
        """Returns whether values of several registers now have the opposite word order of the description."""
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

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.cells)} values>"

    def __iter__(self) -> Iterator[Cell]:
        return iter(self.cells.values())

    def cell(self, name: str) -> Cell:
        """Return the cell of a parameter."""
        return self.cells[fold(name)]

    def __getitem__(self, name: str) -> Value:
        return self.cell(name).get()

    def __setitem__(self, name: str, value: Value) -> None:
        self.cell(name).set(value)

    def number(self, name: str) -> float:
        """Return the value of a numeric parameter."""
        return float(self.cell(name).get())

    def integer(self, name: str) -> int:
        """Return the value of a parameter that is a whole number."""
        return int(self.cell(name).get())

    def measure(self, name: str, read: Callable[[], Value]) -> None:
        """Compute the value with `read` at each read."""
        self.cell(name).measured = read

    def after(self, name: str, act: Callable[[Value], None]) -> None:
        """Call `act` with the value after each write from outside."""
        self.cell(name).after = act

    def veto(self, name: str, check: Callable[[Value], None]) -> None:
        """Call `check` before a write from outside is stored; it may raise Declined."""
        self.cell(name).veto = check

    def restore(self, values: dict[str, Value] | None = None) -> None:
        """Set every cell to its default, then those of `values` (see `snapshot`). No hook is called."""
        for cell in sorted(self, key=lambda cell: cell.whole is not None):  # words first, then the bits in them
            cell.set(cell.default)
        for name, value in (values or {}).items():
            self[name] = value

    def snapshot(self, wanted: Callable[[Cell], bool]) -> dict[str, Value]:
        """Return the stored values of the cells for which `wanted` returns true."""
        return {cell.name: cell.held for cell in self if cell.whole is None and wanted(cell)}

    # Registers

    def registers(self, cell: Cell, old: Sequence[int] = ()) -> tuple[int, ...]:
        """Return the registers of a cell's value. For half a register or a bit, `old` is the rest of the register."""
        words = cell.free.to_registers(cell.shown(), old)
        return words[::-1] if self._is_reversed(cell) else words

    def value(self, cell: Cell, registers: Sequence[int]) -> Value:
        """Return the value of a cell from its registers."""
        return cell.free.from_registers(registers[::-1] if self._is_reversed(cell) else registers)

    def _is_reversed(self, cell: Cell) -> bool:
        return cell.parameter.type != "text" and self.words_reversed()


def _default(parameter: Parameter) -> Value:
    """Return the value at delivery: the default of the description, otherwise an empty text, False or 0."""
    if parameter.default is not None and parameter.access != "wo":
        return parameter.default
    if parameter.type == "text":
        return ""
    return False if parameter.type == "bool" else 0
