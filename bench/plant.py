"""A plant of 127 CANopen nodes on one machine, and its load: `make plant`, or `python -m bench.plant --help`.

    this process           manager: boots each node with its DCF, watches the heartbeats, sends SYNC,
        |                  an RPDO to each node, and receives all TPDOs
    16 bytes a frame, through a pair of sockets or with --bus a CAN bus (can://socketcan/vcan0)
        |
    a second process       the nodes: one `NodeGroup`, one server, one thread

Each node has the objects of the EDS of an AZ3, without its motor. Its DCF gives it a heartbeat of 500 ms, a synchronous
RPDO (control word) and a TPDO with its status word at each n-th SYNC (--type). With 127 nodes, 100 Hz and type 1 these
are about as many frames as a bus of 1 Mbit/s carries; the result says how many bits they have.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import Any

from barewire import CanopenClient
from barewire.canopen import (
    BootEvent,
    CanFrame,
    LocalNode,
    NetworkList,
    NodeGroup,
    device_configuration,
    eds,
    pdos_of,
    slave_of,
)
from barewire.canopen.cob_ids import SYNC_KEY
from barewire.devices import load
from barewire.io.canopen.bus.node_runner import Running
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import FramesLost
from barewire.io.endpoint import Endpoint
from barewire.io.ports.base import Port
from barewire.io.ports.can.interfaces import can_port
from barewire.io.ports.can.socketcan import SocketCanPort
from barewire_workbench.eds.export import export

HEARTBEAT = 500
"""Milliseconds between two heartbeats of a node."""
BIT_RATE = 1_000_000
OVERHEAD = 47
"""Bits of a frame with an 11-bit identifier around its data, without stuff bits."""


def port_at(place: str) -> Port[CanFrame]:
    """Return the port of an endpoint, or of an inherited socket by its number."""
    if place.isdigit():
        return SocketCanPort(Endpoint.parse("can://socketcan/pair"), opened=socket.socket(fileno=int(place)))
    return can_port(Endpoint.parse(place))


class SyncTimes:
    """A participant of the plant that records when SYNC arrived there."""

    deadline = None
    receives = frozenset({SYNC_KEY})

    def __init__(self) -> None:
        self.times: list[float] = []

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        if frame is not None:
            self.times.append(now)
        return []


def serve(place: str, count: int) -> None:
    """Run the nodes, and write the processor time and counters at each line of the standard input."""
    described = export(load("az3"), "az3.eds")
    syncs, nodes = SyncTimes(), list[Any]()
    for number in range(1, count + 1):
        objects = described.dictionary(number)
        nodes.append(LocalNode(number, objects, pdos_of(objects, number)))
    with CanBus(port_at(place)) as bus, Running(bus, NodeGroup([syncs, *nodes]), None) as running:
        print("ready", flush=True)
        for _ in sys.stdin:
            states = Counter(int(node.state) for node in nodes)
            counted = {"cpu": time.process_time(), "sent": running.statistics.sent, "states": states}
            counted |= {"controls": sorted({int(node.objects.get(0x6040)) for node in nodes})}
            counted |= {"lost": running.statistics.lost, "errors": running.statistics.errors, "syncs": syncs.times}
            print(json.dumps(counted), flush=True)
            syncs.times = []


def planned(count: int, type: int) -> NetworkList:
    """Return what the manager knows of its nodes: one DCF, whose COB-IDs depend on the node-ID."""
    values: dict[Any, Any] = {(0x1017, 0): HEARTBEAT, (0x1400, 2): 1, (0x1600, 0): 1, (0x1600, 1): 0x6040_0010}
    values |= {(0x1800, 2): type, (0x1A00, 0): 1, (0x1A00, 1): 0x6041_0010}
    for place in (1, 2, 3):  # the PDOs 2 to 4 are off
        values[0x1400 + place, 1] = eds.Formula(0x8000_0200 + 0x100 * place)
        values[0x1800 + place, 1] = eds.Formula(0x8000_0180 + 0x100 * place)
    dcf = eds.to_dcf(export(load("az3"), "az3.eds"), 1, values)
    configurations = [device_configuration(dcf, number) for number in range(1, count + 1)]
    slaves = [slave_of(one, mandatory=True, heartbeat=3 * HEARTBEAT / 1000) for one in configurations]
    return NetworkList(slaves, start_all=True, boot_time=120)


@dataclass
class Cycles:
    """The TPDOs of each SYNC, and how long after it the last one arrived. A machine that listens."""

    expected: int
    deadline = None
    at: float = 0.0
    arrived: int = 0
    pdos: int = 0
    last: float = 0.0
    taken: list[float] = field(default_factory=list)
    incomplete: int = 0

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        if frame is None:
            return []
        if frame.key != SYNC_KEY:
            self.arrived += 1
            self.pdos += 1
            self.last = now
            return []
        if self.at and self.arrived:
            self.taken.append(self.last - self.at)
            self.incomplete += self.arrived % self.expected != 0
        self.at, self.arrived = now, 0
        return []


class Plant:
    """The process of the nodes."""

    def __init__(self, place: str, count: int, inherited: Sequence[int]) -> None:
        command = [sys.executable, "-m", "bench.plant", "--serve", place, "--nodes", str(count)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, pass_fds=inherited
        )
        assert self._line() == "ready"

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def counted(self) -> dict[str, Any]:
        """Return the processor time and the counters of the nodes."""
        assert self.process.stdin is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        found: dict[str, Any] = json.loads(self._line())
        return found

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.communicate()


@dataclass
class Load:
    """The work of a phase: its seconds, and the processor time of both processes."""

    wall: float
    manager: float
    nodes: float

    def __str__(self) -> str:
        manager, nodes = self.manager / self.wall, self.nodes / self.wall
        return f"manager {manager:.0%}, nodes {nodes:.0%} of one core"


class Meter:
    """Measures phases."""

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.begin()

    def begin(self) -> None:
        """Begin a phase."""
        self.counted = self.plant.counted()
        self._at, self._cpu = time.monotonic(), time.process_time()

    def end(self) -> tuple[Load, dict[str, Any]]:
        """Return the load of the phase, and what the nodes counted during it."""
        cpu, at, counted = time.process_time(), time.monotonic(), self.plant.counted()
        counted["sent"] -= self.counted["sent"]
        return Load(at - self._at, cpu - self._cpu, counted["cpu"] - self.counted["cpu"]), counted


def measure(plant: Plant, place: str, options: argparse.Namespace) -> int:
    """Boot the plant, run it, and print its load. Return the exit status."""
    network, ready = planned(options.nodes, options.type), threading.Event()
    kinds: Counter[str] = Counter()

    def on_event(event: BootEvent) -> None:
        kinds[event.kind] += 1
        if event.kind in ("failed", "missing", "lost"):
            print(event)
        if event.kind == "started":
            ready.set()

    meter = Meter(plant)
    with CanopenClient(port_at(place)) as bus, bus.nmt.start_manager(network, on_event):
        if not ready.wait(150):
            print(f"the network is not ready: {dict(kinds)}")
            return 1
        booting, counted = meter.end()
        print(f"{options.nodes} nodes booted and configured from their DCFs in {booting.wall:.1f} s: {booting}")
        cycles = Cycles(options.nodes)
        keys = frozenset({SYNC_KEY, *((0x180 + number, False) for number in range(1, options.nodes + 1))})
        with bus.watch(cycles, keys) as stream:
            dropped: list[Any] = []  # reports of the stream: frames that it had no room for
            taker = threading.Thread(target=lambda: dropped.extend(stream))
            taker.start()
            meter.begin()
            with bus.sync.start(1 / options.rate):
                end = time.monotonic() + options.seconds
                number, commanded = 0, 0
                while time.monotonic() < end:  # a control word to each node, one after the other
                    number = number % options.nodes + 1
                    bus.send(CanFrame(0x200 + number, b"\x0f\0"))
                    commanded += 1
                    time.sleep(1 / options.rate)
            running, counted = meter.end()
            time.sleep(0.3)  # for the last TPDOs
            after = plant.counted()
            counted |= {"syncs": counted["syncs"] + after["syncs"], "states": after["states"], "lost": after["lost"]}
        taker.join()
    counted["lost"] += sum(one.frames for one in dropped if isinstance(one, FramesLost))
    return report(options, cycles, running, counted, commanded, kinds)


def report(
    options: argparse.Namespace,
    cycles: Cycles,
    running: Load,
    counted: dict[str, Any],
    commanded: int,
    kinds: Counter[str],
) -> int:
    """Print the load of the run. Return 1 if a node or a frame is missing."""
    syncs = counted["syncs"]
    frames = counted["sent"] + len(syncs) + commanded
    bits = OVERHEAD * frames + 16 * (cycles.pdos + commanded) + 8 * (counted["sent"] - cycles.pdos)
    off = sorted(abs(after - before - 1 / options.rate) * 1000 for before, after in pairwise(syncs))
    print(f"SYNC at {options.rate:g} Hz for {running.wall:.1f} s, {len(syncs)} in all: {running}")
    print(f"  {frames / running.wall:,.0f} frames/s, {bits / running.wall / BIT_RATE:.0%} of a bus of 1 Mbit/s")
    print(
        f"  interval of SYNC at the nodes: {1000 / options.rate:g} ms, off by {median(off):.2f} ms in the median, "
        f"{off[int(len(off) * 0.99)]:.2f} ms in 99 %, {off[-1]:.2f} ms at most"
    )
    taken = sorted(one * 1000 for one in cycles.taken)
    late = (
        f"{median(taken):.1f} ms (median), {taken[int(len(taken) * 0.99)]:.1f} ms in 99 %, {taken[-1]:.1f} ms at most"
    )
    print(f"  last TPDO after SYNC: {late}")
    expected = (len(syncs) // options.type) * options.nodes
    is_whole = cycles.pdos == expected and not kinds["lost"] and not counted["lost"]
    is_whole = is_whole and counted["states"] == {"5": options.nodes} and not counted["errors"]
    print(f"  {cycles.pdos} of {expected} TPDOs received, {kinds['lost']} nodes lost, {counted['lost']} frames lost")
    print(f"({platform.python_implementation()} {platform.python_version()}, {os.cpu_count()} cores)")
    return 0 if is_whole else 1


def main() -> int:
    """Carry out the command."""
    parser = argparse.ArgumentParser(description="Boot a plant of CANopen nodes, run it, and print its load.")
    parser.add_argument("--nodes", type=int, default=127, choices=range(1, 128), metavar="1..127")
    parser.add_argument("--rate", type=float, default=100.0, metavar="HZ", help="SYNCs a second")
    parser.add_argument("--seconds", type=float, default=10.0, help="how long the plant runs")
    parser.add_argument("--type", type=int, default=1, help="the TPDOs are sent at every n-th SYNC")
    parser.add_argument("--bus", metavar="ENDPOINT", help="a CAN bus; by default a pair of sockets")
    parser.add_argument("--serve", metavar="PLACE", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve(options.serve, options.nodes)
        return 0
    if options.bus:
        here, there, inherited = options.bus, options.bus, []
    else:
        one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for end in (one, other):
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 21)
        here, there, inherited = str(one.detach()), str(other.fileno()), [other.fileno()]
    plant = Plant(there, options.nodes, inherited)
    try:
        return measure(plant, here, options)
    finally:
        plant.close()


if __name__ == "__main__":
    sys.exit(main())
