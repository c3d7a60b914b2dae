"""The text of values <-> values: numbers in all notations, formulas with the node-ID, values of every data type.

        10  0x0A  012         integers, all ten     0Ah  1,5  +5  08        read as 10, 1.5, 5, 8, and reported
        $NODEID+0x200         a formula             0x200+$NODEID           the same, and reported
        1.5  0x3FC00000       REAL32, either way    FFFEh of an INTEGER16   -2
        01020A                OCTET_STRING, DOMAIN  Device type             VISIBLE_STRING, unchanged

Reading never raises. The result is a value or None, and the rules that the text breaks.
"""

from __future__ import annotations

import re
import struct
from typing import Generic, NamedTuple, TypeVar

from barewire.canopen.datatypes import BY_NAME, DAY, TimeCodec, TimeDifference, TimeOfDay, object_codec
from barewire.codecs import Number, Value
from barewire.errors import DecodeError, EncodeError


class Formula(NamedTuple):
    """A number that depends on the node-ID.

    >>> str(Formula(0x200)), Formula(0x200).at(5) == 0x205
    ('$NODEID+0x200', True)
    """

    offset: int

    def at(self, node: int) -> int:
        """Return the number for a node."""
        return self.offset + node

    def __str__(self) -> str:
        # The sum is optional [CiA 306 4.3], but some readers find no number without it.
        return f"$NODEID+0x{self.offset:X}"


Expression = Value | Formula


Read = TypeVar("Read")


class EdsReading(NamedTuple, Generic[Read]):
    """The value of a text, None without one, and the rules that the text breaks."""

    value: Read | None
    rules: tuple[str, ...] = ()


_LONGEST = 64  # digits; no data type needs more, and int() is slow where there are thousands
_HEX = re.compile(r"0[xX]([0-9A-Fa-f]+)")
_DECIMAL = re.compile(r"[0-9]+")
_SUFFIXED = re.compile(r"(?:0[xX])?([0-9A-Fa-f]+)[hH]|(0[xX][0-9A-Fa-f]+|[0-9]+)[uUlL]{1,3}")
_BARE_HEX = re.compile(r"(?!0[bB])[0-9A-Fa-f]+")
_POWER_OF_TEN = re.compile(r"[0-9]+[eE][0-9]+")  # it would be hexadecimal digits too
_HEX_DIGITS = re.compile(r"[0-9A-Fa-f]+")
_REAL = re.compile(r"(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_WHOLE_REAL = re.compile(r"([0-9]+)[.,]0*")  # no exponent: 1e3 may be meant as 1E3h
_SPECIAL = re.compile(r"[+-]?(?:inf|nan|infinity)", re.I)
_DAYS = re.compile(r"([0-9]{1,4}) ([0-9]{1,8})")  # days and milliseconds, as some tools write a time
_WORDS = {"true": 1, "yes": 1, "false": 0, "no": 0}


def read_integer(text: str) -> EdsReading[int]:
    """Read an integer in any accepted notation.

    >>> read_integer("0x1F"), read_integer("001"), read_integer("soon")
    (EdsReading(value=31, rules=()), EdsReading(value=1, rules=()), EdsReading(value=None, rules=('bad-number',)))

    A leading zero makes a number octal [CiA 306 4.3]. Few authors intend that, so it is reported if it matters.

    >>> read_integer("012"), read_integer("08")
    (EdsReading(value=10, rules=('leading-zeros',)), EdsReading(value=8, rules=('leading-zeros',)))
    """
    plain, rules = _strip_syntax(text)
    if not plain:
        return EdsReading(None, (*rules, "empty"))
    sign = -1 if plain[0] == "-" else 1
    digits = plain[1:] if plain[0] in "+-" else plain
    if len(digits) > _LONGEST:
        return EdsReading(None, (*rules, "bad-number"))
    number = _unsigned(digits)
    if number is None:  # words: their blanks and quotes are not reported
        return EdsReading(None, (*(rule for rule in rules if rule.endswith("comment")), "bad-number"))
    value, rule = number
    if plain[0] == "+" or (sign < 0 and _HEX.fullmatch(digits)):
        rules.append("number-form")
    if rule:
        rules.append(rule)
    return EdsReading(sign * value, tuple(rules))


def _unsigned(digits: str) -> tuple[int, str] | None:
    """Return a number, and the rule that its notation breaks; None if it is no number."""
    if match := _HEX.fullmatch(digits):
        return int(match[1], 16), ""
    if _DECIMAL.fullmatch(digits):
        is_octal = digits[0] == "0" and not {"8", "9"} & set(digits)
        value = int(digits, 8 if is_octal else 10)
        is_doubtful = digits[0] == "0" and digits != "0" and (not is_octal or value != int(digits))
        return value, "leading-zeros" if is_doubtful else ""
    if match := _SUFFIXED.fullmatch(digits):
        return int(match[1], 16) if match[1] else int(
            match[2], 16 if match[2][:2].lower() == "0x" else 10
        ), "number-form"
    if digits.casefold() in _WORDS:
        return _WORDS[digits.casefold()], "number-form"
    if _BARE_HEX.fullmatch(digits) and not _POWER_OF_TEN.fullmatch(digits):
        return int(digits, 16), "number-form"
    if match := _WHOLE_REAL.fullmatch(digits):
        return int(match[1]), "decimal-comma" if "," in digits else "real-for-integer"
    return None


def _strip_syntax(text: str) -> tuple[str, list[str]]:
    """Return the text of a number without comment, quotes and inner blanks, and the rules that these break."""
    plain, rules = strip_comment(text.strip())
    if len(plain) > 1 and plain[0] == plain[-1] and plain[0] in "\"'":
        plain = plain[1:-1].strip()
        rules.append("quoted")
    if len(plain.split()) > 1:
        plain = "".join(plain.split())
        rules.append("blanks-in-number")
    return plain, rules


def strip_comment(text: str) -> tuple[str, list[str]]:
    """Return the text before a comment, of CiA 306 or of a programming language, and the rule it breaks.

    >>> strip_comment("0x07 # VAR"), strip_comment("5;rpm")
    (('0x07', ['foreign-comment']), ('5', ['inline-comment']))
    """
    marks = ((text.index(mark), mark) for mark in (";", "#", "//") if mark in text)
    position, mark = min(marks, default=(len(text), ""))
    rules = ["inline-comment"] if mark == ";" else ["foreign-comment"] if mark else []
    return text[:position].rstrip(), rules


def read_expression(text: str) -> EdsReading[Expression]:
    """Read an integer or a formula.

    >>> read_expression("0x200 + $NODEID").value
    Formula(offset=512)
    """
    if "nodeid" not in text.casefold():
        return EdsReading(*read_integer(text))
    bare, rules = strip_comment(text)
    terms = [term.strip() for term in bare.split("+")]
    nodes = [term for term in terms if term.casefold() in ("$nodeid", "nodeid")]
    numbers = [read_integer(term) for term in terms if term not in nodes]
    if len(nodes) != 1 or any(number.value is None or number.value < 0 for number in numbers):
        return EdsReading(None, (*rules, "bad-formula"))
    if terms[0] != "$NODEID":
        rules.append("formula-form")
    for number in numbers:
        rules += number.rules
    return EdsReading(Formula(sum(number.value or 0 for number in numbers)), tuple(rules))


def read_value(text: str, type: str) -> EdsReading[Expression]:
    """Read a value of a data type. An empty text has no value, and breaks no rule.

    >>> read_value("0xFFFE", "i16").value, read_value("1,5", "f32"), read_value("01 02", "octets").value
    (-2, EdsReading(value=1.5, rules=('decimal-comma',)), b'\\x01\\x02')
    """
    if type in ("string", "unicode"):
        bare, rules = (text[1:-1], ("quoted",)) if _is_quoted(text) else (text, ())
        if type == "unicode" or all(ord(character) < 0x100 for character in bare):
            return EdsReading(bare, rules)
        # A VISIBLE_STRING is bytes: those of the UTF-8 encoding, each as one character.
        return EdsReading(bare.encode("utf-8", "surrogatepass").decode("latin-1"), (*rules, "bad-text"))
    if not text.strip():
        return EdsReading(None)
    if type in ("octets", "domain"):
        return _octets(text)
    if type in ("f32", "f64"):
        return _real(text, type)
    if type in ("time_of_day", "time_difference") and (match := _DAYS.fullmatch(text.strip())):
        total = int(match[1]) * DAY + int(match[2])
        return EdsReading(TimeOfDay(total) if type == "time_of_day" else TimeDifference(total), ("number-form",))
    return _integer_of_type(read_expression(text), type, text)


def _is_quoted(text: str) -> bool:
    return len(text) > 1 and text[0] == text[-1] == '"'


def _octets(text: str) -> EdsReading[Expression]:
    plain = text.strip()
    digits = "".join((plain[2:] if plain[:2] in ("0x", "0X") else plain).split())
    if not _HEX_DIGITS.fullmatch(digits):
        return EdsReading(text.encode("latin-1", "replace"), ("bad-hex",))
    odd = len(digits) % 2
    return EdsReading(bytes.fromhex("0" * odd + digits), () if digits == plain and not odd else ("hex-form",))


def _real(text: str, type: str) -> EdsReading[Expression]:
    plain, rules = _strip_syntax(text)
    digits = plain.lstrip("+-") if plain.count("+") + plain.count("-") <= 1 else plain
    if _HEX.fullmatch(digits) and len(digits) <= _LONGEST:
        bits = int(digits, 16)
        if bits >> BY_NAME[type].bits or plain[0] == "-":
            return EdsReading(None, (*rules, "out-of-range"))
        form = "f" if type == "f32" else "d"
        (value,) = struct.unpack(f">{form}", bits.to_bytes(BY_NAME[type].bits // 8, "big"))
        return EdsReading(value, tuple(rules))
    bare = plain.rstrip("fF") if _REAL.fullmatch(plain.rstrip("fF").lstrip("+-")) else plain
    if not (_REAL.fullmatch(bare.lstrip("+-")) or _SPECIAL.fullmatch(bare)) or len(bare) > _LONGEST:
        return EdsReading(None, (*rules, "bad-number"))
    if bare != plain or _SPECIAL.fullmatch(bare):
        rules.append("number-form")
    if "," in bare:
        rules.append("decimal-comma")
    try:
        value = float(bare.replace(",", "."))
        object_codec(type).encode(value)
    except EncodeError:
        return EdsReading(None, (*rules, "out-of-range"))
    except ValueError:
        return EdsReading(None, (*rules, "bad-number"))
    return EdsReading(value, tuple(rules))


def _integer_of_type(reading: EdsReading[Expression], type: str, text: str) -> EdsReading[Expression]:
    """Check the range of a number or formula; a negative number may be written as its unsigned pattern."""
    value, rules = reading
    if value is None or "bad-number" in rules:
        return EdsReading(None, rules)
    codec, number = object_codec(type), int(value.offset if isinstance(value, Formula) else value)
    if isinstance(codec, TimeCodec):
        try:
            return EdsReading(codec.decode(number.to_bytes(codec.size, "little")), rules)
        except (OverflowError, DecodeError):
            return EdsReading(None, (*rules, "out-of-range"))
    low, high = (int(codec.minimum), int(codec.maximum)) if isinstance(codec, Number) else (0, 1)
    if type[0] == "i" and isinstance(value, int) and high < number <= 2 * high + 1:
        decimal = not any(mark in text.casefold() for mark in "xabcdefh")
        return EdsReading(number - 2 * (high + 1), (*rules, "unsigned-decimal") if decimal else rules)
    if not low <= number <= high:
        return EdsReading(None, (*rules, "out-of-range"))
    return EdsReading(bool(number), rules) if type == "bool" else reading


def write_value(value: Expression, type: str, like: str = "") -> str:
    """Write a value as text, in the notation of `like`, the text that it replaces.

    >>> write_value(10, "u16"), write_value(10, "u16", like="0x0005"), write_value(-2, "i16", like="0xFFFF")
    ('10', '0x000A', '0xFFFE')

    Raise EncodeError if the type has no such value.
    """
    codec = object_codec(type)
    if isinstance(value, Formula):
        codec.encode(value.offset)
        return str(value)
    data = codec.encode(value)
    if type in ("string", "unicode"):
        written = str(codec.decode(data))
        if _is_quoted(written):
            raise EncodeError(f"{written} would be read back without its quotes")
        return written
    if type in ("octets", "domain"):
        return data.hex().upper()
    if like[:2].lower() == "0x" or isinstance(codec, TimeCodec):
        width = 2 * len(data) if type[0] == "f" or isinstance(codec, TimeCodec) else len(like) - 2
        return f"0x{int.from_bytes(data, 'little'):0{width}X}"
    if isinstance(value, float) and type[0] != "f":
        return str(int(value))
    return str(int(value)) if isinstance(value, bool) else str(value)
