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
    from barewire.modbus.adu import BROADCAST as BROADCAST, PDU_LIMIT as PDU_LIMIT, Adu as Adu, Noise as Noise
    from barewire.modbus.client.bus import Bus as Bus
    from barewire.modbus.client.exchange import ask as ask, tell as tell
    from barewire.modbus.client.fair_queue import FairQueue as FairQueue
    from barewire.modbus.client.line_state import LateReply as LateReply, WriteOutcomeUnknown as WriteOutcomeUnknown
    from barewire.modbus.client.read_identification import Identification as Identification, identify as identify
    from barewire.modbus.echo import EchoLine as EchoLine
    from barewire.modbus.exceptions import (
        EXCEPTIONS as EXCEPTIONS,
        ModbusException as ModbusException,
        exception_name as exception_name,
    )
    from barewire.modbus.framing import Line as Line
    from barewire.modbus.messages.base import (
        ExceptionResponse as ExceptionResponse,
        Message as Message,
        Request as Request,
        Response as Response,
    )
    from barewire.modbus.messages.canopen_reference import (
        CanopenReference as CanopenReference,
        CanopenReferenceResponse as CanopenReferenceResponse,
    )
    from barewire.modbus.messages.coils import (
        ReadCoils as ReadCoils,
        ReadCoilsResponse as ReadCoilsResponse,
        ReadDiscreteInputs as ReadDiscreteInputs,
        ReadDiscreteInputsResponse as ReadDiscreteInputsResponse,
        WriteMultipleCoils as WriteMultipleCoils,
        WriteMultipleCoilsResponse as WriteMultipleCoilsResponse,
        WriteSingleCoil as WriteSingleCoil,
        WriteSingleCoilResponse as WriteSingleCoilResponse,
    )
    from barewire.modbus.messages.combined import (
        MaskWriteRegister as MaskWriteRegister,
        MaskWriteRegisterResponse as MaskWriteRegisterResponse,
        ReadWriteMultipleRegisters as ReadWriteMultipleRegisters,
        ReadWriteMultipleRegistersResponse as ReadWriteMultipleRegistersResponse,
    )
    from barewire.modbus.messages.comm_events import (
        GetCommEventCounter as GetCommEventCounter,
        GetCommEventCounterResponse as GetCommEventCounterResponse,
        GetCommEventLog as GetCommEventLog,
        GetCommEventLogResponse as GetCommEventLogResponse,
        event_text as event_text,
    )
    from barewire.modbus.messages.diagnostics import (
        Diagnostics as Diagnostics,
        DiagnosticsResponse as DiagnosticsResponse,
        ReadExceptionStatus as ReadExceptionStatus,
        ReadExceptionStatusResponse as ReadExceptionStatusResponse,
        Unanswered as Unanswered,
    )
    from barewire.modbus.messages.fifo import (
        ReadFifoQueue as ReadFifoQueue,
        ReadFifoQueueResponse as ReadFifoQueueResponse,
    )
    from barewire.modbus.messages.files import (
        FileRecord as FileRecord,
        ReadFileRecord as ReadFileRecord,
        ReadFileRecordResponse as ReadFileRecordResponse,
        RecordPlace as RecordPlace,
        WriteFileRecord as WriteFileRecord,
        WriteFileRecordResponse as WriteFileRecordResponse,
    )
    from barewire.modbus.messages.identification import (
        ReadDeviceIdentification as ReadDeviceIdentification,
        ReadDeviceIdentificationResponse as ReadDeviceIdentificationResponse,
        ReportServerId as ReportServerId,
        ReportServerIdResponse as ReportServerIdResponse,
    )
    from barewire.modbus.messages.registers import (
        ReadHoldingRegisters as ReadHoldingRegisters,
        ReadHoldingRegistersResponse as ReadHoldingRegistersResponse,
        ReadInputRegisters as ReadInputRegisters,
        ReadInputRegistersResponse as ReadInputRegistersResponse,
        WriteMultipleRegisters as WriteMultipleRegisters,
        WriteMultipleRegistersResponse as WriteMultipleRegistersResponse,
        WriteSingleRegister as WriteSingleRegister,
        WriteSingleRegisterResponse as WriteSingleRegisterResponse,
    )
    from barewire.modbus.messages.registry import (
        decode_request as decode_request,
        decode_response as decode_response,
        register as register,
    )
    from barewire.modbus.messages.sdo_abort import (
        ExtendedExceptionResponse as ExtendedExceptionResponse,
        SdoAborted as SdoAborted,
    )
    from barewire.modbus.server.authorization import Authorization as Authorization, Permission as Permission
    from barewire.modbus.server.handlers import Functions as Functions
    from barewire.modbus.server.identity import Identity as Identity
    from barewire.modbus.server.serial_counters import SerialCounters as SerialCounters
    from barewire.modbus.server.server import Reply as Reply, Server as Server, Unit as Unit
    from barewire.modbus.server.statistics import ServerStatistics as ServerStatistics
    from barewire.modbus.server.table import Table as Table

__getattr__, __all__ = lazy(
    __name__,
    {
        "adu": "BROADCAST PDU_LIMIT Adu Noise",
        "client.exchange": "ask tell",
        "messages.coils": (
            "ReadCoils ReadCoilsResponse ReadDiscreteInputs ReadDiscreteInputsResponse WriteMultipleCoils "
            "WriteMultipleCoilsResponse WriteSingleCoil WriteSingleCoilResponse"
        ),
        "messages.diagnostics": (
            "Diagnostics DiagnosticsResponse Unanswered ReadExceptionStatus ReadExceptionStatusResponse"
        ),
        "messages.comm_events": (
            "GetCommEventCounter GetCommEventCounterResponse GetCommEventLog GetCommEventLogResponse event_text"
        ),
        "messages.combined": (
            "MaskWriteRegister MaskWriteRegisterResponse ReadWriteMultipleRegisters ReadWriteMultipleRegistersResponse"
        ),
        "messages.fifo": "ReadFifoQueue ReadFifoQueueResponse",
        "messages.files": (
            "FileRecord RecordPlace ReadFileRecord ReadFileRecordResponse WriteFileRecord WriteFileRecordResponse"
        ),
        "messages.canopen_reference": "CanopenReference CanopenReferenceResponse",
        "messages.sdo_abort": "ExtendedExceptionResponse SdoAborted",
        "client.bus": "Bus",
        "client.line_state": "LateReply WriteOutcomeUnknown",
        "echo": "EchoLine",
        "client.fair_queue": "FairQueue",
        "server.authorization": "Authorization Permission",
        "exceptions": "EXCEPTIONS ModbusException exception_name",
        "messages.registry": "decode_request decode_response register",
        "messages.identification": (
            "ReadDeviceIdentification ReadDeviceIdentificationResponse ReportServerId ReportServerIdResponse"
        ),
        "client.read_identification": "Identification identify",
        "server.identity": "Identity",
        "framing": "Line",
        "messages.base": "ExceptionResponse Message Request Response",
        "messages.registers": (
            "ReadHoldingRegisters ReadHoldingRegistersResponse ReadInputRegisters ReadInputRegistersResponse "
            "WriteMultipleRegisters WriteMultipleRegistersResponse WriteSingleRegister "
            "WriteSingleRegisterResponse"
        ),
        "server.server": "Reply Server Unit",
        "server.statistics": "ServerStatistics",
        "server.serial_counters": "SerialCounters",
        "server.handlers": "Functions",
        "server.table": "Table",
    },
)
