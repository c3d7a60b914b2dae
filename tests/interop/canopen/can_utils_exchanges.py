"""Exchanges with programs in other processes: can-utils on the kernel's CAN, and a device in a second process.

candump prints the frames of the bus and cansend sends one frame. Neither implements CANopen, so they check the frames
themselves.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from barewire.canopen import CanFrame, NmtCommand, NmtState, download, send_nmt
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.socketcan import SocketCanPort
from tests.helpers import BAREWIRE, PATIENCE
from tests.interop.canopen.can_bench import ADDRESS, NODE, Bench
from tests.interop.canopen.canopen_exchanges import exchange
from tests.interop.canopen.guest import ROOT

ONLY = ("socketcan",)
BETWEEN_PROCESSES = ("slcan", "socketcand", "socketcan")


class Candump:
    """A candump that runs during all exchanges. Each of them has the lines between two marks on the bus."""

    def __init__(self, written: Path) -> None:
        self._written = written
        self._port = SocketCanPort(Endpoint.parse("can://socketcan/vcan0"))
        self._marks = 0

    def mark(self) -> str:
        """Send a frame that no other one is like."""
        self._marks += 1
        frame = CanFrame(0x7FE, self._marks.to_bytes(2, "big"))
        self._port.send(frame)
        return str(frame)

    def lines_since(self, mark: str) -> list[str]:
        """Return what candump wrote behind a mark, one line a frame."""
        end = self.mark()  # sent after all other frames: once it is written, they are too
        _until(lambda: end in self._written.read_text(encoding="ascii"), 20)
        lines = self._written.read_text(encoding="ascii").splitlines()
        first, last = (next(place for place, line in enumerate(lines) if text in line) for text in (mark, end))
        return lines[first + 1 : last]

    def close(self) -> None:
        self._port.close()


@contextmanager
def candump(folder: Path) -> Iterator[Candump]:
    """Run candump during the block; it writes into the folder."""
    before = _listeners()
    path = folder / "candump.log"
    # A file, because a full pipe would block it; and a large receive buffer for the time that it is not scheduled.
    with (
        path.open("w") as written,
        subprocess.Popen(["candump", "-L", "-r", "4000000", "vcan0"], stdout=written) as process,
    ):
        try:
            _until(lambda: _listeners() > before)
            with closing(Candump(path)) as running:
                yield running
        finally:
            process.terminate()


def _listeners() -> int:
    """Return the number of sockets on vcan0 without a filter, as the kernel lists them."""
    return Path("/proc/net/can/rcvlist_all").read_text(encoding="utf-8").count("  vcan0  ")


def _until(true: Callable[[], bool], seconds: float = 5) -> None:
    until = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < until
        time.sleep(0.01)


def assert_same_frames(lines: list[str], seen: list[CanFrame]) -> None:
    """Assert that candump received the frames of our side: on each identifier the same ones in the same order.

    Remote frames and data frames of an identifier have different senders, so only the bus has an order of both: a frame
    may have been received, but not read yet, when our side sends one.

    (1764000000.000001) vcan0 605#4000100000000000 T
    """
    dumped = [CanFrame.parse(line.split()[2]) for line in lines]
    for key in {(frame.key, frame.remote) for frame in (*dumped, *seen)}:
        theirs, ours = ([str(frame) for frame in some if (frame.key, frame.remote) == key] for some in (dumped, seen))
        place = next((place for place, pair in enumerate(zip(theirs, ours)) if pair[0] != pair[1]), None)
        shown = "none" if place is None else f"{place}: {theirs[place : place + 3]}, {ours[place : place + 3]}"
        assert theirs == ours, f"candump received {len(theirs)}, our side {len(ours)}; the first difference is {shown}"


def cansend(text: str) -> None:
    subprocess.run(["cansend", "vcan0", text], check=True, timeout=10)


@contextmanager
def simulated(bench: Bench) -> Iterator[None]:
    """Simulate the AZ3 by the command, in a process of its own."""
    command = [BAREWIRE, "simulate", "az3", f"{bench.third}?node={NODE}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        try:
            assert process.stdout.readline().startswith(f"ready {bench.third}")
            yield
        finally:
            process.terminate()
        assert process.wait(10) == 0


def _answer(bench: Bench, question: str, answer: str) -> None:
    """Send `question` with cansend and wait for a frame of our device that begins with `answer`."""
    before = len(bench.seen)
    cansend(question)
    bench.wait(lambda: any(str(frame).startswith(answer) for frame in bench.seen[before:]))


@exchange("device", "SDO expedited upload", "SDO expedited download", "SDO abort", peer="cansend", only=ONLY)
def cansend_reads_and_writes(bench: Bench) -> None:
    device = bench.start_device().device
    _answer(bench, "605#4000100000000000", "585#4300100000000000")
    _answer(bench, "605#2F01200046000000", "585#60012000")
    assert device.objects.get(0x2001) == 0x46
    _answer(bench, "605#40.FF.0F.00.00.00.00.00", "585#80FF0F0000000206")


@exchange("device", "SDO segmented upload", "SDO segmented download", peer="cansend", only=ONLY)
def cansend_moves_segments(bench: Bench) -> None:
    device = bench.start_device().device
    _answer(bench, "605#2100210009000000", "585#60002100")
    _answer(bench, "605#0031323334353637", "585#20")
    _answer(bench, "605#1B38390000000000", "585#30")
    assert device.objects.get(0x2100) == b"123456789"
    _answer(bench, "605#4000210000000000", "585#4100210009000000")
    _answer(bench, "605#6000000000000000", "585#0031323334353637")
    _answer(bench, "605#7000000000000000", "585#1B3839")


@exchange("device", "NMT command", "SYNC", "TPDO", "RPDO", "EMCY", peer="cansend", only=ONLY)
def cansend_moves_process_data(bench: Bench) -> None:
    device = bench.start_device().device
    cansend("000#0105")
    bench.wait(lambda: device.state is NmtState.OPERATIONAL)
    cansend("205#0F00.A8610000")
    bench.wait(lambda: device.objects.get(0x60FF) == 25_000)
    _answer(bench, "080#", "185#3706A8610000")
    _answer(bench, "205#0F00", "085#1082")


@exchange("device", "node guarding", "boot-up", peer="cansend", only=ONLY)
def cansend_guards_and_resets(bench: Bench) -> None:
    bench.start_device()
    _answer(bench, "605#2B17100000000000", "585#60171000")
    for answer in ("705#7F", "705#FF", "705#7F"):
        _answer(bench, "705#R1", answer)
    _answer(bench, "000#8205", "705#00")


@exchange("device", "LSS switch", "LSS inquire", "LSS configure", "TIME", peer="cansend", only=ONLY)
def cansend_gives_a_node_id(bench: Bench) -> None:
    device = bench.start_device(None).device
    cansend("7E5#0401000000000000")
    _answer(bench, "7E5#5A00000000000000", f"7E4#5A{ADDRESS.vendor.to_bytes(4, 'little').hex().upper()}")
    _answer(bench, "7E5#1105000000000000", "7E4#1100")
    _answer(bench, "7E5#0400000000000000", "705#00")
    cansend("100#FF5B26059F3C")
    bench.wait(lambda: device.time.last is not None)


@exchange("device", "SDO expedited upload", "SDO expedited download", "NMT command", "boot-up", only=BETWEEN_PROCESSES)
def their_master_uses_a_device_in_another_process(bench: Bench) -> None:
    """The simulated drive is in its own process, both masters are in this one."""
    with simulated(bench):
        bench.listen(_Texts(), lambda text: text == f"{0x700 + NODE:03X}#00")
        node = bench.remote()
        assert node.sdo.upload(0x1000, 0) == bytes.fromhex("92010200")
        node.sdo.download(0x60FF, 0, (1500).to_bytes(4, "little"))
        node.sdo.download(0x1017, 0, (50).to_bytes(2, "little"))
        node.nmt.send_command(0x81)
        bench.listen(_Texts(), lambda text: text == f"{0x700 + NODE:03X}#00")
        assert node.sdo.upload(0x1017, 0) == (1000).to_bytes(2, "little")
        # Ours last: their client would take an answer to another client for the answer to its next request.
        bench.run(download(NODE, 0x1017, 0, (50).to_bytes(2, "little"), timeout=PATIENCE))
        assert [message.state for message in bench.run(send_nmt(NmtCommand.START, NODE))] == [NmtState.OPERATIONAL]


@exchange("device", only=ONLY, peer="none")
def our_conformance_battery_over_socketcan(bench: Bench) -> None:
    """Run `barewire conform`, with remote frames, in one process and the drive in another."""
    url = f"{bench.third}?node={NODE}&timeout=1"  # a busy machine takes longer than 0.1 s
    with simulated(bench):
        done = subprocess.run(
            [BAREWIRE, "conform", url, "--only", "SDO-3,SDO-04,NMT-2,TPD-40"],
            capture_output=True, text=True, timeout=60, cwd=ROOT, env={**os.environ, "NO_COLOR": "1"}, check=False,
        )  # fmt: skip
    *lines, last = done.stdout.splitlines()
    assert [line for line in lines if not line.startswith("ok ")] == [], done.stdout
    assert last == f"{len(lines)} of {len(lines)} passed"
    assert len(lines) > 10
    assert done.stderr == ""


class _Texts:
    """A machine that reports every frame as text."""

    def feed(self, frame: CanFrame, now: float) -> list[str]:
        return [str(frame)]
