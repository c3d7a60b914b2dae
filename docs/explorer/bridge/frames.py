"""One frame for the page: what each byte means, what is wrong, and how it looks on the wire."""

from __future__ import annotations

from typing import Any

from barewire.ascii import encode as encode_ascii
from barewire.canopen.frame import AnyFrame, CanFrame
from barewire.devices import Device, load
from barewire.errors import EncodeError
from barewire.rtu import encode as encode_rtu
from barewire_workbench import Explanation, explain_text
from barewire_workbench.api import explain_can_text, explain_exchange
from barewire_workbench.frames.input import parse_ascii, parse_hex
from barewire_workbench.frames.known_node import of_device
from barewire_workbench.monitor.pdos import PdoTracker
from barewire_workbench.pictures.levels import frame_pictures
from barewire_workbench.pictures.picture import html_fragment, page_style
from barewire_workbench.recordings.candump import parse_any_can

_LONGEST = 4096
"""The longest text of a frame, in characters: 256 bytes in any notation are shorter."""


def style() -> str:
    """Return the style sheet of the pictures."""
    return page_style(follows_page=True)


def frame(protocol: str, text: str, role: str = "", request: str = "", device: str = "") -> dict[str, Any]:
    """Return the explanation of a frame, its diagnosis, its editable bytes and its pictures as HTML.

    With a `request` the frame is a response to it. A `device` of the catalogue gives names, types and addresses: on
    Modbus to a response with its request, on CAN to the node that the frame is from or for.
    """
    if not text.strip():
        raise EncodeError("no frame: type or paste its bytes")
    if len(text) > _LONGEST:
        raise EncodeError(f"{len(text)} characters are more than one frame: paste them in the view Log")
    can: AnyFrame | None = parse_any_can(text) if protocol == "can" else None
    if isinstance(can, CanFrame) and device:
        explanation = _explained_can(text, can, load(device))
    elif request.strip() and can is None:
        explanation = explain_exchange(protocol, request, text, device=load(device) if device else None)
    else:
        explanation = explain_text(protocol, text, role or None)
    pictures = frame_pictures(explanation, can)
    return {
        **explanation.as_dict(),
        "verdict": explanation.verdict,
        "lines": explanation.lines(),
        "bytes": _bytes(protocol, text, explanation),
        "pictures": {name: html_fragment(picture, f"picture-{name}") for name, picture in pictures.items()},
    }


def _explained_can(text: str, can: CanFrame, device: Device) -> Explanation:
    """Return the explanation of a frame of a node that is this device."""
    node = can.id & 0x7F
    if device.canopen is None or not node:
        return explain_can_text(text)
    known = of_device(device, node)
    return explain_can_text(text, pdos=PdoTracker((known,)), dialects={node: known.commands})


def _bytes(protocol: str, text: str, explanation: Explanation) -> list[dict[str, str]]:
    """Return each byte (of ASCII: each character) that can be edited, with the name of its field."""
    found: list[dict[str, str]] = []
    for field in explanation.fields:
        parts = list(field.hex) if protocol == "ascii" else field.hex.split()
        if field.length:
            found += [{"hex": part, "name": field.name} for part in parts]
    return found


def edit(protocol: str, text: str, at: int, hex: str) -> str:  # the word of the page
    """Return the text of the frame with byte `at` (of ASCII: character) replaced."""
    if protocol == "ascii":
        shown = parse_ascii(text).decode("latin-1").rstrip("\r\n")
        _check_place(at, len(shown))
        return shown[:at] + hex[:1] + shown[at + 1 :]
    try:
        value = int(hex, 16)
    except ValueError:
        raise EncodeError(f"byte {at}: {hex!r} is not a hexadecimal number from 00 to FF") from None
    if not 0 <= value <= 255:
        raise EncodeError(f"byte {at}: {hex!r} is not a hexadecimal number from 00 to FF")
    if protocol == "can":
        head, mark, digits = text.partition("#")
        data = bytearray(parse_hex(digits)) if mark else bytearray()
        _check_place(at, len(data))
        data[at] = value
        return f"{head}#{data.hex(' ').upper()}"
    data = bytearray(parse_hex(text))
    _check_place(at, len(data))
    data[at] = value
    return data.hex(" ").upper()


def _check_place(at: int, size: int) -> None:
    if not 0 <= at < size:
        raise EncodeError(f"byte {at}: the frame has {size}")


def mend(protocol: str, text: str) -> str:
    """Return the frame with its checksum, or the length of its header, made right for the other bytes."""
    if protocol == "rtu":
        data = parse_hex(text)
        if len(data) < 4:
            raise EncodeError(f"{len(data)} bytes are too few: a unit, a function code and two bytes of CRC are needed")
        return encode_rtu(data[0], data[1:-2]).hex(" ").upper()
    if protocol == "ascii":
        shown = parse_ascii(text).decode("latin-1").strip().removeprefix(":")
        try:
            data = bytes.fromhex(shown)[:-1]
        except ValueError:
            raise EncodeError("the characters behind ':' are not pairs of hexadecimal digits") from None
        if len(data) < 2:
            raise EncodeError("too few characters: a unit, a function code and an LRC are needed")
        return encode_ascii(data[0], data[1:]).decode().strip()
    if protocol == "tcp":
        data = parse_hex(text)
        if len(data) < 8:
            raise EncodeError(f"{len(data)} bytes are too few: the header has 7, and a function code follows")
        return (data[:2] + b"\0\0" + (len(data) - 6).to_bytes(2, "big") + data[6:]).hex(" ").upper()
    raise EncodeError("the controller computes the CRC of a CAN frame: there is nothing to mend")
