"""A mebibyte over SDO, by barewire and by the `canopen` library; the transferred value is checked.

    the client alone       against a server that only counts and sends frames made beforehand
    in memory              with barewire's server; no bus, no thread
    on python-can          its virtual bus: threads, queues, a message object for each frame; client and server in one
                           process, so the time is the sum of both sides
    each with its own      what users of each library get
    server

The server of `canopen` has no block transfer, so its users get segments. Those rows have a smaller value, because they
are so much slower; in both the time is proportional to the bytes. Times are processor times of all threads, because
waiting is not work.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import can
import pytest

from barewire.canopen import download, upload
from bench.race import Factory, Many, Race, entries
from bench.sdo_buses import moved, our_server, their_network, their_server
from bench.sdo_peers import (
    NODE,
    Store,
    real,
    run_ours,
    server_for,
    their_download,
    their_upload,
    with_their_server,
)

MEBIBYTE = 1 << 20
SHORT = 1 << 14
ROUNDS = 5
VALUE = bytes(place * 7 % 251 for place in range(MEBIBYTE))


class Prepared(Many):
    """Work with a preparation before each time, which is not measured. The result must equal `right`."""

    measures_itself = True

    def __init__(self, prepare: Callable[[], Any], work: Callable[[Any], Any], right: Any) -> None:
        super().__init__(self.measure)
        self.prepare, self.work, self.right = prepare, work, right

    def measure(self, count: int) -> float:
        """Processor seconds for one piece of work."""
        took = 0.0
        for _ in range(count):
            it = self.prepare()
            start = time.process_time()
            found = self.work(it)
            took += time.process_time() - start
            assert found == self.right
        return took / count


# Without a bus ---------------------------------------------------------------------------------------------------


def our_upload(answer: Any) -> bytes:
    return bytes(run_ours(answer, upload(NODE, 0x2100, block=True)))


def without_bus(verb: str, server: str) -> Race:
    value = VALUE if verb == "upload" else b""
    alone = value if server == "the client alone" else None

    def factory(client: str) -> Factory:
        def prepare() -> Any:
            store = Store(value)
            return server_for(client, alone, store), store

        def upload_it(prepared: Any) -> bytes:
            it, _ = prepared
            return their_upload(it) if client == "canopen" else our_upload(it)

        def download_it(prepared: Any) -> bytes:
            it, store = prepared
            if client == "canopen":
                their_download(it, VALUE)
            else:
                run_ours(it, download(NODE, 0x2100, 0, VALUE, block=True))
            return VALUE if alone is not None else bytes(store.value)

        return lambda closing: Prepared(prepare, upload_it if verb == "upload" else download_it, VALUE)

    contestants = {"barewire": factory("barewire"), "canopen": factory("canopen")}
    return Race("SDO", f"block {verb}, {server}", MEBIBYTE, contestants, rounds=ROUNDS, turn=0.0)


# On python-can ---------------------------------------------------------------------------------------------------


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

    contestants = {name: factory(name) for name in ("barewire", "barewire, asyncio", "canopen")}
    what = f"block {verb}, python-can's virtual bus"
    return Race("SDO", what, MEBIBYTE, {**contestants, "python-can alone": the_bus_itself}, rounds=3, turn=0.0)


def the_bus_itself(closing: ExitStack) -> Prepared:
    """Send and receive as many messages as a mebibyte has segments, and do nothing with them."""
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


# Each with its own server -----------------------------------------------------------------------------------------


def on_python_can_with_own_server(closing: ExitStack) -> Prepared:
    value = VALUE[:SHORT]
    closing.enter_context(our_server(Store(value)))
    return Prepared(lambda: None, lambda _: moved("barewire", None), value)


def on_python_can_with_their_own_server(closing: ExitStack) -> Prepared:
    value = VALUE[:SHORT]
    closing.enter_context(their_server(value))
    node = closing.enter_context(their_network("theirs"))
    return Prepared(lambda: None, lambda _: their_upload(node, block=False), value)


def in_memory_with_own_server(closing: ExitStack) -> Prepared:
    value = VALUE[:SHORT]
    return Prepared(lambda: real(Store(value), "barewire"), our_upload, value)


def in_memory_with_their_own_server(closing: ExitStack) -> Prepared:
    value = VALUE[:SHORT]
    return Prepared(lambda: with_their_server(value), lambda node: their_upload(node, block=False), value)


OWN = "upload, each with its own server"
"""Each library at its best: blocks, and segments. On separate buses, because both servers are node 5."""
IN_MEMORY: dict[str, Factory] = {"barewire": in_memory_with_own_server, "canopen": in_memory_with_their_own_server}
ON_PYTHON_CAN: dict[str, Factory] = {
    "barewire": on_python_can_with_own_server,
    "canopen": on_python_can_with_their_own_server,
}

RACES = (
    *(without_bus(verb, how) for verb in ("upload", "download") for how in ("the client alone", "in memory")),
    *(on_python_can(verb) for verb in ("upload", "download")),
    Race("SDO", f"{OWN}, in memory", SHORT, IN_MEMORY, rounds=2 * ROUNDS + 1, turn=0.0),
    Race("SDO", f"{OWN}, python-can", SHORT, ON_PYTHON_CAN, rounds=ROUNDS, turn=0.0),
)


@pytest.mark.parametrize(("race", "contestant"), entries(*RACES))
def test_sdo(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)
