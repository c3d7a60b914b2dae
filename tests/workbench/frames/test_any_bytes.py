"""Any bytes: no exception, and every byte in exactly one field."""

from __future__ import annotations

import json

from hypothesis import given, settings, strategies as st

from barewire import ascii as ascii_room, rtu, tcp
from barewire.canopen import CanFrame
from barewire.errors import DecodeError
from barewire.modbus import decode_request, decode_response
from barewire.modbus.messages import registry as functions
from barewire_workbench import Explanation, FrameRole, ProtocolName, explain, explain_text
from barewire_workbench.frames.modbus import explain_ascii

thorough = settings(max_examples=100, deadline=None, derandomize=True, database=None)

ROLES = st.sampled_from([None, "request", "response"])
CODES = st.sampled_from([request.function_code for request in functions.known_requests()])
# Random bytes rarely form a message, so half of them begin like one.
PDUS = st.one_of(
    st.binary(min_size=1, max_size=40),
    st.builds(lambda code, bit, rest: bytes([code | bit]) + rest, CODES, st.sampled_from([0, 0x80]), st.binary()),
    st.builds(lambda rest: b"\x2b\x0e" + rest, st.binary(max_size=30)),
).map(lambda pdu: pdu[:253])
UNITS = st.integers(0, 255)
FRAMES = {
    "rtu": st.one_of(st.binary(max_size=300), st.builds(rtu.encode, UNITS, PDUS)),
    "ascii": st.one_of(
        st.binary(max_size=60),
        st.text(":0123456789ABCDEFabG\r\n", max_size=60).map(str.encode),
        st.builds(ascii_room.encode, UNITS, PDUS),
    ),
    "tcp": st.one_of(
        st.binary(max_size=300),
        st.builds(tcp.encode, UNITS, PDUS, st.integers(0, 0xFFFF)),
        st.builds(lambda length, rest: bytes([0, 1, 0, 0, 0, length]) + rest, UNITS, st.binary(max_size=20)),
    ),
}
IDENTIFIERS = st.one_of(
    st.sampled_from([0, 0x80, 0x85, 0x100, 0x185, 0x205, 0x585, 0x605, 0x705, 0x7E4, 0x7E5]), st.integers(0, 0x1FFFFFFF)
)


def check_fields(explanation: Explanation, size: int) -> None:
    """Check that the fields follow each other without gap or overlap, up to the end."""
    at = 0
    for field in explanation.fields:
        assert field.offset == at, explanation.lines()
        at += field.length
    assert at == size, explanation.lines()
    assert explanation.valid == (explanation.error is None)
    assert explanation.error is None or 0 <= explanation.error.at <= size
    assert json.loads(json.dumps(explanation.as_dict())) == explanation.as_dict()
    assert len(explanation.lines()) == len(explanation.fields) + 1 + bool(explanation.diagnosis)
    assert all("\n" not in line and line.isprintable() for line in explanation.lines())


@thorough
@given(st.data(), st.sampled_from(["rtu", "ascii", "tcp"]), ROLES)
def test_every_byte_of_a_modbus_frame_is_in_one_field(
    data: st.DataObject, protocol: ProtocolName, role: FrameRole | None
) -> None:
    frame = data.draw(FRAMES[protocol])
    cut = data.draw(st.sampled_from([frame, frame[:-1], frame[1:], frame + b"\x00\r"]))
    check_fields(explain(protocol, cut, role), len(cut))


@thorough
@given(FRAMES["ascii"], ROLES)
def test_every_typed_character_is_in_one_field(frame: bytes, role: FrameRole | None) -> None:
    check_fields(explain_ascii(frame, role, typed=True), len(frame))


@thorough
@given(st.builds(CanFrame, IDENTIFIERS, st.binary(max_size=9), st.booleans()))
def test_every_byte_of_a_can_frame_is_in_one_field(frame: CanFrame) -> None:
    check_fields(explain("can", frame), len(frame.data))


@thorough
@given(st.builds(CanFrame, IDENTIFIERS, st.just(b""), st.booleans(), st.just(True), st.integers(0, 8)))
def test_a_remote_frame_has_one_field(frame: CanFrame) -> None:
    check_fields(explain("can", frame), 0)


@thorough
@given(PDUS, UNITS)
def test_valid_means_that_the_decoders_agree(pdu: bytes, unit: int) -> None:
    for role, decode in (("request", decode_request), ("response", decode_response)):
        fault = None
        try:
            decode(pdu)
        except DecodeError as error:
            fault = error
        explanation = explain("rtu", rtu.encode(unit, pdu), "request" if role == "request" else "response")
        if not pdu[0] & 0x7F:  # whatever its length: there is no function 00
            assert explanation.error is not None
            assert explanation.error.reason == "function"
        elif fault is None:
            assert explanation.valid
        elif fault.reason != "function":
            assert explanation.error == (fault.reason, fault.at + 1, fault.text)


def check_text(protocol: ProtocolName, text: str) -> None:
    refusal, lines = "", list[str]()
    try:
        lines = explain_text(protocol, text).lines()
    except DecodeError as error:
        refusal = error.text
    assert bool(lines) is not bool(refusal)
    assert "\n" not in refusal


@thorough
@given(st.sampled_from(["rtu", "ascii", "tcp", "can"]), st.text(max_size=40))
def test_any_text_is_explained_or_refused_in_one_line(protocol: ProtocolName, text: str) -> None:
    check_text(protocol, text)


@thorough
@given(st.sampled_from(["rtu", "tcp", "can"]), st.text(r"0123456789ABCDEFghx\xR#[]() ,.:can'", max_size=30))
def test_text_that_is_nearly_right_is_explained_or_refused(protocol: ProtocolName, text: str) -> None:
    check_text(protocol, text)


@thorough
@given(st.sampled_from(["rtu", "ascii", "tcp"]), st.text("013479abcx\\\"'{}[]<>();:=,- \n.|", max_size=40))
def test_text_that_is_nearly_source_code_is_explained_or_refused(protocol: ProtocolName, text: str) -> None:
    check_text(protocol, text)
