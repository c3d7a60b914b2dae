"""The devices that a hostile master configures: of an EDS, of one in which everything is mappable, and simulators."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from barewire.canopen import Entry, LocalNode, pdos_of
from barewire.canopen.communication_objects import standard_objects
from barewire.canopen.eds import EdsItem, EdsObject, compose, parse
from barewire.devices.sim import simulator
from tests.model.hostile_master import HostileMaster

NODE = 5
SIMULATED = ("az3",)
"""The simulated devices that have CANopen."""
SLOTS = 4
"""Mapped objects of a PDO."""


def described() -> list[Entry]:
    """Return the objects of the device: every communication object, and application objects of several types."""
    objects = [*standard_objects(name="hostile device", heartbeat=1000, watched=2, emcy_consumers=1, servers=2)]
    objects += [Entry(0x1010, 1, "store", "u32"), Entry(0x1011, 1, "restore", "u32")]
    for number, type in enumerate(("bool", "u8", "i16", "u32", "f32", "u64")):
        objects.append(Entry(0x2001 + number, 0, f"value {number}", type))
    objects.append(Entry(0x2007, 0, "program", "domain", "rw", b""))
    objects += [Entry(0x2010, 0, "measured", "u16", "ro"), Entry(0x2011, 0, "command", "u8", "wo")]
    for record, mapping, identifier in ((0x1400, 0x1600, 0x205), (0x1800, 0x1A00, 0x185)):
        rows = (1, "u32", identifier), (2, "u8", 255), (3, "u16", 0), (5, "u16", 0), (6, "u8", 0)
        objects += [Entry(record, sub, f"parameter {sub}", type, "rw", value) for sub, type, value in rows]
        objects.append(Entry(mapping, 0, "entries", "u8", "rw", 1))
        objects += [Entry(mapping, sub, f"entry {sub}", "u32", "rw", 0) for sub in range(2, SLOTS + 1)]
        objects.append(Entry(mapping, 1, "entry 1", "u32", "rw", 0x2003_0010))
    return objects


def eds_text(*, all_mappable: bool) -> bytes:
    """Return an EDS of these objects. `all_mappable` writes PDOMapping=1 at every object, which CiA 306 allows."""
    indices: dict[int, list[Entry]] = {}
    for entry in sorted(described(), key=lambda entry: (entry.index, entry.sub)):
        indices.setdefault(entry.index, []).append(entry)
    objects = []
    for index, entries in indices.items():
        is_variable = [entry.sub for entry in entries] == [0]
        items = [
            EdsItem(
                entry.sub,
                entry.name,
                entry.type,
                entry.access,
                default=None if entry.type == "domain" else entry.default,
                pdo=all_mappable or index >= 0x2000,
            )
            for entry in entries
        ]
        if items[0].sub:
            items.insert(0, EdsItem(0, "highest sub-index", "u8", "ro", default=entries[-1].sub))
        objects.append(EdsObject(index, f"object {index:X}", 7 if is_variable else 9, tuple(items)))
    return compose(objects, {"FileName": "hostile.eds"}).encode()


def device_of_eds(*, all_mappable: bool) -> LocalNode:
    """Return the device of that EDS, as `CanopenServer` makes it."""
    objects = parse(eds_text(all_mappable=all_mappable)).dictionary(NODE)
    return LocalNode(NODE, objects, pdos_of(objects, NODE))


def _forget_saved(adapter: Any) -> None:
    adapter.machine.store.saved = {}


def masters() -> dict[str, Callable[[], HostileMaster]]:
    """Return a function for each device that makes a master of a new one."""

    def of_eds(*, all_mappable: bool) -> HostileMaster:
        return HostileMaster(
            lambda: device_of_eds(all_mappable=all_mappable), local=lambda device: device, forget=lambda device: None
        )

    def simulated(name: str) -> HostileMaster:
        def make() -> Any:
            return simulator(name, node=NODE).canopen

        return HostileMaster(make, local=lambda adapter: adapter.node, forget=_forget_saved)

    return {
        "EDS": lambda: of_eds(all_mappable=False),
        "EDS, all mappable": lambda: of_eds(all_mappable=True),
        **{name: partial(simulated, name) for name in SIMULATED},
    }
