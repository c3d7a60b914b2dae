"""A device with objects of every kind, and its EDS: what the cases of an EDS are tested with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from barewire.canopen import Entry, LocalNode
from barewire.canopen.datatypes import BY_NAME
from barewire.canopen.eds import Eds, EdsItem, EdsObject, compose, parse
from barewire.canopen.eds.objects import MAPPABLE, RECORD, VAR, EdsAccess
from tests.workbench.conform.canopen.devices import plain

MORE = (
    Entry(0x1008, 0, "manufacturer device name", "string", "const", "barewire plain device"),
    Entry(0x2000, 0, "speed", "u16", "rw", 20, 10, 1000),
    Entry(0x2001, 0, "offset", "i32", "rw", -5, -100, 100),
    Entry(0x2002, 0, "counter", "u64", "ro", 7),
    Entry(0x2003, 0, "comment", "string", "rw", "as delivered"),
    Entry(0x2004, 0, "key", "u16", "wo", 0, None, 100),
    Entry(0x2005, 0, "gain", "f32", "rw", 1.5, -10.5, 1e15),
    Entry(0x2006, 0, "part number", "string", "const", "ab"),
    Entry(0x2007, 0, "internal", "u8", "ro", 1, mappable=()),
    Entry(0x2008, 0, "on", "bool", "rw", 0),
    Entry(0x2010, 1, "first", "u8", "rw", 1, object_name="record"),
    Entry(0x2010, 2, "second", "u16", "ro", 2, object_name="record"),
    Entry(0x2010, 4, "fourth", "u32", "rw", 4, object_name="record"),
)
PROCESS: dict[int, EdsAccess] = {0x6040: "rww", 0x6041: "ro"}


def device(*changed: Entry, missing: tuple[tuple[int, int], ...] = ()) -> LocalNode:
    """Return the device with some entries changed, added or missing."""
    places = {(entry.index, entry.sub): entry for entry in (*MORE, *changed)}
    added = {place for place in places if place[0] >= 0x2000 and place != (0x6041, 0)} - set(missing)
    node = plain(*(places[place] for place in sorted(added)))
    for place in places.keys() - added - set(missing):
        node.objects.replace(places[place])
    for entry in [entry for entry in node.objects if entry.index >= 0x2000 and entry.mappable is None]:
        node.objects.replace(replace(entry, mappable=MAPPABLE[PROCESS[entry.index]] if entry.index in PROCESS else ()))
    return node


def eds_of(node: LocalNode) -> Eds:
    """Return the EDS of a device, read from its text."""
    objects = [_described(node, index) for index in sorted({entry.index for entry in node.objects})]
    return parse(compose(objects).encode())


def _described(node: LocalNode, index: int) -> EdsObject:
    entries = [node.objects.entry(index, sub) for sub in node.objects.subs(index)]
    kind = VAR if [entry.sub for entry in entries] == [0] else RECORD
    items = tuple(_item(node, entry) for entry in entries)
    return EdsObject(index, entries[-1].object_name or entries[0].name, kind, items)


def _item(node: LocalNode, entry: Entry) -> EdsItem:
    access: EdsAccess = PROCESS.get(entry.index, entry.access)
    return EdsItem(
        entry.sub,
        entry.name,
        entry.type,
        access,
        default=node.objects.default(entry.index, entry.sub),
        low=entry.minimum,
        high=entry.maximum,
        pdo=entry.index in PROCESS,
        code=BY_NAME[entry.type].code,
    )


RIGHT = eds_of(device())
OBJECTS: Mapping[int, EdsObject] = RIGHT.objects


def described_with(index: int, sub: int, **changes: object) -> dict[int, EdsObject]:
    """Return the objects of the EDS with one item changed."""
    described = OBJECTS[index]
    items = tuple(replace(item, **changes) if item.sub == sub else item for item in described.items)  # type: ignore[arg-type]
    return {**OBJECTS, index: replace(described, items=items)}
