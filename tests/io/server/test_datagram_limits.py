"""Datagrams that a UDP server refuses: its own answers that come back, and too many of one host."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from collections.abc import Callable

import pytest

from barewire import AsyncModbusServer, ModbusServer, Table
from barewire.io.ports.network import is_own_address
from barewire.io.server.limits import COPIES, RATE, DatagramLimits

WRITE = bytes.fromhex("0001 0000 0006 01 06 0001 002A")
SENDER = ("192.0.2.1", 502)
EQUAL = ["05 0001 FF00", "06 0001 002A", "16 0001 00F2 0025"]
"""Requests with an answer that equals them."""


def limits() -> DatagramLimits:
    return DatagramLimits(lambda sender: False)


def answered(found: DatagramLimits, data: bytes, now: float) -> bool:
    if found.is_own_answer(data, SENDER, now):
        return False
    found.answered_with_itself(data, SENDER, now)
    return True


def test_of_the_same_datagram_without_a_pause_one_is_refused() -> None:
    found = limits()
    results = [answered(found, WRITE, number / 100) for number in range(2 * COPIES + 2)]
    assert [place for place, was_answered in enumerate(results) if not was_answered] == [COPIES, 2 * COPIES + 1]


def test_the_same_datagram_with_pauses_is_always_answered() -> None:
    found = limits()
    assert all(answered(found, WRITE, float(number)) for number in range(3 * COPIES))


def test_other_datagrams_are_always_answered() -> None:
    found = limits()
    assert all(answered(found, number.to_bytes(2, "big") + WRITE[2:], 0.0) for number in range(3 * COPIES))
    assert len(found._copies) == 1024


def test_each_host_has_a_limit_of_its_own_for_a_second() -> None:
    found = limits()
    assert [found.is_too_much("192.0.2.1", 5.0) for _ in range(RATE + 2)] == [False] * RATE + [True] * 2
    assert not found.is_too_much("192.0.2.2", 5.9)
    assert not found.is_too_much("192.0.2.1", 6.0)


def test_hosts_beyond_those_remembered_share_a_limit() -> None:
    found = limits()
    refused = [found.is_too_much(f"host {number}", 0.0) for number in range(1024 + RATE + 1)]
    assert refused == [False] * (1024 + RATE) + [True]
    assert len(found._received) == 1025


@pytest.mark.parametrize(
    ("own", "sender", "expected"),
    [
        (("127.0.0.1", 502), ("127.0.0.1", 502), True),
        (("127.0.0.1", 502), ("127.0.0.1", 503), False),
        (("127.0.0.1", 502), ("127.0.0.2", 502), False),
        (("0.0.0.0", 502), ("127.0.0.1", 502), True),
        (("0.0.0.0", 502), ("127.0.0.1", 503), False),
        (("0.0.0.0", 502), ("192.0.2.1", 502), False),
    ],
)
def test_the_own_address(own: tuple[str, int], sender: tuple[str, int], expected: bool) -> None:
    assert is_own_address(own, sender) == expected


# With sockets: the socket of a server also sends the forged datagram ------------------------------------------------


async def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end
        await asyncio.sleep(0.01)


def bound() -> socket.socket:
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    found.bind(("127.0.0.1", 0))
    return found


@pytest.mark.parametrize("pdu", EQUAL)
def test_a_datagram_from_the_own_address_is_refused(pdu: str) -> None:
    data = bytes.fromhex(pdu)
    data = bytes([0, 1, 0, 0, 0, 1 + len(data), 1]) + data

    async def main() -> None:
        with bound() as port:
            async with AsyncModbusServer("udp://127.0.0.1:0", {1: Table()}, listener=port.dup()) as server:
                port.sendto(data, port.getsockname())
                await until(lambda: server.statistics.echoes == 1)
                assert server.statistics.requests == 0

    asyncio.run(main())


@pytest.mark.parametrize("pdu", EQUAL)
def test_two_servers_that_answer_each_other_come_to_rest(pdu: str) -> None:
    data = bytes.fromhex(pdu)
    data = bytes([0, 1, 0, 0, 0, 1 + len(data), 1]) + data

    async def main() -> None:
        with bound() as first, contextlib.closing(ModbusServer("udp://127.0.0.1:0", {1: Table()})) as threaded:
            threaded.start()
            async with AsyncModbusServer("udp://127.0.0.1:0", {1: Table()}, listener=first.dup()) as server:
                first.sendto(data, ("127.0.0.1", threaded.port))
                both = server.statistics, threaded.statistics
                await until(lambda: sum(counted.echoes for counted in both) == 1)
                assert sum(counted.requests for counted in both) == 2 * COPIES

    asyncio.run(main())


def test_a_client_that_repeats_its_write_with_the_same_transaction_is_answered() -> None:
    with ModbusServer("udp://127.0.0.1:0", {1: Table()}) as server, bound() as client:
        client.settimeout(30)
        for _ in range(300):
            client.sendto(WRITE, ("127.0.0.1", server.port))
            assert client.recv(300) == WRITE
