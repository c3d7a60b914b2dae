"""The messages of Modbus: a request and a response class for each function code, each with a drawing of its bytes.

    base                 the base classes of messages
    exception_response   81 to FF         a function that the server declines
    coils                01 02 05 0F      bits: coils and discrete inputs
    registers            03 04 06 10      holding and input registers
    combined             16 17            mask write; read and write in one request
    fifo                 18               a queue of registers
    files                14 15            file records
    diagnostics          07 08            the state of the server, and of its serial line
    comm_events          0B 0C            the event counter and the event log of a serial line
    identification       11 2B/0E         server ID, device identification
    canopen_reference    2B/0D            an object dictionary behind Modbus; its exception is an SDO abort
    raw                  any              a message as its bytes, for gateways
    registry             the class of a PDU, the length of a PDU from its first bytes, custom function codes

**This file is the list of the functions.** To add one, write its two classes, add them to both lists below, and the
request to `FUNCTIONS`, where `registry` finds it; `barewire.modbus` exports every name. The first list is for type
checkers, which read only import statements.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.modbus.messages.canopen_reference import (
        CanopenReference as CanopenReference,
        CanopenReferenceResponse as CanopenReferenceResponse,
        ExtendedExceptionResponse as ExtendedExceptionResponse,
        SdoAborted as SdoAborted,
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
    from barewire.modbus.messages.exception_response import ExceptionResponse as ExceptionResponse
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
    from barewire.modbus.messages.raw import RawRequest as RawRequest, RawResponse as RawResponse
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

__getattr__, __dir__, NAMES = lazy(
    __name__,
    {
        "exception_response": "ExceptionResponse",
        "coils": (
            "ReadCoils ReadCoilsResponse ReadDiscreteInputs ReadDiscreteInputsResponse WriteMultipleCoils "
            "WriteMultipleCoilsResponse WriteSingleCoil WriteSingleCoilResponse"
        ),
        "registers": (
            "ReadHoldingRegisters ReadHoldingRegistersResponse ReadInputRegisters ReadInputRegistersResponse "
            "WriteMultipleRegisters WriteMultipleRegistersResponse WriteSingleRegister "
            "WriteSingleRegisterResponse"
        ),
        "combined": (
            "MaskWriteRegister MaskWriteRegisterResponse ReadWriteMultipleRegisters ReadWriteMultipleRegistersResponse"
        ),
        "fifo": "ReadFifoQueue ReadFifoQueueResponse",
        "files": (
            "FileRecord RecordPlace ReadFileRecord ReadFileRecordResponse WriteFileRecord WriteFileRecordResponse"
        ),
        "diagnostics": "Diagnostics DiagnosticsResponse Unanswered ReadExceptionStatus ReadExceptionStatusResponse",
        "comm_events": (
            "GetCommEventCounter GetCommEventCounterResponse GetCommEventLog GetCommEventLogResponse event_text"
        ),
        "identification": (
            "ReadDeviceIdentification ReadDeviceIdentificationResponse ReportServerId ReportServerIdResponse"
        ),
        "raw": "RawRequest RawResponse",
        "canopen_reference": "CanopenReference CanopenReferenceResponse ExtendedExceptionResponse SdoAborted",
    },
)

FUNCTIONS = {
    **{0x01: "ReadCoils", 0x02: "ReadDiscreteInputs", 0x05: "WriteSingleCoil", 0x0F: "WriteMultipleCoils"},
    **{0x03: "ReadHoldingRegisters", 0x04: "ReadInputRegisters"},
    **{0x06: "WriteSingleRegister", 0x10: "WriteMultipleRegisters"},
    **{0x16: "MaskWriteRegister", 0x17: "ReadWriteMultipleRegisters", 0x18: "ReadFifoQueue"},
    **{0x14: "ReadFileRecord", 0x15: "WriteFileRecord", 0x11: "ReportServerId"},
    **{0x07: "ReadExceptionStatus", 0x08: "Diagnostics", 0x0B: "GetCommEventCounter", 0x0C: "GetCommEventLog"},
}
"""The request of each function code."""
MEI_TYPES = {0x0D: "CanopenReference", 0x0E: "ReadDeviceIdentification"}
"""The request of each MEI type, behind function code 2B [MB-APP 6.19]."""

if not TYPE_CHECKING:
    __all__ = NAMES  # a type checker would take a list that it cannot read for an empty one
