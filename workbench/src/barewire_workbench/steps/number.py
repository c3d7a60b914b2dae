"""A number as bytes and registers, and back: sign, exponent and fraction of a float, two's complement, byte orders.

    1.1 as f32     0 | 0111 1111 | 000 1100 1100 1100 1100 1101     3F 8C CC CD

    CC CD 3F 8C  in order CDAB   ->   3F 8C CC CD   ->   + 1.1000000238 x 2^0

The steps use exact fractions; `codecs` has the numbers that the package sends.
"""

from __future__ import annotations

import math
import re
import struct
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from typing import NamedTuple

from barewire.codecs.numbers import codec
from barewire.codecs.order import ORDERS, Order
from barewire.errors import DecodeError, EncodeError, shown
from barewire_workbench.frames.result import counted
from barewire_workbench.steps.model import Steps, StepSection, StepTable, grouped_bits, spaced_hex

_ORDER_TEXT: dict[Order, str] = {
    "ABCD": "high word first: big-endian, the usual reading",
    "CDAB": "low word first",
    "BADC": "high word first, bytes swapped",
    "DCBA": "all reversed: little-endian, as on CANopen",
}


def ordered(data: bytes, order: Order) -> bytes:
    """Return big-endian bytes in an order: words reversed for C and D in front, bytes swapped for B in front of A.

    >>> ordered(bytes.fromhex("0A0B0C0D"), "CDAB").hex(" ")
    '0c 0d 0a 0b'
    """
    if len(data) < 2:
        return data
    words = [data[place : place + 2] for place in range(0, len(data), 2)]
    if order in ("CDAB", "DCBA"):
        words = words[::-1]
    return b"".join(word[::-1] if order in ("BADC", "DCBA") else word for word in words)


def order_sections(data: bytes, order: Order) -> list[StepSection]:
    """Return the table of the four orders for big-endian bytes; the one that was asked for is marked."""
    if len(data) == 1:
        return [f"One byte, {spaced_hex(data)}, has no order; in a register it is one half."]
    letters = " ".join(f"{chr(ord('A') + place)} = {byte:02X}h" for place, byte in enumerate(data))
    count = len(data) // 2
    rows = []
    for possible, name in _order_names(len(data)).items():
        sent = ordered(data, possible)
        registers = [f"{sent[place]:02X}{sent[place + 1]:02X}h" for place in range(0, len(data), 2)]
        mark = "<--" if name == _order_name(order, len(data)) else ""
        text = _ORDER_TEXT[possible] if count > 1 else ("high byte first" if name == "AB" else "bytes swapped")
        rows.append((name, spaced_hex(sent), *registers, text, mark))
    header = ("order", "on the wire", *[f"register n+{place}" if place else "register n" for place in range(count)])
    return [
        f"Order. The bytes, the most significant first, are {letters}. A register of Modbus holds two bytes and is "
        "sent high byte first; which register has which word is not standardised.",
        StepTable("", (*header, "meaning", ""), tuple(rows)),
    ]


def _order_names(size: int) -> dict[Order, str]:
    """Return the orders that differ for a number of this size, with their names: two bytes have only AB and BA."""
    return {"ABCD": "AB", "BADC": "BA"} if size == 2 else {order: order for order in ORDERS}


def _order_name(order: Order, size: int) -> str:
    return order if size > 2 else "AB" if order in ("ABCD", "CDAB") else "BA"


# A number as bytes --------------------------------------------------------------------------------------------------


NUMBER_TYPES = ("f32", "f64", "u8", "i8", "u16", "i16", "u32", "i32", "u64", "i64")

_LONGEST_TEXT = 1200
_POWERS = 400
"""The largest power of ten of a number: that of a f64 is 308, and its smallest is -324."""
_FAR = re.compile(r"([eE][+-]?)0*[1-9][0-9]{3,}$")
"""A power of ten beyond every type; a smaller one is read in its place: machines of 32 bits have no 1e999999999."""


class FloatShape(NamedTuple):
    """A format of IEEE 754: the bits of the exponent and of the fraction; the sign is in front of them."""

    exponent: int
    fraction: int

    @property
    def bias(self) -> int:
        return (1 << self.exponent - 1) - 1

    @property
    def sign(self) -> int:
        """The pattern in which only the bit of the sign is set."""
        return 1 << self.exponent + self.fraction

    @property
    def ones(self) -> int:
        """The exponent of infinity and NaN: all its bits are 1."""
        return (1 << self.exponent) - 1

    def split(self, pattern: int) -> tuple[bool, int, int]:
        """Return whether the number is negative, its exponent and its fraction."""
        fraction = pattern & (1 << self.fraction) - 1
        return pattern >= self.sign, pattern >> self.fraction & self.ones, fraction

    def data(self, pattern: int) -> bytes:
        """Return the bytes of a pattern, the most significant first."""
        return pattern.to_bytes((1 + self.exponent + self.fraction) // 8, "big")


FLOAT_SHAPES = {"f32": FloatShape(8, 23), "f64": FloatShape(11, 52)}


def number_steps(text: str, type: str = "f32", order: Order = "ABCD") -> Steps:
    """Work out the bytes of a number, given as text, in a type and a byte order.

    >>> number_steps("1.1", "f32", "CDAB")
    <Steps float: 1.1 as f32 in order CDAB: CC CD 3F 8C>

    Raises EncodeError for a text that is no number, a type or an order that does not exist, and a number that does not
    fit the type.
    """
    if type not in NUMBER_TYPES:
        raise EncodeError(f"type {shown(type)}: expected one of {', '.join(NUMBER_TYPES)}", "type")
    coder = codec(type, order)
    if type in FLOAT_SHAPES:
        value, data, sections = _float(text, type)
        source = f"IEEE 754, binary{coder.bits}; the order of registers: a convention of each device"
    else:
        value, data, sections = _integer(text, type)
        source = "Modbus Application Protocol 1.1b3, 4.2; the order of registers: a convention of each device"
    sent = coder.encode(value)
    in_order = f" in order {_order_name(order, len(sent))}" if len(sent) > 1 else ""
    named = f"{shown(text.strip()).strip(chr(39))} as {type}{in_order}"
    registers = [int.from_bytes(sent[place : place + 2], "big") for place in range(0, len(sent) - 1, 2)]
    return Steps(
        "float",
        named,
        source,
        (*sections, *order_sections(data, order)),
        f"{named}: {spaced_hex(sent)}",
        {"type": type, "order": order, "bytes": spaced_hex(sent), "registers": registers, "value": value},
    )


# Integers ---------------------------------------------------------------------------------------------------------


def _integer(text: str, type: str) -> tuple[int, bytes, list[StepSection]]:
    try:
        given = int(text.strip(), 0) if len(text) <= 100 else None
    except ValueError:
        given = None
    if given is None:
        raise EncodeError(f"{shown(text)}: expected a whole number for {type}, such as 1000, -5 or 0x3E8", "value")
    number = int(codec(type).check(given))
    bits = int(type[1:])
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if type[0] == "i" else (0, (1 << bits) - 1)
    sections: list[StepSection] = [f"{type} has {bits} bits: {low} to {high}."]
    pattern = number
    if number < 0:
        pattern = (1 << bits) + number
        inverted = (1 << bits) - 1 + number  # 2^bits - 1 has only ones
        sections += [
            f"A negative number is stored as its two's complement, 2^{bits} - {-number} = {pattern}. To find it "
            "without subtracting, write the number without its sign, invert all bits, and add 1:",
            StepTable(
                "",
                ("step", "bits", "hex"),
                (
                    (f"{-number}", grouped_bits(-number, bits), f"{-number:0{bits // 4}X}h"),
                    ("all bits inverted", grouped_bits(inverted, bits), f"{inverted:0{bits // 4}X}h"),
                    ("plus 1", grouped_bits(pattern, bits), f"{pattern:0{bits // 4}X}h"),
                ),
            ),
        ]
    else:
        sections.append(f"In binary: {grouped_bits(number, bits)}, in hexadecimal {number:0{bits // 4}X}h.")
    return number, pattern.to_bytes(bits // 8, "big"), sections


# Floats -----------------------------------------------------------------------------------------------------------


def _float(text: str, type: str) -> tuple[float, bytes, list[StepSection]]:
    shape = FLOAT_SHAPES[type]
    special = _special(text.strip().lower(), shape)
    if special is not None:
        pattern, explanation = special
        sections: list[StepSection] = [explanation]
    else:
        number, negative = _decimal(text, type)
        pattern, sections = _rounded(number, negative, shape, type)
    data = shape.data(pattern)
    value = struct.unpack(">f" if type == "f32" else ">d", data)[0]
    sections.append(float_fields(pattern, shape))
    if special is None:
        sections += _exactness(number, negative, pattern, shape, type)
    return value, data, sections


def _special(text: str, shape: FloatShape) -> tuple[int, str] | None:
    """Return the pattern and the explanation of a text that is no finite number."""
    word, negative = text.lstrip("+-"), text.startswith("-")
    sign, ones = shape.sign if negative else 0, shape.ones << shape.fraction
    if word in ("inf", "infinity"):
        return sign | ones, "Infinity: an exponent of ones and a fraction of zeros."
    if word == "nan":
        quiet = sign | ones | 1 << shape.fraction - 1
        return quiet, "NaN, not a number: an exponent of ones and a fraction that is not 0, here its highest bit."
    return None


def _decimal(text: str, type: str) -> tuple[Fraction, bool]:
    """Return the exact number without its sign, and whether it is negative."""
    try:
        if len(text) > _LONGEST_TEXT or "_" in text:
            raise InvalidOperation
        parsed = Decimal(_FAR.sub(rf"\g<1>{10 * _POWERS}", text.strip()))
    except InvalidOperation:
        raise EncodeError(f"{shown(text)}: expected a number for {type}, such as 1.1, -40 or 2.5e-3", "value") from None
    if not parsed.is_finite():
        raise EncodeError(f"{shown(text)}: expected a number for {type}, such as 1.1, -40 or 2.5e-3", "value")
    if parsed and abs(parsed.adjusted()) > _POWERS:
        raise EncodeError(f"{shown(text)} does not fit {type}: expected powers of ten from -{_POWERS} to {_POWERS}")
    return abs(Fraction(parsed)), parsed.is_signed()


def _rounded(number: Fraction, negative: bool, shape: FloatShape, type: str) -> tuple[int, list[StepSection]]:
    """Return the pattern of the nearest float, and how it is found."""
    sign = shape.sign if negative else 0
    sections: list[StepSection] = [f"Sign. The number is {'negative: 1' if negative else 'not negative: 0'}."]
    if not number:
        return sign, [*sections, "Zero has no highest 1: exponent and fraction are 0."]
    power = _power_of_two(number)
    lowest = 1 - shape.bias
    subnormal = power < lowest
    power = max(power, lowest)
    scaled = number / Fraction(2) ** power
    fraction_exact = (scaled if subnormal else scaled - 1) * (1 << shape.fraction)
    fraction = round(fraction_exact)  # to the nearest whole number, and half to the even one, as IEEE 754 rounds
    field = 0 if subnormal else power + shape.bias
    pattern = (field << shape.fraction) + fraction  # a fraction that rounds up to 2^23 carries into the exponent
    if pattern >> shape.fraction >= shape.ones:
        codec(type).check(math.inf if number > 10**308 else -float(number) if negative else float(number))
        raise EncodeError(f"the number does not fit {type}: at most ±{codec(type).maximum:g}", "value")
    what = f"{shown_number(number)} = {shown_number(scaled)} x 2^{power}"
    if subnormal:
        sections.append(
            f"Exponent. {what}: below 2^{lowest}, the smallest normal power. Such a number is subnormal: its exponent "
            f"field is 0, and there is no 1 in front of its fraction."
        )
    else:
        sections.append(
            f"Exponent. Divide by a power of two so that 1 <= number < 2: {what}. The field holds the power plus "
            f"{shape.bias}, so that it needs no sign: {power} + {shape.bias} = {field} = "
            f"{grouped_bits(field, shape.exponent)}."
        )
    beyond = "" if subnormal else "The 1 in front of the point is not stored. "
    rest = scaled if subnormal else scaled - 1
    sections.append(
        f"Fraction. {beyond}The rest, {shown_number(rest)}, is written in {shape.fraction} binary digits: double it "
        "again and again; the digit in front of the point is the next bit."
    )
    sections.append(_doubling(rest, shape.fraction))
    sections.append(_rounding_text(fraction_exact, fraction, shape))
    return sign | pattern, sections


def _power_of_two(number: Fraction) -> int:
    """Return the largest power of two that is not above the number."""
    power = number.numerator.bit_length() - number.denominator.bit_length()
    return power if Fraction(2) ** power <= number else power - 1


def _doubling(rest: Fraction, places: int) -> StepTable:
    rows = []
    for place in range(1, places + 1):
        doubled = 2 * rest
        bit = int(doubled >= 1)
        rows.append((str(place), f"2 x {shown_number(rest)} = {shown_number(doubled)}", str(bit)))
        rest = doubled - bit
        if not rest and place < places:
            rows.append(("", f"nothing is left: {places - place} zeros follow", ""))
            break
    return StepTable("", ("place", "doubled", "bit"), tuple(rows))


def _rounding_text(exact: Fraction, fraction: int, shape: FloatShape) -> str:
    below = math.floor(exact)
    rest = exact - below
    if not rest:
        return f"Rounding. Nothing is left after {shape.fraction} digits, so the number is stored exactly."
    compared = "less than" if rest < Fraction(1, 2) else "more than" if rest > Fraction(1, 2) else "exactly"
    chosen = "up: 1 is added to the last bit" if fraction > below else "down: the digits stay as they are"
    tie = ", and of two neighbours equally near the even one is taken" if compared == "exactly" else ""
    carry = ""
    if fraction == 1 << shape.fraction:
        carry = ". All digits were 1, so the carry makes the fraction 0 and adds 1 to the exponent"
    return f"Rounding. What is left, {shown_number(rest)}, is {compared} a half{tie}, so round {chosen}{carry}."


def float_fields(pattern: int, shape: FloatShape) -> StepTable:
    """Return the table of the sign, the exponent and the fraction in a pattern."""
    negative, field, fraction = shape.split(pattern)
    data = shape.data(pattern)
    return StepTable(
        "Together: sign, exponent, fraction.",
        ("field", "bits", "value"),
        (
            ("sign", str(int(negative)), "-" if negative else "+"),
            ("exponent", grouped_bits(field, shape.exponent), f"{field}"),
            ("fraction", grouped_bits(fraction, shape.fraction), f"{fraction}"),
            ("all", grouped_bits(pattern, 8 * len(data)), spaced_hex(data)),
        ),
    )


def _exactness(number: Fraction, negative: bool, pattern: int, shape: FloatShape, type: str) -> list[StepSection]:
    sign_bit, magnitude = pattern & shape.sign, pattern & shape.sign - 1
    stored = _value(magnitude, shape)
    sign = "-" if negative else ""
    if stored == number:
        return [f"The stored value is exactly {sign}{shown_number(stored, 60)}."]
    rows = []
    for place, name in ((magnitude - 1, "next to 0"), (magnitude, "stored"), (magnitude + 1, "next beyond")):
        if place < 0 or place >> shape.fraction >= shape.ones:
            continue  # zero has no neighbour nearer to 0, and the largest number none beyond
        value = _value(place, shape)
        difference = shown_number(abs(value - number), 3).replace("...", "")
        rows.append((name, spaced_hex(shape.data(sign_bit | place)), f"{sign}{shown_number(value, 60)}", difference))
    digits = ""
    if magnitude >> shape.fraction:
        digits = f" Any number of up to {6 if type == 'f32' else 15} decimal digits can be read back from a {type}."
    return [
        f"The stored value is not exactly the number. A {type} has no value between these neighbours, so the nearest "
        f"is taken.{digits}",
        StepTable("", ("neighbour", "bytes", "value", "away by"), tuple(rows)),
    ]


def _value(magnitude: int, shape: FloatShape) -> Fraction:
    """Return the exact value of a pattern without its sign bit."""
    _, field, fraction = shape.split(magnitude)
    if field == 0:
        return Fraction(fraction, 1 << shape.fraction) * Fraction(2) ** (1 - shape.bias)
    return (1 + Fraction(fraction, 1 << shape.fraction)) * Fraction(2) ** (field - shape.bias)


def shown_number(number: Fraction, digits: int = 25) -> str:
    """Return a number in decimal: exactly if that takes at most so many digits, else rounded, with '...' behind.

    >>> shown_number(Fraction(11, 10)), shown_number(Fraction(1, 3), 5), shown_number(Fraction(1, 2**60), 10)
    ('1.1', '0.33333...', '8.673617379...e-19')
    """
    if number == 0:
        return "0"
    power = _power_of_ten(number)
    significant = number / Fraction(10) ** (power - digits + 1)
    whole = str(math.floor(significant))
    is_exact = significant.denominator == 1
    kept = whole.rstrip("0") if is_exact else whole
    more = "" if is_exact else "..."
    if not -6 < power < digits:
        return f"{kept[0]}{'.' if len(kept) > 1 else ''}{kept[1:]}{more}e{power:+d}"
    if power < 0:
        return f"0.{'0' * (-power - 1)}{kept}{more}"
    kept = kept.ljust(power + 1, "0")
    return f"{kept[: power + 1]}{'.' if len(kept) > power + 1 or more else ''}{kept[power + 1 :]}{more}"


def _power_of_ten(number: Fraction) -> int:
    power = len(str(number.numerator)) - len(str(number.denominator))
    return power if Fraction(10) ** power <= number else power - 1


# Bytes as a number --------------------------------------------------------------------------------------------------


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
        name = _order_name(order, len(data))
        named = f"{named} in order {name}"
        sections.append(f"Order {name}. The most significant byte first, the bytes are {spaced_hex(straight)}.")
    pattern = int.from_bytes(straight, "big")
    if type in FLOAT_SHAPES:
        sections += _decoded_float(pattern, FLOAT_SHAPES[type])
    else:
        sections += _decoded_integer(pattern, 8 * len(data), signed=type[0] == "i")
    if len(data) > 1:
        rows = tuple(
            (
                possible_name,
                spaced_hex(ordered(data, possible)),
                repr(codec(type, possible).decode(data)),
                "<--" if possible_name == name else "",
            )
            for possible, possible_name in _order_names(len(data)).items()
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


def _decoded_float(pattern: int, shape: FloatShape) -> list[StepSection]:
    negative, field, fraction = shape.split(pattern)
    sign = "-" if negative else ""
    sections: list[StepSection] = [float_fields(pattern, shape)]
    if field == shape.ones:
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


def _decoded_integer(pattern: int, bits: int, *, signed: bool) -> list[StepSection]:
    text = f"{pattern:0{bits // 4}X}h = {pattern}."
    if not signed:
        return [text]
    if not pattern >> bits - 1:
        return [f"{text} The highest bit is 0, so the number is not negative."]
    return [
        f"{text} The highest bit is 1, so the number is negative: "
        f"subtract 2^{bits}, {pattern} - {1 << bits} = {pattern - (1 << bits)}."
    ]
