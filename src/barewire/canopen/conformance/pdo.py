"""Conformance cases of PDOs: their records, the order in which these change, and process data.   [CiA 301 7.2.2]

The first valid RPDO and the first valid TPDO are tested. The RPDO gets zeros.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.conformance.frames import Sdo, make_case, multiplexer, silence
from barewire.canopen.conformance.model import BOOT, SILENCE, Effect, NodeCase, NodeStep, Subject, SubjectPdo

# Each case is a row: name, title, steps, needs, reason.
# fmt: off

_CLAUSE = "CiA 301 7.2.2 PDO"
_VALUE, _ACCESS = 0x0609_0030, 0x0601_0000
_HIGH = 0x0609_0031
_NO_OBJECT, _NO_SUB = 0x0602_0000, 0x0609_0011
_NOT_MAPPABLE, _TOO_LONG = 0x0604_0041, 0x0604_0042
_OFF = 0x8000_0000


def pdo_cases(subject: Subject) -> Iterator[NodeCase]:
    """Yield the cases of this service for one device."""
    node = subject.node
    rpdo = subject.pdo(0x1400, 0x1600) or SubjectPdo(0x1400, 0x1600, CobEntry(0x200 + node), 2, 2)
    tpdo = subject.pdo(0x1800, 0x1A00) or SubjectPdo(0x1800, 0x1A00, CobEntry(0x180 + node), 2, 2)
    yield from _records(subject, "RPDO", "RPD", rpdo)
    yield from _records(subject, "TPDO", "TPD", tpdo)
    yield from _received(subject, rpdo)
    yield from _sent(subject, tpdo)


def _records(subject: Subject, direction: str, short: str, pdo: SubjectPdo) -> Iterator[NodeCase]:
    """Yield the cases of the two records of a PDO, and of when their objects can be written."""
    s = Sdo(subject.node)
    record, mapping, word = pdo.communication, pdo.mapping, pdo.cob.pack()
    elsewhere = (0x1FE if direction == "TPDO" else 0x27E) | word & 0x4000_0000

    def case(
        number: int, title: str, *steps: NodeStep, why: str = "", effect: Effect = "writes", needs: tuple[str, ...] = ()
    ) -> NodeCase:
        name, title = f"{short}-{number:02d}", f"{direction}: {title}"
        needs = (direction, *needs)
        return make_case(subject, _CLAUSE, (s.responses,), name, title, *steps, effect=effect, needs=needs, why=why)

    write, refuse = s.write, s.refuse
    off, on = write(record, 1, word | _OFF, 4), write(record, 1, word, 4)
    # A fixed mapping refuses a write of its count; this ends the case.
    fixed = s.refused(mapping, 0, _ACCESS, 0x0601_0002, _VALUE, 0x0800_0022)
    empty = write(mapping, 0, 0, 1)._replace(ends=(fixed,))
    first = subject.number(mapping, 1)
    highest = NodeStep((s.upload(record),), (s.response(f"4F{multiplexer(record, 0)}0[2-6]"),))
    yield case(1, "sub-index 0 of the communication record", highest, effect="reads", why="2 to 6")
    yield case(2, "type 245 is reserved", refuse(record, 2, 245, 1, _VALUE, _HIGH), why="06090030")
    if direction == "RPDO":
        yield case(3, "type 253 is not for RPDOs", refuse(record, 2, 253, 1, _VALUE, _HIGH), why="06090030")
    yield case(4, "type 1 and type 255 are accepted", write(record, 2, 1, 1), write(record, 2, 255, 1),
               s.read(record, 2, b"\xff"))
    yield case(5, "another COB-ID while it is on", refuse(record, 1, elsewhere, 4, _VALUE), why="06090030")
    yield case(6, "switched off and on again", off, s.read(record, 1, _four(word | _OFF)), on,
               s.read(record, 1, _four(word)))
    yield case(7, "switched off, it accepts another COB-ID", off, write(record, 1, elsewhere, 4),
               s.read(record, 1, _four(elsewhere)))
    yield case(8, "a reserved COB-ID is refused", off, refuse(record, 1, 0x580 + subject.node, 4, _VALUE, _HIGH),
               why="06090030")
    yield case(9, "the inhibit time while it is on", refuse(record, 3, 100, 2, _VALUE, 0x0800_0022),
               needs=(f"{record:04X}h:03",), why="06090030")
    yield case(10, "the inhibit time when it is off", off, write(record, 3, 100, 2), on, needs=(f"{record:04X}h:03",))
    yield case(11, "the event timer while it is on", write(record, 5, 100, 2), needs=(f"{record:04X}h:05",))
    yield case(12, "the count of the mapping while it is on",
               refuse(mapping, 0, 0, 1, _ACCESS, 0x0601_0002, _NOT_MAPPABLE, _VALUE, 0x0800_0022),
               why="06010000: switched off first")
    counted = refuse(mapping, 1, first, 4, _ACCESS, 0x0601_0002, _NOT_MAPPABLE)
    yield case(13, "an entry of the mapping while its count is not 0", off, counted, why="06010000 or 06040041")
    yield case(14, "an entry for an object that does not exist", off, empty,
               refuse(mapping, 1, 0x0FFF_0008, 4, _NO_OBJECT, _NOT_MAPPABLE), why="06020000 or 06040041")
    yield case(15, "an entry for a sub-index that does not exist", off, empty,
               refuse(mapping, 1, 0x1000_FE20, 4, _NO_OBJECT, _NOT_MAPPABLE, _NO_SUB), why="06040041")
    count = subject.number(mapping, 0, 1)
    restored = [write(mapping, sub, subject.number(mapping, sub), 4) for sub in range(1, count + 1)]
    yield case(16, "the whole mapping rewritten in the safe order", off, empty, *restored, write(mapping, 0, count, 1),
               on, why="off, 0, entries, count, on")
    beyond = refuse(mapping, 0, 65, 1, _TOO_LONG, _ACCESS, _NO_OBJECT, _NOT_MAPPABLE, _VALUE, _HIGH)
    yield case(17, "more entries than there can be", off, empty, beyond, why="06040042")
    times = 64 // (first & 0xFF or 64) + 1
    again = [
        write(mapping, sub, first, 4)._replace(ends=(s.refused(mapping, sub, _TOO_LONG, _NOT_MAPPABLE, _NO_SUB),))
        for sub in range(1, times + 1)
    ]
    yield case(18, "more than eight bytes", off, empty, *again,
               refuse(mapping, 0, times, 1, _TOO_LONG, _NOT_MAPPABLE, _ACCESS, _NO_OBJECT),
               needs=(f"{mapping:04X}h:{times:02X}",), why="06040042")
    boots = NodeStep((f"000#82{subject.node:02X}",), (SILENCE,), wait=BOOT / 3, full_wait=True)
    back = s.read(mapping, 0, bytes([count]))
    yield case(19, "a reset of the communication restores the mapping", off, empty, boots, back,
               s.read(record, 1, _four(word)), effect="commands")


def _four(word: int) -> bytes:
    return word.to_bytes(4, "little")


class _ProcessData:
    """Steps that the cases of process data share."""

    def __init__(self, subject: Subject, pdo: SubjectPdo) -> None:
        self.s = Sdo(subject.node)
        self.name = f"{pdo.cob.identifier:03X}#"
        self.start = NodeStep(
            (f"000#01{subject.node:02X}",), (SILENCE, f"{self.name}{'.' * 2 * pdo.size}"), wait=0.05, full_wait=True
        )
        self.stop = silence(f"000#02{subject.node:02X}", wait=0.02)
        self.works = self.s.works


def _received(subject: Subject, pdo: SubjectPdo) -> Iterator[NodeCase]:
    process = _ProcessData(subject, pdo)
    s, name = process.s, process.name
    alarm = f"{0x80 + subject.node:03X}#"
    whole, short = "00" * pdo.size, "00" * (pdo.size - 1)

    def case(
        number: int, title: str, *steps: NodeStep, needs: tuple[str, ...] = ("RPDO", "1014h"), why: str = ""
    ) -> NodeCase:
        listens = (alarm, s.responses)
        return make_case(
            subject,
            _CLAUSE,
            listens,
            f"RPD-{number}",
            f"RPDO: {title}",
            *steps,
            effect="commands",
            needs=needs,
            why=why,
        )

    quiet = (SILENCE,)
    good = NodeStep((f"{name}{whole}",), quiet, wait=0.1)
    yield case(30, "of the mapped length", process.start, good, process.works)
    yield case(31, "too short: emergency 8210h", process.start,
               NodeStep((f"{name}{short}",), (f"{alarm}1082............",)))
    twice = NodeStep((f"{name}{short}",), quiet, wait=0.2)
    yield case(32, "too short twice: one emergency", process.start,
               NodeStep((f"{name}{short}",), (f"{alarm}1082............",)), twice)
    if pdo.size < 8:
        yield case(33, "too long: emergency 8220h, or the first bytes are used", process.start,
                   NodeStep((f"{name}{whole}00",), (f"{alarm}2082............", SILENCE), wait=0.2))
    yield case(34, "ignored in PRE-OPERATIONAL", NodeStep((f"{name}{short}",), quiet, wait=0.2), process.works)
    stopped = NodeStep((f"{name}{short}",), quiet, wait=0.2)
    yield case(35, "ignored in STOPPED", process.start, process.stop, stopped)
    yield case(36, "a remote frame is ignored", process.start, NodeStep((f"{name}R{pdo.size}",), quiet, wait=0.2))
    extended = NodeStep((f"{pdo.cob.identifier:08X}#{short}",), quiet, wait=0.2)
    yield case(37, "a frame of the same number with 29 bits is ignored", process.start, extended)
    word = pdo.cob.pack()
    off = s.write(pdo.communication, 1, word | _OFF, 4)
    yield case(38, "switched off it is ignored", off, process.start, NodeStep((f"{name}{short}",), quiet, wait=0.2))
    moved = s.write(pdo.communication, 1, 0x27E, 4)
    alarmed = NodeStep((f"27E#{short}",), (f"{alarm}1082............",))
    yield case(39, "with another COB-ID it is received there, and only there", off, moved, process.start,
               NodeStep((f"{name}{short}",), quiet, wait=0.2), alarmed)
    # The device monitors the RPDO from the first one on.
    timer = s.write(pdo.communication, 5, 300, 2)
    at_once = s.write(pdo.communication, 2, 255, 1)
    missed = NodeStep((), (f"{alarm}5082............", SILENCE), wait=0.7)
    needs = ("RPDO", "1014h", f"{pdo.communication:04X}h:05")
    yield case(40, "event timer: emergency 8250h when the RPDO stops", at_once, timer, process.start, good, missed,
               needs=needs, why="or the device does not monitor RPDOs")


def _sent(subject: Subject, pdo: SubjectPdo) -> Iterator[NodeCase]:
    process = _ProcessData(subject, pdo)
    s, name, record = process.s, process.name, pdo.communication
    data = f"{name}{'.' * 2 * pdo.size}"
    word = pdo.cob.pack()
    refused = s.refused(record, 2, _VALUE, _HIGH)

    def case(number: int, title: str, *steps: NodeStep, needs: tuple[str, ...] = ("TPDO",), why: str = "") -> NodeCase:
        listens = (name, s.responses, "1FE#")
        return make_case(
            subject,
            _CLAUSE,
            listens,
            f"TPD-{number}",
            f"TPDO: {title}",
            *steps,
            effect="commands",
            needs=needs,
            why=why,
        )

    def transmission(number: int) -> NodeStep:
        return s.write(record, 2, number, 1)._replace(ends=(refused,))

    sync = NodeStep(("080#",), (data,))
    no = silence("080#", wait=0.1)
    start = process.start
    yield case(30, "type 1: one with every SYNC, of the mapped length", transmission(1), start, sync, sync, sync)
    yield case(31, "type 2: one with every second SYNC", transmission(2), start, no, sync, no, sync)
    yield case(32, "type 240: none with the first SYNC", transmission(240), start, no)
    yield case(33, "none in PRE-OPERATIONAL", transmission(1), no, no)
    yield case(34, "none in STOPPED", transmission(1), start, sync, process.stop, no)
    back = silence(f"000#80{subject.node:02X}", wait=0.02)
    yield case(35, "none in PRE-OPERATIONAL again", transmission(1), start, sync, back, no)
    off = s.write(record, 1, word | _OFF, 4)
    yield case(36, "switched off: none", transmission(1), off, start._replace(accepts=(SILENCE,)), no)
    elsewhere = s.write(record, 1, 0x1FE | word & 0x4000_0000, 4)
    moved = NodeStep(("080#",), (f"1FE#{'.' * 2 * pdo.size}",))
    yield case(37, "on another COB-ID", transmission(1), off, elsewhere, start._replace(accepts=(SILENCE,)), moved)
    timer = s.write(record, 5, 100, 2)
    running = NodeStep((), (f"{data}{{3,7}}",), wait=0.5, full_wait=True)
    yield case(38, "type 255 and an event timer of 100 ms", transmission(255), timer, start, running,
               needs=("TPDO", f"{record:04X}h:05"), why="3 to 7 in 500 ms; more where values change")
    yield case(50, "type 254 and an event timer of 100 ms", transmission(254), timer, start, running,
               needs=("TPDO", f"{record:04X}h:05"), why="as TPD-38; or the type is refused: 06090030")
    none = s.write(record, 5, 0, 2)
    still = NodeStep((), (SILENCE, f"{data}{{1,30}}"), wait=0.3, full_wait=True)
    yield case(39, "the event timer off again, while it runs", transmission(255), timer, start, running,
               none._replace(accepts=(*none.accepts, f"{data}, {none.accepts[0]}")), still,
               needs=("TPDO", f"{record:04X}h:05"))
    ask = NodeStep((f"{name}R{pdo.size}",), (data,))
    if pdo.cob.bit30:
        yield case(40, "bit 30 set: a remote frame is not answered", transmission(1), start,
                   silence(f"{name}R{pdo.size}", wait=0.1))
    else:
        yield case(40, "type 253: a remote frame is answered, SYNC is not", transmission(253), start, no, ask,
                   why="or the type is refused: 06090030")
    yield case(41, "SYNC with 29 bits is ignored", transmission(1), start, silence("00000080#", wait=0.1), sync)
    yield case(42, "start twice: still one with every SYNC", transmission(1), start, start, sync, sync)
    yield from _in_other_states(case, process, pdo, transmission)
    may = NodeStep(("080#",), (SILENCE, data), wait=0.1)
    yield case(47, "type 0: none without SYNC", transmission(0), start._replace(accepts=(SILENCE,), wait=0.3), may,
               why="at a SYNC after an event")
    if not pdo.cob.bit30:
        sampled = NodeStep((f"{name}R{pdo.size}",), (data, SILENCE), wait=0.1)
        yield case(48, "type 252: a remote frame is answered, SYNC is not", transmission(252), start, sampled, no, ask,
                   why="the values are those of the last SYNC; or the type is refused: 06090030")
    on = s.write(record, 1, word, 4)
    counted = s.write(0x1019, 0, 10, 1)
    first = s.write(record, 6, 3, 1)
    steps = [silence(f"080#{number:02X}", wait=0.1) for number in (1, 2)]
    numbered = [NodeStep((f"080#{number:02X}",), (data,)) for number in (3, 4)]
    yield case(49, "SYNC start value 3: the first with the SYNC of counter 3", counted, off, transmission(1), first, on,
               start._replace(accepts=(SILENCE,)), *steps, *numbered, needs=("TPDO", "1019h", f"{record:04X}h:06"))


def _in_other_states(
    case: Callable[..., NodeCase], process: _ProcessData, pdo: SubjectPdo, transmission: Callable[[int], NodeStep]
) -> Iterator[NodeCase]:
    """Yield the cases of remote frames and event timers in PRE-OPERATIONAL and STOPPED."""
    s, name = process.s, process.name
    unanswered = silence(f"{name}R{pdo.size}", wait=0.1)
    yield case(43, "a remote frame in PRE-OPERATIONAL is not answered", unanswered, process.works)
    yield case(44, "a remote frame in STOPPED is not answered", process.start, process.stop, unanswered)
    timer = s.write(pdo.communication, 5, 100, 2)
    needs = ("TPDO", f"{pdo.communication:04X}h:05")
    yield case(45, "the event timer does not run in PRE-OPERATIONAL", transmission(255), timer, silence(wait=0.3),
               needs=needs)
    stop = process.stop._replace(accepts=(SILENCE, f"{name}{'.' * 2 * pdo.size}"))
    yield case(46, "the event timer does not run in STOPPED", transmission(255), timer, process.start, stop,
               silence(wait=0.3), needs=needs)
