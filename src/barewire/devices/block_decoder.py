"""The registers of one block -> the values of its parameters: planned once, then one struct call for all of them.

    registers   0      1      2      3      4          A u16, C f32, E i16; nobody asked for 1
                A      .      C             E
    struct      H      2x     f             h          ">H2xfh", over the ten bytes

What lies in another order than ABCD, is part of a register, is text, or lies over a neighbour is read one by one,
beside the rest; the values are the same either way.

I know: where the members of a block lie and of which type they are.  I never know: lines, requests, time.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import lru_cache

from barewire.codecs import Value
from barewire.devices.parameter import ModbusAt, Parameter
from barewire.devices.plan import Member, PlannedRead

Decode = Callable[[Sequence[int]], dict[str, Value]]

# A byte or a bit that has a register to itself fills it as a 16-bit number, as in `Parameter`.
_KINDS = {"u8": "H", "u16": "H", "u32": "I", "u64": "Q", "i8": "h", "i16": "h", "i32": "i", "i64": "q"}
_KINDS |= {"f32": "f", "f64": "d", "bool": "H"}


@lru_cache(maxsize=256)
def block_decoder(block: PlannedRead) -> Decode:
    """What turns the content of this block, as a response has it, into values by name.

    >>> from barewire.devices import load
    >>> from barewire.devices.plan import plan_reads
    >>> adxl = load("adxl")
    >>> (block,) = plan_reads(adxl, [adxl.find("L1 current"), adxl.find("L3 current")])
    >>> block.quantity, block_decoder(block)(range(block.quantity))
    (6, {'L1 current': 0.0001, 'L3 current': 26.2149})
    """
    if block.table in ("coil", "discrete"):
        places = [(parameter.name, offset) for parameter, offset in block.members]
        return lambda content: {name: bool(content[offset]) for name, offset in places}
    together: list[Parameter] = []
    alone: list[tuple[Parameter, int, int]] = []
    kinds, reached = ">", 0
    for parameter, offset in sorted(block.members, key=_offset):
        place = parameter.modbus
        assert place is not None
        kind = _kind(parameter, place)
        if kind is None or offset < reached:
            alone.append((parameter, offset, offset + place.words))
            continue
        kinds += f"{2 * (offset - reached)}x{kind}"
        together.append(parameter)
        reached = offset + place.words
    kinds += f"{2 * (block.quantity - reached)}x"
    words, values = struct.Struct(f">{block.quantity}H"), struct.Struct(kinds)
    rules = [(parameter.name, _scaling(parameter)) for parameter in together]

    def decode(content: Sequence[int]) -> dict[str, Value]:
        raw = values.unpack(words.pack(*content))
        found = {name: number if rule is None else rule(number) for (name, rule), number in zip(rules, raw)}
        for parameter, start, end in alone:
            found[parameter.name] = parameter.from_registers(content[start:end])
        return found

    return decode


def _offset(member: Member) -> int:
    return member.offset


def _kind(parameter: Parameter, place: ModbusAt) -> str | None:
    """The struct's letter for a parameter that lies in whole registers, the more significant first."""
    kind = _KINDS.get(parameter.type)
    straight = place.order == "ABCD" and place.half is None and place.bit is None
    if kind is None or not straight or struct.calcsize(f">{kind}") != 2 * place.words:
        return None
    return kind


def _scaling(parameter: Parameter) -> Callable[[float], Value] | None:
    """What `Parameter.from_raw` does, worked out beforehand; None if it does nothing."""
    if parameter.type == "bool":
        return bool
    if parameter.scale == 1:
        return None
    if parameter.type[0] == "f":
        factor = float(parameter.scale)
        return lambda raw: raw * factor
    above, below = parameter.scale.numerator, parameter.scale.denominator

    def scaled(raw: float) -> Value:
        # A quotient of whole numbers is rounded once, so this is the exact fraction as a float.
        return raw * above / below if raw * above % below else int(raw * above // below)

    return scaled
