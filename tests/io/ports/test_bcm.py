"""The CAN broadcast manager: its messages, and a socket pair in place of the kernel."""

from __future__ import annotations

import ast
import errno
import socket
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import barewire
from barewire.canopen import CanFrame, CyclicProducer, SyncProducer
from barewire.errors import EncodeError, PortError
from barewire.io.canopen.bus_methods import KernelCycle
from barewire.io.ports.can.bcm import BroadcastManager, NoBroadcastManager, delete_message, setup_message
from tests.helpers import refused
from tools import rooms

HEAD = struct.Struct("@III4xqqqqII")
ONE, TWO, OTHER = CanFrame.parse("205#0F00"), CanFrame.parse("205#1F00"), CanFrame.parse("206#01")


class Kernel:
    """The other end of the socket: it keeps the messages, and has errors for the next calls."""

    def __init__(self) -> None:
        self.inner, self.far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.far.setblocking(False)
        self.receive_errors: list[int] = []
        self.send_errors: list[int] = []
        self.is_closed = False

    def send(self, data: bytes) -> int:
        if self.send_errors:
            raise OSError(self.send_errors.pop(0), "failed")
        return self.inner.send(data)

    def recv(self, size: int) -> bytes:
        if self.receive_errors:
            raise OSError(self.receive_errors.pop(0), "failed")
        return self.inner.recv(size)

    def setblocking(self, flag: bool) -> None:
        self.inner.setblocking(flag)

    def close(self) -> None:
        self.is_closed = True
        self.inner.close()

    def messages(self) -> list[str]:
        """Return the messages since the last call: what is to be done, and the data of each frame."""
        found: list[str] = []
        while True:
            try:
                message = self.far.recv(8192)
            except BlockingIOError:
                return found
            opcode, flags, count, seconds, microseconds, *interval, identifier, frames = HEAD.unpack_from(message)
            assert (count, seconds, microseconds) == (0, 0, 0)
            assert len(message) == HEAD.size + 16 * frames
            data = []
            for at in range(HEAD.size, len(message), 16):
                sent_id, length = struct.unpack_from("=IB", message, at)
                data.append(f"{sent_id:X}#{message[at + 8 : at + 8 + length].hex()}")
            kind = {(1, 3): "start", (1, 0): "change", (2, 0): "delete"}[opcode, flags]
            times = f" {interval[0]}.{interval[1]:06}" if kind == "start" else ""
            found.append(" ".join([f"{kind}{times} {identifier:X}", *data]))


@pytest.fixture
def kernel() -> Iterator[Kernel]:
    made = Kernel()
    yield made
    made.close()
    made.far.close()


def manager_on(kernel: Kernel) -> BroadcastManager:
    opened: Any = kernel
    return BroadcastManager("can0", opened=opened)


@pytest.mark.skipif(struct.calcsize("l") != 8, reason="the struct of 64-bit systems")
@pytest.mark.parametrize(
    ("text", "identifier", "length", "data"),
    [
        ("080#", 0x80, 0, ""),
        ("205#0F00", 0x205, 2, "0F00"),
        ("18FEF100#0102030405060708", 0x98FEF100, 8, "0102030405060708"),
        ("705#R1", 0x40000705, 1, ""),
    ],
)
def test_messages_are_those_of_the_kernel(text: str, identifier: int, length: int, data: str) -> None:
    frame = CanFrame.parse(text)
    packed = struct.pack("=IB3x8s", identifier, length, bytes.fromhex(data))
    number = identifier & ~0x4000_0000
    assert setup_message([frame], 1.25) == HEAD.pack(1, 3, 0, 0, 0, 1, 250_000, number, 1) + packed
    assert setup_message([frame, frame], None) == HEAD.pack(1, 0, 0, 0, 0, 0, 0, number, 2) + 2 * packed
    assert delete_message(frame) == HEAD.pack(2, 0, 0, 0, 0, 0, 0, number, 0)


def test_new_data_replace_the_old_ones_and_leave_the_timer(kernel: Kernel) -> None:
    manager = manager_on(kernel)
    manager.send((ONE,), 0.01)
    manager.send((ONE,), 0.01)
    manager.send((TWO,), 0.01)
    assert kernel.messages() == ["start 0.010000 205 205#0f00", "change 205 205#1f00"]
    manager.send((TWO,), 0.02)
    assert kernel.messages() == ["delete 205", "start 0.020000 205 205#1f00"]
    manager.send((TWO, OTHER), 0.02)
    manager.send((OTHER,), 0.02)
    assert kernel.messages() == [
        "delete 205",
        "start 0.020000 205 205#1f00 206#01",
        "delete 205",
        "start 0.020000 206 206#01",
    ]
    manager.close()
    assert kernel.messages() == ["delete 206"]
    assert kernel.is_closed
    manager.close()


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (errno.ENOBUFS, "can://socketcan/can0: the kernel has no room for cyclic frames"),
        (errno.ENOMEM, "the kernel has no room for cyclic frames"),
        (errno.ENODEV, "the interface is gone: was the adapter unplugged?"),
        (errno.ENETDOWN, "the interface is down; the kernel sends on when it is up"),
        (errno.EINVAL, "cyclic frames: "),
    ],
)
def test_an_error_of_the_kernel_is_a_port_error_and_closes_the_socket(kernel: Kernel, number: int, text: str) -> None:
    kernel.send_errors = [number]
    with pytest.raises(PortError, match=text.replace("?", r"\?")):
        KernelCycle(CyclicProducer(0.1, ONE), manager_on(kernel))
    assert kernel.is_closed


def test_limits_of_the_kernel_are_errors_before_anything_is_sent(kernel: Kernel) -> None:
    manager = manager_on(kernel)
    with refused(EncodeError, "period 1e-05 s: expected 0.0001 or more, for the kernel"):
        manager.send((ONE,), 0.00001)
    with refused(EncodeError, "257 frames: expected 256 or fewer"):
        manager.send((ONE,) * 257, 0.1)
    manager.send((ONE,) * 256, 0.0001)
    assert [message[:18] for message in kernel.messages()] == ["start 0.000100 205"]


def test_a_cycle_takes_over_what_its_producer_changes(kernel: Kernel) -> None:
    producer = CyclicProducer(0.1, ONE)
    cycle = KernelCycle(producer, manager_on(kernel))
    assert repr(cycle) == "<KernelCycle every 0.1 s on can://socketcan/can0: 205#0F00>"
    assert (cycle.deadline, cycle.feed(None, 0.0)) == (None, [])
    producer.update(TWO)
    assert cycle.feed(None, 0.1) == []
    producer.period = 0.2
    cycle.feed(None, 0.2)
    cycle.close()
    start, change, *others = kernel.messages()
    assert (start, change) == ("start 0.100000 205 205#0f00", "change 205 205#1f00")
    assert others == ["delete 205", "start 0.200000 205 205#1f00", "delete 205"]


def test_a_sync_with_a_counter_is_a_turn_of_frames(kernel: Kernel) -> None:
    KernelCycle(SyncProducer(0.01, overflow=3), manager_on(kernel))
    assert kernel.messages() == ["start 0.010000 80 80#01 80#02 80#03"]


def test_an_interface_that_goes_down_is_logged_once(kernel: Kernel, caplog: pytest.LogCaptureFixture) -> None:
    cycle = KernelCycle(CyclicProducer(0.1, ONE), manager_on(kernel))
    kernel.receive_errors = [errno.ENETDOWN]
    for now in (0.0, 0.1, 0.2):
        cycle.feed(None, now)
    (line,) = caplog.messages
    assert line == "can://socketcan/can0: the interface is down; the kernel sends on when it is up"
    assert kernel.messages() == ["start 0.100000 205 205#0f00"]


def test_an_interface_that_was_removed_is_found_again(
    kernel: Kernel, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    manager = manager_on(kernel)
    cycle = KernelCycle(CyclicProducer(0.1, ONE), manager)
    back, opened = Kernel(), [False]

    def reopen() -> Kernel:
        if not opened[0]:
            raise PortError("can://socketcan/can0: the interface is gone: was the adapter unplugged?")
        return back

    monkeypatch.setattr(manager, "_open", reopen)
    kernel.receive_errors = [errno.ENODEV]
    for now in (0.0, 0.5, 1.0):
        cycle.feed(None, now)
    assert not manager.is_sending
    opened[0] = True
    cycle.feed(None, 1.5)
    assert back.messages() == []
    cycle.feed(None, 2.0)
    assert back.messages() == ["start 0.100000 205 205#0f00"]
    assert kernel.is_closed
    assert len(caplog.messages) == 2
    cycle.close()
    assert back.messages() == ["delete 205"]
    back.far.close()


def test_a_system_without_a_broadcast_manager_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(socket, "CAN_BCM", raising=False)
    with pytest.raises(NoBroadcastManager, match="this is another system"):
        BroadcastManager("can0")


@pytest.mark.skipif(sys.platform != "linux", reason="CAN_BCM is a part of Linux")
def test_a_kernel_without_can_bcm_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise OSError(errno.EPROTONOSUPPORT, "Protocol not supported")

    monkeypatch.setattr(socket, "socket", fails)
    with pytest.raises(NoBroadcastManager, match="modprobe can_bcm"):
        BroadcastManager("can0")


def test_only_cyclic_producers_import_the_broadcast_manager() -> None:
    home = Path(barewire.__file__).parent
    users = set()
    for file in home.rglob("*.py"):
        for node in rooms.loading_nodes(file):
            if isinstance(node, ast.ImportFrom) and (node.module or "").endswith("ports.can.bcm"):
                users.add(file.relative_to(home).as_posix())
    assert users == {"io/canopen/bus_methods.py"}
