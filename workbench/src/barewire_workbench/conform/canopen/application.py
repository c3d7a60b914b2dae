"""Conformance cases that write the application objects of an EDS, 2000h to 9FFFh, with other values than they have.

        OD-RANGE-2000:00     its limits, and values between them, are accepted and read back      [CiA 301 7.4, CiA 306]
        RND-05               50 reads of application objects in random order                      [CiA 301 7.2.4]
        RND-06               50 writes in random order, each followed by a read

The values of a number with LowLimit and HighLimit are both limits and three values between them. The EDS does not say
which others are safe: an object without limits gets its DefaultValue, a BOOLEAN both values. The controlword of each
axis of a drive is never written, since it switches the power stage on; bit 0 of ObjFlags leaves out others. After each
case, `restore_values` gives the objects the values that they had.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Final

from barewire.canopen.datatypes import object_codec
from barewire.canopen.eds.objects import EdsObject, every_item
from barewire_workbench.conform.canopen.eds_objects import DescribedItem, read_steps, write_steps
from barewire_workbench.conform.canopen.frames import READ_ONLY_CODES, Sdo, make_case
from barewire_workbench.conform.canopen.model import NodeCase, NodeStep, Subject
from barewire_workbench.conform.canopen.random_order import irregular

_CONTROLWORDS: Final = frozenset(range(0x6040, 0xA000, 0x0800))
"""6040h, and those of the axes 2 to 8 of a drive: 6840h, 7040h, ...   [CiA 402-2]"""
_OTHERS_FORBID = (0x0604_0043, 0x0604_0047, 0x0609_0036, *READ_ONLY_CODES)
"""The value does not go with those of other objects (06090036: a maximum below the minimum); OD-WRITE reports 0601."""
_RANDOM_ORDER = "CiA 301 7.2.4 SDO in random order"


def application_cases(subject: Subject, objects: Mapping[int, EdsObject]) -> Iterator[NodeCase]:
    """Yield the cases of the application objects that the EDS describes, for one device."""
    described = [DescribedItem(subject, of, item) for of, item in every_item(objects.values()) if of.index >= 0x2000]
    order = irregular(subject.node)
    writable = {item: values for item in described if (values := _values(item, order))}
    for item, values in writable.items():
        steps = [step for value in values for step in (*_write(item, value), *read_steps(item.s, *item.place, value))]
        listed = f"{len(values)} value{'s' * (len(values) > 1)}"
        title = f"accepts {listed} within its limits, and keeps them" if len(values) > 1 else "accepts its default"
        yield item.case("RANGE", title, *steps, effect="application", why="or the state of the device forbids it")
    yield from _random_order(subject, described, writable, order)


def _random_order(
    subject: Subject, described: list[DescribedItem], writable: dict[DescribedItem, list[bytes]], order: Iterator[int]
) -> Iterator[NodeCase]:
    s = Sdo(subject.node)
    readable = [item for item in described if item.value and len(item.value) <= 4]
    reads = [_read(readable[next(order) % len(readable)]) for _ in range(50 if readable else 0)]
    case = partial(make_case, subject, _RANDOM_ORDER, (s.responses,))
    reading = case("RND-05", "50 reads of application objects in random order", *(reads or [s.works]), effect="reads")
    yield reading._replace(lacks="" if readable else "a readable object from 2000h on")
    short = [item for item in writable if item.value and len(item.value) == item.size and item.size <= 4]
    steps: list[NodeStep] = []
    for _ in range(50 if short else 0):
        item = short[next(order) % len(short)]
        values = writable[item]
        (step,) = _write(item, values[next(order) % len(values)])
        steps += [step._replace(accepts=(*step.accepts, *step.ends), ends=()), _read(item)]
    writing = case("RND-06", "50 writes of application objects in random order", *(steps or [s.works]),
                   effect="application", why="or the state of the device forbids it")  # fmt: skip
    yield writing._replace(lacks="" if short else "a writable object from 2000h on")


def _values(item: DescribedItem, order: Iterator[int]) -> list[bytes]:
    """Return the values that an object is given: those that the EDS names, and some between its limits."""
    described, low, high = item.item, *(item.at_node(limit) for limit in item.item.limits)
    if described.access not in ("rw", "rww", "rwr") or described.flags & 3 or item.index in _CONTROLWORDS:
        return []
    if item.size is None:
        return []
    found: list[bytes | None] = [item.encoded(described.default)]
    if described.type == "bool":
        found = [b"\0", b"\1"]
    elif isinstance(low, int) and isinstance(high, int) and low <= high:
        between = [low + next(order) % (high - low + 1) for _ in range(3)]
        found = [item.encoded(value) for value in (low, *between, high)]
    elif isinstance(low, (int, float)) and isinstance(high, (int, float)) and low <= high:
        found = [item.encoded(value) for value in (low, low + (high - low) / 2, high)]
        # The nearest REAL32 of a limit such as 1E21 may lie beyond it.
        codec = object_codec(described.type)
        found = [data for data in found if data and low <= float(codec.decode(data)) <= high]
    return list(dict.fromkeys(data for data in found if data))


def _write(item: DescribedItem, value: bytes) -> list[NodeStep]:
    """Return the steps of a write, which may end with a refusal that other objects are the reason of."""
    refused = item.s.refused(*item.place, *_OTHERS_FORBID)
    return [step._replace(ends=(*step.ends, refused)) for step in write_steps(item.s, *item.place, value)]


def _read(item: DescribedItem) -> NodeStep:
    """Return the step that reads any value of the length that the object has."""
    return NodeStep((item.s.upload(*item.place),), (item.s.sized(*item.place, len(item.value or b"0000")),))
