"""Clients and servers of SDO without a bus: ours, the `canopen` library's, and a server that only counts.

        our client   --  ours(hear, conversation)   --\
                                                       hear(frame) -> frames     Counting, or our server (`real`)
        their client --  TheirNetwork               --/
        their client --  TheirNetwork  -------------------------------------->   their own server

What is sent is heard at once, and what is said to it waits in a queue for the client: no thread, no wait, no message
of python-can. Each side is run as its shell would run it.
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

Hear = Callable[[bytes | bytearray], list[Any]]
"""What a server says to a frame, as its hearer has frames: ours `CanFrame`, theirs the eight bytes."""


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

    def hear(self, data: bytes | bytearray) -> list[Any]:
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
    # Theirs says a bytearray and takes bytes as well: of the two ways only one costs a copy.
    return lambda data: [frame.data for frame in hear(CanFrame(0x605, bytes(data)))]


# Our client --------------------------------------------------------------------------------------------------


def ours(hear: Callable[[CanFrame], list[CanFrame]], conversation: Conversation[CanFrame, Any]) -> Any:
    """Our client on it, as the engine of the shells carries a conversation out."""
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
                for said in step.items:
                    coming.extend(hear(said))
            step = conversation.send(new(Heard, (frame, 0.0)))
    except StopIteration as stop:
        return stop.value


# Theirs ------------------------------------------------------------------------------------------------------


class TheirNetwork(canopen.Network):  # type: ignore[misc]
    """A network of theirs without python-can, whose messages ours does not have here either: what is sent is given to
    `hear`."""

    def __init__(self, hear: Callable[[int, bytes | bytearray], None]) -> None:
        super().__init__()
        self._hear = hear

    def send_message(self, can_id: int, data: bytes | bytearray, remote: bool = False) -> None:
        self._hear(can_id, data)


def their_node(network: Any) -> Any:
    node = canopen.RemoteNode(NODE, canopen.ObjectDictionary())
    network.add_node(node)
    return node


def with_server(hear: Hear) -> Any:
    """Their client on a server that is a function."""

    def answer(identifier: int, data: bytes | bytearray) -> None:
        for said in hear(data):
            network.notify(0x585, said, 0.0)

    network = TheirNetwork(answer)
    return their_node(network)


def their_objects() -> Any:
    """A dictionary of theirs with one object of any length."""
    objects = canopen.ObjectDictionary()
    domain = canopen.objectdictionary.ODVariable("anything", 0x2100, 0)
    domain.data_type, domain.access_type = canopen.objectdictionary.DOMAIN, "rw"
    objects.add_object(domain)
    return objects


def with_their_server(value: bytes) -> Any:
    """Their client on their server: two networks that hear each other."""
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


# Either of them, on one of our servers ------------------------------------------------------------------------


def listening(client: str, alone: bytes | None, store: Store) -> Any:
    """A server for one of the clients: one that only counts, or the real one."""
    if client == "canopen":
        return with_server(real(store, client) if alone is None else Counting(alone, bytearray).hear)
    if alone is None:
        return real(store, client)
    counting = Counting(alone, lambda data: CanFrame(0x585, data))
    return lambda frame: counting.hear(frame.data)
