"""Conformance cases of an EDS: every object of the device against its description.   [CiA 301 7.4, CiA 306]

        OD-READ-2000:00      it can be read and has the length of its DataType, or is write-only
        OD-SUB-2010          sub-indices that the EDS does not describe do not exist
        OD-TYPE-2000         sub-index FFh, if it exists, has the ObjectType and the DataType   [CiA 301 7.4.1]
        OD-ABSENT-1011       a communication object that the EDS does not describe does not exist
        OD-DEFAULT-2000:00   after a reset it has its DefaultValue
        OD-ACCESS-2002:00    a read-only object refuses a write (of the value that it has)
        OD-WRITE-2000:00     a writable object accepts the value that it has
        OD-LENGTH-2000:00    one byte more and one less are refused
        OD-LIMIT-2000:00     values beyond LowLimit and HighLimit are refused
        OD-RPDO-6040:00      it can be mapped into a PDO, or cannot, as PDOMapping and AccessType say; OD-TPDO
        OD-DUMMY-0005        a data type of [DummyUsage] can be mapped into an RPDO as a placeholder

Bit 0 of ObjFlags leaves out the writes of an object, bit 1 its reads.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Literal

from barewire.canopen.datatypes import BY_CODE, DataType, object_codec
from barewire.canopen.eds.objects import MAPPABLE, RECORD, EdsItem, EdsObject, every_item
from barewire.canopen.eds.value_syntax import Expression, Formula
from barewire.codecs import Value
from barewire.errors import EncodeError
from barewire_workbench.conform.canopen.frames import (
    LENGTH_CODES,
    OTHER_TYPE,
    READ_ONLY_CODES,
    Sdo,
    little,
    make_case,
    multiplexer,
    silence,
)
from barewire_workbench.conform.canopen.model import Effect, NodeCase, NodeStep, Subject, SubjectPdo
from barewire_workbench.conform.canopen.probe import STANDARD_OBJECTS, may_be_read
from barewire_workbench.conform.canopen.transfers import download_steps, upload_steps

_OBJECTS, _EDS, _PDO = "CiA 301 7.4 object dictionary", "CiA 306 EDS", "CiA 301 7.2.2 PDO mapping"
_WRITE_ONLY = (0x0601_0001, 0x0601_0000)
_NO_OBJECT, _NO_SUB = 0x0602_0000, 0x0609_0011
_NOT_NOW = (0x0800_0020, 0x0800_0021, 0x0800_0022)
"""A write that the state of the device forbids: the cases of an EDS do not judge it."""
_NO_DATA = 0x0800_0024
_LIMITS = (0x0609_0030, 0x0609_0031, 0x0609_0032)
_UNMAPPED = (0x0604_0041, 0x0602_0000, 0x0604_0042)
_OFF = 0x8000_0000
_STRUCTURE = 0xFF
_HISTORY, _STORES, _SERIAL_NUMBER = 0x1003, (0x1010, 0x1011), (0x1018, 4)
_MAPPINGS = (*range(0x1600, 0x1800), *range(0x1A00, 0x1C00))
_CHANNELS_AND_PDOS = range(0x1200, 0x1C00)
"""SDO channels and PDOs: what can be written depends on whether they are in use, as the cases of PDOs test."""


def object_cases(subject: Subject, objects: Mapping[int, EdsObject], dummies: Iterable[int] = ()) -> Iterator[NodeCase]:
    """Yield the cases of all objects of an EDS, and of the dummies that it allows, for one device."""
    described = [DescribedItem(subject, of, item) for of, item in every_item(objects.values())]
    yield from (case for item in described for case in item.reads())
    yield from (case for of in objects.values() if of.items for case in _sub_indices(subject, of))
    yield from (case for of in objects.values() if of.items for case in _structure(subject, of))
    for index in STANDARD_OBJECTS:
        if index not in objects:
            yield _case(subject, f"OD-ABSENT-{index:04X}", f"{index:04X}h is not in the EDS: it does not exist",
                        Sdo(subject.node).refuse_read(index, 0, _NO_OBJECT), clause=_EDS, effect="reads",
                        why="06020000")  # fmt: skip
    yield from (case for item in described for case in item.defaults())
    yield from (case for item in described for case in item.writes())
    yield from (case for item in described for case in item.mappings())
    yield from (_dummy(subject, BY_CODE[code]) for code in sorted(dummies) if code in BY_CODE)


def _case(
    subject: Subject, name: str, title: str, *steps: NodeStep, clause: str, effect: Effect, why: str = "",
    needs: tuple[str, ...] = (),
) -> NodeCase:  # fmt: skip
    listens = (Sdo(subject.node).responses,)
    return make_case(subject, clause, listens, name, title, *steps, effect=effect, needs=needs, why=why)


def _sub_indices(subject: Subject, of: EdsObject) -> Iterator[NodeCase]:
    """Yield the case of the sub-indices between and after those that the EDS describes."""
    subs = {item.sub for item in of.items}
    there = next((item for item in of.items if item.access != "wo"), None)
    if there is None or max(subs) >= 0xFE:
        return
    missing = [sub for sub in range(max(subs) + 2) if sub not in subs][-8:]
    steps = [Sdo(subject.node).refuse_read(of.index, sub, _NO_SUB) for sub in missing]
    listed = ", ".join(f"{sub:02X}" for sub in missing)
    needs = () if there.type == "domain" else (f"{of.index:04X}h:{there.sub:02X}",)  # domains are not read beforehand
    yield _case(subject, f"OD-SUB-{of.index:04X}", f"{of.index:04X}h {of.name}: no sub-index {listed}", *steps,
                clause=_EDS, effect="reads", needs=needs, why="06090011")  # fmt: skip


def _structure(subject: Subject, of: EdsObject) -> Iterator[NodeCase]:
    """Yield the case of sub-index FFh, which a device may have: the structure of the object.   [CiA 301 7.4.1]

        585#43 00 20 FF 07 06 00 00     2000h is a variable (07h) of UNSIGNED16 (0006h)

    The elements of an array have its type; the number of a record's own type is not in an EDS.
    """
    s, items = Sdo(subject.node), [item for item in of.items if item.sub or not of.is_record]
    there = next((item for item in of.items if may_be_read(item)), None)
    if there is None or not items or any(item.sub == _STRUCTURE for item in items):
        return
    kind = ".." if of.object_type == RECORD else f"{items[0].code & 0xFF:02X}"
    accepted = s.response(f"43{multiplexer(of.index, _STRUCTURE)}{of.object_type:02X}{kind}0000")
    asked = NodeStep(
        (s.upload(of.index, _STRUCTURE),), (s.refused(of.index, _STRUCTURE, _NO_SUB, _NO_OBJECT), accepted)
    )
    yield _case(subject, f"OD-TYPE-{of.index:04X}", f"{of.index:04X}h {of.name}: the structure in sub-index FFh", asked,
                clause=_OBJECTS, effect="reads", needs=(f"{of.index:04X}h:{there.sub:02X}",),
                why="06090011: it has none")  # fmt: skip


def _dummy(subject: Subject, kind: DataType) -> NodeCase:
    """Return the case that maps a data type as a placeholder into the first RPDO. Its length may be verified or not."""
    s, pdo = Sdo(subject.node), subject.pdo(0x1400, 0x1600)
    off, empty, mapping = _emptied(s, pdo, 0x1400)
    entry, count = s.write(mapping, 1, kind.code << 16 | kind.bits, 4), s.write(mapping, 0, 1, 1)
    return _case(subject, f"OD-DUMMY-{kind.code:04X}",
                 f"the dummy {kind.standard} can be mapped into an RPDO", off, empty, entry, count, clause=_PDO,
                 effect="writes", needs=("RPDO",))  # fmt: skip


def _emptied(s: Sdo, pdo: SubjectPdo | None, first: int) -> tuple[NodeStep, NodeStep, int]:
    """Return the steps that switch a PDO off and empty its mapping (a fixed one ends the case), and its index."""
    communication, mapping = (pdo.communication, pdo.mapping) if pdo else (first, first + 0x0200)
    off = s.write(communication, 1, (pdo.cob.pack() if pdo else 0) | _OFF, 4)
    fixed = s.refused(mapping, 0, *READ_ONLY_CODES, 0x0609_0030, 0x0800_0022)
    return off, s.write(mapping, 0, 0, 1)._replace(ends=(fixed,)), mapping


class DescribedItem:
    """One item of an EDS, the value that the device has for it, and its cases."""

    def __init__(self, subject: Subject, of: EdsObject, item: EdsItem) -> None:
        self.subject = subject
        self.of, self.item = of, item
        self.s = Sdo(subject.node)
        self.index, self.sub = self.place = of.index, item.sub
        self.address = f"{of.index:04X}:{item.sub:02X}"
        self.title = f"{of.index:04X}h:{item.sub:02X} {item.name}"
        self.size = object_codec(item.type).size
        self.value = subject.values.get(self.place)
        self.there = f"{of.index:04X}h:{item.sub:02X}"
        wrong = self.value is not None and self.size is not None and len(self.value) != self.size
        self.needs = (f"{OTHER_TYPE}{item.type}",) if wrong else (self.there,)

    def case(
        self, group: str, title: str, *steps: NodeStep, clause: str = _OBJECTS, effect: Effect = "tries",
        needs: tuple[str, ...] | None = None, why: str = "",
    ) -> NodeCase:  # fmt: skip
        """Return a case of this item."""
        return _case(self.subject, f"OD-{group}-{self.address}", f"{self.title}: {title}", *steps, clause=clause,
                     effect=effect, needs=self.needs if needs is None else needs, why=why)  # fmt: skip

    def reads(self) -> Iterator[NodeCase]:
        """Yield the case that reads the object, or is refused."""
        index, sub, s = self.index, self.sub, self.s
        if self.item.access == "wo":
            yield self.case("READ", "write-only", s.refuse_read(index, sub, *_WRITE_ONLY), effect="reads", needs=(),
                            why="06010001 or 06010000")  # fmt: skip
        elif may_be_read(self.item):
            place = multiplexer(index, sub)
            # An empty history, a domain without data, and an object that the state of the device hides.
            ends = [s.refused(index, sub, _NO_DATA, 0x0800_0022, *((_NO_SUB,) if index == _HISTORY and sub else ()))]
            if self.size is None:
                accepts = [s.response(f"4.{place}")]
            else:
                accepts = [s.response(f"41{place}{little(self.size, 4)}"), s.response(f"40{place}")]
                if self.size <= 4:
                    accepts.insert(0, s.sized(index, sub, self.size))
            length = "of any length" if self.size is None else f"of {self.size} byte{'s' * (self.size > 1)}"
            asked = NodeStep((s.upload(index, sub),), tuple(accepts), tuple(ends))
            yield self.case("READ", f"{self.item.access}, {self.item.type}, {length}", asked,
                            silence(s.abort, wait=0.02), effect="reads", needs=())  # fmt: skip

    def defaults(self) -> Iterator[NodeCase]:
        """Yield the case that compares the value after a reset with DefaultValue."""
        item, data = self.item, self.encoded(self.item.default)
        constant = item.access == "const" or (item.access == "ro" and (self.place in _IDENTITY or self._is_highest_sub))
        settable = item.access in ("rw", "rww") and self.index not in (_HISTORY, *_STORES)
        if data and may_be_read(item) and (constant or settable) and self.place != _SERIAL_NUMBER:
            needs = self.needs if len(data) <= 4 or self.value is None else (self.there,)
            yield self.case("DEFAULT", "its default after a reset", *read_steps(self.s, *self.place, data), clause=_EDS,
                            needs=needs, why=f"{item.default!r}")  # fmt: skip

    @property
    def _is_highest_sub(self) -> bool:
        """Whether it is sub-index 0 of a record or an array, and no number of errors or of mapped objects."""
        return self.sub == 0 and self.of.is_record and self.index != _HISTORY and self.index not in _MAPPINGS

    def writes(self) -> Iterator[NodeCase]:
        """Yield the cases that write the object: refused, or with the value that it has."""
        item, value, s = self.item, self.value or b"", self.s
        if item.flags & 1 or item.type == "domain":
            return
        if item.access in ("ro", "const"):
            yield self.case("ACCESS", "read-only", *self._refused(value or b"\0", *READ_ONLY_CODES),
                            why="06010002 or 06010000")  # fmt: skip
            return
        if self.index in (_HISTORY, *_STORES, *_CHANNELS_AND_PDOS):
            return
        if item.access != "wo":
            yield self.case("WRITE", "accepts the value that it has", *write_steps(s, *self.place, value or b"\0"),
                            *(read_steps(s, *self.place, value) if may_be_read(item) and value else ()))  # fmt: skip
        codes = (*_NOT_NOW, *READ_ONLY_CODES)  # a read-only object is reported by OD-WRITE
        if self.size is not None and self.size <= 4 and item.access != "wo":
            lengths = [size for size in (self.size + 1, self.size - 1) if 1 <= size <= 4]
            steps = [s.refuse(*self.place, int.from_bytes(value[:size], "little"), size, *LENGTH_CODES, *codes)
                     for size in lengths]  # fmt: skip
            if steps:
                listed = " and ".join(map(str, lengths))
                yield self.case("LENGTH", f"refuses {listed} bytes", *steps, why="06070010, 06070012, 06070013")
        beyond = [(word, data) for word, data in self._beyond() if data is not None]
        if beyond:
            steps = [step for _, data in beyond for step in self._refused(data, *_LIMITS, *codes)]
            needs = () if item.access == "wo" else self.needs
            yield self.case("LIMIT", f"refuses {' and '.join(word for word, _ in beyond)}", *steps, clause=_EDS,
                            needs=needs, why="06090030, 06090031, 06090032")  # fmt: skip

    def mappings(self) -> Iterator[NodeCase]:
        """Yield the cases that map the object into the first RPDO and the first TPDO."""
        if self.index < 0x2000 or self.size is None or self.size > 8:
            return
        bits = 1 if self.item.type == "bool" else 8 * self.size
        allowed = MAPPABLE[self.item.access] if self.item.pdo else ()
        if len(allowed) == 2:
            return  # AccessType rw does not say into which PDOs: devices allow one of them, or both
        yield self._mapping("RPDO", 0x1400, bits, mappable="RPDO" in allowed)
        yield self._mapping("TPDO", 0x1800, bits, mappable="TPDO" in allowed)

    def _mapping(self, kind: Literal["RPDO", "TPDO"], first: int, bits: int, *, mappable: bool) -> NodeCase:
        s, pdo = self.s, self.subject.pdo(first, first + 0x0200)
        off, empty, mapping = _emptied(s, pdo, first)
        entry = s.write(mapping, 1, self.index << 16 | self.sub << 8 | bits, 4)
        count = s.write(mapping, 0, 1, 1)
        if not mappable:
            entry = entry._replace(ends=(s.refused(mapping, 1, *_UNMAPPED),))
            count = s.refuse(mapping, 0, 1, 1, *_UNMAPPED)
        title = f"can {'' if mappable else 'not '}be mapped into {'an' if kind == 'RPDO' else 'a'} {kind}"
        return self.case(kind, title.replace("can not", "cannot"), off, empty, entry, count, clause=_PDO,
                         effect="writes", needs=(kind,), why="" if mappable else "06040041")  # fmt: skip

    def _beyond(self) -> Iterator[tuple[str, bytes | None]]:
        """Yield the values below and above the limits, None for one that the type cannot hold."""
        low, high = (self.at_node(limit) for limit in self.item.limits)
        if self.size is None:
            return
        # One is less than the resolution of a large REAL: such a limit is passed by a thousandth of it.
        if isinstance(low, (int, float)):
            yield f"less than {low}", self.encoded(low - (1 if isinstance(low, int) else max(1, abs(low) / 1000)))
        if isinstance(high, (int, float)):
            yield f"more than {high}", self.encoded(high + (1 if isinstance(high, int) else max(1, abs(high) / 1000)))

    def at_node(self, value: Expression | None) -> Value | None:
        """Return a value of the EDS for the node-ID of the device: $NODEID+180h is 185h for node 5."""
        return value.at(self.subject.node) if isinstance(value, Formula) else value

    def encoded(self, value: Expression | None) -> bytes | None:
        """Return a value as bytes, None if the type cannot hold it."""
        value = self.at_node(value)
        try:
            return None if value is None else object_codec(self.item.type).encode(value)
        except EncodeError:
            return None

    def _refused(self, data: bytes, *codes: int) -> tuple[NodeStep, ...]:
        """Return the steps of a write that is refused, at its start or at its end."""
        s = self.s
        if len(data) <= 4:
            return (s.refuse(*self.place, int.from_bytes(data, "little"), len(data), *codes),)
        refused = s.refused(*self.place, *codes)
        steps = write_steps(s, *self.place, data)
        steps[0] = steps[0]._replace(ends=(refused,))
        last = steps[-1]._replace(accepts=(refused,))
        return (*(step._replace(ends=(refused,)) for step in steps[:-1]), last)


_IDENTITY = ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 3))
"""The read-only objects whose values are the same in each device of a kind."""


def read_steps(s: Sdo, index: int, sub: int, data: bytes) -> list[NodeStep]:
    """Return the steps that read this value, in one frame or in segments."""
    if len(data) <= 4:
        return [s.read(index, sub, data)]
    return upload_steps(s, multiplexer(index, sub), data)


def write_steps(s: Sdo, index: int, sub: int, data: bytes) -> list[NodeStep]:
    """Return the steps that write this value, or that the state of the device forbids."""
    not_now = (s.refused(index, sub, *_NOT_NOW),)
    if len(data) <= 4:
        step = s.write(index, sub, int.from_bytes(data, "little"), len(data))
        return [step._replace(ends=not_now)]
    return [step._replace(ends=not_now) for step in download_steps(s, multiplexer(index, sub), data)]
