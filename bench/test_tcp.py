"""Modbus TCP on the loopback: ten registers, again and again, over one connection; then over many at once.

Client and server are two processes. *Two cores*: each has its own core, and the time includes waking up the other
process, as in any use with two programs. *One core*: both are on the same core, so the time is work only, without
waiting; this is the strict one. *Its own work*: the same, but only the processor time of the client is counted,
independent of other load. All clients use the same server, all servers are used by the same client.
"""

from __future__ import annotations

import asyncio
import socket
import struct
import time
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from functools import partial
from typing import Any

import pytest

from bench.race import Factory, Many, Race, Work, entries
from bench.servers import CORES, IMAGE, REGISTERS, SERVERS, on_core, start
from bench.tcp_clients import ASYNC, BLOCKING, REQUEST, Connect, ReadOnce, barewire_async, raw_socket

PLACES = {"two cores": (CORES[0], CORES[-1]), "one core": (CORES[0], CORES[0])}
if len(CORES) < 2:
    del PLACES["two cores"]
OWN_WORK = "its own work"
CLIENT_PLACES = PLACES | {OWN_WORK: PLACES["one core"]}
# Many short turns: a disturbance hits any two contestants with the same probability. With a core for each side the
# time of waking up varies most, so there are more rounds.
ROUNDS, TURN = {"two cores": 201, "one core": 61, OWN_WORK: 61}, 0.01
PROCESSES = 4
"""Processes of the same program differ in speed by up to a tenth, each for its whole life, because of their memory
layout. So each server runs in this many processes, and the rounds alternate between them."""


class OwnWork(Many):
    """The processor time of this process for one of `count` pieces of work."""

    measures_itself = True

    def __init__(self, run: Callable[[int], Any]) -> None:
        self._work = run
        super().__init__(self.measure)

    def __call__(self) -> Any:
        return self._work(1)

    def measure(self, count: int) -> float:
        """Seconds."""
        start = time.process_time()
        self._work(count)
        return (time.process_time() - start) / count


def _own_work(work: Work) -> Work:
    def often(count: int) -> Any:
        for _ in range(count):
            found = work()
        return found

    return OwnWork(work.run if isinstance(work, Many) else often)


def _one_for_all(server: str, core: int) -> Callable[[ExitStack], int]:
    """Return a function for the port of a server that all contestants of a race share; it ends with the race."""
    ports: dict[ExitStack, int] = {}

    def port(closing: ExitStack) -> int:
        if closing not in ports:
            ports[closing] = start(server, closing, core)
            closing.callback(ports.pop, closing)
        return ports[closing]

    return port


def _its_own(server: str, core: int) -> Callable[[ExitStack], int]:
    """Return a function for the port of a new server for each contestant."""
    return lambda closing: start(server, closing, core)


def _client(make: Connect, served: Callable[[ExitStack], int], place: str) -> Factory:
    ours, _ = CLIENT_PLACES[place]

    def factory(closing: ExitStack) -> Work:
        port = served(closing)
        on_core(ours, closing)
        work = make(port, closing)
        return _own_work(work) if place == OWN_WORK else work

    return factory


def _race(family: str, what: str, place: str, contestants: dict[str, Factory], expect: Any) -> Race:
    return Race(family, what, place, contestants, expect, rounds=ROUNDS[place], turn=TURN)


def blocking(place: str) -> Race:
    served = _one_for_all("raw", CLIENT_PLACES[place][1])
    contestants = {name: _client(make, served, place) for name, make in BLOCKING.items()}
    return _race("TCP client, blocking", "10 registers", place, contestants, REGISTERS)


def _in_loop(
    make: Callable[[int, int, ExitStack], Awaitable[ReadOnce]],
    served: Callable[[ExitStack], int],
    flight: int,
    place: str,
) -> Factory:
    ours, _ = CLIENT_PLACES[place]

    def factory(closing: ExitStack) -> Work:
        port = served(closing)
        on_core(ours, closing)
        loop = asyncio.new_event_loop()
        closing.callback(loop.close)
        closing.callback(lambda: loop.run_until_complete(asyncio.sleep(0.01)))
        read_once = loop.run_until_complete(_made(make(port, flight, closing)))

        async def one_after_the_other(count: int) -> Any:
            for _ in range(count):
                found = await read_once()
            return found

        async def side_by_side(count: int) -> Any:
            each, more = divmod(count, flight)  # exactly `count` requests
            tasks = (one_after_the_other(each + (place < more)) for place in range(min(flight, count)))
            return (await asyncio.gather(*tasks))[0]

        way = one_after_the_other if flight == 1 else side_by_side
        work = Many(lambda count: loop.run_until_complete(asyncio.wait_for(way(count), 20.0)))
        return _own_work(work) if place == OWN_WORK else work

    return factory


async def _made(coming: Awaitable[ReadOnce]) -> ReadOnce:
    return await coming


def asyncio_client(flight: int, place: str) -> Race:
    # pymodbus always has one request in flight, so it takes part in both races.
    served = _one_for_all("raw asyncio", CLIENT_PLACES[place][1])
    contestants = {name: _in_loop(make, served, flight, place) for name, make in ASYNC.items()}
    if flight > 1:
        contestants["barewire, 1 in flight"] = _in_loop(barewire_async, served, 1, place)
    return _race("TCP client, asyncio", f"10 registers, {flight} in flight", place, contestants, REGISTERS)


# Servers ---------------------------------------------------------------------------------------------------------


class OneByOne(Many):
    """The same work with several processes in rotation, one for each turn."""

    def __init__(self, works: list[Work]) -> None:
        self._works = deque(works)
        super().__init__(self.measure)

    def __call__(self) -> Any:
        return self._works[0]()  # the process of the next turn

    def measure(self, count: int) -> None:
        """Run one turn with one process."""
        work = self._works[0]
        for _ in range(count):
            work()
        self._works.rotate(-1)


def _server(name: str, flight: int, place: str) -> Factory:
    one = _client(partial(raw_socket, flight=flight), _its_own(name, PLACES[place][1]), place)

    def factory(closing: ExitStack) -> Work:
        works = [one(closing) for _ in range(PROCESSES)]
        if len({tuple(work()) for work in works}) > 1:
            raise AssertionError(f"{name}: its processes differ")  # the race compares the first one with `expect`
        return OneByOne(works)

    return factory


def server(flight: int, place: str) -> Race:
    # The first one is the floor. pyModbusTCP, modbus-tk and uModbus read one request at a time from a chunk.
    contestants = {name: _server(name, flight, place) for name in SERVERS if name != "raw"}
    return _race("TCP server", f"10 registers, {flight} at once", place, contestants, REGISTERS)


def many_sockets(port: int, closing: ExitStack, count: int) -> Work:
    """Send one request on each of `count` connections, then receive all answers."""
    connections = [closing.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(count)]
    for connection in connections:
        connection.settimeout(5.0)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    request, unpack = REQUEST.pack(1, 0, 6, 1, 3, 0, 10), struct.Struct(">10H").unpack_from

    def read_once() -> tuple[int, ...]:
        for connection in connections:
            connection.sendall(request)
        return [unpack(connection.recv(4096), 9) for connection in connections][-1]

    return read_once


def connections(count: int) -> Race:
    place = next(iter(PLACES))
    names = [name for name in SERVERS if name != "raw"]
    read_once, core = partial(many_sockets, count=count), PLACES[place][1]
    contestants = {name: _client(read_once, _its_own(name, core), place) for name in names}
    family, what = "TCP server, connections", "10 registers of each at once"
    return Race(family, what, count, contestants, REGISTERS, rounds=ROUNDS["one core"], turn=TURN)


assert len(IMAGE) == 20


@pytest.mark.parametrize(("race", "contestant"), entries(*map(blocking, CLIENT_PLACES)))
def test_blocking_client(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)


@pytest.mark.parametrize(
    ("race", "contestant"), entries(*(asyncio_client(n, place) for n in (1, 16) for place in CLIENT_PLACES))
)
def test_asyncio_client(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)


@pytest.mark.parametrize(("race", "contestant"), entries(*(server(n, place) for n in (1, 16) for place in PLACES)))
def test_server(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)


@pytest.mark.parametrize(("race", "contestant"), entries(*map(connections, (1, 4, 16, 64))))
def test_connections(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)
