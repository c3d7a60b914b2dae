"""The LSS master: each service is a conversation.   [CiA 305]

master                                   the devices
40 41 42 43 | address          ->
                               <-        44            the device with this address: True; no answer: False
11 | 05                        ->
                               <-        11 | 00       done, or LssRefused
17                             ->
                               <-        17 | 00       stored
04 | 00                        ->                      all back to waiting; a device with a new node-ID boots now

A bus has one LSS master, which sends one request at a time, so an answer belongs to the last request. Where no answer
means "no such device", the result is False, 0 or None. If a device in configuration does not answer, NoAnswer is
raised.

Fastscan finds devices that have no node-ID and whose LSS address is unknown, bit by bit:

        51 | number | bit | sub | next       devices answer if their part `sub` equals `number` from bit `bit` upwards

        begin            any device without a node-ID answers           its response time is measured
        part 0, bit 31   number 0  -> answer: the bit is 0              no answer: the bit is 1
        ...              32 requests for a part, 128 for an address
        part 0 whole     must be confirmed -> answer: go on to part 1

A bit that is 1 costs a whole time-out, so the time-out determines how long a scan takes. It is three times the longest
response time so far, and never less than `floor`. If devices answer with different delays, a late answer would be
mistaken for one to the next request. So if the begin request brought several answers, the scan waits after every answer
for as long as they were apart (`linger`).

A lost frame looks like "no answer" and makes a wrong bit, which the confirmation of the part detects. The time-out is
then doubled, each request without an answer is repeated from now on, and the scan starts again. Parts that were
confirmed before are not scanned again, but confirmed with one request.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from barewire.canopen.cob_ids import check_node, check_node_ids
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import (
    BEGIN,
    IDENTIFY_SERVICES,
    STORE_NOT_SUPPORTED,
    UNCONFIGURED,
    Fastscan,
    LssAddress,
    LssMessage,
    LssRefused,
    LssService,
    LssState,
    with_number,
)
from barewire.canopen.nmt.messages import reported_state
from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import DecodeError, EncodeError, NoAnswer

LSS_TIMEOUT = 0.5
"""Default time-out in seconds. Devices answer within about a millisecond; a USB adapter adds up to 20 ms."""


def send_lss(message: LssMessage) -> Conversation[CanFrame, float]:
    """Send a message without waiting for an answer. Return the time at which it was sent."""
    sent: Heard[CanFrame] = yield Send(message.encode())
    return sent.now


def request_lss(
    message: LssMessage, wanted: int, timeout: float = LSS_TIMEOUT
) -> Conversation[CanFrame, LssMessage | None]:
    """Send a message and return the first answer of the service `wanted`, None if none came in time."""
    now = yield from send_lss(message)
    until = now + timeout
    while True:
        heard: Heard[CanFrame] = yield Listen(until)
        if heard.item is not None:
            answer = read_answer(heard.item, wanted)
            if answer is not None:
                return answer
        if heard.now >= until:
            return None


def read_answer(frame: CanFrame, wanted: int) -> LssMessage | None:
    """Decode the frame as an answer of the service `wanted`. Return None for every other frame."""
    try:
        message = LssMessage.decode(frame)
    except DecodeError:
        return None
    return message if message.answer and message.service == wanted else None


def answer_times(
    request: CanFrame, wanted: int, timeout: float, linger: float | None = None
) -> Conversation[CanFrame, list[float]]:
    """Send a request and return the response times of its answers until the time-out; with `linger` those up to this
    many seconds after the first one. Simultaneous answers merge into one frame."""
    sent: Heard[CanFrame] = yield Send(request)
    until = sent.now + timeout
    times: list[float] = []
    while True:
        heard: Heard[CanFrame] = yield Listen(until)
        if heard.item is not None and read_answer(heard.item, wanted) is not None:
            times.append(heard.now - sent.now)
            if linger is not None and len(times) == 1:
                until = heard.now + linger
        # With 0 the first answer is the end, without one more look at the bus.
        if heard.now >= until or (times and linger == 0):
            return times


def switch_global(state: LssState) -> Conversation[CanFrame, None]:
    """Switch every device to waiting or configuration. Configuration is for a bus with one device only."""
    yield from send_lss(LssMessage(LssService.SWITCH_GLOBAL, bytes([state])))


def switch_selective(address: LssAddress, *, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, bool]:
    """Switch the device with this address to configuration. Return False if no device answered."""
    parts = (LssService.SELECT_VENDOR, LssService.SELECT_PRODUCT, LssService.SELECT_REVISION)
    for service, number in zip(parts, address):
        yield from send_lss(with_number(service, number))
    serial = with_number(LssService.SELECT_SERIAL, address.serial)
    return (yield from request_lss(serial, LssService.SELECTED, timeout)) is not None


def identify_slaves(
    vendor: int,
    product: int,
    revisions: tuple[int, int] = (0, 0xFFFF_FFFF),
    serials: tuple[int, int] = (0, 0xFFFF_FFFF),
    *,
    timeout: float = LSS_TIMEOUT,
) -> Conversation[CanFrame, int]:
    """Return the number of answers of devices within these limits, both ends included."""
    limits = (vendor, product, *revisions, *serials)
    requests = [with_number(service, number) for service, number in zip(IDENTIFY_SERVICES, limits)]
    for request in requests[:-1]:
        yield from send_lss(request)
    # Devices answer the last one of the six.
    return len((yield from answer_times(requests[-1].encode(), LssService.IDENTIFIED, timeout)))


def identify_unconfigured(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, int]:
    """Return the number of answers of devices without a node-ID."""
    request = LssMessage(LssService.IDENTIFY_UNCONFIGURED).encode()
    return len((yield from answer_times(request, LssService.UNCONFIGURED_IDENTIFIED, timeout)))


def inquire_address(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, LssAddress]:
    """Return the address of the device in configuration. Raise NoAnswer."""
    parts = []
    for step in range(4):
        answer = yield from _must_answer(LssMessage(LssService(LssService.INQUIRE_VENDOR + step)), timeout)
        parts.append(answer.number)
    return LssAddress(*parts)


def inquire_node(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, int | None]:
    """Return the node-ID of the device in configuration, None if it has none. Raise NoAnswer."""
    answer = yield from _must_answer(LssMessage(LssService.INQUIRE_NODE), timeout)
    return None if answer.body[0] == UNCONFIGURED else answer.body[0]


def configure_node(node: int | None, *, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, None]:
    """Set the pending node-ID of the device in configuration, or remove it. Raise LssRefused and NoAnswer."""
    number = UNCONFIGURED if node is None else check_node(node)
    yield from _must_accept(LssMessage(LssService.CONFIGURE_NODE, bytes([number])), timeout)


def configure_bit_timing(entry: int, table: int = 0, *, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, None]:
    """Set the bit rate of the device in configuration, an entry of `BIT_RATES`. Raise LssRefused and NoAnswer."""
    if not (0 <= entry <= 255 and 0 <= table <= 255):
        raise EncodeError(f"bit timing table {table}, entry {entry}: expected 0..255 for both")
    yield from _must_accept(LssMessage(LssService.CONFIGURE_BIT_TIMING, bytes([table, entry])), timeout)


def activate_bit_timing(delay: float) -> Conversation[CanFrame, float]:
    """Let all devices in configuration change their bit rate after `delay` seconds and stay silent for as long again.

    Return the time at which they send again; by then the caller must have changed the bit rate of its own port.
    Raise EncodeError for a delay outside 0..65.535 s.
    """
    if not 0 <= delay <= 65.535:
        raise EncodeError(f"switch delay {delay} s: expected 0..65.535")
    body = round(delay * 1000).to_bytes(2, "little")
    now = yield from send_lss(LssMessage(LssService.ACTIVATE_BIT_TIMING, body))
    return now + 2 * delay


def store_configuration(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, None]:
    """Let the device in configuration store node-ID and bit rate. Raise LssRefused and NoAnswer."""
    yield from _must_accept(LssMessage(LssService.STORE), timeout)


def _must_answer(message: LssMessage, timeout: float) -> Conversation[CanFrame, LssMessage]:
    answer = yield from request_lss(message, message.service, timeout)
    if answer is None:
        name = LssService(message.service).name.lower().replace("_", " ")
        raise NoAnswer(f"no device in the LSS state configuration answered {name} within {timeout:g} s")
    return answer


def _must_accept(message: LssMessage, timeout: float) -> Conversation[CanFrame, None]:
    answer = yield from _must_answer(message, timeout)
    if answer.body[0]:
        raise LssRefused(LssService(message.service), answer.body[0], answer.body[1])


_FLOOR = 0.010
"""The shortest time-out in seconds. A device answers within a millisecond or two; the rest is for the adapter."""

KnownAddress = Sequence[int | None]
"""Vendor-ID, product code, revision and serial number; None for a part that is unknown."""

_NOTHING_KNOWN: KnownAddress = (None, None, None, None)


class FastscanProgress(NamedTuple):
    """The progress of a scan: the part and its bit, the number found so far, the present time-out in seconds."""

    part: int
    bit: int
    number: int
    wait: float
    restarts: int


@dataclass(slots=True)
class _Timing:
    floor: float
    longest: float
    wait: float
    linger: float = 0.0  # seconds of listening after an answer, for the answers of slower devices
    restarts: int = 0

    def note_answer(self, response_time: float) -> None:
        self.wait = min(max(self.wait, 3 * response_time), self.longest)

    def note_failure(self) -> None:
        """Wait longer from now on: a frame was lost, or an answer came after the time-out."""
        self.restarts += 1
        self.wait = min(2 * self.wait, self.longest)
        if self.linger:
            self.linger = min(2 * self.linger, self.longest)

    @property
    def attempts(self) -> int:
        """How often a request is sent before "no answer" is accepted: once while no scan has failed."""
        return 1 if not self.restarts else 2 if self.restarts < 4 else 3


def fastscan(
    known: KnownAddress = _NOTHING_KNOWN,
    *,
    timeout: float = LSS_TIMEOUT,
    floor: float = _FLOOR,
    attempts: int = 10,
    progress: Callable[[FastscanProgress], None] | None = None,
) -> Conversation[CanFrame, LssAddress | None]:
    """Find one device without a node-ID and switch it to configuration. Return its address, None if there is none.

    known      parts of the address that are confirmed with one request each, and not scanned; the result is None
               if no device matches them
    timeout    time-out of the begin request, in seconds
    floor      shortest time-out of all other requests, in seconds
    attempts   scans before NoAnswer is raised: the bus loses too many frames to confirm an address
    progress   called before each request
    """
    if len(known) != 4:
        raise EncodeError(f"{len(known)} known parts: expected 4, None for an unknown one")
    if not floor >= 0:
        raise EncodeError(f"floor {floor} s: expected 0 or more", "floor")
    timing = _Timing(floor, timeout, floor)
    confirmed: list[int | None] = [None, None, None, None]
    unmatched = 0  # scans in which a known part was not confirmed
    while timing.restarts < attempts:
        if (yield from _begin(timing, timeout)):
            failed = yield from _scan(known, confirmed, timing, progress)
            if failed is None:
                return LssAddress(*(part or 0 for part in confirmed))
            unmatched += known[failed] is not None
            if unmatched == 3:  # once or twice the answer may have been lost
                return None
        elif not timing.restarts:
            return None
        timing.note_failure()
        # If the last answer was lost, a device is in configuration and no longer takes part: switch it back.
        yield from switch_global(LssState.WAITING)
    raise NoAnswer(f"fastscan ran {attempts} times and found no address that a device confirmed")


def _begin(timing: _Timing, timeout: float) -> Conversation[CanFrame, bool]:
    """Return whether any device answers; measure the response time and how far apart the answers are."""
    for _ in range(2):
        times = yield from answer_times(Fastscan(0, BEGIN, 0, 0).encode(), LssService.IDENTIFIED, timeout)
        if times:
            timing.note_answer(times[-1])
            if len(times) > 1:
                timing.linger = max(timing.linger, timing.floor, 1.5 * (times[-1] - times[0]))
            return True
    return False


def _scan(
    known: KnownAddress,
    confirmed: list[int | None],
    timing: _Timing,
    progress: Callable[[FastscanProgress], None] | None,
) -> Conversation[CanFrame, int | None]:
    """Scan the four parts once, into `confirmed`. Return the part that was not confirmed, None if all were."""
    for part in range(4):
        number = known[part] if known[part] is not None else confirmed[part]
        if number is None:
            number = yield from _scan_part(part, timing, progress)
        if not (yield from _matches(Fastscan(number, 0, part, (part + 1) % 4), timing)):
            confirmed[part] = None
            return part
        confirmed[part] = number
    return None


def _scan_part(
    part: int, timing: _Timing, progress: Callable[[FastscanProgress], None] | None
) -> Conversation[CanFrame, int]:
    number = 0
    for bit in range(31, -1, -1):
        if progress is not None:
            progress(FastscanProgress(part, bit, number, timing.wait, timing.restarts))
        if not (yield from _matches(Fastscan(number, bit, part, part), timing)):
            number |= 1 << bit
    return number


def _matches(request: Fastscan, timing: _Timing) -> Conversation[CanFrame, bool]:
    for _ in range(timing.attempts):
        times = yield from answer_times(request.encode(), LssService.IDENTIFIED, timing.wait, timing.linger)
        if times:
            timing.note_answer(times[0])
            return True
    return False


class AssignedNode(NamedTuple):
    """A device that was given a node-ID. `booted` is whether its boot-up message was received, `stored` whether it
    has stored the node-ID for the next power-on."""

    address: LssAddress
    node: int
    booted: bool
    stored: bool


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
    """Find devices without a node-ID and assign `nodes` to them in order, until no device or no node-ID is left.

    `known`, `timeout`, `floor` and `progress` are those of `fastscan`; `found` is called for each device. With `store`,
    each device is asked to store its node-ID; one that does not support that has it until it is switched off
    (`AssignedNode.stored`). Raise LssRefused if a device refuses its node-ID, or if its storage fails. However it ends,
    no device is left in configuration.
    """
    check_node_ids("nodes", nodes)
    assigned: list[AssignedNode] = []
    yield from switch_global(LssState.WAITING)
    try:
        for node in nodes:
            address = yield from fastscan(known, timeout=timeout, floor=floor, progress=progress)
            if address is None:
                break
            yield from configure_node(node, timeout=timeout)
            stored = store and (yield from _stores(timeout))
            # Back in the state waiting, the device takes over its node-ID and boots.
            switched_at = yield from send_lss(LssMessage(LssService.SWITCH_GLOBAL, bytes([LssState.WAITING])))
            booted = yield from _wait_for_boot_up(node, switched_at + timeout)
            assigned.append(AssignedNode(address, node, booted, stored))
            if found is not None:
                found(assigned[-1])
    except GeneratorExit:
        raise  # the conversation is closed: nothing can be sent any more
    except BaseException:
        # A device in configuration does not take part in the next scan, and obeys what is meant for another one.
        yield from switch_global(LssState.WAITING)
        raise
    return assigned


def _stores(timeout: float) -> Conversation[CanFrame, bool]:
    try:
        yield from store_configuration(timeout=timeout)
    except LssRefused as refusal:
        if refusal.code != STORE_NOT_SUPPORTED:  # which CiA 305 allows
            raise
        return False
    return True


def _wait_for_boot_up(node: int, until: float) -> Conversation[CanFrame, bool]:
    while True:
        heard: Heard[CanFrame] = yield Listen(until)
        received = None if heard.item is None else reported_state(heard.item)
        if received is not None and received.node == node:
            return True
        if heard.now >= until:
            return False
