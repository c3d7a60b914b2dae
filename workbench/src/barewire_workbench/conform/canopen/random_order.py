"""Conformance cases that read and write objects in random order; the order is the same in each run.   [CiA 301 7.2.4]

        RND-01     50 reads of 1000h to 1FFFh
        RND-02     10 writes in PRE-OPERATIONAL, each read back; RND-03 in OPERATIONAL
        RND-04     10 reads and writes in STOPPED, which has no SDO

They are made here, and not in the vectors, because each step follows from the order and from what the device has.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from barewire.canopen.object_dictionary import ObjectAddress
from barewire_workbench.conform.canopen.frames import (
    HEARTBEAT,
    PRE,
    START,
    STOP,
    Sdo,
    little,
    make_case,
    nmt_command,
    silence,
)
from barewire_workbench.conform.canopen.model import NodeCase, NodeStep, Subject

_RANDOM = "CiA 301 7.2.4 SDO in each state"


def random_cases(subject: Subject) -> Iterator[NodeCase]:
    """Yield reads and writes whose order and values only depend on the node-ID."""
    node, order = subject.node, irregular(subject.node)
    s = Sdo(node)
    short = sorted(place for place, data in subject.values.items() if 1 <= len(data) <= 4 and place[0] < 0x2000)
    reads = [
        NodeStep((s.upload(*place),), (s.sized(*place, len(subject.values[place])),))
        for place in (_choice(order, short) for _ in range(50 if short else 0))
    ]
    case = partial(make_case, subject, _RANDOM, (s.responses,))
    yield case("RND-01", "50 reads of 1000h to 1FFFh in random order", *(reads or [s.works]), effect="reads")

    def writes(count: int) -> list[NodeStep]:
        steps: list[NodeStep] = []
        for _ in range(count):
            period, watch = 20_000 + next(order) % 40_000, subject.other_node << 16 | 1 + next(order) % 0xFFFF
            steps += [s.write(0x1017, 0, period, 2), s.read(0x1017, 0, period.to_bytes(2, "little"))]
            if subject.has(0x1016, 1):
                steps += [s.write(0x1016, 1, watch, 4), s.read(0x1016, 1, watch.to_bytes(4, "little"))]
        return steps

    for name, state, enter in (("RND-02", "PRE-OPERATIONAL", ()), ("RND-03", "OPERATIONAL", (START,))):
        entered = [silence(nmt_command(command, node), wait=0.02) for command in enter]
        yield case(
            name,
            f"10 random writes in {state}, each read back",
            *entered,
            *writes(10),
            effect="commands",
            needs=HEARTBEAT,
        )
    before = s.write(0x1017, 0, 30_000, 2)
    unheard = [silence(s.download(0x1017, 0, 20_000 + next(order) % 10_000, 2), wait=0.05) for _ in range(5)]
    unread = [silence(s.upload(*_choice(order, short or [(0x1000, 0)])), wait=0.05) for _ in range(5)]
    stop, back = (silence(nmt_command(command, node), wait=0.02) for command in (STOP, PRE))
    after = NodeStep((s.upload(0x1017),), (s.response(f"4B171000{little(30_000, 2)}"),))
    yield case(
        "RND-04",
        "10 random reads and writes in STOPPED: no answer, nothing is written",
        before,
        stop,
        *(step for pair in zip(unheard, unread) for step in pair),
        back,
        after,
        effect="commands",
        needs=HEARTBEAT,
    )


def irregular(start: int) -> Iterator[int]:
    """Yield numbers of 31 bits in an irregular order, the same for each start (Park and Miller's generator)."""
    number = start
    while True:
        number = number * 48_271 % 0x7FFF_FFFF
        yield number


def _choice(order: Iterator[int], places: list[ObjectAddress]) -> ObjectAddress:
    return places[next(order) % len(places)]
