"""A program for the guest kernel: its broadcast manager (CAN_BCM) sends SYNC, a heartbeat and set points on vcan0.

data       frames in turn, and new data at the end of the interval; candump receives them as well
stopped    a program that is stopped (SIGSTOP) still has them sent; one that is killed has not
down       the interface goes down and up, and is removed and made again: the kernel sends on
"""

from __future__ import annotations

import faulthandler
import signal
import subprocess
import sys
import time
from itertools import pairwise

from barewire import CanopenClient
from barewire.canopen import CanFrame, CyclicProducer, NmtState
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.interfaces import can_port
from barewire.io.ports.can.socketcan import SocketCanPort
from tests.interop.canopen.link_down import PATIENCE, link

URL = "can://socketcan/vcan0"
MASTER = f"""
from barewire import CanopenClient
with CanopenClient({URL!r}) as client, client.sync.start(0.005, overflow=3, by="kernel") as sync:
    print(sync.by_kernel, flush=True)
    input()
"""


def received(count: int, url: str = URL) -> list[str]:
    """Return the next frames on the bus, as another program receives them."""
    port = can_port(Endpoint.parse(url))
    try:
        found: list[str] = []
        for _ in range(count):
            frame = port.receive(PATIENCE)
            assert frame is not None, f"no frame came after {found}"
            found.append(str(frame))
        return found
    finally:
        port.close()


def wait_for(text: str, url: str = URL) -> None:
    """Wait until a frame comes."""
    end = time.monotonic() + PATIENCE
    while received(1, url) != [text]:
        assert time.monotonic() < end, f"{text} did not come"


def is_silent() -> bool:
    """Return whether no frame comes for a while."""
    port = can_port(Endpoint.parse(URL))
    try:
        return port.receive(0.2) is None
    finally:
        port.close()


def check_data() -> None:
    """Frames in turn, new data, another program, the end of the client."""
    setpoint = CyclicProducer(0.005, CanFrame(0x205, b"\1"), CanFrame(0x305, b"\2"))
    command = ["candump", "-n", "3", "-L", "vcan0,77F:7FF"]
    with CanopenClient(URL) as client:
        with client.start(setpoint, by="kernel") as running:
            assert running.by_kernel
            wait_for("305#02")
            found = received(40)
            assert found[0] != found[1]
            assert found == found[:2] * 20, found  # none twice, none left out
            running.do(lambda now: setpoint.update(CanFrame(0x205, b"\3"), CanFrame(0x305, b"\4")))
            wait_for("305#04")
            assert set(received(20)) == {"205#03", "305#04"}
        assert is_silent()
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as candump:
            heartbeat = client.nmt.start_heartbeat(127, 0.01, state=NmtState.OPERATIONAL, by="kernel")
            output, _ = candump.communicate(timeout=PATIENCE)
            assert output.count(" 77F#05") == 3, output
        with client.frames((0x77F, False)) as frames:  # the clients of this program receive them as well
            assert str(frames.get(PATIENCE)) == "77F#05"
        assert heartbeat.by_kernel
    assert is_silent()


def check_stopped() -> None:
    """The kernel sends while the program stands still, at equal intervals, and not after its end."""
    with subprocess.Popen([sys.executable, "-c", MASTER], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as master:
        assert master.stdout is not None
        assert master.stdout.readline() == b"True\n"
        master.send_signal(signal.SIGSTOP)
        port = SocketCanPort(Endpoint.parse(URL), stamps=True)
        times: list[float] = []
        counters: list[int] = []
        for _ in range(100):
            frame = port.receive(PATIENCE)
            assert frame is not None
            assert port.received_at is not None
            times.append(port.received_at)
            counters.append(frame.data[0])
        port.close()
        assert [later for earlier, later in pairwise(counters) if later != earlier % 3 + 1] == []
        intervals = sorted(later - earlier for earlier, later in pairwise(times))
        print(f"every 5 ms: median {intervals[49] * 1e3:.2f} ms, longest {intervals[-1] * 1e3:.2f} ms")
        assert 0.004 < intervals[49] < 0.02, intervals  # a busy computer delays the guest
        master.kill()
    assert is_silent()


def check_down() -> None:
    """The interface goes down and up, and is removed and made again."""
    with CanopenClient(URL) as client, client.sync.start(0.005, by="kernel"):
        wait_for("080#")
        link("down")
        link("up")
        wait_for("080#")
        subprocess.run(["ip", "link", "del", "vcan0"], check=True, timeout=PATIENCE)
        for words in (["add", "vcan0", "type", "vcan"], ["set", "vcan0", "up"]):
            subprocess.run(["ip", "link", *words], check=True, timeout=PATIENCE)
        wait_for("080#")
    assert is_silent()


def main() -> None:
    """Run all parts."""
    for part in (check_data, check_stopped, check_down):
        part()
        print(f"{part.__name__}: ok", flush=True)


if __name__ == "__main__":
    faulthandler.dump_traceback_later(200, exit=True)  # before the guest is killed: shows where it hangs
    main()
