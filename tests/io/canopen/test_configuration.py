"""A node with its DCF, and a network that is booted by its manager, blocking and with asyncio, over a virtual bus."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path
from typing import Any

import pytest

from barewire import CanopenClient, CanopenServer
from barewire.canopen import (
    BootEvent,
    BootSlave,
    ConfigurationFailed,
    LocalNode,
    NetworkList,
    NmtState,
    device_configuration,
    pdos_of,
    slave_of,
)
from barewire.errors import EncodeError
from tests.canopen.configuration.plant import dcf, described
from tests.io.canopen.either_client import KINDS, get, run_with

pytest.importorskip("can")


def device(number: int = 5) -> LocalNode:
    objects = described().dictionary(number)
    return LocalNode(number, objects, pdos_of(objects, number))


@KINDS
def test_a_device_is_compared_configured_and_stores(kind: str, tmp_path: Path) -> None:
    url, file = f"can://virtual/{tmp_path.name}-{kind}", tmp_path / "pump.dcf"
    file.write_bytes(dcf({"Heartbeat": 500, (0x1800, 2): 1}).encode())
    local = device()

    async def calls(client: Any) -> None:
        node = client.node(dcf=file)
        assert repr(node).startswith("<node 5 of ")
        found = await get(node.diff())
        assert [f"{one.entry.index:X}" for one in found] == ["1017", "1800", "1020", "1020"]
        assert "<td>1017h:00 Heartbeat</td><td>0</td><td>500</td>" in found._repr_html_()
        assert list((await get(node.configure(dry_run=True, store=True))).changes) == found
        assert (local.objects["Heartbeat"], local.stored.values) == (0, {})
        steps: list[str] = []
        result = await get(node.configure(store=True, progress=lambda done, total, step: steps.append(step)))
        assert repr(result) == "<ConfigurationResult: 4 changes, stored, 0 left out>"
        assert "write 1017h:00 Heartbeat = 500" in steps
        assert await get(node.diff()) == []
        assert await get(node.read("Heartbeat")) == 500
        assert local.stored.values[0x1800, 2] == 1
        local.objects.set(0x1018, 2, 8)
        with pytest.raises(ConfigurationFailed, match="node 5 is another device"):
            await get(node.configure())

    with CanopenServer(url, device=local):
        run_with(calls, kind, url)


def test_mistakes_name_what_was_expected(tmp_path: Path) -> None:
    with CanopenClient(f"can://virtual/{tmp_path.name}") as client:
        plain = described()
        with pytest.raises(EncodeError, match="expected eds= or dcf=, not both"):
            client.node(5, eds=plain, dcf=plain)  # type: ignore[call-overload]
        with pytest.raises(EncodeError, match="has no ParameterValue: expected a DCF"):
            client.node(5, dcf=plain)
        with pytest.raises(EncodeError, match=r"dcf '.*missing.dcf': No such file"):
            client.node(5, dcf=tmp_path / "missing.dcf")
        with pytest.raises(EncodeError, match="node 0: expected a number"):
            client.node(0, dcf=dcf({"Heartbeat": 1}))
        with pytest.raises(AttributeError, match=r"'configure' needs a DCF: bus.node\(5, dcf=...\)"):
            client.node(5, eds=plain).configure()  # type: ignore[attr-defined]
        assert client.node(9, dcf=dcf({"Heartbeat": 1})).number == 9


# A network ------------------------------------------------------------------------------------------------------------


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
