"""A hundred thousand reads of one node, by three threads and by fifty tasks: not one wrong value.

So many in `make proof`, a tenth of them in `make test`."""

from __future__ import annotations

import asyncio
import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from barewire import CanopenClient, CanopenServer
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.io.canopen.bus.shared_bus import CanBus
from tests.helpers import part_or_whole
from tests.io.canopen.memory_bus import device, memory_bus

NUMBERS = 100
"""Objects from 3000h on, each with another value, so that an answer to another request is a wrong value."""


def right(place: int, data: bytes) -> bool:
    return int.from_bytes(data, "little") == place * 7919


def by_threads(client: CanopenClient, threads: int, reads: int) -> list[int]:
    """Read in several threads, each in another order; return how many right values each read."""
    found = [0] * threads

    def work(number: int) -> None:
        for turn in range(reads):
            place = turn * (2 * number + 1) % NUMBERS
            found[number] += right(place, client.node().sdo.upload(0x3000 + place))

    workers = [threading.Thread(target=work, args=(number,)) for number in range(threads)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return found


async def by_tasks(client: AsyncCanopenClient, tasks: int, reads: int) -> list[int]:
    async def work(number: int) -> int:
        found = 0
        for turn in range(reads):
            place = turn * (2 * number + 1) % NUMBERS
            found += right(place, await client.node().sdo.upload(0x3000 + place))
        return found

    return await asyncio.gather(*map(work, range(tasks)))


@pytest.mark.parametrize("reads", part_or_whole(1_000, 20_000))
def test_three_threads_on_one_node(reads: int) -> None:
    with memory_bus() as bus, CanopenClient(bus, node=5, timeout=30.0) as client, client.host(device()):
        assert by_threads(client, 3, reads) == [reads] * 3
        received = client.channel().total
        assert (received.late, received.garbled) == (0, 0)


@pytest.mark.parametrize("reads", part_or_whole(40, 800))
def test_fifty_tasks_on_one_node(reads: int) -> None:
    async def main(bus: CanBus) -> list[int]:
        async with AsyncCanopenClient(bus, node=5, timeout=30.0) as client:
            with client.host(device()):
                await asyncio.sleep(0)
                return await by_tasks(client, 50, reads)

    with memory_bus() as bus:
        assert asyncio.run(main(bus)) == [reads] * 50


def test_threads_on_the_virtual_bus_of_python_can() -> None:
    pytest.importorskip("can")
    url = "can://virtual/soak?node=5&timeout=30"

    async def main() -> list[int]:
        async with AsyncCanopenClient(url) as client:
            return await by_tasks(client, 50, 20)

    with CanopenServer("can://virtual/soak", device=device()):
        with CanopenClient(url) as client:
            assert by_threads(client, 3, 500) == [500] * 3
        assert asyncio.run(main()) == [20] * 50


# `make plant`, with few nodes for a short time ------------------------------------------------------------------------

ROOT = Path(__file__).parents[3]


@pytest.mark.long
def test_the_nodes_of_a_plant_boot_run_and_are_counted() -> None:
    command = [sys.executable, "-m", "bench.plant", "--nodes", "5", "--seconds", "0.5", "--rate", "20"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.startswith("5 nodes booted and configured from their DCFs")
    found = re.search(r"(\d+) of (\d+) TPDOs received, 0 nodes lost, 0 frames lost", run.stdout)
    assert found is not None, run.stdout
    assert found[1] == found[2] != "0"
    assert not int(found[1]) % 5
