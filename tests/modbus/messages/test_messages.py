"""Every message: encode and decode, lengths from the first bytes, and the fields of its bytes."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, strategies as st

from barewire.modbus import (
    CanopenReference,
    CanopenReferenceResponse,
    Diagnostics,
    DiagnosticsResponse,
    ExceptionResponse,
    ExtendedExceptionResponse,
    GetCommEventCounter,
    GetCommEventCounterResponse,
    GetCommEventLog,
    GetCommEventLogResponse,
    MaskWriteRegister,
    MaskWriteRegisterResponse,
    Message,
    ReadCoils,
    ReadCoilsResponse,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
    ReadDiscreteInputs,
    ReadDiscreteInputsResponse,
    ReadExceptionStatus,
    ReadExceptionStatusResponse,
    ReadFifoQueue,
    ReadFifoQueueResponse,
    ReadFileRecord,
    ReadFileRecordResponse,
    ReadHoldingRegisters,
    ReadHoldingRegistersResponse,
    ReadInputRegisters,
    ReadInputRegistersResponse,
    ReadWriteMultipleRegisters,
    ReadWriteMultipleRegistersResponse,
    ReportServerId,
    ReportServerIdResponse,
    Response,
    WriteFileRecord,
    WriteFileRecordResponse,
    WriteMultipleCoils,
    WriteMultipleCoilsResponse,
    WriteMultipleRegisters,
    WriteMultipleRegistersResponse,
    WriteSingleCoil,
    WriteSingleCoilResponse,
    WriteSingleRegister,
    WriteSingleRegisterResponse,
    decode_request,
    decode_response,
)
from barewire.modbus.messages.registry import AnyRequest, known_requests, measure_request, measure_response
from tests.helpers import every_case, modest, readable, unhex

ADDRESS = WORD = st.integers(0, 0xFFFF)
BYTE = st.integers(0, 0xFF)
REGISTERS = st.lists(WORD, min_size=1, max_size=125).map(tuple)
# A response decoded alone holds whole bytes of bits.
WHOLE_BYTES = st.lists(st.booleans(), min_size=1, max_size=250).map(
    lambda bits: tuple(b for b in bits for _ in range(8))
)
RECORD = st.integers(0, 9999)
FILE = st.integers(1, 0xFFFF)
WORDS = st.lists(WORD, min_size=1, max_size=20).map(tuple)
GROUPS = st.lists(st.tuples(FILE, RECORD, WORDS), min_size=1, max_size=5).map(tuple)
DIALECT = st.sampled_from(["cia309", "schneider"])
NODE = st.integers(1, 127)
PLACE = (NODE, WORD, BYTE, WORD)


def canopen(message: Any, has_data: bool) -> st.SearchStrategy[Any]:
    """Build either message of 2B/0D. `has_data`: writes have data (requests), otherwise reads (responses)."""
    data = st.binary(max_size=200)
    full = st.builds(lambda d, *rest: message(*rest[:4], len(d), d, has_data, rest[4]), data, *PLACE, DIALECT)
    bare = st.builds(lambda n, *rest: message(*rest[:4], n, b"", not has_data, rest[4]), WORD, *PLACE, DIALECT)
    return st.one_of(full, bare)


OBJECTS = st.lists(st.tuples(BYTE, st.binary(max_size=30)), max_size=7).map(tuple)

REQUESTS: dict[type[AnyRequest], st.SearchStrategy[AnyRequest]] = {
    ReadCoils: st.builds(ReadCoils, ADDRESS, st.integers(1, 2000)),
    ReadDiscreteInputs: st.builds(ReadDiscreteInputs, ADDRESS, st.integers(1, 2000)),
    ReadHoldingRegisters: st.builds(ReadHoldingRegisters, ADDRESS, st.integers(1, 125)),
    ReadInputRegisters: st.builds(ReadInputRegisters, ADDRESS, st.integers(1, 125)),
    WriteSingleCoil: st.builds(WriteSingleCoil, ADDRESS, st.booleans()),
    WriteSingleRegister: st.builds(WriteSingleRegister, ADDRESS, WORD),
    # Two bytes of data, as in all messages but query data, which has its own tests below.
    Diagnostics: st.one_of(
        st.builds(Diagnostics, st.just(0), st.binary(min_size=2, max_size=2)),
        st.builds(Diagnostics, WORD, st.just(b"\0\0")),
    ),
    GetCommEventCounter: st.builds(GetCommEventCounter),
    GetCommEventLog: st.builds(GetCommEventLog),
    ReadFileRecord: st.builds(
        ReadFileRecord, st.lists(st.tuples(FILE, RECORD, st.integers(1, 10)), min_size=1, max_size=11).map(tuple)
    ),
    WriteFileRecord: st.builds(WriteFileRecord, GROUPS),
    MaskWriteRegister: st.builds(MaskWriteRegister, ADDRESS, WORD, WORD),
    ReadWriteMultipleRegisters: st.builds(
        ReadWriteMultipleRegisters,
        *(ADDRESS, st.integers(1, 125), ADDRESS, st.lists(WORD, min_size=1, max_size=121)),
    ),
    ReadFifoQueue: st.builds(ReadFifoQueue, ADDRESS),
    CanopenReference: canopen(CanopenReference, has_data=True),
    ReadExceptionStatus: st.builds(ReadExceptionStatus),
    WriteMultipleCoils: st.builds(
        WriteMultipleCoils, ADDRESS, st.lists(st.booleans(), min_size=1, max_size=1968).map(tuple)
    ),
    WriteMultipleRegisters: st.builds(WriteMultipleRegisters, ADDRESS, st.lists(WORD, min_size=1, max_size=123)),
    ReportServerId: st.builds(ReportServerId),
    ReadDeviceIdentification: st.builds(ReadDeviceIdentification, st.integers(1, 4), BYTE),
}
RESPONSES: dict[type[Response], st.SearchStrategy[Response]] = {
    ReadCoilsResponse: st.builds(ReadCoilsResponse, WHOLE_BYTES),
    ReadDiscreteInputsResponse: st.builds(ReadDiscreteInputsResponse, WHOLE_BYTES),
    ReadHoldingRegistersResponse: st.builds(ReadHoldingRegistersResponse, REGISTERS),
    ReadInputRegistersResponse: st.builds(ReadInputRegistersResponse, REGISTERS),
    WriteSingleCoilResponse: st.builds(WriteSingleCoilResponse, ADDRESS, st.booleans()),
    WriteSingleRegisterResponse: st.builds(WriteSingleRegisterResponse, ADDRESS, WORD),
    DiagnosticsResponse: st.builds(DiagnosticsResponse, WORD, st.binary(min_size=2, max_size=2)),
    GetCommEventCounterResponse: st.builds(GetCommEventCounterResponse, WORD, WORD),
    GetCommEventLogResponse: st.builds(GetCommEventLogResponse, WORD, WORD, WORD, st.binary(max_size=64)),
    ReadFileRecordResponse: st.builds(ReadFileRecordResponse, st.lists(WORDS, min_size=1, max_size=5).map(tuple)),
    WriteFileRecordResponse: st.builds(WriteFileRecordResponse, GROUPS),
    MaskWriteRegisterResponse: st.builds(MaskWriteRegisterResponse, ADDRESS, WORD, WORD),
    ReadWriteMultipleRegistersResponse: st.builds(ReadWriteMultipleRegistersResponse, REGISTERS),
    ReadFifoQueueResponse: st.builds(ReadFifoQueueResponse, st.lists(WORD, max_size=31).map(tuple)),
    CanopenReferenceResponse: canopen(CanopenReferenceResponse, has_data=False),
    ExtendedExceptionResponse: st.builds(ExtendedExceptionResponse, st.integers(0, 0xFFFFFFFF)),
    ReadExceptionStatusResponse: st.builds(ReadExceptionStatusResponse, BYTE),
    WriteMultipleCoilsResponse: st.builds(WriteMultipleCoilsResponse, ADDRESS, st.integers(1, 1968)),
    WriteMultipleRegistersResponse: st.builds(WriteMultipleRegistersResponse, ADDRESS, st.integers(1, 123)),
    ReportServerIdResponse: st.builds(ReportServerIdResponse, st.binary(max_size=251)),
    ReadDeviceIdentificationResponse: st.builds(
        ReadDeviceIdentificationResponse, st.integers(1, 4), BYTE, OBJECTS, st.booleans(), BYTE
    ),
    # AB FF begins the extended exception of 2B/0D.
    ExceptionResponse: st.builds(ExceptionResponse, st.integers(0x80, 0xFF), st.integers(0, 0xFE)),
}
ANY_REQUEST = st.one_of(*REQUESTS.values())
ANY_RESPONSE = st.one_of(*RESPONSES.values())
ALL_CLASSES: list[type[Message]] = [*REQUESTS, *RESPONSES]


def test_every_known_message_is_tested_here() -> None:
    assert set(known_requests()) == set(REQUESTS)
    assert {request.response for request in known_requests()} | {ExceptionResponse, ExtendedExceptionResponse} == set(
        RESPONSES
    )


def test_requests_are_listed_by_function_code() -> None:
    codes = [request.function_code for request in known_requests()]
    assert codes == sorted(codes)


# Encoding and decoding -------------------------------------------------------------------------------------------


@modest
@given(ANY_REQUEST)
def test_a_request_is_decoded_as_it_was_encoded(request: AnyRequest) -> None:
    pdu = request.encode()
    assert pdu[0] == request.function_code
    assert len(pdu) <= 253
    assert type(request).decode(pdu) == decode_request(pdu) == request


@modest
@given(ANY_RESPONSE)
def test_a_response_is_decoded_as_it_was_encoded(response: Response) -> None:
    pdu = response.encode()
    assert pdu[0] == response.function_code
    assert len(pdu) <= 253
    assert type(response).decode(pdu) == decode_response(pdu) == response


@every_case(
    ("request_pdu", "response_pdu"),
    [
        ("01 0013 0013", "01 03 CD6B05"),
        ("02 00C4 0016", "02 03 ACDB35"),
        ("03 006B 0003", "03 06 022B 0000 0064"),
        ("04 0008 0001", "04 02 000A"),
        ("05 00AC FF00", "05 00AC FF00"),
        ("06 0001 0003", "06 0001 0003"),
        ("07", "07 6D"),
        ("08 0000 A537", "08 0000 A537"),
        ("0B", "0B FFFF 0108"),
        ("0C", "0C 08 0000 0108 0121 2000"),
        ("0F 0013 000A 02 CD01", "0F 0013 000A"),
        ("10 0001 0002 04 000A0102", "10 0001 0002"),
        ("11", "11 03 01 FF 41"),
        ("14 0E 06 0004 0001 0002 06 0003 0009 0002", "14 0C 05 06 0DFE0020 05 06 33CD0040"),
        ("15 0D 06 0004 0007 0003 06AF04BE100D", "15 0D 06 0004 0007 0003 06AF04BE100D"),
        ("16 0004 00F2 0025", "16 0004 00F2 0025"),
        ("17 0003 0006 000E 0003 06 00FF00FF00FF", "17 0C 00FE 0ACD 0001 0003 000D 00FF"),
        ("18 04DE", "18 0006 0002 01B8 1284"),
        ("2B 0D 00 1F 1005 00 0000 0008", "2B 0D 00 1F 1005 00 0000 0004 80000000"),
        ("2B 0D 01 1F 203C 02 0000 0002 03E8", "2B 0D 01 1F 203C 02 0000 0000"),
        ("2B 0E 01 00", "2B 0E 01 01 00 00 01 00 03 54454D"),
    ],
)
def test_the_examples_of_the_standard(request_pdu: str, response_pdu: str) -> None:
    request = decode_request(unhex(request_pdu))
    assert request.encode() == unhex(request_pdu)
    assert isinstance(request.read_response(unhex(response_pdu)), request.response)


@pytest.mark.parametrize("message", ALL_CLASSES, ids=lambda message: message.__name__)
@modest
@given(data=st.data())
def test_any_bytes_are_a_message_or_a_decode_error(message: type[Message], data: st.DataObject) -> None:
    code = st.just(b"\x83") if message is ExceptionResponse else st.just(bytes([message.function_code]))
    pdu = data.draw(st.one_of(st.binary(max_size=260), st.builds(bytes.__add__, code, st.binary(max_size=20))))
    message.fields(pdu)
    readable(message.decode, pdu)


@modest
@given(st.binary(max_size=260))
def test_measuring_any_bytes_never_raises(pdu: bytes) -> None:
    for measured in (measure_request(pdu), measure_response(pdu)):
        assert measured is None or measured >= 1


# The length from the first bytes ---------------------------------------------------------------------------------


def assert_measured(pdu: bytes, measure: Any) -> None:
    """The measured length never shrinks, never exceeds the PDU, and equals it in the end."""
    measured = [measure(pdu[:length]) for length in range(1, len(pdu) + 1)]
    assert measured == sorted(measured)
    assert measured[-1] == len(pdu)
    for length, size in enumerate(measured[:-1], start=1):
        assert length < size <= len(pdu)


@modest
@given(ANY_REQUEST, st.binary(max_size=4))
def test_the_length_of_a_request_follows_from_its_first_bytes(request: AnyRequest, behind: bytes) -> None:
    pdu = request.encode()
    assert_measured(pdu, measure_request)
    assert measure_request(pdu + behind) == len(pdu)


@modest
@given(ANY_RESPONSE, st.binary(max_size=4))
def test_the_length_of_a_response_follows_from_its_first_bytes(response: Response, behind: bytes) -> None:
    pdu = response.encode()
    assert_measured(pdu, measure_response)
    assert measure_response(pdu + behind) == len(pdu)


@pytest.mark.parametrize("pdu", ["", "00", "41", "65 00", "2B 0C", "2B FF 01"])
def test_the_length_of_an_unknown_function_is_unknown(pdu: str) -> None:
    assert measure_request(unhex(pdu)) is None
    assert measure_response(unhex(pdu)) is None


# Fields ----------------------------------------------------------------------------------------------------------


@modest
@given(st.one_of(ANY_REQUEST, ANY_RESPONSE))
def test_the_fields_cover_each_byte_once(message: Message) -> None:
    pdu = message.encode()
    fields = type(message).fields(pdu)
    assert [place for field in fields for place in range(field.offset, field.offset + field.length)] == [
        *range(len(pdu))
    ]


@modest
@given(st.one_of(ANY_REQUEST, ANY_RESPONSE), st.data())
def test_the_fields_of_a_truncated_message_lie_inside_it(message: Message, data: st.DataObject) -> None:
    pdu = message.encode()
    half = pdu[: data.draw(st.integers(0, len(pdu)))]
    end = 0
    for field in type(message).fields(half):
        assert field.offset == end
        end += field.length
    assert end <= len(half)


@every_case(
    ("message", "pdu", "name", "meaning"),
    [
        (Diagnostics, "08 0004 0000", "sub_function", "Force Listen Only Mode"),
        (Diagnostics, "08 0013 0000", "sub_function", "reserved: no public sub-function"),
        (WriteSingleCoil, "05 00AC FF00", "value", "on"),
        (WriteSingleCoil, "05 00AC 0000", "value", "off"),
        (WriteSingleCoil, "05 00AC 1234", "value", "neither on (FF00h) nor off (0000h)"),
        (ExceptionResponse, "83 02", "exception_code", "illegal data address"),
        (ExceptionResponse, "83 63", "exception_code", "undefined exception code"),
        (ReadExceptionStatusResponse, "07 6D", "status", "bits 7..0: 01101101"),
        (GetCommEventCounterResponse, "0B FFFF 0108", "status", "busy with a program command"),
        (GetCommEventCounterResponse, "0B 0000 0108", "status", "ready"),
        (GetCommEventLogResponse, "0C 07 0000 0108 0121 C0", "event", "received: broadcast"),
        (GetCommEventLogResponse, "0C 07 0000 0108 0121 41", "event", "sent: exception 1..3"),
        (GetCommEventLogResponse, "0C 07 0000 0108 0121 20", "event", "undefined event"),
        (ReadDeviceIdentification, "2B 0E 03 00", "read_code", "extended"),
        (ReadDeviceIdentification, "2B 0E 07 00", "read_code", "not defined"),
        (ReadDeviceIdentificationResponse, "2B 0E 01 01 00 00 01 02 01 31", "object_id", "MajorMinorRevision"),
        (ReadDeviceIdentificationResponse, "2B 0E 01 01 00 00 01 80 01 31", "object_id", "private"),
    ],
)
def test_the_meaning_of_a_field(message: type[Message], pdu: str, name: str, meaning: str) -> None:
    assert {field.name: field.meaning for field in message.fields(unhex(pdu))}[name] == meaning
