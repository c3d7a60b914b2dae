"""A program for the guest kernel: vcan0 goes down and up while a client and a device use it, and both recover.

down     a transfer in progress raises PortError, the stream reports BusDown; no frame of the device is received
up       the stream reports BusUp, a transfer of the same client succeeds, the heartbeats of the device come again
"""

from __future__ import annotations

import faulthandler
import subprocess
import threading
import time

from barewire import CanopenClient, CanopenServer
from barewire.canopen import CanFrame, Entry, LocalNode, ObjectDictionary, standard_objects
from barewire.errors import NoAnswer, PortError
from barewire.io import BusDown, BusUp, FramesLost
from barewire.io.canopen.bus.subscriber import Stream
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.interfaces import can_port
from barewire.io.ports.can.socketcan import SocketCanPort

URL = "can://socketcan/vcan0?node=5&timeout=3"
PATIENCE = 30.0  # as tests.helpers, which needs packages that the guest does not have
LONG = bytes(range(256)) * 4096


def link(state: str) -> None:
    """Set vcan0 up or down."""
    subprocess.run(["ip", "link", "set", "vcan0", state], check=True, timeout=PATIENCE)


def until(stream: Stream[CanFrame], kind: type[object]) -> object:
    """Return the next event of a class; skip the events before it."""
    end = time.monotonic() + PATIENCE
    while True:
        event = stream.get(timeout=max(0.0, end - time.monotonic()))
        assert event is not None, f"no {kind.__name__} came"
        if isinstance(event, kind):
            return event
        assert isinstance(event, (CanFrame, FramesLost)), event


def failing(client: CanopenClient, begun: threading.Event, failed: list[Exception]) -> None:
    """Transfers, one after the other, until one of them fails."""
    try:
        while True:
            client.node().sdo.download(0x2100, 0, LONG, progress=lambda done, size: begun.set())
    except (PortError, NoAnswer) as error:
        failed.append(error)


def check_socket() -> None:
    """The socket of SocketCAN: filters, own frames, frames that the system drops, an interface that is down."""
    url = "can://socketcan/vcan0"
    few = can_port(Endpoint.parse(f"{url}?filter=585,00000705&receive_own_messages=1"))
    small = can_port(Endpoint.parse(f"{url}?receive_buffer=1"))
    other = can_port(Endpoint.parse(url))
    frames = [CanFrame(number, b"1", extended) for number in (0x585, 0x705) for extended in (False, True)]
    for frame in frames:
        other.send(frame)
    few.send(CanFrame(0x585, b"own"))
    own = CanFrame(0x585, b"own")
    marked = [(few.receive(1.0), getattr(few, "is_own", None)) for _ in range(3)]
    assert marked == [(frames[0], False), (frames[3], False), (own, True)]
    few.send(own)
    other.send(frames[0])
    assert isinstance(few, SocketCanPort)
    assert (few.receive_others(1.0), few.receive_others(0.05), few.receive(0.0)) == (frames[0], None, None)
    for _ in range(500):
        other.send(CanFrame(0x100, bytes(8)))
    received = 0
    while small.receive(0.05) is not None:
        received += 1
    lost = getattr(small, "lost", 0)
    assert received < 507 == received + lost, (received, lost)
    for port in (few, small, other):
        port.close()


def main() -> None:
    """Take the link down and up, twice."""
    check_socket()
    objects = ObjectDictionary([*standard_objects(heartbeat=50), Entry(0x2100, 0, "long", "domain", default=b"")])
    node = LocalNode(5, objects)
    node.sdo.timeout = PATIENCE  # a guest may stand still for the usual second
    with CanopenServer("can://socketcan/vcan0", device=node), CanopenClient(URL) as client:
        for _ in range(2):
            with client.frames((0x705, False)) as stream:
                until(stream, CanFrame)
                begun, failed = threading.Event(), list[Exception]()
                thread = threading.Thread(target=failing, args=(client, begun, failed))
                thread.start()
                assert begun.wait(PATIENCE)
                link("down")
                gone = until(stream, BusDown)
                thread.join(PATIENCE)
                assert [type(error) for error in failed] == [PortError], failed
                link("up")
                until(stream, BusUp)
                until(stream, CanFrame)  # a heartbeat: the device has reopened its bus as well
            client.node().sdo.download(0x2100, 0, b"after it")
            assert client.node().sdo.upload(0x2100) == b"after it"
            print("gone and back:", getattr(gone, "why", gone))


if __name__ == "__main__":
    faulthandler.dump_traceback_later(200, exit=True)  # before the guest is killed: shows where it hangs
    main()
