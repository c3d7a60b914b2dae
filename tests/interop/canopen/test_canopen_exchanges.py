"""barewire and the `canopen` package of PyPI on one bus: every service of that package, in both roles.

The carriers are python-can's virtual bus, slcan on pseudo-terminals, and socketcand with the bus in another process.
The frames of each service that a test claims must have been sent or received by our side.

`BAREWIRE_CARRIERS=socketcan` runs the exchanges over vcan0 instead; `test_canopen_guest` does so in a guest kernel.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

import tests.interop.canopen.canopen_master_exchanges  # noqa: F401 - registers its exchanges
from tests.interop.canopen.can_bench import Carriers, bench_on, services_in
from tests.interop.canopen.can_hubs import hub
from tests.interop.canopen.can_utils_exchanges import Candump, assert_same_frames, candump
from tests.interop.canopen.canopen_exchanges import EXCHANGES, Exchange

CARRIERS = os.environ.get("BAREWIRE_CARRIERS", "virtual,slcan,socketcand").split(",")


@pytest.fixture(scope="module")
def carriers() -> Iterator[Carriers]:
    """Start the buses that are in other processes."""
    with ExitStack() as hubs:
        (address,) = hubs.enter_context(hub("socketcand")) if "socketcand" in CARRIERS else [""]
        yield Carriers(address)


@pytest.fixture(scope="module")
def dump(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Candump | None]:
    """Start candump, if there is a bus for it. In a guest a new process for each exchange would take most of the
    time."""
    if "socketcan" not in CARRIERS:
        yield None
        return
    with candump(tmp_path_factory.mktemp("candump")) as running:
        yield running


def proofs(exchange: Exchange, carrier: str) -> list[pytest.MarkDecorator]:
    """Return the marks of an exchange over a carrier. On SocketCAN candump receives the frames too and gets a mark as
    well."""
    peers = [exchange.peer] if exchange.services else []
    if peers and carrier == "socketcan":
        peers.append("candump")
    mark = pytest.mark.evidence
    return [mark(peer, exchange.role, carrier, *exchange.services) for peer in peers]


@pytest.mark.parametrize(
    ("exchange", "carrier"),
    [
        pytest.param(exchange, carrier, marks=proofs(exchange, carrier), id=f"{carrier}-{exchange.name}")
        for carrier in CARRIERS
        for exchange in EXCHANGES
        if exchange.goes_over(carrier)
    ],
)
def test_exchange(carriers: Carriers, exchange: Exchange, carrier: str, dump: Candump | None) -> None:
    mark = dump.mark() if dump else ""
    with bench_on(carriers, carrier) as bench:
        exchange.run(bench)
        bench.stop_devices()
        assert set(exchange.services) <= services_in(bench.seen)
    if dump and exchange.services:
        assert_same_frames(dump.lines_since(mark), bench.seen)
