"""The pictures of `barewire steps`: what `--format svg` and `--format html` draw.

float                        the bytes of a 32-bit value in two registers, in the four orders
statusword, controlword      the state machine of CiA 402 with the words
can-frame                    the bits of one frame on the bus
timing                       the levels of a request with the silence around it
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from barewire.ascii import encode as ascii_frame
from barewire.errors import EncodeError
from barewire.rtu import encode
from barewire_workbench.frames.input import parse_hex
from barewire_workbench.pictures.levels import CanFramePicture, LevelsPicture
from barewire_workbench.pictures.picture import Picture
from barewire_workbench.pictures.states import DriveWord, StatesPicture
from barewire_workbench.pictures.steps import TYPES, RegistersPicture
from barewire_workbench.recordings.can_text import parse_can
from barewire_workbench.steps import number_steps, parse_word
from barewire_workbench.wire import CharacterFormat, can_bits


def picture_of_steps(name: str, arguments: Mapping[str, Any]) -> Picture:
    """Return the picture of a command with these arguments. Raise EncodeError if it has none."""
    draw = _DRAWN.get(name)
    if draw is None:
        raise EncodeError(f"steps {name} has no picture: expected one of {', '.join(_DRAWN)}")
    return draw(**arguments)


def timing_picture(baudrate: int, character: CharacterFormat) -> LevelsPicture:
    """Return the levels of a request: of RTU with the silence around it, with 7 data bits of ASCII."""
    pdu = bytes.fromhex("03 00 00 00 02")
    if character.data_bits < 8:
        digits = ["unit", "function code", "address", "address", "quantity", "quantity", "LRC"]
        names = ["start", *(name for name in digits for _ in range(2)), "CR", "LF"]
        return LevelsPicture(ascii_frame(1, pdu), character, baudrate, names)
    request = encode(1, pdu)
    names = ["unit", "function code", "address", "address", "quantity", "quantity", "CRC", "CRC"]
    return LevelsPicture(request, character, baudrate, names, "t3.5")


def check_value_or_bytes(value: str | None, data: str | None) -> None:
    """Raise EncodeError unless a number is given in one way: as VALUE or as its bytes."""
    if (value is None) == (data is None):
        raise EncodeError("expected a VALUE or --bytes HEX, one of them; see barewire steps float --help")


def _registers(value: str | None, type_name: str, order: str, data: str | None) -> Picture:
    check_value_or_bytes(value, data)
    if type_name not in TYPES:
        raise EncodeError(f"--type {type_name}: a picture has two registers: expected one of {', '.join(TYPES)}")
    if value is None:
        return RegistersPicture.of_bytes(parse_hex(data or ""), type_name, order=order)
    steps = number_steps(value, type_name, "ABCD")
    number = steps.values["value"]
    if type_name == "f32":
        with suppress(ValueError):
            number = float(value)  # as it was given, before it is rounded
    if not isinstance(number, int | float):
        number = RegistersPicture.of_bytes(bytes.fromhex(str(steps.values["bytes"])), type_name).rows[0].value
    return RegistersPicture.of_value(number, type_name, order=order)


def _control_word(word: str | None, previous: str, device: str | None) -> Picture:
    words = [] if word is None else [DriveWord("control", parse_word(word, "control word"))]
    before = parse_word(previous, "--previous")
    return StatesPicture([*([DriveWord("control", before)] if before else []), *words], device or "")


def _status_word(words: Sequence[str], device: str | None) -> Picture:
    return StatesPicture((DriveWord("status", parse_word(word, "status word")) for word in words), device or "")


def _can_frame(frames: tuple[str, ...], bitrate: int) -> Picture:
    texts = frames if sum("#" in frame for frame in frames) > 1 else (" ".join(frames),)
    if len(texts) > 1:
        raise EncodeError(f"a picture has one frame, {len(texts)} are given")
    return CanFramePicture(can_bits(parse_can(texts[0])), bitrate)


_DRAWN: dict[str, Callable[..., Picture]] = {
    "float": _registers,
    "statusword": _status_word,
    "controlword": _control_word,
    "can-frame": _can_frame,
}
