"""SDO transfers, one after the other on one channel, with faults at every frame, in virtual time.

    client  -- 605h -->  |  each frame: arrives, is lost, comes twice, or is late and holds up  |  server of node 5
            <-- 585h --  |  the frames behind it, as on a bus                                   |

Each upload of the object returns another value, and each download writes another one, so a value that belongs to
another transfer is visible. What is checked, in every run:

    own value       an upload raises, or returns one value that the server read after the transfer before it began
    written         a download that returns has written its value last
    the next one    after the faults the channel works: a transfer without faults succeeds at the second attempt at most

The assumptions: a frame comes once; no frame is late by more than the time-out of a transfer, after which the channel
is quiet for another time-out. SDO responses name their object and nothing else, so if a request comes twice and the
next one is for the same object without a pause, its value can be as old as the transfer before, or, if that next
request is lost, the second confirmation of a download passes for its own.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any, Literal

from barewire.canopen import CanFrame, Channel, SdoAbort, SdoServer, download, upload
from barewire.canopen.sdo.client.plain import PlainDownload, PlainUpload
from barewire.conversation import Abandoned, Conversation, Listen, Send, abort_frames
from barewire.errors import NoAnswer
from tests.canopen.sdo.sdo_bus import Bus, Store, plainly
from tests.model.choices import Choices

TIMEOUT = 0.2
INDEX = 0x2100
SIZES = (4, 20)  # bytes of a value in one frame, and in segments or blocks
Mode = Literal["plain", "expedited", "segments", "blocks"]  # plain: expedited, as far as possible without conversation
Fault = Literal["arrives", "is lost", "comes twice", "is late"]


@dataclass(frozen=True)
class Transfers:
    """The alphabet of a scenario. `faults` is the number of frames in a run that do not simply arrive."""

    length: int = 2
    verbs: tuple[Literal["upload", "download"], ...] = ("upload", "download")
    modes: tuple[Mode, ...] = ("expedited", "segments", "blocks")
    outcomes: tuple[Fault, ...] = ("arrives", "is lost", "comes twice", "is late")
    delays: tuple[float, ...] = (0.15,)
    faults: int = 1
    cancelled: tuple[int, ...] = ()
    """At which of its waits a transfer may be cancelled; the first one is before its request."""


@dataclass
class SdoTally:
    """What happened in all runs of a scenario."""

    transfers: int = 0
    right: int = 0
    errors: int = 0
    wrong: list[str] = field(default_factory=list)
    stuck: list[str] = field(default_factory=list)
    """A description of each run after which the channel did not work."""


class ChangingStore(Store):
    """An object whose value is another one at each read: its number, as many bytes as `size`."""

    def __init__(self) -> None:
        super().__init__()
        self.length = 4
        self.reads = 0
        self.previous = 0
        """The number of reads when the transfer before the last one began."""
        self.objects = {(INDEX, 0): b""}

    def read(self, index: int, sub: int) -> bytes:
        """Return the next value."""
        self.reads += 1
        return value_of(self.reads, self.length)

    def size(self, index: int, sub: int) -> int | None:
        """Return the size of the value."""
        return self.length

    def may_write(self, index: int, sub: int, size: int | None) -> None:
        """Accept any value."""

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Keep the value."""
        self.objects[index, sub] = data


def value_of(number: int, length: int) -> bytes:
    """A value that names its number in every byte."""
    return bytes([number & 0xFF]) * length


def sdo_scenario(setup: Transfers, tally: SdoTally) -> Callable[[Choices], None]:
    """The scenario of one setup: `setup.length` transfers, then one without faults."""

    def play(choices: Choices) -> None:
        store = ChangingStore()
        left = setup.faults
        held_until = 0.0

        def fault(number: int, frame: CanFrame) -> list[tuple[float, CanFrame]]:
            nonlocal left, held_until
            outcome = choices.take(setup.outcomes) if left else "arrives"
            left -= outcome != "arrives"
            if outcome == "is late":
                held_until = max(held_until, bus.now + choices.take(setup.delays))
            delay = max(0.0, held_until - bus.now)
            return [(delay, frame)] * {"is lost": 0, "comes twice": 2}.get(outcome, 1)

        bus = Bus(SdoServer(5, store, timeout=TIMEOUT, blksize=2), fault=fault)
        channel = Channel(5, own_frames=False if "plain" in setup.modes else None)
        for number in range(1, setup.length + 1):
            verb, mode = choices.take(setup.verbs), choices.take(setup.modes)
            waits = choices.take((0, *setup.cancelled)) if setup.cancelled else 0
            _transfer(bus, channel, store, 100 + number, verb, mode, tally, choices, waits)
        left = 0
        for _ in range(2):
            before = tally.right
            _transfer(bus, channel, store, 200, "upload", "expedited", tally, choices)
            if tally.right > before:
                return
        tally.stuck.append(str(choices.script))

    return play


def _transfer(
    bus: Bus,
    channel: Channel,
    store: ChangingStore,
    number: int,
    verb: str,
    mode: Mode,
    tally: SdoTally,
    choices: Choices,
    waits: int = 0,
) -> None:
    store.length = SIZES[mode in ("segments", "blocks")]
    where = f"transfer {number} ({verb}, {mode}) of {choices.script}"
    tally.transfers += 1
    oldest, store.previous = store.previous + 1, store.reads
    written, blocks = value_of(number, store.length), mode == "blocks"
    conversation: Conversation[CanFrame, Any]
    if mode == "plain" and verb == "upload":
        conversation = plainly(PlainUpload(channel, INDEX, 0, TIMEOUT, None, None))
    elif mode == "plain":
        conversation = plainly(PlainDownload(channel, INDEX, 0, TIMEOUT, written))
    elif verb == "upload":
        conversation = upload(channel, INDEX, timeout=TIMEOUT, block=blocks)
    else:
        conversation = download(channel, INDEX, 0, written, timeout=TIMEOUT, block=blocks)
    result = bus.run(_result_of(conversation, waits))
    read = [value_of(count, size) for count in range(oldest, store.reads + 1) for size in SIZES]
    if isinstance(result, Exception):
        tally.errors += 1
    elif verb == "upload" and result not in read:
        tally.wrong.append(f"{where}: {result.hex()}, expected one of the reads {oldest} to {store.reads}")
    elif verb == "download" and store.objects[INDEX, 0] != written:
        tally.wrong.append(f"{where}: the object holds {store.objects[INDEX, 0].hex()}")
    else:
        tally.right += 1


def _result_of(conversation: Generator[Any, Any, Any], waits: int) -> Generator[Any, Any, Any]:
    """Return the result of a transfer, or its error. It is cancelled at this wait, with 0 never."""
    step = next(conversation)
    try:
        while True:
            waits -= isinstance(step, Listen)
            if not waits and isinstance(step, Listen):
                break
            step = conversation.send((yield step))
    except StopIteration as stop:
        return stop.value
    except (SdoAbort, NoAnswer) as error:
        return error
    for frame in abort_frames(conversation):
        yield Send(frame)
    return Abandoned("cancelled")
