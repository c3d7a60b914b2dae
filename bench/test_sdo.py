"""A mebibyte over SDO: by us and by the `canopen` library, the same value, checked.

    the client alone       against a server that only counts: it hands over what a client must hear, made beforehand
    in memory              with barewire's server; no bus, no thread
    on python-can          its virtual bus: threads, queues, a message object for each frame; client and server in one
                           process, so one time is the sum of both sides

The library's own server has no blocks: what its users get from one of its nodes is segmented. That is a row of its own,
with a smaller value, since it is that much slower. Times are of the processor, in all threads, because a waiting thread
is no work.
"""

from __future__ import annotations

import asyncio
import threading
import time
from binascii import crc_hqx
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import can
import canopen
import pytest

from barewire.canopen import (
    AbortCode,
    CanFrame,
    Device,
    LssAddress,
    LssSlave,
    LssState,
    ObjectDictionary,
    SdoAbort,
    SdoServer,
    download,
    upload,
)
from barewire.conversation import Conversation, Heard, Send
from barewire.shells import open_canopen, open_canopen_async, open_host
from barewire.shells.can_bus import CanPort
from barewire.shells.endpoint import Endpoint
from bench.race import Factory, Many, Race, entries

MEBIBYTE = 1 << 20
SHORT = 1 << 14
ROUNDS = 5
NODE = 5
VALUE = bytes(place * 7 % 251 for place in range(MEBIBYTE))

Hear = Callable[[bytes], list[Any]]
"""What a server says to a frame, as its hearer has frames: ours `CanFrame`, theirs a bytearray."""


def as_ours(data: bytes) -> CanFrame:
    return CanFrame(0x585, data)


class Store:
    """One object of any length."""

    def __init__(self, value: bytes) -> None:
        self.value = value

    def size(self, index: int, sub: int) -> int | None:
        if index != 0x2100:
            raise SdoAbort(AbortCode.NO_OBJECT, index, sub)
        return None

    def read(self, index: int, sub: int) -> bytes:
        self.size(index, sub)
        return self.value

    def may_write(self, index: int, sub: int, size: int | None) -> None:
        self.size(index, sub)

    def write(self, index: int, sub: int, data: bytes) -> None:
        self.value = data


class Counting:
    """A server that does no work while it is timed: its frames are made beforehand, what it hears it counts."""

    def __init__(self, value: bytes, make: Callable[[bytes], Any]) -> None:
        size = len(value).to_bytes(4, "little")
        self._frames: deque[list[Any]] = deque([[b"\xc6\0\x21\0" + size]])
        for start in range(0, len(value), 889):
            part = value[start : start + 889]
            block = [bytes([at // 7 + 1]) + part[at : at + 7].ljust(7, b"\0") for at in range(0, len(part), 7)]
            if start + 889 >= len(value):
                block[-1] = bytes([block[-1][0] | 0x80]) + block[-1][1:]
            self._frames.append(block)
        unused = -len(value) % 7
        self._frames.append([bytes([0xC1 | unused << 2]) + crc_hqx(value, 0).to_bytes(2, "little") + bytes(5)])
        self._frames = deque([make(frame) for frame in said] for said in self._frames)
        self._make = make
        self._inside = 0
        self._downloads = False

    def hear(self, data: bytes) -> list[Any]:
        command = data[0]
        if not self._downloads:
            if command & 0xE0 == 0xC0:
                self._downloads = True
                return [self._make(b"\xa4\0\x21\0\x7f\0\0\0")]
            return self._frames.popleft() if self._frames else []
        if command & 0x80 and self._inside < 0:
            return [self._make(b"\xa1\0\0\0\0\0\0\0")]
        self._inside += 1
        if command < 0x7F:
            return []
        said = bytes([0xA2, self._inside, 0x7F]) + bytes(5)
        self._inside = -1 if command & 0x80 else 0
        return [self._make(said)]


def real(store: Store, client: str) -> Hear:
    """barewire's server, heard without a bus."""
    server = SdoServer(NODE, store)

    def hear(frame: CanFrame) -> list[Any]:
        said = server.feed(frame, 0.0)
        while server.deadline is not None and server.deadline <= 0.0:
            said += server.feed(None, 0.0)
        return said

    if client == "barewire":
        return hear
    return lambda data: [bytearray(frame.data) for frame in hear(CanFrame(0x605, data))]


def ours(hear: Callable[[CanFrame], list[CanFrame]], conversation: Conversation[CanFrame, Any]) -> Any:
    """Our client on it, as the engine of the shells carries a conversation out."""
    coming: deque[CanFrame] = deque()
    new = tuple.__new__
    try:
        step = next(conversation)
        while True:
            frame = None
            if isinstance(step, Send):
                coming.extend(hear(step.item))
            elif coming:
                frame = coming.popleft()
            step = conversation.send(new(Heard, (frame, 0.0)))
    except StopIteration as stop:
        return stop.value


class TheirBus:
    """A bus of theirs without python-can: what the client sends is heard at once."""

    channel_info = "memory"

    def __init__(self, network: Any, hear: Hear) -> None:
        self._network, self._hear = network, hear

    def send(self, message: Any, timeout: float | None = None) -> None:
        for data in self._hear(bytes(message.data)):
            self._network.notify(0x585, data, 0.0)


def their_node(hear: Hear) -> Any:
    network = canopen.Network()
    network.bus = TheirBus(network, hear)
    node = canopen.RemoteNode(NODE, canopen.ObjectDictionary())
    network.add_node(node)
    return node


def listening(client: str, alone: bytes | None, store: Store) -> Any:
    """A server for one of the clients: one that only counts, or the real one."""
    if client == "canopen":
        return their_node(real(store, client) if alone is None else Counting(alone, bytearray).hear)
    if alone is None:
        return real(store, client)
    counting = Counting(alone, as_ours)
    return lambda frame: counting.hear(frame.data)


def their_upload(node: Any, *, block: bool = True) -> bytes:
    with node.sdo.open(0x2100, 0, "rb", block_transfer=block) as stream:
        return bytes(stream.read())


def their_download(node: Any, value: bytes) -> None:
    with node.sdo.open(0x2100, 0, "wb", size=len(value), block_transfer=True) as stream:
        stream.write(value)


class Prepared(Many):
    """Work with something to prepare before each time, which does not count. What it gives is held against `right`."""

    measures_itself = True

    def __init__(self, prepare: Callable[[], Any], work: Callable[[Any], Any], right: Any) -> None:
        super().__init__(self.measure)
        self.prepare, self.work, self.right = prepare, work, right

    def measure(self, count: int) -> float:
        """Seconds of the processor for one."""
        took = 0.0
        for _ in range(count):
            it = self.prepare()
            start = time.process_time()
            found = self.work(it)
            took += time.process_time() - start
            assert found == self.right
        return took / count


# Without a bus ---------------------------------------------------------------------------------------------------


def without_bus(verb: str, server: str) -> Race:
    value, alone = (VALUE, VALUE) if verb == "upload" else (b"", b"")

    def factory(client: str) -> Factory:
        def prepare() -> Any:
            return listening(client, alone if server == "the client alone" else None, Store(value))

        def upload_it(it: Any) -> bytes:
            if client == "canopen":
                return their_upload(it)
            return bytes(ours(it, upload(NODE, 0x2100, block=True)))

        def download_it(it: Any) -> bytes:
            if client == "canopen":
                their_download(it, VALUE)
            else:
                ours(it, download(NODE, 0x2100, 0, VALUE, block=True))
            return VALUE

        return lambda closing: Prepared(prepare, upload_it if verb == "upload" else download_it, VALUE)

    who = {"barewire": factory("barewire"), "canopen": factory("canopen")}
    return Race("SDO", f"block {verb}, {server}", MEBIBYTE, who, rounds=ROUNDS, turn=0.0)


# On python-can ---------------------------------------------------------------------------------------------------


@contextmanager
def our_server(store: Store) -> Iterator[None]:
    port = CanPort(Endpoint.parse("can://virtual/bench"))
    server, stop = SdoServer(NODE, store), threading.Event()

    def live() -> None:
        while not stop.is_set():
            wait = 0.05 if server.deadline is None else min(0.05, max(0.0, server.deadline - time.monotonic()))
            for frame in server.feed(port.receive(wait), time.monotonic()):
                port.send(frame)

    thread = threading.Thread(target=live)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        port.close()


@contextmanager
def their_server(value: bytes, channel: str = "theirs") -> Iterator[None]:
    objects = canopen.ObjectDictionary()
    domain = canopen.objectdictionary.ODVariable("anything", 0x2100, 0)
    domain.data_type, domain.access_type = canopen.objectdictionary.DOMAIN, "rw"
    objects.add_object(domain)
    network = canopen.Network()
    network.connect(interface="virtual", channel=channel)
    network.create_node(NODE, objects).set_data(0x2100, 0, value)
    try:
        yield
    finally:
        network.disconnect()


@contextmanager
def their_network(channel: str = "bench") -> Iterator[Any]:
    network = canopen.Network()
    network.connect(interface="virtual", channel=channel)
    node = canopen.RemoteNode(NODE, canopen.ObjectDictionary())
    network.add_node(node)
    node.sdo.RESPONSE_TIMEOUT = 10.0
    try:
        yield node
    finally:
        network.disconnect()


URL = f"can://virtual/bench?node={NODE}&timeout=10"


async def with_asyncio(value: bytes | None) -> bytes:
    async with await open_canopen_async(URL) as client:
        if value is None:
            return await client.upload(0x2100, block=True)
        await client.download(0x2100, 0, value, block=True)
        return value


def moved(client: str, value: bytes | None) -> bytes:
    """One block transfer by a client that is opened and closed for it."""
    if client == "barewire, asyncio":
        return asyncio.run(with_asyncio(value))
    if client == "barewire":
        with open_canopen(URL) as blocking:
            if value is None:
                return blocking.upload(0x2100, block=True)
            blocking.download(0x2100, 0, value, block=True)
            return value
    with their_network() as node:
        if value is None:
            return their_upload(node)
        their_download(node, value)
        return value


def on_python_can(verb: str) -> Race:
    def factory(client: str) -> Factory:
        def make(closing: ExitStack) -> Prepared:
            def work(store: Store) -> bytes:
                with our_server(store):
                    found = moved(client, None if verb == "upload" else VALUE)
                assert store.value == VALUE
                return found

            return Prepared(lambda: Store(VALUE if verb == "upload" else b""), work, VALUE)

        return make

    who = {name: factory(name) for name in ("barewire", "barewire, asyncio", "canopen")}
    what = f"block {verb}, python-can's virtual bus"
    return Race("SDO", what, MEBIBYTE, {**who, "python-can alone": the_bus_itself}, rounds=3, turn=0.0)


def the_bus_itself(closing: ExitStack) -> Prepared:
    """As many messages as a mebibyte has segments, sent and received, and nothing done with them."""
    sender, receiver = (can.Bus(interface="virtual", channel="floor") for _ in range(2))
    closing.callback(sender.shutdown)
    closing.callback(receiver.shutdown)

    def work(_: object) -> int:
        count = 0
        for start in range(0, MEBIBYTE, 889):
            segments = range(min(127, -(-(MEBIBYTE - start) // 7)))
            for _ in segments:
                sender.send(can.Message(arbitration_id=0x585, is_extended_id=False, data=bytes(8)))
            for _ in segments:
                count += receiver.recv(1.0) is not None
        return count

    return Prepared(lambda: None, work, -(-MEBIBYTE // 7))


def with_own_server(closing: ExitStack) -> Prepared:
    value = VALUE[:SHORT]
    closing.enter_context(our_server(Store(value)))
    return Prepared(lambda: None, lambda _: moved("barewire", None), value)


def with_their_own_server(closing: ExitStack) -> Prepared:
    value = VALUE[:SHORT]
    closing.enter_context(their_server(value))
    node = closing.enter_context(their_network("theirs"))
    return Prepared(lambda: None, lambda _: their_upload(node, block=False), value)


def own_servers() -> Race:
    """The best that each has: blocks, and segments. On a bus each, for both servers are node 5."""
    who: dict[str, Factory] = {"barewire": with_own_server, "canopen": with_their_own_server}
    return Race("SDO", "upload, each with its own server, python-can", SHORT, who, rounds=ROUNDS, turn=0.0)


RACES = (
    *(without_bus(verb, how) for verb in ("upload", "download") for how in ("the client alone", "in memory")),
    *(on_python_can(verb) for verb in ("upload", "download")),
    own_servers(),
)


@pytest.mark.parametrize(("race", "who"), entries(*RACES))
def test_sdo(enter: Callable[[Race, str], None], race: Race, who: str) -> None:
    enter(race, who)


# Not SDO, but the same bus -----------------------------------------------------------------------------------------


def fastscan(closing: ExitStack) -> Many:
    """128 unknown bits, 92 of them ones, which cost a wait each: on the clock, since waiting is what it does."""
    address = LssAddress(0xFFFF0360, 0xDEADBEEF, 0x7FFF0002, 0xFFFFFFFF)
    nameless = Device(None, ObjectDictionary(), lss=LssSlave(address))
    closing.enter_context(open_host("can://virtual/lss", node=nameless))
    client = closing.enter_context(open_canopen("can://virtual/lss"))

    def work(count: int) -> None:
        for _ in range(count):
            client.switch_global(LssState.WAITING)
            assert client.fastscan() == address

    return Many(work)


FASTSCAN = Race("LSS", "fastscan, python-can's virtual bus", "128 bits", {"barewire": fastscan}, rounds=3, turn=0.0)


@pytest.mark.parametrize(("race", "who"), entries(FASTSCAN))
def test_fastscan(enter: Callable[[Race, str], None], race: Race, who: str) -> None:
    enter(race, who)
