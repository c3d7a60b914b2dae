"""Explained Modbus frames: valid, broken, and ambiguous ones."""

from __future__ import annotations

import json
from typing import Any

import pytest

from barewire import rtu, tcp
from barewire.modbus.messages import registry as functions
from barewire_workbench import ExplainedField, Explanation, FrameRole, explain
from barewire_workbench.frames.modbus import explain_ascii


def of_rtu(pdu: str, role: FrameRole | None = None, unit: int = 1) -> Explanation:
    return explain("rtu", rtu.encode(unit, bytes.fromhex(pdu)), role)


def field(explanation: Explanation, name: str) -> ExplainedField:
    (named,) = [field for field in explanation.fields if field.name == name]
    return named


def meanings(explanation: Explanation) -> dict[str, str]:
    return {field.name: field.meaning for field in explanation.fields}


def fault(explanation: Explanation) -> tuple[str, int]:
    assert explanation.error is not None
    return explanation.error.reason, explanation.error.at


# A valid and a broken frame ---------------------------------------------------------------------


def test_a_request_is_named_field_by_field() -> None:
    explanation = explain("rtu", bytes.fromhex("01040FB1000222F8"))
    assert (explanation.valid, explanation.role, explanation.error) == (True, "request", None)
    assert [(field.offset, field.length, field.name, field.hex, field.value) for field in explanation.fields] == [
        (0, 1, "unit", "01", 1),
        (1, 1, "function code", "04", 4),
        (2, 2, "address", "0F B1", 0x0FB1),
        (4, 2, "quantity", "00 02", 2),
        (6, 2, "CRC", "22 F8", 0xF822),
    ]
    assert meanings(explanation) == {
        "unit": "unit 1",
        "function code": "04 Read Input Registers",
        "address": "0-based; number 4018 in 1-based tables",
        "quantity": "input registers",
        "CRC": "CRC ok",
    }
    assert explanation.verdict == "valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok"


def test_a_wrong_crc_leaves_all_fields_explained() -> None:
    explanation = explain("rtu", bytes.fromhex("010404000001103BC3"), "response")
    assert (explanation.valid, explanation.role) == (False, "response")
    assert explanation.error == ("checksum", 7, "CRC is 3B C3, should be FB D8")
    assert [field.name for field in explanation.fields] == [
        *("unit", "function code", "byte count", "register 0", "register 1", "CRC"),
    ]
    assert field(explanation, "CRC").meaning == "CRC wrong, should be FB D8"
    assert explanation.verdict == "not valid: CRC is 3B C3, should be FB D8 (byte 7)"


def test_the_dict_has_these_keys_and_is_json() -> None:
    explanation = explain("rtu", bytes.fromhex("018302C0F0"), "response").as_dict()
    assert list(explanation) == ["protocol", "valid", "role", "fields", "error", "diagnosis", "notes"]
    fields: Any = explanation["fields"]
    assert [list(field) for field in fields] == [["offset", "length", "name", "hex", "value", "meaning"]] * 4
    assert json.loads(json.dumps(explanation)) == explanation
    assert explanation["error"] == {"reason": "checksum", "at": 3, "text": "CRC is C0 F0, should be C0 F1"}
    assert explain("rtu", rtu.encode(1, b"\x07")).as_dict()["error"] is None


# Direction -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pdu", "role"),
    [
        ("04 0FB1 0002", "request"),
        ("04 04 0000 0110", "response"),
        ("01 01 05", "response"),
        ("0F 0013 000A 02 CD01", "request"),
        ("0F 0013 000A", "response"),
        ("07", "request"),
        ("07 6D", "response"),
        ("2B 0E 01 00", "request"),
        ("2B 0E 01 01 00 00 01 00 01 41", "response"),
        ("84 02", "response"),
        ("41 01 02", None),
    ],
)
def test_the_direction_is_guessed_from_the_shape(pdu: str, role: FrameRole | None) -> None:
    explanation = of_rtu(pdu)
    assert (explanation.role, explanation.valid) == (role, True)


@pytest.mark.parametrize("pdu", ["05 00AC FF00", "06 0001 0003", "01 03 00 00 08"])
def test_an_ambiguous_pdu_is_a_request_with_a_note(pdu: str) -> None:
    explanation = of_rtu(pdu)
    assert explanation.role == "request"
    assert explanation.verdict.endswith("(a response can look the same)")
    assert of_rtu(pdu, "response").role == "response"


@pytest.mark.parametrize(
    ("pdu", "role"), [("04 0FB1 0000", "request"), ("04 04 0000 0110 22", "response"), ("03 02 01", "response")]
)
def test_a_damaged_pdu_has_the_direction_nearer_in_length(pdu: str, role: FrameRole) -> None:
    explanation = of_rtu(pdu)
    assert (explanation.role, explanation.valid) == (role, False)


def test_a_given_role_is_used() -> None:
    explanation = of_rtu("04 0FB1 0002", "response")
    assert explanation.role == "response"
    assert fault(explanation) == ("length", 2)
    assert field(explanation, "byte count").meaning == "15 bytes announced, 3 follow"


def test_a_request_has_no_exception_bit() -> None:
    explanation = of_rtu("83 02", "request")
    assert fault(explanation) == ("function", 1)
    assert field(explanation, "exception code").meaning.startswith("illegal data address")


# What the fields mean --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "meaning"),
    [(0, "broadcast: all units, no answer"), (247, "unit 247"), (248, "unit 248: 248..255 are reserved")],
)
def test_units_on_a_serial_line(unit: int, meaning: str) -> None:
    assert meanings(of_rtu("04 0000 0001", unit=unit))["unit"] == meaning


def test_unit_255_on_tcp_is_the_server_itself() -> None:
    explanation = explain("tcp", tcp.encode(255, b"\x07", 5))
    assert meanings(explanation)["unit"] == "the server itself, no unit behind it"


@pytest.mark.parametrize(
    ("code", "meaning"),
    [
        ("41", "41 user-defined function"),
        ("6E", "6E user-defined function"),
        ("09", "09 reserved function"),
        ("63", "63 not a public function of the standard"),
    ],
)
def test_an_unknown_function_is_valid_and_its_data_are_bytes(code: str, meaning: str) -> None:
    explanation = of_rtu(f"{code} AA BB")
    assert explanation.valid
    assert field(explanation, "function code").meaning == meaning
    assert field(explanation, "data").hex == "AA BB"


def test_function_00_does_not_exist() -> None:
    for pdu in ("00 01", "80 01"):
        assert fault(of_rtu(pdu)) == ("function", 1)


def test_an_exception_is_explained_with_its_hint() -> None:
    explanation = of_rtu("83 02")
    assert field(explanation, "function code").meaning == "bit 7: exception to 03 Read Holding Registers"
    assert field(explanation, "exception code").meaning.startswith("illegal data address: ")
    assert "exception 02 (illegal data address) to 03 Read Holding Registers" in explanation.verdict
    assert field(of_rtu("83 63"), "exception code").meaning == "undefined exception code"


@pytest.mark.parametrize(
    ("pdu", "at"), [("03 0000 007E", 4), ("01 0000 07D1", 4), ("05 0000 1200", 4), ("10 0000 0000 00", 4)]
)
def test_a_forbidden_value_is_an_error_at_its_place(pdu: str, at: int) -> None:
    assert fault(of_rtu(pdu)) == ("value", at)


def test_registers_have_their_address_and_signed_value() -> None:
    explanation = of_rtu("10 0001 0002 04 000A FFFE")
    assert meanings(explanation)["register 0"] == "for address 0001h"
    assert meanings(explanation)["register 1"] == "for address 0002h, -2 if signed"


def test_identification_names_its_objects() -> None:
    explanation = of_rtu("2B 0E 01 01 FF 02 01 00 03 54 45 4D")
    assert field(explanation, "object value").value == "TEM"
    assert field(explanation, "object id").meaning == "VendorName"
    assert field(explanation, "more follows").meaning == "more follows"
    assert any("'TEM'" in line for line in explanation.lines())


# Broken frames ---------------------------------------------------------------------------------------------------


def test_a_cut_field_keeps_its_name() -> None:
    explanation = explain("tcp", tcp.encode(1, bytes.fromhex("030001007D"))[:9], "request")
    last = explanation.fields[-1]
    assert (last.name, last.value, last.meaning) == ("address", None, "cut short")


@pytest.mark.parametrize(
    ("frame", "role", "crc"),
    [
        ("01 03 0000 000A", "request", "C5 CD"),
        ("01 83 02", "response", "C0 F1"),
        ("01 03 02 0001", "response", "79 84"),
    ],
)
def test_a_frame_without_its_crc_is_explained_and_not_valid(frame: str, role: FrameRole, crc: str) -> None:
    explanation = explain("rtu", bytes.fromhex(frame))
    whole = explain("rtu", bytes.fromhex(frame + crc))
    assert (explanation.role, whole.role, explanation.valid, whole.valid) == (role, role, False, True)
    assert explanation.error is not None
    assert explanation.error.text.startswith(f"no CRC; with {crc} it is a {role} ")
    assert [field[2:] for field in explanation.fields[:-1]] == [field[2:] for field in whole.fields[:-1]]
    assert (explanation.fields[-1].length, explanation.fields[-1].meaning) == (0, f"is missing; it would be {crc}")


def test_an_ascii_frame_without_its_lrc_is_explained_and_not_valid() -> None:
    for typed in (b":01030000000A", b":01030000000A\r\n"):
        explanation = explain_ascii(typed, typed=True)
        assert explanation.error is not None
        assert (
            explanation.error.text == "no LRC; with F2 it is a request to unit 1, Read Holding Registers, 10 from 0000h"
        )
        assert field(explanation, "quantity").value == 10
        assert not explanation.valid


def test_characters_that_were_not_typed_are_not_counted() -> None:
    explanation = explain_ascii(b":", typed=True)
    assert explanation.error is not None
    assert explanation.error.text == "an ASCII frame has at least 9 characters, got 1 and no CR LF"


def test_a_crc_with_swapped_bytes_is_recognised() -> None:
    explanation = explain("rtu", bytes.fromhex("01040FB10002F822"))
    assert explanation.verdict == "not valid: CRC is F8 22, should be 22 F8: the low byte comes first (byte 6)"


def test_a_second_frame_after_the_first_is_left_over() -> None:
    first = bytes.fromhex("01040FB1000222F8")
    explanation = explain("rtu", first + bytes.fromhex("0104040000"))
    assert fault(explanation) == ("checksum", 8)
    assert (explanation.fields[-1].name, explanation.fields[-1].offset) == ("left over", 8)
    assert field(explanation, "CRC").meaning == "CRC ok"


def test_a_zero_after_a_correct_frame_is_found_although_the_crc_fits() -> None:
    frame = bytes.fromhex("01040FB1000222F8") + b"\x00"
    assert rtu.decode(frame).pdu == bytes.fromhex("040FB1000222")
    assert fault(explain("rtu", frame)) == ("long", 8)


@pytest.mark.parametrize(
    ("frame", "reason", "at"),
    [
        ("0007 0001 0006 01 03 0000 0001", "protocol", 2),
        ("0007 0000 0000 01 03 0000 0001", "length", 4),
        ("0007 0000 0007 01 03 0000 0001", "short", 12),
        ("0007 0000 0006 01 03 0000 0001 00", "long", 12),
        ("0007 0000", "short", 4),
        ("", "short", 0),
    ],
)
def test_the_header_of_tcp_is_checked(frame: str, reason: str, at: int) -> None:
    assert fault(explain("tcp", bytes.fromhex(frame))) == (reason, at)


def test_ascii_counts_characters_and_shows_them() -> None:
    explanation = explain("ascii", b":01040FB1000239\r\n")
    assert [(field.offset, field.length, field.name, field.hex) for field in explanation.fields] == [
        (0, 1, "start", ":"),
        (1, 2, "unit", "01"),
        (3, 2, "function code", "04"),
        (5, 4, "address", "0F B1"),
        (9, 4, "quantity", "00 02"),
        (13, 2, "LRC", "39"),
        (15, 2, "end", "CR LF"),
    ]
    assert explanation.verdict == "valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; LRC ok"


@pytest.mark.parametrize(
    ("frame", "reason", "at"),
    [
        (b":01040FB1000238\r\n", "checksum", 13),
        (b":01040FB1000239", "delimiter", 15),
        (b"01040FB1000239\r\n", "delimiter", 0),
        (b":01040FG1000239\r\n", "character", 7),
        (b":01040FB100023\r\n", "short", 14),
        (b":010400000000FB\r\n", "value", 9),
    ],
)
def test_a_fault_in_ascii_has_the_place_of_the_character(frame: bytes, reason: str, at: int) -> None:
    explanation = explain("ascii", frame)
    assert fault(explanation) == (reason, at)
    assert explanation.verdict.endswith(f"(character {at})")


def test_a_typed_frame_may_lack_its_end() -> None:
    for typed in (b":01040FB1000239", b":01040FB1000239\n"):
        explanation = explain_ascii(typed, typed=True)
        assert explanation.valid
        assert (explanation.fields[-1].offset, explanation.fields[-1].name) == (15, "end")
        assert explanation.fields[-1].meaning.startswith("CR LF is missing")


def test_every_known_function_has_a_name_and_no_field_without_one() -> None:
    for request in functions.known_requests():
        explanation = of_rtu(bytes([request.function_code]).hex() + " 0E 01 00 01", "request")
        assert explanation.fields[1].meaning[:2] == f"{request.function_code:02X}"
