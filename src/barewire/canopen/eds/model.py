"""The objects of an EDS as values, and the object dictionary that a device makes of them.

[1018]     ObjectType=9 ParameterName=Identity       EdsObject(1018h, "Identity", 9, items)
[1018sub1] DataType=7 ParameterName=Vendor-ID            '-- EdsItem(1, "Vendor-ID", "u32", ...)
                                                                '-- Entry(1018h, 1, ...) of the dictionary
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from barewire.canopen.cob_ids import check_node
from barewire.canopen.datatypes import object_codec
from barewire.canopen.eds.value_syntax import Expression, Formula
from barewire.canopen.object_dictionary import Entry, ObjectAccess, ObjectDictionary
from barewire.codecs import Value
from barewire.errors import EncodeError

DOMAIN, DEFTYPE, DEFSTRUCT, VAR, ARRAY, RECORD = 2, 5, 6, 7, 8, 9
"""Object types, without NULL (0)."""

EdsAccess = Literal["ro", "wo", "rw", "rwr", "rww", "const"]

MAPPABLE: dict[EdsAccess, tuple[Literal["RPDO", "TPDO"], ...]] = {
    "ro": ("TPDO",),
    "const": ("TPDO",),
    "rwr": ("TPDO",),
    "wo": ("RPDO",),
    "rww": ("RPDO",),
    "rw": ("RPDO", "TPDO"),
}
"""The PDOs that an object of this access may be mapped to, if it may be mapped."""


@dataclass(frozen=True, slots=True)
class EdsItem:
    """The description of one sub-index of an object. `code` is the number of DataType, `type` its meaning."""

    sub: int
    name: str
    type: str
    access: EdsAccess = "rw"
    default: Expression | None = None
    low: int | float | Formula | None = None
    high: int | float | Formula | None = None
    pdo: bool = False
    value: Expression | None = None
    denotation: str = ""
    flags: int = 0
    code: int = 0
    object_type: int = VAR

    @property
    def limits(self) -> tuple[int | float | Formula | None, int | float | Formula | None]:
        """The lowest and the highest value."""
        return self.low, self.high


@dataclass(frozen=True, slots=True)
class EdsObject:
    """One object; a variable has one item, sub-index 0. `line` is that of its section, 0 if CompactPDO implies it."""

    index: int
    name: str
    object_type: int
    items: tuple[EdsItem, ...]
    line: int = 0
    compact: bool = False

    def __repr__(self) -> str:
        entries = f"{len(self.items)} entr{'y' if len(self.items) == 1 else 'ies'}"
        return f"<EdsObject {self.index:04X}h {self.name}: {entries}>"

    @property
    def is_record(self) -> bool:
        """Whether the object has sub-indices."""
        return self.object_type in (ARRAY, RECORD, DEFSTRUCT)

    def item(self, sub: int = 0) -> EdsItem:
        """Return the item of a sub-index. Raise EncodeError if there is none."""
        for item in self.items:
            if item.sub == sub:
                return item
        raise EncodeError(f"{self.index:04X}h {self.name} has no sub-index {sub:02X}h")


def every_item(objects: Iterable[EdsObject]) -> Iterator[tuple[EdsObject, EdsItem]]:
    """Yield all items that have a value. Items of DEFTYPE and DEFSTRUCT have none: they describe types."""
    for described in objects:
        if described.object_type not in (DEFTYPE, DEFSTRUCT):
            for item in described.items:
                yield described, item


def to_dictionary(objects: Iterable[EdsObject], node: int | None) -> ObjectDictionary:
    """Return the object dictionary of a node, with each ParameterValue as the present value.

    Raise EncodeError if `node` is None and a formula needs it.
    """
    if node is not None:
        check_node(node)
    items = list(every_item(objects))
    dictionary = ObjectDictionary(_entry(described, item, node) for described, item in items)
    for described, item in items:
        value = _evaluated(item.value, described.index, item.sub, node)
        if value is not None and _fits(value, item.type):
            dictionary.set(described.index, item.sub, value)
    return dictionary


def _entry(described: EdsObject, item: EdsItem, node: int | None) -> Entry:
    place = described.index, item.sub
    default = _evaluated(item.default, *place, node)
    low, high = _evaluated(item.low, *place, node), _evaluated(item.high, *place, node)
    access: ObjectAccess = "rw" if item.access == "rwr" or item.access == "rww" else item.access
    return Entry(
        *place,
        item.name,
        item.type,
        access,
        default if default is not None and _fits(default, item.type) else 0,
        low if isinstance(low, (int, float)) else None,
        high if isinstance(high, (int, float)) else None,
        object_name=described.name if described.is_record else "",
        mappable=MAPPABLE[item.access] if item.pdo else (),
    )


def _evaluated(value: Expression | None, index: int, sub: int, node: int | None) -> Value | None:
    if not isinstance(value, Formula):
        return value
    if node is None:
        raise EncodeError(f"{index:04X}h:{sub:02X} is {value}: a node-ID is needed")
    return value.at(node)


def _fits(value: Value, type: str) -> bool:
    try:
        object_codec(type).encode(value)
    except EncodeError:
        return False
    return True
