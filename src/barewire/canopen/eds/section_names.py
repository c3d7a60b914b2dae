"""The names of an EDS: its sections and their keys, and other spellings of them.   [CiA 306]

        [FileInfo] [DeviceInfo] [DummyUsage] [Comments]               heads
        [MandatoryObjects] [OptionalObjects] [ManufacturerObjects]    lists      1=0x1000
        [1018]        an object                                       [1018sub1]  one sub-index of it, in hexadecimal
        [1003Name] [1003Value] [1003Denotation]                       of sub-indices made by CompactSubObj
        [M1ModuleInfo] [M1Fixed6000] ...                              modules: kept, not read

Files differ in capitals, so names are compared in lower case: `SectionName.key`, `KeyName.key`.
"""

from __future__ import annotations

import re
from typing import Literal, NamedTuple

SectionKind = Literal["head", "list", "object", "sub", "compact", "module", "unknown"]

FILE_INFO = [
    *("FileName", "FileVersion", "FileRevision", "EDSVersion", "Description"),
    *("CreationTime", "CreationDate", "CreatedBy", "ModificationTime", "ModificationDate", "ModifiedBy"),
]
BAUD_RATES = [f"BaudRate_{rate}" for rate in (10, 20, 50, 125, 250, 500, 800, 1000)]
DEVICE_INFO = [
    *("VendorName", "VendorNumber", "ProductName", "ProductNumber", "RevisionNumber", "OrderCode"),
    *BAUD_RATES,
    *("SimpleBootUpMaster", "SimpleBootUpSlave", "Granularity", "DynamicChannelsSupported", "GroupMessaging"),
    *("NrOfRXPDO", "NrOfTXPDO", "LSS_Supported"),
]
_OBSOLETE_KEYS = [
    *("ProductVersion", "ProductRevision", "LMT_ManufacturerName", "LMT_ProductName"),
    *("ExtendedBootUpMaster", "ExtendedBootUpSlave"),
]
"""Keys of [DeviceInfo] that older versions had [CiA 306 4.5]."""
COMMISSIONING = ["NodeID", "NodeName", "Baudrate", "NetNumber", "NetworkName", "CANopenManager", "LSS_SerialNumber"]
LISTS = ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")
OBJECT = [
    *("ParameterName", "ObjectType", "DataType", "AccessType", "LowLimit", "HighLimit", "DefaultValue", "PDOMapping"),
    *("SubNumber", "ObjFlags", "CompactSubObj", "ParameterValue", "Denotation", "UploadFile", "DownloadFile"),
    *("ParamRefd", "SRDOMapping", "InvertedSRAD"),
]

_HEADS: dict[str, list[str]] = {
    "FileInfo": [*FILE_INFO, "LastEDS"],
    "DeviceInfo": [*DEVICE_INFO, "CompactPDO", *_OBSOLETE_KEYS],
    "DeviceComissioning": [*COMMISSIONING, "NodeRefd", "NetRefd"],
    "DummyUsage": [f"Dummy{index:04X}" for index in range(1, 0x20)],
    "Comments": ["Lines"],
    "SupportedModules": ["NrOfEntries"],
    "ConnectedModules": ["NrOfEntries"],
    "DynamicChannels": ["NrOfSeg"],
    "Tools": ["Items"],
}
"""Every head with its possible keys, except numbered ones."""

TEXTS = frozenset(
    {
        *("vendorname", "productname", "ordercode", "nodename", "networkname", "noderefd", "netrefd"),
        *(key.casefold() for key in _OBSOLETE_KEYS),
    }
)
"""Keys of [DeviceInfo] and [DeviceComissioning] with text; the others have numbers."""

_COMPACT = {"name": "Name", "value": "Value", "denotation": "Denotation", "objectlinks": "ObjectLinks"}
_OBJECT = re.compile(
    r"(0x)?([0-9a-f]{1,8})(h?)\s*(?:(sub)\s*(0x)?([0-9a-f]{1,8})|(name|value|denotation|objectlinks))?", re.I
)
_MODULE = re.compile(r"m[0-9]+(moduleinfo|comments|fixed|subext).*|tool[0-9]+", re.I)
_NUMBERED = re.compile(r"([a-z]*)0*([0-9]{1,5})", re.I)
_FREE_HEADS = ("DynamicChannels", "Tools")
_HEAD_OF = {name.casefold(): name for name in _HEADS} | {"devicecommissioning": "DeviceComissioning"}
_LIST_OF = {name.casefold(): name for name in LISTS}
_OWN_SPELLINGS = {"nrofrxpdo": "NrOfRxPDO", "nroftxpdo": "NrOfTxPDO", "edsversion": "EdsVersion"}


class SectionName(NamedTuple):
    """The meaning of a section's name. `proper` is the spelling of CiA 306, `rule` the rule that another one breaks.

    Capitals break no rule: CiA 306 4.2 compares names without them.
    """

    kind: SectionKind
    proper: str
    rule: str = ""
    object: int = 0
    sub: int = 0
    part: str = ""

    @property
    def key(self) -> str:
        """The name for comparisons, in lower case."""
        return self.proper.casefold()

    def other_capitals(self, name: str) -> bool:
        """Return whether a name differs from the proper one in capitals only; hexadecimal digits may have either."""
        if name.casefold() != self.key or self.kind == "object":
            return False
        word = "sub" if self.kind == "sub" else self.part
        return word not in name if word else name != self.proper


def section_name(name: str) -> SectionName:
    """Return the meaning of a name between brackets.

    >>> section_name("1018Sub1")
    SectionName(kind='sub', proper='1018sub1', rule='', object=4120, sub=1, part='')
    >>> section_name("DeviceCommissioning").proper
    'DeviceComissioning'
    """
    folded = name.casefold()
    head, listed = _HEAD_OF.get(folded), _LIST_OF.get(folded)
    if head:
        return SectionName("head", head, "" if folded == head.casefold() else "section-form")
    if listed:
        return SectionName("list", listed)
    match = _OBJECT.fullmatch(name)
    # A short name must have a digit, or [Add] would be an object.
    if match and (len(match[2]) >= 4 or any(letter.isdigit() for letter in match[2])):
        return _object(name, match)
    return SectionName("module" if _MODULE.fullmatch(name) else "unknown", name)


def _object(name: str, match: re.Match[str]) -> SectionName:
    index, sub = int(match[2], 16), int(match[6] or "0", 16)
    if index > 0xFFFF or sub > 0xFF:
        return SectionName("unknown", name, "sub-range")
    part = _COMPACT.get((match[7] or "").casefold(), "")
    kind: SectionKind = "sub" if match[4] else "compact" if part else "object"
    proper = f"{index:04X}" + (f"sub{sub:X}" if match[4] else part)
    rule = "" if name.casefold() == proper.casefold() else "section-form"
    return SectionName(kind, proper, rule, index, sub, part)


class KeyName(NamedTuple):
    """The meaning of a key: its proper spelling, whether its section defines it, the rule that the spelling breaks, and
    whether it differs in capitals only."""

    proper: str
    known: bool
    rule: str = ""
    capitals: bool = False

    @property
    def key(self) -> str:
        """The name for comparisons, in lower case."""
        return self.proper.casefold()


def key_name(section: SectionName, key: str) -> KeyName:
    """Return the meaning of a key of that section.

    >>> key_name(section_name("1018"), "subnumber")
    KeyName(proper='SubNumber', known=True, rule='', capitals=True)
    >>> key_name(section_name("OptionalObjects"), "Supported Objects")
    KeyName(proper='SupportedObjects', known=True, rule='key-form', capitals=False)
    """
    folded = "".join(key.casefold().split())
    proper = _keys_of(section).get(folded)
    if proper:
        if folded != key.casefold():
            return KeyName(proper, True, "key-form")
        return KeyName(proper, True, "", key not in (proper, _OWN_SPELLINGS.get(folded)))
    wanted = "Line" if section.proper == "Comments" else ""
    number = _NUMBERED.fullmatch("".join(key.split()))
    if number and number[1].casefold() == wanted.casefold() and section.kind in ("head", "list", "compact"):
        proper = f"{wanted}{int(number[2])}"
        same = key.casefold() == proper.casefold()
        return KeyName(proper, True, "" if same else "key-form", same and key != proper)
    return KeyName(key, section.kind == "module" or section.proper in _FREE_HEADS)


def entry_number(key: str) -> int | None:
    """Return the number of a numbered key in lower case, None for a name.

    >>> entry_number("12"), entry_number("lines"), entry_number("²")
    (12, None, None)
    """
    return int(key) if len(key) < 6 and key.isascii() and key.isdigit() else None


_OBJECT_KEYS = {key.casefold(): key for key in OBJECT}
_HEAD_KEYS = {name: {key.casefold(): key for key in keys} for name, keys in _HEADS.items()}
_LIST_KEYS = {"supportedobjects": "SupportedObjects"}
_COMPACT_KEYS = {"nrofentries": "NrOfEntries"}
_LINK_KEYS = {"objectlinks": "ObjectLinks"}


def _keys_of(section: SectionName) -> dict[str, str]:
    if section.kind in ("object", "sub"):
        return _OBJECT_KEYS
    if section.kind == "head":
        return _HEAD_KEYS[section.proper]
    if section.kind == "list":
        return _LIST_KEYS
    if section.kind == "compact":
        return _LINK_KEYS if section.part == "ObjectLinks" else _COMPACT_KEYS
    return {}
