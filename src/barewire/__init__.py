"""barewire: Modbus (RTU, ASCII, TCP) and CANopen in pure Python, from the first bit of a CRC to a named value.

    with barewire.ModbusClient("tcp://10.0.0.7", unit=1, timeout=0.5) as plc:
        plc.read_holding_registers(0, 2)
    async with barewire.AsyncModbusClient("rtu:///dev/ttyUSB0?baudrate=19200") as line:
        await line.at(unit=3).read_coils(0, 8)
    with barewire.ModbusServer("tcp://127.0.0.1:0", units={1: barewire.Table()}) as server:
        print(server.url)

    with barewire.CanopenClient("can://socketcan/can0") as bus:
        node = bus.node(5, device="az3")
        node.read("STATUS WORD"), node.sdo.upload(0x6041, 0), node.nmt.start()
    with barewire.CanopenServer("can://memory/x?node=5", device="az3") as server: ...

    with barewire.connect("az3", "can://socketcan/can0?node=5") as az3:          # a machine by name, on any bus
        az3["TARGET VELOCITY"] = 1500

The options of a URL and keyword arguments are the same options. Behind this door, in the order to read them:

    barewire.errors, barewire.conversation         the errors; requests and time-outs without a clock
    barewire.codecs     values and bytes: orders, floats, text
    barewire.modbus     Modbus messages, the client's and the server's side of a line
    barewire.rtu, barewire.ascii, barewire.tcp     the three kinds of frame that carry a Modbus message
    barewire.canopen    CAN frames, SDO, PDO, NMT, EMCY, SYNC, LSS, EDS
    barewire.devices    names, units and places of the values of a device; drives; simulators
    barewire.io         clients and servers on real ports; the rooms before it have no clock and no socket
    barewire.gateway    the program that shares lines between clients, and publishes their values to a broker

`import barewire` loads none of them: a name loads its file when it is first used.
"""

from barewire._lazy import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from barewire.canopen.abort_codes import SdoAbort as SdoAbort
    from barewire.devices.description.load import load as load
    from barewire.devices.device import UnknownName as UnknownName
    from barewire.devices.drive import DriveStuck as DriveStuck
    from barewire.errors import (
        BarewireError as BarewireError,
        DecodeError as DecodeError,
        EncodeError as EncodeError,
        NoAnswer as NoAnswer,
        PortError as PortError,
        Refused as Refused,
    )
    from barewire.io.canopen.async_client import AsyncCanopenClient as AsyncCanopenClient
    from barewire.io.canopen.client import CanopenClient as CanopenClient
    from barewire.io.machine import connect as connect, connect_async as connect_async
    from barewire.io.modbus.async_client import AsyncModbusClient as AsyncModbusClient
    from barewire.io.modbus.client import ModbusClient as ModbusClient
    from barewire.io.server.can import AsyncCanopenServer as AsyncCanopenServer, CanopenServer as CanopenServer
    from barewire.io.server.modbus import AsyncModbusServer as AsyncModbusServer, ModbusServer as ModbusServer
    from barewire.modbus.client.line_state import WriteOutcomeUnknown as WriteOutcomeUnknown
    from barewire.modbus.exceptions import ModbusException as ModbusException
    from barewire.modbus.server.table import Table as Table

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy(
    __name__,
    {
        # Modbus
        "io.modbus.client": "ModbusClient",
        "io.modbus.async_client": "AsyncModbusClient",
        "io.server.modbus": "ModbusServer AsyncModbusServer",
        "modbus.server.table": "Table",
        # CANopen
        "io.canopen.client": "CanopenClient",
        "io.canopen.async_client": "AsyncCanopenClient",
        "io.server.can": "CanopenServer AsyncCanopenServer",
        # A machine by name
        "io.machine": "connect connect_async",
        "devices.description.load": "load",
        # Errors
        "errors": "BarewireError EncodeError DecodeError Refused NoAnswer PortError",
        "modbus.exceptions": "ModbusException",
        "modbus.client.line_state": "WriteOutcomeUnknown",
        "canopen.abort_codes": "SdoAbort",
        "devices.device": "UnknownName",
        "devices.drive": "DriveStuck",
    },
)
__all__ += ["__version__"]
