"""What a Python prompt and a notebook show: one short line for every object a user meets, a table where one helps."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from enum import Enum
from importlib import import_module
from typing import Any

import pytest

import barewire
from barewire.ascii import AsciiLine
from barewire.canopen import (
    CanFrame,
    Channel,
    Entry,
    LocalNode,
    ObjectDictionary,
    ScanResult,
    SdoServer,
    eds,
)
from barewire.codecs import Layout
from barewire.devices import CanopenAccess, Drive, ModbusAccess, Reading, load, names
from barewire.devices.drive import DriveStatus
from barewire.devices.sim import MachineUnits, simulator
from barewire.io import CanBus
from barewire.io.canopen.node import ObjectReading, ObjectReadings
from barewire.modbus import Authorization, Bus, DeviceIdentification, Identity, ReadHoldingRegisters, Server
from barewire.rtu import RtuLine, Timing
from barewire.tcp import DatagramLine, FanOut, TcpLine
from barewire_workbench import explain
from barewire_workbench.ascii_gateway.session import GatewaySession
from barewire_workbench.eds.export import export
from barewire_workbench.sniffer import Sniffer
from tests.helpers import every_case

ROOMS = [
    *("barewire", "barewire.modbus", "barewire.canopen", "barewire.canopen.sdo", "barewire.canopen.eds"),
    *("barewire.devices", "barewire.devices.sim", "barewire_workbench"),
    *("barewire.rtu", "barewire.ascii", "barewire.tcp", "barewire.codecs", "barewire.io"),
]
AZ3 = load("az3")
OBJECTS = ObjectDictionary([Entry(0x2000, 1, "speed", "u16", "rw", 5)])
LINE = RtuLine(Timing.of(19200))

EXAMPLES: list[tuple[Callable[[], Any], str | re.Pattern[str]]] = [
    (lambda: AZ3, "<Device az3: TEM AZ3 servo drive, 354 parameters, Modbus and CANopen>"),
    (lambda: load("adxl"), "<Device adxl: LOVATO Electric ADXL soft starter, 59 parameters, Modbus>"),
    (lambda: AZ3.find("status word"), "<Parameter STATUS WORD: ro u16, input 24, 6041h:00>"),
    (lambda: AZ3.find("reset error"), "<Parameter RESET ERROR: rw bool, coil 13, 2018h:00 bit 13>"),
    (lambda: AZ3.find("spidac channel sel2"), "<Parameter SPIDAC CHANNEL SEL2: rw u8, holding 2 H, 2025h:00>"),
    (lambda: AZ3.canopen, "<CanopenSettings: node 1, 125000 bit/s, dialect az3, 8 PDOs>"),
    (lambda: AZ3.modbus, "<ModbusSettings: unit 1, order CDAB, reads up to 124, writes up to 123 registers>"),
    (lambda: AZ3.drive, "<DriveRoles: STATUS WORD, CONTROL WORD, modes position 1, velocity 3>"),
    (lambda: Reading(AZ3.find("target torque"), 5), "<Reading TARGET TORQUE = 5 ‰ of rated torque>"),
    (lambda: OBJECTS, "<ObjectDictionary: 2 entries>"),
    (lambda: OBJECTS.entry(0x2000, 1), "<Entry 2000h:01 speed: rw u16>"),
    (lambda: ObjectReading(OBJECTS.entry(0x2000, 1), 5), "<ObjectReading 2000h:01 speed = 5>"),
    (lambda: export(AZ3).objects[0x1018], "<EdsObject 1018h Identity object: 2 entries>"),
    (lambda: eds.parse(b""), "<Eds: 0 lines, 0 objects>"),
    (lambda: ScanResult(), "<ScanResult: no nodes, 0 frames>"),
    (
        lambda: barewire.Table(10),
        "<Table: coils 0..9, discrete inputs 0..9, holding registers 0..9, input registers 0..9>",
    ),
    (
        lambda: barewire.Table(0, coils=[True]),
        "<Table: coils 0, discrete inputs: none, holding registers: none, input registers: none>",
    ),
    (lambda: simulator("az3").modbus, "<Az3ModbusAdapter of <Az3: TEM AZ3 servo drive, simulated>>"),
    (lambda: simulator("az3").canopen, "<CanopenAdapter of <Az3: TEM AZ3 servo drive, simulated>, node 1>"),
    (lambda: simulator("az3").store, "<MachineStore: 354 values>"),
    (
        lambda: DriveStatus(0.0, 0x0637, 1, 2000, 0),
        "<DriveStatus: operation enabled, status word 0637h, mode 1, position 2000, velocity 0>",
    ),
    (lambda: DriveStatus(0.0, 0x0640), "<DriveStatus: switch on disabled, status word 0640h>"),
    (lambda: barewire.ModbusClient("tcp://127.0.0.1:1", lazy=True), "<ModbusClient tcp://127.0.0.1:1>"),
    (
        lambda: barewire.ModbusClient("tcp://127.0.0.1:1", lazy=True).at(unit=3),
        "<ModbusClient tcp://127.0.0.1:1, unit 3>",
    ),
    (
        lambda: barewire.ModbusClient("tcp://127.0.0.1:1?unit=2", lazy=True).at(unit=3),
        "<ModbusClient tcp://127.0.0.1:1?unit=2, unit 3>",
    ),
    (
        lambda: barewire.AsyncModbusClient("tcp://127.0.0.1:1?unit=3").at(timeout=2.0),
        "<AsyncModbusClient tcp://127.0.0.1:1?unit=3>",
    ),
    (lambda: barewire.AsyncModbusClient("tcp://127.0.0.1:1"), "<AsyncModbusClient tcp://127.0.0.1:1>"),
    (lambda: barewire.AsyncModbusServer("tcp://127.0.0.1:1", {}), "<AsyncModbusServer tcp://127.0.0.1:1>"),
    (lambda: barewire.connect_async("csd-mt", "tcp://127.0.0.1:1"), "<csd-mt by <AsyncModbusClient tcp://127.0.0.1:1>>"),
    (
        lambda: barewire.connect_async("csd-mt", "tcp://127.0.0.1:1").drive,
        "<AsyncDriveClient of <csd-mt by <AsyncModbusClient tcp://127.0.0.1:1>>>",
    ),
    (lambda: Drive(ModbusAccess(Bus(LINE), 1, AZ3), AZ3), "<Drive az3>"),
    (lambda: ModbusAccess(Bus(LINE), 7, AZ3), "<ModbusAccess: az3, unit 7>"),
    (lambda: CanopenAccess(Channel(5), AZ3), "<CanopenAccess: az3, <Channel: node 5>>"),
    (lambda: simulator("az3"), "<Az3: TEM AZ3 servo drive, simulated>"),
    (lambda: simulator("adxl"), "<Adxl: LOVATO Electric ADXL soft starter, simulated>"),
    (lambda: simulator("csd-mt"), "<CsdMt: RTA CSD MT 94 / CSD MT S4 stepper drive, simulated>"),
    (lambda: MachineUnits(simulator("az3"), 255), "<MachineUnits 1, 255: TEM AZ3 servo drive>"),
    (lambda: LINE, "<RtuLine: client>"),
    (lambda: AsciiLine(), "<AsciiLine>"),
    (lambda: TcpLine(), "<TcpLine>"),
    (lambda: DatagramLine(), "<DatagramLine>"),
    (lambda: FanOut(4), "<FanOut: 4 lines>"),
    (lambda: Bus(LINE), "<Bus: <RtuLine: client>>"),
    (lambda: Server(LINE, {1: barewire.Table(1)}, serial=True), "<Server: units 1, <RtuLine: client>>"),
    (lambda: Sniffer(LINE), "<Sniffer: <RtuLine: client>>"),
    (lambda: Identity({0: "a", 1: "b", 2: "c"}), "<Identity: VendorName 'a', ProductCode 'b', MajorMinorRevision 'c'>"),
    (lambda: Authorization({"reader": []}), "<Authorization: roles reader>"),
    (lambda: DeviceIdentification(1, {0: b"TEM"}), "<DeviceIdentification: VendorName 'TEM'>"),
    (lambda: Channel(5), "<Channel: node 5>"),
    (lambda: SdoServer(5, OBJECTS), "<SdoServer 605h, 585h: <ObjectDictionary: 2 entries>>"),
    (lambda: LocalNode(5, OBJECTS), re.compile(r"<LocalNode 5: initialising, <ObjectDictionary: \d+ entries>>")),
    (lambda: GatewaySession(1), "<GatewaySession: net 1>"),
    (lambda: Layout(">HH", "address", "quantity"), "<Layout '>HH': address, quantity>"),
    (lambda: ReadHoldingRegisters(0, 2), "ReadHoldingRegisters(address=0, quantity=2)"),
    (lambda: CanFrame.parse("605#40"), re.compile(r"CanFrame\(.*\)")),
    (lambda: explain("rtu", bytes.fromhex("010300000002C40B")), re.compile(r"<Explanation rtu: valid: .*>")),
]  # fmt: skip


@every_case("number", range(len(EXAMPLES)))
def test_an_object_is_one_short_line_in_a_prompt(number: int) -> None:
    make, expected = EXAMPLES[number]
    shown = repr(make())
    if isinstance(expected, str):
        assert shown == expected
    else:
        assert expected.fullmatch(shown)
    assert len(shown) < 200


# Machines inside a node, a line or a session, and base classes: Python's own repr, one line with the name.
PARTS = {
    *("Message", "Request", "Response", "EchoLine", "FairQueue", "SerialCounters"),
    *("NmtSlave", "HeartbeatProducer", "HeartbeatConsumer", "GuardingMaster", "GuardedNode", "LssSlave", "PdoEngine"),
    *("EmcyProducer", "EmcyConsumer", "SyncProducer", "SyncMonitor", "TimeProducer", "TimeConsumer", "PdoConsumer"),
    "StoredParameters",
}


def public_classes() -> Iterator[type]:
    seen = set()
    for room in ROOMS:
        package = import_module(room)
        for name in package.__all__:
            found = getattr(package, name)
            if inspect.isclass(found) and found.__module__.startswith("barewire") and found not in seen:
                seen.add(found)
                yield found


def test_no_public_class_shows_only_its_address() -> None:
    """Every public class has a repr of its own; those of dataclasses and named tuples have all fields."""
    bare = {
        kind.__name__
        for kind in public_classes()
        if vars(object)["__repr__"] is kind.__repr__
        and not issubclass(kind, (Exception, Enum))
        and not getattr(kind, "_is_protocol", False)
        and not inspect.isabstract(kind)
    }
    assert bare == PARTS


@pytest.mark.parametrize("name", names())
def test_no_parameter_of_the_catalogue_is_longer_than_a_line(name: str) -> None:
    assert max(len(repr(parameter)) for parameter in load(name).parameters) < 120


def test_a_modbus_server_names_its_address() -> None:
    with barewire.ModbusServer("tcp://127.0.0.1:0", {}) as server:
        assert repr(server) == f"<ModbusServer {server.url}>"
        assert repr(server.connections) == "<ConnectionTable: none open, 0 closed by the server>"


def test_streams_clients_and_nodes_on_a_bus() -> None:
    with barewire.CanopenServer("can://virtual/reprs?node=5", device="az3") as server:
        assert repr(server).startswith("<CanopenServer can://virtual/reprs")
        with barewire.CanopenClient("can://virtual/reprs") as bus, bus.frames() as stream:
            node = bus.node(5, device="az3")
            assert repr(bus) == "<CanopenClient on virtual/reprs>"
            assert repr(bus.bus) == "<CanBus virtual/reprs>"
            assert repr(node) == "<node 5 of <CanopenClient on virtual/reprs>>"
            assert repr(node.drive) == "<DriveClient of <node 5 of <CanopenClient on virtual/reprs>>>"
            assert repr(node.sdo) == "<SdoMethods of node 5 of <CanopenClient on virtual/reprs>>"
            assert repr(node.nmt) == "<NodeNmtMethods of node 5 of <CanopenClient on virtual/reprs>>"
            assert repr(bus.nmt) == "<NetworkNmtMethods of <CanopenClient on virtual/reprs>>"
            assert repr(stream) == "<Stream of FrameListener on virtual/reprs>"
            assert isinstance(bus.bus, CanBus)
            readings = node.read("STATUS WORD", "TARGET VELOCITY")
            assert "<td>STATUS WORD</td>" in readings._repr_html_()  # type: ignore[attr-defined]


# The tables of a notebook


def test_a_device_is_a_table_in_a_notebook() -> None:
    html = AZ3._repr_html_()
    assert html.count("<tr>") == 354 + 1
    assert "<caption>TEM AZ3 servo drive: 354 parameters</caption>" in html
    assert "<td>STATUS WORD</td><td>ro</td><td>u16</td><td>0..65535</td><td>input 24</td><td>6041h:00</td>" in html
    assert "&lt;" not in AZ3.title


def test_readings_and_an_identification_are_tables_in_a_notebook() -> None:
    from barewire.devices.parameter import Readings

    readings = Readings([Reading(AZ3.find("STATUS WORD"), 0x0637), Reading(AZ3.find("TARGET TORQUE"), 5)])
    assert readings == list(readings)
    assert "<td>TARGET TORQUE</td><td>5 ‰ of rated torque</td>" in readings._repr_html_()
    speed, position = ObjectReading(OBJECTS.entry(0x2000, 1), -5), ObjectReading(OBJECTS.entry(0x2000, 1), True)
    html = ObjectReadings([speed, position])._repr_html_()
    assert html.startswith("<table><tr><th>object</th><th>name</th><th>value</th></tr>")
    assert "<tr><td>2000h:01</td><td>speed</td><td>-5</td></tr>" in html
    assert "<td>True</td>" in html
    html = DeviceIdentification(1, {0: b"TEM & <Co>"})._repr_html_()
    assert "<td>VendorName</td><td>TEM &amp; &lt;Co&gt;</td>" in html
