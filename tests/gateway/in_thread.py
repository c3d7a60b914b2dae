"""A gateway beside blocking clients."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from barewire.gateway.config import read_config
from barewire.gateway.gateway import Gateway

WAIT = 30.0


@contextmanager
def running(text: str) -> Iterator[Gateway]:
    """A gateway in a thread of its own."""
    started = threading.Event()
    found: list[Any] = []

    async def main() -> None:
        async with Gateway(read_config(text)) as gateway:
            found[:] = [gateway, asyncio.get_running_loop()]
            started.set()
            await gateway.stopping.wait()

    thread = threading.Thread(target=asyncio.run, args=[main()])
    thread.start()
    assert started.wait(WAIT)
    try:
        yield found[0]
    finally:
        found[1].call_soon_threadsafe(found[0].stop)
        thread.join(WAIT)
