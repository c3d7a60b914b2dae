"""Conformance cases of heartbeat consumers, emergencies, SYNC and TIME.   [CiA 301 7.2.5 to 7.2.8]"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from barewire.canopen.conformance.frames import (
    RESET_COMMUNICATION,
    START,
    STOP,
    Sdo,
    little,
    make_case,
    nmt_command,
    silence,
)
from barewire.canopen.conformance.model import BOOT, SILENCE, NodeCase, NodeStep, Subject

# Each case is a row: name, title, steps, needs, reason.
# fmt: off

CONSUMER = "CiA 301 7.2.8 heartbeat consumer"
EMCY, SYNC, TIME = "CiA 301 7.2.7 EMCY", "CiA 301 7.2.5 SYNC", "CiA 301 7.2.6 TIME"
_VALUE, _STATE = 0x0609_0030, 0x0800_0022
_WATCH = ("1016h:01",)


def emcy_sync_time_cases(subject: Subject) -> Iterator[NodeCase]:
    """Yield the cases of this service for one device."""
    yield from _consumer(subject)
    yield from _emcy(subject)
    yield from _sync(subject)
    yield from _time(subject)


def _consumer(subject: Subject) -> Iterator[NodeCase]:
    node, other = subject.node, subject.other_node
    s = Sdo(node)
    alarm = f"{0x80 + node:03X}#"
    beat = f"{0x700 + other:03X}#05"
    entry = other << 16 | 100
    watch = s.write(0x1016, 1, entry, 4)
    beats_once = silence(beat, wait=0.05)
    lost = NodeStep((), (f"{alarm}3081............",), wait=0.5)
    quiet = silence(wait=0.3)

    case = partial(make_case, subject, CONSUMER, (alarm, s.responses), effect="commands", needs=(*_WATCH, "1014h"))
    yield case("HBC-01", "a monitored node stops: one emergency 8130h", watch, beats_once, lost, quiet)
    again = NodeStep((beat,), (f"{alarm}0000............", SILENCE), wait=0.1)
    yield case("HBC-02", "the monitored node returns", watch, beats_once, lost, again, why="emergency 0000h, or none")
    yield case("HBC-03", "no error for a node that has sent no heartbeat yet", watch, quiet)
    boot_up = silence(f"{0x700 + other:03X}#00", wait=0.3)
    yield case("HBC-04", "a boot-up message does not start the monitoring", watch, boot_up,
               why="the first heartbeat does")
    steady = [silence(beat, wait=0.04)] * 6
    yield case("HBC-05", "no error for a node that keeps sending", watch, *steady)
    off = s.write(0x1016, 1, 0, 4)
    yield case("HBC-06", "an entry of 0 monitors no node", watch, beats_once, off, quiet)
    yield case("HBC-07", "the same node in two entries", watch, s.refuse(0x1016, 2, entry, 4, 0x0604_0043, _VALUE),
               needs=("1016h:02",), why="06040043")
    yield case("HBC-08", "two entries of 0 are accepted", off, s.write(0x1016, 2, 0, 4), needs=("1016h:02",))
    start = silence(nmt_command(START, node), wait=0.02)
    works = s.works
    stopped = silence(s.upload(0x1000), wait=0.1)
    for name, behavior, effect, after in (
        ("HBC-09", 1, "no change of state", works),
        ("HBC-10", 2, "STOPPED", stopped),
    ):
        behave = s.write(0x1029, 1, behavior, 1)
        yield case(name, f"1029h:01 is {behavior}: {effect} when a node is lost in OPERATIONAL", behave, watch, start,
                   beats_once, lost, after, needs=(*_WATCH, "1014h", "1029h:01"))


def _emcy(subject: Subject) -> Iterator[NodeCase]:
    node = subject.node
    s = Sdo(node)
    alarm = f"{0x80 + node:03X}#"
    rpdo = subject.pdo(0x1400, 0x1600)
    identifier, size = (rpdo.cob.identifier, rpdo.size) if rpdo else (0x200 + node, 2)
    start = silence(nmt_command(START, node), wait=0.02)
    short = NodeStep((f"{identifier:03X}#{'00' * (size - 1)}",), (f"{alarm}1082............",))
    right = NodeStep((f"{identifier:03X}#{'00' * size}",), (f"{alarm}0000............", SILENCE), wait=0.1)
    both = ("RPDO", "1014h")

    case = partial(make_case, subject, EMCY, (alarm, s.responses), effect="commands")
    expected = s.value(0x1014, 0, (0x80 + node).to_bytes(4, "little"))
    yield case("EMC-01", "1014h is 80h plus the node-ID", NodeStep((s.upload(0x1014),), (expected,)), needs=("1014h",),
               effect="reads")
    yield case("EMC-02", "an RPDO that is too short: emergency 8210h", start, short, needs=both)
    register = NodeStep((s.upload(0x1001),), (s.response("4F011000[13579BDF][13579BDF]"),))
    yield case("EMC-03", "afterwards 1001h shows a communication error", start, short, register, needs=both,
               why="bit 4, and bit 0 with every error")
    yield case("EMC-04", "a correct RPDO ends the error", start, short, right, needs=both,
               why="emergency 0000h, or none")
    clear = s.write(0x1003, 0, 0, 1)
    one_entry = s.read(0x1003, 0, b"\1")
    newest = NodeStep((s.upload(0x1003, 1),), (s.response("430310011082"),))
    history = (*both, "1003h")
    yield case("EMC-05", "1003h holds the error, and its number", clear, start, short, one_entry, newest, needs=history)
    no_entry = s.read(0x1003, 0, b"\0")
    yield case("EMC-06", "0 written to 1003h:00 clears the history", start, short, clear, no_entry, needs=history)
    yield case("EMC-07", "1003h:00 accepts only 0", s.refuse(0x1003, 0, 1, 1, _VALUE, 0x0609_0031), needs=("1003h",),
               effect="writes", why="06090030")
    empty = NodeStep(
        (s.upload(0x1003, 1),), (s.refused(0x1003, 1, 0x0800_0024, 0x0609_0011), s.value(0x1003, 1, bytes(4)))
    )
    yield case("EMC-08", "an entry of an empty history", clear, empty, needs=("1003h",), effect="writes",
               why="08000024 or 06090011; some devices return 0")
    moved = s.refuse(0x1014, 0, 0x80 + subject.other_node, 4, _VALUE)
    yield case("EMC-09", "1014h keeps its identifier while it is valid", moved, needs=("1014h",), effect="writes",
               why="06090030")
    off = s.write(0x1014, 0, 0x8000_0080 + node, 4)
    no_emergency = short._replace(accepts=(SILENCE,), wait=0.2)
    yield case("EMC-10", "1014h not valid: no emergency", off, start, no_emergency, needs=both, why="bit 31")
    stop = silence(nmt_command(STOP, node), wait=0.02)
    yield case("EMC-11", "no emergency in STOPPED", stop, no_emergency, needs=both)


def _sync(subject: Subject) -> Iterator[NodeCase]:
    node = subject.node
    s = Sdo(node)
    makes = ("1005h", "1006h")

    listens = ("080#", s.responses, f"{0x80 + node:03X}#", f"{0x700 + node:03X}#00")
    case = partial(make_case, subject, SYNC, listens, effect="commands")
    on = s.write(0x1005, 0, 0x4000_0080, 4)
    period = s.write(0x1006, 0, 100_000, 4)
    beats = NodeStep((), ("080#{2,5}",), wait=0.35, full_wait=True)
    # A device that only consumes SYNC refuses to produce it, and passes.
    may = on._replace(ends=(s.refused(0x1005, 0, _VALUE, 0x0609_0031),))
    yield case("SYN-01", "1005h bit 30: SYNC every 100 ms", period, may, beats, needs=makes)
    # A device that misses SYNC may say so in an emergency.
    quiet = NodeStep((), (SILENCE, f"{0x80 + node:03X}#{'.' * 16}{{1,3}}"), wait=0.3, full_wait=True)
    yield case("SYN-02", "1005h bit 30 cleared: no SYNC", period, may, beats,
               NodeStep((s.download(0x1005, 0, 0x80, 4),), (s.accepted(0x1005), f"080#, {s.accepted(0x1005)}")), quiet,
               needs=makes)
    yield case("SYN-03", "no period: no SYNC", may, quiet, needs=makes, why="1006h is 0")
    counted = NodeStep((), ("080#01, 080#02, 080#03, 080#01",), wait=1.0)
    overflow = s.write(0x1019, 0, 3, 1)
    yield case("SYN-04", "1019h is 3: the counter goes 1, 2, 3, 1", overflow, period, may, counted,
               needs=(*makes, "1019h"))
    boots = NodeStep(
        (nmt_command(RESET_COMMUNICATION, node),), (f"{0x700 + node:03X}#00", f"080#, {0x700 + node:03X}#00"), wait=BOOT
    )
    yield case("SYN-05", "a reset stops SYNC", period, may, beats, boots, quiet, needs=makes)
    stop = NodeStep((nmt_command(STOP, node),), (SILENCE, "080#"), wait=0.02)
    yield case("SYN-06", "no SYNC in STOPPED", period, may, beats, stop, quiet, needs=makes)
    yield case("SYN-07", "1019h may not be 241", s.refuse(0x1019, 0, 241, 1, _VALUE, 0x0609_0031), needs=("1019h",),
               why="06090030 or 06090031")
    yield case("SYN-08", "1019h is refused while 1006h is not 0", period,
               s.refuse(0x1019, 0, 10, 1, _STATE, 0x0800_0000), needs=("1006h", "1019h"), why="08000022")
    yield case("SYN-09", "1005h keeps its identifier while the device produces SYNC", period, may,
               s.refuse(0x1005, 0, 0x4000_0081, 4, _VALUE), needs=makes, why="06090030")
    yield case("SYN-10", "1005h accepts no reserved identifier", s.refuse(0x1005, 0, 0x601, 4, _VALUE, 0x0609_0031),
               needs=("1005h",), why="06090030")
    start = silence(nmt_command(START, node), wait=0.02)
    wrong = NodeStep(("080#01",), (f"{0x80 + node:03X}#4082............",))
    yield case("SYN-11", "an unexpected counter: emergency 8240h", start, wrong, needs=("1005h", "1019h", "1014h"))
    window = s.write(0x1007, 0, 20_000, 4)
    read_back = s.read(0x1007, 0, (20_000).to_bytes(4, "little"))
    yield case("SYN-12", "1007h, the window, keeps its value", window, read_back, needs=("1007h",))


def _time(subject: Subject) -> Iterator[NodeCase]:
    s = Sdo(subject.node)
    listens = (s.responses, f"{0x80 + subject.node:03X}#")
    works = s.works

    case = partial(make_case, subject, TIME, listens, needs=("1012h",))
    yield case("TIM-01", "1012h is 100h with its flags", NodeStep((s.upload(0x1012),), (s.response("43121000000100"),)),
               effect="reads")
    yield case("TIM-02", "TIME of six bytes has no lasting effect", silence("100#FF5B26059F3C", wait=0.05), works,
               effect="commands")
    yield case("TIM-03", "TIME of two bytes has no lasting effect", silence("100#FF5B", wait=0.05), works,
               effect="commands")
    consumes = s.write(0x1012, 0, 0x8000_0100, 4)
    read_back = NodeStep((s.upload(0x1012),), (s.response(f"43121000{little(0x8000_0100, 4)}"),))
    yield case("TIM-04", "1012h bit 31: the device consumes TIME", consumes, read_back, effect="writes")
