"""PDOs: the objects in their bits, by the factory setting and by writes to the mapping.

        write to 1A00h:01 ...                         the entries of TPDO1
        write of 3 to 1A00h:00                        from now on the first three are mapped; 0: none
        write of 40000185h to 1800h:01                its COB-ID; with bit 31 it is switched off

Reads show the same. A reset restores the factory setting, unless another one was stored (1010h). The mappings of nodes
without a description are learned in the same way; their values are named by index and sub-index.
"""

from __future__ import annotations

from barewire.canopen.cob_ids import CobEntry, classify
from barewire.canopen.frame import CanFrame
from barewire.canopen.pdo.config import PDOS_MAX, PdoConfig, PdoDirection
from barewire.canopen.pdo.mapping import ENTRIES_MAX, MappedObject, PdoMapping
from barewire.codecs import Value
from barewire.devices.parameter import show
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.frames.known_node import KnownNode, KnownObject, KnownPdo
from barewire_workbench.monitor.events import MonitorEvent, PdoMappingReport, PdoReport, Violation

_RECORDS_MAX = 1024
"""The most PDOs whose configuration is followed."""
_LAST_MAX = 512
"""The most PDOs whose last data is kept, to find what is new."""

_FrameKey = tuple[int, bool]
_RECORDS: tuple[tuple[int, PdoDirection, bool], ...] = (
    (0x1400, "RPDO", False),
    (0x1600, "RPDO", True),
    (0x1800, "TPDO", False),
    (0x1A00, "TPDO", True),
)
"""The index of PDO 1 in each kind of record, the direction, and whether it is the mapping."""


class _Record:
    """The present configuration of one PDO of one node. `words` are its mapping entries as 32-bit numbers."""

    def __init__(self, node: int, direction: PdoDirection, number: int, factory: PdoConfig | None) -> None:
        self.node = node
        self.direction = direction
        self.number = number
        self.factory = factory
        self.key: _FrameKey | None = None
        self.words: dict[int, int] = {}
        self.count: int | None = None
        self.mapping: PdoMapping | None = None
        self.changed = False

    @property
    def name(self) -> str:
        """The name, such as TPDO1."""
        return f"{self.direction}{self.number}"

    def reset(self) -> None:
        """Restore the factory setting."""
        self.changed = False
        config = self.factory or PdoConfig(self.direction, self.number, mapping=())
        self.set_cob_id(config.cob_entry(self.node))
        self.words = dict(enumerate(config.mapping, start=1))
        self.count = None if self.factory is None else len(self.words)

    def set_cob_id(self, entry: CobEntry) -> None:
        """Set the identifier; bit 31 switches the PDO off."""
        self.key = None if entry.bit31 else (entry.identifier, entry.extended)

    def build_mapping(self, objects: dict[tuple[int, int], KnownObject]) -> None:
        """Build the mapping from the entries, without types if a type does not fit the bits of its entry."""
        self.mapping = None
        if self.count is None or any(number not in self.words for number in range(1, self.count + 1)):
            return
        words = [self.words[number] for number in range(1, self.count + 1)]
        self.mapping = _mapping(words, objects) or _mapping(words, {})


class PdoTracker:
    """The PDOs of all nodes: their owners, mappings and values. A machine."""

    def __init__(self, known: tuple[KnownNode, ...] = ()) -> None:
        self._objects: dict[int, dict[tuple[int, int], KnownObject]] = {node.node: dict(node.objects) for node in known}
        self._records: dict[tuple[int, PdoDirection, int], _Record] = {}
        self._by_key: dict[_FrameKey, _Record] = {}
        self._last: dict[_FrameKey, bytes] = {}
        self._stored: set[int] = set()
        for node in known:
            for pdo in node.pdos:
                self._add(node.node, pdo.direction, pdo.number, pdo)

    def _add(self, node: int, direction: PdoDirection, number: int, factory: PdoConfig | None) -> _Record | None:
        place = node, direction, number
        if place not in self._records and len(self._records) < _RECORDS_MAX:
            self._records[place] = record = _Record(node, direction, number, factory)
            record.reset()
            self._update(record)
        return self._records.get(place)

    def _update(self, record: _Record) -> None:
        """Update the tables after a change of the record."""
        for key in [key for key, other in self._by_key.items() if other is record]:
            del self._by_key[key]
        # A PDO cannot have a restricted identifier: a frame with it is another message, such as NMT.
        if record.key is not None and not CobEntry(*record.key).is_restricted:
            self._by_key[record.key] = record
        record.build_mapping(self._objects.get(record.node, {}))

    def owner(self, frame: CanFrame) -> KnownPdo | None:
        """Return the PDO with this identifier; None if it is not a known PDO."""
        record = self._by_key.get(frame.key)
        if record is not None:
            return KnownPdo(record.node, record.name, record.mapping)
        sender = classify(frame)
        if sender is None or "PDO" not in sender[0].name:
            return None
        return KnownPdo(sender[1], sender[0].name, None)

    def object(self, node: int, index: int | None, sub: int | None) -> KnownObject | None:
        """Return an object of a node that has a description; None for others."""
        return None if index is None or sub is None else self._objects.get(node, {}).get((index, sub))

    def feed(self, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Take a PDO, or a frame with a free identifier."""
        node, name, mapping = self.owner(frame) or (0, f"{frame.id:03X}h", None)
        if frame.remote:
            return [PdoReport(now, node, name, b"", {}, (), False, requested=True)]
        events: list[MonitorEvent] = []
        data = frame.data
        values: dict[str, Value] = {}
        texts: tuple[str, ...] = ()
        if mapping is not None:
            if len(data) != mapping.size:
                rule = "PDO-TOO-SHORT" if len(data) < mapping.size else "PDO-TOO-LONG"
                text = f"{name}: {mapping.size} bytes are mapped, got {len(data)}"
                events.append(Violation(now, rule, node, text, str(frame)))
            if len(data) >= mapping.size:
                values, texts = self.unpack(node, mapping, data[: mapping.size])
        repeated = self._last.get(frame.key) == data
        # A bus with more PDOs than are remembered reports the others as new each time, instead of growing.
        if frame.key in self._last or len(self._last) < _LAST_MAX:
            self._last[frame.key] = data
        events.append(PdoReport(now, node, name, data, values, texts, repeated))
        return events

    def unpack(self, node: int, mapping: PdoMapping, data: bytes) -> tuple[dict[str, Value], tuple[str, ...]]:
        """Return the values by name, and each as text with its name."""
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
            if known is not None and known.name == entry.name:
                values[entry.name], text = known.value(value), known.text(value)
            else:
                values[entry.name], text = value, show(value, entry.type or "")
            texts.append(f"{entry.name} = {text}")
        return values, tuple(texts)

    # The configuration, learned from accesses by SDO

    def learn(self, node: int, index: int, sub: int, data: bytes, now: float) -> list[MonitorEvent]:
        """Take the value of an object of the node that an access by SDO shows."""
        if index == 0x1010 and sub:
            self._stored.add(node)
        for first, direction, is_map in _RECORDS:
            if first <= index < first + PDOS_MAX and len(data) <= 8:
                record = self._add(node, direction, index - first + 1, None)
                if record is not None:
                    return self._change(record, is_map, sub, int.from_bytes(data, "little"), now)
        return []

    def _change(self, record: _Record, is_map: bool, sub: int, number: int, now: float) -> list[MonitorEvent]:
        """Store the value of a sub-index, and report the mapping if that changes it."""
        before = record.key, _words(record)
        # Only what decides about later frames is followed: the COB-ID, and the entries up to their number.
        if not is_map and sub == 1:
            record.set_cob_id(CobEntry.unpack(number))
        elif is_map and sub == 0:
            record.count = number if number <= ENTRIES_MAX else None
        elif is_map and sub <= ENTRIES_MAX:
            record.words[sub] = number
            if record.count is not None and sub > record.count:
                return []  # it is not mapped until sub-index 0 says so
        else:
            return []
        record.changed = True
        self._update(record)
        after = record.key, _words(record)
        stays_off = before[0] is None and record.key is None  # its mapping is reported when it is on again
        return [] if before == after or stays_off else [self._report(record, now)]

    def _report(self, record: _Record, now: float) -> MonitorEvent:
        if record.key is None:
            return PdoMappingReport(now, record.node, record.name, None, ())
        entries = () if record.mapping is None else record.mapping.entries
        names = tuple(entry.name for entry in entries)
        return PdoMappingReport(now, record.node, record.name, record.key[0], names)

    def reset(self, node: int, now: float) -> list[MonitorEvent]:
        """Restore the factory setting after a boot of the node, unless another one was stored."""
        events: list[MonitorEvent] = []
        if node in self._stored:
            return events
        for record in self._records.values():
            if record.node == node and record.changed:
                record.reset()
                self._update(record)
                events.append(self._report(record, now))
        return events


def _mapping(words: list[int], objects: dict[tuple[int, int], KnownObject]) -> PdoMapping | None:
    """Return the mapping of these entries; None if the type of an object does not fit the bits of its entry."""
    entries = []
    for word in words:
        known = objects.get((word >> 16, word >> 8 & 0xFF))
        type_name = None if known is None or known.type == "text" else known.type
        entries.append(MappedObject.of_word(word, type_name, "" if known is None else known.name))
    try:
        return PdoMapping(entries)
    except EncodeError:
        return None


def _words(record: _Record) -> list[int] | None:
    return None if record.mapping is None else [entry.word for entry in record.mapping.entries]
