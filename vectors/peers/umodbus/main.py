"""uModbus as an adapter: its functions, its checksum, and the frames of its two clients."""

from __future__ import annotations

from typing import Any

from adapter import NotOffered, bits, bitted, checksums, hexed, octets, serve, worded, words
from adapter_client import ExceptionAnswer, given
from client_line import NAMES, needs, over_time
from umodbus import functions
from umodbus.client import tcp
from umodbus.client.serial import rtu
from umodbus.client.serial.redundancy_check import add_crc, get_crc, validate_crc
from umodbus.exceptions import ModbusError


def kind_of(code: int) -> Any:
    """Return the class of a function."""
    found = functions.function_code_to_function_map.get(code)
    if found is None:
        raise NotOffered("uModbus has no such function")
    return found


def encode_pdu(question: dict[str, Any]) -> dict[str, Any]:
    code, message = octets(question["function"])[0], question["message"]
    function = kind_of(code)()
    if code <= 4 and question["side"] == "response":
        values = bits(message["bits"]) if code <= 2 else words(message["registers"])
        function.quantity = len(values)
        return {"pdu": hexed(function.create_response_pdu(values))}
    if code <= 4:
        function.starting_address, function.quantity = message["address"], message["quantity"]
    elif code <= 6:
        function.address, function.value = message["address"], message["value"]
    elif question["side"] == "request":
        function.starting_address = message["address"]
        function.values = bits(message["bits"]) if code == 15 else words(message["registers"])
    else:
        raise NotOffered("uModbus makes this response from its request")
    return {"pdu": hexed(function.request_pdu if question["side"] == "request" else function.create_response_pdu())}


def fields_of(function: Any, side: str) -> dict[str, Any]:
    """Return the fields of a function, read from a request or from a response."""
    code = function.function_code
    if code <= 4 and side == "request":
        return {"address": function.starting_address, "quantity": function.quantity}
    if code <= 4:
        return {"bits": bitted(function.data)} if code <= 2 else {"registers": worded(function.data)}
    if code <= 6:
        value = function.value if side == "request" else function.data
        return {"address": function.address, "value": {0: False, 1: True}.get(value, value) if code == 5 else value}
    if side == "request":
        values = {"bits": bitted(function.values)} if code == 15 else {"registers": worded(function.values)}
        return {"address": function.starting_address, **values}
    return {"address": function.starting_address, "quantity": function.data}


def decode_pdu(question: dict[str, Any]) -> dict[str, Any]:
    pdu = octets(question["pdu"])
    if not pdu:
        raise NotOffered("uModbus looks up the class by the first byte")
    kind = kind_of(pdu[0])
    if question["side"] == "request":
        return {"function": hexed(pdu[:1]), "message": fields_of(kind.create_from_request_pdu(pdu), "request")}
    if pdu[0] <= 4:
        raise NotOffered("uModbus needs the request for this")
    return {"function": hexed(pdu[:1]), "message": fields_of(kind.create_from_response_pdu(pdu), "response")}


def exchange(question: dict[str, Any]) -> dict[str, Any]:
    request, response = octets(question["request"]), octets(question["response"])
    kind_of(request[0])
    try:
        functions.pdu_to_function_code_or_raise_error(response)
        function = functions.create_function_from_response_pdu(response, request)
    except ModbusError as error:
        return {"exception_code": error.error_code}
    return {"message": fields_of(function, "response")}


def connect(line: Any, patches: Any) -> Any:
    """Return the function that asks."""
    needs(line, "rtu", "tcp")
    library = rtu if line.is_serial else tcp

    def ask(unit: int, code: int, fields: dict[str, Any]) -> Any:
        if unit == 0 and line.is_serial:
            raise NotOffered("no broadcasts")
        adu = getattr(library, NAMES[code])(unit, *given(code, fields))
        try:
            return library.send_message(adu, line)
        except ModbusError as error:
            raise ExceptionAnswer(error.error_code) from None

    return ask


def encode_rtu(question: dict[str, Any]) -> dict[str, Any]:
    return {"frame": hexed(add_crc(bytes([question["unit"]]) + octets(question["pdu"])))}


def decode_rtu(question: dict[str, Any]) -> dict[str, Any]:
    frame = octets(question["frame"])
    validate_crc(frame)
    return {"unit": frame[0], "pdu": hexed(frame[1:-2])}


serve(
    "uModbus",
    {
        "pdu": {"encode": encode_pdu, "decode": decode_pdu},
        "exchange": {"decode": exchange},
        **over_time(connect),
        **checksums(get_crc),
        "rtu-frame": {"encode": encode_rtu, "decode": decode_rtu},
    },
)
