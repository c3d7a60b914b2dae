"""Error frames and CAN FD frames: kept apart from classical frames, and counted."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable
from typing import Any

import pytest

from barewire.canopen import CanFrame, ErrorFrame, FdFrame
from barewire.errors import PortError
from barewire.io.endpoint import Endpoint

can = pytest.importorskip("can")


def test_error_and_fd_frames_have_their_own_types() -> None:
    from barewire.io.ports.python_can import CanPort

    port = CanPort(Endpoint.parse("can://virtual/kinds"))
    other = can.Bus(interface="virtual", channel="kinds")
    for message in (
        can.Message(arbitration_id=0x60, is_error_frame=True, is_extended_id=False, data=bytes(8)),
        can.Message(arbitration_id=0x585, is_fd=True, is_extended_id=False, data=bytes(12), bitrate_switch=True),
        can.Message(arbitration_id=0x585, is_extended_id=True, data=b"\1"),
    ):
        other.send(message)
    assert port.receive(1.0) == CanFrame(0x585, b"\1", extended=True)
    assert list(port.strange) == [ErrorFrame(0x60, bytes(8)), FdFrame(0x585, bytes(12), False, 1)]
    assert port.others == 2
    port.close()
    other.shutdown()


def test_send_and_receive_both_report_an_interface_that_went_down(monkeypatch: pytest.MonkeyPatch) -> None:
    """The system reports it once, to the first call: here to `send`."""
    from barewire.io.ports.python_can import CanPort

    port = CanPort(Endpoint.parse("can://virtual/went-down"))
    try:
        assert port.receive(0.0) is None

        def down(message: Any) -> None:
            raise can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)

        monkeypatch.setattr(port._bus, "send", down)
        ways: list[Callable[[], Any]] = [
            lambda: port.send(CanFrame(0x100)),
            lambda: port.receive(0.0),
            lambda: port.receive_any(0.0),
        ]
        for what in ways:
            with pytest.raises(PortError, match="the interface is down"):
                what()
    finally:
        port.close()


def test_receive_does_not_block_when_send_takes_the_report_between_select_and_recv(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The report makes the socket readable; the thread that sends can take it before the reader reads the socket."""
    from barewire.io.ports.python_can import CanPort

    ours, other = socket.socketpair()

    class SocketCan:
        """A bus of python-can's `socketcan`: `recv` reads the socket after `select` found it readable."""

        socket = ours

        def recv(self, timeout: float) -> Any:
            with pytest.raises(PortError, match="the interface is down: ip link set can0 up"):
                port.send(CanFrame(0x100))
            try:
                return ours.recv(16)
            except OSError as error:
                raise can.CanOperationError(f"Error receiving: {error.strerror}", error.errno) from error

        def send(self, message: Any) -> None:
            raise can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)

        def shutdown(self) -> None:
            ours.close()

    monkeypatch.setattr(can, "Bus", lambda **options: SocketCan())
    port = CanPort(Endpoint.parse("can://socketcan/can0"))
    try:
        with pytest.raises(PortError, match="the interface is down: ip link set can0 up"):
            port.receive(1.0)
    finally:
        port.close()
        other.close()


@pytest.mark.parametrize(
    ("options", "own_frames"),
    [("", False), ("?receive_own_messages=true", True), ("?receive_own_messages=false", False)],
)
def test_a_port_knows_whether_it_returns_what_it_sends(options: str, own_frames: bool) -> None:
    from barewire.io.ports.python_can import CanPort

    port = CanPort(Endpoint.parse(f"can://virtual/own-frames{options}"))
    try:
        port.send(CanFrame(0x100, b"\1"))
        assert port.own_frames is own_frames
        assert (port.receive(0.0) is not None) is own_frames
    finally:
        port.close()
