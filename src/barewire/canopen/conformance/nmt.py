"""Conformance cases of NMT and error control: the states, the services in each state, heartbeat and node guarding.

[CiA 301 7.2.8]
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from barewire.canopen.conformance.frames import (
    HEARTBEAT,
    PRE,
    RESET,
    RESET_COMMUNICATION,
    START,
    STOP,
    Sdo,
    make_case,
    nmt_command,
    silence,
)
from barewire.canopen.conformance.model import BOOT, SILENCE, NodeCase, NodeStep, Subject

# Each case is a row: name, title, steps, needs, reason.
# fmt: off

NMT, CONTROL = "CiA 301 7.2.8 NMT", "CiA 301 7.2.8 error control"
_GUARD = ("100Ch", "100Dh")
_NOT_ITSELF = 4
"""Bit 2 of 1F80h, NMT startup: the device does not start itself.   [CiA 302-2]"""


def nmt_cases(subject: Subject) -> Iterator[NodeCase]:
    """Yield the cases of this service for one device."""
    yield from _nmt(subject)
    yield from _heartbeat(subject)
    yield from _guarding(subject)


def _nmt(subject: Subject) -> Iterator[NodeCase]:
    node = subject.node
    s = Sdo(node)
    boot = f"{0x700 + node:03X}#00"
    works = s.works
    silent = silence(s.upload(0x1000), wait=0.1)
    boots = NodeStep((nmt_command(RESET, node),), (boot,), wait=BOOT)
    boots_communication = NodeStep((nmt_command(RESET_COMMUNICATION, node),), (boot,), wait=BOOT)

    def do(command: str, to: int | None = None) -> NodeStep:
        return silence(nmt_command(command, node if to is None else to), wait=0.02)

    case = partial(make_case, subject, NMT, (s.responses, boot), effect="commands")
    yield case("NMT-01", "start: SDO works", do(START), works)
    yield case("NMT-02", "stop: SDO is silent", do(STOP), silent, why="no SDO in STOPPED")
    yield case("NMT-03", "stop, then pre-operational: SDO works", do(STOP), silent, do(PRE), works)
    yield case("NMT-04", "stop, then start: SDO works", do(STOP), silent, do(START), works)
    yield case("NMT-05", "start, then pre-operational: SDO works", do(START), do(PRE), works)
    yield case("NMT-06", "stop, to all nodes", do(STOP, 0), silent, do(PRE, 0), works)
    yield case("NMT-07", "stop, to another node", do(STOP, subject.other_node), works)
    hasty = NodeStep(
        (nmt_command(START, node), nmt_command(STOP, node), nmt_command(START, node)), (SILENCE,), wait=0.02
    )
    yield case("NMT-08", "start, stop, start without a pause", hasty, works)
    once = silence(wait=0.2)
    yield case("NMT-10", "reset node: one boot-up message", boots, once, works)
    yield case("NMT-11", "reset communication: one boot-up message", boots_communication, once, works)
    yield case("NMT-12", "reset node from STOPPED", do(STOP), silent, boots, works)
    yield case("NMT-13", "reset communication from STOPPED", do(STOP), silent, boots_communication, works)
    yield case("NMT-14", "reset node from OPERATIONAL", do(START), boots, works)
    yield case("NMT-15", "reset communication from OPERATIONAL", do(START), boots_communication, works)
    elsewhere = silence(nmt_command(RESET_COMMUNICATION, subject.other_node), wait=0.3)
    yield case("NMT-16", "reset communication, to another node", elsewhere, works)
    write = s.write(0x1017, 0, 12_345, 2)
    default = s.read(0x1017, 0, subject.number(0x1017, 0, 2).to_bytes(2, "little"))
    yield case("NMT-17", "reset communication restores 1017h", write, boots_communication, default, needs=HEARTBEAT,
               why="1000h to 1FFFh have their power-on values")
    yield case("NMT-18", "reset node restores 1017h", write, boots, default, needs=HEARTBEAT)
    yield from _after_a_reset(subject)
    for name, text, frame in (
        ("NMT-20", f"000#03{node:02X}", "an undefined command"),
        ("NMT-21", "000#02", "a command of one byte"),
        ("NMT-22", f"000#02{node:02X}00", "a command of three bytes"),
        ("NMT-23", f"00000000#02{node:02X}", "a stop with 29 bits"),
        ("NMT-24", "000#R2", "a remote frame"),
    ):
        yield case(name, f"{frame} is ignored", silence(text, wait=0.02), works)


def _after_a_reset(subject: Subject) -> Iterator[NodeCase]:
    """Yield the case that tells a device that starts itself. 1F80h of CiA 302 with bit 2 cleared allows it."""
    node = subject.node
    s = Sdo(node)
    own = f"{0x700 + node:03X}#"
    state = "[07][5F]" if subject.has(0x1F80) and not subject.number(0x1F80) & _NOT_ITSELF else "7F"
    boots = NodeStep((nmt_command(RESET_COMMUNICATION, node),), (f"{own}00",), wait=BOOT)
    settled = NodeStep((), (f"{own}..{{0,9}}",), wait=0.1, full_wait=True)
    beats = NodeStep((s.download(0x1017, 0, 100, 2),), (f"{own}..{{0,3}}, {s.accepted(0x1017)}, {own}..{{0,1}}",))
    seen = NodeStep((), (f"{own}{state}{{1,4}}",), wait=0.25, full_wait=True)
    yield make_case(subject, NMT, (own, s.responses), "NMT-19", "a reset ends in PRE-OPERATIONAL", boots, settled,
                    beats, seen, effect="commands", needs=HEARTBEAT,
                    why="or in OPERATIONAL, if 1F80h says that the device starts itself")


def _heartbeat(subject: Subject) -> Iterator[NodeCase]:
    node = subject.node
    s = Sdo(node)
    own = f"{0x700 + node:03X}#"
    # A heartbeat of the previous period may still come first, and one of the new period at once.
    taken = f"{own}7F{{0,3}}, {s.accepted(0x1017)}, {own}7F{{0,1}}"
    set_100, off = (NodeStep((s.download(0x1017, 0, period, 2),), (taken,)) for period in (100, 0))

    case = partial(make_case, subject, CONTROL, (own, s.responses), effect="commands", needs=HEARTBEAT)

    def window(state: str, fewest: int, most: int, seconds: float) -> NodeStep:
        return NodeStep((), (f"{own}{state}{{{fewest},{most}}}",), wait=seconds, full_wait=True)

    def change(command: str, state: str, before: str = "7F") -> NodeStep:
        # A heartbeat may still have the previous state; some devices send the new one at once.
        accepted = (f"{own}{before}{{0,1}}, {own}{state}{{1,2}}",)
        return NodeStep((nmt_command(command, node),), accepted, wait=0.3)

    yield case("HB-01", "a period of 100 ms", set_100, window("7F", 4, 7, 0.55), why="4 to 7 in 550 ms")
    yield case("HB-02", "OPERATIONAL is 05", set_100, change(START, "05"), window("05", 1, 4, 0.25))
    yield case("HB-03", "STOPPED is 04, and the heartbeat goes on", set_100, change(STOP, "04"),
               window("04", 1, 4, 0.25))
    yield case("HB-04", "PRE-OPERATIONAL is 7F again", set_100, change(START, "05"), change(PRE, "7F", "05"),
               window("7F", 1, 4, 0.25))
    yield case("HB-05", "a period of 0: no heartbeat", set_100, window("7F", 1, 4, 0.25), off, silence(wait=0.3))
    faster = NodeStep((s.download(0x1017, 0, 50, 2),), (taken,))
    yield case("HB-06", "a new period applies at once", set_100, faster, window("7F", 6, 13, 0.5), why="50 ms")
    yield case("HB-07", "a 29-bit frame of the same number is not answered", off,
               silence(f"{0x700 + node:08X}#R1", wait=0.1))


def _guarding(subject: Subject) -> Iterator[NodeCase]:
    node = subject.node
    s = Sdo(node)
    own = f"{0x700 + node:03X}#"
    taken = f"{own}7F{{0,3}}, {s.accepted(0x1017)}"
    off = NodeStep((s.download(0x1017, 0, 0, 2),), (taken,))

    def ask(state: str, *more: str) -> NodeStep:
        return NodeStep((f"{0x700 + node:03X}#R1",), (f"{own}{state}" if state else SILENCE, *more), wait=0.2)

    first = (off,) if subject.has(0x1017) else ()

    def case(name: str, title: str, *steps: NodeStep, needs: tuple[str, ...] = _GUARD, why: str = "") -> NodeCase:
        listens = (own, s.responses)
        return make_case(
            subject, CONTROL, listens, name, title, *first, *steps, effect="commands", needs=needs, why=why
        )

    yield case("GRD-01", "the toggle bit: 0, 1, 0", ask("7F"), ask("FF"), ask("7F"))
    start, stop = (silence(nmt_command(name, node), wait=0.02) for name in (START, STOP))
    yield case("GRD-02", "in OPERATIONAL and STOPPED", start, ask("05"), stop, ask("84"), ask("04"))
    boots = NodeStep((nmt_command(RESET_COMMUNICATION, node),), (f"{own}00",), wait=BOOT)
    # A device may start itself, and has its own heartbeat after the reset.
    settled, back = (NodeStep(sends, (f"{own}..{{0,3}}",), wait=0.02, full_wait=True)
                     for sends in ((), (nmt_command(PRE, node),)))
    yield case("GRD-03", "the toggle bit is 0 again after a reset", ask("7F"), boots, settled, back, *first, ask("7F"),
               ask("FF"))
    slow = NodeStep((s.download(0x1017, 0, 30_000, 2),), (f"{taken}, {own}7F{{0,1}}",), wait=0.1, full_wait=True)
    yield case("GRD-04", "with a heartbeat, guarding requests are not answered", slow, ask(SILENCE),
               needs=(*_GUARD, "1017h"), why="only one of the two is active")
    yield case("GRD-05", "with a heartbeat of 0, guarding works again", slow, off, ask("7F"), needs=(*_GUARD, "1017h"))
    life = s.write(0x100C, 0, 50, 2), s.write(0x100D, 0, 2, 1)
    missed = f"{0x80 + node:03X}#3081"
    emergency = NodeStep((), (f"{missed}............",), wait=0.5)
    life_case = partial(
        make_case, subject, CONTROL, (own, s.responses, missed[:4]), effect="commands", needs=(*_GUARD, "1014h")
    )
    yield life_case("GRD-06", "life guarding: emergency when the master stops", *first, *life, ask("7F"), emergency,
                    why="emergency 8130h after 100Ch times 100Dh")
    yield life_case("GRD-07", "life guarding begins with the first request", *first, *life, silence(wait=0.3))
