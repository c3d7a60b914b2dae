"""Compare a device with its configuration, and write the differences in an order that no rule of CiA 301 forbids.

        1  read       1000h, 1018h    a device of another type is not configured at all
                      all settings    equal ones are not written
                      PDO records     as they will be: an impossible mapping is found before anything is written
        2  write      18xxh:01 | bit 31            all PDOs that change: off, before anything else changes
                      other objects                in the order below
                      1Axxh:00 = 0, :01 ..., :00   the mapping of each PDO; then type and times (`pdo.remote`)
                      18xxh:01                     on
        3  read back  each value that was written
        4  write      1020h:01, :02   configuration date and time, which a master compares (CiA 302); then, if asked,
                      1010h:01        store all parameters

If a step fails, the PDOs that were switched off stay off, and the error names what was done: 1020h does not have the
new date then, so that a master does not take the device for configured.

The order of objects that are not PDO records, and the steps before some of them:   [CiA 301]

        1005h, 1012h, 1014h, 12xxh     the identifier changes only while the service is off: it is switched off first
        12xxh:03                       changes only while the channel is off: both COB-IDs off, then :03, :01, :02
        1016h                          no two entries may have one node: entries that change become 0 first
        1019h                          changes only while 1006h is 0: 1006h becomes 0 first

All others are written in the order of their addresses. PDO records are written by `pdo.remote`.

The concise DCF: the same writes as one string of bytes, in 1F22h of a CANopen manager.   [CiA 302-3]

        | 02 00 00 00 | 17 10 | 00  | 02 00 00 00 | F4 01 | 00 18 | 02  | 01 00 00 00 | 01 |
          values u32    index   sub   size u32      data    index   sub   size u32      data
                        u16     u8                  1017h:00 = 500, u16                 1800h:02 = 1, u8

All numbers are little-endian, the data are the bytes that an SDO download sends. 1F22h:05 is the concise DCF of node 5.
A manager writes the values in their order, one SDO each, and compares nothing. So the order must suit any device:
`concise_dcf` switches PDOs off before it changes them, and an address may occur several times; the last value counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from struct import Struct, unpack_from
from typing import Any, NamedTuple

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.configuration.settings import (
    DATE,
    DeviceConfiguration,
    Difference,
    Setting,
    check_bits,
    object_text,
    pdo_of,
    value_text,
)
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import Entry, ObjectAddress, ObjectDictionary
from barewire.canopen.pdo.config import PdoConfig
from barewire.canopen.pdo.multiplexed import MPDO_COUNTS
from barewire.canopen.pdo.remote import PdoConfigPolicy, read_pdo, write_pdo
from barewire.canopen.sdo import Channel, upload
from barewire.canopen.sdo.channel import channel_to
from barewire.canopen.sdo.client import write_setting
from barewire.codecs import Value
from barewire.conversation import DEFAULT_TIMEOUT, Conversation
from barewire.errors import BarewireError, DecodeError, EncodeError, NoAnswer

_CYCLE, _OVERFLOW = 0x1006, 0x1019
_SYNC, _TIME, _EMCY, _CONSUMERS = 0x1005, 0x1012, 0x1014, 0x1016
_SDO_CHANNELS = range(0x1200, 0x1300)
_BIT30, _BIT31 = 1 << 30, 1 << 31
_CYCLE_ENTRY = Entry(_CYCLE, 0, "communication cycle period", "u32")


def _plain_writes(changes: Iterable[Difference], cycle: int | None = None) -> Iterator[tuple[Entry, bytes]]:
    """Yield the writes of objects that are not PDO records, in a permitted order, as (entry, bytes).

    `cycle` is the present value of 1006h if 1019h changes. The `present` values of 1005h, 1012h, 1014h, 1016h and 12xxh
    decide whether a step before is needed; None: it is always done.
    """
    changes = sorted(changes, key=_order)
    changed = {change.entry.index: change for change in changes}
    held_back = (_OVERFLOW, _CYCLE) if _OVERFLOW in changed else ()
    yield from _cleared_consumers(changes)
    if held_back and (cycle is None or cycle):
        yield _CYCLE_ENTRY, bytes(4)
    for change in changes:
        if change.entry.index in _SDO_CHANNELS and change.entry.sub in (1, 2):
            yield from _switched_off(change)
    for change in changes:
        if change.entry.index in (_SYNC, _TIME, _EMCY):
            yield from _switched_off(change)
        if change.entry.index not in held_back:
            yield change.entry, change.data
    for index in held_back:
        if index in changed:
            yield changed[index].entry, changed[index].data
        elif cycle:
            yield _CYCLE_ENTRY, cycle.to_bytes(4, "little")


def _cleared_consumers(changes: list[Difference]) -> Iterator[tuple[Entry, bytes]]:
    """Yield the writes that make the entries of 1016h empty, if two of them may exchange their nodes."""
    consumers = [change for change in changes if change.entry.index == _CONSUMERS and change.entry.sub]
    for change in consumers if len(consumers) > 1 else []:
        if change.present != 0:
            yield change.entry, bytes(4)


def _switched_off(change: Difference) -> Iterator[tuple[Entry, bytes]]:
    """Yield the write that switches a service off with its present identifier, if its identifier changes."""
    if not isinstance(change.wanted, int):
        return
    present = change.present if isinstance(change.present, int) else None
    if present is not None and not (present ^ change.wanted) & ~(_BIT30 | _BIT31):
        return  # the identifier stays
    before = change.wanted if present is None else present
    if change.entry.index in (_SYNC, _TIME):  # bit 30 produces, bit 31 (of 1012h) consumes
        off = before & ~(_BIT30 | _BIT31) if change.entry.index == _TIME else before & ~_BIT30
    else:
        off = before | _BIT31
    if off not in (present, change.wanted):
        yield change.entry, off.to_bytes(4, "little")


def _order(change: Difference) -> tuple[int, bool, int]:
    """Sort by address; in an SDO channel the node-ID (:03) comes before the COB-IDs, which switch it on."""
    return change.entry.index, change.entry.index in _SDO_CHANNELS and change.entry.sub in (1, 2), change.entry.sub


STORE_TIMEOUT = 10.0
"""Seconds that a device has at least to store its parameters: many write to a slow memory before they respond."""

ConfigureProgress = Callable[[int, int, str], object]
"""Called as progress(done, total, step): the steps so far, the steps expected, and the next one in words. Writes are
added to the total when it is known what differs."""

_STORE = 0x1010
_MISSING = (AbortCode.NO_OBJECT, AbortCode.NO_SUB)
_ONLY_CHANGES = PdoConfigPolicy(skip_equal=True)


class ConfigurationFailed(BarewireError):
    """A device is not the one of the configuration, or has another value than was written."""


class ConfigurationResult(NamedTuple):
    """What `configure_device` did: the differences that it wrote, and whether the device stored its parameters. After a
    dry run: the differences that it would write."""

    changes: tuple[Difference, ...]
    stored: bool
    left_out: tuple[str, ...]

    def __repr__(self) -> str:
        stored = ", stored" if self.stored else ""
        return f"<ConfigurationResult: {len(self.changes)} changes{stored}, {len(self.left_out)} left out>"


def compare_device(
    node: int | Channel,
    configuration: DeviceConfiguration,
    *,
    timeout: float = DEFAULT_TIMEOUT,
    progress: ConfigureProgress | None = None,
) -> Conversation[CanFrame, list[Difference]]:
    """Read all objects of a configuration, and return those that differ: identity, settings, date.

    Write-only objects and objects that the device does not have differ always. Raise SdoAbort and NoAnswer.
    """
    settings = *configuration.identity, *configuration.settings, *configuration.date
    return _Configurator(channel_to(node, None), configuration, timeout, progress).compare(settings)


def configure_device(
    node: int | Channel,
    configuration: DeviceConfiguration,
    *,
    store: bool = False,
    dry_run: bool = False,
    timeout: float = DEFAULT_TIMEOUT,
    progress: ConfigureProgress | None = None,
) -> Conversation[CanFrame, ConfigurationResult]:
    """Write the differences between a device and its configuration, and read them back. It should be pre-operational.

        store       then store all parameters by 1010h:01, so that the device has them after the next reset
        dry_run     write nothing: only compare, with the same errors before a write
        timeout     seconds that each response may take
        progress    called before each step

    Raise ConfigurationFailed, before anything is written, for a device of another identity or without one of the
    objects; after the writes, if a value that is read back is not the one that was written. Raise SdoAbort for a value
    that the device refuses, and NoAnswer.
    """
    configurator = _Configurator(channel_to(node, None), configuration, timeout, progress)
    return configurator.configure(store=store, dry_run=dry_run)


@dataclass(slots=True)
class _Configurator:
    """One comparison or configuration of a device. Each step is told to `progress`."""

    channel: Channel
    configuration: DeviceConfiguration
    timeout: float
    progress: ConfigureProgress | None
    done: int = 0
    total: int = 0
    written: list[str] = field(default_factory=list)
    writing: str = ""  # what is being written
    off: list[PdoConfig] = field(default_factory=list)  # what was switched off

    def configure(self, *, store: bool, dry_run: bool) -> Conversation[CanFrame, ConfigurationResult]:
        configuration, name = self.configuration, f"node {self.channel.node}"
        try:
            foreign = yield from self.compare(configuration.identity)
            settings = () if foreign else (*configuration.settings, *configuration.date)
            differences = yield from self.compare(settings)
            missing = [
                difference for difference in differences if difference.reason and difference.entry.access != "wo"
            ]
            changes = [difference for difference in differences if difference.entry.index != DATE]
            pdos = [] if missing else (yield from self._changed_pdos(changes))
        except BarewireError as error:
            if not dry_run:
                error.add_note(f"nothing was written to {name}")
            raise
        if foreign:
            raise ConfigurationFailed(f"{name} is another device: {'; '.join(map(str, foreign))}")
        if missing:
            raise ConfigurationFailed(f"{name}: nothing was written: {'; '.join(map(str, missing))}")
        if dry_run:
            return ConfigurationResult(tuple(differences), False, configuration.left_out)
        dates = [difference for difference in differences if difference.entry.index == DATE]
        try:
            if changes and configuration.date and not dates:
                # The device has this date, but not the values: the date must not remain if a write fails.
                yield from self._write(configuration.date[0].entry, bytes(4), "the date is removed")
            if changes:
                yield from self._write_changes(changes, pdos)
                yield from self._read_back(changes)
            for setting in configuration.date if changes or dates else ():
                yield from self._write(setting.entry, setting.data)
        except BarewireError as error:
            error.add_note(f"{name} has {self._written_text(error)}; configure it again")
            raise
        if store:
            yield from self._store()
        return ConfigurationResult((*changes, *dates), store, configuration.left_out)

    def _tell(self, step: str) -> None:
        self.total = max(self.total, self.done + 1)
        if self.progress is not None:
            self.progress(self.done, self.total, step)
        self.done += 1

    def compare(self, settings: Iterable[Setting]) -> Conversation[CanFrame, list[Difference]]:
        settings = list(settings)
        self.total += len(settings)
        differences = []
        for setting in settings:
            difference = yield from self._difference(setting, "read")
            if difference is not None:
                differences.append(difference)
        return differences

    def _difference(self, setting: Setting, verb: str) -> Conversation[CanFrame, Difference | None]:
        entry = setting.entry
        self._tell(f"{verb} {object_text(entry)}")
        if entry.access == "wo":
            return Difference(entry, None, setting.value, "write-only")
        try:
            data = yield from upload(self.channel, entry.index, entry.sub, size=entry.codec.size, timeout=self.timeout)
        except SdoAbort as refusal:
            if refusal.code not in _MISSING:
                refusal.add_context(f"while reading {object_text(entry)}")
                raise
            return Difference(entry, None, setting.value, "no such object")
        if data == setting.data:
            return None
        try:
            return Difference(entry, entry.codec.decode(data), setting.value)
        except DecodeError:
            return Difference(entry, data, setting.value)

    def _write(self, entry: Entry, data: bytes, why: str = "") -> Conversation[CanFrame, None]:
        text = value_text(entry, entry.codec.decode(data))
        self._tell(f"write {object_text(entry)} = {text}{why and f' ({why})'}")
        self.writing = f"{entry.index:04X}h:{entry.sub:02X}"
        try:
            yield from write_setting(self.channel, entry.index, entry.sub, data, timeout=self.timeout)
        except SdoAbort as refusal:
            refusal.add_context(f"while writing {object_text(entry)} = {text}")
            raise
        self._has_written(self.writing)

    def _has_written(self, place: str) -> None:
        self.written.append(place)
        self.writing = ""

    def _written_text(self, error: BarewireError) -> str:
        """Return in words how far a configuration came until this error."""
        count = len(self.written)
        text = f"{count or 'no'} object{'s' if count > 1 else ''} written"
        if self.writing and isinstance(error, NoAnswer):
            text += f" (and perhaps {self.writing}, whose response did not come)"
        off = ", ".join(f"{pdo.direction}{pdo.number}" for pdo in self.off)
        return f"{text}{off and f', and these PDOs switched off: {off}'}, and not the date of the configuration"

    # PDOs and writes

    def _changed_pdos(self, changes: list[Difference]) -> Conversation[CanFrame, list[tuple[PdoConfig, PdoConfig]]]:
        """Return each PDO that changes as it is, and as it is to be."""
        records = [pdo for change in changes if (pdo := pdo_of(change.entry.index)) is not None]
        pdos = []
        for direction, number in dict.fromkeys((pdo.direction, pdo.number) for pdo in records):
            present = yield from read_pdo(self.channel, direction, number, timeout=self.timeout)
            pdos.append((present, _wanted_pdo(present, self.configuration.settings, changes)))
        return pdos

    def _write_changes(
        self, changes: list[Difference], pdos: list[tuple[PdoConfig, PdoConfig]]
    ) -> Conversation[CanFrame, None]:
        plain = [change for change in changes if pdo_of(change.entry.index) is None]
        cycle = None
        if any(change.entry.index == _OVERFLOW for change in plain):
            cycle = yield from self._present_cycle()
        writes = list(_plain_writes(plain, cycle))
        self.total += len(writes) + 2 * len(pdos) + len(changes)
        for present, _ in pdos:
            if not (present.cob_id or 0) & _BIT31:
                entry = Entry(present.communication, 1, f"COB-ID of {present.direction}{present.number}", "u32")
                yield from self._write(entry, ((present.cob_id or 0) | _BIT31).to_bytes(4, "little"), "off")
                self.off.append(present)
        for entry, data in writes:
            yield from self._write(entry, data)
        for _, pdo in pdos:
            self._tell(f"write {pdo!r}")
            self.writing = f"{pdo.direction}{pdo.number}"
            yield from write_pdo(self.channel, pdo, policy=_ONLY_CHANGES, timeout=self.timeout)
            self._has_written(self.writing)
            self.off = [other for other in self.off if other.communication != pdo.communication]

    def _read_back(self, changes: list[Difference]) -> Conversation[CanFrame, None]:
        """Read what was written. Of a PDO everything: the writes of one of its values may change another."""
        places = {(change.entry.index, change.entry.sub) for change in changes}
        records: set[int] = set()
        for change in changes:
            if (pdo := pdo_of(change.entry.index)) is not None:
                records |= {pdo.communication, pdo.map}
        wrong = []
        for setting in self.configuration.settings:
            if (setting.place in places or setting.entry.index in records) and setting.entry.access != "wo":
                difference = yield from self._difference(setting, "read back")
                if difference is not None:
                    wrong.append(str(difference))
        if wrong:
            text = f"node {self.channel.node} has other values than were written: {'; '.join(wrong)}"
            raise ConfigurationFailed(text)

    def _present_cycle(self) -> Conversation[CanFrame, int]:
        try:
            data = yield from upload(self.channel, _CYCLE, 0, size=4, timeout=self.timeout)
        except SdoAbort as refusal:
            if refusal.code not in _MISSING:
                raise
            return 0
        return int.from_bytes(data[:4], "little")

    def _store(self) -> Conversation[CanFrame, None]:
        self._tell(f"store: {_STORE:04X}h:01")
        try:
            yield from write_setting(self.channel, _STORE, 1, b"save", timeout=max(self.timeout, STORE_TIMEOUT))
        except BarewireError as error:
            stored = "may have stored them or not" if isinstance(error, NoAnswer) else "did not store them"
            error.add_note(f"node {self.channel.node} has all values of the configuration, and {stored}")
            raise


def _wanted_pdo(present: PdoConfig, settings: Iterable[Setting], changes: Iterable[Difference]) -> PdoConfig:
    """Return a PDO as it is to be: the settings of its two records, and for all else the present values."""
    records = {present.communication, present.map}
    values = {setting.place: int(setting.value) for setting in settings if setting.entry.index in records}
    fields: dict[str, Any] = {}
    for sub, name in ((1, "cob_id"), (2, "type"), (3, "inhibit"), (5, "event_timer"), (6, "sync_start")):
        if (present.communication, sub) in values:
            fields[name] = values[present.communication, sub]
    count = values.get((present.map, 0), present.count)
    multiplexed = MPDO_COUNTS.get(count)
    name = f"{present.direction}{present.number}"
    for change in changes:
        if change.entry.index == present.map and change.entry.sub > (0 if multiplexed else count):
            place = f"{present.map:04X}h:{change.entry.sub:02X}"
            text = f"expected a value for {present.map:04X}h:00 that includes it"
            raise EncodeError(f"{name} maps {count} objects, but {place} is configured: {text}")
    words = []
    for sub in range(1, count + 1) if multiplexed is None else ():
        before = present.mapping[sub - 1] if sub <= len(present.mapping) else None
        word = values.get((present.map, sub), before)
        if word is None:
            place = f"{present.map:04X}h:{sub:02X}"
            raise EncodeError(f"{name} maps {count} objects: expected a value for {place} in the configuration")
        words.append(word)
    check_bits(present, words)
    return replace(present, mapping=tuple(words), multiplexed=multiplexed, **fields)


# The concise DCF ------------------------------------------------------------------------------------------------------

_COUNT = 4
_HEAD = Struct("<HBI")


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
    the DCF. Raise EncodeError if a mapping is configured without the COB-ID or the number of objects of its PDO.
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
            yield ConciseValue(*cob_id.place, (int(cob_id.value) | _BIT31).to_bytes(4, "little"))
    # The number of entries of an array or record may be fixed in a device: it is written only where it changes.
    compound = {setting.entry.index for setting in others if setting.entry.sub}
    changes = [
        Difference(setting.entry, None, setting.value)
        for setting in others
        if setting.entry.sub or setting.entry.index not in compound or setting.value != setting.entry.default
    ]
    cycle = None if any(change.entry.index == _CYCLE for change in changes) else 0
    for entry, data in _plain_writes(changes, cycle):
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
    if cob_id is not None and not int(cob_id.value) & _BIT31:
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
