"""The static types of the CANopen clients, nodes, and machines by name: checked by mypy --strict, not by pytest."""

from __future__ import annotations

from pathlib import Path
from typing import assert_type

from barewire import AsyncCanopenClient, AsyncCanopenServer, CanopenClient, CanopenServer, connect, connect_async
from barewire.canopen import CanFrame, Channel, EmcyConsumer, LssAddress, NodeState, PdoConfig, RemotePdo, upload
from barewire.canopen.emcy import EmcyEvent
from barewire.canopen.nmt.error_control import HeartbeatEvent
from barewire.canopen.pdo.remote import PdoReceived
from barewire.codecs import Value
from barewire.devices.drive import DriveStatus
from barewire.devices.parameter import Reading
from barewire.io.canopen.bus.async_bus import AsyncRunning, AsyncStream
from barewire.io.canopen.bus.node_runner import Running
from barewire.io.canopen.bus.subscriber import Stream
from barewire.io.canopen.node import AsyncDeviceNode, DeviceNode, EdsNode, Node, ObjectReading
from barewire.io.canopen.operations import AsyncBusRunner, BlockingBusRunner
from barewire.io.machine import AsyncMachineClient, MachineClient

FRAME = CanFrame(0x80)


def of_the_blocking_client(bus: CanopenClient, tpdo: RemotePdo) -> None:
    assert_type(bus.node(5), Node[BlockingBusRunner])
    assert_type(bus.node(5, device="az3"), DeviceNode)
    assert_type(bus.node(5, eds=Path("x.eds")), EdsNode[BlockingBusRunner])
    assert_type(bus.receive(), CanFrame | None)
    assert_type(bus.send(FRAME), None)
    assert_type(bus.lss.fastscan(), LssAddress | None)
    assert_type(bus.emergencies(), Stream[EmcyEvent])
    assert_type(bus.nmt.heartbeats({5: 1.0}), Stream[HeartbeatEvent])
    assert_type(bus.run(upload(5, 0x1000)), bytes)
    assert_type(bus.watch(EmcyConsumer()), Stream[EmcyEvent])
    assert_type(bus.sync.start(1.0), Running)
    node = bus.node(5)
    assert_type(node.sdo.upload(0x6041), bytes)
    assert_type(node.sdo.find_channel(2), Channel)
    assert_type(node.sdo.over(node.channel).upload(0x6041, 0, timeout=0.5), bytes)
    assert_type(node.nmt.start(), None)
    assert_type(node.nmt.state(), NodeState)
    assert_type(node.pdo.read_config("TPDO", 1), PdoConfig)
    assert_type(node.pdo.receive(tpdo), Stream[PdoReceived])
    assert_type(node.emergencies(), Stream[EmcyEvent])
    assert_type(bus.node(5, eds="x.eds").read((0x1018, 1)), Value)
    assert_type(bus.node(5, eds="x.eds").read_all(), list[ObjectReading])
    az3 = bus.node(5, device="az3")
    assert_type(az3.read("STATUS WORD"), Reading)
    assert_type(az3.read("STATUS WORD", "DC BUS"), list[Reading])
    assert_type(az3["STATUS WORD"], Reading)
    assert_type(az3.drive.enable(), DriveStatus)


async def of_the_asyncio_client(bus: AsyncCanopenClient, tpdo: RemotePdo) -> None:
    assert_type(bus.node(5), Node[AsyncBusRunner])
    assert_type(bus.node(5, device="az3"), AsyncDeviceNode)
    assert_type(bus.node(5, eds=Path("x.eds")), EdsNode[AsyncBusRunner])
    assert_type(await bus.receive(), CanFrame | None)
    assert_type(await bus.send(FRAME), None)
    assert_type(await bus.lss.fastscan(), LssAddress | None)
    assert_type(bus.emergencies(), AsyncStream[EmcyEvent])
    assert_type(bus.nmt.heartbeats({5: 1.0}), AsyncStream[HeartbeatEvent])
    assert_type(await bus.run(upload(5, 0x1000)), bytes)
    assert_type(bus.watch(EmcyConsumer()), AsyncStream[EmcyEvent])
    assert_type(bus.sync.start(1.0), AsyncRunning)
    node = bus.node(5)
    assert_type(await node.sdo.upload(0x6041), bytes)
    assert_type(await node.sdo.find_channel(2), Channel)
    assert_type(await node.nmt.start(), None)
    assert_type(await node.nmt.state(), NodeState)
    assert_type(await node.pdo.read_config("TPDO", 1), PdoConfig)
    assert_type(node.pdo.receive(tpdo), AsyncStream[PdoReceived])
    assert_type(await bus.node(5, eds="x.eds").read((0x1018, 1)), Value)
    az3 = bus.node(5, device="az3")
    assert_type(await az3.read("STATUS WORD"), Reading)
    assert_type(await az3.read("STATUS WORD", "DC BUS"), list[Reading])
    assert_type(await az3.drive.enable(), DriveStatus)


async def of_servers_and_machines() -> None:
    with CanopenServer("can://virtual/x?node=5", device="az3") as server:
        assert_type(server, CanopenServer)
    async with AsyncCanopenServer("can://virtual/x?node=5", eds="x.eds") as serving:
        assert_type(serving.url, str)
    with connect("az3", "can://virtual/x?node=5", timeout=0.5) as az3:
        assert_type(az3, MachineClient)
        assert_type(az3["STATUS WORD"], Reading)
        assert_type(az3.read("A", "B"), list[Reading])
        assert_type(az3.read_all(), list[Reading])
        assert_type(az3.drive.move(100, relative=True), DriveStatus)
    async with connect_async("az3", "tcp://127.0.0.1") as awaited:
        assert_type(awaited, AsyncMachineClient)
        assert_type(await awaited.read("A"), Reading)
        assert_type(await awaited.read_all(["A"]), list[Reading])
        assert_type(await awaited.drive.home(), DriveStatus)


def of_wrong_calls(bus: CanopenClient, az3: MachineClient) -> None:
    """Each of these lines is an error for mypy, which also reports an unneeded ignore."""
    bus.node(5).sdo.upload("6041")  # type: ignore[arg-type]
    bus.node(5).read("STATUS WORD")  # type: ignore[attr-defined]
    bus.node(5, device="az3", eds="x.eds")  # type: ignore[call-overload]
    az3.write("TARGET VELOCITY")  # type: ignore[call-overload]
    az3.drive.move()  # type: ignore[call-arg]
