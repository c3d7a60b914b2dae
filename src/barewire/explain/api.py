"""The two ways in: a frame as it is, and a frame as somebody typed it."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

from barewire.canopen.frame import AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.errors import DecodeError, EncodeError
from barewire.explain.canopen.frame import explain_can
from barewire.explain.capture.can_text import parse_any_can
from barewire.explain.input.text import parse_ascii, parse_hex
from barewire.explain.modbus.frames import explain_ascii, explain_rtu, explain_tcp
from barewire.explain.result import Explanation, Protocol, Role

PROTOCOLS: tuple[Protocol, ...] = get_args(Protocol)
ROLES: tuple[Role, ...] = get_args(Role)


def explain(protocol: str, data: bytes | AnyFrame, role: str | None = None) -> Explanation:
    """One whole frame, field by field. Whatever the bytes are, there is an explanation and never an exception.

    >>> explain("rtu", bytes.fromhex("01040FB1000222F8")).verdict
    'valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok'

    Without `role` it is guessed from the shape. EncodeError only for a protocol or a role that does not exist, and
    for bytes where a `CanFrame` is needed, or the other way round.
    """
    side = _checked(protocol, role)
    if isinstance(data, bytes | bytearray) == (protocol == "can"):
        raise EncodeError(f"{protocol}: expected {'a CanFrame' if protocol == 'can' else 'bytes'}, not {data!r}")
    if isinstance(data, CanFrame | FdFrame | ErrorFrame):
        return explain_can(data)
    known = {"rtu": explain_rtu, "ascii": explain_ascii, "tcp": explain_tcp}
    return known[protocol](data, side)


def explain_text(protocol: str, text: str, role: str | None = None) -> Explanation:
    """The same for what somebody typed or pasted; `barewire.explain.input.text` shows the forms.

    >>> explain_text("can", "can0  705   [1]  05").verdict
    'valid: error control from node 5: operational'

    Raises DecodeError, with the place in the text, for what is no way of writing a frame. An ASCII frame may come
    without its CR LF, because that is how lines are copied from a screen.
    """
    side = _checked(protocol, role)
    if protocol == "can":
        return explain_can(parse_any_can(text))
    if protocol == "ascii":
        characters = parse_ascii(text)
        said = explain_ascii(characters, side, typed=True)
        return said if characters.startswith(b":") else hinted(said, text, side)
    try:
        return hinted(explain(protocol, parse_hex(text), side), text, side)
    except DecodeError as error:
        other = _other(protocol, text, side)
        raise DecodeError(error.reason, error.data, error.at, error.text + other) if other else error from None


def hinted(said: Explanation, text: str, role: Role | None = None) -> Explanation:
    """The same; if its envelope is broken, and the text is a whole frame of another protocol, its error says so.

    >>> explain_text("tcp", "01 04 0F B1 00 02 22 F8").verdict.partition("; ")[2]
    'as rtu it is a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok (byte 2)'
    """
    intact = any(field.name == "CRC" and field.meaning == "CRC ok" for field in said.fields)
    bare = said.error is not None and said.error.text.startswith("no CRC") and not text.lstrip().startswith(":")
    if said.error is None or intact or bare:
        return said
    other = _other(said.protocol, text, role)
    return replace(said, error=said.error._replace(text=said.error.text + other)) if other else said


def _other(protocol: str, text: str, role: Role | None) -> str:
    """What the text is in another protocol: '; as tcp it is ...', or nothing."""
    for name in ("tcp", "rtu", "ascii", "can"):
        try:
            if name == protocol or (name == "can") != ("#" in text):
                continue
            if name == "can":
                said = explain_can(parse_any_can(text))
            elif name == "ascii":
                said = explain_ascii(parse_ascii(text), role, typed=True)
            else:
                said = explain(name, parse_hex(text), role)
        except DecodeError:
            continue
        if said.error is None:
            return f"; as {name} it is {said.summary}"
        if name in ("rtu", "ascii") and said.error.text.startswith("no "):
            return f"; as {name}: {said.error.text}"
    return ""


def _checked(protocol: str, role: str | None) -> Role | None:
    """The role, if there are such a protocol and such a role: both come from a command line as plain text."""
    if protocol not in PROTOCOLS:
        raise EncodeError(f"protocol {protocol!r}: expected {', '.join(PROTOCOLS)}", "protocol")
    if role is not None and role not in ROLES:
        raise EncodeError(f"role {role!r}: expected {', '.join(ROLES)}", "role")
    return role
