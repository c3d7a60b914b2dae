"""The word order of a machine that can change it (register 1162 of the CSD MT), and clients that read it afterwards."""

from __future__ import annotations

import pytest

from barewire.conversation import play
from barewire.devices import UnknownName, load, read_modbus, write_modbus
from barewire.devices.raw_address import device_with
from barewire.devices.sim import simulator
from barewire.modbus import Bus, Server
from barewire.modbus.messages.registers import ReadHoldingRegisters, ReadHoldingRegistersResponse
from barewire.tcp import TcpLine
from tests.helpers import refused, serving

WORD_ORDER = "Little Endian / Big Endian"


def test_a_machine_with_changed_word_order_is_read_with_that_order() -> None:
    drive, bus = simulator("csd-mt"), Bus(TcpLine())
    assert drive.modbus is not None
    peer = serving(Server(TcpLine(), {1: drive.modbus}, serial=False))
    little, big = load("csd-mt"), load("csd-mt?order=abcd")
    play(write_modbus(bus, 1, little, {"Profile Velocity": 70_000, WORD_ORDER: 0}), peer)
    readings, _ = play(read_modbus(bus, 1, big, ["Profile Velocity"]), peer)
    assert readings[0].value == 70_000
    play(write_modbus(bus, 1, big, {"Target Position": -2, WORD_ORDER: 1}), peer)
    readings, _ = play(read_modbus(bus, 1, little, ["Target Position"]), peer)
    assert readings[0].value == -2


def test_a_simulator_with_changed_word_order() -> None:
    """Setting the register in the simulator changes the word order as a write does."""
    drive = simulator("csd-mt")
    assert drive.modbus is not None
    drive.store[WORD_ORDER] = 0
    drive.store["Profile Velocity"] = 70_000
    answer = drive.modbus.handle(ReadHoldingRegisters(1044, 2), 0.0)
    assert isinstance(answer, ReadHoldingRegistersResponse)
    assert answer.registers == (1, 4464)


def test_a_parameter_with_an_order_of_its_own_keeps_it() -> None:
    az3 = load("az3").in_order("ABCD")
    assert {place.order for row in az3.parameters if (place := row.modbus) and row.type == "f32"} == {"ABCD"}
    assert load("az3").find("ID KP").modbus == az3.find("ID KP").modbus._replace(order="CDAB")  # type: ignore[union-attr]
    assert az3.find("STATUS WORD").object == load("az3").find("STATUS WORD").object


def test_addresses_beside_names_have_the_same_order() -> None:
    machine = device_with("csd-mt?order=ABCD", ["holding:100:f32"])
    place = machine.find("holding:100:f32").modbus
    assert place is not None
    assert place.order == "ABCD"


@pytest.mark.parametrize("name", ["csd-mt?order=XYZ", "csd-mt?orders=ABCD", "csd-mt?"])
def test_an_unknown_order(name: str) -> None:
    with refused(UnknownName, f"device '{name}': expected ?order= and one of ABCD, CDAB, BADC, DCBA behind the name"):
        load(name)
