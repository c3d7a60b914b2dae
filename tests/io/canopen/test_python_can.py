"""CAN through python-can: the kinds of frames; a bus whose frames are UDP packets, which do not leave the machine."""

from __future__ import annotations

import socket

import pytest

from barewire import CanopenClient, CanopenServer
from barewire.canopen import CanFrame, ErrorFrame, FdFrame
from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.python_can import CanPort
from tests.io.canopen.memory_bus import device

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


# udp_multicast --------------------------------------------------------------------------------------------------------

GROUP = "239.74.163.2"


def way_to_the_group() -> tuple[int, bool]:
    """A free port of the group. The test is skipped if this machine has no route to a group."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        probe.bind(("", 0))
        number: int = probe.getsockname()[1]
        try:
            probe.sendto(b"", (GROUP, number))
        except OSError:
            return number, False
    return number, True


def test_transfers_over_udp_multicast_beside_foreign_packets_in_the_group() -> None:
    pytest.importorskip("msgpack")
    place, there_is_a_way = way_to_the_group()
    url = f"can://udp_multicast/{GROUP}?port={place}&hop_limit=0&node=5&timeout=30"
    if not there_is_a_way:
        with pytest.raises(PortError, match=rf"can://udp_multicast/{GROUP}: could not .*: no such device"):
            CanopenClient(url)
        return
    value = bytes(number % 251 for number in range(700))
    with CanopenServer(url, device=device()), CanopenClient(url) as client:
        assert client.node().sdo.upload(0x6041) == b"\x37\x06"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as foreign:
            foreign.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            for noise in (b"nonsense", b"\x81\xa1a", b"\xc1", b"\x81\xa1a\x01\x02"):
                foreign.sendto(noise, (GROUP, place))
        for block in (False, True):
            client.node().sdo.download(0x2100, 0, value, block=block)
            assert client.node().sdo.upload(0x2100, block=block) == value
        port = client.bus.port
        assert isinstance(port, CanPort)
        assert (port.garbled, client.bus.failure) == (4, None)
