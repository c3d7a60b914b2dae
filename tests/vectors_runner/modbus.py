"""pdu, exchange."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from barewire.modbus.exceptions import ModbusException
from barewire.modbus.messages.base import Message
from barewire.modbus.messages.registry import (
    decode_request,
    decode_response,
    measure_request,
    measure_response,
    request_class,
    response_class,
)
from tests.vectors_runner.common import Case, bits, octets, refuse, words


def from_json(name: str, value: Any) -> Any:
    """The value of a message field in the types of the library."""
    if name == "bits":
        return bits(value)
    if name == "registers":
        return words(value)
    if name in ("data", "events"):
        return octets(value)
    if name in ("index", "abort_code"):
        return int(value, 16)
    if name == "places":
        return tuple((one["file"], one["record"], one["length"]) for one in value)
    if name == "records":
        return tuple(
            words(one) if isinstance(one, str) else (one["file"], one["record"], words(one["registers"]))
            for one in value
        )
    if name == "objects":
        return tuple((one["id"], octets(one["value"])) for one in value)
    return value


def build(case: Case) -> Message:
    """The message that the case describes."""
    code = octets(case["function"]) if "function" in case else octets(case["pdu"])[:2]
    code = b"\x2b\x0e" if code == b"\x2b" else code
    made = request_class(code) if case["side"] == "request" else response_class(code)
    assert made is not None, f"no message class for function {code.hex()}"
    fields = {name: from_json(name, value) for name, value in case["message"].items()}
    return made(**fields)


def assert_fields(message: Message, fields: dict[str, Any]) -> None:
    """Assert that the decoded message has the fields of the case; `bits` may have padding, which must be zero."""
    for name, value in fields.items():
        wanted, found = from_json(name, value), getattr(message, name)
        if name == "bits":
            assert found[: len(wanted)] == wanted
            assert len(found) - len(wanted) < 8
            assert not any(found[len(wanted) :])
        else:
            assert found == wanted, name


def assert_measured(measure: Callable[[bytes], int | None], pdu: bytes) -> None:
    """Assert that `measure`, given the start of a PDU, asks for more bytes until it has all, never for too many."""
    have = 1
    while (wanted := measure(pdu[:have])) is not None and wanted > have:
        assert wanted <= len(pdu)
        have = wanted
    assert wanted == len(pdu)


def pdu(case: Case) -> None:
    """One message: fields and bytes."""
    request = case["side"] == "request"

    def decode() -> Message:
        return decode_request(octets(case["pdu"])) if request else decode_response(octets(case["pdu"]))

    if case["result"] == "invalid":
        refuse(case, encode=lambda: build(case).encode(), wire=None, decode=decode, value=None)
        return
    assert_fields(decode(), case["message"])
    if "uncountable" not in case.get("flags", ()):
        assert_measured(measure_request if request else measure_response, octets(case["pdu"]))
    if case["result"] == "valid":
        assert build(case).encode() == octets(case["pdu"])
    else:
        assert build(case).encode() != octets(case["pdu"])


def exchange(case: Case) -> None:
    """A request and its response."""
    request = decode_request(octets(case["request"]))

    def read() -> Message:
        return request.read_response(octets(case["response"]))  # type: ignore[no-any-return]

    if case["result"] == "invalid":
        refuse(case, encode=request.encode, wire=None, decode=read, value=None)
    elif "exception_code" in case:
        with pytest.raises(ModbusException) as caught:
            read()
        assert caught.value.code == case["exception_code"]
    else:
        message = read()
        assert_fields(message, case["message"])
        if "bits" in case["message"]:
            assert message.bits == bits(case["message"]["bits"])  # type: ignore[attr-defined]
