"""Two clients on one SDO channel, in every order of their frames on the bus.

    client 1  -- 605h --+
    client 2  -- 605h --+-->  server of node 5          each frame reaches all others on the bus, in one order
    both     <-- 585h --+

CiA 301 gives a channel one client, but nothing on the bus prevents a second one. The choices: which of the stations
that have a frame to send sends next, and when a client begins its next transfer. A station sends its own frames in
order, and one may be ready long before it gets the bus, so a client can send on the strength of what it knew before.

Every read of an object returns another value, and every download writes another one. What is checked, in every run:

    own value    an upload raises, or returns the whole value of one read of its own object since it began
    written      a download raises, or the server has written exactly its bytes to its object since it began

A client that notices the other one raises NoAnswer, and what its download did is then unknown: `mixed` counts the
writes of bytes that neither client sent as one value.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from barewire.canopen import CanFrame, SdoAbort, SdoServer
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import NoAnswer
from tests.canopen.sdo.sdo_bus import FRAME_TIME
from tests.model.choices import Choices
from tests.model.sdo import REQUEST, SIZES, Mode, PublicClient, RecordingStore, Verb, value_of


@dataclass(frozen=True)
class TwoClients:
    """The alphabet of a scenario. Each client makes `transfers` transfers."""

    transfers: int = 1
    verbs: tuple[Verb, ...] = ("upload", "download")
    modes: tuple[Mode, ...] = ("expedited",)
    objects: tuple[int, ...] = (0x2100, 0x2101)
    hears: bool = True
    """Whether the port of a client delivers the requests of the other one."""
    own_frames: bool | None = False
    """What the clients know of their ports, see `Channel`."""
    server: Callable[..., SdoServer] = SdoServer


@dataclass
class TwoTally:
    """What happened in all runs of a scenario."""

    transfers: int = 0
    right: int = 0
    errors: int = 0
    noticed: int = 0
    """Of `errors`: because of the other client."""
    mixed: int = 0
    wrong: list[str] = field(default_factory=list)


class Station:
    """A station on the bus: the frames it has to send."""

    def __init__(self) -> None:
        self.sending: deque[CanFrame] = deque()


class ClientStation(Station):
    """A client: its channel, its transfer, and the frames that wait for it."""

    def __init__(self, own_frames: bool | None) -> None:
        super().__init__()
        self.public = PublicClient(own_frames)
        self.inbox: deque[CanFrame] = deque()
        self.conversation: Conversation[CanFrame, Any] | None = None
        self.step: Any = None
        self.begun = 0
        """The number of transfers that it has begun."""
        self.check: Callable[[Any], None]


class TwoOnOneChannel:
    """The bus, the server, the two clients, and the time."""

    def __init__(self, choices: Choices, setup: TwoClients, tally: TwoTally) -> None:
        self.choices, self.setup, self.tally = choices, setup, tally
        self.now = 0.0
        self.store = RecordingStore(setup.objects)
        self.server = setup.server(5, self.store, blksize=2)
        self.server_station = Station()
        self.clients = (ClientStation(setup.own_frames), ClientStation(setup.own_frames))
        self.sent: set[tuple[int, bytes]] = set()
        """The object and the bytes of every download."""

    def begin(self, client: ClientStation) -> None:
        """Begin the next transfer of a client."""
        take = self.choices.take
        verb, mode, index = take(self.setup.verbs), take(self.setup.modes), take(self.setup.objects)
        self.store.length = SIZES[mode]
        client.begun += 1
        self.tally.transfers += 1
        number = 100 + 10 * client.begun + self.clients.index(client)
        written = value_of(index, number, SIZES[mode])
        begun_at = len(self.store.done)
        if verb == "download":
            self.sent.add((index, written))
        client.conversation = client.public.transfer(verb, mode, index, written)

        def check(result: bytes | None) -> None:
            value = written if verb == "download" else result
            if (verb, index, value) in self.store.done[begun_at:]:
                self.tally.right += 1
            else:
                where = f"{mode} {verb} of {index:X}h by client {self.clients.index(client) + 1}"
                shown = "confirmed" if result is None else result.hex()
                self.tally.wrong.append(f"{where} of {self.choices.script}: {shown}, {self.store.done[begun_at:]}")

        client.check = check
        client.step = next(client.conversation)
        self._run(client, None)

    def _run(self, client: ClientStation, heard: Heard[CanFrame] | None) -> None:
        """Resume a client, and continue until it has to wait."""
        assert client.conversation is not None
        try:
            while True:
                if heard is not None:
                    client.step = client.conversation.send(heard)
                if not isinstance(client.step, Listen):
                    client.sending.extend(client.step.items)
                    heard = Heard(None, self.now)
                elif client.inbox:
                    heard = Heard(client.inbox.popleft(), self.now)
                elif client.step.until <= self.now:
                    heard = Heard(None, self.now)
                else:
                    return
        except StopIteration as stop:
            client.conversation = None
            client.check(stop.value)
        except (SdoAbort, NoAnswer) as error:
            client.conversation = None
            self.tally.errors += 1
            self.tally.noticed += "another client" in str(error)

    def transmit(self, station: Station) -> None:
        """Put the next frame of a station on the bus: it reaches all others."""
        frame = station.sending.popleft()
        self.now += FRAME_TIME
        if station is not self.server_station:
            self.server_station.sending.extend(self.server.feed(frame, self.now))
        for client in self.clients:
            if client is station or (not self.setup.hears and frame.id == REQUEST):
                continue
            client.public.bus.monitor.feed(frame, self.now)
            client.inbox.append(frame)
            if client.conversation is not None:
                self._run(client, Heard(client.inbox.popleft(), self.now))
        self._serve()

    def _serve(self) -> None:
        while self.server.deadline is not None and self.server.deadline <= self.now:
            self.server_station.sending.extend(self.server.feed(None, self.now))

    def wait(self) -> None:
        """Let time pass until a station continues without a frame."""
        waiting = [client for client in self.clients if client.conversation is not None]
        dues = [client.step.until for client in waiting]
        if self.server.deadline is not None:
            dues.append(self.server.deadline)
        self.now = max(self.now, min(dues))
        self._serve()
        for client in waiting:
            if client.conversation is not None and client.step.until <= self.now:
                self._run(client, Heard(None, self.now))

    def actions(self) -> list[Callable[[], None]]:
        """What may happen next."""
        actions: list[Callable[[], None]] = [
            partial(self.transmit, station) for station in (self.server_station, *self.clients) if station.sending
        ]
        idle = [client for client in self.clients if client.conversation is None]
        actions += [partial(self.begin, client) for client in idle if client.begun < self.setup.transfers]
        if not actions and len(idle) < len(self.clients):
            actions.append(self.wait)
        return actions


def two_clients_scenario(setup: TwoClients, tally: TwoTally) -> Callable[[Choices], None]:
    """The scenario of one setup: every order of the frames of two clients and the server."""

    def play(choices: Choices) -> None:
        bus = TwoOnOneChannel(choices, setup, tally)
        while actions := bus.actions():
            choices.take(actions)()
        written = {(index, value) for verb, index, value in bus.store.done if verb == "download"}
        tally.mixed += len(written - bus.sent)

    return play
