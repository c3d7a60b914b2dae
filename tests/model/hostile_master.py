"""A hostile master: it configures a device in every way its objects allow, and then uses what it configured.

    letters    one step of a configuration each, such as "RPDO1 onto 1400h:01", made of SDO requests and NMT
    alphabet   the letters of a device, derived from its object dictionary: COB-IDs on identifiers of other services,
               every kind of transmission type, times of 0, 1 and the greatest, mappings of each type of object, "save"
               and "load", additional SDO channels, SDO transfers that are not ended
    attack     after the letters: SYNC with and without counter, RPDOs of 0 to 8 bytes, remote requests, NMT, guarding,
               heartbeats, TIME, emergencies, and time that passes step by step and by weeks
    check      then the device answers 1000h, sends its heartbeat if 1017h is not 0, raised no error, sent nothing on an
               identifier that is not its own, and what it remembers is bounded; an object reads as it was written,
               and reset node restores all defaults

All of it in virtual time. `run_all` of `choices` makes every sequence of letters up to a length, `run_random` longer
ones. A device is reset between two sequences, since to make a new one takes longer than all the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

from barewire.canopen import CanFrame, Entry, LocalNode, ObjectDictionary, cob_id
from barewire.canopen.cob_ids import is_restricted
from barewire.canopen.emcy import WAITING_MAX
from barewire.canopen.object_dictionary import ObjectAddress
from barewire.codecs import Value
from tests.model.choices import Choices

OFF, PRODUCES, EXTENDED = 0x8000_0000, 0x4000_0000, 0x2000_0000
BURST = 64
"""The most frames that a device sends at once here: PDOs, emergencies, one SDO response."""
STEPS, STUCK = 16, 8  # deadlines that are followed; how many of them may be in the past, one after the other
DEVICE_TYPE = 0x1000
MULTIPLEXED = tuple(
    index.to_bytes(2, "little") + bytes([sub]) + value.to_bytes(4, "little")
    for index, sub, value in ((0x1400, 1, OFF), (0x1600, 0, 0), (0x1005, 0, PRODUCES | 0x80), (0x1017, 0, 1), (9, 9, 9))
)
"""What a multiplexed RPDO writes: index, sub-index and value."""
DUMMIES = {0x0001: 1, 0x0007: 32}
"""Placeholders in a mapping, and their bits."""


class Fed(Protocol):
    """A device: a `LocalNode`, or the node of a simulator."""

    @property
    def deadline(self) -> float | None: ...

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]: ...


class Letter(NamedTuple):
    """One step of a configuration."""

    name: str
    frames: tuple[CanFrame, ...]


def download(node: int, index: int, sub: int, value: int, size: int) -> CanFrame:
    """Return the request of an expedited download."""
    command = 0x23 | (4 - size) << 2
    head = bytes([command]) + index.to_bytes(2, "little") + bytes([sub])
    return CanFrame(cob_id("SDO request", node), head + value.to_bytes(size, "little").ljust(4, b"\0"))


def upload(node: int, index: int, sub: int = 0) -> CanFrame:
    """Return the request of an upload."""
    return CanFrame(cob_id("SDO request", node), b"\x40" + index.to_bytes(2, "little") + bytes([sub, 0, 0, 0, 0]))


def nmt(command: int, node: int = 0) -> CanFrame:
    """Return an NMT command."""
    return CanFrame(0, bytes([command, node]))


class Alphabet:
    """Makes the letters of one device. `mapped` are the objects that are mapped into PDOs.

    A small alphabet has fewer identifiers, types and times, and four mappings.
    """

    def __init__(
        self, objects: ObjectDictionary, node: int, mapped: Sequence[ObjectAddress], *, small: bool = False
    ) -> None:
        self.objects = objects
        self.node = node
        self.mapped = mapped
        self.small = small
        self.identifiers = [cob_id("SYNC"), cob_id("RPDO1", node)]
        if not small:
            more = cob_id("TPDO1", node), cob_id("EMCY", node), cob_id("SDO request", node), 0x6A0
            self.identifiers += [*more, EXTENDED | 0x1000_0000]

    def letters(self) -> list[Letter]:
        """Return all letters."""
        steps = [*self._plain(), *self._cob_ids(), *self._channels()]
        steps += [*self._pdo("RPDO", 0x1400, 0x1600), *self._pdo("TPDO", 0x1800, 0x1A00)]
        letters = [Letter(name, tuple(frames)) for name, frames in steps if frames]
        return [
            *letters,
            *self._transfers(),
            Letter("start", (nmt(0x01),)),
            Letter("reset communication", (nmt(0x82), nmt(0x01))),
            Letter("reset node", (nmt(0x81), nmt(0x01))),
        ]

    def _transfers(self) -> Iterator[Letter]:
        """Return transfers that are begun and not ended, of the first objects of variable length."""
        long = [entry for entry in self.objects if entry.codec.size is None]
        for entry in [entry for entry in long if entry.access == "const"][:1]:
            yield self._open(entry, "upload", "40 00000000")
            yield self._open(entry, "block upload", "A4 02000000", "A3")
        for entry in [entry for entry in long if entry.access == "rw"][:1]:
            yield self._open(entry, "download", "21 20000000", "00 61626364656667")
            yield self._open(entry, "block download", "C6 20000000", "01 61626364656667")

    def _open(self, entry: Entry, kind: str, request: str, following: str = "") -> Letter:
        command, *rest = bytes.fromhex(request)
        first = bytes([command]) + entry.index.to_bytes(2, "little") + bytes([entry.sub, *rest])
        frames = [first, bytes.fromhex(following).ljust(8, b"\0")][: 1 + bool(following)]
        return Letter(f"{kind} of {entry.index:X}h", tuple(CanFrame(0x600 + self.node, data) for data in frames))

    def _write(self, index: int, sub: int, value: int) -> list[CanFrame]:
        """Return the request that writes an object; none if the device has no such object of a size."""
        if (index, sub) not in self.objects:
            return []
        size = self.objects.entry(index, sub).codec.size
        return [] if size not in (1, 2, 4) else [download(self.node, index, sub, value & (1 << 8 * size) - 1, size)]

    def _each(self, index: int, sub: int, *values: int) -> Iterator[tuple[str, list[CanFrame]]]:
        for value in values[-2:] if self.small else values:
            yield f"{index:04X}h:{sub:02X} = {value:X}h", self._write(index, sub, value)

    def _plain(self) -> Iterator[tuple[str, list[CanFrame]]]:
        node = self.node
        yield from self._each(0x1003, 0, 0)
        yield from self._each(0x1006, 0, 0, 1, 10_000, 0xFFFF_FFFF)
        yield from self._each(0x1007, 0, 1)
        yield "guarding", [*self._write(0x100C, 0, 1), *self._write(0x100D, 0, 1)]
        yield from self._each(0x1010, 1, int.from_bytes(b"save", "little"))
        yield from self._each(0x1011, 1, int.from_bytes(b"load", "little"))
        yield from self._each(0x1015, 0, 1, 0xFFFF)
        yield from self._each(0x1016, 1, 0, node << 16 | 1, 9 << 16 | 1, 9 << 16 | 0xFFFF, 0xFF_FFFF)
        yield from self._each(0x1017, 0, 0, 1, 0xFFFF)
        yield from self._each(0x1019, 0, 0, 2, 240)
        yield from self._each(0x1028, 1, OFF, 0x81, cob_id("EMCY", node))
        yield from self._each(0x1029, 1, 1, 2)

    def _cob_ids(self) -> Iterator[tuple[str, list[CanFrame]]]:
        for index, off in ((0x1005, 0), (0x1012, 0), (0x1014, OFF)):
            for identifier in self.identifiers:
                word = identifier | (0 if off else PRODUCES)
                if index == 0x1012:
                    word |= OFF
                name = f"{index:04X}h = {word:08X}h"
                yield name, [*self._write(index, 0, off | identifier), *self._write(index, 0, word)]
        yield "SYNC is produced each us", [*self._write(0x1006, 0, 1), *self._write(0x1005, 0, PRODUCES | 0x80)]

    def _channels(self) -> Iterator[tuple[str, list[CanFrame]]]:
        for request, response in ((0x6A0, 0x6A1), (0x6A0, 0x6A0), (cob_id("RPDO1", self.node), 0x80)):
            frames = [*self._write(0x1201, 1, request), *self._write(0x1201, 2, response)]
            yield f"1201h = {request:X}h, {response:X}h", frames

    def _pdo(self, kind: str, record: int, mapping: int) -> Iterator[tuple[str, list[CanFrame]]]:
        if (record, 1) not in self.objects or (mapping, 1) not in self.objects:
            return
        default = cob_id("RPDO1" if kind == "RPDO" else "TPDO1", self.node)
        off, on = self._write(record, 1, OFF | default), self._write(record, 1, default)
        for identifier in (*self.identifiers, PRODUCES | default):
            yield f"{kind} {record:X}h on {identifier:X}h", [*off, *self._write(record, 1, identifier)]
        yield f"{kind} {record:X}h off", off
        for type in (0, 1, 252) if self.small else (0, 1, 240, 252, 253, 255):
            yield f"{kind} {record:X}h type {type}", self._write(record, 2, type)
        for sub, times in ((3, (1, 0xFFFF)), (5, (1, 0xFFFF)), (6, (1, 240))):
            for time in times[:1] if self.small else times:
                yield f"{kind} {record:X}h:{sub} = {time}", [*off, *self._write(record, sub, time), *on]
        for count in (0xFE, 0xFF):
            frames = [*off, *self._write(record, 2, 255), *self._write(mapping, 0, count), *on]
            yield f"{kind} {record:X}h is multiplexed {count:X}h", frames
        for address in self.mapped[:: max(1, len(self.mapped) // 4)] if self.small else self.mapped:
            yield self._map(kind, record, mapping, [address])
        for first, second in zip(self.mapped, () if self.small else self.mapped[1:]):
            yield self._map(kind, record, mapping, [second, first])

    def _map(
        self, kind: str, record: int, mapping: int, addresses: Sequence[ObjectAddress]
    ) -> tuple[str, list[CanFrame]]:
        """Return the letter that maps these objects, and nothing else, into a PDO. It is then received at once."""
        default = cob_id("RPDO1" if kind == "RPDO" else "TPDO1", self.node)
        frames = [*self._write(record, 1, OFF | default), *self._write(mapping, 0, 0)]
        for sub, (index, place) in enumerate(addresses, 1):
            bits = DUMMIES.get(index) or 8 * (self.objects.size(index, place) or 1)
            frames += self._write(mapping, sub, index << 16 | place << 8 | bits)
        frames += [*self._write(mapping, 0, len(addresses)), *self._write(record, 2, 255)]
        names = " and ".join(f"{index:04X}h:{sub:02X}" for index, sub in addresses)
        return f"{kind} {record:X}h onto {names}", [*frames, *self._write(record, 1, default)]


def mappable(objects: ObjectDictionary) -> list[ObjectAddress]:
    """Return the objects to map: each communication object that is mappable, one other of each type, and dummies."""
    found: list[ObjectAddress] = []
    types: set[tuple[str, str]] = set()
    for entry in objects:
        kind = entry.type, entry.access
        if not (entry.is_mappable("RPDO") or entry.is_mappable("TPDO")) or entry.codec.size is None:
            continue
        if entry.index < 0x2000 or kind not in types:
            found.append((entry.index, entry.sub))
        if entry.index >= 0x2000:
            types.add(kind)
    return [*found, *((index, 0) for index in DUMMIES)]


class HostileMaster:
    """Uses one device, sequence after sequence.

    make      makes the device
    local     returns the `LocalNode` of a device
    forget    deletes what a device has stored
    """

    def __init__(
        self, make: Callable[[], Fed], *, local: Callable[[Any], LocalNode], forget: Callable[[Any], None]
    ) -> None:
        self.make = make
        self.local = local
        self.forget = forget
        self.renew()
        node = local(self.device)
        assert node.node is not None
        self.node: int = node.node
        self.mapped = mappable(node.objects)
        self.own = {cob_id("SDO answer", self.node), cob_id("error control", self.node)}
        self.device_type = node.objects.read(DEVICE_TYPE, 0)
        self.defaults = self._values()
        self.changed = self.sent = 0  # letters that changed the device, and frames that it sent

    def renew(self) -> None:
        """Take a new device."""
        self.device = self.make()
        self.now = 0.0
        start = getattr(self.device, "start", None)
        if start is not None:
            start(0.0)

    def letters(self, *, small: bool = False, singles: bool = False) -> list[Letter]:
        """Return the letters for this device; with `singles` also writes to every object, one by one."""
        objects = self.local(self.device).objects
        letters = Alphabet(objects, self.node, self.mapped, small=small).letters()
        return [*letters, *single_writes(objects, self.node)] if singles else letters

    def _values(self) -> dict[ObjectAddress, Value]:
        """Return the values of all writable objects that are not computed."""
        objects = self.local(self.device).objects
        own = [entry for entry in objects if entry.access == "rw" and entry.on_read is None]
        return {(entry.index, entry.sub): objects.get(entry.index, entry.sub) for entry in own}

    def scenario(self, letters: Sequence[Letter], length: int) -> Callable[[Choices], None]:
        """Return the scenario of all sequences of this many letters."""

        def run(choices: Choices) -> None:
            self.play([choices.take(letters) for _ in range(length)])

        return run

    def play(self, sequence: Sequence[Letter]) -> None:
        """Reset the device, let it be configured, use it, and check it. Raises AssertionError with the sequence."""
        names = ", ".join(letter.name for letter in sequence)
        try:
            self._reset()
            self.feed(nmt(0x01))
            for letter in sequence:
                before = self.local(self.device).objects.changes
                for frame in letter.frames:
                    self._configure(frame)
                self.changed += self.local(self.device).objects.changes != before
            self.attack()
            self.check()
        except Exception as error:
            self.renew()
            raise AssertionError(f"after {names}: {type(error).__name__}: {error}") from error

    def _reset(self) -> None:
        """Reset the device: it has all its defaults."""
        self.forget(self.device)
        self.local(self.device).stored.values.clear()
        self.feed(nmt(0x81))
        values = self._values()
        kept = [place for place, value in values.items() if value != self.defaults[place]]
        assert not kept, f"after reset node {kept[0][0]:04X}h:{kept[0][1]:02X} is {values[kept[0]]!r}"

    def _configure(self, frame: CanFrame) -> None:
        """Send a frame of a letter. An object that was written reads as it was written."""
        sent = self.feed(frame)
        place = int.from_bytes(frame.data[1:3], "little"), frame.data[3] if len(frame.data) == 8 else 0
        confirmed = CanFrame(cob_id("SDO answer", self.node), b"\x60" + frame.data[1:4] + bytes(4))
        if confirmed not in sent or place not in self.defaults:
            return
        objects = self.local(self.device).objects
        size = objects.size(*place) or 0
        assert objects.read(*place) == frame.data[4 : 4 + size], f"{frame} was confirmed, and has no effect"

    def feed(self, frame: CanFrame | None) -> list[CanFrame]:
        """Feed the device; check what it sends."""
        sent = self.device.feed(frame, self.now)
        assert len(sent) <= BURST, f"{len(sent)} frames after {frame}"
        for answer in sent:
            allowed = answer.extended or answer.id in self.own or not is_restricted(answer.id)
            assert allowed, f"{answer} after {frame}: a restricted identifier"
        self.sent += len(sent)
        return sent

    def attack(self) -> None:
        """Use everything that may be configured."""
        node, objects = self.node, self.local(self.device).objects
        configured = integer(objects, 0x1400, 1) & 0x7FF
        self.feed(nmt(0x01))
        for identifier in sorted({cob_id("RPDO1", node), cob_id("TPDO1", node), cob_id("SYNC"), configured, 0x6A0}):
            for size in range(9) if identifier == configured else (0, 1, 8):
                self.feed(CanFrame(identifier, b"\xff" * size))
            for data in (b"\1" * 8, b"saveload", b"\x40\x00\x10" + bytes(5)):
                self.feed(CanFrame(identifier, data))
            if identifier == configured:  # it may be a multiplexed PDO, whose frames name the object that is written
                for place in MULTIPLEXED:
                    self.feed(CanFrame(identifier, bytes([0x80 | node]) + place))
            self.feed(CanFrame(identifier, remote=True))
        self.feed(CanFrame(0x1000_0000, b"\xff" * 8, extended=True))
        self.follow()
        for frame in (
            CanFrame(cob_id("error control", node), remote=True),
            *(CanFrame(cob_id("error control", other), bytes([5])) for other in (9, node)),
            CanFrame(cob_id("error control", 9), b"\0"),
            CanFrame(cob_id("EMCY", 1), bytes(8)),
            CanFrame(cob_id("TIME"), b"\xff" * 6),
        ):
            self.feed(frame)
        for command, answers in ((0x80, 1), (0x01, 1), (0x02, 0)):
            self.feed(nmt(command, node))
            self.feed(CanFrame(cob_id("SYNC"), b""))
            assert len(self._answers()) == answers, f"{answers} answers expected after NMT {command:02X}h"
        self.feed(nmt(0x01))
        self.now += 1e6
        self.feed(None)
        self.follow()

    def _answers(self) -> list[CanFrame]:
        """Return the answers to a request for 1000h, after an abort: within a block 40h is the number of a segment."""
        self.feed(CanFrame(0x600 + self.node, b"\x80" + bytes(7)))
        answer = cob_id("SDO answer", self.node)
        return [frame for frame in self.feed(upload(self.node, DEVICE_TYPE)) if frame.id == answer]

    def follow(self) -> None:
        """Let time pass from deadline to deadline. Time must pass: a deadline in the past again and again is a loop."""
        stuck = 0
        for _ in range(STEPS):
            due = self.device.deadline
            if due is None:
                return
            stuck = 0 if due > self.now else stuck + 1
            assert stuck < STUCK, f"the deadline {due} stays in the past at {self.now}"
            self.now = max(self.now, due)
            self.feed(None)

    def check(self) -> None:
        """Check that the device answers and beats, and that it remembers little."""
        local = self.local(self.device)
        node, objects = self.node, local.objects
        self.feed(nmt(0x80, node))
        answers = self._answers()
        assert len(answers) == 1, f"answers to 1000h: {answers}"
        assert answers[0].data == b"\x43\x00\x10\x00" + self.device_type, f"answered {answers[0]}"
        period = integer(objects, 0x1017) / 1000
        if period:
            self.now += period
            beats = [str(frame) for frame in self.feed(None) if frame.id == cob_id("error control", node)]
            assert beats == [f"7{node:02X}#7F"], f"heartbeats: {beats}"
        assert len(local.errors._waiting) <= WAITING_MAX
        assert len(local.errors._active) <= BURST
        assert len(local.stored.values) <= len(list(objects))


def integer(objects: ObjectDictionary, index: int, sub: int = 0) -> int:
    """Return the value of an object, 0 if the device has none."""
    return int(objects.get(index, sub)) if (index, sub) in objects else 0


def single_writes(objects: ObjectDictionary, node: int) -> Iterator[Letter]:
    """Return one letter for each writable communication object and each of its limits, one bit and some patterns."""
    for entry in objects:
        if entry.index < 0x2000 and entry.access in ("rw", "wo") and entry.codec.size in (1, 2, 4):
            yield from _values(entry, node)


def _values(entry: Entry, node: int) -> Iterator[Letter]:
    most = (1 << 8 * (size := entry.codec.size or 1)) - 1
    for value in sorted({0, 1, 2, 7, 8, 9, 64, 127, node, most // 2, most // 2 + 1, most - 1, most}):
        if value <= most:
            name = f"{entry.index:04X}h:{entry.sub:02X} = {value:X}h"
            yield Letter(name, (download(node, entry.index, entry.sub, value, size),))
