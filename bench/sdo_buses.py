"""Clients and servers of SDO on python-can's virtual bus, in one process.

        server (thread) -> port -> queue of python-can -> reader (thread) -> client

Our server and theirs are on separate buses, since both are node 5.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import canopen

from barewire import AsyncCanopenClient, CanopenClient
from barewire.canopen import SdoServer
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.python_can import CanPort
from bench.sdo_peers import NODE, Store, their_download, their_node, their_objects, their_upload

URL = f"can://virtual/bench?node={NODE}&timeout=10"


@contextmanager
def our_server(store: Store) -> Iterator[None]:
    port = CanPort(Endpoint.parse("can://virtual/bench"))
    server, stop = SdoServer(NODE, store), threading.Event()

    def serve() -> None:
        while not stop.is_set():
            wait = 0.05 if server.deadline is None else min(0.05, max(0.0, server.deadline - time.monotonic()))
            for frame in server.feed(port.receive(wait), time.monotonic()):
                port.send(frame)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        port.close()


@contextmanager
def their_server(value: bytes, channel: str = "theirs") -> Iterator[None]:
    network = canopen.Network()
    network.connect(interface="virtual", channel=channel)
    network.create_node(NODE, their_objects()).set_data(0x2100, 0, value)
    try:
        yield
    finally:
        network.disconnect()


@contextmanager
def their_network(channel: str = "bench") -> Iterator[Any]:
    network = canopen.Network()
    network.connect(interface="virtual", channel=channel)
    node = their_node(network)
    node.sdo.RESPONSE_TIMEOUT = 10.0
    try:
        yield node
    finally:
        network.disconnect()


async def with_asyncio(value: bytes | None) -> bytes:
    async with AsyncCanopenClient(URL) as client:
        if value is None:
            return await client.node().sdo.upload(0x2100, block=True)
        await client.node().sdo.download(0x2100, 0, value, block=True)
        return value


def moved(client: str, value: bytes | None) -> bytes:
    """Transfer one value in blocks by a client that is opened and closed for it; return the value."""
    if client == "barewire, asyncio":
        return asyncio.run(with_asyncio(value))
    if client == "barewire":
        with CanopenClient(URL) as blocking:
            if value is None:
                return blocking.node().sdo.upload(0x2100, block=True)
            blocking.node().sdo.download(0x2100, 0, value, block=True)
            return value
    with their_network() as node:
        if value is None:
            return their_upload(node)
        their_download(node, value)
        return value
