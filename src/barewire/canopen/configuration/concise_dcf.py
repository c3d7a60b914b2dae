"""The concise DCF: the configuration of a device as one string of bytes, in 1F22h of a CANopen manager.   [CiA 302-3]

        | 02 00 00 00 | 17 10 | 00  | 02 00 00 00 | F4 01 | 00 18 | 02  | 01 00 00 00 | 01 |
          values u32    index   sub   size u32      data    index   sub   size u32      data
                        u16     u8                  1017h:00 = 500, u16                 1800h:02 = 1, u8

All numbers are little-endian, the data are the bytes that an SDO download sends. 1F22h:05 is the concise DCF of node 5.
A manager writes the values in their order, one SDO each, and compares nothing. So the order must suit any device:
`concise_dcf` switches PDOs off before it changes them, and an address may occur several times; the last value counts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from struct import Struct, unpack_from

from barewire.canopen.configuration.configure import CYCLE, plain_writes
from barewire.canopen.configuration.settings import DeviceConfiguration, Difference, Setting, pdo_of
from barewire.canopen.object_dictionary import ObjectAddress, ObjectDictionary
from barewire.canopen.pdo.config import PdoConfig
from barewire.codecs import Value
from barewire.errors import DecodeError, EncodeError

_COUNT = 4
_HEAD = Struct("<HBI")
_OFF = 1 << 31


@dataclass(frozen=True, slots=True)
class ConciseValue:
    """One write of a concise DCF: the object and its bytes, little-endian."""

    index: int
    sub: int
    data: bytes

    def __repr__(self) -> str:
        return f"<ConciseValue {self.index:04X}h:{self.sub:02X} = {self.data.hex(' ').upper() or 'empty'}>"


def encode_concise_dcf(values: Iterable[ConciseValue]) -> bytes:
    """Return the bytes of a concise DCF.

    >>> encode_concise_dcf([ConciseValue(0x1017, 0, bytes([0xF4, 1]))]).hex(" ")
    '01 00 00 00 17 10 00 02 00 00 00 f4 01'

    Raise EncodeError for an index or sub-index that does not exist.
    """
    values = list(values)
    pieces = [len(values).to_bytes(_COUNT, "little")]
    for value in values:
        if not (0 <= value.index <= 0xFFFF and 0 <= value.sub <= 0xFF):
            raise EncodeError(f"index {value.index:X}h, sub-index {value.sub:X}h: expected 0..FFFFh and 0..FFh")
        pieces += [_HEAD.pack(value.index, value.sub, len(value.data)), value.data]
    return b"".join(pieces)


def decode_concise_dcf(data: bytes) -> list[ConciseValue]:
    """Return the values of a concise DCF. No bytes at all are a concise DCF without values.

    >>> decode_concise_dcf(bytes.fromhex("01000000 1710 00 02000000 F401"))
    [<ConciseValue 1017h:00 = F4 01>]

    Raise DecodeError("short") if it ends within a value, DecodeError("long") if bytes follow the last one.
    """
    if not data:
        return []
    if len(data) < _COUNT:
        raise DecodeError("short", data, len(data), "the number of values takes 4 bytes")
    (count,) = unpack_from("<I", data)
    at, values = _COUNT, []
    for number in range(1, count + 1):
        if at + _HEAD.size > len(data):
            raise DecodeError("short", data, len(data), f"index, sub-index and size of value {number} of {count}")
        index, sub, size = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if at + size > len(data):
            text = f"{index:04X}h:{sub:02X}, value {number} of {count}, has {size} bytes: {len(data) - at} are there"
            raise DecodeError("short", data, len(data), text)
        values.append(ConciseValue(index, sub, bytes(data[at : at + size])))
        at += size
    if at < len(data):
        raise DecodeError("long", data, at, f"{len(data) - at} bytes after the last of {count} values")
    return values


def concise_dcf(configuration: DeviceConfiguration) -> list[ConciseValue]:
    """Return the writes of a configuration in an order that is safe for any device.

    First all PDOs are switched off; then follow the other objects, the mapping and the parameters of each PDO, its
    COB-ID, and last 1020h, the date. The highest sub-index of an array or record is left out if it is the default of
    the DCF. Raise EncodeError if a mapping is configured without the COB-ID of its PDO or without the number of its
    objects.
    """
    return list(_writes(configuration))


def _writes(configuration: DeviceConfiguration) -> Iterator[ConciseValue]:
    others: list[Setting] = []
    pdos: dict[int, tuple[PdoConfig, dict[ObjectAddress, Setting]]] = {}
    for setting in configuration.settings:
        if (pdo := pdo_of(setting.entry.index)) is None:
            others.append(setting)
        else:
            pdos.setdefault(pdo.communication, (pdo, {}))[1][setting.place] = setting
    for pdo, settings in pdos.values():
        _check_complete(pdo, settings)
        if (pdo.communication, 1) in settings:
            cob_id = settings[pdo.communication, 1]
            yield ConciseValue(*cob_id.place, (int(cob_id.value) | _OFF).to_bytes(4, "little"))
    # The number of entries of an array or record may be fixed in a device: it is written only where it changes.
    compound = {setting.entry.index for setting in others if setting.entry.sub}
    changes = [
        Difference(setting.entry, None, setting.value)
        for setting in others
        if setting.entry.sub or setting.entry.index not in compound or setting.value != setting.entry.default
    ]
    cycle = None if any(change.entry.index == CYCLE for change in changes) else 0
    for entry, data in plain_writes(changes, cycle):
        yield ConciseValue(entry.index, entry.sub, data)
    for pdo, settings in pdos.values():
        yield from _pdo_writes(pdo, settings)
    for setting in configuration.date:
        yield ConciseValue(*setting.place, setting.data)


def _check_complete(pdo: PdoConfig, settings: Mapping[ObjectAddress, Setting]) -> None:
    if not any(index == pdo.map for index, _ in settings):
        return
    for missing, index, sub in (("COB-ID", pdo.communication, 1), ("number of objects", pdo.map, 0)):
        if (index, sub) not in settings:
            text = f"its mapping is configured, but not its {missing}: expected a value of {index:04X}h:{sub:02X}"
            raise EncodeError(f"{pdo.direction}{pdo.number}: {text}")


def _pdo_writes(pdo: PdoConfig, settings: Mapping[ObjectAddress, Setting]) -> Iterator[ConciseValue]:
    count, cob_id = settings.get((pdo.map, 0)), settings.get((pdo.communication, 1))
    if count is not None:
        yield ConciseValue(pdo.map, 0, b"\0")
    for setting in settings.values():
        if setting.entry.index == pdo.map and setting.entry.sub:
            yield ConciseValue(*setting.place, setting.data)
    if count is not None and count.value:
        yield ConciseValue(*count.place, count.data)
    for setting in settings.values():
        if setting.entry.index == pdo.communication and setting is not cob_id:
            yield ConciseValue(*setting.place, setting.data)
    if cob_id is not None and not int(cob_id.value) & _OFF:
        yield ConciseValue(*cob_id.place, cob_id.data)


def concise_values(concise: Iterable[ConciseValue], objects: ObjectDictionary) -> dict[ObjectAddress | str, Value]:
    """Return the values that a device has after the writes of a concise DCF, for `eds.to_dcf` of its EDS.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> objects = ObjectDictionary([Entry(0x1017, 0, "heartbeat", "u16")])
    >>> concise_values([ConciseValue(0x1017, 0, bytes(2)), ConciseValue(0x1017, 0, bytes([0xF4, 1]))], objects)
    {(4119, 0): 500}

    Raise EncodeError for an object that `objects` does not have, DecodeError for bytes that are not of its type.
    """
    values: dict[ObjectAddress | str, Value] = {}
    for write in concise:
        entry = objects.at((write.index, write.sub))
        try:
            values[write.index, write.sub] = entry.codec.decode(write.data)
        except DecodeError as error:
            error.add_context(f"{write!r} is to be {entry.name}, {entry.type}")
            raise
    return values
