"""Lab 6: registers as numbers: signed, 32 bits in both word orders, floats; and two ways to count addresses."""

from __future__ import annotations

import struct

from barewire.codecs import ORDERS, codec
from barewire.codecs.order import Order
from barewire_workbench.cli.teach.labs.model import AnswerCheck, Lab, LabExercise, right, wrong
from barewire_workbench.cli.teach.labs.reading import any_number, in_hex, typed_number, typed_octets

_SIGNED = bytes.fromhex("FF 38")
_COUNTER = 100_000
_FLOAT = 19.25
_ORDER: Order = "CDAB"
_PRINTED = 40108


def _i16(answer: str) -> AnswerCheck:
    given, expected = typed_number(answer), codec("i16").decode(_SIGNED)
    if given == expected:
        return right(
            f"{in_hex(_SIGNED)} is {codec('u16').decode(_SIGNED)} without a sign; minus 65536 that is {expected}"
        )
    if given == codec("u16").decode(_SIGNED):
        return wrong("that is the number without a sign; in an i16 the highest bit counts -32768")
    return wrong(f"as i16, {given:g} is not {in_hex(_SIGNED)}")


def _u32(answer: str) -> AnswerCheck:
    given, data = any_number(answer), codec("u32").encode(_COUNTER)
    if _COUNTER in given:
        return right(f"{data.hex().upper()}h: the register with the lower address has the high half, order ABCD")
    for order in ORDERS:
        if codec("u32", order).decode(data) in given:
            return wrong(
                f"that is the number in order {order}; the task says that the high half is in the first register"
            )
    return wrong(f"the first register counts 65536, the second one 1: the registers are {in_hex(data)} in hexadecimal")


def _word_order(answer: str) -> AnswerCheck:
    typed, registers = answer.strip().upper(), codec("f32", _ORDER).encode(_FLOAT)
    order = next((order for order in ORDERS if order == typed), None)
    if order is None:
        return wrong(f"expected one of {', '.join(ORDERS)}")
    value = codec("f32", order).decode(registers)
    if value == _FLOAT:
        return right(f"{in_hex(registers)} in order {typed} is {value} \u00b0C; A is the highest byte of the number")
    return wrong(f"in order {typed} these registers are {value:.6g}, hardly a temperature")


def _to_registers(answer: str) -> AnswerCheck:
    data = typed_octets(answer)
    if len(data) != 4:
        return wrong(f"{len(data)} bytes; two registers have 4")
    expected = struct.pack(">f", -1.5)
    for order in ORDERS:
        value = codec("f32", order).decode(data)
        if value == -1.5:
            if order == "ABCD":
                return right(f"1.5 = 1.5 x 2^0: sign 1, exponent 0 + 127, fraction 0.5: {in_hex(expected)}")
            return wrong(f"that is -1.5 in order {order}; the task asks for ABCD")
    return wrong(f"as f32 in order ABCD that is {codec('f32').decode(data):.6g}")


def _address(answer: str) -> AnswerCheck:
    given, expected = any_number(answer), _PRINTED - 40001
    if expected in given:
        return right(
            f"{_PRINTED} is holding register number {_PRINTED - 40000}, counted from "
            f"1; on the wire {expected}, {expected:04X}h"
        )
    if _PRINTED in given:
        return wrong(
            "that is the printed number; its first digit, 4, names the table, which the function code says on the wire"
        )
    if _PRINTED - 40000 in given:
        return wrong("that is its number counted from 1; on the wire addresses are counted from 0")
    return wrong("the first digit names the table, the other four the number in it, counted from 1")


VALUES_LAB = Lab(
    6,
    "Values and word order",
    "Get numbers with a sign, long numbers and floats out of 16-bit registers, in the order that the device has.",
    20,
    "06-values-and-word-order.md",
    ("barewire simulate table tcp://127.0.0.1:1503",),
    (
        LabExercise("6.1", f"A register holds {in_hex(_SIGNED)}, type i16. Which number is it?", "a number", _i16),
        LabExercise(
            "6.2",
            "Registers 10 and 11 hold {:d} and {:d}, type u32, the high half first. Which number is it?".format(
                *divmod(_COUNTER, 65536)
            ),
            "a number",
            _u32,
        ),
        LabExercise(
            "6.3",
            f"Two registers with a room temperature, type f32, hold {in_hex(codec('f32', _ORDER).encode(_FLOAT))}. "
            "Which order has the device?",
            f"one of {', '.join(ORDERS)}",
            _word_order,
        ),
        LabExercise(
            "6.4", "Which two registers hold -1.5 as f32 in order ABCD?", "four bytes in hexadecimal", _to_registers
        ),
        LabExercise(
            "6.5",
            f"A manual prints holding register {_PRINTED}. Which address goes into the request?",
            "a number, decimal or hexadecimal with h",
            _address,
        ),
    ),
)
