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

from barewire.door import lazy

TYPE_CHECKING = False  # see `barewire.record`
if TYPE_CHECKING:
    from barewire.modbus.adu import BROADCAST, PDU_LIMIT, Adu, Noise
    from barewire.modbus.authorise import Authorisation, Permission
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
    from barewire.modbus.bus import Bus
    from barewire.modbus.canopen_reference import CanopenReference, CanopenReferenceResponse
    from barewire.modbus.combined import (
        MaskWriteRegister,
        MaskWriteRegisterResponse,
        ReadWriteMultipleRegisters,
        ReadWriteMultipleRegistersResponse,
    )
    from barewire.modbus.counters import Counters
    from barewire.modbus.diagnostics import (
        Diagnostics,
        DiagnosticsResponse,
        ReadExceptionStatus,
        ReadExceptionStatusResponse,
        Unanswered,
    )
    from barewire.modbus.echo import EchoLine
    from barewire.modbus.events import (
        GetCommEventCounter,
        GetCommEventCounterResponse,
        GetCommEventLog,
        GetCommEventLogResponse,
        event_text,
    )
    from barewire.modbus.exceptions import EXCEPTIONS, ModbusException, exception_name
    from barewire.modbus.fifo import ReadFifoQueue, ReadFifoQueueResponse
    from barewire.modbus.files import (
        FileRecord,
        ReadFileRecord,
        ReadFileRecordResponse,
        RecordPlace,
        WriteFileRecord,
        WriteFileRecordResponse,
    )
    from barewire.modbus.functions import decode_request, decode_response, register
    from barewire.modbus.handlers import Functions
    from barewire.modbus.identification import (
        ReadDeviceIdentification,
        ReadDeviceIdentificationResponse,
        ReportServerId,
        ReportServerIdResponse,
    )
    from barewire.modbus.identity import Identity
    from barewire.modbus.inquiry import Identification, identify
    from barewire.modbus.line import Line
    from barewire.modbus.lost import LateReply, WriteOutcomeUnknown
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
    from barewire.modbus.sdo_abort import ExtendedExceptionResponse, SdoAborted
    from barewire.modbus.serve import Reply, Server, Unit
    from barewire.modbus.table import Table
    from barewire.modbus.talk import ask, tell
    from barewire.modbus.tally import Tally
    from barewire.modbus.turns import Turns

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
    "Turns",
    "Authorisation",
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
    "Tally",
    "Unit",
    "Counters",
    "Functions",
    "Table",
]

# Which file holds what. Only that one is loaded, with what it needs: an envelope asks for `Adu` and gets no messages.
_FILES = {
    "adu": "BROADCAST PDU_LIMIT Adu Noise",
    "authorise": "Authorisation Permission",
    "bits": (
        "ReadCoils ReadCoilsResponse ReadDiscreteInputs ReadDiscreteInputsResponse WriteMultipleCoils "
        "WriteMultipleCoilsResponse WriteSingleCoil WriteSingleCoilResponse"
    ),
    "bus": "Bus",
    "canopen_reference": "CanopenReference CanopenReferenceResponse",
    "combined": (
        "MaskWriteRegister MaskWriteRegisterResponse ReadWriteMultipleRegisters ReadWriteMultipleRegistersResponse"
    ),
    "counters": "Counters",
    "diagnostics": "Diagnostics DiagnosticsResponse ReadExceptionStatus ReadExceptionStatusResponse Unanswered",
    "echo": "EchoLine",
    "events": "GetCommEventCounter GetCommEventCounterResponse GetCommEventLog GetCommEventLogResponse event_text",
    "exceptions": "EXCEPTIONS ModbusException exception_name",
    "fifo": "ReadFifoQueue ReadFifoQueueResponse",
    "files": "FileRecord ReadFileRecord ReadFileRecordResponse RecordPlace WriteFileRecord WriteFileRecordResponse",
    "functions": "decode_request decode_response register",
    "handlers": "Functions",
    "identification": "ReadDeviceIdentification ReadDeviceIdentificationResponse ReportServerId ReportServerIdResponse",
    "identity": "Identity",
    "inquiry": "Identification identify",
    "line": "Line",
    "lost": "LateReply WriteOutcomeUnknown",
    "message": "ExceptionResponse Message Request Response",
    "registers": (
        "ReadHoldingRegisters ReadHoldingRegistersResponse ReadInputRegisters ReadInputRegistersResponse "
        "WriteMultipleRegisters WriteMultipleRegistersResponse WriteSingleRegister "
        "WriteSingleRegisterResponse"
    ),
    "sdo_abort": "ExtendedExceptionResponse SdoAborted",
    "serve": "Reply Server Unit",
    "table": "Table",
    "tally": "Tally",
    "talk": "ask tell",
    "turns": "Turns",
}

__getattr__ = lazy(__name__, _FILES)
