"""Through the gateway: mbpoll, pymodbus and libmodbus on TCP reach the three machines, each on a line of another kind.

    unit 1   ADXL, on RTU          unit 2   CSD MT, on TCP          unit 3   AZ3, node 5 of a CAN bus

libmodbus makes every call of its client to the table of `our_side`, on RTU.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from uuid import uuid4

import pytest
from pymodbus.client import ModbusTcpClient

from barewire import CanopenServer, ModbusServer, connect
from barewire.devices.description.load import load
from barewire.devices.sim import simulator
from tests.gateway.in_thread import running
from tests.interop.our_side import LINE, FullUnit
from tests.interop.test_libmodbus import programs as programs

MACHINES = {1: ("adxl", "Thyristors temperature"), 2: ("csd-mt", "Status Word"), 3: ("az3", "STATUS WORD")}
"""Of each unit: the machine, and a value of it."""


Asked = tuple[bool, int, list[int]]
Gatewayed = tuple[str, dict[int, Asked], str, FullUnit]


def _asked(unit: int, url: str) -> Asked:
    """Whether it is an input register, the address on the wire, and what is read there without the gateway."""
    device, name = MACHINES[unit]
    with connect(device, url) as machine:
        parameter = load(device).find(name)
        assert parameter.modbus is not None
        registers = list(parameter.to_registers(machine[name].value))
    return parameter.modbus.table == "input", parameter.modbus.address, registers


@pytest.fixture(scope="module")
def gateway() -> Iterator[Gatewayed]:
    """The URL of a gateway, what is asked of each unit, the line of the table, and the table."""
    table, bus = FullUnit("rtu", set()), f"can://memory/{uuid4().hex}"
    with ExitStack() as stack:
        adxl, csd = simulator("adxl").modbus, simulator("csd-mt").modbus
        assert adxl is not None
        assert csd is not None
        lines = [
            stack.enter_context(ModbusServer(f"rtu://pty{LINE}", {1: adxl})).url,
            stack.enter_context(ModbusServer("tcp://127.0.0.1:0", {1: csd})).url,
            stack.enter_context(ModbusServer(f"rtu://pty{LINE}", {1: table})).url,
        ]
        stack.enter_context(CanopenServer(f"{bus}?node=5", device="az3"))
        backends = "".join(
            f'[[backend]]\nname = "{unit}"\nurl = "{url}"\nunits = {unit}\n[backend.unit.{unit}]\nas = {place}\n{more}'
            for unit, url, place, more in (
                (1, lines[0], 1, ""),
                (2, lines[1], 1, ""),
                (3, bus, 5, 'device = "az3"\n'),
            )
        )
        direct = {1: f"{lines[0]}&unit=1", 2: f"{lines[1]}?unit=1", 3: f"{bus}?node=5"}
        asked = {unit: _asked(unit, url) for unit, url in direct.items()}  # before a line has its owner
        running_one = stack.enter_context(running(f'[[listen]]\nurl = "tcp://127.0.0.1:0"\n{backends}'))
        yield running_one.urls[0], asked, lines[2], table


@pytest.mark.needs("mbpoll")
@pytest.mark.parametrize("unit", MACHINES)
def test_mbpoll_reads_every_machine(gateway: Gatewayed, unit: int) -> None:
    host, _, port = gateway[0].partition("://")[2].partition(":")
    is_input, first, expected = gateway[1][unit]
    options = ["-a", str(unit), "-t", "3" if is_input else "4", "-r", str(first), "-c", str(len(expected))]
    command = ["mbpoll", "-m", "tcp", "-p", port, "-0", "-1", "-q", *options, host]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    assert done.returncode == 0, done.stderr
    assert [int(line.split()[1]) for line in done.stdout.splitlines() if line.startswith("[")] == expected


@pytest.mark.parametrize("unit", MACHINES)
def test_pymodbus_reads_every_machine(gateway: Gatewayed, unit: int) -> None:
    host, _, port = gateway[0].partition("://")[2].partition(":")
    is_input, first, expected = gateway[1][unit]
    with ModbusTcpClient(host, port=int(port), timeout=10) as client:
        read = client.read_input_registers if is_input else client.read_holding_registers
        assert read(first, count=len(expected), device_id=unit).registers == expected
        assert read(60000, count=2, device_id=unit).exception_code == 2
        assert read(first, count=1, device_id=9).exception_code == 0x0A


@pytest.mark.needs("libmodbus", "cc")
def test_libmodbus_makes_every_call(gateway: Gatewayed, programs: dict[str, Path]) -> None:
    """Its client asks unit 1: here that is the table of `our_side`, through a gateway of its own."""
    _, _, line, table = gateway
    text = f'[[listen]]\nurl = "tcp://127.0.0.1:0"\n[[backend]]\nname = "line"\nurl = "{line}"\nunits = 1\n'
    with running(text) as one:
        command = [str(programs["client"]), "tcp", *one.urls[0].partition("://")[2].split(":")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert done.stderr == ""
    assert done.stdout.splitlines()[-1] == "all"
    assert list(table.holding_registers[2000:2123]) == list(range(1000, 1123))
