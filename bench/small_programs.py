"""The same small programs with each library, as its documentation shows them, for `bench/small.py`.

A client defines `read()`, which reads ten registers; a server of ten registers prints "ready" and serves. Both are at
`place`: a port on the loopback, or the path of a pseudo-terminal. A program imports what it needs and nothing else,
because its memory and its start are measured.
"""

from __future__ import annotations

BLOCKING_TCP = {
    "barewire": """
from barewire import ModbusClient
client = ModbusClient(f"tcp://127.0.0.1:{place}")
def read(): return client.read_holding_registers(0, 10)
""",
    "pyModbusTCP": """
from pyModbusTCP.client import ModbusClient
client = ModbusClient("127.0.0.1", int(place))
def read(): return client.read_holding_registers(0, 10)
""",
    "pymodbus": """
from pymodbus.client import ModbusTcpClient
client = ModbusTcpClient("127.0.0.1", port=int(place))
client.connect()
def read(): return client.read_holding_registers(0, count=10, device_id=1).registers
""",
}

BLOCKING_RTU = {
    "barewire": """
from barewire import ModbusClient
client = ModbusClient(f"rtu://{place}?baudrate=115200")
def read(): return client.read_holding_registers(0, 10)
""",
    "minimalmodbus": """
import minimalmodbus
client = minimalmodbus.Instrument(place, 1)
client.serial.baudrate = 115200
client.serial.timeout = 1.0
def read(): return client.read_registers(0, 10)
""",
    "pymodbus": """
from pymodbus.client import ModbusSerialClient
client = ModbusSerialClient(place, baudrate=115200)
client.connect()
def read(): return client.read_holding_registers(0, count=10, device_id=1).registers
""",
}

ASYNCIO_TCP = {
    "barewire": """
from barewire import AsyncModbusClient
client = AsyncModbusClient(f"tcp://127.0.0.1:{place}")
async def read(): return await client.read_holding_registers(0, 10)
""",
    "pymodbus": """
from pymodbus.client import AsyncModbusTcpClient
client = None
async def read():
    global client
    if client is None:
        client = AsyncModbusTcpClient("127.0.0.1", port=int(place))
        await client.connect()
    return (await client.read_holding_registers(0, count=10, device_id=1)).registers
""",
    "tmodbus": """
from tmodbus import create_async_tcp_client
client = None
async def read():
    global client
    if client is None:
        client = create_async_tcp_client("127.0.0.1", int(place), unit_id=1)
        await client.connect()
    return await client.read_holding_registers(0, 10)
""",
}

SERVERS_TCP = {
    "barewire": """
import threading
from barewire import ModbusServer, Table
server = ModbusServer(f"tcp://127.0.0.1:{place}", units={1: Table(100)})
print("ready", flush=True)
server.run(threading.Event())
""",
    "barewire, asyncio": """
import asyncio
from barewire import AsyncModbusServer, Table
async def main():
    async with AsyncModbusServer(f"tcp://127.0.0.1:{place}", units={1: Table(100)}):
        print("ready", flush=True)
        await asyncio.Event().wait()
asyncio.run(main())
""",
    "pyModbusTCP": """
import threading
from pyModbusTCP.server import ModbusServer
server = ModbusServer("127.0.0.1", int(place), no_block=True)
server.start()
print("ready", flush=True)
threading.Event().wait()
""",
    "pymodbus, asyncio": """
import asyncio
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
async def main():
    device = SimDevice(1, [SimData(0, values=[0] * 10, datatype=DataType.REGISTERS)])
    server = ModbusTcpServer(device, address=("127.0.0.1", int(place)))
    await server.serve_forever(background=True)
    print("ready", flush=True)
    await asyncio.Event().wait()
asyncio.run(main())
""",
    "tmodbus, asyncio": """
import asyncio
from tmodbus.pdu import ReadHoldingRegistersPDU
from tmodbus.server import AsyncTcpServer, ModbusRequestRouter
router = ModbusRequestRouter()
@router.register(ReadHoldingRegistersPDU)
async def read(unit_id, request):
    return [0] * request.quantity
async def main():
    await AsyncTcpServer("127.0.0.1", router, port=int(place)).start()
    print("ready", flush=True)
    await asyncio.Event().wait()
asyncio.run(main())
""",
}

FIELD = """
from barewire import ModbusServer, Table
import signal
with ModbusServer("rtu://pty?baudrate=115200", units={1: Table(100)}) as server:
    print(server.url.partition("?")[0].removeprefix("rtu://"), flush=True)
    signal.sigwait([signal.SIGTERM])
"""
"""Behind the clients for RTU and the gateways: a unit on a new pseudo-terminal, whose path it prints."""

MEASURED = """
import json, time
started = time.process_time()
assert len(read()) == 10
first = time.process_time()
for _ in range(count): read()
took = time.process_time() - first
peak = next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(json.dumps({"start": first, "request": took / count, "memory": int(peak) * 1024}))
"""
"""The end of a blocking client."""

MEASURED_ASYNC = """
import asyncio, json, time
async def measure():
    assert len(await read()) == 10
    first = time.process_time()
    for _ in range(count): await read()
    took = time.process_time() - first
    peak = next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM"))
    print(json.dumps({"start": first, "request": took / count, "memory": int(peak) * 1024}), flush=True)
asyncio.run(measure())
"""
"""The end of a client for asyncio."""
