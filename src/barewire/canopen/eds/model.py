"""The objects that the sections of an EDS tell of, and the object dictionary that a device makes of them.

        [1018]     ObjectType=9 ParameterName=Identity       EdsObject(1018h, "Identity", 9, items)
        [1018sub1] DataType=7 ParameterName=Vendor-ID            '-- Item(1, "Vendor-ID", "u32", ...)
                                                                        '-- Entry(1018h, 1, ...) of the dictionary

        own sections [hhhh] [hhhhsubN]  --.
        CompactSubObj, [hhhhName]       ---+--> EdsObject
        CompactPDO, NrOfRxPDO           --'

What is doubtful is read somehow, and reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from barewire.canopen.cob_ids import check_node
from barewire.canopen.datatypes import BY_CODE, RECORDS, object_codec
from barewire.canopen.eds.diagnostics import Diagnostic
from barewire.canopen.eds.value_syntax import Expression, Formula, read_integer
from barewire.canopen.object_dictionary import Entry, ObjectAccess, ObjectDictionary
from barewire.codecs import Value
from barewire.errors import EncodeError

if TYPE_CHECKING:
    from barewire.canopen.eds.document import Document

DOMAIN, DEFTYPE, DEFSTRUCT, VAR, ARRAY, RECORD = 2, 5, 6, 7, 8, 9
"""Object types. NULL, 0, is none."""

EdsAccess = Literal["ro", "wo", "rw", "rwr", "rww", "const"]

MAPPABLE: dict[EdsAccess, tuple[Literal["RPDO", "TPDO"], ...]] = {
    "ro": ("TPDO",),
    "const": ("TPDO",),
    "rwr": ("TPDO",),
    "wo": ("RPDO",),
    "rww": ("RPDO",),
    "rw": ("RPDO", "TPDO"),
}
"""In which PDOs an object of this access may stand, if it may at all."""


@dataclass(frozen=True, slots=True)
class EdsItem:
    """What an EDS tells of one index and sub-index. `code` is the DataType as it stands, `type` what it means."""

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
    """One object: a variable has one item, sub-index 0. `line` is that of its section, 0 if it is only implied."""

    index: int
    name: str
    object_type: int
    items: tuple[EdsItem, ...]
    line: int = 0
    compact: bool = False

    @property
    def is_record(self) -> bool:
        """Whether it has sub-indices."""
        return self.object_type in (ARRAY, RECORD, DEFSTRUCT)

    def item(self, sub: int = 0) -> EdsItem:
        """One sub-index; EncodeError if there is none."""
        for item in self.items:
            if item.sub == sub:
                return item
        raise EncodeError(f"{self.index:04X}h {self.name} has no sub-index {sub:02X}h")


def read_objects(document: Document, found: list[Diagnostic]) -> dict[int, EdsObject]:
    """All objects, in the order of their indices. What is odd is added to `found`."""
    from barewire.canopen.eds.compact import implied_pdos
    from barewire.canopen.eds.reader import Reader

    reader = Reader(document, found)
    objects = {index: reader.object(index) for index in sorted(reader.indices)}
    reader.heads()
    reader.lists(objects)
    for implied in implied_pdos(reader, objects):
        objects[implied.index] = implied
    return dict(sorted(objects.items()))


# The dictionary


def to_dictionary(document: Document, node_id: int | None) -> ObjectDictionary:
    """See `Document.dictionary`."""
    node = commissioned_node(document) if node_id is None else node_id
    if node is not None:
        check_node(node)
    dictionary = ObjectDictionary(entries(document, node))
    for item_of, item in every_item(document):
        value = _counted(item.value, item_of.index, item.sub, node)
        if value is not None and _fits(value, item.type):
            dictionary.set(item_of.index, item.sub, value)
    return dictionary


def commissioned_node(document: Document) -> int | None:
    """The node-ID of [DeviceComissioning], None if there is none that can be."""
    number = read_integer(document.get("DeviceComissioning", "NodeID") or "").value
    return number if number is not None and 1 <= number <= 127 else None


def every_item(document: Document) -> Iterator[tuple[EdsObject, EdsItem]]:
    """All that have a value of their own: no DEFTYPE and DEFSTRUCT, which tell of types."""
    for described in document.objects.values():
        if described.object_type not in (DEFTYPE, DEFSTRUCT):
            for item in described.items:
                yield described, item


def entries(document: Document, node: int | None) -> Iterator[Entry]:
    """The entries of the dictionary for a node. EncodeError for a formula without one."""
    for described, item in every_item(document):
        place = described.index, item.sub
        default = _counted(item.default, *place, node)
        low, high = _counted(item.low, *place, node), _counted(item.high, *place, node)
        access: ObjectAccess = "rw" if item.access == "rwr" or item.access == "rww" else item.access
        yield Entry(
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


def _counted(value: Expression | None, index: int, sub: int, node: int | None) -> Value | None:
    if not isinstance(value, Formula):
        return value
    if node is None:
        raise EncodeError(f"{index:04X}h:{sub:02X} is {value}: say for which node")
    return value.at(node)


def _fits(value: Value, type: str) -> bool:
    try:
        object_codec(type).encode(value)
    except EncodeError:
        return False
    return True


def data_type_name(code: int) -> str:
    """The standard's name of a data type.

    >>> data_type_name(7), data_type_name(0x21), data_type_name(0xA0)
    ('UNSIGNED32', 'PDO_MAPPING', '00A0h')
    """
    return BY_CODE[code].standard if code in BY_CODE else RECORDS.get(code, f"{code:04X}h")
