"""Round trips on real ports: every writable parameter of every machine, once over each transport that it has.

Both ends of every range, in virtual time and through the same frames: tests/devices/sim/test_round_trips.
"""

from __future__ import annotations

import time

import pytest

from barewire import CanopenServer, ModbusServer, connect
from barewire.devices import Device, Parameter, load
from barewire.devices.sim import MachineUnits, simulator
from barewire.io.server.base import ThreadedServer
from tests.devices.sim.test_round_trips import MENU, PDO_RECORDS, PUSHED, in_range, same, wanted
from tests.helpers import free_port

LINES = [
    ("az3", "rtu://pty?baudrate=115200&pace=0"),
    ("az3", "can"),
    ("adxl", "rtu://pty?baudrate=115200&pace=0"),
    ("adxl", "ascii://pty?baudrate=115200&pace=0"),
    ("adxl", "tcp://127.0.0.1:0"),
    ("csd-mt", "tcp://127.0.0.1:0"),
]

CHANGES_ALL_ELSE = {
    *(
        "Little Endian / Big Endian",
        "Counter Watchdog",
    ),  # the settings of the link itself, and of faults
    *("Save and reboot", "Event index"),  # not answered; has another meaning when it is read
}


def travels(device: Device, parameter: Parameter, url: str) -> bool:
    if not parameter.writable or parameter.name in CHANGES_ALL_ELSE:
        return False
    if url == "can":
        return parameter.object is not None and parameter.object.index not in PDO_RECORDS
    return parameter.modbus is not None


@pytest.mark.parametrize(("name", "url"), LINES, ids=[f"{name}-{url.partition(':')[0]}" for name, url in LINES])
def test_every_writable_parameter_over_every_transport(name: str, url: str) -> None:
    device, machine = load(name), simulator(name, time.monotonic())
    where = f"can://socketcand/127.0.0.1:{free_port()}/can0" if url == "can" else url
    server: ThreadedServer
    if url == "can":
        server = CanopenServer(where, device=machine)
    else:
        server = ModbusServer(where, MachineUnits(machine, *(() if "pty" in url else (255, 0))))
    wrong, done = [], 0
    with server as host, connect(device, host.url, timeout=20) as connected:
        if name == "adxl":
            connected.write(MENU)
        for parameter in [parameter for parameter in device.parameters if travels(device, parameter, url)]:
            if parameter.name.startswith("C14"):
                connected.write({"C13 Save a copy of the setup parameters": 12})
            value = next(value for value in wanted(parameter) if in_range(parameter, value))
            connected.write({parameter.name: value})
            done += 1
            if parameter.readable and parameter.name not in PUSHED[name]:
                reading = connected.read(parameter.name)
                if not same(parameter, reading.value, value):
                    wrong.append((parameter.name, value, reading.value))
            if parameter.name in MENU:
                connected.write(MENU)
            if parameter.type == "bool":
                connected.write({parameter.name: False})  # BRAKE ACTIVATION on, BRAKE VALUE belongs to no parameter
    assert wrong == []
    assert done > {"az3": 190, "adxl": 15, "csd-mt": 60}[name]
