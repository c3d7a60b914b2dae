"""Two implementations on one bus: ours and the `canopen` package of PyPI, over python-can's virtual bus.

Our client reads and writes its LocalNode; its client reads and writes our Device. Real threads and real time, but
no hardware and nothing outside this process.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any, TypeVar

import pytest

from barewire.canopen import (
    CanFrame,
    Channel,
    Device,
    Entry,
    NmtCommand,
    NmtMessage,
    NmtState,
    ObjectDictionary,
    Pdo,
    SdoAbort,
    download,
    upload,
)
from barewire.conversation import Conversation, Heard, Send

can = pytest.importorskip("can")
canopen = pytest.importorskip("canopen")

Result = TypeVar("Result")
NODE = 5


class Port:
    """One participant of a virtual bus: frames in, frames out."""

    def __init__(self, channel: str) -> None:
        self.bus = can.Bus(interface="virtual", channel=channel)

    def send(self, frame: CanFrame) -> None:
        self.bus.send(
            can.Message(
                arbitration_id=frame.id, data=frame.data, is_extended_id=frame.extended, is_remote_frame=frame.remote
            )
        )

    def receive(self, seconds: float) -> CanFrame | None:
        message = self.bus.recv(max(0.0, seconds))
        if message is None:
            return None
        return CanFrame(message.arbitration_id, bytes(message.data), message.is_extended_id, message.is_remote_frame)


def run(conversation: Conversation[CanFrame, Result], port: Port) -> Result:
    """A conversation in real time, with as little around it as possible."""
    try:
        step = next(conversation)
        while True:
            if isinstance(step, Send):
                port.send(step.item)
                frame = None
            else:
                frame = port.receive(step.until - time.monotonic())
            step = conversation.send(Heard(frame, time.monotonic()))
    except StopIteration as stop:
        result: Result = stop.value
        return result


def dictionary_of_theirs() -> Any:
    objects = canopen.ObjectDictionary()
    for index, name, data_type, value in (
        (0x1017, "heartbeat time", canopen.objectdictionary.UNSIGNED16, 1000),
        (0x2000, "three bytes", canopen.objectdictionary.UNSIGNED24, 0x332211),
        (0x2001, "percent", canopen.objectdictionary.UNSIGNED8, 50),
        (0x6071, "target torque", canopen.objectdictionary.INTEGER16, -5),
        (0x60FF, "target velocity", canopen.objectdictionary.INTEGER32, -25000),
        (0x206A, "vref", canopen.objectdictionary.REAL32, 1.5),
    ):
        variable = canopen.objectdictionary.ODVariable(name, index, 0)
        variable.data_type, variable.access_type, variable.value = data_type, "rw", value
        objects.add_object(variable)
    domain = canopen.objectdictionary.ODVariable("anything", 0x2100, 0)
    domain.data_type, domain.access_type = canopen.objectdictionary.DOMAIN, "rw"
    objects.add_object(domain)
    return objects


@pytest.fixture
def network(request: pytest.FixtureRequest) -> Iterator[Any]:
    """Their side of a bus of our own, closed at the end."""
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.05  # how long its thread waits at most, and so how long closing takes
    network.connect(interface="virtual", channel=request.node.name)
    yield network
    network.disconnect()


@pytest.fixture
def port(request: pytest.FixtureRequest) -> Iterator[Port]:
    """Our side of the same bus."""
    port = Port(request.node.name)
    yield port
    port.bus.shutdown()


def test_our_client_reads_and_writes_their_node(network: Any, port: Port) -> None:
    network.create_node(NODE, dictionary_of_theirs())
    channel = Channel(NODE)
    for index, value, other in (
        (0x2001, "32", "0B"),
        (0x1017, "E803", "D007"),
        (0x2000, "112233", "AABBCC"),
        (0x6071, "FBFF", "0500"),
        (0x60FF, "589EFFFF", "A8610000"),
        (0x206A, "0000C03F", "CDCC8C3F"),
    ):
        assert run(upload(channel, index), port) == bytes.fromhex(value)
        run(download(channel, index, 0, bytes.fromhex(other)), port)
        assert run(upload(channel, index), port) == bytes.fromhex(other)
    assert (channel.total.late, channel.total.garbled, channel.total.short) == (0, 0, 0)


def test_their_node_refuses_and_we_understand(network: Any, port: Port) -> None:
    network.create_node(NODE, dictionary_of_theirs())
    with pytest.raises(SdoAbort, match="0602 0000h object does not exist"):
        run(upload(NODE, 0x6041), port)
    with pytest.raises(SdoAbort, match="0607 0010h"):
        run(download(NODE, 0x2001, 0, b"\1\2"), port)


LENGTHS = (5, 7, 8, 14, 100, 889, 890, 4000)


def counting(length: int) -> bytes:
    return bytes(place % 256 for place in range(length))


def test_our_client_moves_long_values_to_and_from_their_node(network: Any, port: Port) -> None:
    """Their node has no blocks: it refuses them for a download and answers an upload with segments; we go along."""
    network.create_node(NODE, dictionary_of_theirs())
    channel = Channel(NODE)
    for length in LENGTHS:
        for block in (False, True):
            value = counting(length)[:: -1 if block else 1]
            run(download(channel, 0x2100, 0, value, block=block), port)
            assert run(upload(channel, 0x2100, block=block), port) == value
    assert (channel.total.late, channel.total.garbled, channel.total.short) == (0, 0, 0)


@pytest.fixture
def device(port: Port) -> Iterator[Device]:
    """Our device, living in a thread on its side of the bus."""
    objects = ObjectDictionary(
        [
            Entry(0x1017, 0, "heartbeat time", "u16", "rw", 0),
            Entry(0x2000, 0, "three bytes", "u24", "rw", 0x332211),
            Entry(0x2001, 0, "percent", "u8", "rw", 50, maximum=100),
            Entry(0x2002, 0, "constant", "u32", "const", 7),
            Entry(0x2100, 0, "anything", "domain", "rw", b""),
            Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637),
            Entry(0x60FF, 0, "target velocity", "i32", "rw", -25000),
            Entry(0x206A, 0, "vref", "f32", "rw", 1.5),
        ]
    )
    device = Device(NODE, objects, [Pdo("TPDO", 1, (0x60410010, 0x60FF0020), type=1)])
    stopped = threading.Event()

    def live() -> None:
        said = device.start(time.monotonic())
        while not stopped.is_set():
            for frame in said:
                port.send(frame)
            wait = 0.01 if device.deadline is None else min(0.01, device.deadline - time.monotonic())
            said = device.feed(port.receive(wait), time.monotonic())

    thread = threading.Thread(target=live)
    thread.start()
    yield device
    stopped.set()
    thread.join()


def remote(network: Any) -> Any:
    node = canopen.RemoteNode(NODE, dictionary_of_theirs())
    network.add_node(node)
    node.sdo.RESPONSE_TIMEOUT = 2.0
    return node


@pytest.mark.usefixtures("device")
def test_their_client_reads_and_writes_our_device(network: Any) -> None:
    node = remote(network)
    for index, value, other in (
        (0x2001, "32", "0B"),
        (0x1017, "0000", "D007"),
        (0x2000, "112233", "AABBCC"),
        (0x60FF, "589EFFFF", "A8610000"),
        (0x206A, "0000C03F", "CDCC8C3F"),
    ):
        assert node.sdo.upload(index, 0) == bytes.fromhex(value)
        node.sdo.download(index, 0, bytes.fromhex(other))
        assert node.sdo.upload(index, 0) == bytes.fromhex(other)


@pytest.mark.parametrize("block", [False, True])
def test_their_client_moves_long_values_to_and_from_our_device(network: Any, device: Device, block: bool) -> None:
    node = remote(network)
    for length in LENGTHS:
        value = counting(length)
        with node.sdo.open(0x2100, 0, "wb", size=length, block_transfer=block, buffering=7) as stream:
            stream.write(value)
        assert device.objects.read(0x2100, 0) == value
        with node.sdo.open(0x2100, 0, "rb", block_transfer=block) as stream:
            assert stream.read() == value
    assert device.sdo.counters.aborts_said == 0


@pytest.mark.usefixtures("device")
def test_our_device_refuses_and_they_understand(network: Any) -> None:
    node = remote(network)
    for index, data, code in (
        (0x3000, None, 0x06020000),
        (0x2001, b"\x65", 0x06090031),
        (0x2001, b"\1\2", 0x06070012),
        (0x2002, b"\1\2\3\4", 0x06010002),
    ):
        with pytest.raises(canopen.SdoAbortedError) as caught:
            node.sdo.upload(index, 0) if data is None else node.sdo.download(index, 0, data)
        assert caught.value.code == code


def test_they_command_our_device_and_sync_it(network: Any, device: Device) -> None:
    node = remote(network)
    node.nmt.state = "OPERATIONAL"
    heard = threading.Event()
    data: list[bytes] = []

    def tpdo(identifier: int, frame: bytearray, timestamp: float) -> None:
        data.append(bytes(frame))
        heard.set()

    network.subscribe(0x180 + NODE, tpdo)
    assert node.sdo.upload(0x6041, 0) == bytes.fromhex("3706")  # the command came first on the same bus
    assert device.state is NmtState.OPERATIONAL
    network.sync.transmit()
    assert heard.wait(2.0)
    assert data == [bytes.fromhex("3706 589EFFFF")]


def test_our_command_moves_their_node(network: Any, port: Port) -> None:
    node = network.create_node(NODE, dictionary_of_theirs())
    port.send(NmtMessage(NmtCommand.START, NODE).encode())
    assert run(upload(NODE, 0x2001), port) == b"\x32"
    assert node.nmt.state == "OPERATIONAL"
