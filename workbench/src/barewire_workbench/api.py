"""The functions of this package: `explain` for a frame in bytes, `explain_text` for a frame as text, and
`explain_exchange` for a response with its request.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import replace
from typing import get_args

from barewire.canopen.frame import AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.devices import Device
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.diagnosis.can import explain_diagnosed_can, modbus_on_can
from barewire_workbench.diagnosis.exchange import (
    ExpectedValue,
    addresses_of_table,
    cannot_answer,
    decoded,
    diagnose_exchange,
    expected_values,
    float_values,
    with_diagnosis,
)
from barewire_workbench.diagnosis.good import good_ascii
from barewire_workbench.frames.can import PdoDescriptions, explain_can
from barewire_workbench.frames.input import parse_ascii, parse_hex
from barewire_workbench.frames.modbus import explain_ascii, explain_rtu, explain_tcp
from barewire_workbench.frames.result import Explanation, FrameRole, ProtocolName
from barewire_workbench.recordings.candump import parse_any_can

_PROTOCOLS: tuple[ProtocolName, ...] = get_args(ProtocolName)
_NO_DIALECTS: Mapping[int, Container[int]] = {}
_ROLES: tuple[FrameRole, ...] = get_args(FrameRole)


def explain(protocol: str, data: bytes | AnyFrame, role: str | None = None) -> Explanation:
    """Explain one frame, field by field. There is an explanation for any bytes.

    >>> explain("rtu", bytes.fromhex("01040FB1000222F8")).verdict
    'valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok'

    `protocol` is "rtu", "ascii", "tcp" or "can", `role` is "request" or "response"; without a role it is guessed from
    the shape of the frame. Raises EncodeError for another protocol or role, and for bytes instead of a `CanFrame` or
    the reverse.
    """
    checked = _checked(protocol, role)
    if isinstance(data, bytes | bytearray) == (protocol == "can"):
        raise EncodeError(f"{protocol}: expected {'a CanFrame' if protocol == 'can' else 'bytes'}, not {data!r}")
    if isinstance(data, CanFrame | FdFrame | ErrorFrame):
        return _with_modbus(explain_diagnosed_can(data), _bytes_with_identifier(data), checked)
    explainers: dict[str, Callable[[bytes, FrameRole | None], Explanation]] = {
        "rtu": explain_rtu,
        "ascii": explain_ascii,
        "tcp": explain_tcp,
    }
    return with_diagnosis(explainers[protocol](data, checked), data, checked)


def explain_text(protocol: str, text: str, role: str | None = None) -> Explanation:
    """Explain a frame that was typed or pasted; `frames.input` and `recordings.candump` show the forms.

    >>> explain_text("can", "can0  705   [1]  05").verdict
    'valid: error control from node 5: operational'

    Raises DecodeError, with the place in the text, if the text is not in one of the forms. An ASCII frame may lack its
    CR LF, as lines copied from a screen do.
    """
    checked = _checked(protocol, role)
    characters = parse_ascii(text)
    if protocol == "ascii":
        return _typed_ascii(text, characters, checked)
    try:
        if protocol == "can":
            explanation = explain_can_text(text, checked)
        else:
            data = characters if good_ascii(characters) is not None else parse_hex(text)
            explanation = explain(protocol, data, checked)
        return _with_hint(explanation, text, checked)
    except DecodeError as error:
        other = _other(protocol, text, checked)
        raise DecodeError(error.reason, error.data, error.at, error.text + other) if other else error from None


def explain_exchange(
    protocol: str, request: str, response: str, *, device: Device | None = None, floats: str | None = None
) -> Explanation:
    """Explain a pasted response to a pasted request: its diagnosis says what does not fit the request.

    >>> explain_exchange("rtu", "01 03 00 00 00 01 84 0A", "02 03 02 00 07 BD 86").diagnosis[0].text
    'unit 2 answers, and unit 1 was asked'

    With the `device` its addresses are known, and the orders in which it sends 32-bit values. `floats` is "f32" or
    "f64": all registers of the response are floats of that type.

    Raises DecodeError for a text that cannot be read, EncodeError for the protocol can.
    """
    if protocol == "can":
        raise EncodeError("a request and its response: expected rtu, ascii or tcp, not can", "protocol")
    explanation = explain_text(protocol, response, "response")
    framing = explanation.protocol
    sent, answered = _typed_bytes(protocol, request), _typed_bytes(protocol, response)
    values, known = list[ExpectedValue](), frozenset[int]()
    try:
        pdu = decoded(framing, sent).pdu
    except DecodeError:
        pdu = b""
    if floats is not None:
        values = float_values(floats, pdu)
    elif device is not None and pdu:
        values, known = expected_values(device, pdu), addresses_of_table(device, pdu)
    findings = diagnose_exchange(framing, sent, answered, values, known)
    diagnosis = (*findings, *explanation.diagnosis)
    return replace(explanation, diagnosis=diagnosis or tuple(cannot_answer(framing, sent, answered)))


def _typed_bytes(protocol: str, text: str) -> bytes:
    characters = parse_ascii(text)
    return characters if protocol == "ascii" or characters.startswith(b":") else parse_hex(text)


def _typed_ascii(text: str, characters: bytes, role: FrameRole | None) -> Explanation:
    """Explain a text as an ASCII frame. If it is none, it may be the codes of other bytes: of an RTU frame, perhaps."""
    explanation = with_diagnosis(explain_ascii(characters, role, typed=True), characters, role)
    if characters.startswith(b":"):
        return explanation
    if not explanation.diagnosis:
        try:
            codes = parse_hex(text)
        except DecodeError:
            codes = b""
        of_codes = with_diagnosis(explain_ascii(codes, role, typed=True), codes, role)
        explanation = of_codes if of_codes.diagnosis else explanation
    return _with_hint(explanation, text, role)


def explain_can_text(
    text: str,
    role: str | None = None,
    pdos: PdoDescriptions | None = None,
    dialects: Mapping[int, Container[int]] = _NO_DIALECTS,
) -> Explanation:
    """Explain a text as a CAN frame; `pdos` and `dialects` describe the nodes, as for `diagnose_can`.

    Most short texts can be read as a CAN frame, so one that is a good Modbus frame gets that finding first.

    Raises DecodeError for a text that is no CAN frame.
    """
    explanation = explain_diagnosed_can(parse_any_can(text), pdos, dialects)
    try:
        return _with_modbus(explanation, [parse_hex(text)], _checked("can", role))
    except DecodeError:  # a form that only CAN has, such as 605#40
        return explanation


def _with_modbus(explanation: Explanation, candidates: Iterable[bytes], role: FrameRole | None) -> Explanation:
    finding = next(filter(None, (modbus_on_can(data, role) for data in candidates)), None)
    return explanation if finding is None else replace(explanation, diagnosis=(finding, *explanation.diagnosis))


def _bytes_with_identifier(frame: AnyFrame) -> list[bytes]:
    """Return the bytes from which a text of hexadecimal digits becomes this frame: the first ones are its identifier.

    01 03 00 00 00 0A C5 CD     001#030000000AC5CD          0103 00 00 ...     103#0000...
    """
    if not isinstance(frame, CanFrame) or frame.remote or frame.extended:
        return []
    return [frame.id.to_bytes(size) + frame.data for size in (1, 2) if frame.id < 256**size]


def _with_hint(explanation: Explanation, text: str, role: FrameRole | None = None) -> Explanation:
    """Return the explanation. If its framing is broken and another protocol fits the text, the error names that one.

    >>> explain_text("tcp", "01 04 0F B1 00 02 22 F8").verdict.partition("; ")[2]
    'as rtu it is a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok (byte 2)'
    """
    intact = any(field.name == "CRC" and field.meaning == "CRC ok" for field in explanation.fields)
    error = explanation.error
    without_crc = error is not None and error.text.startswith("no CRC") and not text.lstrip().startswith(":")
    if error is None or intact or without_crc:
        return explanation
    other = _other(explanation.protocol, text, role)
    return replace(explanation, error=error._replace(text=error.text + other)) if other else explanation


def _other(protocol: str, text: str, role: FrameRole | None) -> str:
    """Return the reading in another protocol, '; as tcp it is ...', or '' if none fits."""
    for name in ("tcp", "rtu", "ascii", "can"):
        try:
            if name == protocol or (name == "can") != ("#" in text):
                continue
            if name == "can":
                explanation = explain_can(parse_any_can(text))
            elif name == "ascii":
                explanation = explain_ascii(parse_ascii(text), role, typed=True)
            else:
                explanation = (explain_rtu if name == "rtu" else explain_tcp)(parse_hex(text), role)
        except DecodeError:
            continue
        if explanation.error is None:
            return f"; as {name} it is {explanation.summary}"
        if name in ("rtu", "ascii") and explanation.error.text.startswith("no "):
            return f"; as {name}: {explanation.error.text}"
    return ""


def _checked(protocol: str, role: str | None) -> FrameRole | None:
    """Check protocol and role: both come from a command line as plain text."""
    if protocol not in _PROTOCOLS:
        raise EncodeError(f"protocol {protocol!r}: expected {', '.join(_PROTOCOLS)}", "protocol")
    if role is not None and role not in _ROLES:
        raise EncodeError(f"role {role!r}: expected {', '.join(_ROLES)}", "role")
    return role
