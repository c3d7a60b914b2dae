"""Whether an answer has what a case expects."""

from __future__ import annotations

import math
import re
import struct
from decimal import Decimal
from typing import Any

from patterns import fits_frame

HEX = re.compile("[0-9A-Fa-f ]*")
NUMBER = re.compile(r"[+-]?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]{1,4})?")
NAMED = re.compile("[+-]?(inf|nan)", re.IGNORECASE)
ANY_ORDER = ("device", "gateway-309-3")
MISSING: Any = object()
Fields = dict[str, Any]


def form(value: Any) -> str:
    return "number" if type(value) in (int, float) else type(value).__name__


def equal(wanted: Any, answered: Any, name: str, type_: str, question: Fields) -> bool:
    """Whether an answer has what is wanted. `name` is that of the field, `type_` that of a number in it."""
    if isinstance(wanted, dict):
        if "one_of" in wanted:
            return any(equal(one, answered, name, type_, question) for one in wanted["one_of"])
        if wanted.keys() == {"from", "to"}:
            is_between = form(answered) == "number" and wanted["from"] <= answered <= wanted["to"]
            return is_between and answered == int(answered)
        return isinstance(answered, dict) and all(
            is_padded(key, value, answered.get(key), question)
            or equal(value, answered.get(key, MISSING), key, type_, question)
            for key, value in wanted.items()
        )
    if isinstance(wanted, list):
        if not isinstance(answered, list) or len(answered) != len(wanted):
            return False
        if question["kind"] in ANY_ORDER:
            wanted, answered = by_identifier(wanted), by_identifier(answered)
        entries = question["entries"] if question["kind"] == "pdo" else []
        types = [entry["type"] or "" for entry in entries] + [type_] * (len(wanted) - len(entries))
        return all(equal(one, other, name, type_, question) for one, other, type_ in zip(wanted, answered, types))
    if not isinstance(wanted, str) or not isinstance(answered, str):
        return form(wanted) == form(answered) and bool(wanted == answered)
    if question["kind"] == "device" and ".." in wanted:
        return fits_frame(wanted, answered)
    if wanted == answered or (name == "value" and same_number(wanted, answered, type_)):
        return True
    return HEX.fullmatch(wanted) is not None and digits(wanted) == digits(answered)


def digits(text: str) -> str:
    return text.replace(" ", "").upper()


def by_identifier(items: list[Any]) -> list[Any]:
    """Return frames in the order of their identifiers, those of one identifier as they came; other lists unchanged."""
    choices = [item.get("one_of") if isinstance(item, dict) else None for item in items]
    frames = [one_of[0] if isinstance(one_of, list) and one_of else item for item, one_of in zip(items, choices)]
    if not all(isinstance(frame, str) and "#" in frame for frame in frames):
        return items
    return [items[place] for place in sorted(range(len(items)), key=lambda place: frames[place].partition("#")[0])]


def is_padded(name: str, wanted: Any, answered: Any, question: Fields) -> bool:
    """Whether bits of a response that was decoded without its request have up to seven more, all zero."""
    is_response = name == "bits" and question["kind"] == "pdu" and question["side"] == "response"
    if not is_response or not isinstance(wanted, str) or not isinstance(answered, str):
        return False
    short, long = wanted.replace(" ", ""), answered.replace(" ", "")
    return long.startswith(short) and re.fullmatch("0{0,7}", long[len(short) :]) is not None


def same_number(wanted: str, answered: str, type_: str) -> bool:
    """Whether two texts are the same number: of floating point the nearest one of that type, others exactly."""
    one, other = number(wanted, type_), number(answered, type_)
    return one is not None and one == other


def number(text: str, type_: str) -> Decimal | bytes | None:
    is_decimal = NUMBER.fullmatch(text) is not None
    if type_.startswith(("u", "i", "b")):
        return Decimal(text) if is_decimal else None
    if not type_.startswith("f") or (not is_decimal and not NAMED.fullmatch(text)):
        return None
    try:
        packed = struct.pack(">f" if type_ == "f32" else ">d", float(text))
    except OverflowError:
        return None
    return None if is_decimal and math.isinf(float(text)) else b"nan" if math.isnan(float(text)) else packed


def is_excluded(wanted: Any, answered: Any, question: Fields) -> bool:
    """Whether the answer is in a `never` of what is expected: wrong, whatever the standard leaves open."""
    if isinstance(wanted, dict) and "one_of" in wanted:
        return any(equal(one, answered, "", "", question) for one in wanted.get("never", ()))
    if isinstance(wanted, dict) and isinstance(answered, dict):
        return any(is_excluded(value, answered[key], question) for key, value in wanted.items() if key in answered)
    pairs = zip(wanted, answered) if isinstance(wanted, list) and isinstance(answered, list) else ()
    return any(is_excluded(one, other, question) for one, other in pairs)
