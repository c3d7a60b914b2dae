"""CANopen over python-can's udp_multicast: a bus whose frames are UDP packets. The packets do not leave the machine."""

from __future__ import annotations

import socket

import pytest

from barewire import CanopenClient, CanopenServer
from barewire.errors import PortError
from barewire.io.ports.can.python_can import CanPort
from tests.io.canopen.memory_bus import device

pytest.importorskip("can")
pytest.importorskip("msgpack")

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


def test_transfers_beside_foreign_packets_in_the_group() -> None:
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
