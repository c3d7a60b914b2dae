"""The contestants on a CAN bus: hand-written code, barewire, python-can and the `canopen` library.

Each factory receives a `Place` and returns the work. Processor time is that of all threads of the client's process, and
on a socket pair and on vcan the responder is another process.
"""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from binascii import crc_hqx
from collections.abc import Callable
from contextlib import ExitStack
from struct import Struct
from typing import Any

import can
import canopen

from barewire import AsyncCanopenClient, CanopenClient
from barewire.canopen import CanFrame
from bench.can_places import Place
from bench.can_responder import COUNT, COUNTED, NODE, PAIR, RECEIVED, SEND, SENT, VALUE, frame_of
from bench.race import Many, Work
from bench.sdo_peers import their_download, their_node, their_upload

REQUEST = 0x600 + NODE
TIMEOUT = 10.0
ORDERS = 5
Make = Callable[[ExitStack, Place], Work]


def raw(closing: ExitStack, place: Place) -> Any:
    """Return a raw socket with a time-out that the system keeps."""
    port = closing.enter_context(place.raw())
    port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, Struct("@qq").pack(int(TIMEOUT), 0))
    return port


# Expedited reads -------------------------------------------------------------------------------------------------


def read_by_hand(closing: ExitStack, place: Place) -> Work:
    port = raw(closing, place)
    request = frame_of(REQUEST, bytes.fromhex("4000100000000000"))
    head, answer = frame_of(REQUEST - 0x80, bytes(8))[:8], bytes.fromhex("43001000")

    def work() -> bytes:
        port.send(request)
        while True:
            frame = port.recv(16)
            if frame[:8] == head and frame[8:12] == answer:
                return bytes(frame[12:])

    return work


def read_by_hand_on_python_can(closing: ExitStack, place: Place) -> Work:
    bus = place.python_can()
    closing.callback(bus.shutdown)

    def work() -> bytes:
        data = bytes.fromhex("4000100000000000")
        bus.send(can.Message(arbitration_id=REQUEST, is_extended_id=False, data=data))
        while (message := bus.recv(TIMEOUT)) is not None:
            if message.arbitration_id == REQUEST - 0x80 and message.data[:4] == b"\x43\0\x10\0":
                return bytes(message.data[4:])
        raise AssertionError("no answer")

    return work


def _client(closing: ExitStack, port: Any) -> CanopenClient:
    return closing.enter_context(CanopenClient(port, node=NODE, timeout=TIMEOUT))


def read_by_us(closing: ExitStack, place: Place) -> Work:
    sdo = _client(closing, place.ours()).node().sdo
    return lambda: sdo.upload(0x1000)


def read_by_us_over_python_can(closing: ExitStack, place: Place) -> Work:
    sdo = _client(closing, place.over_python_can()).node().sdo
    return lambda: sdo.upload(0x1000)


class Awaited(Many):
    """Work of the asyncio client, in a loop of its own; `use` is called with its node."""

    def __init__(self, closing: ExitStack, place: Place, use: Callable[[Any], Any]) -> None:
        super().__init__(self.repeat)
        self.use = use
        self.loop = closing.enter_context(asyncio.Runner())

        async def opened() -> AsyncCanopenClient:
            return await AsyncCanopenClient(place.ours(), node=NODE, timeout=TIMEOUT).__aenter__()

        client = self.loop.run(opened())
        closing.callback(lambda: self.loop.run(client.close()))
        self.node = client.node()

    def repeat(self, count: int) -> Any:
        """Do the work `count` times."""

        async def work() -> Any:
            for _ in range(count):
                result = await self.use(self.node)
            return result

        return self.loop.run(work())


def read_with_asyncio(closing: ExitStack, place: Place) -> Work:
    return Awaited(closing, place, lambda node: node.sdo.upload(0x1000))


def read_by_hand_with_asyncio(closing: ExitStack, place: Place) -> Work:
    """The least that asyncio takes: a reader that stays registered, a future and a time-out for each request."""
    port, loop = closing.enter_context(place.raw()), closing.enter_context(asyncio.Runner()).get_loop()
    port.setblocking(False)
    request = frame_of(REQUEST, bytes.fromhex("4000100000000000"))
    head, answer = frame_of(REQUEST - 0x80, bytes(8))[:8], bytes.fromhex("43001000")
    waiting: list[asyncio.Future[bytes]] = []

    def receive() -> None:
        frame = port.recv(16)
        if waiting and frame[:8] == head and frame[8:12] == answer:
            waiting.pop().set_result(frame[12:])

    async def read(count: int) -> bytes:
        for _ in range(count):
            waiting.append(loop.create_future())
            port.send(request)
            async with asyncio.timeout(TIMEOUT):
                value = await waiting[0]
        return value

    loop.add_reader(port.fileno(), receive)
    closing.callback(loop.remove_reader, port.fileno())
    return Many(lambda count: loop.run_until_complete(read(count)))


def _their_client(closing: ExitStack, place: Place) -> Any:
    network = canopen.Network()
    network.bus = place.python_can()
    network.connect()
    closing.callback(network.disconnect)
    node = their_node(network)
    node.sdo.RESPONSE_TIMEOUT = TIMEOUT
    return node


def read_by_canopen(closing: ExitStack, place: Place) -> Work:
    sdo = _their_client(closing, place).sdo
    return lambda: sdo.upload(0x1000, 0)


# A mebibyte in blocks --------------------------------------------------------------------------------------------


def upload_by_hand(closing: ExitStack, place: Place) -> Work:
    port = raw(closing, place)
    confirm = frame_of(REQUEST, bytes.fromhex("A27F7F0000000000"))

    def work() -> bytes:
        port.send(frame_of(REQUEST, bytes.fromhex("A40021007F000000")))
        size = int.from_bytes(port.recv(16)[12:16], "little")
        port.send(frame_of(REQUEST, b"\xa3" + bytes(7)))
        parts: list[bytes] = []
        last = 0
        while not last & 0x80:
            for number in range(1, 128):
                frame = port.recv(16)
                last = frame[8]
                assert last & 0x7F == number
                parts.append(frame[9:])
                if last & 0x80:
                    break
            port.send(confirm)
        value = b"".join(parts)[:size]
        assert int.from_bytes(port.recv(16)[9:11], "little") == crc_hqx(value, 0)
        port.send(frame_of(REQUEST, b"\xa1" + bytes(7)))
        return value

    return work


def download_by_hand(closing: ExitStack, place: Place) -> Work:
    port = raw(closing, place)
    head = frame_of(REQUEST, bytes(8))[:8]

    def work() -> bytes:
        port.send(head + b"\xc6\0\x21\0" + len(VALUE).to_bytes(4, "little"))
        assert port.recv(16)[8] == 0xA4
        for start in range(0, len(VALUE), 889):
            end = min(start + 889, len(VALUE))
            for number, at in enumerate(range(start, end, 7), 1):
                last = 0x80 if at + 7 >= len(VALUE) else 0
                port.send(head + bytes([number | last]) + VALUE[at : at + 7].ljust(7, b"\0"))
            assert port.recv(16)[8:10] == bytes([0xA2, number])
        crc = crc_hqx(VALUE, 0).to_bytes(2, "little")
        port.send(head + bytes([0xC1 | (-len(VALUE) % 7) << 2]) + crc + bytes(5))
        assert port.recv(16)[8] == 0xA1
        return VALUE

    return work


def _moved_by(sdo: Any, verb: str) -> Work:
    if verb == "upload":
        return lambda: sdo.upload(0x2100, block=True)
    return lambda: sdo.download(0x2100, 0, VALUE, block=True) or VALUE


def block_by_us(verb: str) -> Make:
    return lambda closing, place: _moved_by(_client(closing, place.ours()).node().sdo, verb)


def block_with_asyncio(verb: str) -> Make:
    async def use(node: Any) -> bytes:
        if verb == "upload":
            return bytes(await node.sdo.upload(0x2100, block=True))
        await node.sdo.download(0x2100, 0, VALUE, block=True)
        return VALUE

    return lambda closing, place: Awaited(closing, place, use)


def block_by_canopen(verb: str) -> Make:
    def make(closing: ExitStack, place: Place) -> Work:
        node = _their_client(closing, place)
        if verb == "upload":
            return lambda: their_upload(node)
        return lambda: their_download(node, VALUE) or VALUE

    return make


# Single frames: processor time for each --------------------------------------------------------------------------


class Frames(Many):
    """The processor time of one frame; `begin` sends an order for `many` to the responder, several times in a turn."""

    measures_itself = True

    def __init__(self, begin: Callable[[], Any], take: Callable[[int], Any], many: int) -> None:
        super().__init__(self.measure)
        self.begin, self.take, self.many = begin, take, many

    def measure(self, count: int) -> float:
        """Return processor seconds for one frame."""
        took = 0.0
        for _ in range(ORDERS * count):
            self.begin()
            start = time.process_time()
            self.take(self.many)
            took += time.process_time() - start
        return took / (ORDERS * count * self.many)


def order(many: int, pause: int) -> bytes:
    return PAIR.pack(many, pause)


def receive_by_hand(many: int, pause: int) -> Make:
    def make(closing: ExitStack, place: Place) -> Work:
        port = raw(closing, place)

        def take(count: int) -> None:
            for number in range(count):
                assert port.recv(16)[8:] == number.to_bytes(8, "little")

        return Frames(lambda: port.send(frame_of(SEND, order(many, pause))), take, many)

    return make


def receive_by_python_can(many: int, pause: int) -> Make:
    def make(closing: ExitStack, place: Place) -> Work:
        bus = place.python_can()
        closing.callback(bus.shutdown)

        def take(count: int) -> None:
            for number in range(count):
                message = bus.recv(TIMEOUT)
                assert message is not None
                assert message.data == number.to_bytes(8, "little")

        data = order(many, pause)
        return Frames(lambda: bus.send(can.Message(arbitration_id=SEND, is_extended_id=False, data=data)), take, many)

    return make


def receive_by_notifier(many: int, pause: int) -> Make:
    def make(closing: ExitStack, place: Place) -> Work:
        bus, all_there, seen = place.python_can(), threading.Event(), [0]
        closing.callback(bus.shutdown)

        def listen(message: can.Message) -> None:
            seen[0] += 1
            if seen[0] == many:
                all_there.set()

        notifier = can.Notifier(bus, [listen])
        closing.callback(notifier.stop)

        def begin() -> None:
            seen[0] = 0
            all_there.clear()
            bus.send(can.Message(arbitration_id=SEND, is_extended_id=False, data=order(many, pause)))

        def take(count: int) -> None:
            assert all_there.wait(TIMEOUT)
            assert seen[0] == count

        return Frames(begin, take, many)

    return make


def receive_by_our_port(many: int, pause: int, how: str = "ours") -> Make:
    def make(closing: ExitStack, place: Place) -> Work:
        port = getattr(place, how)()
        closing.callback(port.close)

        def take(count: int) -> None:
            for number in range(count):
                frame = port.receive(TIMEOUT)
                assert frame is not None
                assert frame.data == number.to_bytes(8, "little")

        return Frames(lambda: port.send(CanFrame(SEND, order(many, pause))), take, many)

    return make


def receive_by_stream(many: int, pause: int) -> Make:
    def make(closing: ExitStack, place: Place) -> Work:
        client = _client(closing, place.ours())
        stream = closing.enter_context(client.frames((SENT, False)))

        def take(count: int) -> None:
            for number in range(count):
                frame = stream.get(TIMEOUT)
                assert isinstance(frame, CanFrame)
                assert frame.data == number.to_bytes(8, "little")

        return Frames(lambda: client.send(CanFrame(SEND, order(many, pause))), take, many)

    return make


def send_by_hand(many: int) -> Make:
    def make(closing: ExitStack, place: Place) -> Work:
        port = raw(closing, place)

        def take(count: int) -> None:
            for number in range(count):
                port.send(frame_of(RECEIVED, number.to_bytes(8, "little")))
            assert port.recv(16)[:2] == COUNTED.to_bytes(2, "little")

        return Frames(lambda: port.send(frame_of(COUNT, order(many, 0))), take, many)

    return make


def send_by_python_can(many: int) -> Make:
    def make(closing: ExitStack, place: Place) -> Work:
        bus = place.python_can()
        closing.callback(bus.shutdown)

        def send(identifier: int, data: bytes) -> None:
            bus.send(can.Message(arbitration_id=identifier, is_extended_id=False, data=data), timeout=TIMEOUT)

        def take(count: int) -> None:
            for number in range(count):
                send(RECEIVED, number.to_bytes(8, "little"))
            message = bus.recv(TIMEOUT)
            assert message is not None
            assert message.arbitration_id == COUNTED

        return Frames(lambda: send(COUNT, order(many, 0)), take, many)

    return make


def send_by_our_port(many: int, how: str = "ours") -> Make:
    def make(closing: ExitStack, place: Place) -> Work:
        port = getattr(place, how)()
        closing.callback(port.close)

        def take(count: int) -> None:
            for number in range(count):
                port.send(CanFrame(RECEIVED, number.to_bytes(8, "little")))
            frame = port.receive(TIMEOUT)
            assert frame is not None
            assert frame.id == COUNTED

        return Frames(lambda: port.send(CanFrame(COUNT, order(many, 0))), take, many)

    return make
