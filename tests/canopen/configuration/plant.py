"""A small device as a DCF, as a simulated node, and what is written to it."""

from __future__ import annotations

from barewire.canopen import CanFrame, LocalNode, eds, pdos_of
from barewire.canopen.eds import Eds, EdsItem, EdsObject
from barewire.canopen.eds.value_syntax import Expression
from tests.canopen.virtual_bus import VirtualBus

VAR, ARRAY, RECORD = 7, 8, 9


def _record(index: int, name: str, *items: EdsItem, object_type: int = RECORD) -> EdsObject:
    highest = EdsItem(0, "highest sub-index", "u8", "const", default=max(item.sub for item in items))
    return EdsObject(index, name, object_type, (highest, *items))


def _variable(index: int, name: str, item: EdsItem) -> EdsObject:
    return EdsObject(index, name, VAR, (item,))


def _pdo(index: int, base: int, words: tuple[int, ...]) -> list[EdsObject]:
    mapping = [EdsItem(sub, f"entry {sub}", "u32", "rw", word) for sub, word in enumerate((*words, 0, 0)[:4], 1)]
    communication = _record(
        index,
        f"PDO {index:X}",
        EdsItem(1, "COB-ID", "u32", "rw", eds.Formula(base)),
        EdsItem(2, "type", "u8", "rw", 255),
        EdsItem(3, "inhibit time", "u16", "rw", 0),
        EdsItem(5, "event timer", "u16", "rw", 0),
    )
    count = EdsItem(0, "mapped objects", "u8", "rw", len(words))
    return [communication, EdsObject(index + 0x200, f"mapping {index:X}", RECORD, (count, *mapping))]


def _u32(sub: int, name: str, access: str = "rw", default: Expression = 0) -> EdsItem:
    return EdsItem(sub, name, "u32", access, default)  # type: ignore[arg-type]


OBJECTS = [
    _variable(0x1000, "Device type", _u32(0, "Device type", "ro", 0x191)),
    _variable(0x1001, "Error register", EdsItem(0, "Error register", "u8", "ro", 0)),
    _variable(0x1005, "COB-ID SYNC", _u32(0, "COB-ID SYNC", "rw", 0x80)),
    _variable(0x1006, "Cycle", _u32(0, "Cycle")),
    _record(0x1010, "Store", _u32(1, "Store all", "rw", 1)),
    _variable(0x1014, "COB-ID EMCY", _u32(0, "COB-ID EMCY", "rw", eds.Formula(0x80))),
    _record(0x1016, "Consumer", _u32(1, "Consumer 1"), _u32(2, "Consumer 2"), object_type=ARRAY),
    _variable(0x1017, "Heartbeat", EdsItem(0, "Heartbeat", "u16", "rw", 0)),
    _record(
        0x1018,
        "Identity",
        *(_u32(sub, name, "ro", value) for sub, name, value in ((1, "Vendor-ID", 0x360), (2, "Product", 7))),
        *(_u32(sub, name, "ro", value) for sub, name, value in ((3, "Revision", 0x10002), (4, "Serial", 99))),
    ),
    _variable(0x1019, "Overflow", EdsItem(0, "Overflow", "u8", "rw", 0)),
    _record(0x1020, "Configuration", _u32(1, "Date"), _u32(2, "Time")),
    *_pdo(0x1400, 0x200, (0x60400010,)),
    *_pdo(0x1800, 0x180, (0x60410010,)),
    *_pdo(0x1801, 0x280, (0x60410010,)),
    _variable(0x2000, "Password", EdsItem(0, "Password", "u16", "wo", 0)),
    _variable(0x2001, "Label", EdsItem(0, "Label", "string", "rw", "")),
    _variable(0x6040, "Controlword", EdsItem(0, "Controlword", "u16", "rw", 0, pdo=True)),
    _variable(0x6041, "Statusword", EdsItem(0, "Statusword", "u16", "ro", 0x37, pdo=True)),
    _variable(0x6064, "Position", EdsItem(0, "Position", "i32", "ro", -2, pdo=True)),
]
MODIFIED = {"FileName": "pump.eds", "ModificationDate": "06-28-2026", "ModificationTime": "02:05PM"}
DATE = {"Configuration.Date": 15519, "Configuration.Time": (14 * 60 + 5) * 60_000}


def described() -> Eds:
    """Return the EDS of the device, from which 5 DCFs differ."""
    return eds.compose(OBJECTS, MODIFIED, {"VendorName": "Example"})


def dcf(values: dict[tuple[int, int] | str, Expression], node: int = 5) -> Eds:
    return eds.to_dcf(described(), node, values)


def bus_with(node: int = 5, **values: int) -> tuple[VirtualBus, LocalNode]:
    """Return a bus with the device; `values` are present values, such as x1017_00=500."""
    objects = described().dictionary(node)
    for name, value in values.items():
        index, sub = name[1:].split("_")
        objects.set(int(index, 16), int(sub, 16), value)
    bus, device = VirtualBus(), LocalNode(node, objects, pdos_of(objects, node))
    bus.add(device, sent=device.start(0.0))
    bus.pass_time(0.01)
    bus.log.clear()
    return bus, device


def writes(bus: VirtualBus, node: int = 5) -> list[str]:
    """Return the expedited writes to a node, in order, as `1800:1=80000185`."""
    texts = []
    for _, text in bus.log:
        frame = CanFrame.parse(text)
        if frame.id == 0x600 + node and frame.data[0] in (0x23, 0x27, 0x2B, 0x2F):
            index, value = int.from_bytes(frame.data[1:3], "little"), int.from_bytes(frame.data[4:], "little")
            texts.append(f"{index:X}:{frame.data[3]:X}={value:X}")
    return texts
