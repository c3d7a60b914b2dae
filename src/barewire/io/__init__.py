"""Input and output: carries out conversations on real ports. Below `gateway` only this room has clocks and sockets.

    endpoint           URLs and their options       adapter   serial adapters that return under another name
    engine/            carries out a conversation or an exchange: blocking, asyncio, and the fast path
    ports/             TCP, UDP, TLS, serial ports, pseudo-terminals, CAN buses
    modbus/            ModbusClient, AsyncModbusClient
    canopen/           CanopenClient, AsyncCanopenClient, shared buses, nodes that run on them
    log                what is logged, and the limit of lines
    machine            a machine by name, on Modbus or CANopen; `named_values`: its values; `drive`: its motion
    fault_injection/   faults in the answers of a server
    server/            ModbusServer, AsyncModbusServer, CanopenServer; their limits

`barewire` itself exports the clients, servers and machines; this package exports the rest.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.io.canopen.bus.shared_bus import CanBus as CanBus
    from barewire.io.canopen.bus.subscriber import BusDown as BusDown, BusUp as BusUp, FramesLost as FramesLost
    from barewire.io.endpoint import Endpoint as Endpoint
    from barewire.io.engine.blocking import run as run
    from barewire.io.ports.base import Port as Port

__getattr__, __dir__, __all__ = lazy(
    __name__,
    {
        "endpoint": "Endpoint",
        "engine.blocking": "run",
        "ports.base": "Port",
        "canopen.bus.shared_bus": "CanBus",
        "canopen.bus.subscriber": "FramesLost BusDown BusUp",
    },
)
