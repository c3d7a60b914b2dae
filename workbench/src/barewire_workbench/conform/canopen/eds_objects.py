"""Conformance cases of the objects of a device: as its EDS describes them, and in random order.   [CiA 301 7.4]

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
        OD-RANGE-2000:00     an application object accepts its limits and values between them, and keeps them
        RND-01 to RND-04     communication objects are read and written in random order     [CiA 301 7.2.4]
        RND-05, RND-06       application objects are read, and written and read, in random order

Bit 0 of ObjFlags leaves out the writes of an object, bit 1 its reads.

OD-RANGE and RND-06 write the objects 2000h to 9FFFh with other values than they have. A number with LowLimit and
HighLimit gets both limits and three values between them. The EDS does not say which others are safe: an object without
limits gets its DefaultValue, a BOOLEAN both values. The controlword of each axis of a drive is never written, since it
switches the power stage on. After each case, `restore_values` gives the objects the values that they had.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Final, Literal

from barewire.canopen.datatypes import BY_CODE, DataType, object_codec
from barewire.canopen.eds.objects import MAPPABLE, RECORD, REFUSES_READ, REFUSES_WRITE, EdsItem, EdsObject, every_item
from barewire.canopen.eds.value_syntax import Expression, Formula
from barewire.canopen.object_dictionary import ObjectAddress
from barewire.codecs import Value
from barewire.errors import EncodeError
from barewire_workbench.conform.canopen.model import (
    HEARTBEAT,
    LENGTH_CODES,
    OTHER_TYPE,
    PRE,
    READ_ONLY_CODES,
    START,
    STOP,
    Effect,
    NodeCase,
    NodeStep,
    Sdo,
    Subject,
    SubjectPdo,
    little,
    make_case,
    multiplexer,
    nmt_command,
    silence,
)
from barewire_workbench.conform.canopen.probe import STANDARD_OBJECTS, may_be_read
from barewire_workbench.conform.canopen.script import download_steps, upload_steps

_RANDOM = "CiA 301 7.2.4 SDO in each state"


def random_cases(subject: Subject) -> Iterator[NodeCase]:
    """Yield reads and writes of communication objects whose order and values only depend on the node-ID."""
    s, order = Sdo(subject.node), irregular(subject.node)
    case = partial(make_case, subject, _RANDOM, (s.responses,))
    short = sorted(place for place, data in subject.values.items() if 1 <= len(data) <= 4 and place[0] < 0x2000)
    places = [_choice(order, short) for _ in range(50 if short else 0)]
    reads = [NodeStep((s.upload(*place),), (s.sized(*place, len(subject.values[place])),)) for place in places]
    yield case("RND-01", "50 reads of 1000h to 1FFFh in random order", *(reads or [s.works]), effect="reads")
    changes = partial(case, effect="commands", needs=HEARTBEAT)
    start, stop, back = (silence(nmt_command(command, subject.node), wait=0.02) for command in (START, STOP, PRE))
    title = "10 random writes in {}, each read back"
    yield changes("RND-02", title.format("PRE-OPERATIONAL"), *_random_writes(subject, order))
    yield changes("RND-03", title.format("OPERATIONAL"), start, *_random_writes(subject, order))
    unheard = [silence(s.download(0x1017, 0, 20_000 + next(order) % 10_000, 2), wait=0.05) for _ in range(5)]
    unread = [silence(s.upload(*_choice(order, short or [(0x1000, 0)])), wait=0.05) for _ in range(5)]
    yield changes(
        "RND-04",
        "10 random reads and writes in STOPPED: no answer, nothing is written",
        s.write(0x1017, 0, 30_000, 2),
        stop,
        *(step for pair in zip(unheard, unread) for step in pair),
        back,
        NodeStep((s.upload(0x1017),), (s.response(f"4B171000{little(30_000, 2)}"),)),
    )


def _random_writes(subject: Subject, order: Iterator[int]) -> list[NodeStep]:
    """Return writes of times that are so long that no heartbeat disturbs the cases, each read back."""
    s, steps = Sdo(subject.node), list[NodeStep]()
    for _ in range(10):
        period, watch = 20_000 + next(order) % 40_000, subject.other_node << 16 | 1 + next(order) % 0xFFFF
        steps += [s.write(0x1017, 0, period, 2), s.read(0x1017, 0, period.to_bytes(2, "little"))]
        if subject.has(0x1016, 1):
            steps += [s.write(0x1016, 1, watch, 4), s.read(0x1016, 1, watch.to_bytes(4, "little"))]
    return steps


def irregular(start: int) -> Iterator[int]:
    """Yield numbers of 31 bits in an irregular order, the same for each start (Park and Miller's generator)."""
    number = start
    while True:
        number = number * 48_271 % 0x7FFF_FFFF
        yield number


def _choice(order: Iterator[int], places: list[ObjectAddress]) -> ObjectAddress:
    return places[next(order) % len(places)]


# Objects of an EDS --------------------------------------------------------------------------------------------------


_OBJECTS, _EDS, _PDO = "CiA 301 7.4 object dictionary", "CiA 306 EDS", "CiA 301 7.2.2 PDO mapping"
_WRITE_ONLY = (0x0601_0001, 0x0601_0000)
_NO_OBJECT, _NO_SUB = 0x0602_0000, 0x0609_0011
_NOT_NOW = (0x0800_0020, 0x0800_0021, 0x0800_0022)
"""A write that the state of the device forbids: the cases of an EDS do not judge it."""
_NOT_JUDGED = (*_NOT_NOW, *READ_ONLY_CODES)
"""Refusals of a write for another reason: a read-only object is reported by OD-WRITE."""
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
    readable = next((item for item in of.items if item.access != "wo"), None)
    if readable is None or max(subs) >= 0xFE:
        return
    missing = [sub for sub in range(max(subs) + 2) if sub not in subs][-8:]
    steps = [Sdo(subject.node).refuse_read(of.index, sub, _NO_SUB) for sub in missing]
    listed = ", ".join(f"{sub:02X}" for sub in missing)
    # Domains are not read beforehand.
    needs = () if readable.type == "domain" else (f"{of.index:04X}h:{readable.sub:02X}",)
    yield _case(subject, f"OD-SUB-{of.index:04X}", f"{of.index:04X}h {of.name}: no sub-index {listed}", *steps,
                clause=_EDS, effect="reads", needs=needs, why="06090011")  # fmt: skip


def _structure(subject: Subject, of: EdsObject) -> Iterator[NodeCase]:
    """Yield the case of sub-index FFh, which a device may have: the structure of the object.   [CiA 301 7.4.1]

        585#43 00 20 FF 07 06 00 00     2000h is a variable (07h) of UNSIGNED16 (0006h)

    The elements of an array have its type; the number of a record's own type is not in an EDS.
    """
    s, items = Sdo(subject.node), [item for item in of.items if item.sub or not of.is_record]
    readable = next((item for item in of.items if may_be_read(item)), None)
    if readable is None or not items or any(item.sub == _STRUCTURE for item in items):
        return
    kind = ".." if of.object_type == RECORD else f"{items[0].code & 0xFF:02X}"
    accepted = s.response(f"43{multiplexer(of.index, _STRUCTURE)}{of.object_type:02X}{kind}0000")
    read = NodeStep((s.upload(of.index, _STRUCTURE),), (s.refused(of.index, _STRUCTURE, _NO_SUB, _NO_OBJECT), accepted))
    yield _case(subject, f"OD-TYPE-{of.index:04X}", f"{of.index:04X}h {of.name}: the structure in sub-index FFh", read,
                clause=_OBJECTS, effect="reads", needs=(f"{of.index:04X}h:{readable.sub:02X}",),
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
            read = NodeStep((s.upload(index, sub),), tuple(accepts), tuple(ends))
            yield self.case("READ", f"{self.item.access}, {self.item.type}, {length}", read,
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
        item, value = self.item, self.value or b"\0"
        if item.flags & REFUSES_WRITE or item.type == "domain":
            return
        if item.access in ("ro", "const"):
            yield self.case("ACCESS", "read-only", *self._refused(value, *READ_ONLY_CODES), why="06010002 or 06010000")
            return
        if self.index in (_HISTORY, *_STORES, *_CHANNELS_AND_PDOS):
            return
        if item.access != "wo":
            read_back = read_steps(self.s, *self.place, value) if may_be_read(item) and self.value else []
            steps = (*write_steps(self.s, *self.place, value), *read_back)
            yield self.case("WRITE", "accepts the value that it has", *steps)
            yield from self._wrong_lengths()
        yield from self._beyond_limits()

    def _wrong_lengths(self) -> Iterator[NodeCase]:
        value = self.value or b""
        lengths = [] if self.size is None or self.size > 4 else [self.size + 1, self.size - 1]
        lengths = [length for length in lengths if 1 <= length <= 4]
        codes = (*LENGTH_CODES, *_NOT_JUDGED)
        steps = [self.s.refuse(*self.place, int.from_bytes(value[:length], "little"), length, *codes)
                 for length in lengths]  # fmt: skip
        if steps:
            title = f"refuses {' and '.join(map(str, lengths))} bytes"
            yield self.case("LENGTH", title, *steps, why="06070010, 06070012, 06070013")

    def _beyond_limits(self) -> Iterator[NodeCase]:
        beyond = [(word, data) for word, data in self._beyond() if data is not None]
        steps = [step for _, data in beyond for step in self._refused(data, *_LIMITS, *_NOT_JUDGED)]
        if steps:
            title = f"refuses {' and '.join(word for word, _ in beyond)}"
            needs = () if self.item.access == "wo" else self.needs
            yield self.case("LIMIT", title, *steps, clause=_EDS, needs=needs, why="06090030, 06090031, 06090032")

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


# Application objects of an EDS --------------------------------------------------------------------------------------


_CONTROLWORDS: Final = frozenset(range(0x6040, 0xA000, 0x0800))
"""6040h, and those of the axes 2 to 8 of a drive: 6840h, 7040h, ...   [CiA 402-2]"""
_OTHERS_FORBID = (0x0604_0043, 0x0604_0047, 0x0609_0036, *READ_ONLY_CODES)
"""The value does not go with those of other objects (06090036: a maximum below the minimum); OD-WRITE reports 0601."""
_RANDOM_ORDER = "CiA 301 7.2.4 SDO in random order"


def application_cases(subject: Subject, objects: Mapping[int, EdsObject]) -> Iterator[NodeCase]:
    """Yield the cases of the application objects that the EDS describes, for one device."""
    described = [DescribedItem(subject, of, item) for of, item in every_item(objects.values()) if of.index >= 0x2000]
    order = irregular(subject.node)
    writable = {item: values for item in described if (values := _values(item, order))}
    for item, values in writable.items():
        steps = [step for value in values for step in (*_write(item, value), *read_steps(item.s, *item.place, value))]
        listed = f"{len(values)} value{'s' * (len(values) > 1)}"
        title = f"accepts {listed} within its limits, and keeps them" if len(values) > 1 else "accepts its default"
        yield item.case("RANGE", title, *steps, effect="application", why="or the state of the device forbids it")
    yield from _random_order(subject, described, writable, order)


def _random_order(
    subject: Subject, described: list[DescribedItem], writable: dict[DescribedItem, list[bytes]], order: Iterator[int]
) -> Iterator[NodeCase]:
    s = Sdo(subject.node)
    readable = [item for item in described if item.value and len(item.value) <= 4]
    reads = [_read(readable[next(order) % len(readable)]) for _ in range(50 if readable else 0)]
    case = partial(make_case, subject, _RANDOM_ORDER, (s.responses,))
    reading = case("RND-05", "50 reads of application objects in random order", *(reads or [s.works]), effect="reads")
    yield reading._replace(lacks="" if readable else "a readable object from 2000h on")
    # Longer values need several frames: a write of one step, which may be refused, is followed by one read.
    short = [item for item in writable if item.value and len(item.value) == item.size and item.size <= 4]
    steps: list[NodeStep] = []
    for _ in range(50 if short else 0):
        item = short[next(order) % len(short)]
        values = writable[item]
        (step,) = _write(item, values[next(order) % len(values)])
        steps += [step._replace(accepts=(*step.accepts, *step.ends), ends=()), _read(item)]
    writing = case("RND-06", "50 writes of application objects in random order", *(steps or [s.works]),
                   effect="application", why="or the state of the device forbids it")  # fmt: skip
    yield writing._replace(lacks="" if short else "a writable object from 2000h on")


def _values(item: DescribedItem, order: Iterator[int]) -> list[bytes]:
    """Return the values that an object is given: those that the EDS names, and some between its limits."""
    described, low, high = item.item, *(item.at_node(limit) for limit in item.item.limits)
    is_refused = described.flags & (REFUSES_WRITE | REFUSES_READ)
    if described.access not in ("rw", "rww", "rwr") or is_refused or item.index in _CONTROLWORDS:
        return []
    if item.size is None:
        return []
    values: list[bytes | None] = [item.encoded(described.default)]
    if described.type == "bool":
        values = [b"\0", b"\1"]
    elif isinstance(low, int) and isinstance(high, int) and low <= high:
        between = [low + next(order) % (high - low + 1) for _ in range(3)]
        values = [item.encoded(value) for value in (low, *between, high)]
    elif isinstance(low, (int, float)) and isinstance(high, (int, float)) and low <= high:
        values = [item.encoded(value) for value in (low, low + (high - low) / 2, high)]
        # The nearest REAL32 of a limit such as 1E21 may lie beyond it.
        codec = object_codec(described.type)
        values = [data for data in values if data and low <= float(codec.decode(data)) <= high]
    return list(dict.fromkeys(data for data in values if data))


def _write(item: DescribedItem, value: bytes) -> list[NodeStep]:
    """Return the steps of a write, which may end with a refusal that other objects are the reason of."""
    refused = item.s.refused(*item.place, *_OTHERS_FORBID)
    return [step._replace(ends=(*step.ends, refused)) for step in write_steps(item.s, *item.place, value)]


def _read(item: DescribedItem) -> NodeStep:
    """Return the step that reads any value of the length that the object has."""
    return NodeStep((item.s.upload(*item.place),), (item.s.sized(*item.place, len(item.value or b"0000")),))
