"""SYNC, the heartbeat of a master and cyclic frames of both clients, sent by Python or by the kernel."""

from __future__ import annotations

import asyncio
import errno
import socket
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from barewire import AsyncCanopenClient, CanopenClient
from barewire.canopen import CanFrame, CyclicProducer, LocalNode, NmtState, ObjectDictionary
from barewire.errors import EncodeError, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.bcm import BroadcastManager, NoBroadcastManager
from barewire.io.ports.can.socketcan import SocketCanPort
from tests.helpers import refused
from tests.io.canopen.either_client import KINDS, Calls, get, run_with
from tests.io.ports.test_bcm import Kernel


@KINDS
@pytest.mark.parametrize("by", ["python", "kernel"])
def test_python_sends_the_frames_of_a_bus_that_is_not_socketcan(kind: str, by: Any) -> None:
    url = f"can://virtual/cyclic-{kind}-{by}"

    async def calls(client: Any) -> None:
        setpoint = CyclicProducer(0.005, CanFrame(0x205, b"\1"))
        with CanopenClient(url) as other, other.frames() as frames:

            async def until(text: str) -> None:
                async with asyncio.timeout(30):
                    while str(await asyncio.to_thread(frames.get, 1.0)) != text:
                        pass

            with client.sync.start(0.005, overflow=2, by=by) as running:
                assert running.by_kernel is False
                for text in ("080#01", "080#02", "080#01"):
                    await until(text)
            with client.nmt.start_heartbeat(127, 0.005, state=NmtState.STOPPED, by=by) as running:
                assert running.by_kernel is False
                await until("77F#04")
            with client.start(setpoint, frozenset(), by=by) as running:
                assert running.by_kernel is False
                await until("205#01")
                await get(running.do(lambda now: setpoint.update(CanFrame(0x205, b"\2"))))
                await until("205#02")

    run_with(calls, kind, url)


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> Iterator[Kernel]:
    """What the clients of this test send to the broadcast manager of the kernel."""
    made = Kernel()
    monkeypatch.setattr(BroadcastManager, "_open", lambda manager: made)
    yield made
    made.close()
    made.far.close()


@pytest.fixture
def port() -> Iterator[SocketCanPort]:
    """A port of SocketCAN without a CAN bus. The client closes it."""
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    yield SocketCanPort(Endpoint.parse("can://socketcan/can7"), opened=near)
    far.close()


def run_on(port: SocketCanPort, calls: Calls, kind: str) -> None:
    """Make the calls with one of the two clients, on this port."""

    async def main() -> None:
        if kind == "asyncio":
            async with AsyncCanopenClient(port) as client:
                await calls(client)
        else:
            with CanopenClient(port) as blocking:
                await calls(blocking)

    asyncio.run(main())


@KINDS
def test_the_kernel_sends_sync_and_heartbeat_until_they_are_stopped(
    kind: str, kernel: Kernel, port: SocketCanPort
) -> None:
    async def calls(client: Any) -> None:
        with client.sync.start(0.01, overflow=2, by="kernel") as running:
            assert running.by_kernel is True
            assert kernel.messages() == ["start 0.010000 80 80#01 80#02"]
        assert kernel.messages() == ["delete 80"]
        with refused(EncodeError, "expected 0.0001 or more"):
            client.nmt.start_heartbeat(127, 0.00001, by="kernel")
        with refused(EncodeError, "by='hardware': expected 'python' or 'kernel'"):
            client.nmt.start_heartbeat(127, 0.1, by="hardware")
        with refused(EncodeError, "node 128"):
            client.nmt.start_heartbeat(128, 0.1, by="kernel")
        with refused(EncodeError, "LocalNode: expected a CyclicProducer or a SyncProducer"):
            client.start(LocalNode(5, ObjectDictionary([])), by="kernel")

    run_on(port, calls, kind)


@KINDS
def test_the_kernel_sends_changed_frames_until_the_client_is_closed(
    kind: str, kernel: Kernel, port: SocketCanPort
) -> None:
    setpoint = CyclicProducer(0.5, CanFrame(0x205, b"\1"))

    async def calls(client: Any) -> None:
        running = client.start(setpoint, by="kernel")
        assert repr(running.machine) == "<KernelCycle every 0.5 s on can://socketcan/can7: 205#01>"
        await get(running.do(lambda now: setpoint.update(CanFrame(0x205, b"\2"))))
        assert kernel.messages() == ["start 0.500000 205 205#01", "change 205 205#02"]

    run_on(port, calls, kind)
    assert kernel.messages() == ["delete 205"]
    assert kernel.is_closed


@KINDS
def test_an_error_of_the_kernel_is_raised_by_the_call(kind: str, kernel: Kernel, port: SocketCanPort) -> None:
    async def calls(client: Any) -> None:
        kernel.send_errors = [errno.ENOBUFS]
        with pytest.raises(PortError, match="can://socketcan/can7: the kernel has no room for cyclic frames"):
            client.sync.start(0.01, by="kernel")

    run_on(port, calls, kind)


@KINDS
def test_python_sends_the_frames_if_the_kernel_has_no_can_bcm(
    kind: str, monkeypatch: pytest.MonkeyPatch, port: SocketCanPort, caplog: pytest.LogCaptureFixture
) -> None:
    def missing(manager: BroadcastManager) -> None:
        raise NoBroadcastManager("the kernel has no CAN_BCM: modprobe can_bcm")

    monkeypatch.setattr(BroadcastManager, "_open", missing)
    caplog.set_level("INFO", "barewire")

    async def calls(client: Any) -> None:
        with client.sync.start(60.0, by="kernel") as running:
            assert running.by_kernel is False

    run_on(port, calls, kind)
    text = "can://socketcan/can7: cyclic frames are sent by Python: the kernel has no CAN_BCM: modprobe can_bcm"
    assert text in caplog.messages


def test_a_client_loads_the_broadcast_manager_for_the_kernel_only() -> None:
    look = """
import sys
from barewire import CanopenClient
with CanopenClient("can://virtual/bcm-import") as client, client.sync.start(60.0):
    before = "barewire.io.ports.can.bcm" in sys.modules
    with client.sync.start(60.0, by="kernel"):
        print(before, "barewire.io.ports.can.bcm" in sys.modules)
"""
    run = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True, timeout=60)
    assert run.stdout == "False True\n"
