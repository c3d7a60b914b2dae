"""Shared by all kinds: hexadecimal texts, and the meaning of valid, invalid and acceptable."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import pytest

from barewire.errors import DecodeError, EncodeError

Case: TypeAlias = dict[str, Any]


def octets(text: str) -> bytes:
    """'01 04' -> the two bytes."""
    return bytes.fromhex(text)


def words(text: str) -> tuple[int, ...]:
    """'022B 0000' -> the two register values."""
    return tuple(int(word, 16) for word in text.split())


def bits(text: str) -> tuple[bool, ...]:
    """'10110011 10' -> ten bits, the first one first."""
    return tuple(place == "1" for place in text.replace(" ", ""))


def whole_or_float(text: str) -> int | float:
    """A value as the vectors write it: text, because JSON numbers lose digits."""
    try:
        return int(text)
    except ValueError:
        return float(text)


def check(
    case: Case,
    *,
    encode: Callable[[], object],
    wire: object,
    decode: Callable[[], object],
    value: object,
) -> None:
    """Check both directions of a case. `wire` is its encoded form, `value` its decoded one.

    acceptable    decoding must give the value; with the flag `tolerant`, encoding must give something else
    """
    if case["result"] == "invalid":
        refuse(case, encode=encode, wire=wire, decode=decode, value=value)
        return
    assert decode() == value
    if case["result"] == "valid":
        assert encode() == wire
    elif "tolerant" in case.get("flags", ()):
        assert encode() != wire


def refuse(
    case: Case, *, encode: Callable[[], object], wire: object, decode: Callable[[], object], value: object
) -> None:
    """Check that an invalid case fails as its `fails` states: in encode, in decode, or when both are compared."""
    if case["fails"] == "encode":
        assert case["reason"] == "value", "fields that cannot be encoded have the reason value"
        with pytest.raises(EncodeError):
            encode()
    elif case["fails"] == "decode":
        with pytest.raises(DecodeError) as caught:
            decode()
        assert caught.value.reason == case["reason"], str(caught.value)
    else:
        assert case["reason"] in ("mismatch", "checksum"), "each half is well formed, so no other reason is possible"
        assert decode() != value
        assert encode() != wire
