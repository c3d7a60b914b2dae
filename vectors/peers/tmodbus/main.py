"""tmodbus as an adapter (Python 3.12 and later): its messages, ASCII frames, checksums, numbers in registers."""

from __future__ import annotations

from typing import Any

import tmodbus.pdu as pdus
from adapter import (
    FIELDS,
    NotOffered,
    Refused,
    bits,
    bitted,
    checksums,
    hexed,
    number,
    octets,
    register_bytes,
    registers,
    serve,
    worded,
    words,
)
from tmodbus.pdu.device import ReadDeviceIdentificationResponse
from tmodbus.pdu.file import FileRecord, FileRecordRequest
from tmodbus.pdu.serial_line import CommEventCounterResponse, CommEventLogResponse
from tmodbus.transport.async_ascii import build_ascii_frame, decode_ascii_frame, validate_ascii_frame
from tmodbus.transport.async_rtu import (
    BITS_PER_CHAR,
    compute_interframe_delay,
    compute_max_continuous_transmission_delay,
)
from tmodbus.utils.crc import calculate_crc16
from tmodbus.utils.lrc import calculate_lrc
from tmodbus.utils.order_aware_struct import OrderAwareStruct
from tmodbus_client import client

LETTERS = {"u16": "H", "i16": "h", "u32": "I", "i32": "i", "u64": "Q", "i64": "q", "f32": "f", "f64": "d"}
ORDERS = {"ABCD": ("big", "big"), "BADC": ("big", "little"), "CDAB": ("little", "big"), "DCBA": ("little", "little")}


def class_of(pdu: bytes) -> Any:
    """Return the class of a message by its first bytes."""
    if not pdu:
        raise NotOffered("tmodbus looks up the class by the first byte")
    try:
        if pdus.is_function_code_for_subfunction_pdu(pdu[0]):
            width = pdus.get_subfunction_code_length(pdu[0])
            return pdus.get_subfunction_pdu_class(pdu[0], int.from_bytes(pdu[1 : 1 + width], "big"))
        return pdus.get_pdu_class(pdu[0])
    except ValueError as error:
        raise NotOffered(str(error)) from None


def data_of(text: str) -> bytes:
    """Return the bytes of registers."""
    return octets(register_bytes(words(text)))


TO: dict[str, Any] = {
    "bits": bits,
    "registers": words,
    "places": lambda rows: [FileRecordRequest(row["file"], row["record"], row["length"]) for row in rows],
    "records": lambda rows: [FileRecord(row["file"], row["record"], data_of(row["registers"])) for row in rows],
}
"""Values of fields as the library takes them, in the order of FIELDS."""


def made(code: int, kind: Any, message: dict[str, Any]) -> Any:
    """Return the request with these fields."""
    if code != 8:
        return kind(*(TO.get(name, lambda value: value)(message[name]) for name in FIELDS.get(code, ())))
    data, sub_function = octets(message["data"]), message["sub_function"]
    if sub_function == 0:
        return kind(data)
    if sub_function in (1, 3):
        return kind({1: data == b"\xff\x00", 3: data[0] if data else 0}[sub_function])
    if data != bytes(2):
        raise NotOffered("the data of a request are always zero")
    return kind()


def encode_pdu(question: dict[str, Any]) -> dict[str, Any]:
    code, message = octets(question["function"]), question["message"]
    if code[0] == 8:
        code += message["sub_function"].to_bytes(2, "big")
    kind = class_of(code)
    if question["side"] == "request":
        return {"pdu": hexed(made(code[0], kind, message).encode_request())}
    match code[0]:
        case 1 | 2:
            values: Any = bits(message["bits"])
            request = kind(0, len(values))
        case 3 | 4:
            values = words(message["registers"])
            request = kind(0, len(values))
        case 5 | 6:
            values, request = message["value"], kind(message["address"], message["value"])
        case 7:
            values, request = message["status"], kind()
        case 0x0B:
            values, request = CommEventCounterResponse(message["status"], message["event_count"]), kind()
        case 0x0C:
            counts = message["status"], message["event_count"], message["message_count"]
            values, request = CommEventLogResponse(*counts, octets(message["events"])), kind()
        case 0x15:
            request = made(0x15, kind, message)
            values = list(request.file_records)
        case 0x16:
            request = made(0x16, kind, message)
            values = message["and_mask"], message["or_mask"]
        case 0x17:
            values = words(message["registers"])
            request = kind(0, len(values), 0, [0])
        case 0x18:
            values, request = words(message["registers"]), kind(0)
        case 0x2B:
            found = {row["id"]: octets(row["value"]) for row in message["objects"]}
            head = message["read_code"], message["conformity"], message["more_follows"], message["next_object"]
            values = ReadDeviceIdentificationResponse(*head, len(found), found)
            request = kind(message["read_code"], 0)
        case _:
            raise NotOffered("tmodbus makes this response from its request")
    return {"pdu": hexed(request.encode_response(values))}


ATTRIBUTES = {
    **{"address": ("start_address", "address"), "bits": ("values",), "registers": ("write_values", "values")},
    **{"read_address": ("read_start_address",), "write_address": ("write_start_address",)},
    **{"places": ("requests",), "records": ("file_records",), "read_code": ("read_device_id_code",)},
}
"""The names of fields in the library, where they have other ones."""


def places(rows: Any) -> list[dict[str, Any]]:
    return [{"file": row.file_number, "record": row.record_number, "length": row.record_length} for row in rows]


def fields_of(code: int, found: Any) -> dict[str, Any]:
    """Return the fields of a request."""
    if code == 8:
        raise NotOffered("tmodbus does not keep the data of a diagnostic request")
    shown = {"bits": bitted, "registers": worded, "places": places, "records": records}
    values = {
        name: next(getattr(found, one) for one in ATTRIBUTES.get(name, (name,)) if hasattr(found, one))
        for name in FIELDS.get(code, ())
    }
    return {name: shown.get(name, lambda value: value)(value) for name, value in values.items()}


def records(rows: Any) -> list[dict[str, Any]]:
    return [
        {"file": row.file_number, "record": row.record_number, "registers": worded(registers(row.data))} for row in rows
    ]


def result_of(code: int, request: Any, value: Any) -> dict[str, Any]:
    """Return the fields of a response that answers a request; an echo has those of the request."""
    match code:
        case 1 | 2:
            return {"bits": bitted(value)}
        case 3 | 4 | 0x17 | 0x18:
            return {"registers": worded(value)}
        case 7:
            return {"status": value}
        case 0x0B:
            return {"status": value.status, "event_count": value.event_count}
        case 0x0C:
            counts = {"status": value.status, "event_count": value.event_count, "message_count": value.message_count}
            return {**counts, "events": hexed(value.events)}
        case 0x0F | 0x10:
            return {"address": request.start_address, "quantity": value}
        case 0x11:
            return {"data": hexed(value.server_id + bytes([255 * value.run_indicator_status]) + value.additional_data)}
        case 0x14:
            return {"records": [worded(registers(row)) for row in value]}
        case 0x15:
            return {"records": records(value)}
        case 0x2B:
            head = {"read_code": value.device_id_code, "conformity": int(value.conformity_level)}
            head |= {"more_follows": value.more, "next_object": value.next_object_id}
            return {**head, "objects": [{"id": name, "value": hexed(data)} for name, data in value.objects.items()]}
        case 0x08:
            raise NotOffered("tmodbus does not keep the data of a diagnostic response")
    return fields_of(code, request)


def decode_pdu(question: dict[str, Any]) -> dict[str, Any]:
    pdu = octets(question["pdu"])
    kind = class_of(pdu)
    if question["side"] == "request":
        message = fields_of(pdu[0], kind.decode_request(pdu))
    elif pdu[0] in (7, 0x0B, 0x0C, 0x11):
        message = result_of(pdu[0], kind(), kind().decode_response(pdu))
    elif pdu[0] == 0x18:
        message = result_of(pdu[0], None, kind(0).decode_response(pdu))
    elif pdu[0] == 0x2B:
        message = result_of(pdu[0], None, kind(pdu[2] if len(pdu) > 2 else 1, 0).decode_response(pdu))
    else:
        raise NotOffered("tmodbus needs the request for this")
    return {"function": hexed(pdu[: 2 if pdu[0] == 0x2B else 1]), "message": message}


def exchange(question: dict[str, Any]) -> dict[str, Any]:
    request, response = octets(question["request"]), octets(question["response"])
    asked = class_of(request).decode_request(request)
    if response[0] & 0x80:
        raise NotOffered("tmodbus reads exceptions in its transports")
    if request[0] == 0x08:
        return {"message": diagnostic(int.from_bytes(request[1:3], "big"), asked.decode_response(response))}
    return {"message": result_of(request[0], asked, asked.decode_response(response))}


def diagnostic(sub_function: int, value: Any) -> dict[str, Any]:
    """Return the fields of a response of function 08: bytes, a counter, a delimiter, a choice, or nothing."""
    if isinstance(value, bool):
        value = b"\xff\x00" if value else b"\x00\x00"
    elif isinstance(value, int):
        value = bytes([value, 0]) if sub_function == 0x03 else value.to_bytes(2, "big")
    return {"sub_function": sub_function, "data": hexed(value or bytes(2))}


def encode_ascii(question: dict[str, Any]) -> dict[str, Any]:
    return {"text": build_ascii_frame(question["unit"], octets(question["pdu"])).decode("latin-1")}


def decode_ascii(question: dict[str, Any]) -> dict[str, Any]:
    raw = decode_ascii_frame(question["text"].encode("latin-1"))
    if not validate_ascii_frame(raw):
        raise Refused("LRC")
    return {"unit": raw[0], "pdu": hexed(raw[1:-1])}


def timing(question: dict[str, Any]) -> dict[str, Any]:
    if question["bits"] != BITS_PER_CHAR or question["baud"] < 1:
        raise NotOffered("its characters have 11 bits, and its serial port refuses speeds")
    character = BITS_PER_CHAR / question["baud"]
    times = {"t15_ns": compute_max_continuous_transmission_delay(character)}
    times |= {"character_ns": character, "t35_ns": compute_interframe_delay(character)}
    return {name: round(time * 1e9) for name, time in times.items()}


def layout(question: dict[str, Any]) -> OrderAwareStruct:
    """Return their structure for a number."""
    if question["type"] not in LETTERS:
        raise NotOffered("tmodbus has the numbers of struct")
    return OrderAwareStruct(">" + LETTERS[question["type"]], *ORDERS[question["order"]])  # type: ignore[arg-type]


def encode_number(question: dict[str, Any]) -> dict[str, Any]:
    return {"bytes": hexed(layout(question).pack(number(question["value"])))}


def decode_number(question: dict[str, Any]) -> dict[str, Any]:
    return {"value": str(layout(question).unpack(octets(question["bytes"]))[0])}


serve(
    "tmodbus",
    {
        "pdu": {"encode": encode_pdu, "decode": decode_pdu},
        "exchange": {"decode": exchange},
        "client": {"run": client(class_of)},
        "rtu-timing": {"encode": timing},
        "ascii-frame": {"encode": encode_ascii, "decode": decode_ascii},
        **checksums(calculate_crc16, calculate_lrc),
        "number": {"encode": encode_number, "decode": decode_number},
    },
)
