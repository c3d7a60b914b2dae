"""Answers for whole CANopen devices: objects as data, then frames in and out over time."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from barewire.canopen.communication_objects import lss_address
from barewire.canopen.datatypes import object_codec, type_name
from barewire.canopen.device.device import LocalNode
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.slave import LssSlave
from barewire.canopen.object_dictionary import Entry, ObjectAddress, ObjectDictionary
from barewire.canopen.pdo.config import pdos_of
from barewire.codecs import Value
from barewire_workbench.vectors.answers.texts import number, octets
from barewire_workbench.vectors.questions import Fields

_EVERY_DEVICE: tuple[tuple[str, str, str], ...] = (
    ("1000:00", "UNSIGNED32", "const"),
    ("1001:00", "UNSIGNED8", "ro"),
    ("1018:01", "UNSIGNED32", "const"),
)
"""The objects that a device has beside those of the case; their values are 0."""
_MAPPED: dict[str, Any] = {"no": (), "RPDO": ("RPDO",), "TPDO": ("TPDO",), "both": ("RPDO", "TPDO")}
_TIMERS_MAX = 1000
"""Timers that may end between two steps."""


def address_of(text: str) -> ObjectAddress:
    """Return index and sub-index of "1017:00"."""
    index, _, sub = text.partition(":")
    return int(index, 16), int(sub, 16)


def value_of(type: str, text: str) -> Value:
    """Return the value of a text: decimal for numbers, hexadecimal for bytes, the characters for strings."""
    name = type_name(type)
    if name in ("octets", "domain"):
        return octets(text)
    if name in ("string", "unicode"):
        return text
    if name in ("time_of_day", "time_difference"):
        return object_codec(name).decode(octets(text))
    return bool(int(text)) if name == "bool" else number(text)


def dictionary(rows: Iterable[Fields]) -> ObjectDictionary:
    """Return the object dictionary of a device."""
    entries = []
    listed = list(rows)
    have = {row["object"] for row in listed}
    for place, type, access in _EVERY_DEVICE:
        if place not in have:
            listed.append({"object": place, "type": type, "access": access, "value": "0"})
    for row in listed:
        index, sub = address_of(row["object"])
        low, high = (None if row.get(name) is None else float(row[name]) for name in ("low", "high"))
        entries.append(
            Entry(
                *(index, sub, row["object"], row["type"], row["access"], value_of(row["type"], row["value"])),
                minimum=int(low) if low is not None and low.is_integer() else low,
                maximum=int(high) if high is not None and high.is_integer() else high,
                mappable=_MAPPED[row.get("mapped", "no")],
            )
        )
    return ObjectDictionary(entries)


def device(given: Fields) -> Fields:
    """Run a device step by step: what it sends, by its timers and as response."""
    described = given["device"]
    objects, node = dictionary(described["objects"]), described["id"]
    lss = LssSlave(lss_address(objects), node, store=lambda *stored: True) if described.get("lss") else None
    machine = LocalNode(node, objects, pdos_of(objects, node or 1), lss=lss)
    steps, now = [], 0.0
    for place, step in enumerate(given["talk"]):
        since, now = now, step["at"] / 1e6
        said = machine.start(0.0) if place == 0 else []
        said += _until(machine, since, now)
        for text in step.get("hear", ()):
            said += machine.feed(CanFrame.parse(text), now)
        for act in step.get("act", ()):
            said += _act(machine, act, now)
        said += machine.feed(None, now) + _until(machine, now, now)
        steps.append({"say": [str(frame) for frame in said]})
    return {"talk": steps}


def _until(machine: LocalNode, since: float, now: float) -> list[CanFrame]:
    """Let the time pass from `since` to `now`, timer by timer. Return what is sent on the way."""
    said: list[CanFrame] = []
    for _ in range(_TIMERS_MAX):
        due = machine.deadline
        if due is None or due > now:
            break
        said += machine.feed(None, max(due, since))
    return said


def _act(machine: LocalNode, act: Fields, now: float) -> list[CanFrame]:
    """Do what the application of a device does: set a value, or report an error or its end."""
    if "set" in act:
        index, sub = address_of(act["set"])
        machine.objects.set(index, sub, value_of(machine.objects.entry(index, sub).type, act["value"]))
        return []
    if "error" in act:
        return machine.error(int(act["error"], 16), now, info=octets(act.get("info", "")))
    return machine.error_gone(int(act["clear"], 16), now)
