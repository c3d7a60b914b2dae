"""The device that an EDS or DCF describes, so that it can stand where the name of a description does.

    [1017] ParameterName=Producer heartbeat time    "Producer heartbeat time"           a variable
    [1018sub1] ParameterName=Vendor-ID              "Identity Object / Vendor-ID"       an entry of a record or array
    [1400sub1], [1401sub1] both called COB-ID       "RPDO communication parameter / COB-ID (1400h:01)"
    [DeviceInfo] VendorNumber, 1000h, 1018h         [identity]: what the device must say it is
    storable objects, 1010h                         settings, and [settings]: what stores them

    DCF: ParameterValue=500                         configured_values(device)["Producer heartbeat time"] == 500

A value is the raw number: an EDS has no units and no scales.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from glob import escape
from types import MappingProxyType
from typing import Any

from barewire.canopen.eds import Eds
from barewire.canopen.eds.objects import REFUSES_READ, EdsItem, EdsObject, every_item
from barewire.canopen.eds.value_syntax import read_integer
from barewire.canopen.object_dictionary import Entry
from barewire.codecs import Value
from barewire.devices import Device, Parameter
from barewire.devices.device import CanopenSettings
from barewire.devices.parameter import ObjectAt, ParameterAccess, ParameterKind
from barewire.errors import fold
from barewire_workbench.eds.storable import formulas, storable

_TYPES = {"string": "text", "unicode": "text"}
"""The type of a value for types of objects whose name is another one."""
_KINDS: Mapping[str, ParameterKind] = {"ro": "measurement", "wo": "command"}
_WANTED = "configuration"
_DEVICE_TYPE, _IDENTITY = 0x1000, 0x1018
_STORE, _SAVE = (0x1010, 1), 0x65766173
"""Where all parameters are stored, and the letters "save", which do it.   [CiA 301 7.5.2.13]"""
_NUMBERS = {"vendor": (1, "VendorNumber"), "product": (2, "ProductNumber")}


def device_of_eds(eds: Eds, name: str, node: int) -> Device:
    """Return the device with the parameters of an EDS or DCF, for the node-ID `node`.

    >>> from barewire import load
    >>> from barewire_workbench.eds.export import export
    >>> drive = device_of_eds(export(load("az3")), "az3.eds", 5)
    >>> drive.find("target velocity"), drive.find("identity object / vendor-id")
    (<Parameter TARGET VELOCITY: rw i32, 60FFh:00>, <Parameter Identity object / Vendor-ID: ro u32, 1018h:01>)
    """
    items = [(described, item) for described, item in every_item(eds.objects.values())]
    counts = Counter(fold(_name(described, item)) for described, item in items)
    dictionary = eds.dictionary(node)
    settings, of_node = storable(eds, node), formulas(eds)
    parameters, wanted, alone = [], {}, {}
    restoring: dict[str, Any] = {"communication": [], "store": {}}
    for described, item in items:
        title = _name(described, item)
        if counts[fold(title)] > 1:
            title += f" ({described.index:04X}h:{item.sub:02X})"
        entry = dictionary.entry(described.index, item.sub)
        place = described.index, item.sub
        parameters.append(_parameter(title, entry, has_default=item.default is not None, is_setting=place in settings))
        if place in of_node:
            restoring["communication"].append(escape(title))
        if place == _STORE and parameters[-1].writable:
            restoring["store"] = {title: _SAVE}
        if item.value is not None:
            wanted[title] = dictionary.get(described.index, item.sub)
        if item.type == "domain" or item.flags & REFUSES_READ:
            alone[title] = "a domain may be long" if item.type == "domain" else "its ObjFlags want no scan to read it"
    texts = (eds.get("DeviceInfo", key) or "" for key in ("VendorName", "ProductName"))
    extra = {
        _WANTED: MappingProxyType(wanted),
        "read_alone": MappingProxyType(alone),
        "identity": _identity(eds),
        "settings": restoring,
    }
    return Device(
        name=name,
        title=" ".join(text for text in texts if text) or name,
        parameters=tuple(parameters),
        documents=(name,),
        canopen=CanopenSettings(node=node),
        extra=MappingProxyType(extra),
    )


def configured_values(device: Device) -> Mapping[str, Value]:
    """Return the values of a DCF by the names of the parameters; of any other device nothing."""
    wanted: Mapping[str, Value] = device.extra.get(_WANTED, {})
    return wanted


def _name(described: EdsObject, item: EdsItem) -> str:
    return " ".join((f"{described.name} / {item.name}" if described.is_record else item.name).split())


def _parameter(name: str, entry: Entry, *, has_default: bool, is_setting: bool) -> Parameter:
    access: ParameterAccess = "ro" if entry.access == "const" else entry.access
    own_type = _TYPES.get(entry.type)
    is_number = entry.codec.size is not None
    return Parameter(
        name,
        own_type or entry.type,
        default=entry.default if has_default else None,
        minimum=entry.minimum if is_number else None,
        maximum=entry.maximum if is_number else None,
        access=access,
        kind="setting" if is_setting else _KINDS.get(access, "command"),
        storable=is_setting,
        group=_group(entry.index),
        object=ObjectAt(entry.index, entry.sub, type=entry.type if own_type else ""),
    )


def _group(index: int) -> str:
    """Return the part of the object dictionary.   [CiA 301, object dictionary]

    >>> [_group(index) for index in (0x1018, 0x1600, 0x2000, 0x6040)]
    ['communication', 'PDOs', 'manufacturer', 'device profile']
    """
    if index < 0x2000:
        return "PDOs" if 0x1400 <= index < 0x1C00 else "communication"
    return "manufacturer" if index < 0x6000 else "device profile" if index < 0xA000 else "interface profile"


def _identity(eds: Eds) -> Mapping[str, int]:
    """Return the table [identity] of the device. A number that is 0 is not known: files say that of many devices."""
    defaults = {(described.index, item.sub): item.default for described, item in every_item(eds.objects.values())}
    numbers = {"device_type": defaults.get((_DEVICE_TYPE, 0))}
    for key, (sub, in_head) in _NUMBERS.items():
        numbers[key] = defaults.get((_IDENTITY, sub)) or _head_number(eds, in_head)
    return MappingProxyType({key: number for key, number in numbers.items() if isinstance(number, int) and number})


def _head_number(eds: Eds, key: str) -> int | None:
    return read_integer(eds.get("DeviceInfo", key) or "").value
