"""PDOs overheard: which bits are which object, as the factory, or whoever wrote the mapping, has said.

        a write to 1A00h:01 ...                         the entries of TPDO1, kept
        a write to 1A00h:00 of 3                        from now on the first three are mapped; 0: none
        a write to 1800h:01 of 40000185h                its COB-ID; with bit 31: switched off

Reads tell the same. A reset brings the factory setting back, unless somebody has stored another (1010h).
Nodes that nobody described are learned in the same way; their values have places for names.
"""

from __future__ import annotations

from barewire.canopen.cob_ids import CobEntry, classify, cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.pdo.config import PdoConfig, PdoDirection
from barewire.canopen.pdo.mapping import ENTRIES_MAX, MappedObject, PdoMapping
from barewire.codecs import Value
from barewire.devices.parameter import show
from barewire.errors import DecodeError, EncodeError
from barewire.explain.can_monitor import events
from barewire.explain.can_monitor.events import MonitorEvent, Violation
from barewire.explain.canopen.known_node import KnownNode, KnownObject

RECORDS_MAX = 1024
"""So many PDOs are followed; changes of further ones are not."""
SHOWN_MAX = 512
"""So many PDOs' last data are remembered, to know what is new."""

FrameKey = tuple[int, bool]
_BASES: tuple[tuple[int, int, PdoDirection], ...] = ((0x1400, 0x1600, "RPDO"), (0x1800, 0x1A00, "TPDO"))


class _Record:
    """One PDO of one node, as it is now."""

    def __init__(self, node: int, direction: PdoDirection, number: int, factory: PdoConfig | None) -> None:
        self.node = node
        self.direction = direction
        self.number = number
        self.factory = factory
        self.key: FrameKey | None = None
        self.words: dict[int, int] = {}
        self.count: int | None = None
        self.mapping: PdoMapping | None = None
        self.changed = False

    @property
    def name(self) -> str:
        """TPDO1."""
        return f"{self.direction}{self.number}"

    def reset(self) -> None:
        """As it comes from the factory."""
        self.changed = False
        self.words, self.count, self.key = {}, None, None
        if self.factory is not None:
            entry = self.factory.cob_entry(self.node)
            self.key = None if entry.bit31 else (entry.identifier, entry.extended)
            self.words = dict(enumerate(self.factory.mapping, start=1))
            self.count = len(self.words)
        elif self.number <= 4:
            self.key = (
                cob_id("TPDO1" if self.direction == "TPDO" else "RPDO1", self.node) + 0x100 * (self.number - 1),
                False,
            )

    def plan(self, objects: dict[tuple[int, int], KnownObject]) -> None:
        """Make the mapping of its entries. Types that do not fit their bits are left out: bits stay bits."""
        self.mapping = None
        if self.count is None or not all(place in self.words for place in range(1, self.count + 1)):
            return
        words = [self.words[place] for place in range(1, self.count + 1)]
        for typed in (True, False):
            entries = []
            for word in words:
                known = objects.get((word >> 16, word >> 8 & 0xFF)) if typed else None
                kind = None if known is None or known.type == "text" else known.type
                entries.append(MappedObject.of_word(word, kind, "" if known is None else known.name))
            try:
                self.mapping = PdoMapping(entries)
                return
            except EncodeError:
                continue


class PdoTracker:
    """The PDOs of all nodes, as far as they are known."""

    def __init__(self, known: tuple[KnownNode, ...] = ()) -> None:
        self._objects: dict[int, dict[tuple[int, int], KnownObject]] = {one.node: dict(one.objects) for one in known}
        self._records: dict[tuple[int, PdoDirection, int], _Record] = {}
        self._by_key: dict[FrameKey, _Record] = {}
        self._last: dict[FrameKey, bytes] = {}
        self._stored: set[int] = set()
        for one in known:
            for pdo in one.pdos:
                self._add(one.node, pdo.direction, pdo.number, pdo)

    def _add(self, node: int, direction: PdoDirection, number: int, factory: PdoConfig | None) -> _Record | None:
        place = node, direction, number
        if place not in self._records and len(self._records) < RECORDS_MAX:
            self._records[place] = record = _Record(node, direction, number, factory)
            record.reset()
            self._settle(record)
        return self._records.get(place)

    def _settle(self, record: _Record) -> None:
        """Its key and its mapping as they are now."""
        for key in [key for key, one in self._by_key.items() if one is record]:
            del self._by_key[key]
        if record.key is not None:
            self._by_key[record.key] = record
        record.plan(self._objects.get(record.node, {}))

    def owner(self, frame: CanFrame) -> tuple[int, str, PdoMapping | None] | None:
        """Node, name and mapping of the PDO with this identifier; None if it is none that is known."""
        record = self._by_key.get(frame.key)
        if record is not None:
            return record.node, record.name, record.mapping
        found = classify(frame)
        if found is None or "PDO" not in found[0].name:
            return None
        return found[1], found[0].name, None

    def object(self, node: int, index: int | None, sub: int | None) -> KnownObject | None:
        """An object of a node that somebody described."""
        return None if index is None or sub is None else self._objects.get(node, {}).get((index, sub))

    def hear(self, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Process data, or what a free identifier carries."""
        node, name, mapping = self.owner(frame) or (0, f"{frame.id:03X}h", None)
        if frame.remote:
            return [events.PdoReport(now, node, name, b"", {}, (), False, requested=True)]
        found: list[MonitorEvent] = []
        data = frame.data
        values: dict[str, Value] = {}
        texts: tuple[str, ...] = ()
        if mapping is not None:
            if len(data) < mapping.size:
                text = f"{name}: {mapping.size} bytes are mapped, here are {len(data)}"
                found.append(Violation(now, "PDO-TOO-SHORT", node, text, str(frame)))
            else:
                if len(data) > mapping.size:
                    text = f"{name}: {mapping.size} bytes are mapped, here are {len(data)}"
                    found.append(Violation(now, "PDO-TOO-LONG", node, text, str(frame)))
                values, texts = self.read(node, mapping, data[: mapping.size])
        repeated = self._last.get(frame.key) == data
        if frame.key in self._last or len(self._last) < SHOWN_MAX:
            self._last[frame.key] = data
        found.append(events.PdoReport(now, node, name, data, values, texts, repeated))
        return found

    def read(self, node: int, mapping: PdoMapping, data: bytes) -> tuple[dict[str, Value], tuple[str, ...]]:
        """Values by name, and each in words."""
        try:
            raw = mapping.unpack(data)
        except DecodeError:
            return {}, ()
        values, texts = {}, []
        objects = self._objects.get(node, {})
        for entry in mapping.entries:
            if entry.name not in raw:
                continue
            known = objects.get((entry.index, entry.sub))
            value = raw[entry.name]
            is_it = known is not None and known.name == entry.name
            values[entry.name] = known.value(value) if known is not None and is_it else value
            text = known.text(value) if known is not None and is_it else show(value)
            texts.append(f"{entry.name} = {text}")
        return values, tuple(texts)

    # What is written and read teaches

    def learn(self, node: int, index: int, sub: int, data: bytes, now: float) -> list[MonitorEvent]:
        """An object of the node has this value."""
        if index == 0x1010 and sub:
            self._stored.add(node)
        for communication, mapping, direction in _BASES:
            for base, is_map in ((communication, False), (mapping, True)):
                if base <= index < base + 0x200 and len(data) <= 8:
                    number = int.from_bytes(data, "little")
                    record = self._add(node, direction, index - base + 1, None)
                    if record is not None:
                        return self._changed(record, is_map, sub, number, now)
        return []

    def _changed(self, record: _Record, is_map: bool, sub: int, number: int, now: float) -> list[MonitorEvent]:
        before = record.key, _words(record)
        if not is_map and sub == 1:
            entry = CobEntry.unpack(number)
            record.key = None if entry.bit31 else (entry.identifier, entry.extended)
        elif is_map and sub == 0:
            record.count = number if number <= ENTRIES_MAX else None
        elif is_map and sub <= ENTRIES_MAX:
            record.words[sub] = number
            if record.count is not None and sub > record.count:
                return []
        else:
            return []
        record.changed = True
        self._settle(record)
        after = record.key, _words(record)
        if before == after or before[0] is after[0] is None:
            return []  # nothing new; or it is switched off, and what it will carry is told when it is on again
        return [self._told(record, now)]

    def _told(self, record: _Record, now: float) -> MonitorEvent:
        names = () if record.mapping is None or record.key is None else record.mapping.entries
        texts = tuple(entry.name for entry in names)
        return events.PdoMappingReport(
            now, record.node, record.name, None if record.key is None else record.key[0], texts
        )

    def reset(self, node: int, now: float) -> list[MonitorEvent]:
        """The node has booted: the factory setting again, unless another was stored."""
        found: list[MonitorEvent] = []
        if node in self._stored:
            return found
        for record in self._records.values():
            if record.node == node and record.changed:
                record.reset()
                self._settle(record)
                found.append(self._told(record, now))
        return found


def _words(record: _Record) -> list[int] | None:
    return None if record.mapping is None else [entry.word for entry in record.mapping.entries]
