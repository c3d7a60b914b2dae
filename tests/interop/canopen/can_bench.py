"""A CAN bus with two implementations: ours, and the `canopen` package of PyPI.

bench.network            the other library, connected
bench.port               our port, the only other one on the bus; `bench.run(conversation)` uses it
bench.start_device(...)  our device on that port, in a thread
bench.seen               every frame sent or received by our port; `services_in` derives the exchanged services from it
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from itertools import count
from typing import Any, NamedTuple, TypeVar

import canopen

from barewire.canopen import (
    CanFrame,
    Entry,
    LocalNode,
    LssAddress,
    LssSlave,
    ObjectDictionary,
    PdoConfig,
    standard_objects,
)
from barewire.conversation import Conversation
from barewire.io.endpoint import Endpoint
from barewire.io.engine.blocking import run
from barewire.io.ports.can.interfaces import can_port
from barewire.io.ports.can.memory import MemoryPort
from barewire.io.ports.can.python_can import CanPort
from barewire.io.ports.can.socketcan import SocketCanPort
from tests.helpers import PATIENCE
from tests.interop.canopen.can_hubs import hub

Result = TypeVar("Result")
NODE = 5
ADDRESS = LssAddress(0x0000_0100, 0x0001_0000, 0x0000_0002, 0x8000_0001)  # few ones: each is a time-out in a fastscan
TPDO_MAPPING = (0x60410010, 0x60FF0020)
RPDO_MAPPING = (0x60400010, 0x60FF0020)


class Place(NamedTuple):
    """How one side connects to a bus: our URL, and the arguments of python-can."""

    url: str
    options: dict[str, Any]


class RecordingPort:
    """Our port; it records every frame that it sends or receives."""

    def __init__(self, port: CanPort | MemoryPort | SocketCanPort) -> None:
        self.port = port
        self.seen: list[CanFrame] = []

    def send(self, frame: CanFrame) -> None:
        self.seen.append(frame)
        self.port.send(frame)

    def receive(self, timeout: float) -> CanFrame | None:
        frame = self.port.receive(timeout)
        if frame is not None:
            self.seen.append(frame)
        return frame

    def close(self) -> None:
        self.port.close()


class RunningDevice:
    """A device in a thread of its own; `do` runs a task in that thread and sends the frames it returns."""

    def __init__(self, port: RecordingPort, device: LocalNode) -> None:
        self.port = port
        self.device = device
        self._stopped = threading.Event()
        self._tasks: list[Callable[[float], list[CanFrame]]] = []
        for frame in device.start(time.monotonic()):
            port.send(frame)
        self._thread = threading.Thread(target=self._live)
        self._thread.start()

    def do(self, task: Callable[[float], list[CanFrame]]) -> None:
        self._tasks.append(task)

    def _live(self) -> None:
        while not self._stopped.is_set():
            wait = 0.01 if self.device.deadline is None else min(0.01, self.device.deadline - time.monotonic())
            frame = self.port.receive(max(0.0, wait))
            now = time.monotonic()
            frames = self.device.feed(frame, now)
            while self._tasks:
                frames += self._tasks.pop(0)(now)
            for answer in frames:
                self.port.send(answer)

    def stop(self) -> None:
        self._stopped.set()
        self._thread.join()


class Bench:
    """Both sides on one bus."""

    def __init__(self, ours: Place, theirs: Place, third: str) -> None:
        self.third = third
        self.port = RecordingPort(can_port(Endpoint.parse(ours.url)))
        self.network = canopen.Network()
        self.network.NOTIFIER_CYCLE = 0.05  # the longest wait of its thread, and so the time that closing takes
        self.network.connect(**theirs.options)
        self._running_devices: list[RunningDevice] = []

    def is_connected(self) -> bool:
        """Send until each side receives the other: an adapter on a serial line does not report that it is open."""
        received: list[int] = []
        self.network.subscribe(0x7FF, lambda identifier, data, timestamp: received.append(identifier))
        for _ in range(100):
            self.port.port.send(CanFrame(0x7FF))
            self.network.send_message(0x7FF, b"")
            back = self.port.port.receive(0.02)
            if received and back is not None:
                break
        else:
            return False
        self.network.unsubscribe(0x7FF)
        while self.port.port.receive(0.02) is not None:
            pass
        return True

    def close(self) -> None:
        for running in self._running_devices:
            running.stop()
        self._running_devices.clear()
        self.network.disconnect()
        self.port.close()

    def stop_devices(self) -> None:
        """Stop our devices and receive what is still on its way."""
        for running in self._running_devices:
            running.stop()
        self._running_devices.clear()
        while self.port.receive(0.02) is not None:
            pass

    @property
    def seen(self) -> list[CanFrame]:
        return self.port.seen

    def run(self, conversation: Conversation[CanFrame, Result]) -> Result:
        """Run a conversation of ours on the bus."""
        return run(conversation, self.port)

    def start_device(self, node: int | None = NODE) -> RunningDevice:
        """Start our device."""
        running = RunningDevice(self.port, device(node))
        self._running_devices.append(running)
        return running

    def remote(self, objects: Any = None) -> Any:
        """Return our device as a remote node of the other library."""
        node = canopen.RemoteNode(NODE, dictionary_of_theirs() if objects is None else objects)
        self.network.add_node(node)
        node.sdo.RESPONSE_TIMEOUT = PATIENCE
        return node

    def local(self) -> Any:
        """Return a device of the other library."""
        return self.network.create_node(NODE, dictionary_of_theirs())

    def listen(self, machine: Any, until: Callable[[Any], bool], seconds: float = PATIENCE) -> Any:
        """Feed a machine of ours until it reports an event for which `until` is true; return that event."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            frame = self.port.receive(left)
            for event in [] if frame is None else machine.feed(frame, time.monotonic()):
                if until(event):
                    return event
        raise AssertionError(f"no such event; seen: {', '.join(map(str, self.seen))}")

    def wait(self, true: Callable[[], object], seconds: float = PATIENCE) -> None:
        """Wait until `true` returns a true value."""
        end = time.monotonic() + seconds
        while not true():
            assert time.monotonic() < end, f"seen: {', '.join(map(str, self.seen))}"
            time.sleep(0.005)


def device(node: int | None) -> LocalNode:
    """Return our device: objects of all kinds, a PDO each way, guarding and LSS."""
    objects = [
        *standard_objects(ADDRESS, heartbeat=100),
        Entry(0x2000, 0, "three bytes", "u24", "rw", 0x332211),
        Entry(0x2001, 0, "percent", "u8", "rw", 50, maximum=100),
        Entry(0x2002, 0, "constant", "u32", "const", 7),
        Entry(0x2100, 0, "anything", "domain", "rw", b""),
        Entry(0x206A, 0, "vref", "f32", "rw", 1.5),
        Entry(0x6040, 0, "controlword", "u16", "rw", 0),
        Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637),
        Entry(0x60FF, 0, "target velocity", "i32", "rw", -25000),
    ]
    pdos = [PdoConfig("RPDO", 1, RPDO_MAPPING), PdoConfig("TPDO", 1, TPDO_MAPPING, type=1)]
    local = LocalNode(node, ObjectDictionary(objects), pdos, lss=LssSlave(ADDRESS, store=lambda number, rate: True))
    local.sdo.timeout = PATIENCE
    return local


def dictionary_of_theirs() -> Any:
    """Return the same objects, described with the other library."""
    od = canopen.objectdictionary
    objects = canopen.ObjectDictionary()
    for index, name, data_type, value in (
        (0x1017, "heartbeat time", od.UNSIGNED16, 0),
        (0x2000, "three bytes", od.UNSIGNED24, 0x332211),
        (0x2001, "percent", od.UNSIGNED8, 50),
        (0x206A, "vref", od.REAL32, 1.5),
        (0x6040, "controlword", od.UNSIGNED16, 0),
        (0x6041, "statusword", od.UNSIGNED16, 0x0637),
        (0x60FF, "target velocity", od.INTEGER32, -25000),
    ):
        variable = od.ODVariable(name, index, 0)
        variable.data_type, variable.access_type, variable.value = data_type, "rw", value
        objects.add_object(variable)
    domain = od.ODVariable("anything", 0x2100, 0)
    domain.data_type, domain.access_type = od.DOMAIN, "rw"
    objects.add_object(domain)
    for communication, mapping, cob_id, words in (
        (0x1400, 0x1600, 0x200 + NODE, RPDO_MAPPING),
        (0x1800, 0x1A00, 0x180 + NODE, TPDO_MAPPING),
    ):
        _record(objects, communication, {0: 6, 1: cob_id, 2: 1, 3: 0, 5: 0, 6: 0}, wide=(1,))
        entries = dict(enumerate((len(words), *words, *[0] * (8 - len(words)))))
        _record(objects, mapping, entries, wide=range(1, 9))
    return objects


def _record(objects: Any, index: int, values: dict[int, int], wide: Any) -> None:
    od = canopen.objectdictionary
    record = od.ODRecord(f"record {index:04X}", index)
    for sub, value in values.items():
        variable = od.ODVariable(f"record {index:04X} {sub}", index, sub)
        variable.data_type = od.UNSIGNED32 if sub in wide else od.UNSIGNED16 if sub in (3, 5) else od.UNSIGNED8
        variable.access_type, variable.value = "rw", value
        record.add_member(variable)
    objects.add_object(record)


def services_in(frames: list[CanFrame]) -> set[str]:
    """Return the exchanged services by their names in docs/reference/interop.md; a confirmed one counts if answered."""
    found: set[str] = set()
    asked = b""
    guarded = False
    for frame in frames:
        identifier, data = frame.id, frame.data
        if frame.remote:
            guarded = guarded or identifier == 0x700 + NODE
        elif identifier == 0x600 + NODE and data:
            asked = data if data[0] & 0xE0 in (0x20, 0x40) or data[0] & 0xE1 in (0xA0, 0xC0) else asked
            if asked is data and data[2] in (0x16, 0x1A):
                found.add("PDO mapping")
        elif identifier == 0x580 + NODE and data:
            found |= _answered(data, asked)
        elif identifier == 0x700 + NODE and data == b"\0":
            found.add("boot-up")
        elif identifier == 0x700 + NODE:
            found.add("node guarding" if guarded else "heartbeat")
        elif identifier in (0x7E4, 0x7E5):
            found |= _LSS.get(data[0], set())
        else:
            found |= _SIMPLE.get(identifier, set())
    return found


_SIMPLE = {
    0x000: {"NMT command"},
    0x080: {"SYNC"},
    0x100: {"TIME"},
    0x080 + NODE: {"EMCY"},
    0x180 + NODE: {"TPDO"},
    0x200 + NODE: {"RPDO"},
}
_LSS = {
    service: {name}
    for name, services in {
        "LSS switch": (0x04, 0x44),
        "LSS identify": (0x4F, 0x50),
        "LSS inquire": range(0x5A, 0x5F),
        "LSS configure": (0x11, 0x13, 0x17),
        "LSS fastscan": (0x51,),
    }.items()
    for service in services
}


def _answered(data: bytes, asked: bytes) -> set[str]:
    way = "expedited" if asked and asked[0] & 0x02 else "segmented"
    kind = data[0] >> 5
    if data[0] == 0x80:
        return {"SDO abort"}
    if kind == 2:
        return {f"SDO {'expedited' if data[0] & 2 else 'segmented'} upload"}
    if kind == 3:
        return {f"SDO {way} download"}
    return (
        {"SDO block download"} if data[0] & 0xE3 == 0xA0 else {"SDO block upload"} if data[0] & 0xE1 == 0xC0 else set()
    )


class Carriers:
    """Places on the buses of each carrier. Where a carrier has several buses, each call gives a new one."""

    def __init__(self, socketcand: str) -> None:
        self._socketcand = socketcand
        self._number = count(1)

    def places(self, carrier: str, terminals: list[str]) -> tuple[Place, Place, str]:
        """Return our place, the place of the other library, and the URL for a third participant in any process.

        `terminals` are three adapters on one bus, for slcan only.
        """
        number = next(self._number)
        third = ""
        if carrier == "virtual":
            ours = theirs = Place(f"can://virtual/bench{number}", {"interface": "virtual", "channel": f"bench{number}"})
        elif carrier == "socketcand":
            host, _, port = self._socketcand.partition(":")
            bus = f"can{number}"
            # tcp_tune: send each frame at once, not after 40 ms. Our side does so by default.
            options = {"interface": "socketcand", "host": host, "port": int(port), "channel": bus, "tcp_tune": True}
            ours = theirs = Place(f"can://socketcand/{self._socketcand}/{bus}", options)
        elif carrier == "slcan":
            one, other, another = terminals
            third = f"can://slcan{another}"
            ours = Place(f"can://slcan{one}", {})
            options = {"interface": "slcan", "channel": other, "sleep_after_open": 0.0, "bitrate": 125_000}
            theirs = Place("", options)
        else:
            ours = theirs = Place("can://socketcan/vcan0", {"interface": "socketcan", "channel": "vcan0"})
        return ours, theirs, third or ours.url


@contextmanager
def bench_on(carriers: Carriers, carrier: str) -> Iterator[Bench]:
    """Connect both sides to a bus, and disconnect them at the end.

    Each bench has new adapters for slcan: bytes that one leaves in a terminal would be read by the next. Adapters whose
    opening was lost on the way, which python-can does not notice, are replaced up to four times.
    """
    with ExitStack() as stack:
        for _ in range(5):
            terminals = stack.enter_context(hub("slcan", "3", lines=3)) if carrier == "slcan" else []
            bench = stack.enter_context(closing(Bench(*carriers.places(carrier, terminals))))
            if carrier != "slcan" or bench.is_connected():
                break
            stack.close()
        else:
            raise AssertionError("the two sides did not receive each other's frames in 5 attempts")
        yield bench
