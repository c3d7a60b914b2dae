"""Clients and servers of SDO without a bus: ours, the `canopen` library's, and a server that only counts.

        our client   --  run_ours(answer, conversation)  --\
                                                            answer(frame) -> frames     Counting, or our server (`real`)
        their client --  TheirNetwork                    --/
        their client --  TheirNetwork  ----------------------------------------------->   their own server

A frame is answered at once, and the answers wait in a queue for the client: no thread, no wait, no message of
python-can. Each side runs as its own engine would run it.
"""

from __future__ import annotations

from binascii import crc_hqx
from collections import deque
from collections.abc import Callable
from typing import Any

import canopen

from barewire.canopen import AbortCode, CanFrame, SdoAbort, SdoServer
from barewire.conversation import Conversation, Heard, Listen

NODE = 5

Answer = Callable[[bytes | bytearray], list[Any]]
"""The answers of a server to a frame, in the client's type of frames: ours `CanFrame`, theirs the eight bytes."""


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
    """A server that does no work during the measurement: frames are made beforehand, received ones are counted."""

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
        self._frames = deque([make(frame) for frame in block] for block in self._frames)
        self._make = make
        self._inside = 0
        self._downloads = False

    def answer(self, data: bytes | bytearray) -> list[Any]:
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
        acknowledgement = bytes([0xA2, self._inside, 0x7F]) + bytes(5)
        self._inside = -1 if command & 0x80 else 0
        return [self._make(acknowledgement)]


def real(store: Store, client: str) -> Answer:
    """barewire's server without a bus, as a function."""
    server = SdoServer(NODE, store)

    def answer(frame: CanFrame) -> list[Any]:
        answers = server.feed(frame, 0.0)
        while server.deadline is not None and server.deadline <= 0.0:
            answers += server.feed(None, 0.0)
        return answers

    if client == "barewire":
        return answer
    # Their client sends a bytearray and accepts bytes: only one of the two directions costs a copy.
    return lambda data: [frame.data for frame in answer(CanFrame(0x605, bytes(data)))]


# Our client --------------------------------------------------------------------------------------------------


def run_ours(answer: Callable[[CanFrame], list[CanFrame]], conversation: Conversation[CanFrame, Any]) -> Any:
    """Run a conversation of our client on a server, as the engine in `io` does."""
    coming: deque[CanFrame] = deque()
    new = tuple.__new__
    try:
        step = next(conversation)
        while True:
            frame = None
            if isinstance(step, Listen):
                if coming:
                    frame = coming.popleft()
            else:
                for item in step.items:
                    coming.extend(answer(item))
            step = conversation.send(new(Heard, (frame, 0.0)))
    except StopIteration as stop:
        return stop.value


# Theirs ------------------------------------------------------------------------------------------------------


class TheirNetwork(canopen.Network):  # type: ignore[misc]
    """A network of the canopen library without python-can: sent frames go to `receive`. Our client has no python-can
    messages in these races either."""

    def __init__(self, receive: Callable[[int, bytes | bytearray], None]) -> None:
        super().__init__()
        self._receive = receive

    def send_message(self, can_id: int, data: bytes | bytearray, remote: bool = False) -> None:
        self._receive(can_id, data)


def their_node(network: Any) -> Any:
    node = canopen.RemoteNode(NODE, canopen.ObjectDictionary())
    network.add_node(node)
    return node


def with_server(server: Answer) -> Any:
    """Their client, connected to a server that is a function."""

    def answer(identifier: int, data: bytes | bytearray) -> None:
        for frame in server(data):
            network.notify(0x585, frame, 0.0)

    network = TheirNetwork(answer)
    return their_node(network)


def their_objects() -> Any:
    """Return a dictionary of the canopen library with one object of any length."""
    objects = canopen.ObjectDictionary()
    domain = canopen.objectdictionary.ODVariable("anything", 0x2100, 0)
    domain.data_type, domain.access_type = canopen.objectdictionary.DOMAIN, "rw"
    objects.add_object(domain)
    return objects


def with_their_server(value: bytes) -> Any:
    """Their client on their server: two networks, each of which receives the frames of the other."""
    theirs = TheirNetwork(lambda identifier, data: served.notify(identifier, data, 0.0))
    served = TheirNetwork(lambda identifier, data: theirs.notify(identifier, data, 0.0))
    served.create_node(NODE, their_objects()).set_data(0x2100, 0, value)
    return their_node(theirs)


def their_upload(node: Any, *, block: bool = True) -> bytes:
    with node.sdo.open(0x2100, 0, "rb", block_transfer=block) as stream:
        return bytes(stream.read())


def their_download(node: Any, value: bytes) -> None:
    with node.sdo.open(0x2100, 0, "wb", size=len(value), block_transfer=True) as stream:
        stream.write(value)


# Servers for either client ------------------------------------------------------------------------


def server_for(client: str, alone: bytes | None, store: Store) -> Any:
    """Return a server for one of the clients: the counting one if `alone` is a value, else the real one."""
    if client == "canopen":
        return with_server(real(store, client) if alone is None else Counting(alone, bytearray).answer)
    if alone is None:
        return real(store, client)
    counting = Counting(alone, lambda data: CanFrame(0x585, data))
    return lambda frame: counting.answer(frame.data)
