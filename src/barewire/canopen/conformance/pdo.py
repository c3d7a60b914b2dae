"""Conformance cases of PDOs: their records, the order in which these change, and process data.   [CiA 301 7.2.2]

The first valid RPDO and the first valid TPDO are tested. The RPDO gets zeros.
"""

from __future__ import annotations

from collections.abc import Iterator

from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.conformance.frames import Sdo, make_case, multiplexer
from barewire.canopen.conformance.model import BOOT, SILENCE, Effect, NodeCase, NodeStep, Subject, SubjectPdo

_CLAUSE = "CiA 301 7.2.2 PDO"
_VALUE, _ACCESS = 0x0609_0030, 0x0601_0000
_HIGH = 0x0609_0031
_NO_OBJECT, _NO_SUB = 0x0602_0000, 0x0609_0011
_NOT_MAPPABLE, _TOO_LONG = 0x0604_0041, 0x0604_0042
_OFF = 0x8000_0000


def pdo_cases(subject: Subject) -> Iterator[NodeCase]:
    """Yield the cases for this device."""
    node = subject.node
    for what, short, tried, fallback in (
        ("RPDO", "RPD", subject.pdo(0x1400, 0x1600), SubjectPdo(0x1400, 0x1600, CobEntry(0x200 + node), 2, 2)),
        ("TPDO", "TPD", subject.pdo(0x1800, 0x1A00), SubjectPdo(0x1800, 0x1A00, CobEntry(0x180 + node), 2, 2)),
    ):
        yield from _records(subject, what, short, tried or fallback)
    yield from _received(
        subject, subject.pdo(0x1400, 0x1600) or SubjectPdo(0x1400, 0x1600, CobEntry(0x200 + node), 2, 2)
    )
    yield from _sent(subject, subject.pdo(0x1800, 0x1A00) or SubjectPdo(0x1800, 0x1A00, CobEntry(0x180 + node), 2, 2))


def _records(subject: Subject, what: str, short: str, pdo: SubjectPdo) -> Iterator[NodeCase]:
    """Yield the two records of a PDO, and when their objects can be written."""
    s = Sdo(subject.node)
    at, mapping, word = pdo.communication, pdo.mapping, pdo.cob.pack()
    elsewhere = (0x1FE if what == "TPDO" else 0x27E) | word & 0x4000_0000

    def case(
        number: int, title: str, *steps: NodeStep, why: str = "", effect: Effect = "writes", needs: tuple[str, ...] = ()
    ) -> NodeCase:
        listens = (s.answer("")[:4],)
        name, title = f"{short}-{number:02d}", f"{what}: {title}"
        needs = (what, *needs)
        return make_case(subject, name, title, _CLAUSE, steps, effect=effect, listens=listens, needs=needs, why=why)

    def write(index: int, sub: int, value: int, size: int) -> NodeStep:
        return NodeStep((s.download(index, sub, value, size),), (s.accepted(index, sub),))

    def refuse(index: int, sub: int, value: int, size: int, *codes: int) -> NodeStep:
        return NodeStep((s.download(index, sub, value, size),), (s.refused(index, sub, *codes),))

    off, on = write(at, 1, word | _OFF, 4), write(at, 1, word, 4)
    # A fixed mapping refuses a write of its count; this ends the case.
    fixed = s.refused(mapping, 0, _ACCESS, 0x0601_0002, _VALUE, 0x0800_0022)
    empty = write(mapping, 0, 0, 1)._replace(ends=(fixed,))
    first = subject.number(mapping, 1)
    highest = NodeStep((s.upload(at),), (s.answer(f"4F{multiplexer(at, 0)}0[2-6]"),))
    yield case(1, "sub-index 0 of the communication record", highest, effect="reads", why="2 to 6")
    yield case(2, "type 245 is reserved", refuse(at, 2, 245, 1, _VALUE, _HIGH), why="06090030")
    if what == "RPDO":
        yield case(3, "type 253 is not for RPDOs", refuse(at, 2, 253, 1, _VALUE, _HIGH), why="06090030")
    yield case(4, "type 1 and type 255 are accepted", write(at, 2, 1, 1), write(at, 2, 255, 1),
               NodeStep((s.upload(at, 2),), (s.value(at, 2, b"\xff"),)))  # fmt: skip
    yield case(5, "another COB-ID while it is on", refuse(at, 1, elsewhere, 4, _VALUE), why="06090030")
    yield case(6, "switched off and on again", off,
               NodeStep((s.upload(at, 1),), (s.value(at, 1, _four(word | _OFF)),)), on,
               NodeStep((s.upload(at, 1),), (s.value(at, 1, _four(word)),)))  # fmt: skip
    yield case(7, "switched off, it accepts another COB-ID", off, write(at, 1, elsewhere, 4),
               NodeStep((s.upload(at, 1),), (s.value(at, 1, _four(elsewhere)),)))  # fmt: skip
    yield case(8, "a reserved COB-ID is refused", off, refuse(at, 1, 0x580 + subject.node, 4, _VALUE, _HIGH),
               why="06090030")  # fmt: skip
    yield case(9, "the inhibit time while it is on", refuse(at, 3, 100, 2, _VALUE, 0x0800_0022),
               needs=(f"{at:04X}h:03",), why="06090030")  # fmt: skip
    yield case(10, "the inhibit time when it is off", off, write(at, 3, 100, 2), on, needs=(f"{at:04X}h:03",))
    yield case(11, "the event timer while it is on", write(at, 5, 100, 2), needs=(f"{at:04X}h:05",))
    yield case(12, "the count of the mapping while it is on",
               refuse(mapping, 0, 0, 1, _ACCESS, 0x0601_0002, _NOT_MAPPABLE, _VALUE, 0x0800_0022),
               why="06010000: switched off first")  # fmt: skip
    counted = refuse(mapping, 1, first, 4, _ACCESS, 0x0601_0002, _NOT_MAPPABLE)
    yield case(13, "an entry of the mapping while its count is not 0", off, counted, why="06010000 or 06040041")
    yield case(14, "an entry for an object that does not exist", off, empty,
               refuse(mapping, 1, 0x0FFF_0008, 4, _NO_OBJECT, _NOT_MAPPABLE), why="06020000 or 06040041")  # fmt: skip
    yield case(15, "an entry for a sub-index that does not exist", off, empty,
               refuse(mapping, 1, 0x1000_FE20, 4, _NO_OBJECT, _NOT_MAPPABLE, _NO_SUB), why="06040041")  # fmt: skip
    count = subject.number(mapping)
    restored = [write(mapping, sub, subject.number(mapping, sub), 4) for sub in range(1, count + 1)]
    yield case(16, "the whole mapping rewritten in the safe order", off, empty, *restored,
               write(mapping, 0, count, 1), on, why="off, 0, entries, count, on")  # fmt: skip
    beyond = refuse(mapping, 0, 65, 1, _TOO_LONG, _ACCESS, _NO_OBJECT, _NOT_MAPPABLE, _VALUE, _HIGH)
    yield case(17, "more entries than there can be", off, empty, beyond, why="06040042")
    times = 64 // (first & 0xFF or 64) + 1
    again = [write(mapping, sub, first, 4)._replace(
        ends=(s.refused(mapping, sub, _TOO_LONG, _NOT_MAPPABLE, _NO_SUB),)) for sub in range(1, times + 1)]  # fmt: skip
    yield case(18, "more than eight bytes", off, empty, *again,
               refuse(mapping, 0, times, 1, _TOO_LONG, _NOT_MAPPABLE, _ACCESS, _NO_OBJECT),
               needs=(f"{mapping:04X}h:{times:02X}",), why="06040042")  # fmt: skip
    boots = NodeStep((f"000#82{subject.node:02X}",), (SILENCE,), wait=BOOT / 3, full_wait=True)
    back = NodeStep((s.upload(mapping),), (s.value(mapping, 0, bytes([count])),))
    yield case(19, "a reset of the communication restores the mapping", off, empty, boots, back,
               NodeStep((s.upload(at, 1),), (s.value(at, 1, _four(word)),)), effect="commands")  # fmt: skip


def _four(word: int) -> bytes:
    return word.to_bytes(4, "little")


class _ProcessData:
    """Steps of process data."""

    def __init__(self, subject: Subject, pdo: SubjectPdo) -> None:
        self.s = Sdo(subject.node)
        self.name = f"{pdo.cob.identifier:03X}#"
        self.start = NodeStep((f"000#01{subject.node:02X}",), (SILENCE, f"{self.name}{'.' * 2 * pdo.size}"), wait=0.05,
                          full_wait=True)  # fmt: skip
        self.stop = NodeStep((f"000#02{subject.node:02X}",), (SILENCE,), wait=0.02)
        self.works = NodeStep((self.s.upload(0x1000),), (self.s.any_value(0x1000),))

    def write(self, index: int, sub: int, value: int, size: int, *ends: str) -> NodeStep:
        return NodeStep((self.s.download(index, sub, value, size),), (self.s.accepted(index, sub),), ends)


def _received(subject: Subject, pdo: SubjectPdo) -> Iterator[NodeCase]:
    process = _ProcessData(subject, pdo)
    s, name = process.s, process.name
    alarm = f"{0x80 + subject.node:03X}#"
    whole, short = "00" * pdo.size, "00" * (pdo.size - 1)

    def case(
        number: int, title: str, *steps: NodeStep, needs: tuple[str, ...] = ("RPDO", "1014h"), why: str = ""
    ) -> NodeCase:
        listens = (alarm, s.answer("")[:4])
        return make_case(subject, f"RPD-{number}", f"RPDO: {title}", _CLAUSE, steps, effect="commands", listens=listens,
                   needs=needs, why=why)  # fmt: skip

    quiet = (SILENCE,)
    good = NodeStep((f"{name}{whole}",), quiet, wait=0.1)
    yield case(30, "of the mapped length", process.start, good, process.works)
    yield case(
        31, "too short: emergency 8210h", process.start, NodeStep((f"{name}{short}",), (f"{alarm}1082............",))
    )
    twice = NodeStep((f"{name}{short}",), quiet, wait=0.2)
    yield case(32, "too short twice: one emergency", process.start,
               NodeStep((f"{name}{short}",), (f"{alarm}1082............",)), twice)  # fmt: skip
    if pdo.size < 8:
        yield case(33, "too long: emergency 8220h, or the first bytes are used", process.start,
                   NodeStep((f"{name}{whole}00",), (f"{alarm}2082............", SILENCE), wait=0.2))  # fmt: skip
    yield case(34, "ignored in PRE-OPERATIONAL", NodeStep((f"{name}{short}",), quiet, wait=0.2), process.works)
    stopped = NodeStep((f"{name}{short}",), quiet, wait=0.2)
    yield case(35, "ignored in STOPPED", process.start, process.stop, stopped)
    yield case(36, "a remote frame is ignored", process.start, NodeStep((f"{name}R{pdo.size}",), quiet, wait=0.2))
    extended = NodeStep((f"{pdo.cob.identifier:08X}#{short}",), quiet, wait=0.2)
    yield case(37, "a frame of the same number with 29 bits is ignored", process.start, extended)
    word = pdo.cob.pack()
    off = process.write(pdo.communication, 1, word | _OFF, 4)
    yield case(38, "switched off it is ignored", off, process.start, NodeStep((f"{name}{short}",), quiet, wait=0.2))
    moved = process.write(pdo.communication, 1, 0x27E, 4)
    alarmed = NodeStep((f"27E#{short}",), (f"{alarm}1082............",))
    yield case(39, "with another COB-ID it is received there, and only there", off, moved, process.start,
               NodeStep((f"{name}{short}",), quiet, wait=0.2), alarmed)  # fmt: skip
    # The device monitors the RPDO from the first one on.
    timer = process.write(pdo.communication, 5, 100, 2)
    at_once = process.write(pdo.communication, 2, 255, 1)
    missed = NodeStep((), (f"{alarm}5082............", SILENCE), wait=0.5)
    needs = ("RPDO", "1014h", f"{pdo.communication:04X}h:05")
    yield case(40, "event timer: emergency 8250h when the RPDO stops", at_once, timer, process.start, good, missed,
               needs=needs, why="or the device does not monitor RPDOs")  # fmt: skip


def _sent(subject: Subject, pdo: SubjectPdo) -> Iterator[NodeCase]:
    process = _ProcessData(subject, pdo)
    s, name, at = process.s, process.name, pdo.communication
    data = f"{name}{'.' * 2 * pdo.size}"
    word = pdo.cob.pack()
    refused = s.refused(at, 2, _VALUE, _HIGH)

    def case(number: int, title: str, *steps: NodeStep, needs: tuple[str, ...] = ("TPDO",), why: str = "") -> NodeCase:
        listens = (name, s.answer("")[:4], "1FE#")
        return make_case(subject, f"TPD-{number}", f"TPDO: {title}", _CLAUSE, steps, effect="commands", listens=listens,
                   needs=needs, why=why)  # fmt: skip

    def kind(number: int) -> NodeStep:
        return process.write(at, 2, number, 1, refused)

    sync = NodeStep(("080#",), (data,))
    no = NodeStep(("080#",), (SILENCE,), wait=0.1)
    start = process.start
    yield case(30, "type 1: one with every SYNC, of the mapped length", kind(1), start, sync, sync, sync)
    yield case(31, "type 2: one with every second SYNC", kind(2), start, no, sync, no, sync)
    yield case(32, "type 240: none with the first SYNC", kind(240), start, no)
    yield case(33, "none in PRE-OPERATIONAL", kind(1), no, no)
    yield case(34, "none in STOPPED", kind(1), start, sync, process.stop, no)
    back = NodeStep((f"000#80{subject.node:02X}",), (SILENCE,), wait=0.02)
    yield case(35, "none in PRE-OPERATIONAL again", kind(1), start, sync, back, no)
    off = process.write(at, 1, word | _OFF, 4)
    yield case(36, "switched off: none", kind(1), off, start._replace(accepts=(SILENCE,)), no)
    elsewhere = process.write(at, 1, 0x1FE | word & 0x4000_0000, 4)
    moved = NodeStep(("080#",), (f"1FE#{'.' * 2 * pdo.size}",))
    yield case(37, "on another COB-ID", kind(1), off, elsewhere, start._replace(accepts=(SILENCE,)), moved)
    timer = process.write(at, 5, 100, 2)
    running = NodeStep((), (f"{data}{{3,7}}",), wait=0.5, full_wait=True)
    yield case(38, "type 255 and an event timer of 100 ms", kind(255), timer, start, running,
               needs=("TPDO", f"{at:04X}h:05"), why="3 to 7 in 500 ms; more where values change")  # fmt: skip
    none = process.write(at, 5, 0, 2)
    still = NodeStep((), (SILENCE, f"{data}{{1,30}}"), wait=0.3, full_wait=True)
    yield case(39, "the event timer off again, while it runs", kind(255), timer, start, running,
               none._replace(accepts=(*none.accepts, f"{data}, {none.accepts[0]}")), still,
               needs=("TPDO", f"{at:04X}h:05"))  # fmt: skip
    ask = NodeStep((f"{name}R{pdo.size}",), (data,))
    if pdo.cob.bit30:
        yield case(40, "bit 30 set: a remote frame is not answered", kind(1), start,
                   NodeStep((f"{name}R{pdo.size}",), (SILENCE,), wait=0.1))  # fmt: skip
    else:
        yield case(40, "type 253: a remote frame is answered, SYNC is not", kind(253), start, no, ask,
                   why="or the type is refused: 06090030")  # fmt: skip
    yield case(41, "SYNC with 29 bits is ignored", kind(1), start,
               NodeStep(("00000080#",), (SILENCE,), wait=0.1), sync)  # fmt: skip
    yield case(42, "start twice: still one with every SYNC", kind(1), start, start, sync, sync)
