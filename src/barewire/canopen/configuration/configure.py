"""Compare a device with its configuration, and write the differences in an order that no rule of CiA 301 forbids.

        1  read       1000h, 1018h    a device of another type is not configured at all
                      all settings    equal ones are not written
                      PDO records     as they will be: an impossible mapping is found before anything is written
        2  write      18xxh:01 | bit 31            all PDOs that change: off, before anything else changes
                      other objects                in the order below
                      1Axxh:00 = 0, :01 ..., :00   the mapping of each PDO; then type and times (`pdo.remote_config`)
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

All others are written in the order of their addresses. PDO records are written by `pdo.remote_config`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
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
from barewire.canopen.object_dictionary import Entry
from barewire.canopen.pdo.config import PdoConfig
from barewire.canopen.pdo.multiplexed import MPDO_COUNTS
from barewire.canopen.pdo.remote import PdoConfigPolicy, read_pdo, write_pdo
from barewire.canopen.sdo import Channel, download, upload
from barewire.canopen.sdo.channel import channel_to
from barewire.conversation import DEFAULT_TIMEOUT, Conversation
from barewire.errors import BarewireError, DecodeError, EncodeError, NoAnswer

CYCLE, OVERFLOW = 0x1006, 0x1019
_SYNC, _TIME, _EMCY, _CONSUMERS = 0x1005, 0x1012, 0x1014, 0x1016
_SDO_CHANNELS = range(0x1200, 0x1300)
_BIT30, _BIT31 = 1 << 30, 1 << 31
_CYCLE_ENTRY = Entry(CYCLE, 0, "communication cycle period", "u32")


def plain_writes(changes: Iterable[Difference], cycle: int | None = None) -> Iterator[tuple[Entry, bytes]]:
    """Yield the writes of objects that are not PDO records, in a permitted order, as (entry, bytes).

    `cycle` is the present value of 1006h if 1019h changes. The `present` values of 1005h, 1012h, 1014h, 1016h and 12xxh
    decide whether a step before is needed; None: it is always done.
    """
    changes = sorted(changes, key=_order)
    consumers = [change for change in changes if change.entry.index == _CONSUMERS and change.entry.sub]
    for change in consumers if len(consumers) > 1 else []:
        if change.present != 0:
            yield change.entry, bytes(4)
    overflow = next((change for change in changes if change.entry.index == OVERFLOW), None)
    wanted_cycle = next((change for change in changes if change.entry.index == CYCLE), None)
    if overflow is not None and (cycle is None or cycle):
        yield _CYCLE_ENTRY, bytes(4)
    channels = [change for change in changes if change.entry.index in _SDO_CHANNELS and change.entry.sub in (1, 2)]
    for change in channels:
        yield from _switched_off(change)
    for change in changes:
        if change.entry.index in (_SYNC, _TIME, _EMCY):
            yield from _switched_off(change)
        if change is overflow or (change is wanted_cycle and overflow is not None):
            continue
        yield change.entry, change.entry.codec.encode(change.wanted)
    if overflow is not None:
        yield overflow.entry, overflow.entry.codec.encode(overflow.wanted)
        if wanted_cycle is not None:
            yield wanted_cycle.entry, wanted_cycle.entry.codec.encode(wanted_cycle.wanted)
        elif cycle:
            yield _CYCLE_ENTRY, cycle.to_bytes(4, "little")


def _switched_off(change: Difference) -> Iterator[tuple[Entry, bytes]]:
    """Yield the write that switches a service off with its present identifier, if its identifier changes."""
    present = change.present if isinstance(change.present, int) else None
    if not isinstance(change.wanted, int):
        return
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
_OFF = 1 << 31
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
    return _Steps(channel_to(node, None), timeout, progress).compare(settings)


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
    return _configure(_Steps(channel_to(node, None), timeout, progress), configuration, store, dry_run)


def _configure(
    steps: _Steps, configuration: DeviceConfiguration, store: bool, dry_run: bool
) -> Conversation[CanFrame, ConfigurationResult]:
    try:
        wrong = yield from steps.compare(configuration.identity)
        found = [] if wrong else (yield from steps.compare((*configuration.settings, *configuration.date)))
        changes = [one for one in found if one.entry.index != DATE]
        absent = [one for one in found if one.reason and one.entry.access != "wo"]
        pdos = [] if absent else (yield from _changed_pdos(steps, configuration, changes))
    except BarewireError as error:
        if not dry_run:
            error.add_note(f"nothing was written to node {steps.channel.node}")
        raise
    if wrong:
        raise ConfigurationFailed(f"node {steps.channel.node} is another device: {'; '.join(map(str, wrong))}")
    if absent:
        raise ConfigurationFailed(f"node {steps.channel.node}: nothing was written: {'; '.join(map(str, absent))}")
    if dry_run:
        return ConfigurationResult(tuple(found), False, configuration.left_out)
    dates = [one for one in found if one.entry.index == DATE]
    try:
        if changes:
            if configuration.date and not dates:
                # The device has the date of this configuration, but not its values: not to remain if a write fails.
                yield from steps.write(configuration.date[0].entry, bytes(4), "the date is removed")
            yield from _write_changes(steps, changes, pdos)
            yield from _read_back(steps, configuration, changes)
        if changes or dates:
            for setting in configuration.date:
                yield from steps.write(setting.entry, setting.data)
    except BarewireError as error:
        error.add_note(f"node {steps.channel.node} has {steps.written_text(error)}; configure it again")
        raise
    if store:
        yield from _store(steps)
    return ConfigurationResult((*changes, *dates), store, configuration.left_out)


def _store(steps: _Steps) -> Conversation[CanFrame, None]:
    steps.tell(f"store: {_STORE:04X}h:01")
    try:
        wait = max(steps.timeout, STORE_TIMEOUT)
        yield from download(steps.channel, _STORE, 1, b"save", timeout=wait)
    except BarewireError as error:
        stored = "may have stored them or not" if isinstance(error, NoAnswer) else "did not store them"
        error.add_note(f"node {steps.channel.node} has all values of the configuration, and {stored}")
        raise


class _Steps:
    """The SDO transfers of one configuration, told to `progress`."""

    def __init__(self, channel: Channel, timeout: float, progress: ConfigureProgress | None) -> None:
        self.channel = channel
        self.timeout = timeout
        self.progress = progress
        self.done = self.total = 0
        self.written: list[str] = []
        self.writing = ""  # what is being written
        self.off: list[PdoConfig] = []

    def tell(self, step: str) -> None:
        self.total = max(self.total, self.done + 1)
        if self.progress is not None:
            self.progress(self.done, self.total, step)
        self.done += 1

    def compare(self, settings: Iterable[Setting]) -> Conversation[CanFrame, list[Difference]]:
        settings = list(settings)
        self.total += len(settings)
        found = []
        for setting in settings:
            difference = yield from self.difference(setting, "read")
            if difference is not None:
                found.append(difference)
        return found

    def difference(self, setting: Setting, verb: str) -> Conversation[CanFrame, Difference | None]:
        entry = setting.entry
        self.tell(f"{verb} {object_text(entry)}")
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

    def write(self, entry: Entry, data: bytes, why: str = "") -> Conversation[CanFrame, None]:
        text = value_text(entry, entry.codec.decode(data))
        self.tell(f"write {object_text(entry)} = {text}{why and f' ({why})'}")
        self.writing = f"{entry.index:04X}h:{entry.sub:02X}"
        try:
            yield from download(self.channel, entry.index, entry.sub, data, timeout=self.timeout)
        except SdoAbort as refusal:
            refusal.add_context(f"while writing {object_text(entry)} = {text}")
            raise
        self.has_written(self.writing)

    def has_written(self, place: str) -> None:
        self.written.append(place)
        self.writing = ""

    def written_text(self, error: BarewireError) -> str:
        """Return in words how far a configuration came until this error."""
        count = len(self.written)
        text = f"{count or 'no'} object{'s' if count > 1 else ''} written"
        if self.writing and isinstance(error, NoAnswer):
            text += f" (and perhaps {self.writing}, whose response did not come)"
        off = ", ".join(f"{pdo.direction}{pdo.number}" for pdo in self.off)
        return f"{text}{off and f', and these PDOs switched off: {off}'}, and not the date of the configuration"


def _changed_pdos(
    steps: _Steps, configuration: DeviceConfiguration, changes: list[Difference]
) -> Conversation[CanFrame, list[tuple[PdoConfig, PdoConfig]]]:
    """Return each PDO that changes as it is, and as it is to be."""
    numbers = {(pdo.direction, pdo.number): pdo for one in changes if (pdo := pdo_of(one.entry.index)) is not None}
    pdos = []
    for pdo in numbers.values():
        present = yield from read_pdo(steps.channel, pdo.direction, pdo.number, timeout=steps.timeout)
        pdos.append((present, _wanted_pdo(present, configuration.settings, changes)))
    return pdos


def _write_changes(
    steps: _Steps, changes: list[Difference], pdos: list[tuple[PdoConfig, PdoConfig]]
) -> Conversation[CanFrame, None]:
    plain = [one for one in changes if pdo_of(one.entry.index) is None]
    cycle = None
    if any(one.entry.index == OVERFLOW for one in plain):
        cycle = yield from _present_cycle(steps)
    writes = list(plain_writes(plain, cycle))
    steps.total += len(writes) + 2 * len(pdos) + len(changes)
    for present, _ in pdos:
        if not (present.cob_id or 0) & _OFF:
            off = Entry(present.communication, 1, f"COB-ID of {present.direction}{present.number}", "u32")
            yield from steps.write(off, ((present.cob_id or 0) | _OFF).to_bytes(4, "little"), "off")
            steps.off.append(present)
    for entry, data in writes:
        yield from steps.write(entry, data)
    for _, pdo in pdos:
        steps.tell(f"write {pdo!r}")
        steps.writing = f"{pdo.direction}{pdo.number}"
        yield from write_pdo(steps.channel, pdo, policy=_ONLY_CHANGES, timeout=steps.timeout)
        steps.has_written(steps.writing)
        steps.off = [one for one in steps.off if one.communication != pdo.communication]


def _read_back(
    steps: _Steps, configuration: DeviceConfiguration, changes: list[Difference]
) -> Conversation[CanFrame, None]:
    records = {one.entry.index for one in changes}
    for pdo in [pdo_of(index) for index in records]:
        records |= {pdo.communication, pdo.map} if pdo is not None else set()
    places = {(one.entry.index, one.entry.sub) for one in changes}
    wrong = []
    for setting in configuration.settings:
        in_pdo = setting.entry.index in records and pdo_of(setting.entry.index) is not None
        if (setting.place in places or in_pdo) and setting.entry.access != "wo":
            difference = yield from steps.difference(setting, "read back")
            if difference is not None:
                wrong.append(str(difference))
    if wrong:
        raise ConfigurationFailed(f"node {steps.channel.node} has other values than were written: {'; '.join(wrong)}")


def _present_cycle(steps: _Steps) -> Conversation[CanFrame, int]:
    try:
        data = yield from upload(steps.channel, CYCLE, 0, size=4, timeout=steps.timeout)
    except SdoAbort as refusal:
        if refusal.code not in _MISSING:
            raise
        return 0
    return int.from_bytes(data[:4], "little")


def _wanted_pdo(present: PdoConfig, settings: Iterable[Setting], changes: Iterable[Difference]) -> PdoConfig:
    """Return a PDO as it is to be: the settings of its two records, and for all else the present values."""
    records = {present.communication, present.map}
    values = {one.place: int(one.value) for one in settings if one.entry.index in records}
    fields: dict[str, Any] = {}
    for sub, name in ((1, "cob_id"), (2, "type"), (3, "inhibit"), (5, "event_timer"), (6, "sync_start")):
        if (present.communication, sub) in values:
            fields[name] = values[present.communication, sub]
    count = values.get((present.map, 0), present.count)
    multiplexed = MPDO_COUNTS.get(count)
    for one in changes:
        if one.entry.index == present.map and one.entry.sub > (0 if multiplexed else count):
            name, place = f"{present.direction}{present.number}", f"{present.map:04X}h:{one.entry.sub:02X}"
            text = f"expected a value for {present.map:04X}h:00 that includes it"
            raise EncodeError(f"{name} maps {count} objects, but {place} is configured: {text}")
    words = []
    for sub in range(1, count + 1) if multiplexed is None else ():
        before = present.mapping[sub - 1] if sub <= len(present.mapping) else None
        word = values.get((present.map, sub), before)
        if word is None:
            name, place = f"{present.direction}{present.number}", f"{present.map:04X}h:{sub:02X}"
            raise EncodeError(f"{name} maps {count} objects: expected a value for {place} in the configuration")
        words.append(word)
    check_bits(present, words)
    return replace(present, mapping=tuple(words), multiplexed=multiplexed, **fields)
