"""THE LETTER: what Modbus says, whatever carries it. Messages are values, a client has one verb.

    request:   unit | function code | data          ask(line, unit, ReadHoldingRegisters(107, 3))
    response:  unit | function code | data          -> ReadHoldingRegistersResponse(registers=(555, 0, 100))
    or:        unit | function code + 80h | code    -> ModbusException

    message     what a message is                    bits, registers, diagnostics, identification    the messages
    functions   which class for which function code  adu         what an envelope delivers
    talk        the client's turn of talk            serve       the server, as a machine
    line        what an envelope must offer          table       a ready unit: four tables in memory
    exceptions  how a server declines                bus         what is remembered between two questions

I know: function codes, their fields and limits, turns of talk.  I never know: checksums, delimiters, ports, clocks;
what a register means.  Everybody but `codecs` and `canopen` may import me; I import no envelope.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from barewire.modbus.adu import BROADCAST, PDU_LIMIT, Adu, Noise
    from barewire.modbus.bits import (
        ReadCoils,
        ReadCoilsResponse,
        ReadDiscreteInputs,
        ReadDiscreteInputsResponse,
        WriteMultipleCoils,
        WriteMultipleCoilsResponse,
        WriteSingleCoil,
        WriteSingleCoilResponse,
    )
    from barewire.modbus.bus import Bus, LateReply, WriteOutcomeUnknown
    from barewire.modbus.diagnostics import (
        Diagnostics,
        DiagnosticsResponse,
        ReadExceptionStatus,
        ReadExceptionStatusResponse,
    )
    from barewire.modbus.exceptions import EXCEPTIONS, ModbusException, exception_name
    from barewire.modbus.functions import decode_request, decode_response, register
    from barewire.modbus.identification import (
        ReadDeviceIdentification,
        ReadDeviceIdentificationResponse,
        ReportServerId,
        ReportServerIdResponse,
    )
    from barewire.modbus.line import Line
    from barewire.modbus.message import ExceptionResponse, Message, Request, Response
    from barewire.modbus.registers import (
        ReadHoldingRegisters,
        ReadHoldingRegistersResponse,
        ReadInputRegisters,
        ReadInputRegistersResponse,
        WriteMultipleRegisters,
        WriteMultipleRegistersResponse,
        WriteSingleRegister,
        WriteSingleRegisterResponse,
    )
    from barewire.modbus.serve import Reply, Server, Tally, Unit
    from barewire.modbus.table import Table
    from barewire.modbus.talk import ask, tell

__all__ = [
    "BROADCAST",
    "PDU_LIMIT",
    "Adu",
    "Noise",
    "ask",
    "tell",
    "ReadCoils",
    "ReadCoilsResponse",
    "ReadDiscreteInputs",
    "ReadDiscreteInputsResponse",
    "WriteMultipleCoils",
    "WriteMultipleCoilsResponse",
    "WriteSingleCoil",
    "WriteSingleCoilResponse",
    "Diagnostics",
    "DiagnosticsResponse",
    "Bus",
    "LateReply",
    "WriteOutcomeUnknown",
    "ReadExceptionStatus",
    "ReadExceptionStatusResponse",
    "EXCEPTIONS",
    "ModbusException",
    "exception_name",
    "decode_request",
    "decode_response",
    "register",
    "ReadDeviceIdentification",
    "ReadDeviceIdentificationResponse",
    "ReportServerId",
    "ReportServerIdResponse",
    "Line",
    "ExceptionResponse",
    "Message",
    "Request",
    "Response",
    "ReadHoldingRegisters",
    "ReadHoldingRegistersResponse",
    "ReadInputRegisters",
    "ReadInputRegistersResponse",
    "WriteMultipleRegisters",
    "WriteMultipleRegistersResponse",
    "WriteSingleRegister",
    "WriteSingleRegisterResponse",
    "Reply",
    "Server",
    "Tally",
    "Unit",
    "Table",
]

# Loaded when asked for, the light ones first: an envelope needs `adu` only and must not pay for all the messages.
_FILES = (
    "adu",
    "exceptions",
    "line",
    "message",
    "bits",
    "registers",
    "diagnostics",
    "identification",
    "functions",
    "bus",
    "talk",
    "serve",
    "table",
)


def __getattr__(name: str) -> Any:
    if name in __all__:
        for file in _FILES:
            module = import_module(f"{__name__}.{file}")
            if name in vars(module):
                return vars(module)[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
