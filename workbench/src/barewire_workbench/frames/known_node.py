"""The description of a node: the names and types of its objects, and the factory setting of its PDOs.

of_device(load("az3"), 5)               from the catalogue: names, units, named values and bits
of_dictionary(dictionary, 5)            from an EDS or DCF: names and types
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from barewire.canopen.cob_ids import check_node, classify
from barewire.canopen.datatypes import TimeDifference, TimeOfDay, object_codec
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.pdo.config import PdoConfig, PdoDirection, pdos_of
from barewire.canopen.pdo.mapping import PdoMapping
from barewire.canopen.sdo.dialect import STANDARD
from barewire.codecs import Value
from barewire.devices.device import Device
from barewire.devices.parameter import Parameter, show
from barewire.devices.sdo_dialects import DIALECTS
from barewire.errors import BarewireError, EncodeError


class KnownObject(NamedTuple):
    """One object. A `parameter` adds a unit, a scale, and named values."""

    name: str
    type: str
    parameter: Parameter | None = None

    def value(self, raw: Value) -> Value:
        """Return the scaled value of a raw number."""
        return raw if self.parameter is None else self.parameter.from_raw(raw)

    def text(self, raw: Value) -> str:
        """Return the value of a raw number as text, with its unit."""
        if self.parameter is not None:
            return self.parameter.text(self.parameter.from_raw(raw))
        if isinstance(raw, bytes):
            return raw.hex(" ").upper()
        if isinstance(raw, TimeOfDay):
            return str(raw.datetime)
        if isinstance(raw, TimeDifference):
            return str(raw.timedelta)
        return repr(raw) if isinstance(raw, str) else show(raw, self.type)

    def read(self, data: bytes) -> str:
        """Return the value of the object from its bytes, as text; empty if they do not fit its type."""
        try:
            if self.parameter is not None and self.type != "text":
                return self.parameter.text(self.parameter.from_object(data))
            return self.text(object_codec("string" if self.type == "text" else self.type).decode(data))
        except BarewireError:
            return ""


class KnownPdo(NamedTuple):
    """The PDO of a node. Without a description of the node its mapping is not known."""

    node: int
    name: str
    mapping: PdoMapping | None


class KnownNode(NamedTuple):
    """One node: its objects by index and sub-index, and the factory setting of its PDOs."""

    node: int
    title: str
    objects: Mapping[tuple[int, int], KnownObject]
    pdos: tuple[PdoConfig, ...]
    commands: tuple[int, ...] = ()
    """Command bytes of its requests that differ from the standard."""


def of_device(device: Device, node: int | None = None) -> KnownNode:
    """Return a device of the catalogue with this node-ID, or its own. Raises EncodeError if it has no CANopen.

    >>> from barewire.devices import load
    >>> known = of_device(load("az3"), 5)
    >>> known.objects[0x6041, 0].name, [pdo.direction for pdo in known.pdos][:2]
    ('STATUS WORD', ['RPDO', 'RPDO'])
    """
    if device.canopen is None:
        raise EncodeError(f"{device.name} has no CANopen in its description")
    number = check_node(device.canopen.node if node is None else node)
    objects: dict[tuple[int, int], KnownObject] = {}
    for parameter in device.parameters:
        place = parameter.object
        if place is not None and place.bit is None:
            objects.setdefault((place.index, place.sub), KnownObject(parameter.name, parameter.type, parameter))
    pdos = []
    for described in device.canopen.pdos:
        owner = classify(CanFrame(described.cob_id + number))
        if owner is None or "PDO" not in owner[0].name:
            continue
        direction: PdoDirection = "TPDO" if owner[0].name.startswith("T") else "RPDO"
        words = tuple(index << 16 | sub << 8 | bits for index, sub, bits in described.map)
        pdos.append(PdoConfig(direction, int(owner[0].name[4:]), words, described.transmission))
    dialect = DIALECTS.get(device.canopen.dialect, STANDARD)
    commands = tuple(command for _, command in dialect.read_commands)
    return KnownNode(number, device.title, objects, tuple(pdos), commands)


def of_dictionary(objects: ObjectDictionary, node: int, title: str = "") -> KnownNode:
    """Return a node described by an object dictionary, such as one read from an EDS."""
    known = {(entry.index, entry.sub): KnownObject(entry.name, entry.type) for entry in objects}
    for entry in objects:
        if entry.object_name and entry.sub and entry.object_name != entry.name:
            known[entry.index, entry.sub] = KnownObject(f"{entry.object_name}.{entry.name}", entry.type)
    return KnownNode(check_node(node), title, known, tuple(pdos_of(objects, node)))
