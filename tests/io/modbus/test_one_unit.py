"""How a client asks one unit of a line: options of a URL, or keywords, that it alone has."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from typing import Any

import pytest

import barewire
from barewire import AsyncModbusClient, ModbusClient, ModbusServer, NoAnswer, Table
from barewire.errors import EncodeError
from barewire.io.machine import AsyncMachineClient
from barewire.modbus import ReadHoldingRegisters

UNITS: Any = {2: {"timeout": 0.02, "dead_after": 1}, 3: {"gap": 0.1}}
QUERY = "timeout=9&timeout.2=0.02&dead_after.2=1&gap.3=0.1"
READ = ReadHoldingRegisters(0, 1)


@pytest.fixture
def line() -> Iterator[ModbusServer]:
    """A server on a pseudo-terminal, with units 1 and 3: unit 2 does not answer."""
    with ModbusServer("rtu://pty", units={1: Table(), 3: Table()}) as server:
        yield server


@pytest.mark.parametrize("in_url", [True, False])
def test_every_way_to_ask_a_unit_uses_its_options(line: ModbusServer, in_url: bool) -> None:
    options: Any = {} if in_url else {"timeout": 9, "units": UNITS}
    with ModbusClient(f"{line.url}?{QUERY}" if in_url else line.url, **options) as client:
        assert client.url == f"{line.url}?{QUERY}"
        assert client.bus.state.units[3].gap == 0.1
        with pytest.raises(NoAnswer, match=r"within 0\.02 s"):
            client.at(2).read_holding_registers(0, 1)
        client.at(1).read_holding_registers(0, 1)
        with pytest.raises(NoAnswer, match="left 1 requests unanswered: asked again in"):
            client.ask(READ, unit=2)
        assert client.at(2, timeout=5).timeout_for(2) == 5


def test_an_asyncio_client_has_the_same_options(line: ModbusServer) -> None:
    async def main() -> None:
        async with AsyncModbusClient(line.url, timeout=9, units=UNITS) as client:
            with pytest.raises(NoAnswer, match=r"within 0\.02 s"):
                await client.read("csd-mt", "Status Word", unit=2)
            began = time.monotonic()
            for _ in range(3):
                await client.ask(READ, unit=3)
            assert time.monotonic() - began >= 0.2

    asyncio.run(main())


def test_a_machine_on_a_shared_line_has_the_options_of_its_own_url() -> None:
    device = barewire.load("csd-mt")
    url = "rtu:///dev/ttyUSB0?timeout=0.5"
    first = AsyncMachineClient(device, f"{url}&unit=1", lazy=True)
    second = AsyncMachineClient(device, f"{url}&unit=2&gap=0.1&timeout.2=3", shared=first.client)
    assert isinstance(second.client, AsyncModbusClient)
    assert second.client.bus.state.units[2].options == (3.0, 0.1, 0, 30.0)
    assert second.client.timeout_for(2) == 3.0
    assert second.client.bus.state.units[1].options == (0.5, 0.0, 0, 30.0)


@pytest.mark.parametrize(
    ("units", "text"),
    [
        ({7: {"gpa": 1}}, "did you mean 'gap.7'?"),
        ({300: {"gap": 1}}, "'gap.300': expected gap.UNIT, a unit address in 0..255"),
        ({7: {"gap": -1}}, "gap.7='-1' is not a number of seconds"),
        ({7: 0.1}, "units={7: 0.1}: expected the options of units by their addresses, such as {7: {'gap': 0.1}}"),
        ([7], "units=[7]: expected the options of units by their addresses"),
    ],
)
def test_a_wrong_option_of_a_unit_is_an_error_in_words(units: Any, text: str) -> None:
    for client in (ModbusClient, AsyncModbusClient):
        with pytest.raises(EncodeError) as caught:
            client("rtu:///dev/ttyUSB0", units=units, lazy=True)
        assert text in str(caught.value)
