"""The fields that tshark finds in a Modbus packet, compared with those of `explain` for the same bytes."""

from __future__ import annotations

import subprocess
from pathlib import Path

from barewire.modbus.messages.identification import OBJECT_NAMES
from barewire.tcp import encode as tcp_frame
from barewire_workbench import explain

UNIT = 17

# Our name of a field -> tshark's. Fields that are not listed here are bytes in both.
NUMBERS = {
    "function_code": "func_code",
    "address": "reference_num",
    "read_address": "read_reference_num",
    "read_quantity": "read_word_cnt",
    "write_address": "write_reference_num",
    "write_quantity": "write_word_cnt",
    "fifo_count": "word_cnt",
    "event_count": "ev_count",
    "message_count": "ev_msg_count",
    "event": "event",
    "sub_function": "diagnostic_code",
    "and_mask": "and_mask",
    "or_mask": "or_mask",
    "exception_code": "exception_code",
    "mei_type": "mei",
    "read_code": "read_device_id",
    "object_id": "object_id",
    "conformity": "conformity_level",
    "more_follows": "more_follows",
    "next_object": "next_object_id",
    "number_of_objects": "num_objects",
    "object_length": "objects_len",
    "reference_type": "reference_type",
}
ALL = sorted(
    {f"modbus.{name}" for name in NUMBERS.values()}
    | {f"modbus.{name}" for name in ("word_cnt", "bit_cnt", "byte_cnt", "byte_cnt_16", "reference_num_32", "data")}
    | {f"modbus.{name}" for name in ("ev_status", "regval_uint16", "bitval", "request_frame")}
    | {f"modbus.{name}" for name in ("object_str_value", "object_value")}
    | {
        f"modbus.diagnostic.{name}"
        for name in (
            *("return_query_data.request", "return_query_data.echo", "restart_communication_option"),
            "ascii_input_delimiter",
            *("return_diag_register", "clear_ctr_diag_reg", "bus_message_count", "bus_comm_error_count"),
            *("bus_exception_error_count", "slave_message_count", "no_slave_response_count", "slave_nak_count"),
            *("slave_busy_count", "bus_char_overrun_count"),
        )
    }
)  # fmt: skip
RTU = ["mbrtu.unit_id", "mbrtu.crc16", "mbrtu.crc16.status"]
PAIRED = "modbus.request_frame"
"""In a response: the frame number of its request. tshark gives it for some functions only."""
TCP = ["mbtcp.unit_id", "mbtcp.trans_id", "mbtcp.prot_id", "mbtcp.len"]


def tshark(file: Path, fields: list[str], *options: str) -> list[dict[str, list[str]]]:
    """For each packet the fields that tshark found, each with all its values."""
    command = ["tshark", "-r", str(file), "-T", "fields", *options, "-E", "aggregator=|"]
    for field in fields:
        command += ["-e", field]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    rows = [line.split("\t") for line in done.stdout.splitlines()]
    return [{field: value.split("|") for field, value in zip(fields, row) if value} for row in rows]


def our_fields(pdu: bytes, role: str) -> tuple[dict[str, list[int]], int]:
    """Return our fields of a message under tshark's names and the number of their bytes, without the fields that are
    bytes."""
    covered = 0
    found: dict[str, list[int]] = {}
    code = pdu[0] & 0x7F
    groups: list[int] = []
    for field in explain("tcp", tcp_frame(UNIT, pdu), role).fields[4:]:
        value, name = field.value, field.name.replace(" ", "_")
        if name == "quantity":
            name = "bit_cnt" if code in (0x01, 0x02, 0x0F) else "word_cnt"
        elif name == "byte_count":
            name = "byte_cnt_16" if code == 0x18 else "" if code == 0x11 else "byte_cnt"
        elif name == "status" and code != 0x07:
            name = "ev_status"
        elif name == "length":
            name = "byte_cnt" if code == 0x14 and role == "response" else "word_cnt"
        elif name.startswith("register_") and code in (0x03, 0x04, 0x10):
            name = "regval_uint16"
        elif name in ("file", "record"):
            assert isinstance(value, int)
            groups.append(value)
            covered += field.length
            continue
        else:
            name = NUMBERS.get(name, "")
        if name:
            assert isinstance(value, int), field
            covered += field.length
            found.setdefault(f"modbus.{name}", []).append(value & 0x7F if name == "func_code" else value)
    if groups:
        found["modbus.reference_num_32"] = [file << 16 | record for file, record in zip(groups[::2], groups[1::2])]
    return found, covered


def assert_same_fields(pdu: bytes, role: str, theirs: dict[str, list[str]]) -> None:
    """Assert that tshark and `explain` find the same values in a message."""
    if pdu[:2] == b"\xab\xff":  # an exception with more bytes behind it: tshark does not dissect those
        assert (theirs["modbus.func_code"], theirs["modbus.exception_code"]) == (["43"], ["255"])
        return
    mine, covered = our_fields(pdu, role)
    numbers = {key: [int(value, 0) for value in theirs.get(key, [])] for key in mine}
    assert numbers == mine
    left = {key: values for key, values in theirs.items() if key not in mine and key.startswith("modbus.")}
    left.pop(PAIRED, None)
    code = pdu[0]
    if bits := left.pop("modbus.bitval", None):
        packed = int.from_bytes(pdu[2:], "little")
        assert bits == [str(packed >> place & 1) for place in range(len(bits))]
    texts, raw = left.pop("modbus.object_str_value", []), left.pop("modbus.object_value", [])
    if texts or raw:
        fields = explain("tcp", tcp_frame(UNIT, pdu), role).fields
        numbered = [field.value for field in fields if field.name == "object id"]
        values = [field.value for field in fields if field.name == "object value"]
        assert texts == [value for number, value in zip(numbered, values) if number in OBJECT_NAMES]
        # tshark gives objects specific to the device as bytes.
        own = [value for number, value in zip(numbered, values) if number not in OBJECT_NAMES]
        assert [bytes.fromhex(value).decode() for value in raw] == own
    if code == 0x08:
        ((key, (value,)),) = left.items()
        is_bytes = key == "modbus.data" or "query_data" in key
        data = pdu[3:4] if key.endswith("ascii_input_delimiter") else pdu[3:]
        assert (int(value, 16) if is_bytes else int(value, 0)) == int.from_bytes(data, "big")
    elif code == 0x14 and role == "response":
        assert [values[:8] for values in left["modbus.data"]] == ["0dfe0020", "33cd0040"]
    elif left:
        # The bytes that remain are the last ones of the message.
        ((key, (value,)),) = left.items()
        assert key == "modbus.data"
        twice = 1 if pdu[:2] == b"\x2b\x0d" else 0  # tshark gives the MEI type as a number, too
        assert bytes.fromhex(value) == pdu[covered - twice :]
    elif not bits and not texts and not raw:
        assert covered == len(pdu)
