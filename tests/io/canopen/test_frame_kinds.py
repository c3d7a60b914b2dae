"""Error frames and CAN FD frames: kept apart from classical frames, and counted."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, ErrorFrame, FdFrame
from barewire.io.endpoint import Endpoint

can = pytest.importorskip("can")


def test_error_and_fd_frames_have_their_own_types() -> None:
    from barewire.io.ports.can.python_can import CanPort

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


@pytest.mark.parametrize(
    ("options", "own_frames"),
    [("", False), ("?receive_own_messages=true", True), ("?receive_own_messages=false", False)],
)
def test_a_port_knows_whether_it_returns_what_it_sends(options: str, own_frames: bool) -> None:
    from barewire.io.ports.can.python_can import CanPort

    port = CanPort(Endpoint.parse(f"can://virtual/own-frames{options}"))
    try:
        port.send(CanFrame(0x100, b"\1"))
        assert port.own_frames is own_frames
        assert (port.receive(0.0) is not None) is own_frames
    finally:
        port.close()
