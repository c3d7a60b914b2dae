"""Bytes from registers as a number: the way back of `number`, and what the other orders would make of them.

CC CD 3F 8C  in order CDAB   ->   3F 8C CC CD   ->   + 1.1000000238 x 2^0
"""

from __future__ import annotations

from fractions import Fraction

from barewire.codecs.numbers import codec
from barewire.codecs.order import ORDERS, Order
from barewire.errors import DecodeError, EncodeError, shown
from barewire_workbench.frames.result import counted
from barewire_workbench.steps.model import Steps, StepSection, StepTable, spaced_hex
from barewire_workbench.steps.number import FLOAT_SHAPES, NUMBER_TYPES, FloatShape, float_fields, shown_number
from barewire_workbench.steps.registers import ordered


def number_from_bytes_steps(data: bytes, type: str = "f32", order: Order = "ABCD") -> Steps:
    """Work out the number in some bytes, in the order in which they came over the wire.

    >>> number_from_bytes_steps(bytes.fromhex("CCCD3F8C"), "f32", "CDAB")
    <Steps float: CC CD 3F 8C as f32 in order CDAB is 1.100000023841858>

    Raises EncodeError for a type or an order that does not exist, and DecodeError for another number of bytes than the
    type has.
    """
    if type not in NUMBER_TYPES:
        raise EncodeError(f"type {shown(type)}: expected one of {', '.join(NUMBER_TYPES)}", "type")
    coder = codec(type, order)
    if len(data) != coder.size:
        text = f"{counted(len(data))}, but {type} has {coder.size}"
        raise DecodeError("short" if len(data) < coder.size else "long", data, min(len(data), coder.size), text)
    value = coder.decode(data)
    sections: list[StepSection] = []
    named = f"{spaced_hex(data)} as {type}"
    straight = ordered(data, order)
    if len(data) > 1:
        name = _order_name(order, data)
        named = f"{named} in order {name}"
        sections.append(f"Order {name}. The most significant byte first, the bytes are {spaced_hex(straight)}.")
    pattern = int.from_bytes(straight, "big")
    if type in FLOAT_SHAPES:
        sections += _float(pattern, FLOAT_SHAPES[type])
    else:
        sections += _integer(pattern, 8 * len(data), signed=type[0] == "i")
    if len(data) > 1:
        rows = tuple(
            (
                _order_name(each, data),
                spaced_hex(ordered(data, each)),
                repr(codec(type, each).decode(data)),
                "<--" if _order_name(each, data) == _order_name(order, data) else "",
            )
            for each in (ORDERS if len(data) > 2 else ORDERS[:3:2])
        )
        sections.append("Only the manual of the device says which order it uses. A wrong one often shows itself:")
        sections.append(StepTable("", ("order", "sorted", "number", ""), rows))
    return Steps(
        "float",
        named,
        "IEEE 754; the order of registers: a convention of each device"
        if type in FLOAT_SHAPES
        else "Two's complement; the order of registers: a convention of each device",
        tuple(sections),
        f"{named} is {value!r}",
        {"type": type, "order": order, "bytes": spaced_hex(data), "value": value},
    )


def _order_name(order: Order, data: bytes) -> str:
    """Return the name of an order; two bytes have only AB and BA."""
    return order if len(data) > 2 else {"ABCD": "AB", "CDAB": "AB", "BADC": "BA", "DCBA": "BA"}[order]


def _float(pattern: int, shape: FloatShape) -> list[StepSection]:
    field = pattern >> shape.fraction & (1 << shape.exponent) - 1
    fraction = pattern & (1 << shape.fraction) - 1
    sign = "-" if pattern >> shape.exponent + shape.fraction else ""
    sections: list[StepSection] = [float_fields(pattern, shape)]
    if field == (1 << shape.exponent) - 1:
        what = "of 0 mean infinity" if fraction == 0 else "other than 0 mean NaN, not a number"
        return [*sections, f"An exponent of ones and a fraction {what}."]
    part = Fraction(fraction, 1 << shape.fraction)
    if field:
        power, mantissa = field - shape.bias, 1 + part
        exponent = f"The power of two is {field} - {shape.bias} = {power}. In front of the fraction stands a 1: "
    else:
        power, mantissa = 1 - shape.bias, part
        exponent = f"An exponent of 0 means the power {power} and no 1 in front of the fraction: "
    return [
        *sections,
        f"{exponent}{'1 + ' if field else ''}{fraction} / 2^{shape.fraction} = {shown_number(mantissa)}.",
        f"The number is {sign}{shown_number(mantissa)} x 2^{power} = "
        f"{sign}{shown_number(mantissa * Fraction(2) ** power, 60)}.",
    ]


def _integer(pattern: int, bits: int, *, signed: bool) -> list[StepSection]:
    found = f"{pattern:0{bits // 4}X}h = {pattern}."
    if not signed:
        return [found]
    if not pattern >> bits - 1:
        return [f"{found} The highest bit is 0, so the number is not negative."]
    return [
        f"{found} The highest bit is 1, so the number is negative: "
        f"subtract 2^{bits}, {pattern} - {1 << bits} = {pattern - (1 << bits)}."
    ]
