"""Exports a device description as an EDS, for tools that read no other format.

        Parameter  name, type, range, default, access  --.
        several of one index, with sub-indices         ---+--> EdsObject --> compose --> document --> bytes
        bits of one object                             --'
        CanopenSettings.pdos  the device has PDOs      ----> PDOMapping=1 for what fits into a PDO, 8 mapping entries

An EDS has raw numbers, so ranges and defaults lose scale and unit. COB-IDs of PDO records become formulas of the
node-ID again. Fields that the description does not have get neutral values: the name of a record is the common
beginning of the names of its entries, vendor and product are 0. The objects of every node (1000h, 1001h, 1018h) are
added.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import takewhile

from barewire.canopen.eds import Eds, EdsItem, EdsObject, Formula, compose
from barewire.canopen.eds.objects import RECORD, REFUSES_WRITE, VAR
from barewire.codecs import Value
from barewire.devices.device import Device
from barewire.devices.parameter import ObjectAt, Parameter
from barewire.errors import EncodeError

_SERVO_DRIVE = 0x0002_0192
"""Device type: profile 402, servo drive. A device without a status word has 0, no profile."""

_STATUS_WORD = 0x6041
_COMMUNICATION_RECORDS = (*range(0x1400, 0x1600), *range(0x1800, 0x1A00))
_MAPPING_RECORDS = (*range(0x1600, 0x1800), *range(0x1A00, 0x1C00))
_MAPPING_ENTRIES = 8
"""A description has the objects that are mapped by default; the record has as many sub-indices as eight bytes need."""
_APPLICATION = 0x2000
_RATE = re.compile(r"([0-9]+) ([kM])bit/s")
_RATES = (10_000, 20_000, 50_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)


def export(device: Device, file_name: str = "") -> Eds:
    """Return the EDS of a device. Raises EncodeError if its description has no CANopen.

    >>> from barewire.devices import load
    >>> document = export(load("az3"))
    >>> document.get("6041", "ParameterName"), document.get("1400sub1", "DefaultValue"), document.diagnostics
    ('STATUS WORD', '$NODEID+0x200', ())
    """
    if device.canopen is None:
        raise EncodeError(f"{device.name} has no CANopen in its description")
    objects = {described.index: described for described in (*_mandatory_objects(device), *_described_objects(device))}
    rates = {device.canopen.bitrate, *_selectable_rates(device)}
    receive = sum(0x1400 <= index < 0x1600 for index in objects)
    transmit = sum(0x1800 <= index < 0x1A00 for index in objects)
    return compose(
        objects.values(),
        {
            "FileName": file_name or f"{device.name}.eds",
            "FileVersion": "1",
            "FileRevision": "1",
            "EDSVersion": "4.0",
            "Description": device.title,
            "CreatedBy": "barewire",
            "CreationTime": "12:00AM",
            "CreationDate": "01-01-1984",
            "ModificationTime": "12:00AM",
            "ModificationDate": "01-01-1984",
            "ModifiedBy": "barewire",
        },
        {
            "ProductName": device.title,
            **{f"BaudRate_{rate // 1000}": str(int(rate in rates)) for rate in _RATES},
            "SimpleBootUpSlave": "1",
            "Granularity": "8",
            "NrOfRXPDO": str(receive),
            "NrOfTXPDO": str(transmit),
        },
        comments=[f"From: {document}" for document in device.documents],
    )


def _selectable_rates(device: Device) -> Iterator[int]:
    """Yield the bit rates among the named values of parameters, such as "7: 500 kbit/s"."""
    for parameter, _ in _on_canopen(device):
        for text in parameter.values.values():
            if match := _RATE.fullmatch(text):
                yield int(match[1]) * (1_000_000 if match[2] == "M" else 1000)


def _mandatory_objects(device: Device) -> Iterator[EdsObject]:
    """Yield the objects of every node. Objects of the description replace them."""
    is_servo = any(place.index == _STATUS_WORD for _, place in _on_canopen(device))
    profile = _SERVO_DRIVE if is_servo else 0
    yield _variable(0x1000, EdsItem(0, "Device type", "u32", "ro", profile))
    yield _variable(0x1001, EdsItem(0, "Error register", "u8", "ro", 0))
    vendor = EdsItem(1, "Vendor-ID", "u32", "ro", 0)
    yield EdsObject(0x1018, "Identity object", RECORD, (_highest_sub(1), vendor))


def _described_objects(device: Device) -> Iterator[EdsObject]:
    """Yield one object for each index of the parameters."""
    by_index: dict[int, dict[int, Parameter]] = {}
    for parameter, place in _on_canopen(device):
        by_index.setdefault(place.index, {}).setdefault(place.sub, parameter)
    has_pdos = device.canopen is not None and bool(device.canopen.pdos)
    for index, subs in sorted(by_index.items()):
        mappable = has_pdos and index >= _APPLICATION
        items = [_item(device, parameter, index, sub, mappable) for sub, parameter in sorted(subs.items())]
        if [*subs] == [0]:
            yield _variable(index, items[0])
            continue
        if 0 not in subs:
            first = EdsItem(0, "Number of mapped objects", "u8", "rw", len(items))
            items.insert(0, first if index in _MAPPING_RECORDS else _highest_sub(max(subs)))
        if index in _MAPPING_RECORDS:
            unused = range(max(subs) + 1, _MAPPING_ENTRIES + 1)
            items += [EdsItem(sub, f"Mapped object {sub}", "u32", "rw", 0) for sub in unused]
        yield EdsObject(index, _record_name(index, subs.values()), RECORD, tuple(items))


def _on_canopen(device: Device) -> list[tuple[Parameter, ObjectAt]]:
    """Return the parameters with their objects, whole objects first: they are exported instead of their bits."""
    placed = [(parameter, place) for parameter in device.parameters if (place := parameter.object) is not None]
    return sorted(placed, key=lambda pair: pair[1].bit is not None)


def _variable(index: int, item: EdsItem) -> EdsObject:
    return EdsObject(index, item.name, VAR, (item,))


def _highest_sub(sub: int) -> EdsItem:
    return EdsItem(0, "Highest sub-index supported", "u8", "const", sub)


def _record_name(index: int, parameters: Iterable[Parameter]) -> str:
    columns = zip(*(parameter.name.split() for parameter in parameters))
    common = " ".join(words[0] for words in takewhile(lambda words: len({*words}) == 1, columns))
    if index in _COMMUNICATION_RECORDS or index in _MAPPING_RECORDS:
        kind = "communication" if index in _COMMUNICATION_RECORDS else "mapping"
        return f"{common.partition(' ')[0]} {kind} parameter".strip()
    return common or f"Object {index:04X}h"


def _item(device: Device, parameter: Parameter, index: int, sub: int, mappable: bool) -> EdsItem:
    if parameter.object is not None and parameter.object.bit is not None:
        return EdsItem(sub, f"Bits of {index:04X}h", "u16", "rw", pdo=mappable, flags=REFUSES_WRITE)
    default: Value | Formula | None = None if parameter.default is None else parameter.to_raw(parameter.default)
    if index in _COMMUNICATION_RECORDS and sub == 1 and isinstance(default, int) and device.canopen is not None:
        default = Formula(default - device.canopen.node)
    type = "string" if parameter.type == "text" else parameter.object_type
    low, high = (_limit(parameter, limit) for limit in (parameter.minimum, parameter.maximum))
    # A configuration by a DCF must not write commands, targets and measurements.
    flags = REFUSES_WRITE if parameter.writable and parameter.kind != "setting" else 0
    return EdsItem(
        sub, parameter.name, type, parameter.access, default, low, high, mappable and type != "string", flags=flags
    )


def _limit(parameter: Parameter, limit: int | float | None) -> int | float | None:
    """Return a limit as a raw number. None for a text: its limits are lengths, for which an EDS has no key."""
    if limit is None or parameter.type == "text":
        return None
    raw = parameter.to_raw(limit)
    return raw if isinstance(raw, (int, float)) else None
