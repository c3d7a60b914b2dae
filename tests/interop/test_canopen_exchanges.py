"""Two implementations on one bus, ours and the `canopen` package of PyPI: every service that it has, in both roles.

Over python-can's virtual bus; over slcan on pseudo-terminals and over socketcand, with the bus in another process. What
a test says that it proves must really have gone past our side.

`BAREWIRE_CARRIERS=socketcan` runs them over vcan0 instead: `test_canopen_guest` does, in a kernel that has it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from tests.interop.can_bench import Carriers, bench_on, services_in
from tests.interop.can_hubs import hub
from tests.interop.can_utils_exchanges import agrees, candump
from tests.interop.canopen_exchanges import EXCHANGES, Exchange

CARRIERS = os.environ.get("BAREWIRE_CARRIERS", "virtual,slcan,socketcand").split(",")


@pytest.fixture(scope="module")
def carriers() -> Iterator[Carriers]:
    """The buses that are in other processes."""
    with ExitStack() as hubs:
        terminals = hubs.enter_context(hub("slcan", "3", lines=3)) if "slcan" in CARRIERS else []
        (address,) = hubs.enter_context(hub("socketcand")) if "socketcand" in CARRIERS else [""]
        yield Carriers(terminals, address)


def proofs(exchange: Exchange, carrier: str) -> list[pytest.MarkDecorator]:
    """What an exchange proves over a carrier. On real SocketCAN candump looks on, so it is its word as well."""
    strangers = [exchange.stranger] if exchange.services else []
    if strangers and carrier == "socketcan":
        strangers.append("candump")
    mark = pytest.mark.evidence
    return [mark(stranger, exchange.role, carrier, *exchange.services) for stranger in strangers]


@pytest.mark.parametrize(
    ("exchange", "carrier"),
    [
        pytest.param(exchange, carrier, marks=proofs(exchange, carrier), id=f"{carrier}-{exchange.name}")
        for carrier in CARRIERS
        for exchange in EXCHANGES
        if exchange.goes_over(carrier)
    ],
)
def test_exchange(carriers: Carriers, exchange: Exchange, carrier: str) -> None:
    with ExitStack() as stack:
        lines = stack.enter_context(candump()) if carrier == "socketcan" and exchange.services else None
        bench = stack.enter_context(bench_on(carriers, carrier))
        exchange.run(bench)
        bench.quiet()
        assert set(exchange.services) <= services_in(bench.seen)
    if lines is not None:
        agrees(lines, bench.seen)
