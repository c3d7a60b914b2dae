"""The port of SocketCAN on one end of a socket pair, in place of a raw CAN socket: 16 bytes a frame, 72 of CAN FD."""

from __future__ import annotations

import errno
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from barewire import CanopenClient
from barewire.canopen.frame import CanFrame, ErrorFrame, FdFrame
from barewire.errors import EncodeError, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.interfaces import can_endpoint, can_port
from barewire.io.ports.can.socketcan import SocketCanPort

URL = "can://socketcan/can0?bitrate=500000"
SOL_SOCKET, RCVTIMEO, MEMINFO = socket.SOL_SOCKET, socket.SO_RCVTIMEO, 55


class Spy:
    """A socket that counts the calls of some methods, and fails where a test wants it."""

    def __init__(self, inner: socket.socket) -> None:
        self.inner = inner
        self.calls: list[tuple[Any, ...]] = []
        self.send_errors: list[int] = []
        self.receive_errors: list[int] = []
        self.dropped = 0

    def recv(self, *arguments: int) -> bytes:
        self.calls.append(("recv", *arguments))
        if self.receive_errors:
            raise OSError(self.receive_errors.pop(0), "failed")
        return self.inner.recv(*arguments)

    def recvmsg(self, *arguments: int) -> Any:
        """Mark frames that begin with the identifier 7FFh as those of this socket, as a raw CAN socket does."""
        data, extra, flags, address = self.inner.recvmsg(*arguments)
        return data, extra, flags | (0x804 if data[:2] == b"\xff\x07" else 4), address

    def send(self, data: bytes, flags: int = 0) -> int:
        if self.send_errors:
            raise OSError(self.send_errors.pop(0), "failed")
        return self.inner.send(data, flags)

    def setsockopt(self, level: int, option: int, value: Any) -> None:
        self.calls.append(("setsockopt", option))
        self.inner.setsockopt(level, option, value)

    def getsockopt(self, level: int, option: int, size: int = 0) -> int | bytes:
        if option != MEMINFO:
            return self.inner.getsockopt(level, option)
        assert (level, size) == (SOL_SOCKET, 36)
        return struct.pack("=9I", *bytes(8), self.dropped)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


@pytest.fixture
def pair() -> Iterator[tuple[Spy, socket.socket]]:
    ours, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, other:
        yield Spy(ours), other


def port_on(spy: Spy, *, stamps: bool = False) -> SocketCanPort:
    return SocketCanPort(Endpoint.parse(URL), stamps=stamps, opened=spy)  # type: ignore[arg-type]


def raw(identifier: int, data: bytes, length: int | None = None) -> bytes:
    return struct.pack("=IB3x8s", identifier, len(data) if length is None else length, data)


@pytest.mark.parametrize(
    ("frame", "sent"),
    [
        (CanFrame(0x605, bytes.fromhex("4000100000000000")), raw(0x605, bytes.fromhex("4000100000000000"))),
        (CanFrame(0x000, b"\x01\x05"), raw(0x000, b"\x01\x05")),
        (CanFrame(0x80), raw(0x80, b"")),
        (CanFrame(0x605, b"\x01", True), raw(0x8000_0605, b"\x01")),
        (CanFrame(0x1FFFFFFF, bytes(8), True), raw(0x9FFFFFFF, bytes(8))),
        (CanFrame(0x705, b"", False, True, 1), raw(0x4000_0705, b"", 1)),
        (CanFrame(0x705, b"", True, True, 8), raw(0xC000_0705, b"", 8)),
    ],
)
def test_a_frame_is_sixteen_bytes_both_ways(pair: tuple[Spy, socket.socket], frame: CanFrame, sent: bytes) -> None:
    port = port_on(pair[0])
    port.send(frame)
    assert pair[1].recv(100) == sent
    pair[1].send(sent)
    assert port.receive(1.0) == frame


def test_error_frames_and_fd_frames_are_kept_apart(pair: tuple[Spy, socket.socket]) -> None:
    port = port_on(pair[0])
    fd = struct.pack("=IBB2x64s", 0x585, 12, 1, b"twelve bytes")
    error = raw(0x2000_0040, bytes(8))
    for data in (error, fd, b"half", raw(0x100, b"\x01"), error, fd):
        pair[1].send(data)
    assert port.receive(1.0) is None  # the bytes that are no frame
    assert port.receive(1.0) == CanFrame(0x100, b"\x01")
    assert (port.others, port.garbled) == (2, 1)
    assert list(port.strange) == [ErrorFrame(0x40, bytes(8)), FdFrame(0x585, b"twelve bytes", False, 1)]
    assert [port.receive_any(1.0), port.receive_any(1.0)] == list(port.strange)


@pytest.mark.parametrize("text", ["bus off", "restarted"])
def test_reports_of_the_controller_have_their_words(pair: tuple[Spy, socket.socket], text: str) -> None:
    port = port_on(pair[0])
    pair[1].send(raw(0x2000_0040 if text == "bus off" else 0x2000_0100, bytes(8)))
    report = port.receive_any(1.0)
    assert isinstance(report, ErrorFrame)
    assert text in report.text


@pytest.mark.parametrize("timeout", [0.0, 0.001, 0.015, 0.05, 0.2])
def test_a_read_ends_at_its_time_out_and_not_before(pair: tuple[Spy, socket.socket], timeout: float) -> None:
    port = port_on(pair[0])
    for _ in range(3):
        begin = time.monotonic()
        assert port.receive(timeout) is None
        assert time.monotonic() - begin >= timeout


@pytest.mark.parametrize("timeout", [0.01, 5.0])
def test_a_frame_ends_the_wait(pair: tuple[Spy, socket.socket], timeout: float) -> None:
    port = port_on(pair[0])
    sender = threading.Timer(0.0 if timeout < 1 else 0.05, pair[1].send, [raw(0x100, b"")])
    sender.start()
    until = time.monotonic() + 5.0
    while (frame := port.receive(timeout)) is None and time.monotonic() < until:
        pass
    sender.join()
    assert frame == CanFrame(0x100)


def test_a_frame_that_is_there_takes_one_call_of_the_system(pair: tuple[Spy, socket.socket]) -> None:
    port = port_on(pair[0])
    for number in range(50):
        pair[1].send(raw(number, b""))
    assert port.receive(1.0) == CanFrame(0)
    pair[0].calls.clear()
    for number in range(1, 50):
        assert port.receive(1.0 - number / 200) == CanFrame(number)
    assert pair[0].calls == [("recv", 72)] * 49


@pytest.mark.parametrize("full", [errno.ENOBUFS, errno.EAGAIN])
def test_a_frame_for_which_there_is_no_room_is_sent_again(pair: tuple[Spy, socket.socket], full: int) -> None:
    port = port_on(pair[0])
    pair[0].send_errors[:] = [full]
    assert not port.try_send(CanFrame(0x100))
    pair[0].send_errors[:] = [full, full]
    port.send(CanFrame(0x101))
    assert pair[1].recv(100) == raw(0x101, b"")


def test_an_interface_that_is_down_is_reported_by_every_read(pair: tuple[Spy, socket.socket]) -> None:
    """The system reports it once, to the call that comes first."""
    port = port_on(pair[0])
    pair[0].send_errors[:] = [errno.ENETDOWN]
    down = "can://socketcan/can0: the interface is down: ip link set can0 up type can bitrate 500000"
    with pytest.raises(PortError, match=down):
        port.send(CanFrame(0x100))
    for _ in range(2):
        with pytest.raises(PortError, match=down):
            port.receive(60.0)


@pytest.mark.parametrize("number", [errno.ENODEV, errno.ENXIO])
def test_an_interface_that_was_removed_is_called_gone(pair: tuple[Spy, socket.socket], number: int) -> None:
    port = port_on(pair[0])
    pair[0].receive_errors[:] = [number]
    for _ in range(2):
        with pytest.raises(PortError, match="the interface is gone: was the adapter unplugged"):
            port.receive(60.0)


def test_a_frame_that_can_cannot_carry_is_refused(pair: tuple[Spy, socket.socket]) -> None:
    with pytest.raises(PortError, match="is no frame that CAN can carry"):
        port_on(pair[0]).send(CanFrame(-1))


def test_frames_that_the_system_dropped_are_counted(pair: tuple[Spy, socket.socket]) -> None:
    port = port_on(pair[0])
    for step, dropped in enumerate((0xFFFF_FFF0, 5), 1):  # a counter of 32 bits
        pair[0].dropped = dropped
        for _ in range(64):
            pair[1].send(raw(0x100, b""))
            assert port.receive(1.0) is not None
        assert port.lost == (0xFFFF_FFF0 if step == 1 else 0x1_0000_0005)


def test_the_time_of_the_system_is_given_on_request(pair: tuple[Spy, socket.socket]) -> None:
    port = port_on(pair[0], stamps=True)
    before = time.time()
    pair[1].send(raw(0x100, b""))
    after = time.time()
    time.sleep(0.05)
    assert port.receive(1.0) == CanFrame(0x100)
    assert port.received_at is not None
    assert before - 0.01 <= port.received_at <= after + 0.01
    assert port_on(pair[0]).received_at is None


@pytest.mark.parametrize(
    ("option", "text"),
    [
        ("filter=5", "filter='5': expected identifiers such as 585,705"),
        ("filter=585,", "filter='585,': expected identifiers"),
        ("filter=FFF", "filter='FFF': expected identifiers"),
        ("fd=maybe", "fd='maybe': expected 0 or 1"),
        ("receive_buffer=0", "receive_buffer 0: expected 1..1073741824"),
        ("receive_own_message=1", "did you mean 'receive_own_messages'"),
    ],
)
def test_a_wrong_option_is_named_before_anything_is_opened(option: str, text: str) -> None:
    with pytest.raises(EncodeError, match=text):
        can_endpoint(f"can://socketcan/can0?{option}")


def test_a_port_knows_whether_it_returns_what_it_sends(pair: tuple[Spy, socket.socket]) -> None:
    assert not port_on(pair[0]).own_frames
    own = Endpoint.parse("can://socketcan/can0?receive_own_messages=true")
    assert SocketCanPort(own, opened=pair[0].inner).own_frames


def test_frames_that_were_sent_here_are_marked_and_a_client_gets_them_once(pair: tuple[Spy, socket.socket]) -> None:
    url = Endpoint.parse("can://socketcan/can0?receive_own_messages=1")
    port = SocketCanPort(url, opened=pair[0])  # type: ignore[arg-type]
    own, foreign = raw(0x7FF, b"own"), raw(0x585, b"1")
    for data in (own, foreign, own, own, foreign, own):
        pair[1].send(data)
    assert (port.receive(1.0), port.is_own) == (CanFrame(0x7FF, b"own"), True)
    assert (port.receive(1.0), port.is_own) == (CanFrame(0x585, b"1"), False)
    assert (port.receive_others(1.0), port.is_own) == (CanFrame(0x585, b"1"), False)
    assert port.receive_others(0.01) is None
    assert not any(call[0] == "recv" for call in pair[0].calls)
    with CanopenClient(port, node=5) as client, client.frames() as stream:
        client.send(CanFrame(0x7FF, b"own"))
        pair[1].send(own)
        pair[1].send(foreign)
        assert [stream.get(30.0), stream.get(30.0)] == [CanFrame(0x7FF, b"own"), CanFrame(0x585, b"1")]
        assert client.channel().own_frames is False  # so another client on the channel is noticed


MAKE = "ip link add dev {0} type vcan && ip link set {0} up"
BRING_UP = "ip link set {0} up type can bitrate 500000"


@pytest.mark.parametrize(
    ("channel", "number", "advice"),
    [
        ("vcan0", errno.ENODEV, MAKE.format("vcan0")),
        (
            "can0",
            errno.ENODEV,
            f"plug the adapter in, then {BRING_UP.format('can0')}; a virtual one: {MAKE.format('can0')}",
        ),
        ("can0", errno.EAFNOSUPPORT, "the kernel has no SocketCAN: modprobe can_raw"),
    ],
)
def test_an_interface_that_does_not_exist_says_how_to_make_one(
    channel: str, number: int, advice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("barewire.io.ports.can.socketcan.raw_socket", fail)
    with pytest.raises(PortError) as raised:
        can_port(Endpoint.parse(f"can://socketcan/{channel}?bitrate=500000"))
    assert str(raised.value) == f"can://socketcan/{channel}: {os.strerror(number).lower()}; {advice}"


def test_socketcan_needs_no_python_can() -> None:
    program = """
import sys
sys.modules["can"] = None
from barewire import CanopenClient, PortError
try:
    CanopenClient("can://socketcan/no-such-bus")
except PortError as error:
    print("python-can" in str(error), error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.startswith("False can://socketcan/no-such-bus: "), done.stdout
