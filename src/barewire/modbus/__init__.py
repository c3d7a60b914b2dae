"""Modbus above the framing: messages as values, the client's conversations, the server as a machine.

    request     unit | function code | data          ask(line, unit, ReadHoldingRegisters(107, 3))
    response    unit | function code | data          -> ReadHoldingRegistersResponse(registers=(555, 0, 100))
    or          unit | function code + 80h | code    -> ModbusException                              [MB-APP 4.1, 7]

In reading order:

    adu             one frame without its framing, or noise       exceptions   exception responses and their codes
    framing         the protocol of rtu, ascii and tcp lines      echo         a line that receives its own frames
    messages/       every function code: one page per message, and the registry that finds the class of a PDU
    client/         bus (what is remembered between requests), line_state, fair_queue, read_identification
    server/         server, serial_counters, authorization, identity; ready units: table, handlers

Each name below loads only the file that defines it, so a line that needs `Adu` loads no messages. The message classes
are listed in `messages/__init__.py`.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy
from barewire.modbus.messages import NAMES as _MESSAGES

if TYPE_CHECKING:
    from barewire.modbus.adu import BROADCAST as BROADCAST, PDU_LIMIT as PDU_LIMIT, Adu as Adu, Noise as Noise
    from barewire.modbus.client.bus import Bus as Bus
    from barewire.modbus.client.fair_queue import FairQueue as FairQueue, Ticket as Ticket
    from barewire.modbus.client.line_state import (
        LateReply as LateReply,
        UnitOptions as UnitOptions,
        WriteOutcomeUnknown as WriteOutcomeUnknown,
    )
    from barewire.modbus.client.read_identification import (
        DeviceIdentification as DeviceIdentification,
        read_device_identification as read_device_identification,
    )
    from barewire.modbus.echo import EchoLine as EchoLine
    from barewire.modbus.exceptions import (
        EXCEPTIONS as EXCEPTIONS,
        ModbusException as ModbusException,
        exception_name as exception_name,
    )
    from barewire.modbus.framing import Line as Line
    from barewire.modbus.messages import *  # noqa: F403  # every message class
    from barewire.modbus.messages.base import Message as Message, Request as Request, Response as Response
    from barewire.modbus.messages.registry import (
        decode_request as decode_request,
        decode_response as decode_response,
        register as register,
    )
    from barewire.modbus.server.authorization import Authorization as Authorization, Permission as Permission
    from barewire.modbus.server.handlers import Functions as Functions
    from barewire.modbus.server.identity import Identity as Identity
    from barewire.modbus.server.serial_counters import SerialCounters as SerialCounters
    from barewire.modbus.server.server import (
        AnyUnit as AnyUnit,
        Caller as Caller,
        Delayed as Delayed,
        LaterResponse as LaterResponse,
        PduUnit as PduUnit,
        Reply as Reply,
        Server as Server,
        ServerStatistics as ServerStatistics,
        Unit as Unit,
    )
    from barewire.modbus.server.table import Table as Table

__getattr__, __dir__, __all__ = lazy(
    __name__,
    {
        "adu": "BROADCAST PDU_LIMIT Adu Noise",
        "exceptions": "EXCEPTIONS ModbusException exception_name",
        "framing": "Line",
        "echo": "EchoLine",
        "messages.base": "Message Request Response",
        "messages": " ".join(_MESSAGES),
        "messages.registry": "decode_request decode_response register",
        "client.bus": "Bus",
        "client.line_state": "LateReply UnitOptions WriteOutcomeUnknown",
        "client.fair_queue": "FairQueue Ticket",
        "client.read_identification": "DeviceIdentification read_device_identification",
        "server.server": "AnyUnit Caller Delayed LaterResponse PduUnit Reply Server ServerStatistics Unit",
        "server.serial_counters": "SerialCounters",
        "server.authorization": "Authorization Permission",
        "server.identity": "Identity",
        "server.table": "Table",
        "server.handlers": "Functions",
    },
)
