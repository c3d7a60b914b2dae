"""What the tests of modbus-connection leave to the backend: functions that their server does not have, the errors of
barewire in neutral form, links, and answers that come late."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from barewire_modbus_connection import BarewireUnit, ModbusConnection, Params, endpoint
from late_answers import THEN, WAYS, values_after
from modbus_connection import (
    IllegalDataAddressError,
    ModbusConnectionError,
    ModbusSerialParams,
    ModbusTcpParams,
    ModbusTimeoutError,
    ModbusTlsParams,
    ModbusUdpParams,
)
from modbus_connection.exceptions import ModbusProtocolError

from barewire import AsyncModbusServer
from barewire.errors import EncodeError
from barewire.modbus import Table

WAIT = 10.0
"""Seconds that no test needs."""

Do = Callable[[BarewireUnit], Awaitable[object]]
READ: Do = lambda unit: unit.read_holding_registers(0, 1)  # noqa: E731
WRITE: Do = lambda unit: unit.write_register(0, 1)  # noqa: E731


@asynccontextmanager
async def unit_at(params: Params) -> AsyncIterator[BarewireUnit]:
    connection = ModbusConnection(params, timeout=WAIT)
    try:
        yield connection.for_unit(1)
    finally:
        await connection.close()


@asynccontextmanager
async def answered_by(reply: Callable[[bytes], bytes | None]) -> AsyncIterator[ModbusTcpParams]:
    """Serve TCP: `reply` returns the PDU of the response to a PDU, or None to close the connection."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while (head := await reader.read(7)) and (pdu := reply(await reader.read(head[5] - 1))) is not None:
            writer.write(head[:4] + (len(pdu) + 1).to_bytes(2) + head[6:] + pdu)
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    try:
        yield ModbusTcpParams(host="127.0.0.1", port=server.sockets[0].getsockname()[1])
    finally:
        server.close()
        await server.wait_closed()


# Functions ------------------------------------------------------------------------------------------------------------


async def test_functions_that_their_server_does_not_have() -> None:
    table = Table(100, holding_registers=list(range(100)), files={4: [0] * 10})
    table.exception_status = 0b101
    async with AsyncModbusServer("rtu+tcp://127.0.0.1:0", {1: table}) as server:
        device = f"socket://127.0.0.1:{server.port}"
        async with unit_at(ModbusSerialParams(device=device)) as unit:
            await unit.write_file_record(4, 2, [42, 256])
            assert await unit.read_file_record(4, 1, 4) == [0, 42, 256, 0]
            await unit.mask_write_register(4, 0x00F2, 0x0025)
            assert await unit.read_write_registers(3, 2, 10, [7, 8]) == [3, (4 & 0xF2) | (0x25 & ~0xF2)]
            assert await unit.read_holding_registers(10, 2) == [7, 8]
            assert await unit.read_exception_status() == 0b101
            assert await unit.report_server_id() == b"\x01\xfftable"


# Errors ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reply", "do", "error"),
    [
        (lambda pdu: bytes([pdu[0] | 0x80, 2]), READ, IllegalDataAddressError),
        (lambda pdu: bytes([pdu[0], 4, 0, 0, 0, 0]), READ, ModbusProtocolError),  # two registers for one
        (lambda pdu: None, READ, ModbusConnectionError),
        (lambda pdu: None, WRITE, ModbusConnectionError),  # and its outcome is unknown
    ],
)
async def test_errors_are_neutral_and_name_the_call(
    reply: Callable[[bytes], bytes | None], do: Do, error: type[Exception]
) -> None:
    async with answered_by(reply) as params, unit_at(params) as unit:
        with pytest.raises(error, match=r"^(read_holding|write)_registers?\(0, 1\): ") as caught:
            await do(unit)
        assert type(caught.value) is error


async def test_what_no_message_can_carry_is_a_mistake_of_the_caller() -> None:
    async with answered_by(lambda pdu: pdu) as params, unit_at(params) as unit:
        with pytest.raises(EncodeError, match="126"):
            await unit.read_holding_registers(0, 126)
        with pytest.raises(ValueError, match=r"expected 0\.\.65535"):
            await unit.diagnostics(0, 0x10000)
        assert unit.connected


async def test_a_connection_that_takes_too_long_is_a_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    async def connects_never(*_: object, **__: object) -> None:
        raise TimeoutError

    monkeypatch.setattr(asyncio.get_running_loop(), "create_connection", connects_never)
    async with unit_at(ModbusTcpParams(host="127.0.0.1")) as unit:
        with pytest.raises(ModbusTimeoutError, match=r"could not connect to 127.0.0.1:502: .*no connection within"):
            await READ(unit)


async def test_a_certificate_that_is_not_there(tmp_path: Path) -> None:
    params = ModbusTlsParams(host="127.0.0.1", client_cert=str(tmp_path / "none.crt"))
    async with unit_at(params) as unit:
        with pytest.raises(ModbusConnectionError, match=r"could not connect to 127.0.0.1:802: .*No such file"):
            await READ(unit)


# Links ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("params", "url", "options"),
    [
        (ModbusTcpParams(host="FE80::1%enP3s0", port=1502), "tcp://[fe80::1%25enP3s0]:1502", {}),
        (ModbusUdpParams(host="meter.local"), "udp://meter.local:502", {}),
        (ModbusTlsParams(host="meter.local"), "tls://meter.local:802", {}),
        (ModbusSerialParams(device="socket://[::1]:4001", framer="ascii"), "ascii+tcp://[::1]:4001", {}),
        (
            ModbusSerialParams(device="/dev/a port?#1", parity="E"),
            "rtu:///dev/a%20port%3F%231",
            {"baudrate": 9600, "bytesize": 8, "parity": "E", "stopbits": 1},
        ),
    ],
)
def test_the_endpoint_of_params(params: Params, url: str, options: dict[str, Any]) -> None:
    assert endpoint(params) == (url, options)
    assert not ModbusConnection(params).connected


@pytest.mark.parametrize(
    ("params", "text"),
    [
        (ModbusUdpParams(host="a", framer="rtu"), "no rtu framing over UDP"),
        (ModbusSerialParams(device="rfc2217://a:1"), "expected the path of a serial port, or socket://HOST:PORT"),
        (ModbusSerialParams(device="socket://a:1?logging=debug"), "is not a number"),
        (ModbusSerialParams(device="/dev/ttyUSB0", bytesize=7), "RTU needs 8 data bits"),
    ],
)
def test_params_that_no_line_can_have(params: Params, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        ModbusConnection(params)


async def test_a_lost_link_is_reported_once_and_a_closed_one_is_not() -> None:
    lost: list[str] = []
    async with AsyncModbusServer("tcp://127.0.0.1:0", {1: Table(5)}) as server:
        params = ModbusTcpParams(host="127.0.0.1", port=server.port)
        async with unit_at(params) as unit:
            forget = unit.on_connection_lost(lambda: lost.append("lost"))
            await READ(unit)
            await unit.disconnect()
            await READ(unit)
            assert not lost
            await server.close()
            async with asyncio.timeout(WAIT):
                while unit.connected:
                    await asyncio.sleep(0.01)
            assert lost == ["lost"]
            forget()


# Late answers ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS)
async def test_no_request_gets_the_late_answer_to_another(way: str) -> None:
    assert await values_after("barewire", way) == list(THEN)
