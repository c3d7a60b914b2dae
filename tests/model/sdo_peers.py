"""The SDO client of the `canopen` library, and ours, on the same bus in virtual time, with the same faults.

    client  -- 605h --> | each frame: arrives, is lost, is late; or another client sends a request | server of node 5
            <-- 585h -- |                                                                          |

The library is not changed: its network puts frames on the bus of the checker, and the `queue` and `time` modules that
it imports are replaced by ones whose time is that of the bus. A transfer is wrong if an upload returns anything but the
whole value of one read of its object since it began, or if a download returns and the server has not written its bytes
since it began.
"""

from __future__ import annotations

import logging
import queue
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib import import_module
from types import SimpleNamespace
from typing import Literal, TypeAlias
from unittest.mock import patch

from barewire.canopen import CanFrame, SdoAbort, SdoServer
from barewire.errors import NoAnswer
from tests.canopen.sdo.sdo_bus import Bus
from tests.model.choices import Choices
from tests.model.sdo import Mode, PublicClient, RecordingStore, value_of

TIMEOUT = 0.3
"""The default of the `canopen` library, in seconds."""
OBJECTS = (0x2100, 0x2101)
RIVALS = tuple(
    CanFrame(0x605, bytes.fromhex(text).ljust(8, b"\0")) for text in ("40 0021", "40 0121", "2b 0121 00 aabb")
)
"""The requests of another client: it reads both objects, and writes one of them."""

Outcome = Literal["arrives", "is lost", "is late", "another client"]
Transfer: TypeAlias = "Callable[[str, int, bytes], bytes | None]"
"""Makes one transfer: a verb, an object, the bytes to write. Returns those of an upload, or raises any exception."""


@dataclass(frozen=True)
class SdoFaults:
    """The alphabet of a scenario: what may become of a frame, and the lengths of values in bytes."""

    outcomes: tuple[Outcome, ...]
    transfers: int = 6
    sizes: tuple[int, ...] = (4, 4, 10)
    delay: float = 0.25


LATE = SdoFaults(outcomes=(*("arrives",) * 6, "is lost", "is late"))
"""One client; an eighth of the frames is lost, an eighth is late by less than the time-out."""
SHARED = SdoFaults(outcomes=(*("arrives",) * 7, "another client"))
"""No frame is lost or late; an eighth of the frames is followed by a request of another client."""


@dataclass
class SdoPeerTally:
    """What happened in all runs of a scenario."""

    transfers: int = 0
    right: int = 0
    errors: int = 0
    wrong: list[str] = field(default_factory=list)


def barewire(bus: Bus, patches: ExitStack) -> Transfer:
    """Our client."""
    client = PublicClient(False, timeout=TIMEOUT)
    bus.nodes = (*bus.nodes, client)

    def transfer(verb: str, index: int, data: bytes) -> bytes | None:
        mode: Mode = "plain" if len(data) == 4 else "segments"
        result: bytes | None = bus.run(client.transfer(verb, mode, index, data))
        return result

    return transfer


def canopen(bus: Bus, patches: ExitStack) -> Transfer:
    """The SdoClient of the `canopen` library."""
    module = import_module("canopen.sdo.client")
    inbox = bus._clients[0].inbox

    class VirtualQueue:
        """A queue.Queue of responses; to wait is to let the time of the bus pass."""

        def __init__(self) -> None:
            self._items: deque[bytes] = deque()

        def _take(self) -> None:
            while inbox:
                frame = inbox.popleft()
                if frame.id == 0x585:
                    self._items.append(frame.data)

        def empty(self) -> bool:
            self._take()
            return not self._items

        def get(self, block: bool = True, timeout: float = 0.0) -> bytes:
            until = bus.now + timeout
            while self.empty():
                if not bus._event(until):
                    bus.now = until
                    raise queue.Empty
            return self._items.popleft()

    def send_message(can_id: int, data: bytes, remote: bool = False) -> None:
        bus.rest(bus._put(CanFrame(can_id, bytes(data)), bus._clients[0], bus.now) - bus.now)

    def sleep(seconds: float) -> None:
        bus.rest(seconds)

    patches.enter_context(patch.object(module, "queue", SimpleNamespace(Queue=VirtualQueue, Empty=queue.Empty)))
    patches.enter_context(patch.object(module, "time", SimpleNamespace(sleep=sleep, time=lambda: bus.now)))
    client = module.SdoClient(0x605, 0x585, import_module("canopen").ObjectDictionary())
    client.network = SimpleNamespace(send_message=send_message)

    def transfer(verb: str, index: int, data: bytes) -> bytes | None:
        if verb == "download":
            client.download(index, 0, data)
            return None
        return bytes(client.upload(index, 0))

    return transfer


CLIENTS: dict[str, Callable[[Bus, ExitStack], Transfer]] = {"barewire": barewire, "canopen": canopen}


def sdo_peer_scenario(
    connect: Callable[[Bus, ExitStack], Transfer], setup: SdoFaults, tally: SdoPeerTally
) -> Callable[[Choices], None]:
    """The scenario of one client: `setup.transfers` transfers, one after the other."""
    logging.disable(logging.CRITICAL)

    def play(choices: Choices) -> None:
        store = RecordingStore(OBJECTS)
        held_until = 0.0

        def fault(number: int, frame: CanFrame) -> list[tuple[float, CanFrame]]:
            nonlocal held_until
            outcome = choices.take(setup.outcomes)
            if outcome == "is late":  # it holds up the frames behind it
                held_until = bus.now + setup.delay
            arrives = [(max(0.0, held_until - bus.now), frame)]
            if outcome == "another client":
                arrives.append((arrives[0][0], choices.take(RIVALS)))
            return arrives if outcome != "is lost" else []

        bus = Bus(SdoServer(5, store, timeout=TIMEOUT), fault=fault)
        with ExitStack() as patches:
            transfer = connect(bus, patches)
            for number in range(setup.transfers):
                verb, index = choices.take(("upload", "download")), choices.take(OBJECTS)
                store.length = choices.take(setup.sizes)
                data, begun_at = value_of(index, 100 + number, store.length), len(store.done)
                tally.transfers += 1
                try:
                    value = transfer(verb, index, data)
                except (SdoAbort, NoAnswer):
                    tally.errors += 1
                    continue
                except Exception as error:
                    if not type(error).__module__.startswith("canopen"):
                        raise
                    tally.errors += 1
                    continue
                expected = data if verb == "download" else value
                if (verb, index, expected) in store.done[begun_at:]:
                    tally.right += 1
                else:
                    tally.wrong.append(f"transfer {number} ({verb}) of {choices.script}: {value!r}")

    return play


if __name__ == "__main__":
    import sys

    from tests.model.choices import run_random

    for title, setup in (("late", LATE), ("shared", SHARED)):
        for name, connect in CLIENTS.items():
            tally = SdoPeerTally()
            run_random(sdo_peer_scenario(connect, setup, tally), int(sys.argv[1]) // setup.transfers)
            print(title, name, tally.transfers, tally.right, tally.errors, len(tally.wrong), *tally.wrong[:2])
