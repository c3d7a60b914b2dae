"""The front door: importing it is cheap, its clients and servers have exact types, wrong arguments are explained.

The functions with `assert_type` are checked by `mypy --strict`; pytest runs them too.
"""

from __future__ import annotations

import asyncio
import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any, assert_type

import pytest

import barewire
from barewire.devices.sim import simulator
from barewire.errors import EncodeError
from barewire.io.endpoint import CARRIERS, Carrier
from barewire.modbus import ReadHoldingRegisters, ReadHoldingRegistersResponse, WriteSingleRegister
from barewire.modbus.client.read_identification import DeviceIdentification
from tests.helpers import refused

SRC = Path(__file__).parent.parent.parent / "src"


def test_importing_the_front_door_loads_no_room() -> None:
    look = f"import sys; sys.path.insert(0, {str(SRC)!r}); import barewire; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-I", "-S", "-c", look], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert {name for name in loaded if name.startswith("barewire")} == {"barewire", "barewire._lazy"}
    assert not loaded & {"asyncio", "dataclasses", "inspect", "socket", "threading"}


def test_every_name_of_the_door_is_there() -> None:
    for name in barewire.__all__:
        assert getattr(barewire, name) is not None


def test_the_blocking_client_returns_values() -> None:
    with barewire.ModbusServer("tcp://127.0.0.1:0", units={1: barewire.Table(), 3: barewire.Table()}) as server:
        assert_type(server, barewire.ModbusServer)
        assert_type(server.port, int)
        with barewire.ModbusClient(f"tcp://127.0.0.1:{server.port}", unit=1, timeout=30) as client:
            assert_type(client.read_holding_registers(0, 2), tuple[int, ...])
            assert_type(client.read_coils(0, 2), tuple[bool, ...])
            assert_type(client.ask(ReadHoldingRegisters(0, 2)), ReadHoldingRegistersResponse)
            assert_type(client.at(unit=3), barewire.ModbusClient)
            assert_type(client.read_device_identification(), DeviceIdentification)
            client.at(unit=3).write_single_register(7, 70)
            assert client.at(unit=3).read_holding_registers(address=7, quantity=1) == (70,)
            assert client.read_holding_registers(7, 1) == (0,)
            assert client.read_device_identification().objects[0]


def test_the_asyncio_client_returns_coroutines() -> None:
    async def exchanges() -> None:
        passed: list[tuple[str, bytes]] = []
        async with barewire.AsyncModbusServer("tcp://127.0.0.1:0", units={1: barewire.Table()}) as server:
            assert server.url == f"tcp://127.0.0.1:{server.port}"
            client = barewire.AsyncModbusClient(server.url, timeout=30, watch=lambda *seen: passed.append(seen))
            assert passed == []
            async with client:
                assert_type(await client.read_holding_registers(0, 2), tuple[int, ...])
                assert_type(await client.ask(ReadHoldingRegisters(0, 2)), ReadHoldingRegistersResponse)
                assert_type(await client.at(unit=1).read_coils(0, 2), tuple[bool, ...])
                assert_type(client.at(unit=3), barewire.AsyncModbusClient)
                assert_type(await client.read_device_identification(), DeviceIdentification)
        assert [way for way, _ in passed[:2]] == ["sent", "received"]
        with refused(barewire.PortError, "a server serves once"):
            await server.start()

    asyncio.run(exchanges())


def test_an_asyncio_client_without_async_with_connects_with_its_first_request() -> None:
    async def exchange() -> None:
        async with barewire.AsyncModbusServer("tcp://127.0.0.1:0", units={1: barewire.Table()}) as server:
            client = barewire.AsyncModbusClient(server.url, timeout=30)
            assert await client.read_holding_registers(0, 1) == (0,)
            await client.close()

    asyncio.run(exchange())


def test_a_keyword_is_the_same_option_as_in_the_url_and_overrides_it() -> None:
    url = "rtu:///dev/ttyUSB7?baudrate=9600&unit=2"
    client = barewire.ModbusClient(url, unit=5, timeout=0.5, parity="N", echo=True, stopbits=2.0, lazy=True)
    assert client.url == "rtu:///dev/ttyUSB7?baudrate=9600&unit=5&timeout=0.5&parity=N&echo=1&stopbits=2"
    assert (client.unit, client.timeout) == (5, 0.5)


BOTH: list[Any] = [barewire.ModbusClient, barewire.AsyncModbusClient]


@pytest.mark.parametrize("client", BOTH)
def test_a_wrong_option_is_explained(client: Any) -> None:
    with refused(barewire.EncodeError, "unknown option 'baudrate', expected any_transaction, any_unit"):
        client("tcp://10.0.0.7", baudrate=9600)
    with refused(barewire.EncodeError, "parity='odd', expected one of N, E, O"):
        client("rtu:///dev/ttyUSB0", parity="odd")
    with refused(
        barewire.EncodeError, "gap=None_: expected a text, a number, a boolean or a path".replace("None_", "[]")
    ):
        client("tcp://10.0.0.7", gap=[])
    with refused(barewire.EncodeError, "endpoint 502: expected a URL as a string"):
        client(502)
    with refused(barewire.EncodeError, "expected tcp://HOST:PORT (also tls, udp, rtu+tcp, ascii+tcp), rtu:///dev/..."):
        client("10.0.0.7")
    with refused(barewire.EncodeError, "Modbus goes over tcp://"):
        client("can://virtual/x")


@pytest.mark.parametrize("client", BOTH)
def test_an_object_other_than_a_request_message_is_refused(client: Any) -> None:
    one = client("tcp://127.0.0.1:1", lazy=True)
    expected = "expected a request message, such as ReadHoldingRegisters(0, 2) of barewire.modbus, got "
    with refused(TypeError, expected + "'foo'"):
        one.ask("foo")
    with refused(TypeError, expected + "WriteSingleRegister"):
        one.broadcast(WriteSingleRegister)


@pytest.mark.parametrize("server", [barewire.ModbusServer, barewire.AsyncModbusServer])
def test_a_server_without_a_dict_of_units_is_explained(server: Any) -> None:
    with refused(barewire.EncodeError, "expected a dict of unit address and unit, such as {1: Table()}"):
        server("tcp://127.0.0.1:0", barewire.Table())
    with refused(barewire.EncodeError, "units: address 256: expected 0..255"):
        server("tcp://127.0.0.1:0", {256: barewire.Table()})
    with refused(
        barewire.EncodeError,
        "units: unit 1: 5: expected a Table, Functions, simulator(...).modbus, or an object with handle(request, now)",
    ):
        server("tcp://127.0.0.1:0", {1: 5})


@pytest.mark.parametrize("framing", ["tcp", "rtu"])
@pytest.mark.parametrize("server", [barewire.ModbusServer, barewire.AsyncModbusServer])
def test_a_transport_without_a_server_is_refused(server: Any, framing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A new transport has a client first; without this check its server would listen on TCP."""
    monkeypatch.setitem(CARRIERS, "x", Carrier(framing, "bluetooth", frozenset()))
    with refused(barewire.EncodeError, "endpoint 'x://motor': there is no server for x://, expected tcp://, tls://"):
        server("x://motor", units={1: barewire.Table()})


CLOSED: list[Any] = [
    lambda: barewire.AsyncModbusClient("tcp://127.0.0.1:1"),
    lambda: barewire.AsyncCanopenClient("can://virtual/close"),
    lambda: barewire.connect_async("adxl", "tcp://127.0.0.1:1"),
    lambda: barewire.connect_async("az3", "can://virtual/close"),
    lambda: barewire.AsyncModbusServer("tcp://127.0.0.1:0", {1: barewire.Table()}),
    lambda: barewire.AsyncCanopenServer("can://virtual/close?node=5", device="az3"),
]


@pytest.mark.parametrize("make", CLOSED)
def test_close_is_awaited_on_everything_for_asyncio(make: Any) -> None:
    async def close_twice() -> None:
        thing = make()
        await thing.close()
        await thing.close()
        assert not hasattr(thing, "aclose")

    asyncio.run(close_twice())


def test_both_clients_have_the_same_methods() -> None:
    blocking, waiting = ({name for name in dir(kind) if not name.startswith("_")} for kind in BOTH)
    assert waiting == blocking


def test_both_asyncio_clients_are_connected_by_open() -> None:
    for client in (barewire.AsyncModbusClient, barewire.AsyncCanopenClient):
        assert inspect.iscoroutinefunction(client.open)
        assert not hasattr(client, "connect")


def test_a_read_without_names_is_refused() -> None:
    with refused(EncodeError, "read: expected names of parameters; every one is connect(device, url).read_all()"):
        barewire.ModbusClient("tcp://127.0.0.1:1", lazy=True).read("adxl")


def test_an_unknown_name_has_its_error_at_the_door() -> None:
    with pytest.raises(barewire.UnknownName, match="did you mean 'adxl'"):
        barewire.load("adxk")


def test_help_shows_the_parameters_of_a_method() -> None:
    import inspect

    assert list(inspect.signature(barewire.ModbusClient.write_single_register).parameters) == [
        "self",
        "address",
        "value",
    ]
    assert "function 06" in (inspect.getdoc(barewire.AsyncModbusClient.write_single_register) or "")


def test_a_client_takes_the_name_of_a_device_as_well_as_its_description() -> None:
    unit = simulator("adxl").modbus
    assert unit is not None
    with (
        barewire.ModbusServer("tcp://127.0.0.1:0", units={1: unit}) as server,
        barewire.ModbusClient(server.url, timeout=30) as client,
    ):
        client.write("adxl", {"Motor start command": 1})
        (by_name,) = client.read("adxl", "Status")
        (by_description,) = client.read(barewire.load("adxl"), "Status")
        assert by_name.parameter == by_description.parameter
        with refused(EncodeError, "expected the name or the path of a description, or a Device"):
            client.read(5, "Status")  # type: ignore[arg-type]
