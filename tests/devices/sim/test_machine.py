"""Rules of every simulator, tested with a device without behaviour."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from barewire.codecs import Value
from barewire.devices.description.load import load
from barewire.devices.sim import Simulator, simulator
from barewire.devices.sim.store import Declined
from barewire.errors import EncodeError
from barewire.modbus.messages import coils as bits, registers
from barewire.modbus.messages.diagnostics import ReadExceptionStatus
from tests.devices.sim.bench import Bench

HEAD = """
name = "mine"
title = "A user's machine"
[modbus]
first_register = 0
read_limit = 8
write_limit = 4
[canopen]
node = 1
"""
ROWS = """
[[parameter]]
name = "Long"
type = "u32"
holding = 10
max = 100000
default = 7
object = 0x2000
access = "rw"
[[parameter]]
name = "Low"
type = "u8"
holding = 12
half = "L"
access = "rw"
[[parameter]]
name = "High"
type = "i8"
holding = 12
half = "H"
min = -5
access = "rw"
[[parameter]]
name = "Text"
type = "text"
holding = 13
words = 2
access = "rw"
[[parameter]]
name = "Level"
type = "i16"
input = 0
access = "ro"
scale = "1/10"
[[parameter]]
name = "Lamp"
type = "bool"
coil = 3
object = 0x2001
object_bit = 4
access = "rw"
[[parameter]]
name = "Motor"
type = "bool"
coil = 4
object = 0x2001
object_bit = 5
access = "rw"
[[parameter]]
name = "Button"
type = "bool"
discrete = 0
access = "ro"
"""


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    (tmp_path / "device.toml").write_text(HEAD)
    (tmp_path / "rows.toml").write_text(ROWS)
    return Bench(simulator(load(tmp_path)))


def test_written_values_are_read_back(bench: Bench) -> None:
    assert type(bench.machine) is Simulator
    for name, value in (("Long", 100_000), ("Low", 200), ("High", -3), ("Text", "abc"), ("Lamp", True)):
        bench.write(name, value)
        assert bench.read(name) == value
    assert bench.read("Low") == 200
    bench.machine.store["Level"] = 27.24
    assert bench.read("Level") == 27.2


def test_addresses_without_parameter_do_not_exist(bench: Bench) -> None:
    assert bench.words(10, 5) == (0, 7, 0, 0, 0)
    assert bench.refused(registers.ReadHoldingRegisters(9, 2)) == 2
    assert bench.refused(registers.ReadHoldingRegisters(14, 2)) == 2
    assert bench.refused(bits.ReadCoils(2, 2)) == 2
    assert bench.refused(bits.ReadDiscreteInputs(0, 1)) == 0
    assert bench.refused(registers.WriteSingleRegister(0, 1)) == 2  # the input register


def test_the_quantity_is_checked_before_the_address(bench: Bench) -> None:
    assert bench.refused(registers.ReadHoldingRegisters(100, 9)) == 3
    assert bench.refused(registers.WriteMultipleRegisters(100, (0,) * 5)) == 3
    assert bench.refused(ReadExceptionStatus()) == 1


def test_a_request_is_carried_out_completely_or_not_at_all(bench: Bench) -> None:
    # The high byte of register 12 may not be -6, so the long value before it is not taken either.
    assert bench.refused(registers.WriteMultipleRegisters(10, (0, 9, 0xFA00))) == 3
    assert bench.read("Long") == 7
    assert bench.refused(registers.WriteMultipleRegisters(13, (0, 0, 0))) == 2


def test_a_long_value_takes_effect_with_its_last_register(bench: Bench) -> None:
    bench.ask(registers.WriteSingleRegister(10, 1))
    assert bench.words(10, 2) == (0, 7)
    bench.ask(registers.WriteSingleRegister(11, 5))
    assert bench.words(10, 2) == (1, 5)
    bench.ask(registers.WriteSingleRegister(10, 2))
    assert bench.refused(registers.WriteSingleRegister(11, 0)) == 3  # 131072 is too much
    assert bench.words(10, 2) == (1, 5)


def test_the_canopen_adapter_reads_and_writes_the_same_store(bench: Bench) -> None:
    assert bench.frames() == ["701#00"]
    assert bench.download(0x2000, 0, bytes.fromhex("E8030000")) == 0
    assert bench.read("Long") == 1000
    assert bench.download(0x2000, 0, bytes.fromhex("A1860100")) == 0x0609_0031
    bench.write("Lamp", True)
    assert bench.upload(0x2001) == b"\x10\x00"
    assert bench.download(0x2001, 0, b"\x00\x00") == 0
    assert bench.read("Lamp") is False
    assert bench.upload(0x2002) == 0x0602_0000


def test_a_word_of_bits_is_written_completely_or_not_at_all(bench: Bench) -> None:
    def decline(value: Value) -> None:
        if value:
            raise Declined("state", "there is no motor")

    bench.machine.store.veto("Motor", decline)
    bench.frames()
    assert bench.download(0x2001, 0, b"\x30\x00") == 0x0800_0022
    assert bench.upload(0x2001) == b"\x00\x00"


def test_power_off_restores_the_defaults_and_boots_the_node(bench: Bench) -> None:
    bench.write("Long", 9)
    bench.machine.power_cycle(1.0)
    assert bench.read("Long") == 7
    assert bench.frames() == ["701#00"]


def test_simulator_takes_a_name_or_a_description() -> None:
    by_name, by_description = simulator("az3", node=5), simulator(load("csd-mt"))
    assert (type(by_name).__name__, type(by_description).__name__) == ("Az3", "CsdMt")
    assert by_name.canopen is not None
    assert [str(frame) for frame in by_name.canopen.start(100.0)] == ["705#00"]
    assert by_name.canopen.deadline == 101.0
    assert by_name.store["BOOT CAN NODE"] == 5
    assert by_description.canopen is None


@pytest.mark.parametrize("name", ["adxl", "az3", "csd-mt"])
def test_every_property_of_an_environment_takes_its_own_text_and_refuses_another(name: str) -> None:
    machine = simulator(name)
    before = [(row.name, row.text) for row in machine.environment_properties()]
    assert before
    for row in machine.environment_properties():
        machine.set_environment(f"{row.name.upper()} = {row.text.upper()}")
        if row.form.expected != "a text":
            with pytest.raises(EncodeError, match=re.escape(f"expected {row.form.expected} behind =, found '-x'")):
                machine.set_environment(f"{row.name}=-x")
    assert [(row.name, row.text) for row in machine.environment_properties()] == before
    with pytest.raises(EncodeError, match=f"expected NAME=VALUE with a name of {before[0][0]}"):
        machine.set_environment("nothing=1")


def test_a_machine_without_behaviour_has_no_environment(bench: Bench) -> None:
    with pytest.raises(EncodeError, match="mine has no environment to set"):
        bench.machine.set_environment("volts=0")


def test_alarms_and_faults_are_set_and_ended_by_name() -> None:
    starter, servo = simulator("adxl"), simulator("az3")
    starter.set_environment("alarm=OVERTEMPERATURE")
    assert starter.status() == 13
    starter.set_environment("alarm=")
    assert starter.status() == 2
    servo.set_environment("fault=7305")
    assert servo.axis.cause == 0x7305
    servo.set_environment("fault=0")
    assert servo.axis.cause == 0


def test_a_user_description_with_a_shipped_name_gets_no_behaviour(tmp_path: Path) -> None:
    (tmp_path / "device.toml").write_text(HEAD.replace("mine", "az3"))
    (tmp_path / "rows.toml").write_text(ROWS)
    assert type(simulator(tmp_path)) is Simulator
