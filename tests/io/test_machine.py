"""A machine by name: the same calls over Modbus and CANopen, blocking and with asyncio."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest

from barewire import AsyncCanopenClient, CanopenServer, ModbusServer, connect, connect_async
from barewire.devices import UnknownName, load
from barewire.devices.cia402 import State
from barewire.devices.drive import DriveProgress, DriveStuck
from barewire.devices.sim import MachineUnits, simulator
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.machine import AsyncMachineClient
from tests.helpers import refused

pytest.importorskip("can")


@contextmanager
def served(wire: str) -> Iterator[str]:
    """An AZ3 on this wire; the URL of a client."""
    if wire == "can":
        with CanopenServer(f"can://virtual/connect-{time.monotonic()}", device="az3", node=7) as server:
            yield server.url
    else:
        with ModbusServer("tcp://127.0.0.1:0", units=MachineUnits(simulator("az3", time.monotonic()), 1)) as host:
            yield f"{host.url}?unit=1"


WIRES = pytest.mark.parametrize("wire", ["can", "tcp"])


@WIRES
def test_values_by_name(wire: str) -> None:
    with served(wire) as url, connect("az3", url, timeout=30) as az3:
        az3["TARGET VELOCITY"] = 1500
        assert (az3["target velocity"].value, az3["TARGET VELOCITY"].unit) == (1500, "User units")
        az3.write({"TARGET VELOCITY": -5, "TARGET POSITION": 77})
        az3.write("TARGET VELOCITY", 6)
        velocity, position = az3.read("TARGET VELOCITY", "TARGET POSITION")
        assert (velocity.value, position.value) == (6, 77)
        assert az3.read("STATUS WORD").name == "STATUS WORD"
        everything = {reading.name: reading.value for reading in az3.read_all()}
        assert everything["TARGET POSITION"] == 77
        assert len(everything) > 100
        with pytest.raises(UnknownName, match="did you mean 'STATUS WORD'"):
            az3.read("STATUS WRD")
        with pytest.raises(EncodeError, match="STATUS WORD is read only"):
            az3["STATUS WORD"] = 1


def test_what_a_reading_changes_is_read_by_its_name_only() -> None:
    """A reading of the event's description moves the event index on."""
    with (
        ModbusServer("tcp://127.0.0.1:0", units=MachineUnits(simulator("adxl", time.monotonic()), 1)) as host,
        connect("adxl", f"{host.url}?unit=1", timeout=30) as adxl,
    ):
        names = {reading.name for reading in adxl.read_all()}
        assert set(adxl.readable) - names == {"Event description", "Parameter value"}
        assert [reading.name for reading in adxl.read_all(["Event description"])] == ["Event description"]


@WIRES
def test_values_by_name_with_asyncio(wire: str) -> None:
    async def main(url: str) -> None:
        async with connect_async(load("az3"), url, timeout=30) as az3:
            await az3.write("TARGET VELOCITY", 1500)
            await az3.write({"TARGET POSITION": 77})
            assert (await az3.read("TARGET VELOCITY")).value == 1500
            velocity, position = await az3.read("TARGET VELOCITY", "TARGET POSITION")
            assert (velocity.value, position.value) == (1500, 77)
            assert len(await az3.read_all()) > 100
            assert [reading.value for reading in await az3.read_all(["TARGET POSITION"])] == [77]

    with served(wire) as url:
        asyncio.run(main(url))


@WIRES
def test_a_drive_moves_while_its_values_are_read_with_asyncio(wire: str) -> None:
    async def main(url: str) -> None:
        async with connect_async("az3", url, timeout=30) as az3:
            seen: list[DriveProgress] = []
            assert (await az3.drive.enable()).state is State.OPERATION_ENABLED
            moving = asyncio.create_task(az3.drive.following(seen.append).move(200, relative=True, velocity=600))
            reads = 0
            while not moving.done():
                assert (await az3.read("STATUS WORD")).name == "STATUS WORD"
                reads += 1
            assert (await moving).position == 200
            assert reads > 2
            assert seen
            with pytest.raises(DriveStuck):
                await az3.drive.move(10**6, velocity=60, within=0.1)
            assert (await az3.drive.quick_stop()).state in (State.QUICK_STOP_ACTIVE, State.SWITCH_ON_DISABLED)
            await az3.drive.disable()

    with served(wire) as url:
        asyncio.run(main(url))


def test_asyncio_values_in_brackets_are_refused_with_the_call_to_write() -> None:
    async def main() -> None:
        async with AsyncCanopenClient("can://virtual/brackets") as bus:
            values: list[Any] = [
                connect_async("adxl", "tcp://127.0.0.1:1"),
                connect_async("az3", "can://virtual/brackets"),
                bus.node(5, device="az3"),
            ]
            for value in values:
                with pytest.raises(TypeError, match=r"reading takes time: write `await machine.read\('Status'\)`"):
                    value["Status"]
                with pytest.raises(TypeError, match=r"writing takes time: write `await machine.write\('Status', 1\)`"):
                    value["Status"] = 1
                with pytest.raises(TypeError, match="not iterable"):
                    list(value)

    asyncio.run(main())


def test_a_list_without_names_is_read_without_a_request() -> None:
    with ModbusServer("tcp://127.0.0.1:0", units={}) as server, connect("adxl", server.url) as adxl:
        assert adxl.read_all([]) == []


def test_exchanged_arguments_are_explained() -> None:
    for kind in (connect, connect_async):
        for url in ("can://virtual/x?node=5", "tcp://127.0.0.1"):
            with refused(EncodeError, f"device '{url}' is a URL: the device comes first, connect('az3', '{url}')"):
                kind(url, "az3")


def test_errors_name_the_device_and_the_wire() -> None:
    with pytest.raises(EncodeError, match="csd-mt has no CANopen"):
        connect("csd-mt", "can://virtual/x")
    with pytest.raises(UnknownName, match="az4"):
        connect("az4", "can://virtual/x")
    with (
        ModbusServer("tcp://127.0.0.1:0", units={}) as server,
        connect("adxl", server.url) as adxl,
    ):
        with pytest.raises(EncodeError, match="adxl is not a drive"):
            adxl.drive.enable()
        with pytest.raises(EncodeError, match=r"\['Status'\] is not the name of a parameter of adxl; expected a text"):
            adxl.read(["Status"])  # type: ignore[call-overload]
    with pytest.raises(PortError):
        connect("az3", "tcp://127.0.0.1:1", timeout=0.1)
    with pytest.raises(EncodeError, match="unknown option 'speed'"):
        connect("az3", "tcp://127.0.0.1:1", speed=1)
    with pytest.raises(EncodeError, match=r"unknown option 'timout', .*; did you mean 'timeout'"):
        connect("az3", "tcp://127.0.0.1:1", timout=1)
    for kind in (connect, connect_async):
        with pytest.raises(EncodeError, match=r"unknown option 'unit', .*; did you mean 'node'"):
            kind("az3", "can://virtual/x", unit=3)
        with pytest.raises(
            EncodeError, match=r"unknown option 'wach', .*, timeout, and those of the interface; did you mean 'watch'"
        ):
            kind("az3", "can://virtual/x", wach=print)


def test_a_machine_takes_names_of_values_over_modbus_and_canopen() -> None:
    starter = simulator("adxl")
    with ModbusServer("tcp://127.0.0.1:0", {1: starter.modbus}) as server, connect("adxl", server.url) as adxl:
        adxl.write("Motor start command", "execute")
        adxl["Motor start command"] = "Execute"
        with refused(EncodeError, "Motor start command = 'go': expected"):
            adxl["Motor start command"] = "go"
    with CanopenServer("can://virtual/names?node=5", device="az3") as can, connect("az3", can.url) as az3:
        az3.write("MODES OF OPERATION", "profile velocity")
        reading = az3.read("MODES OF OPERATION")
        assert "profile velocity" in str(reading).casefold()


@pytest.mark.parametrize(
    ("url", "other"), [("can://memory/x?node=7", "tcp://127.0.0.1"), ("tcp://127.0.0.1", "can://memory/x?node=7")]
)
def test_a_client_of_the_other_protocol_cannot_be_shared(url: str, other: str) -> None:
    az3 = load("az3")

    async def share() -> None:
        AsyncMachineClient(az3, url, shared=AsyncMachineClient(az3, other).client)

    with pytest.raises(EncodeError, match=r"shared is .*: expected the client of a machine on the same"):
        asyncio.run(share())


SETTINGS = pytest.mark.parametrize(
    ("query", "options", "expected"),
    [
        ("", {}, "9600 8N1"),
        ("?baudrate=19200", {}, "19200 8N1"),
        ("?parity=E&baudrate=38400&stopbits=2", {}, "38400 8E2"),
        ("", {"parity": "O", "baudrate": None}, "9600 8O1"),
    ],
)


@pytest.fixture
def silent_line() -> Iterator[str]:
    """A serial line on which nobody answers; its path."""
    ours, line = os.openpty()
    yield os.ttyname(line)
    os.close(ours)
    os.close(line)


@SETTINGS
def test_a_line_has_the_settings_of_the_description(
    query: str, options: dict[str, Any], expected: str, silent_line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the URL names wins. The error of a line on which nothing has answered yet names the settings."""
    pytest.importorskip("barewire.io.ports.serial")  # which opens this line as what it is
    monkeypatch.setattr("barewire.io.ports.pty.is_pseudo_terminal", lambda path: False)
    told = f"the port is set to {expected}, with which no unit has answered yet"
    url, adxl_options = f"rtu://{silent_line}{query}", {"timeout": 0.01, **options}
    with connect("adxl", url, **adxl_options) as adxl, pytest.raises(NoAnswer, match=told):
        adxl.read("Status")

    async def ask() -> None:
        async with connect_async("adxl", url, **adxl_options) as adxl:
            await adxl.read("Status")

    with pytest.raises(NoAnswer, match=told):
        asyncio.run(ask())


def test_the_port_is_opened_with_these_settings(silent_line: str) -> None:
    termios = pytest.importorskip("termios")
    line = os.open(silent_line, os.O_RDWR | os.O_NOCTTY)
    try:
        with connect("adxl", f"rtu://{silent_line}"):
            assert termios.tcgetattr(line)[4:6] == [termios.B9600, termios.B9600]
        with connect("az3", f"rtu://{silent_line}"):
            assert termios.tcgetattr(line)[4:6] == [termios.B19200, termios.B19200]
    finally:
        os.close(line)


def test_the_settings_are_those_of_the_port_alone(silent_line: str) -> None:
    """A pseudo-terminal has no settings that an error could name."""
    with connect("adxl", f"rtu://{silent_line}", timeout=0.01) as adxl, pytest.raises(NoAnswer) as caught:
        adxl.read("Status")
    assert "the port is set to" not in str(caught.value)


def test_a_wrong_setting_of_a_description_is_named() -> None:
    wrong = replace(load("adxl"), extra={"serial": {"parity": "even"}})
    with pytest.raises(
        EncodeError, match=r"parity='even', expected one of N, E, O.*\[serial\] in the description of adxl"
    ):
        connect(wrong, "rtu:///dev/none")
