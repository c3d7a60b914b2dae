"""`barewire simulate`: a machine at one or several endpoints, a table, the initial state, and the environment."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from barewire import CanopenClient, CanopenServer, ModbusServer
from barewire.devices.sim import Az3, MachineUnits, simulator
from barewire.io.fault_injection.faults import KINDS
from barewire_workbench.cli import simulate
from tests.helpers import PATIENCE, free_port
from tests.workbench.cli.helpers import error_of, output_of, run_here, simulated


def test_one_machine_at_two_endpoints(tmp_path: Path) -> None:
    urls = (f"rtu://{tmp_path}/az3?unit=4", f"can://socketcand/127.0.0.1:{free_port()}/can0?node=9")
    with simulated("az3", *urls) as (serial, bus):
        assert output_of("read", serial, "az3", "MODBUS ADDRESS", "BOOT CAN NODE READ ONLY").splitlines() == [
            "MODBUS ADDRESS = 4",
            "BOOT CAN NODE READ ONLY = 9",
        ]
        output_of("write", bus, "az3", "TARGET VELOCITY=-250")
        assert output_of("read", serial, "az3", "TARGET VELOCITY").startswith("TARGET VELOCITY = -250")
        output_of("write", serial, "az3", "CONTROL WORD=6")
        assert output_of("read", bus, "az3", "STATUS WORD") == output_of("read", serial, "az3", "STATUS WORD")


def test_a_table_on_two_ports_is_one_table() -> None:
    with simulated("table", "tcp://127.0.0.1:0", "udp://127.0.0.1:0") as (first, second):
        output_of("write", first, "raw", "holding:100:f32=1.5", "coil:7=on")
        assert output_of("read", second, "raw", "holding:100:f32", "coil:7") == "holding:100:f32 = 1.5\ncoil:7 = on\n"


def test_a_table_answers_until_interrupted() -> None:
    with simulated("table", "tcp://127.0.0.1:0", client_option="") as (endpoint,):
        host, _, port = endpoint.removeprefix("tcp://").partition(":")
        with socket.create_connection((host, int(port)), timeout=30) as client:
            client.sendall(bytes.fromhex("0001 0000 0006 01 03 FFFF 0001"))
            assert client.recv(100) == bytes.fromhex("0001 0000 0005 01 03 02 0000")


@pytest.mark.parametrize("unit", [0, 248])
def test_a_serial_unit_has_an_address_from_1_to_247(unit: int) -> None:
    assert f"unit {unit}: a unit on a serial line" in error_of("simulate", "table", f"rtu://pty?unit={unit}", status=2)


def test_a_link_to_a_closed_terminal_is_replaced(tmp_path: Path) -> None:
    line = tmp_path / "line"
    line.symlink_to("/dev/pts/999999")
    with simulated("adxl", f"rtu://{line}") as (endpoint,):
        assert "Status" in output_of("read", endpoint, "adxl", "Status")


def test_an_endpoint_that_cannot_be_served_ends_the_command() -> None:
    error = error_of("simulate", "adxl", "tcp://127.0.0.1:0", "can://socketcand/127.0.0.1:1/can0", status=2)
    assert "adxl has no CANopen: expected a Modbus endpoint" in error


def test_endpoints_are_closed_if_a_later_one_cannot_be_opened(tmp_path: Path) -> None:
    """No link to a pseudo-terminal is left behind."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        place = f"127.0.0.1:{taken.getsockname()[1]}"
        error = error_of("simulate", "adxl", f"rtu://{tmp_path}/line", f"tcp://{place}")
    assert error == f"barewire: {place}: address already in use\n"
    assert not (tmp_path / "line").is_symlink()


def test_set_changes_also_a_read_only_parameter() -> None:
    with simulated("adxl", "--set", "Sub-menu number selection=3", "tcp://127.0.0.1:0") as (url,):
        assert output_of("read", url, "adxl", "Sub-menu number selection") == "Sub-menu number selection = 3\n"
    command = ("simulate", "adxl", "tcp://127.0.0.1:0", "--set")
    assert "the simulator computes Frequency itself" in error_of(*command, "Frequency=49", status=2)
    assert "did you mean 'Frequency'?" in error_of(*command, "Frequenzy=49", status=2)
    assert "expected NAME=VALUE" in error_of(*command, "Frequency", status=2)
    assert "a table has no named values" in error_of("simulate", "table", "tcp://127.0.0.1:0", "--set", "a=1", status=2)


def test_world_changes_the_environment() -> None:
    with simulated("adxl", "--world", "line=0", "--world", "limits=3", "tcp://127.0.0.1:0") as (url,):
        text = output_of("read", url, "adxl", "Status", "Limit 1", "Limit 2", "Limit 3")
    assert text.splitlines() == ["Status = 0 (Absence of power)", "Limit 1 = on", "Limit 2 = on", "Limit 3 = off"]
    with simulated("az3", "--world", "volts=0", "rtu://pty") as (url,):
        assert "voltage enabled" not in output_of("read", url, "az3", "STATUS WORD")
    assert "expected NAME=VALUE with a name of volts" in error_of(
        "simulate", "az3", "rtu://pty", "--world", "volt=1", status=2
    )
    assert "a table has no environment" in error_of(
        "simulate", "table", "tcp://127.0.0.1:0", "--world", "volts=1", status=2
    )


def test_a_drive_without_high_voltage_reports_that_on_both_its_wires() -> None:
    machine = simulator("az3")
    assert isinstance(machine, Az3)
    machine.supply(0.0, 0.0)
    bus = f"can://socketcand/127.0.0.1:{free_port()}/can0"
    with (
        ModbusServer("rtu://pty", units=MachineUnits(machine)) as serial,
        CanopenServer(bus, device=machine.canopen) as can,
    ):
        for url in (serial.url, can.url):
            patient = f"{url}{'&' if '?' in url else '?'}timeout=20"
            done = run_here("drive", patient, "az3", "enable", "--timeout", "0.3")
            assert done.returncode == 1
            assert "enable: stuck in 'ready to switch on' after 0.3 s" in done.stderr
            assert "no high voltage, bit 4 (voltage enabled) is off" in done.stderr


@pytest.mark.parametrize("late", ["nan", "-1.0", "inf"])
def test_the_delay_of_the_fault_late_is_checked(late: str) -> None:
    error = error_of("simulate", "adxl", "tcp://127.0.0.1:0", "--fault", "late", f"--late={late}", status=2)
    assert error == f"barewire: Invalid value for '--late': '{late}': expected seconds, 0 or more\n"


@pytest.mark.parametrize(
    ("fault", "endpoint", "text"),
    [
        ("drp", "tcp://127.0.0.1:0", "; did you mean 'drop'?"),
        ("drop:2", "tcp://127.0.0.1:0", "expected a probability, 0..1"),
        ("drop@evry=3", "tcp://127.0.0.1:0", "; did you mean 'every'?"),
        ("split", "udp://127.0.0.1:0", "fault 'split' is not possible on this wire: expected"),
        ("drop@20", "can://socketcand/127.0.0.1:1/can0", "an address selects requests of Modbus, not of CAN"),
    ],
)
def test_a_wrong_fault_is_wrong_usage(fault: str, endpoint: str, text: str) -> None:
    assert text in error_of("simulate", "az3", endpoint, "--fault", fault, status=2)


def test_faults_of_selected_responses() -> None:
    chosen = ("--fault", "exception=04@20,drop@input:30,paced=0.001@40")
    with simulated("table", "tcp://127.0.0.1:0", *chosen, client_option=f"timeout={PATIENCE}") as (url,):
        assert "exception 04" in error_of("read", url, "raw", "holding:20")
        assert output_of("read", url, "raw", "holding:21", "holding:40") == "holding:21 = 0\nholding:40 = 0\n"
        assert "within" in error_of("read", url.replace(f"{PATIENCE}", "0.5"), "raw", "input:30")


def test_the_help_names_every_fault_and_every_carrier() -> None:
    text = output_of("simulate", "--help")
    for word in (*KINDS, "tls", "udp", "rtu+tcp", "ascii+tcp", "can"):
        assert word in text


@pytest.mark.parametrize("device", ["adxl", "az3", "csd-mt"])
def test_the_help_names_every_property_of_an_environment(device: str) -> None:
    section = output_of("simulate", "--help").partition(f"\n  {device}  ")[2]
    for row in simulator(device).environment_properties():
        assert row.name in section


def test_a_bus_is_named_once() -> None:
    buses = [f"can://socketcand/127.0.0.1:29536/can0?node={node}" for node in (5, 6)]
    assert "the device is on this bus already: expected it once" in error_of("simulate", "az3", *buses, status=2)


def test_a_virtual_bus_is_refused_because_no_other_process_reaches_it() -> None:
    for device in ("az3", "table"):
        error = error_of("simulate", device, "tcp://127.0.0.1:0", "can://virtual/x?node=5", status=2)
        assert "'can://virtual/x?node=5': can://virtual is inside one process" in error
        assert "use can://socketcand/127.0.0.1:29536/x" in error


def test_a_read_on_a_virtual_bus_reports_that_it_is_inside_one_process() -> None:
    error = error_of("read", "can://virtual/x?timeout=0.1", "az3", "STATUS WORD")
    assert "nothing at all on the bus meanwhile, and can://virtual is inside one process" in error


def test_a_serial_path_that_another_simulation_serves_is_refused(tmp_path: Path) -> None:
    with simulated("adxl", f"rtu://{tmp_path}/line") as (endpoint,):
        error = error_of("simulate", "adxl", f"rtu://{tmp_path}/line")
        assert f"{tmp_path}/line: another barewire server has this pseudo-terminal; " in error
        assert "Status" in output_of("read", endpoint, "adxl", "Status")


def test_the_device_of_an_eds(tmp_path: Path) -> None:
    """Its objects have their defaults; the node-ID is that of the endpoint."""
    file = tmp_path / "drive.eds"
    output_of("eds", "export", "az3", str(file))
    bus = f"can://socketcand/127.0.0.1:{free_port()}/can0?node=9"
    with simulated(str(file), bus) as (url,):
        assert output_of("read", url, "az3", "MAX CURRENT").startswith("MAX CURRENT = ")
        with CanopenClient(url) as client:
            assert client.node().sdo.upload(0x1000) == bytes.fromhex("92010200")
    for endpoints in (("tcp://127.0.0.1:0",), (bus, "can://socketcand/127.0.0.1:1/can0")):
        assert "expected one endpoint, can://" in error_of("simulate", str(file), *endpoints, status=2)
    missing = str(tmp_path / "none.eds")
    assert "No such file" in error_of("simulate", missing, "can://socketcand/127.0.0.1:1/can0", status=2)


def test_on_a_serial_port_the_settings_are_those_of_the_description(monkeypatch: pytest.MonkeyPatch) -> None:
    """`read` opens its port with the same."""
    ours, line = os.openpty()
    machine = simulator("adxl")
    try:
        with simulate.machine_server(f"rtu://{os.ttyname(line)}", machine) as server:
            assert "baudrate" not in server.url  # a pseudo-terminal has none
        monkeypatch.setattr(simulate, "is_pseudo_terminal", lambda path: False)
        with simulate.machine_server(f"rtu://{os.ttyname(line)}?baudrate=19200", machine) as server:
            assert server.url.endswith("?baudrate=19200&bytesize=8&parity=N&stopbits=1")
    finally:
        os.close(ours)
        os.close(line)
