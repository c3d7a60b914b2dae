"""SDO transfers of the public client, one after the other on one channel, with faults at every frame, in virtual time.

    client  -- 605h -->  |  each frame: arrives, is lost, comes twice, or is late and holds up  |  server of node 5
            <-- 585h --  |  the frames behind it, as on a bus                                   |

The client is `CanopenClient` with its default options: only its port is replaced, and its operations are played on the
bus of the checker. Each upload of an object returns another value, and each download writes another one, so a value
that belongs to another transfer is visible. What is checked, in every run:

    own value       an upload raises, or returns one value of its object that the server read since it began
    written         a download that returns has written its value since it began
    its own error   unless a frame came twice no transfer ends with "no such object", which only the probe asks for
    bounded         a transfer ends within the waits of its channel, and a time-out for each response
    the next one    after the faults the channel works: a transfer without faults succeeds at the second attempt at most

The assumptions: a frame comes once; no frame is late by more than the time-out of its client, or of its call if that is
longer, counted with what holds it up. SDO responses name their object and nothing else, so if a frame comes twice, the
next transfers are for other objects until one of them succeeds, or until a pause. With one object (`Transfers.objects`)
its value can be as old as the transfer before, or, if that next request is lost, the second confirmation of a download
passes for its own.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any, Literal

from barewire.canopen import AbortCode, CanFrame, SdoAbort, SdoServer
from barewire.canopen.sdo.plain import PlainExchange
from barewire.conversation import DEFAULT_TIMEOUT, Abandoned, Conversation, Heard, Listen, Send, abort_frames
from barewire.errors import NoAnswer
from barewire.io.canopen.client import CanopenClient
from tests.canopen.sdo.sdo_bus import Bus, Store, plainly
from tests.model.choices import Choices

TIMEOUT = DEFAULT_TIMEOUT
REQUEST = 0x605
INDEX = 0x2100
MANY = 7 * 80  # bytes, so many that the numbers of some segments in a block are commands of responses, such as 43h
Verb = Literal["upload", "download"]
Mode = Literal["plain", "expedited", "segments", "blocks", "short", "auto", "image"]
"""plain: expedited, as far as possible without conversation. short, auto: blocks if they are worth it. image: in
blocks, and segments look like the value of another object."""
Fault = Literal["arrives", "is lost", "comes twice", "is late", "comes short"]
SIZES: dict[Mode, int] = {
    "plain": 4,
    "expedited": 4,
    "segments": 20,
    "blocks": 20,
    "short": 20,
    "auto": 40,
    "image": MANY,
}
RESPONSES: dict[Mode, int] = {
    "plain": 1,
    "expedited": 1,
    "segments": 5,
    "blocks": 12,
    "short": 12,
    "auto": 12,
    "image": 24,
}
"""For how many responses a transfer waits at most, with those that are asked for again."""


@dataclass(frozen=True)
class Transfers:
    """The alphabet of a scenario. `faults` is the number of frames in a run that do not simply arrive."""

    length: int = 2
    verbs: tuple[Verb, ...] = ("upload", "download")
    modes: tuple[Mode, ...] = ("expedited", "segments", "blocks")
    objects: tuple[int, ...] = (INDEX,)
    outcomes: tuple[Fault, ...] = ("arrives", "is lost", "comes twice", "is late")
    delays: tuple[float, ...] = (0.75,)
    """Of a late frame, in time-outs."""
    faults: int = 1
    cancelled: tuple[int, ...] = ()
    """At which of its steps (frames sent, and waits) a transfer may be cancelled; the first one is before its
    request."""
    cancelled_after: tuple[float, ...] = (0.0,)
    """How many seconds later, if no frame arrives meanwhile."""
    timeouts: tuple[float | None, ...] = (None,)
    """Of the call, None for that of the client."""
    own_frames: tuple[bool | None, ...] = (False,)
    """What the client knows of its port, see `Channel`."""
    kept: tuple[bool, ...] = (True,)
    """Whether the frames that arrive between two transfers wait for the next one; otherwise only the bus sees them."""


DEFAULT_OPTIONS = Transfers(
    length=40,
    modes=("plain", "expedited", "segments", "blocks", "short", "auto") * 2 + ("image",),
    objects=(INDEX, INDEX + 1),
    outcomes=("arrives",) * 40 + ("is lost", "comes twice", "is late", "is late", "comes short"),
    delays=(0.02, 0.2, 0.5, 0.99, 0.99),
    faults=1_000_000,
    cancelled=(0,) * 20 + tuple(range(1, 11)),
    cancelled_after=(0.0, 0.0, 0.01, 0.4, 1.5),
    timeouts=(None, None, None, 0.02, 0.3, 2.0),
    own_frames=(False, None),
    kept=(True, False),
)
"""All that the assumptions allow."""


@dataclass
class SdoTally:
    """What happened in all runs of a scenario."""

    transfers: int = 0
    right: int = 0
    errors: int = 0
    wrong: list[str] = field(default_factory=list)
    stuck: list[str] = field(default_factory=list)
    """A description of each run after which the channel did not work, or in which a transfer took too long."""


class RecordingStore(Store):
    """Objects whose value is another one at each read; it records what was read and written."""

    def __init__(self, objects: tuple[int, ...], *, sized: bool = False) -> None:
        super().__init__()
        self.objects = {(index, 0): b"" for index in objects}
        self.length = 4
        self.done: list[tuple[str, int, bytes]] = []
        self._sized = sized

    def read(self, index: int, sub: int) -> bytes:
        """Return the next value."""
        super().read(index, sub)
        self.done.append(("upload", index, value_of(index, len(self.done), self.length)))
        return self.done[-1][2]

    def size(self, index: int, sub: int) -> int | None:
        """Return the size of the value, or None: the size is unknown."""
        super().read(index, sub)
        return self.length if self._sized else None

    def may_write(self, index: int, sub: int, size: int | None) -> None:
        """Accept any value."""

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Record the value."""
        self.done.append(("download", index, data))


def value_of(index: int, number: int, length: int) -> bytes:
    """A value in which every two bytes name the object and the number of the value. In a long one segment 43h looks
    like a value of object 0, and each after it like one of the object beside."""
    named = bytes((index & 0xFF, number & 0xFF))
    if length < MANY:
        return named * (length // 2)
    return bytes(length - 70) + ((index ^ 1).to_bytes(2, "little") + b"\0" + named * 2) * 10


class _Port:
    """A port that passes no frame: the bus of the checker does."""

    name = "virtual"
    keeps_frames = True

    def __init__(self, own_frames: bool | None) -> None:
        self.own_frames = own_frames

    def send(self, frame: CanFrame) -> None:
        raise AssertionError(f"{frame} was not sent on the bus of the checker")

    def receive(self, timeout: float) -> CanFrame | None:
        raise AssertionError("a client reads its port")

    def close(self) -> None:
        """Do nothing."""


class PublicClient(CanopenClient):
    """The public client of node 5, whose operations are returned. A participant of the bus: the bus of the client,
    which records all frames but those of the client itself."""

    deadline = None

    def __init__(self, own_frames: bool | None, **options: Any) -> None:
        super().__init__(_Port(own_frames), **options)
        self.sdo = self.node(5).sdo

    def carry_out(self, operation: Any) -> Any:
        """Return the operation."""
        return operation

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Record a frame that another participant sent."""
        if frame is not None and frame.id != REQUEST:
            self.bus.monitor.feed(frame, now)
        return []

    def transfer(
        self, verb: str, mode: Mode, index: int, data: bytes, timeout: float | None = None
    ) -> Conversation[CanFrame, Any]:
        """Return the conversation of a transfer; `data` is that of a download."""
        options: dict[str, Any] = {"timeout": timeout, "block": mode in ("blocks", "image")}
        if mode in ("short", "auto"):
            options["block"] = "auto"
        if mode == "expedited":
            options["progress"] = lambda done, size: None
        sdo: Any = self.sdo
        operation = sdo.upload(index, **options) if verb == "upload" else sdo.download(index, 0, data, **options)
        return plainly(operation) if isinstance(operation, PlainExchange) else operation.conversation


class OneChannel:
    """The bus, the server, the client, and what became of the transfers."""

    def __init__(self, choices: Choices, setup: Transfers, tally: SdoTally) -> None:
        self.choices, self.setup, self.tally = choices, setup, tally
        self.store = RecordingStore(setup.objects, sized=True)
        self.client = PublicClient(choices.take(setup.own_frames))
        self.bus = Bus(SdoServer(5, self.store, blksize=2), self.client, fault=self._fault)
        self.left = setup.faults
        self.limit = TIMEOUT
        """The seconds by which frames may be late now."""
        self._held_until = 0.0
        self._is_clean = True  # no frame of an earlier transfer can still come
        self._came_twice = False  # a frame of the present transfer
        self.doubled: set[int] = set()  # the objects of which a second answer may still come
        self._begun_at = [0, 0]

    def _fault(self, number: int, frame: CanFrame) -> list[tuple[float, CanFrame]]:
        outcome = self.choices.take(self.setup.outcomes) if self.left else "arrives"
        self.left -= outcome != "arrives"
        if outcome == "is late":
            late = self.limit * self.choices.take(self.setup.delays)
            self._held_until = max(self._held_until, self.bus.free_at + late)
        elif outcome == "comes short" and frame.id != REQUEST:  # some devices do not send trailing zeros
            frame = frame._replace(data=frame.data.rstrip(b"\0"))
        self._came_twice |= outcome == "comes twice"
        delay = max(0.0, self._held_until - self.bus.free_at)  # frames do not overtake each other
        return [(delay, frame)] * {"is lost": 0, "comes twice": 2}.get(outcome, 1)

    def transfer(self, number: int) -> None:
        """Make the next transfer."""
        take, setup, bus = self.choices.take, self.setup, self.bus
        verb, mode, timeout = take(setup.verbs), take(setup.modes), take(setup.timeouts)
        step = take((0, *setup.cancelled)) if setup.cancelled else 0
        index = take(setup.objects)
        if len(setup.objects) > 1 and self.doubled:
            others = [other for other in setup.objects if other not in self.doubled]
            if others:
                index = take(others)
            else:
                bus.rest(4 * max(self.limit, TIMEOUT))
                self.doubled.clear()
        self.limit = max(TIMEOUT, timeout or 0.0) if self._is_clean else TIMEOUT
        bus.rest(max(0.0, self._held_until - bus.now - self.limit))
        if not take(setup.kept):
            bus._clients[0].inbox.clear()
        self.run(number, verb, mode, index, timeout, step)

    def run(self, number: int, verb: Verb, mode: Mode, index: int, timeout: float | None = None, step: int = 0) -> None:
        """Make this transfer, and judge it."""
        store, tally, began = self.store, self.tally, self.bus.now
        store.length = SIZES[mode]
        tally.transfers += 1
        self._begun_at = [self._begun_at[1], len(store.done)]
        since = self._begun_at[len(self.setup.objects) > 1]
        written, self._came_twice = value_of(index, 100 + number, SIZES[mode]), False
        result = self.bus.run(self._result_of(self.client.transfer(verb, mode, index, written, timeout), step))
        where = f"transfer {number} ({verb} of {index:X}h, {mode}, time-out {timeout}) of {self.choices.script}"
        value = written if verb == "download" else result
        self._is_clean = False
        if isinstance(result, Exception):
            tally.errors += 1
            is_probes = isinstance(result, SdoAbort) and result.code == AbortCode.NO_OBJECT
            if is_probes and not (self._came_twice or self.doubled):
                tally.wrong.append(f"{where}: {result}")
        elif (verb, index, value) not in store.done[since:]:
            shown = "confirmed" if result is None else result.hex()
            tally.wrong.append(f"{where}: {shown}, expected one of {store.done[since:]}")
        else:
            tally.right += 1
            self._is_clean = not self._came_twice
            self.doubled.clear()
        if self._came_twice:
            self.doubled.add(index)
        longest = max(TIMEOUT, *(each or 0.0 for each in self.setup.timeouts))
        took = self.bus.now - began
        if took > 2 * longest + RESPONSES[mode] * (timeout or TIMEOUT) + 0.2:
            tally.stuck.append(f"{where}: {took:.3f} s")

    def _result_of(self, conversation: Conversation[CanFrame, Any], cancelled: int) -> Generator[Any, Any, Any]:
        """Return the result of a transfer, or its error. It is cancelled at this step, with 0 never."""
        try:
            step = next(conversation)
            while True:
                cancelled -= 1
                if cancelled == 0:
                    if not isinstance(step, Listen):
                        yield step
                        break
                    at = self.bus.now + self.choices.take(self.setup.cancelled_after)
                    heard: Heard[CanFrame] = yield Listen(min(step.until, at))
                    if heard.item is None and (heard.now < step.until or at <= heard.now):
                        break
                    step = conversation.send(heard)
                else:
                    step = conversation.send((yield step))
        except StopIteration as stop:
            return stop.value
        except (SdoAbort, NoAnswer) as error:
            return error
        for frame in abort_frames(conversation):
            yield Send(frame)
        return Abandoned("cancelled")


def sdo_scenario(setup: Transfers, tally: SdoTally) -> Callable[[Choices], None]:
    """The scenario of one setup: `setup.length` transfers, then one without faults."""

    def play(choices: Choices) -> None:
        channel = OneChannel(choices, setup, tally)
        for number in range(1, setup.length + 1):
            channel.transfer(number)
        channel.left = 0
        channel.bus.rest(4 * TIMEOUT * bool(channel.doubled))
        for _ in range(2):
            before = tally.right
            channel.run(200, "upload", "expedited", setup.objects[0])
            if tally.right > before:
                return
        tally.stuck.append(str(choices.script))

    return play
