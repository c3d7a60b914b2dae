"""A unit behind a serial server answers one request late: which values do the requests after it return?

    $ python tests/late_answers.py
    {"barewire": {"same link": [200, 300, 400], "link recycled": ...

On RTU nothing in an answer says which request it belongs to. Here register N holds N, so a value shows it.
"""

from __future__ import annotations

import asyncio
import importlib
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from modbus_connection import ModbusConnection, ModbusError, ModbusSerialParams

from barewire.modbus import Adu, ReadHoldingRegisters, ReadHoldingRegistersResponse
from barewire.rtu import RtuLine, Timing, encode

BACKENDS = {
    "barewire": "barewire_modbus_connection",
    "tmodbus": "modbus_connection.tmodbus",
    "pymodbus": "modbus_connection.pymodbus",
}
WAYS = ("same link", "link recycled")
LATE, THEN = 100, (200, 300, 400)
"""The register that is read first, and answered late; those that are read then."""


@asynccontextmanager
async def slow_unit() -> AsyncIterator[str]:
    """Serve a unit that answers its first request when the second one arrives, on whichever connection that is. Yields
    the URL of the serial server, as the device of ModbusSerialParams."""
    waiting: list[bytes] = []
    seen = 0

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal seen
        line = RtuLine(Timing(0.0, 0.0, 0.0), role="server", units=(1,))
        while data := await reader.read(256):
            for request in line.feed(data, asyncio.get_running_loop().time()):
                assert isinstance(request, Adu)
                seen += 1
                waiting.append(encode(1, answer(request.pdu)))
                if seen > 1:
                    writer.write(b"".join(waiting))
                    waiting.clear()
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    try:
        yield f"socket://127.0.0.1:{server.sockets[0].getsockname()[1]}"
    finally:
        server.close()
        await server.wait_closed()  # the client is closed: its connections end by themselves


def answer(pdu: bytes) -> bytes:
    """Return the response to a request: register N holds N. Diagnostics, which may be a probe, are echoed."""
    if pdu[0] != ReadHoldingRegisters.function_code:
        return pdu
    request = ReadHoldingRegisters.decode(pdu)
    return ReadHoldingRegistersResponse((request.address,) * request.quantity).encode()


async def values_after(backend: str, way: str) -> list[int | str]:
    """Return the values of the reads after the one that timed out, or the names of their errors."""
    kind: type[ModbusConnection] = importlib.import_module(BACKENDS[backend]).ModbusConnection
    async with slow_unit() as device:
        connection = kind(ModbusSerialParams(device=device, baudrate=115200), timeout=0.5)
        unit = connection.for_unit(1)

        async def read(register: int) -> int | str:
            try:
                return (await unit.read_holding_registers(register, 1))[0]
            except ModbusError as error:
                return type(error).__name__

        try:
            first = await read(LATE)
            assert first == "ModbusTimeoutError", first
            if way == "link recycled":
                await connection.disconnect()
            return [await read(register) for register in THEN]
        finally:
            await connection.close()


if __name__ == "__main__":
    print(json.dumps({name: {way: asyncio.run(values_after(name, way)) for way in WAYS} for name in BACKENDS}))
