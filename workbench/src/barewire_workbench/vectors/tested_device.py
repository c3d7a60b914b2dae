"""The answer of device-conformance: which device was tested, and what it sent in each step. It is judged here.

    {"device": {"node": 5, "has": ["LSS"], "objects": {"1000:00": "92 01 02 00", "1017:00": "00 00"}},
     "received": [["585#6017100000000000"], []]}

The adapter fills the placeholders of the case with the values of its device, and sends. The judge fills them again with
the values in the answer, and compares what was received: no adapter says of itself that it has passed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from barewire.canopen.lss.messages import LssAddress
from barewire.errors import BarewireError
from barewire_workbench.conform.canopen.battery import failure_of
from barewire_workbench.conform.canopen.model import Subject
from barewire_workbench.conform.canopen.script import Placeholders, applies, read_node_case
from barewire_workbench.vectors.questions import Fields

LARGE, LSS, IDENTIFY = "large object", "LSS", "LSS identify remote slave"
"""Conditions of a case that no object shows: an answer names them."""


def described(subject: Subject, received: Sequence[Sequence[str]]) -> Fields:
    """Return the fields of an answer."""
    has = [LSS, *([IDENTIFY] if subject.identifies else [])] if subject.lss is not None else []
    objects = {f"{index:04X}:{sub:02X}": value.hex(" ").upper() for (index, sub), value in subject.values.items()}
    device: Fields = {"node": subject.node, "has": has, "objects": objects}
    if subject.large is not None:
        device |= {"has": [*has, LARGE], "large": "{:04X}:{:02X}".format(*subject.large)}
    return {"device": device, "received": [list(frames) for frames in received]}


def failure_of_answer(given: Mapping[str, Any], answered: Mapping[str, Any]) -> str:
    """Return how what was received differs from what the case accepts of this device; nothing if it does not."""
    try:
        subject = _subject(answered["device"])
        received = [_texts(frames) for frames in _list(answered["received"])]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        return f"the answer needs device (node, has, objects) and received: {type(error).__name__}: {error}"
    try:
        device = Placeholders(subject)
        case = read_node_case(given, device)
        if not applies(given, device) or case.lacks:
            return f"the device of the answer lacks {case.lacks or ', '.join(given['if'])}, and the case needs it"
        return failure_of(case, received) or ""
    except BarewireError as error:
        return f"the case cannot be filled with the values of the answer: {error}"


def _subject(device: Mapping[str, Any]) -> Subject:
    objects = {_place(name): _bytes(value) for name, value in device["objects"].items()}
    numbers = (int.from_bytes(objects.get((0x1018, sub), b""), "little") for sub in (1, 2, 3, 4))
    has = _texts(device["has"])
    large = _place(device["large"]) if LARGE in has else None
    node = device["node"]
    if isinstance(node, bool) or node not in range(1, 128):
        raise ValueError(f"node {node}: expected 1 to 127")
    if (0x1000, 0) not in objects:
        raise ValueError("objects has no 1000:00, which every device has and answers")
    return Subject(int(node), objects, large, LssAddress(*numbers) if LSS in has else None, IDENTIFY in has)


def _place(name: str) -> tuple[int, int]:
    if not re.fullmatch("[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}", name):
        raise ValueError(f"{name}: expected an object such as 1000:00")
    return int(name[:4], 16), int(name[5:], 16)


def _bytes(text: str) -> bytes:
    if not re.fullmatch("[0-9A-Fa-f ]*", text):
        raise ValueError(f"{text}: expected bytes in hexadecimal")
    return bytes.fromhex(text.replace(" ", ""))


def _list(item: Any) -> list[Any]:
    if not isinstance(item, list):
        raise TypeError(f"{item!r} is no list")
    return item


def _texts(item: Any) -> list[str]:
    texts = _list(item)
    for text in texts:
        if not isinstance(text, str):
            raise TypeError(f"{text!r} is no text")
    return texts
