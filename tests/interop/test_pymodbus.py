"""pymodbus as a stranger: its clients against our servers, our clients against its server. TCP, RTU and ASCII."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator

import pytest
from pymodbus import FramerType
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from barewire.errors import BarewireError
from barewire.modbus import (
    ModbusException,
    ReadCoils,
    ReadHoldingRegisters,
    Table,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from barewire.shells import open_host, open_modbus


def _their_client(url: str) -> ModbusTcpClient | ModbusSerialClient:
    scheme, _, place = url.partition("://")
    if scheme == "tcp":
        host, _, port = place.partition(":")
        return ModbusTcpClient(host, port=int(port), timeout=2)
    framer = FramerType.RTU if scheme == "rtu" else FramerType.ASCII
    return ModbusSerialClient(place.partition("?")[0], framer=framer, baudrate=115200, parity="N", timeout=2)


@pytest.mark.parametrize(
    "url", ["tcp://127.0.0.1:0", "rtu://pty?baudrate=115200&parity=N", "ascii://pty?baudrate=115200&parity=N"]
)
def test_their_client_uses_our_server(url: str) -> None:
    table = Table()
    table.input_registers[3] = 0x1234
    table.discrete_inputs[2] = 1
    with open_host(url, units={1: table}) as host:
        client = _their_client(host.url)
        assert client.connect()
        try:
            assert not client.write_registers(10, [1, 2, 3], device_id=1).isError()
            assert client.read_holding_registers(10, count=3, device_id=1).registers == [1, 2, 3]
            assert not client.write_register(11, 65535, device_id=1).isError()
            assert client.read_holding_registers(11, count=1, device_id=1).registers == [65535]
            assert client.read_input_registers(3, count=1, device_id=1).registers == [0x1234]
            assert client.read_discrete_inputs(0, count=3, device_id=1).bits[:3] == [False, False, True]
            assert not client.write_coils(0, [True, False, True], device_id=1).isError()
            assert not client.write_coil(1, True, device_id=1).isError()
            assert client.read_coils(0, count=3, device_id=1).bits[:3] == [True, True, True]
            assert b"barewire" in client.read_device_information(device_id=1).information.values()
            declined = client.read_holding_registers(0xFFFF, count=2, device_id=1)
            assert declined.isError()
            assert declined.exception_code == 2
        finally:
            client.close()


class _TheirServer:
    """Their asyncio server in a thread of its own."""

    def __init__(self) -> None:
        self.ready = threading.Event()
        self.port = 0
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)
        self._loop: asyncio.AbstractEventLoop | None = None

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._end = asyncio.Event()
        registers = SimData(0, values=[0] * 200, datatype=DataType.REGISTERS)
        server = ModbusTcpServer(SimDevice(id=1, simdata=[registers]), address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        assert server.transport is not None
        self.port = server.transport.sockets[0].getsockname()[1]
        self.ready.set()
        await self._end.wait()
        await server.shutdown()

    def __enter__(self) -> _TheirServer:
        self._thread.start()
        assert self.ready.wait(10)
        return self

    def __exit__(self, *_: object) -> None:
        assert self._loop is not None
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(10)


@pytest.fixture
def their_server() -> Iterator[_TheirServer]:
    with _TheirServer() as server:
        yield server


def test_our_client_uses_their_server(their_server: _TheirServer) -> None:
    with open_modbus(f"tcp://127.0.0.1:{their_server.port}?unit=1") as client:
        client.ask(WriteMultipleRegisters(10, (1, 2, 3)))
        client.ask(WriteSingleRegister(11, 20))
        assert client.ask(ReadHoldingRegisters(10, 3)).registers == (1, 20, 3)
        with pytest.raises((ModbusException, BarewireError)):
            client.ask(ReadHoldingRegisters(5000, 2))
        client.ask(WriteMultipleCoils(0, (True, False, True)))
        assert client.ask(ReadCoils(0, 3)).bits == (True, False, True)
