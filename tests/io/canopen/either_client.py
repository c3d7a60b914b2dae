"""Calls that are made with the blocking client or with that of asyncio."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from barewire import AsyncCanopenClient, CanopenClient

Calls = Callable[[Any], Awaitable[None]]

KINDS = pytest.mark.parametrize("kind", ["blocking", "asyncio"])


async def get(given: Any) -> Any:
    """Return what a method returned: on one client the value, on the other a coroutine of it."""
    return await given if inspect.isawaitable(given) else given


def run_with(calls: Calls, kind: str, bus: Any, **options: Any) -> None:
    """Make the calls with one of the two clients: of a URL, a bus, or a port."""

    async def with_asyncio() -> None:
        async with AsyncCanopenClient(bus, **options) as client:
            await calls(client)

    async def blocking() -> None:
        with CanopenClient(bus, **options) as client:
            await calls(client)

    asyncio.run(with_asyncio() if kind == "asyncio" else blocking())
