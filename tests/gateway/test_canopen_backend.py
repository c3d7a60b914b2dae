"""CANopen nodes behind the gateway: objects by 2B/0D, and named parameters as registers. A simulated AZ3 on a bus."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

from barewire import AsyncModbusClient, CanopenServer
from barewire.canopen import SdoAbort
from barewire.devices.description.load import load
from barewire.devices.modbus_access import read_modbus
from barewire.gateway.canopen_backend import exception_of
from barewire.gateway.config import ConfigError, read_config
from barewire.gateway.gateway import Gateway
from barewire.modbus import CanopenReference, ModbusException, RawRequest, SdoAborted
from barewire_workbench.eds.export import export
from tests.helpers import every_case

WAIT = 30.0


@pytest.fixture
def bus() -> Iterator[str]:
    """A CAN bus in memory with an AZ3 as node 5."""
    url = f"can://memory/{uuid4().hex}"
    with CanopenServer(f"{url}?node=5", device="az3"):
        yield url


def through(url: str, more: str, act: Callable[[AsyncModbusClient], Awaitable[Any]], units: str = "5") -> Any:
    """Act with a client of a gateway whose only backend is this bus."""
    text = f"""
[[listen]]
url = "tcp://127.0.0.1:0"
[[backend]]
name = "can"
url = "{url}"
units = "{units}"
{more}
"""

    async def main() -> Any:
        async with (
            Gateway(read_config(text)) as gateway,
            AsyncModbusClient(gateway.urls[0], unit=5, timeout=WAIT) as client,
        ):
            return await act(client)

    return asyncio.run(main())


async def refusal(request: Awaitable[Any]) -> int:
    with pytest.raises(ModbusException) as refused:
        await request
    return refused.value.code


@pytest.mark.parametrize("dialect", ["cia309", "schneider"])
def test_objects_by_2b_0d(bus: str, dialect: Any) -> None:
    async def act(client: AsyncModbusClient) -> None:
        read = CanopenReference.read(5, 0x6041, count=2, dialect=dialect)
        status = await client.ask(read)
        assert (len(status.data), status.dialect) == (2, dialect)
        part = await client.ask(CanopenReference(5, 0x6064, 0, start=2, count=9, dialect=dialect))
        assert (part.count, len(part.data)) == (2, 2)
        await client.ask(CanopenReference.write_to(5, 0x6081, 0, (1200).to_bytes(4, "little"), dialect=dialect))
        speed = await client.ask(CanopenReference.read(5, 0x6081, count=4, dialect=dialect))
        assert int.from_bytes(speed.data, "little") == 1200
        with pytest.raises(SdoAborted) as aborted:
            await client.ask(CanopenReference.read(5, 0x5FFF, count=4, dialect=dialect))
        assert aborted.value.abort_code == 0x06020000
        assert await refusal(client.ask(CanopenReference.read(6, 0x6041, count=2, dialect=dialect))) == 2

    through(bus, "", act)


def test_the_registers_of_a_description(bus: str) -> None:
    az3 = load("az3")

    async def act(client: AsyncModbusClient) -> None:
        for name in ("STATUS WORD", "POSITION ACTUAL VALUE"):
            (reading,) = await client.run(read_modbus(client.bus, 5, az3, [name]), unit=5)
            assert reading.name == name
        place = az3.find("PROFILE VELOCITY").modbus
        assert place is not None
        await client.write_multiple_registers(place.address, az3.find("PROFILE VELOCITY").to_registers(900))
        (speed,) = await client.run(read_modbus(client.bus, 5, az3, ["PROFILE VELOCITY"]), unit=5)
        assert speed.value == 900
        assert await refusal(client.read_holding_registers(60000, 1)) == 2
        if place.words > 1:
            assert await refusal(client.write_single_register(place.address, 1)) == 2
        status = az3.find("STATUS WORD").modbus
        assert status is not None
        assert await refusal(client.write_single_register(status.address, 1)) == 2
        assert await refusal(client.ask(RawRequest(b"\x07"))) == 1
        assert await refusal(client.ask(RawRequest(b"\x41"))) == 1
        assert await refusal(client.ask(RawRequest(b"\x03\x00"))) == 3

    through(bus, '[backend.unit.5]\ndevice = "az3"', act)


def test_every_parameter_with_both_addresses_can_be_read(bus: str) -> None:
    az3 = load("az3")
    both = [row for row in az3.parameters if row.modbus and row.object and row.readable and row.type != "text"]
    assert len(both) > 50

    async def act(client: AsyncModbusClient) -> list[str]:
        readings = await client.run(read_modbus(client.bus, 5, az3, [row.name for row in both[:40]]), unit=5)
        return [reading.name for reading in readings]

    assert through(bus, '[backend.unit.5]\ndevice = "az3"\n', act) == [row.name for row in both[:40]]


def test_the_registers_of_an_eds(bus: str, tmp_path: Path) -> None:
    file = tmp_path / "az3.eds"
    file.write_bytes(export(load("az3")).encode())

    async def act(client: AsyncModbusClient) -> None:
        assert len(await client.read_holding_registers(0, 3)) == 3
        await client.write_multiple_registers(10, [0, 1200])
        assert await client.read_holding_registers(10, 2) == (0, 1200)
        assert await refusal(client.read_holding_registers(0, 4)) == 2
        assert await refusal(client.read_holding_registers(10, 1)) == 2
        assert await refusal(client.write_single_register(0, 1)) == 2

    registers = '{ 0 = "6041:00", 1 = "6064", 10 = "6081:00" }'
    through(bus, f'[backend.unit.5]\neds = "{file}"\nregisters = {registers}', act)


def entry(index: int, kind: int, value: object, access: str = "rw") -> str:
    rows = f"ParameterName=x\nObjectType=7\nDataType={kind}\nAccessType={access}\nDefaultValue={value}\nPDOMapping=0"
    return f"[{index:X}]\n{rows}\n"


def eds(folder: Path, name: str, speed: int, text: str = "") -> Path:
    """An EDS with the device type, a name at 1008h, and a speed of a given type at 2000h."""
    lists = "[MandatoryObjects]\nSupportedObjects=1\n1=0x1000\n[OptionalObjects]\nSupportedObjects=1\n1=0x1008\n"
    lists += "[ManufacturerObjects]\nSupportedObjects=1\n1=0x2000\n"
    file = folder / f"{name}.eds"
    file.write_text(lists + entry(0x1000, 7, 0, "ro") + entry(0x1008, 9, text, "const") + entry(0x2000, speed, 70000))
    return file


@pytest.mark.parametrize("dialect", ["cia309", "schneider"])
def test_a_long_object_is_read_in_parts_that_fit(tmp_path: Path, dialect: Any) -> None:
    url, text = f"can://memory/{uuid4().hex}", "".join(chr(ord("a") + number % 26) for number in range(300))

    async def act(client: AsyncModbusClient) -> None:
        data = b""
        while len(data) < len(text):
            request = CanopenReference(5, 0x1008, 0, start=len(data), count=0xFFFF, dialect=dialect)
            part = await client.ask(request)
            assert len(part.data) > 50
            data += part.data
        assert data.decode() == text

    with CanopenServer(f"{url}?node=5", eds=eds(tmp_path, "node", 7, text)):
        through(url, "", act)


def test_a_node_that_answers_with_another_type_is_not_dead(tmp_path: Path) -> None:
    """Its description is wrong: 04 for this object, and the others are read."""
    url = f"can://memory/{uuid4().hex}"

    async def act(client: AsyncModbusClient) -> None:
        for _ in range(3):
            assert await refusal(client.read_holding_registers(10, 1)) == 4
        assert await client.read_holding_registers(0, 2) == (0, 0)

    registers = f'eds = "{eds(tmp_path, "table", 6)}"\nregisters = {{ 0 = "1000:00", 10 = "2000:00" }}'
    with CanopenServer(f"{url}?node=5", eds=eds(tmp_path, "node", 7)):
        through(url, f"[backend.unit.5]\n{registers}", act)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ('device = "az4"', "9:1: no device 'az4'"),
        ('device = "adxl"', "9:1: device = 'adxl': it has no CANopen"),
        ('eds = "missing.eds"\nregisters = { 0 = "6041" }', "missing.eds"),
        ('registers = { 0 = "6041" }', "registers: expected device, or eds and registers"),
        ('device = "az3"\nregisters = { x = "6041" }', "registers = {'x': '6041'}: expected a table such as"),
        ("as = 128", "a node-ID is 1 to 127"),
    ],
)
def test_what_is_wrong_with_a_node_is_said_before_the_gateway_runs(options: str, text: str) -> None:
    file = f"""
[[listen]]
url = "tcp://127.0.0.1:0"
[[backend]]
name = "can"
url = "can://memory/x"
units = 5
[backend.unit.5]
{options}
"""
    with pytest.raises(ConfigError) as wrong:
        read_config(file)
    assert text in str(wrong.value)


def test_a_node_that_is_not_there_is_0b_and_delays_no_other(bus: str) -> None:
    async def act(client: AsyncModbusClient) -> None:
        request = CanopenReference.read(6, 0x6041, count=2)
        dead = [asyncio.ensure_future(refusal(client.ask(request, unit=6))) for _ in range(3)]
        await asyncio.sleep(0.01)
        loop = asyncio.get_running_loop()
        began = loop.time()
        assert len((await client.ask(CanopenReference.read(5, 0x6041, count=2))).data) == 2
        took = loop.time() - began
        assert await asyncio.gather(*dead) == [0x0B] * 3
        assert loop.time() - began > took

    through(bus, "timeout = 2.0", act, units="5-6")


@every_case(
    ("code", "expected"),
    [
        (0x06020000, 2), (0x06090011, 2), (0x06010000, 2), (0x06010001, 2), (0x06010002, 2),
        (0x06090030, 3), (0x06090031, 3), (0x06090032, 3), (0x06070010, 3), (0x06070012, 3), (0x06060010, 3),
        (0x05040000, 0x0B), (0x08000000, 4), (0x08000020, 4), (0x08000022, 4), (0x05040005, 4),
    ],
)  # fmt: skip
def test_each_abort_has_its_exception(code: int, expected: int) -> None:
    assert exception_of(SdoAbort(code, 0x6040, 0)) == expected
