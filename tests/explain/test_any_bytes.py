"""Any bytes at all: never an exception, and every byte in exactly one field."""

from __future__ import annotations

import json
from contextlib import suppress

from hypothesis import given, settings, strategies as st

from barewire import ascii as ascii_room, rtu, tcp
from barewire.canopen import CanFrame
from barewire.errors import DecodeError
from barewire.explain import Explanation, FrameRole, ProtocolName, explain, explain_text
from barewire.explain.modbus.frames import explain_ascii
from barewire.modbus import decode_request, decode_response
from barewire.modbus.messages import registry as functions

thorough = settings(max_examples=300, deadline=None, derandomize=True, database=None)

ROLES = st.sampled_from([None, "request", "response"])
CODES = st.sampled_from([request.function_code for request in functions.known_requests()])
# Noise alone would hardly ever reach the messages, so half of it begins as one of them does.
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


def covers(said: Explanation, size: int) -> None:
    """The law: one field behind the other, no gap, no overlap, nothing beyond the end."""
    at = 0
    for field in said.fields:
        assert field.offset == at, said.lines()
        at += field.length
    assert at == size, said.lines()
    assert said.valid == (said.error is None)
    assert said.error is None or 0 <= said.error.at <= size
    assert json.loads(json.dumps(said.as_dict())) == said.as_dict()
    assert len(said.lines()) == len(said.fields) + 1
    assert all("\n" not in line and line.isprintable() for line in said.lines())


@thorough
@given(st.data(), st.sampled_from(["rtu", "ascii", "tcp"]), ROLES)
def test_every_byte_of_a_modbus_frame_is_in_one_field(
    data: st.DataObject, protocol: ProtocolName, role: FrameRole | None
) -> None:
    frame = data.draw(FRAMES[protocol])
    cut = data.draw(st.sampled_from([frame, frame[:-1], frame[1:], frame + b"\x00\r"]))
    covers(explain(protocol, cut, role), len(cut))


@thorough
@given(FRAMES["ascii"], ROLES)
def test_every_typed_character_is_in_one_field(frame: bytes, role: FrameRole | None) -> None:
    covers(explain_ascii(frame, role, typed=True), len(frame))


@thorough
@given(st.builds(CanFrame, IDENTIFIERS, st.binary(max_size=9), st.booleans()))
def test_every_byte_of_a_can_frame_is_in_one_field(frame: CanFrame) -> None:
    covers(explain("can", frame), len(frame.data))


@thorough
@given(st.builds(CanFrame, IDENTIFIERS, st.just(b""), st.booleans(), st.just(True), st.integers(0, 8)))
def test_a_remote_frame_has_one_field(frame: CanFrame) -> None:
    covers(explain("can", frame), 0)


@thorough
@given(PDUS, UNITS)
def test_valid_means_that_the_decoders_agree(pdu: bytes, unit: int) -> None:
    for role, decode in (("request", decode_request), ("response", decode_response)):
        fault = None
        try:
            decode(pdu)
        except DecodeError as error:
            fault = error
        said = explain("rtu", rtu.encode(unit, pdu), "request" if role == "request" else "response")
        if not pdu[0] & 0x7F:  # whatever its length: there is no function 00
            assert said.error is not None
            assert said.error.reason == "function"
        elif fault is None:
            assert said.valid
        elif fault.reason != "function":
            assert said.error == (fault.reason, fault.at + 1, fault.text)


@thorough
@given(st.sampled_from(["rtu", "ascii", "tcp", "can"]), st.text(max_size=40))
def test_any_text_is_explained_or_refused_in_one_line(protocol: ProtocolName, text: str) -> None:
    with suppress(DecodeError):
        assert explain_text(protocol, text).lines()


@thorough
@given(st.sampled_from(["rtu", "tcp", "can"]), st.text(r"0123456789ABCDEFghx\xR#[]() ,.:can'", max_size=30))
def test_text_that_is_nearly_right_is_explained_or_refused(protocol: ProtocolName, text: str) -> None:
    with suppress(DecodeError):
        assert explain_text(protocol, text).lines()


@thorough
@given(st.sampled_from(["rtu", "ascii", "tcp"]), st.text("013479abcx\\\"'{}[]<>();:=,- \n.|", max_size=40))
def test_text_in_nearly_the_dress_of_a_program_is_explained_or_refused(protocol: ProtocolName, text: str) -> None:
    with suppress(DecodeError):
        assert explain_text(protocol, text).lines()
