"""A network that is booted by its manager, blocking and with asyncio, over python-can's virtual bus."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path
from typing import Any

import pytest

from barewire import CanopenServer
from barewire.canopen import (
    BootEvent,
    BootSlave,
    LocalNode,
    NetworkList,
    NmtState,
    device_configuration,
    pdos_of,
    slave_of,
)
from tests.canopen.configuration.plant import dcf, described
from tests.io.canopen.either_client import KINDS, get, run_with

pytest.importorskip("can")


def device(number: int) -> LocalNode:
    objects = described().dictionary(number)
    return LocalNode(number, objects, pdos_of(objects, number))


@KINDS
def test_nodes_are_configured_and_started(kind: str, tmp_path: Path) -> None:
    url = f"can://virtual/{tmp_path.name}-{kind}"
    nodes = {number: device(number) for number in (5, 6)}
    slaves = [slave_of(device_configuration(dcf({"Heartbeat": 100}, number)), mandatory=True) for number in nodes]
    network = NetworkList(slaves, boot_time=60)

    async def calls(client: Any) -> None:
        events: list[str] = []
        steps: list[tuple[int, str]] = []
        result = await get(
            client.nmt.boot(
                network,
                on_event=lambda event: events.append(event.kind),
                progress=lambda node, step: steps.append((node, step)),
                timeout=10.0,
            )
        )
        assert repr(result) == "<NetworkBoot: ready, 2 nodes booted>"
        assert sorted(events) == ["booted", "booted", "ready", "started", "started"]
        assert (5, "write 1017h:00 Heartbeat = 100") in steps
        for number, node in nodes.items():
            await get(client.node(number).nmt.wait_for_state(NmtState.OPERATIONAL, timeout=30))
            assert node.objects["Heartbeat"] == 100
        assert await get(client.node(5).sdo.upload(0x1017)) == b"\x64\x00"  # the channels are free again
        ready = threading.Event()

        def on_event(event: BootEvent) -> None:
            if event.kind == "ready":
                ready.set()

        with client.nmt.start_manager(network, on_event, timeout=10.0):
            await asyncio.to_thread(ready.wait, 60)
        assert ready.is_set()

    with CanopenServer(url, device=nodes[5]), CanopenServer(url, device=nodes[6]):
        run_with(calls, kind, url)


@KINDS
def test_errors_of_the_callbacks_are_kept_and_the_nodes_are_started(kind: str, tmp_path: Path) -> None:
    url = f"can://virtual/{tmp_path.name}-{kind}"
    node = device(5)

    def on_event(event: BootEvent) -> None:
        raise ZeroDivisionError(event.kind)

    def progress(number: int, step: str) -> None:
        raise ZeroDivisionError(f"{number} {step}")

    async def calls(client: Any) -> None:
        network = NetworkList([BootSlave(5, mandatory=True)])
        with client.nmt.start_manager(network, on_event, timeout=10.0, progress=progress) as manager:
            await get(client.node(5).nmt.wait_for_state(NmtState.OPERATIONAL, timeout=30))
        assert manager.statistics.errors == [
            "callback: ZeroDivisionError: 5 read 1000h:00 device type",
            "callback: ZeroDivisionError: booted",
            "callback: ZeroDivisionError: started",
            "callback: ZeroDivisionError: ready",
        ]

    node.objects.set(0x1017, 0, 50)
    node.stored.values[0x1017, 0] = 50
    with CanopenServer(url, device=node):
        run_with(calls, kind, url)
