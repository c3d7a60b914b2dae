"""Fastscan: find a device that has no node-ID and that nobody has heard of, bit by bit.   [CiA 305]

        51 | number | bit | sub | next       "is your part `sub` equal to `number`, from bit `bit` upwards?"

        begin            anybody there? -> yes                          how long they need to answer is measured here
        part 0, bit 31   "is it 0?"  -> yes: the bit is 0               silence: the bit is 1
        ...              32 questions for a part, 128 for an address
        part 0 whole     must be confirmed -> yes: on to part 1

A 1 costs a whole time-out, so how long that is decides how long a scan takes: not a fixed half second, but three
times the longest answer so far, and never less than `floor`. Devices that answer one after the other (each with its
own delay) would have the later answer taken for that to the next question; so if the beginning brought several
answers, every answer is waited out for as long as they lay apart.

A lost frame looks like silence and makes a wrong bit. The confirmation of the part finds it: then the wait is doubled,
from now on silence is believed the second time only, and the scan begins again; what was confirmed before is not asked
bit by bit once more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.master import (
    LSS_TIMEOUT,
    configure_node,
    read_answer,
    send_lss,
    store_configuration,
    switch_global,
)
from barewire.canopen.lss.messages import BEGIN, Fastscan, LssAddress, LssMessage, LssService, LssState
from barewire.canopen.nmt.heartbeat import NodeState
from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import DecodeError, EncodeError, NoAnswer

_FLOOR = 0.010
"""The shortest wait for a "no". A device answers within a millisecond or two; the rest is for the adapter."""

KnownAddress = Sequence[int | None]
"""What is known beforehand of vendor-ID, product code, revision, serial number."""

_NOTHING_KNOWN: KnownAddress = (None, None, None, None)


class FastscanProgress(NamedTuple):
    """Where a scan stands: bit `bit` of part `part`, `number` so far; `wait` is what a "no" costs, in seconds."""

    part: int
    bit: int
    number: int
    wait: float
    restarts: int


@dataclass(slots=True)
class _Pace:
    """How long to wait, learnt from the answers, and from what went wrong."""

    floor: float
    longest: float
    wait: float
    linger: float = 0.0  # after an answer, for those of slower devices
    restarts: int = 0

    def learn(self, took: float) -> None:
        self.wait = min(max(self.wait, 3 * took), self.longest)

    def distrust(self) -> None:
        """Something went wrong: a frame was lost, or an answer came after we had given up."""
        self.restarts += 1
        self.wait = min(2 * self.wait, self.longest)
        if self.linger:
            self.linger = min(2 * self.linger, self.longest)

    @property
    def times(self) -> int:
        """How often a question is asked before silence is believed: once, until something went wrong."""
        return 1 if not self.restarts else 2 if self.restarts < 4 else 3


def fastscan(
    known: KnownAddress = _NOTHING_KNOWN,
    *,
    timeout: float = LSS_TIMEOUT,
    floor: float = _FLOOR,
    attempts: int = 10,
    progress: Callable[[FastscanProgress], None] | None = None,
) -> Conversation[CanFrame, LssAddress | None]:
    """The address of one device without a node-ID, which is in configuration afterwards. None: there is none.

    `known` parts are not scanned but confirmed with one question each; then None means that nobody is like that.
    `timeout` is the wait at the beginning, before anything is measured. Raises NoAnswer when `attempts` scans did not
    lead to an address that a device confirmed: a bus that loses too much.
    """
    if len(known) != 4:
        raise EncodeError(f"{len(known)} known parts: an LSS address has 4")
    pace = _Pace(floor, timeout, floor)
    found: list[int | None] = [None, None, None, None]
    denied = 0
    while pace.restarts < attempts:
        if (yield from _begin(pace, timeout)):
            failed = yield from _scan(known, found, pace, progress)
            if failed is None:
                return LssAddress(*(part or 0 for part in found))
            denied += known[failed] is not None
            if denied == 3:
                return None
        elif not pace.restarts:
            return None
        pace.distrust()
        # A device that heard the last question, whose yes we did not hear, has left the scan: call it back.
        yield from switch_global(LssState.WAITING)
    raise NoAnswer(f"fastscan began {attempts} times and never came to an address that a device confirmed")


def _begin(pace: _Pace, timeout: float) -> Conversation[CanFrame, bool]:
    """Is anybody there, how long do they need, and how far apart do they answer? A lost question is asked again."""
    for _ in range(2):
        times = yield from _question(Fastscan(0, BEGIN, 0, 0), timeout, None)
        if times:
            pace.learn(times[-1])
            if len(times) > 1:
                pace.linger = max(pace.linger, pace.floor, 1.5 * (times[-1] - times[0]))
            return True
    return False


def _scan(
    known: KnownAddress, found: list[int | None], pace: _Pace, progress: Callable[[FastscanProgress], None] | None
) -> Conversation[CanFrame, int | None]:
    """One pass over the four parts. The part that nobody confirmed, None if all were; those are left in `found`."""
    for part in range(4):
        number = known[part] if known[part] is not None else found[part]
        if number is None:
            number = yield from _scan_part(part, pace, progress)
        if not (yield from _is_so(Fastscan(number, 0, part, (part + 1) % 4), pace)):
            found[part] = None
            return part
        found[part] = number
    return None


def _scan_part(
    part: int, pace: _Pace, progress: Callable[[FastscanProgress], None] | None
) -> Conversation[CanFrame, int]:
    number = 0
    for bit in range(31, -1, -1):
        if progress is not None:
            progress(FastscanProgress(part, bit, number, pace.wait, pace.restarts))
        if not (yield from _is_so(Fastscan(number, bit, part, part), pace)):
            number |= 1 << bit
    return number


def _is_so(question: Fastscan, pace: _Pace) -> Conversation[CanFrame, bool]:
    """Whether any device says yes."""
    for _ in range(pace.times):
        times = yield from _question(question, pace.wait, pace.linger)
        if times:
            pace.learn(times[0])
            return True
    return False


def _question(question: Fastscan, wait: float, linger: float | None) -> Conversation[CanFrame, list[float]]:
    """Ask, and wait for a first answer, then `linger` for others; None: the whole `wait`. How long each took."""
    sent: Heard[CanFrame] = yield Send(question.encode())
    until = sent.now + wait
    times: list[float] = []
    while True:
        heard: Heard[CanFrame] = yield Listen(until)
        if heard.item is not None and read_answer(heard.item, LssService.IDENTIFIED) is not None:
            times.append(heard.now - sent.now)
            if linger is not None and len(times) == 1:
                until = heard.now + linger
        if heard.now >= until or (times and linger == 0):
            return times


class AssignedNode(NamedTuple):
    """A device that was found and given a node-ID. `booted`: its boot-up message was heard."""

    address: LssAddress
    node: int
    booted: bool


def assign_node_ids(
    nodes: Iterable[int],
    known: KnownAddress = _NOTHING_KNOWN,
    *,
    store: bool = True,
    timeout: float = LSS_TIMEOUT,
    floor: float = _FLOOR,
    progress: Callable[[FastscanProgress], None] | None = None,
    found: Callable[[AssignedNode], None] | None = None,
) -> Conversation[CanFrame, list[AssignedNode]]:
    """Find every device without a node-ID and give it the next of `nodes`, until there is silence or no node-ID left.

    Raises LssRefused if a device does not take its node-ID or, with `store`, cannot keep it.
    """
    every: list[AssignedNode] = []
    yield from switch_global(LssState.WAITING)
    for node in nodes:
        address = yield from fastscan(known, timeout=timeout, floor=floor, progress=progress)
        if address is None:
            break
        yield from configure_node(node, timeout=timeout)
        if store:
            yield from store_configuration(timeout=timeout)
        now = yield from send_lss(LssMessage(LssService.SWITCH_GLOBAL, bytes([LssState.WAITING])))
        every.append(AssignedNode(address, node, (yield from _boots(node, now + timeout))))
        if found is not None:
            found(every[-1])
    return every


def _boots(node: int, until: float) -> Conversation[CanFrame, bool]:
    """Wait for the boot-up message of the node."""
    while True:
        heard: Heard[CanFrame] = yield Listen(until)
        if heard.item is not None:
            with suppress(DecodeError):
                if NodeState.decode(heard.item).node == node:
                    return True
        if heard.now >= until:
            return False
