"""THE LETTER: what Modbus says, whatever carries it. Messages are values, a client has one verb.

    request:   unit | function code | data          ask(line, unit, ReadHoldingRegisters(107, 3))
    response:  unit | function code | data          -> ReadHoldingRegistersResponse(registers=(555, 0, 100))
    or:        unit | function code + 80h | code    -> ModbusException

    messages    bits, registers, combined, files, fifo, diagnostics, events, identification, canopen_reference,
                sdo_abort
    message     what a message is
    functions   which class for which function code  adu         what an envelope delivers
    line        what an envelope must offer          exceptions  how a server declines
    a client    talk (a turn of talk), bus and lost (what is remembered between two questions), turns (who may ask
                next), inquiry (all that a device says about itself)
    a server    serve (the machine), tally and counters (what it has seen), identity (who it is), authorise (who may do
                what)
    its units   table (all in memory), handlers (plain functions)
    both        echo (a line that hears itself), conform (what every server must do, as data)
    neither     sniff, sniff_numbered (listening in: requests and responses put together)

I know: function codes, their fields and limits, turns of talk.  I never know: checksums, delimiters, ports, clocks;
what a register means.  Everybody but `codecs` and `canopen` may import me; I import no envelope.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.modbus.adu import BROADCAST, PDU_LIMIT, Adu, Noise
    from barewire.modbus.client.bus import Bus
    from barewire.modbus.client.exchange import ask, tell
    from barewire.modbus.client.fair_queue import FairQueue
    from barewire.modbus.client.line_state import LateReply, WriteOutcomeUnknown
    from barewire.modbus.client.read_identification import Identification, identify
    from barewire.modbus.echo import EchoLine
    from barewire.modbus.exceptions import EXCEPTIONS, ModbusException, exception_name
    from barewire.modbus.framing import Line
    from barewire.modbus.messages.base import ExceptionResponse, Message, Request, Response
    from barewire.modbus.messages.canopen_reference import CanopenReference, CanopenReferenceResponse
    from barewire.modbus.messages.coils import (
        ReadCoils,
        ReadCoilsResponse,
        ReadDiscreteInputs,
        ReadDiscreteInputsResponse,
        WriteMultipleCoils,
        WriteMultipleCoilsResponse,
        WriteSingleCoil,
        WriteSingleCoilResponse,
    )
    from barewire.modbus.messages.combined import (
        MaskWriteRegister,
        MaskWriteRegisterResponse,
        ReadWriteMultipleRegisters,
        ReadWriteMultipleRegistersResponse,
    )
    from barewire.modbus.messages.comm_events import (
        GetCommEventCounter,
        GetCommEventCounterResponse,
        GetCommEventLog,
        GetCommEventLogResponse,
        event_text,
    )
    from barewire.modbus.messages.diagnostics import (
        Diagnostics,
        DiagnosticsResponse,
        ReadExceptionStatus,
        ReadExceptionStatusResponse,
        Unanswered,
    )
    from barewire.modbus.messages.fifo import ReadFifoQueue, ReadFifoQueueResponse
    from barewire.modbus.messages.files import (
        FileRecord,
        ReadFileRecord,
        ReadFileRecordResponse,
        RecordPlace,
        WriteFileRecord,
        WriteFileRecordResponse,
    )
    from barewire.modbus.messages.identification import (
        ReadDeviceIdentification,
        ReadDeviceIdentificationResponse,
        ReportServerId,
        ReportServerIdResponse,
    )
    from barewire.modbus.messages.registers import (
        ReadHoldingRegisters,
        ReadHoldingRegistersResponse,
        ReadInputRegisters,
        ReadInputRegistersResponse,
        WriteMultipleRegisters,
        WriteMultipleRegistersResponse,
        WriteSingleRegister,
        WriteSingleRegisterResponse,
    )
    from barewire.modbus.messages.registry import decode_request, decode_response, register
    from barewire.modbus.messages.sdo_abort import ExtendedExceptionResponse, SdoAborted
    from barewire.modbus.server.authorization import Authorization, Permission
    from barewire.modbus.server.handlers import Functions
    from barewire.modbus.server.identity import Identity
    from barewire.modbus.server.serial_counters import SerialCounters
    from barewire.modbus.server.server import Reply, Server, Unit
    from barewire.modbus.server.statistics import ServerStatistics
    from barewire.modbus.server.table import Table

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
    "Unanswered",
    "GetCommEventCounter",
    "GetCommEventCounterResponse",
    "GetCommEventLog",
    "GetCommEventLogResponse",
    "event_text",
    "MaskWriteRegister",
    "MaskWriteRegisterResponse",
    "ReadWriteMultipleRegisters",
    "ReadWriteMultipleRegistersResponse",
    "ReadFifoQueue",
    "ReadFifoQueueResponse",
    "FileRecord",
    "RecordPlace",
    "ReadFileRecord",
    "ReadFileRecordResponse",
    "WriteFileRecord",
    "WriteFileRecordResponse",
    "CanopenReference",
    "CanopenReferenceResponse",
    "ExtendedExceptionResponse",
    "SdoAborted",
    "Bus",
    "LateReply",
    "WriteOutcomeUnknown",
    "EchoLine",
    "FairQueue",
    "Authorization",
    "Permission",
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
    "Identification",
    "Identity",
    "identify",
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
    "ServerStatistics",
    "Unit",
    "SerialCounters",
    "Functions",
    "Table",
]

# Which file holds what. Only that one is loaded, with what it needs: an envelope asks for `Adu` and gets no messages.
_FILES = {
    "adu": "BROADCAST PDU_LIMIT Adu Noise",
    "server.authorization": "Authorization Permission",
    "messages.coils": (
        "ReadCoils ReadCoilsResponse ReadDiscreteInputs ReadDiscreteInputsResponse WriteMultipleCoils "
        "WriteMultipleCoilsResponse WriteSingleCoil WriteSingleCoilResponse"
    ),
    "client.bus": "Bus",
    "messages.canopen_reference": "CanopenReference CanopenReferenceResponse",
    "messages.combined": (
        "MaskWriteRegister MaskWriteRegisterResponse ReadWriteMultipleRegisters ReadWriteMultipleRegistersResponse"
    ),
    "server.serial_counters": "SerialCounters",
    "messages.diagnostics": (
        "Diagnostics DiagnosticsResponse ReadExceptionStatus ReadExceptionStatusResponse Unanswered"
    ),
    "echo": "EchoLine",
    "messages.comm_events": (
        "GetCommEventCounter GetCommEventCounterResponse GetCommEventLog GetCommEventLogResponse event_text"
    ),
    "exceptions": "EXCEPTIONS ModbusException exception_name",
    "messages.fifo": "ReadFifoQueue ReadFifoQueueResponse",
    "messages.files": (
        "FileRecord ReadFileRecord ReadFileRecordResponse RecordPlace WriteFileRecord WriteFileRecordResponse"
    ),
    "messages.registry": "decode_request decode_response register",
    "server.handlers": "Functions",
    "messages.identification": (
        "ReadDeviceIdentification ReadDeviceIdentificationResponse ReportServerId ReportServerIdResponse"
    ),
    "server.identity": "Identity",
    "client.read_identification": "Identification identify",
    "framing": "Line",
    "client.line_state": "LateReply WriteOutcomeUnknown",
    "messages.base": "ExceptionResponse Message Request Response",
    "messages.registers": (
        "ReadHoldingRegisters ReadHoldingRegistersResponse ReadInputRegisters ReadInputRegistersResponse "
        "WriteMultipleRegisters WriteMultipleRegistersResponse WriteSingleRegister "
        "WriteSingleRegisterResponse"
    ),
    "messages.sdo_abort": "ExtendedExceptionResponse SdoAborted",
    "server.server": "Reply Server Unit",
    "server.table": "Table",
    "server.statistics": "ServerStatistics",
    "client.exchange": "ask tell",
    "client.fair_queue": "FairQueue",
}

__getattr__ = lazy(__name__, _FILES)
