"""THE ONLY ROOM WITH CLOCKS AND SOCKETS. Here conversations are carried out on real ports.

    blocking       the engine that waits                 aio            the same engine with await
    modbus_client  the blocking client, by URL           aio_client, aio_connection    the same words for asyncio
    plain          the exchange in which nothing goes wrong, without a conversation
    verbs          read_holding_registers and the like, for both
    client         CANopen, and any client by URL        aio_canopen    the same words for asyncio
    can_verbs, can_verbs_more    upload, tell_nmt, fastscan and the like, for both; can_words  how that is done
    can_fan        one reader of a bus for all, can_tap what each hears of it, aio_can the same for tasks
    can_stream     what is heard, as events              can_run, aio_run    machines that speak by themselves
    drive          a drive behind a client
    host           servers, devices, simulators by URL   host_tcp, host_network, host_serial, host_can   one for each
    aio_server, aio_port_servers    asyncio servers      guests         limits of connections; watching  who spoke
    endpoint, url  URLs taken apart                      carriers       what carries Modbus: line and port for a URL
    back_off       when to connect again                 taps           watching what passes
    tls            certificates, roles                   tls_session    TLS of a server's connection, as a machine

    tcp_socket, serial_port, pseudo_terminal, can_bus, aio_serial, aio_dial     the ports; pyserial and python-can stand
                                                                                here only

        open_modbus("rtu:///dev/ttyUSB0?unit=1")     open_canopen("can://socketcan/can0?node=1")
        open_host("tcp://127.0.0.1:1502", units={1: Table()})

I know: ports, clocks, threads, tasks, and how each of them fails.  I never know: what a byte means.  The command, your
programs, tests and bench import me; nothing below does.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.io.canopen.async_client import (
        AsyncCanopenClient as AsyncCanopenClient,
        open_canopen_async as open_canopen_async,
    )
    from barewire.io.canopen.client import (
        CanopenClient as CanopenClient,
        connect as connect,
        open_bus as open_bus,
        open_canopen as open_canopen,
    )
    from barewire.io.canopen.shared_bus import CanBus as CanBus
    from barewire.io.canopen.subscriber import BusDown as BusDown, BusUp as BusUp, FramesLost as FramesLost
    from barewire.io.endpoint import Endpoint as Endpoint
    from barewire.io.engine.blocking import Port as Port, run as run
    from barewire.io.modbus.async_client import (
        AsyncModbusClient as AsyncModbusClient,
        open_async as open_async,
        open_tcp as open_tcp,
    )
    from barewire.io.modbus.client import ModbusClient as ModbusClient, open_modbus as open_modbus
    from barewire.io.server.asyncio_stream import serve as serve, serve_tcp as serve_tcp
    from barewire.io.server.open import Host as Host, open_host as open_host

__getattr__, __all__ = lazy(
    __name__,
    {
        "endpoint": "Endpoint",
        "engine.blocking": "Port run",
        "modbus.client": "ModbusClient open_modbus",
        "canopen.client": "CanopenClient connect open_canopen open_bus",
        "canopen.shared_bus": "CanBus",
        "canopen.subscriber": "FramesLost BusDown BusUp",
        "modbus.async_client": "AsyncModbusClient open_async open_tcp",
        "canopen.async_client": "AsyncCanopenClient open_canopen_async",
        "server.asyncio_stream": "serve serve_tcp",
        "server.open": "Host open_host",
    },
)
