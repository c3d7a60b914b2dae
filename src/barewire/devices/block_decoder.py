"""The registers of one read request -> the values of its parameters, with one struct call for all of them.

An example:

    registers   0      1      2      3      4          A u16, C f32 in the order CDAB, E i16, F the low half of 4
    bytes       0  1   2  3   4  5   6  7   8  9
                A  A          C  C   C  C   E  EF
    picked      0  1          6  7   4  5   8  9  9    each value with its most significant byte first
    struct      H             f             h     B    ">HfhB"
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any, TypeAlias

from barewire.codecs import Value, to_registers
from barewire.codecs.bits import get_bit
from barewire.codecs.order import reorder
from barewire.devices.parameter import Parameter
from barewire.devices.plan import PlannedRead

BlockDecoder: TypeAlias = Callable[[Sequence[int]], list[Value]]

_LETTERS = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i8": "b", "i16": "h", "i32": "i", "i64": "q"}
_LETTERS |= {"f32": "f", "f64": "d", "bool": "H"}
_IN_REGISTER = {"u8": "H", "i8": "h"}
"""A byte that has a register to itself fills it as a 16-bit number."""


def block_decoder(block: PlannedRead) -> BlockDecoder:
    """Return a function from the content of a response to `block` to the values of its members, in their order.

    >>> from barewire.devices import load
    >>> from barewire.devices.plan import plan_reads
    >>> adxl = load("adxl")
    >>> (block,) = plan_reads(adxl, [adxl.find("L1 current"), adxl.find("L3 current")])
    >>> block.quantity, block_decoder(block)(range(block.quantity))
    (6, [0.0001, 26.2149])
    """
    if block.table in ("coil", "discrete"):
        offsets = [offset for _, offset in block.members]
        return lambda content: [bool(content[offset]) for offset in offsets]
    letters, picked = ">", []
    rules: list[tuple[int, Callable[[Any], Value]]] = []
    for number, (parameter, offset) in enumerate(block.members):
        letter, positions, rule = _member(parameter, 2 * offset)
        letters += letter
        picked += positions
        if rule is not None:
            rules.append((number, rule))
    registers = struct.Struct(f">{block.quantity}H")
    if picked == list(range(registers.size)):
        values = struct.Struct(letters)
        return _with_rules(lambda content: values.unpack(registers.pack(*content)), rules)
    values = struct.Struct(letters + "x")  # one byte more, since itemgetter returns a tuple for two at least
    pick = itemgetter(*picked, 0)
    return _with_rules(lambda content: values.unpack(bytes(pick(registers.pack(*content)))), rules)


def _with_rules(
    unpack: Callable[[Sequence[int]], tuple[Any, ...]], rules: list[tuple[int, Callable[[Any], Value]]]
) -> BlockDecoder:
    def decode(content: Sequence[int]) -> list[Value]:
        values = list(unpack(content))
        for number, rule in rules:
            values[number] = rule(values[number])
        return values

    return decode


def _member(parameter: Parameter, start: int) -> tuple[str, list[int], Callable[[Any], Value] | None]:
    """Return the letter of `struct`, the positions of the bytes with the most significant first, and the function from
    the number to the value (None: the number is the value)."""
    place = parameter.modbus
    assert place is not None
    positions = list(range(start, start + 2 * place.words))
    if place.bit is not None:
        bit = place.bit
        return "H", positions, lambda register: get_bit(register, bit)
    if place.half is not None:
        return _LETTERS[parameter.type], [positions[place.half == "L"]], _scaling(parameter)
    letter = _IN_REGISTER.get(parameter.type) or _LETTERS.get(parameter.type, "")
    if not letter or struct.calcsize(f">{letter}") != len(positions):  # text
        return f"{len(positions)}s", positions, lambda data: parameter.from_registers(to_registers(data))
    in_order = reorder(bytes(range(len(positions))), place.order)
    return letter, [start + position for position in in_order], _scaling(parameter)


def _scaling(parameter: Parameter) -> Callable[[Any], Value] | None:
    """Return `Parameter.from_raw` as a prepared function; None if it changes nothing."""
    if parameter.type == "bool":
        return bool
    if parameter.scale == 1:
        return None
    if parameter.type[0] == "f":
        factor = float(parameter.scale)
        return lambda raw: raw * factor
    above, below = parameter.scale.numerator, parameter.scale.denominator

    def scaled(raw: int) -> Value:
        # A quotient of whole numbers is rounded once, so this is the exact fraction as a float.
        return raw * above / below if raw * above % below else raw * above // below

    return scaled
