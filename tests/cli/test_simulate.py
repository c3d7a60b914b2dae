"""`barewire simulate`: one machine at several endpoints, parts of registers, what it says of itself."""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from barewire import CanopenServer, ModbusServer
from barewire.devices.sim import Az3, MachineUnits, simulator
from barewire.io.fault_injection.faults import KINDS
from tests.cli.test_command import COMMAND, ENVIRONMENT, asked_with, failing, free_port, out


@contextmanager
def simulated(device: str, *arguments: str) -> Iterator[list[str]]:
    """A machine at several endpoints in a process of its own; gives where they are."""
    command = [*COMMAND, "simulate", device, *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            places = [process.stdout.readline().split()[1] for argument in arguments if "://" in argument]
            yield [asked_with(place, "timeout=30") for place in places]
        finally:
            process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
        assert process.stderr.read() == ""


def test_one_drive_on_both_its_wires(tmp_path: Path) -> None:
    urls = (f"rtu://{tmp_path}/az3?unit=4", f"can://socketcand/127.0.0.1:{free_port()}/can0?node=9")
    with simulated("az3", *urls) as (serial, bus):
        assert out("read", serial, "az3", "MODBUS ADDRESS", "BOOT CAN NODE READ ONLY").splitlines() == [
            "MODBUS ADDRESS = 4",
            "BOOT CAN NODE READ ONLY = 9",
        ]
        out("write", bus, "az3", "TARGET VELOCITY=-250")
        assert out("read", serial, "az3", "TARGET VELOCITY").startswith("TARGET VELOCITY = -250")
        out("write", serial, "az3", "CONTROL WORD=6")
        assert out("read", bus, "az3", "STATUS WORD") == out("read", serial, "az3", "STATUS WORD")


def test_a_table_on_two_ports_is_one_table() -> None:
    with simulated("table", "tcp://127.0.0.1:0", "udp://127.0.0.1:0") as (first, second):
        out("write", first, "raw", "holding:100:f32=1.5", "coil:7=on")
        assert out("read", second, "raw", "holding:100:f32", "coil:7") == "holding:100:f32 = 1.5\ncoil:7 = on\n"


def test_a_part_of_a_register_says_how_it_was_written() -> None:
    with simulated("az3", "rtu://pty") as (serial,):
        said = out("write", serial, "az3", "BRAKE 1 POW VALUE=50", "POLARITY=1")
    first, second = said.splitlines()
    assert first == "BRAKE 1 POW VALUE = 50 %, written: its register was read, changed and written back"
    assert second == "POLARITY = 1, written"


def test_what_it_shows_can_be_set_also_where_a_master_may_not() -> None:
    with simulated("adxl", "--set", "Sub-menu number selection=3", "tcp://127.0.0.1:0") as (url,):
        assert out("read", url, "adxl", "Sub-menu number selection") == "Sub-menu number selection = 3\n"
    where = ("simulate", "adxl", "tcp://127.0.0.1:0", "--set")
    assert "this simulator moves Frequency by itself" in failing(*where, "Frequency=49")
    assert "did you mean 'Frequency'?" in failing(*where, "Frequenzy=49")
    assert "expected NAME=VALUE" in failing(*where, "Frequency", status=2)
    assert "table has no names" in failing("simulate", "table", "tcp://127.0.0.1:0", "--set", "a=1")


def test_what_is_around_it_can_be_said() -> None:
    with simulated("adxl", "--world", "line=0", "--world", "limits=3", "tcp://127.0.0.1:0") as (url,):
        said = out("read", url, "adxl", "Status", "Limit 1", "Limit 2", "Limit 3")
    assert said.splitlines() == ["Status = 0 (Absence of power)", "Limit 1 = on", "Limit 2 = on", "Limit 3 = off"]
    with simulated("az3", "--world", "volts=0", "rtu://pty") as (url,):
        assert "voltage enabled" not in out("read", url, "az3", "STATUS WORD")


def test_neighbours_are_written_in_one_request_and_a_name_twice_in_two() -> None:
    with simulated("csd-mt", "tcp://127.0.0.1:0") as (url,):
        said = out("write", url, "csd-mt", "Profile Velocity=1000", "Control Word=6", "Control Word=0", "--json")
        told = [json.loads(line) for line in said.splitlines()]
    assert [(one["name"], one["value"], one["how"]) for one in told] == [
        ("Profile Velocity", 1000, "written"),
        ("Control Word", 6, "written"),
        ("Control Word", 0, "written"),
    ]


def test_a_drive_without_high_voltage_says_so_on_both_wires(tmp_path: Path) -> None:
    machine = simulator("az3")
    assert isinstance(machine, Az3)
    machine.supply(0.0, 0.0)
    bus = f"can://socketcand/127.0.0.1:{free_port()}/can0"
    assert "expected NAME=NUMBER with a name of volts" in failing("simulate", "az3", "rtu://pty", "--world", "volt=1")
    assert "nothing around a table" in failing("simulate", "table", "tcp://127.0.0.1:0", "--world", "volts=1")
    with (
        ModbusServer("rtu://pty", units=MachineUnits(machine)) as serial,
        CanopenServer(bus, device=machine.canopen) as can,
    ):
        for url in (serial.url, can.url):
            command = [*COMMAND, "drive", url, "az3", "enable", "--timeout", "0.3"]
            done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=60, check=False)
            assert done.returncode == 1
            assert "enable: stuck in 'ready to switch on' after 0.3 s" in done.stderr
            assert "no high voltage, bit 4 (voltage enabled) is off" in done.stderr


def test_a_second_endpoint_that_cannot_be_had_is_the_end_of_both() -> None:
    said = failing("simulate", "adxl", "tcp://127.0.0.1:0", "can://socketcand/127.0.0.1:1/can0")
    assert "adxl has no CANopen: it speaks Modbus" in said


def test_the_help_names_every_fault_and_every_carrier() -> None:
    said = out("simulate", "--help")
    for word in (*KINDS, "tls", "udp", "rtu+tcp", "ascii+tcp", "can"):
        assert word in said
