"""Calculations step by step for the page: which there are, what each asks for, and their steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from barewire.codecs import ORDERS
from barewire.errors import EncodeError
from barewire_workbench.frames.input import parse_hex
from barewire_workbench.recordings.candump import parse_can
from barewire_workbench.steps import (
    CRC_VIEWS,
    NUMBER_TYPES,
    Steps,
    can_frame_steps,
    cob_id_steps,
    control_word_steps,
    crc_steps,
    lrc_steps,
    number_steps,
    parse_cob_id,
    parse_word,
    status_word_steps,
    timing_steps,
)
from barewire_workbench.wire import CharacterFormat


class Input(NamedTuple):
    """One thing that a calculation asks for; with `choices`, one of them."""

    name: str
    label: str
    value: str
    choices: tuple[str, ...] = ()


class Kind(NamedTuple):
    """One calculation."""

    title: str
    inputs: tuple[Input, ...]
    steps: Callable[..., Steps]


KINDS = {
    "crc": Kind(
        "CRC of RTU",
        (Input("text", "Bytes", "02 07"), Input("way", "Way", CRC_VIEWS[0], CRC_VIEWS)),
        lambda text, way: crc_steps(parse_hex(text), [way]),
    ),
    "lrc": Kind("LRC of ASCII", (Input("text", "Bytes", "01 04 00 00 08"),), lambda text: lrc_steps(parse_hex(text))),
    "timing": Kind(
        "Times of a serial line",
        (Input("baudrate", "Bits per second", "19200"), Input("form", "Character", "8E1")),
        lambda baudrate, form: timing_steps(_whole(baudrate), CharacterFormat.parse(form)),
    ),
    "float": Kind(
        "A number in registers",
        (
            Input("text", "Number", "1.1"),
            Input("type", "Type", "f32", NUMBER_TYPES),
            Input("order", "Order", "CDAB", ORDERS),
        ),
        lambda text, type, order: number_steps(text, type, order),
    ),
    "cob-id": Kind("COB-ID", (Input("text", "COB-ID", "58Fh"),), lambda text: cob_id_steps(parse_cob_id(text))),
    "controlword": Kind(
        "Control word of a drive",
        (Input("text", "Control word", "000F"),),
        lambda text: control_word_steps(parse_word(text, "control word")),
    ),
    "statusword": Kind(
        "Status word of a drive",
        (Input("text", "Status word", "0637"),),
        lambda text: status_word_steps(parse_word(text, "status word")),
    ),
    "can-frame": Kind(
        "Bits of a CAN frame",
        (Input("text", "Frame", "605#4041600000000000"), Input("bitrate", "Bits per second", "125000")),
        lambda text, bitrate: can_frame_steps([parse_can(text)], _whole(bitrate)),
    ),
}


def kinds() -> list[dict[str, Any]]:
    """Return what the page needs to ask for each calculation."""
    return [
        {"name": name, "title": kind.title, "inputs": [given._asdict() for given in kind.inputs]}
        for name, kind in KINDS.items()
    ]


def steps(kind: str, **inputs: str) -> dict[str, Any]:
    """Return a calculation as `barewire steps --json` prints it."""
    if kind not in KINDS:
        raise EncodeError(f"kind {kind!r}: expected one of {', '.join(KINDS)}")
    names = [given.name for given in KINDS[kind].inputs]
    return KINDS[kind].steps(**{name: inputs.get(name, "") for name in names}).as_dict()


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise EncodeError(f"{text!r} is not a whole number") from None
