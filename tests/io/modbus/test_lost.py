"""`connected` and `on_lost` of both clients; TLS settings of the program; the longest pause of a dead unit."""

from __future__ import annotations

import asyncio
import ssl
from pathlib import Path
from typing import Any

import pytest

from barewire import AsyncModbusClient, AsyncModbusServer, ModbusClient, ModbusServer
from barewire.conversation import Wire
from barewire.errors import BarewireError, EncodeError, NoAnswer, PortError
from barewire.modbus import Bus, ReadHoldingRegisters, Table, UnitOptions
from barewire.rtu import RtuLine, Timing
from tests.certificates import authority, leaf
from tests.helpers import free_port

WAIT = 30.0


def test_a_blocking_client_says_that_its_connection_is_lost() -> None:
    lost: list[str] = []
    port = free_port()
    with ModbusClient(f"tcp://127.0.0.1:{port}", lazy=True, timeout=WAIT, on_lost=lost.append) as client:
        assert not client.connected
        with ModbusServer(f"tcp://127.0.0.1:{port}", {1: Table(5)}):
            client.read_holding_registers(0, 1)
            assert client.connected
            assert client.at(unit=2).connected
        with pytest.raises(PortError):
            client.read_holding_registers(0, 1)
        assert not client.connected
    assert len(lost) == 1
    assert "closed" in lost[0] or "reset" in lost[0]


def test_an_asyncio_client_says_at_once_that_its_connection_is_lost() -> None:
    async def main() -> list[str]:
        lost: list[str] = []
        event = asyncio.Event()

        def on_lost(why: str) -> None:
            lost.append(why)
            event.set()

        port = free_port()
        client = AsyncModbusClient(f"tcp://127.0.0.1:{port}", lazy=True, timeout=WAIT, in_flight=4, on_lost=on_lost)
        async with client:
            for _ in range(2):
                event.clear()
                async with AsyncModbusServer(f"tcp://127.0.0.1:{port}", {1: Table(5)}):
                    await client.read_holding_registers(0, 1)
                    assert client.connected
                async with asyncio.timeout(WAIT):
                    await event.wait()
                assert not client.connected
        return lost

    assert len(asyncio.run(main())) == 2


def test_closing_a_client_is_no_loss() -> None:
    lost: list[str] = []
    with ModbusServer("tcp://127.0.0.1:0", {1: Table(5)}) as server:
        with ModbusClient(server.url, on_lost=lost.append) as client:
            client.read_holding_registers(0, 1)

        async def main() -> None:
            async with AsyncModbusClient(server.url, on_lost=lost.append) as client:
                await client.read_holding_registers(0, 1)

        asyncio.run(main())
    assert lost == []


def test_an_error_in_on_lost_does_not_hide_that_of_the_request(caplog: pytest.LogCaptureFixture) -> None:
    def fail(why: str) -> None:
        raise ZeroDivisionError

    with ModbusServer("tcp://127.0.0.1:0", {1: Table(5)}) as server:
        client = ModbusClient(server.url, timeout=WAIT, on_lost=fail)
        client.read_holding_registers(0, 1)
    with pytest.raises(PortError):
        client.read_holding_registers(0, 1)
    assert "on_lost raised ZeroDivisionError" in caplog.text
    with pytest.raises(EncodeError, match="on_lost"):
        ModbusClient("tcp://127.0.0.1:1", lazy=True, on_lost="x")  # type: ignore[arg-type]


def contexts(folder: Path) -> dict[str, ssl.SSLContext]:
    authority(folder)
    leaf(folder, "server", server=True)
    server = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    server.load_cert_chain(folder / "server.crt", folder / "server.key")
    client = ssl.create_default_context(cafile=str(folder / "ca.crt"))
    return {"server": server, "client": client}


def test_tls_with_settings_of_the_program(tmp_path: Path) -> None:
    both = contexts(tmp_path)
    options: dict[str, Any] = {"ssl_context": both["client"], "timeout": WAIT}
    with ModbusServer("tls://127.0.0.1:0?roles=any", {1: Table(5)}, ssl_context=both["server"]) as server:
        place = server.url.partition("?")[0]
        with ModbusClient(place, **options) as client:
            assert client.read_holding_registers(0, 1) == (0,)

        async def main() -> None:
            async with AsyncModbusClient(place, **options) as client:
                assert await client.read_holding_registers(0, 1) == (0,)

        asyncio.run(main())
        any_server = ssl.create_default_context()
        with pytest.raises(BarewireError):
            ModbusClient(place, ssl_context=any_server)
        any_server.check_hostname = False
        any_server.verify_mode = ssl.CERT_NONE
        with ModbusClient(place, ssl_context=any_server, timeout=WAIT) as client:
            assert client.read_holding_registers(0, 1) == (0,)


@pytest.mark.parametrize(
    ("url", "text"),
    [("tcp://127.0.0.1:1", "ssl_context= is for tls://"), ("tls://127.0.0.1:1?ca=x", "ca and ssl_context= set")],
)
def test_settings_that_cannot_be_used_are_refused(url: str, text: str) -> None:
    with pytest.raises(EncodeError, match=text):
        ModbusClient(url, ssl_context=ssl.create_default_context(), lazy=True)


@pytest.mark.parametrize(
    ("options", "pauses"), [({}, [1, 2, 4, 8, 16, 30, 30]), ({"longest_pause": 3.0}, [1, 2, 3, 3])]
)
def test_the_pause_of_a_dead_unit_doubles_up_to_the_longest(options: dict[str, Any], pauses: list[float]) -> None:
    bus = Bus(RtuLine(Timing.of(19200)), options=UnitOptions(dead_after=1, **options))
    wire: Any = Wire(lambda data, now: [])
    for pause in pauses:
        with pytest.raises(NoAnswer):
            wire.play(bus.ask(1, ReadHoldingRegisters(0, 1), timeout=0.1))
        assert bus.state.units[1].dead_until - wire.now == pytest.approx(pause, abs=0.1)
        wire.now = bus.state.units[1].dead_until
