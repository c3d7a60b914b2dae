"""THE ONLY ROOM WITH CLOCKS AND SOCKETS. Here conversations are carried out on real ports.

    blocking   the engine that waits                 aio        the same engine with await; TCP client and server
    client     clients by URL, blocking              host       servers, devices and simulators by URL
    endpoint   URLs taken apart                      taps       watching what passes

    tcp_socket, serial_port, pseudo_terminal, can_bus        the ports; pyserial and python-can stand here only

        open_modbus("rtu:///dev/ttyUSB0?unit=1")     open_canopen("can://socketcan/can0?node=1")
        open_host("tcp://127.0.0.1:1502", units={1: Table()})

I know: ports, clocks, threads, tasks, and how each of them fails.  I never know: what a byte means.  The command, your
programs, tests and bench import me; nothing below does.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from barewire.shells.aio import AsyncModbusClient, open_tcp, serve_tcp
    from barewire.shells.blocking import Port, run
    from barewire.shells.client import CanopenClient, ModbusClient, connect, open_canopen, open_modbus
    from barewire.shells.endpoint import Endpoint
    from barewire.shells.host import Host, open_host

__all__ = [
    "Endpoint",
    "Port",
    "run",
    "ModbusClient",
    "CanopenClient",
    "connect",
    "open_modbus",
    "open_canopen",
    "AsyncModbusClient",
    "open_tcp",
    "serve_tcp",
    "Host",
    "open_host",
]

# Loaded when asked for, the light ones first: a blocking client needs no asyncio.
_FILES = ("endpoint", "blocking", "client", "aio", "host")


def __getattr__(name: str) -> Any:
    if name in __all__:
        for file in _FILES:
            module = import_module(f"{__name__}.{file}")
            if name in vars(module):
                return vars(module)[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
