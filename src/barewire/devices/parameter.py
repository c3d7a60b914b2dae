"""A parameter: one named value of a machine, with its unit, its range and its address on Modbus and on CANopen.

                        name "STATUS WORD", type u16, unit, scale, range, default, names of its bits
                          |
             .------------'-------------.
        ModbusAt                    ObjectAt
        input register 24           object 6041h, sub-index 0
             |                          |
        registers [0x0637]          bytes 37 06
             '---------- value ---------'

Scale, unit and the names of values and bits belong to the parameter; width, sign and byte order belong to its codec.
Limits are given in the unit, after scaling, as manuals print them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from math import ulp
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from barewire._html import html_table
from barewire.codecs import Codec, Text, Value, codec, from_registers, to_registers
from barewire.codecs.bits import Half, get_bit, get_half, set_bit, set_half
from barewire.codecs.order import Order
from barewire.errors import DecodeError, EncodeError, shown

if TYPE_CHECKING:
    from barewire.canopen.datatypes import ObjectCodec

TableName = Literal["holding", "input", "coil", "discrete"]
TABLE_NAMES: tuple[TableName, ...] = ("holding", "input", "coil", "discrete")
INTEGER_TYPES = ("u8", "u16", "u32", "u64", "i8", "i16", "i32", "i64")
VALUE_TYPES = ("bool", *INTEGER_TYPES, "f32", "f64", "text")
"""The types in a description. An object of CANopen may have any other one of `canopen.datatypes` too."""
_NOT_NUMBERS = {"text": str, "octets": bytes, "domain": bytes}
ParameterAccess = Literal["ro", "rw", "wo"]
ParameterKind = Literal["setting", "command", "measurement", "reserved"]


class ModbusAt(NamedTuple):
    """An address on Modbus. `address` is the one on the wire, counted from 0, whatever the manual prints."""

    table: TableName
    address: int
    words: int = 1
    half: Half | None = None
    bit: int | None = None
    order: Order = "ABCD"

    @property
    def partial(self) -> bool:
        """Whether it is less than a register, so that writing it takes a read, a change and a write."""
        return self.table in ("holding", "input") and (self.half is not None or self.bit is not None)


@dataclass(frozen=True, slots=True)
class ObjectAt:
    """An address in the object dictionary of CANopen. `bit` is set where the value is one bit of the object, `type`
    where the object is wider than the value: 2068h of the AZ3 has 16 bits, the value beside it in a register has 8."""

    index: int
    sub: int = 0
    bit: int | None = None
    type: str = ""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One row of a device description. `catalog/README.md` describes the fields.

    >>> celsius = Parameter("Temperature", "i16", unit="°C", scale=Fraction(1, 10), modbus=ModbusAt("input", 4))
    >>> celsius.from_registers([272]), celsius.to_registers(-0.5)
    (27.2, (65531,))
    """

    name: str
    type: str
    unit: str = ""
    scale: Fraction = Fraction(1)
    default: Value | None = None
    minimum: int | float | None = None
    maximum: int | float | None = None
    access: ParameterAccess = "rw"
    values: Mapping[int, str] = field(default_factory=dict)
    bits: Mapping[int, str] = field(default_factory=dict)
    firmware: str = ""
    kind: ParameterKind = "setting"
    """A setting is kept and restored; a command makes the device act, a measurement is made by it."""
    storable: bool | None = None
    group: str = ""
    """The heading under which a listing has it: see `group` in `catalog/README.md`."""
    answered: bool = True
    """Whether the device answers a write: some restart instead."""
    note: str = ""
    printed: Mapping[str, str] = field(default_factory=dict)
    modbus: ModbusAt | None = None
    object: ObjectAt | None = None

    def __hash__(self) -> int:
        return hash((self.name, self.modbus, self.object))

    def __repr__(self) -> str:
        return f"<Parameter {self.name}: {', '.join(filter(None, (f'{self.access} {self.type}', *self.places)))}>"

    @property
    def places(self) -> tuple[str, str]:
        """The addresses on Modbus and on CANopen as text, such as 'input 24' and '6041h:00', or an empty text."""
        modbus, canopen = "", ""
        if (place := self.modbus) is not None:
            part = f" {place.half}" if place.half else f" bit {place.bit}" if place.bit is not None else ""
            modbus = f"{place.table} {place.address}{part}"
        if (entry := self.object) is not None:
            canopen = f"{entry.index:04X}h:{entry.sub:02X}" + ("" if entry.bit is None else f" bit {entry.bit}")
        return modbus, canopen

    # Values in the unit

    @property
    def readable(self) -> bool:
        """Whether the device allows reading it."""
        return self.access != "wo"

    @property
    def writable(self) -> bool:
        """Whether the device allows writing it."""
        return self.access != "ro"

    def check(self, value: Value) -> Value:
        """Return the value. Raises EncodeError if it is not in the range of the parameter.

        >>> Parameter("Set-point", "u16", unit="l/h", maximum=100).check(101)
        Traceback (most recent call last):
        ...
        barewire.errors.EncodeError: Set-point = 101: expected at most 100 l/h
        """
        if self.type == "bool":
            if value not in (0, 1):
                raise EncodeError(f"{self.name} = {shown(value)}: expected 0 (off) or 1 (on)", self.name)
            return bool(value)
        if self.type in _NOT_NUMBERS:
            if not isinstance(value, _NOT_NUMBERS[self.type]):
                expected = "text" if self.type == "text" else "bytes"
                raise EncodeError(f"{self.name} = {shown(value)}: expected {expected}", self.name)
            return value
        if not isinstance(value, (int, float)):
            raise EncodeError(f"{self.name} = {shown(value)}: expected a number", self.name)
        # Compared this way round, not-a-number is outside of every range.
        above = self.minimum is None or value >= self.limit(self.minimum, -1)
        if not (above and (self.maximum is None or value <= self.limit(self.maximum, 1))):
            limits = limits_text(self.minimum, self.maximum)
            raise EncodeError(f"{self.name} = {show(value)}: expected {limits} {self.unit}".rstrip(), self.name)
        return value

    def limit(self, limit: int | float, side: int) -> int | float:
        """Return the limit; with some slack for an f32, since the 32-bit float nearest to a decimal may exceed it."""
        return limit + side * abs(limit) * 6e-8 if self.type == "f32" else limit

    def text(self, value: Value) -> str:
        """Return the value with its unit, and in words where its values or bits have names.

        >>> Parameter("State", "u8", values={2: "Starter ready"}).text(2)
        '2 (Starter ready)'
        """
        shown_value = self.plain_text(value) + (f" {self.unit}" if self.unit else "")
        if isinstance(value, int) and self.type != "text":
            if int(value) in self.values:
                return f"{shown_value} ({self.values[int(value)]})"
            if self.bits and self.type != "bool":
                names = [name for bit, name in sorted(self.bits.items()) if int(value) >> bit & 1]
                return f"{shown_value} ({', '.join(names) or 'no bit set'})"
        return shown_value

    def shortened(self, value: Value) -> Value:
        """Return the value with the fewest digits that are the same on the wire: a 32-bit float without the binary tail
        that it has as a Python float. Any other value is as it was.

        >>> Parameter("Ratio", "f32").shortened(0.20000000298023224), Parameter("Energy", "f64").shortened(300000.125)
        (0.2, 300000.125)
        """
        return _short_f32(value, float(self.scale)) if self.type == "f32" and isinstance(value, float) else value

    def plain_text(self, value: Value) -> str:
        """Return the value as text, without unit and names."""
        return show(self.shortened(value))

    # Raw numbers, as the wire has them

    def to_raw(self, value: Value) -> Value:
        """Return the number on the wire: the value divided by the scale.

        Raises EncodeError for a value out of range or between two steps.
        """
        value = self.check(value)
        if self.scale == 1 or isinstance(value, (str, bytes)):
            return value
        if self.type.startswith("f"):
            if abs(value) > 1e308:
                raise EncodeError(f"{self.name} = {shown(value)}: more than a float can hold", self.name)
            return float(value) / float(self.scale)
        if value - value != 0:
            raise EncodeError(f"{self.name} = {shown(value)}: expected a finite number", self.name)
        exact = Fraction(value) / self.scale
        raw = round(exact)
        # A decimal such as 27.2 has no exact binary form: what a float rounds is no difference, and neither is a
        # thousandth of a step.
        rounding = Fraction(ulp(value)) / abs(self.scale) / 2 if isinstance(value, float) else Fraction(0)
        is_told_apart = rounding < Fraction(1, 2)
        if is_told_apart and abs(exact - raw) <= max(rounding, Fraction(1, 1000)):
            return raw
        step = f"{show(float(self.scale))} {self.unit}".rstrip()
        why = f"it goes in steps of {step}" if is_told_apart else f"no float tells its steps of {step} apart here"
        raise EncodeError(f"{self.name} = {show(value)}: {why}", self.name)

    def from_raw(self, raw: Value) -> Value:
        """Return the value in the unit for a number from the wire."""
        if self.scale == 1 or isinstance(raw, (str, bytes)):
            return raw
        if isinstance(raw, float):
            return raw * float(self.scale)
        scaled = Fraction(raw) * self.scale
        return float(scaled) if scaled.denominator != 1 else int(scaled)

    # Modbus

    def to_registers(self, value: Value, old: Sequence[int] = ()) -> tuple[int, ...]:
        """Return the registers that hold the value. Half a register or a bit needs `old`, the present register."""
        place = self._on_modbus()
        raw = self.to_raw(value)
        if place.partial:
            if len(old) != 1:
                raise EncodeError(f"{self.name} is part of a register: its present content is needed", self.name)
            if place.bit is not None:
                return (set_bit(old[0], place.bit, bool(raw)),)
            assert place.half is not None
            return (set_half(old[0], place.half, codec(self.type).encode(raw)[0]),)
        return to_registers(self._register_codec(place).encode(raw))

    def from_registers(self, registers: Sequence[int]) -> Value:
        """Return the value in these registers. Raises DecodeError for a wrong number of them."""
        place = self._on_modbus()
        if len(registers) != place.words:
            data = from_registers(registers)
            text = f"{self.name} takes {place.words} registers, not {len(registers)}"
            short = len(registers) < place.words
            raise DecodeError("short" if short else "long", data, min(len(data), 2 * place.words), text)
        if place.bit is not None:
            return get_bit(registers[0], place.bit)
        if place.half is not None:
            return self.from_raw(codec(self.type).decode(bytes([get_half(registers[0], place.half)])))
        raw = self._register_codec(place).decode(from_registers(registers))
        return bool(raw) if self.type == "bool" else self.from_raw(raw)

    def _on_modbus(self) -> ModbusAt:
        if self.modbus is None:
            raise EncodeError(f"{self.name} has no address on Modbus", self.name)
        return self.modbus

    def _register_codec(self, place: ModbusAt) -> Codec:
        if self.type == "text":
            return Text(2 * place.words)
        # A byte or a bit that has a register to itself fills it as a 16-bit number.
        wide = {"u8": "u16", "i8": "i16", "bool": "u16"}.get(self.type, self.type)
        return codec(wide, place.order)

    # CANopen: always little-endian

    def to_object(self, value: Value, old: bytes = b"") -> bytes:
        """Return the bytes of the object. For one bit of an object, `old` is its present content."""
        place = self._in_dictionary()
        raw = self.to_raw(value)
        if place.bit is not None:
            if not old:
                raise EncodeError(f"{self.name} is one bit of an object: its present content is needed", self.name)
            word = set_bit(int.from_bytes(old, "little"), place.bit, bool(raw), 8 * len(old))
            return word.to_bytes(len(old), "little")
        return self._object_codec().encode(raw)

    def from_object(self, data: bytes) -> Value:
        """Return the value in the bytes of the object. Bytes beyond its width are accepted if they are zero."""
        place = self._in_dictionary()
        if place.bit is not None:
            return get_bit(int.from_bytes(data, "little"), place.bit, 8 * len(data))
        of_object = self._object_codec()
        # Some devices answer every object in four bytes (shown in the guide of the AZ3), padded with zeros.
        if of_object.size is not None and len(data) > of_object.size and not any(data[of_object.size :]):
            data = data[: of_object.size]
        raw = of_object.decode(data)
        if isinstance(raw, str):
            return raw.rstrip("\0")  # others end a text with a zero, as C does
        return bool(raw) if self.type == "bool" else self.from_raw(raw)

    @property
    def object_type(self) -> str:
        """The type of the object: that of the value, where the object has no type of its own."""
        return self._in_dictionary().type or self.type

    @property
    def object_size(self) -> int | None:
        """The size of the object in bytes, None if it varies. A bit does not give the width of its object: 16 bits are
        assumed."""
        return 2 if self._in_dictionary().bit is not None else self._object_codec().size

    def _in_dictionary(self) -> ObjectAt:
        if self.object is None:
            raise EncodeError(f"{self.name} has no address in the object dictionary", self.name)
        return self.object

    def _object_codec(self) -> ObjectCodec:
        return _codec_of_object(self.object_type)


@cache
def _codec_of_object(type_name: str) -> ObjectCodec:
    from barewire.canopen.datatypes import object_codec  # a machine on Modbus loads nothing of CANopen

    return object_codec({"bool": "u8", "text": "string"}.get(type_name, type_name))


class Reading(NamedTuple):
    """A parameter and the value that was read.

    >>> reading = Reading(Parameter("Voltage", "f32", unit="V"), 230.0)
    >>> reading, reading.value, reading.number > 200, f"{reading:.1f}"
    (<Reading Voltage = 230 V>, 230.0, True, '230.0')

    It is a tuple: to compare or to calculate, use `number`, and `text` for a text; `value` is either.
    """

    parameter: Parameter
    value: Value

    @property
    def name(self) -> str:
        """The parameter's name."""
        return self.parameter.name

    @property
    def unit(self) -> str:
        """The parameter's unit."""
        return self.parameter.unit

    def __str__(self) -> str:
        return f"{self.name} = {self.parameter.text(self.value)}"

    def __repr__(self) -> str:
        return f"<Reading {self}>"

    def __format__(self, spec: str) -> str:
        return format(self.value, spec) if spec else str(self)

    def __float__(self) -> float:
        return float(self.number)

    def __int__(self) -> int:
        return int(self.number)

    @property
    def number(self) -> int | float:
        """The value, which must be a number (a bit is one). Raises TypeError for a text, and for bytes."""
        if not isinstance(self.value, (int, float)):
            raise TypeError(f"{self!r}: its value is not a number: use .text, or .value for bytes")
        return self.value

    @property
    def text(self) -> str:
        """The value, which must be a text. Raises TypeError for any other; in words each is `str(reading)`."""
        if not isinstance(self.value, str):
            raise TypeError(f"{self!r}: its value is not a text: use .number, or .value for bytes")
        return self.value


def _use_value(operation: str) -> Callable[[Any, Any], Any]:
    """Return the method of a `Reading` for an operator: that of a tuple, and an error with a hint for numbers."""
    of_tuple = getattr(tuple, operation, None)

    def refuse(reading: Reading, other: Any) -> Any:
        if of_tuple is not None and isinstance(other, tuple):
            return of_tuple(reading, other)
        raise TypeError(f"{reading!r}: use its .number")

    return refuse


_OPERATORS = ("__add__", "__radd__", "__sub__", "__rsub__", "__mul__", "__rmul__", "__truediv__", "__rtruediv__")
for _operation in (*_OPERATORS, "__lt__", "__le__", "__gt__", "__ge__"):
    setattr(Reading, _operation, _use_value(_operation))  # not in the class: type checkers report these by themselves


def limits_text(low: int | float | None, high: int | float | None) -> str:
    """Return a range of which at least one limit is given: '0..300', '5', 'at least 0' or 'at most 7'."""
    if low is None or high is None:
        return f"at least {show(low)}" if low is not None else f"at most {show(high or 0)}"
    return show(low) if low == high else f"{show(low)}..{show(high)}"


def show(value: Value, type_name: str = "") -> str:
    """Return a value as the shortest text that loses nothing. Only the type f32 tells that a float has 32 bits, and a
    binary tail that is not shown.

    >>> show(654321.01), show(0.20000000298023224, "f32"), show(3000.0), show(True), show(b"\\x01\\xAB")
    ('654321.01', '0.2', '3000', 'on', '01 AB')
    """
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return repr(_short_f32(value) if type_name == "f32" else value).removesuffix(".0")
    if isinstance(value, bytes):
        return value.hex(" ").upper()
    return shown(value) if type(value) is int else str(value)


def _short_f32(value: float, scale: float = 1.0) -> float:
    wire = codec("f32")
    try:
        raw = wire.encode(value / scale)
        short = (float(f"{value:.{digits}g}") for digits in range(6, 10))  # nine digits tell all of them apart
        return next((number for number in short if wire.encode(number / scale) == raw), value)
    except EncodeError:  # more than 32 bits hold
        return value


def range_text(parameter: Parameter) -> str:
    """Return the range of a parameter, such as '0..300', '5', 'at most 7' or an empty text.

    >>> range_text(Parameter("Set-point", "u16", minimum=0, maximum=100))
    '0..100'
    >>> range_text(Parameter("Number of starts", "u16", maximum=7))
    'at most 7'
    """
    low, high = parameter.minimum, parameter.maximum
    return "" if low is None and high is None else limits_text(low, high)


class Readings(list[Reading]):
    """The readings of one call, in the order of the names."""

    def _repr_html_(self) -> str:
        rows = ((reading.name, reading.parameter.text(reading.value)) for reading in self)
        return html_table(("name", "value"), rows)
