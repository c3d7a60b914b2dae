"""Every message: encode and decode, limits, lengths from the first bytes, fields, and errors."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, strategies as st

from barewire.errors import DecodeError, EncodeError
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
from barewire.modbus.messages.combined import masked
from barewire.modbus.messages.registry import AnyRequest, known_requests, measure_request, measure_response
from tests.helpers import modest, readable, refused, unhex

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


@pytest.mark.parametrize(
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


# Limits ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "field", "low", "high"),
    [
        pytest.param(lambda n: ReadCoils(n, 1), "address", 0, 0xFFFF, id="ReadCoils"),
        pytest.param(lambda n: ReadCoils(0, n), "quantity", 1, 2000, id="ReadCoils"),
        pytest.param(lambda n: ReadDiscreteInputs(0, n), "quantity", 1, 2000, id="ReadDiscreteInputs"),
        pytest.param(lambda n: ReadHoldingRegisters(n, 1), "address", 0, 0xFFFF, id="ReadHoldingRegisters"),
        pytest.param(lambda n: ReadHoldingRegisters(0, n), "quantity", 1, 125, id="ReadHoldingRegisters"),
        pytest.param(lambda n: ReadInputRegisters(0, n), "quantity", 1, 125, id="ReadInputRegisters"),
        pytest.param(lambda n: WriteSingleCoil(n, True), "address", 0, 0xFFFF, id="WriteSingleCoil"),
        pytest.param(lambda n: WriteSingleRegister(n, 0), "address", 0, 0xFFFF, id="WriteSingleRegister"),
        pytest.param(lambda n: WriteSingleRegister(0, n), "value", 0, 0xFFFF, id="WriteSingleRegister"),
        pytest.param(lambda n: WriteMultipleCoilsResponse(0, n), "quantity", 1, 1968, id="coils written"),
        pytest.param(lambda n: WriteMultipleRegistersResponse(0, n), "quantity", 1, 123, id="registers written"),
        pytest.param(lambda n: ReadExceptionStatusResponse(n), "status", 0, 0xFF, id="exception status"),
        pytest.param(lambda n: ReadDeviceIdentification(n, 0), "read_code", 1, 4, id="identification"),
        pytest.param(lambda n: ReadDeviceIdentification(1, n), "object_id", 0, 0xFF, id="identification"),
        pytest.param(lambda n: GetCommEventCounterResponse(n, 0), "status", 0, 0xFFFF, id="event counter"),
        pytest.param(lambda n: GetCommEventCounterResponse(0, n), "event_count", 0, 0xFFFF, id="event counter"),
        pytest.param(lambda n: GetCommEventLogResponse(0, 0, n, b""), "message_count", 0, 0xFFFF, id="event log"),
        pytest.param(lambda n: ReadFileRecord(((n, 0, 1),)), "file", 1, 0xFFFF, id="ReadFileRecord"),
        pytest.param(lambda n: ReadFileRecord(((1, n, 1),)), "record", 0, 9999, id="ReadFileRecord"),
        pytest.param(lambda n: WriteFileRecord(((n, 0, (0,)),)), "file", 1, 0xFFFF, id="WriteFileRecord"),
        pytest.param(lambda n: WriteFileRecord(((1, n, (0,)),)), "record", 0, 9999, id="WriteFileRecord"),
        pytest.param(lambda n: MaskWriteRegister(n, 0, 0), "address", 0, 0xFFFF, id="MaskWriteRegister"),
        pytest.param(lambda n: MaskWriteRegister(0, n, 0), "and_mask", 0, 0xFFFF, id="MaskWriteRegister"),
        pytest.param(lambda n: MaskWriteRegister(0, 0, n), "or_mask", 0, 0xFFFF, id="MaskWriteRegister"),
        pytest.param(lambda n: ReadWriteMultipleRegisters(n, 1, 0, (0,)), "read_address", 0, 0xFFFF, id="read/write"),
        pytest.param(lambda n: ReadWriteMultipleRegisters(0, n, 0, (0,)), "read_quantity", 1, 125, id="read/write"),
        pytest.param(lambda n: ReadWriteMultipleRegisters(0, 1, n, (0,)), "write_address", 0, 0xFFFF, id="read/write"),
        pytest.param(lambda n: ReadFifoQueue(n), "address", 0, 0xFFFF, id="ReadFifoQueue"),
        pytest.param(lambda n: CanopenReference.read(n, 0, count=1), "node", 1, 127, id="CanopenReference"),
        pytest.param(lambda n: CanopenReference.read(1, n, count=1), "index", 0, 0xFFFF, id="CanopenReference"),
        pytest.param(lambda n: CanopenReference.read(1, 0, n, count=1), "sub_index", 0, 0xFF, id="CanopenReference"),
        pytest.param(lambda n: CanopenReference(1, 0, 0, n, 1), "start", 0, 0xFFFF, id="CanopenReference"),
        pytest.param(lambda n: ExtendedExceptionResponse(n), "abort_code", 0, 0xFFFFFFFF, id="SDO abort"),
        pytest.param(lambda n: ExceptionResponse(n, 1), "function_code", 0x80, 0xFF, id="exception"),
        pytest.param(lambda n: ExceptionResponse(0x83, n), "exception_code", 0, 0xFF, id="exception"),
    ],
)
def test_both_limits_are_accepted_and_one_beyond_is_refused(make: Any, field: str, low: int, high: int) -> None:
    for value in (low, high):
        assert decode_of(make(value)) == make(value)
    for value in (low - 1, high + 1):
        with refused(EncodeError, f"{field} = {value}: expected {low}..{high}") as caught:
            make(value)
        assert isinstance(caught.value, EncodeError)
        assert caught.value.field == field


def decode_of(message: Message) -> Message:
    return type(message).decode(message.encode())


@pytest.mark.parametrize(
    ("make", "high"),
    [
        pytest.param(lambda n: WriteMultipleCoils(0, (True,) * n), 1968, id="WriteMultipleCoils"),
        pytest.param(lambda n: WriteMultipleRegisters(0, (0,) * n), 123, id="WriteMultipleRegisters"),
        pytest.param(lambda n: ReadCoilsResponse((True,) * n), 2000, id="ReadCoilsResponse"),
        pytest.param(lambda n: ReadHoldingRegistersResponse((0,) * n), 125, id="ReadHoldingRegistersResponse"),
    ],
)
def test_rows_have_at_least_one_value_and_at_most_as_many_as_fit(make: Any, high: int) -> None:
    for quantity in (1, high):
        assert len(make(quantity).encode()) <= 253
    for quantity in (0, high + 1):
        with refused(EncodeError, f"quantity = {quantity}: expected 1..{high}"):
            make(quantity)


@pytest.mark.parametrize("value", [-1, 0x10000, 1.5])
def test_each_register_is_checked_when_the_message_is_made(value: int) -> None:
    with refused(EncodeError, f"register 1 of 2: {value!r} is not a whole number in 0..65535"):
        WriteMultipleRegisters(0, (0, value))


@pytest.mark.parametrize(
    ("make", "low", "high", "name"),
    [
        pytest.param(lambda n: ReadWriteMultipleRegisters(0, 1, 0, (0,) * n), 1, 121, "write_quantity", id="17"),
        pytest.param(lambda n: ReadWriteMultipleRegistersResponse((0,) * n), 1, 125, "quantity", id="17 answered"),
        pytest.param(lambda n: ReadFifoQueueResponse((0,) * n), 0, 31, "fifo_count", id="18 answered"),
        pytest.param(lambda n: GetCommEventLogResponse(0, 0, 0, bytes(n)), 0, 64, "events", id="0C answered"),
    ],
)
def test_row_limits_of_the_rarer_functions(make: Any, low: int, high: int, name: str) -> None:
    for quantity in (low, high):
        assert len(make(quantity).encode()) <= 253
        assert decode_of(make(quantity)) == make(quantity)
    for quantity in {low - 1, high + 1} - {-1}:
        with refused(EncodeError, f"{name} = {quantity}: expected {low}..{high}"):
            make(quantity)


def test_file_requests_accept_as_many_groups_as_fit() -> None:
    assert len(ReadFileRecord(((1, 0, 1),) * 35).encode()) == 2 + 245
    with refused(EncodeError, "byte_count = 252: expected 7..245"):
        ReadFileRecord(((1, 0, 1),) * 36)
    with refused(EncodeError, "byte_count = 0: expected 7..245"):
        ReadFileRecord(())
    with refused(EncodeError, "length = 0: expected 1..125"):
        ReadFileRecord(((1, 0, 0),))
    assert len(WriteFileRecord(((1, 0, (0,) * 122),)).encode()) == 253
    with refused(EncodeError, "byte_count = 253: expected 9..251"):
        WriteFileRecord(((1, 0, (0,) * 123),))
    with refused(EncodeError, "byte_count = 0: expected 9..251"):
        WriteFileRecord(())
    with refused(EncodeError, "register 0 of 1: 65536"):
        WriteFileRecord(((1, 0, (0x10000,)),))


def test_a_read_of_records_whose_answer_would_not_fit_is_refused() -> None:
    ReadFileRecord(((1, 0, 124),))
    with refused(EncodeError, "the answer would have 254 bytes: more than the 253 of a PDU"):
        ReadFileRecord(((1, 0, 125),))


@pytest.mark.parametrize(
    ("sub_function", "data"),
    [(0x01, "0001"), (0x01, "00FF"), (0x02, "0001"), (0x03, "0D0A"), (0x04, "0100"), (0x0B, "0001"), (0x14, "FFFF")],
)
def test_diagnostics_refuses_data_that_its_sub_function_does_not_allow(sub_function: int, data: str) -> None:
    with refused(EncodeError, f"for sub-function {sub_function:02X}: expected") as caught:
        Diagnostics(sub_function, unhex(data))
    assert isinstance(caught.value, EncodeError)
    assert caught.value.field == "data"
    DiagnosticsResponse(sub_function, unhex(data))


def test_a_reserved_sub_function_may_have_any_data() -> None:
    assert decode_of(Diagnostics(0x99, b"\x01\x02\x03")) == Diagnostics(0x99, b"\x01\x02\x03")


def test_canopen_data_is_as_long_as_its_count() -> None:
    CanopenReference.write_to(1, 0x2000, 0, bytes(241))
    CanopenReference.write_to(1, 0x2000, 0, bytes(242), dialect="schneider")
    with refused(EncodeError, "data length = 242: expected 0..241"):
        CanopenReference.write_to(1, 0x2000, 0, bytes(242))
    with refused(EncodeError, "3 bytes of data for a count of 4"):
        CanopenReference(1, 0x2000, count=4, data=b"abc", write=True)
    with refused(EncodeError, "0 bytes of data for a count of 4"):
        CanopenReferenceResponse(1, 0x2000, count=4)
    with refused(EncodeError, "dialect 'nanotec': expected one of cia309, schneider"):
        CanopenReference(1, 0x2000, dialect="nanotec")  # type: ignore[arg-type]


def test_a_mask_write_sets_the_bits_of_the_or_mask_where_and_is_0() -> None:
    assert masked(0xABCD, ~0b110 & 0xFFFF, 0b010) == 0xABCB


def test_a_written_row_may_be_any_sequence() -> None:
    assert WriteMultipleRegisters(0, [1, 2]) == WriteMultipleRegisters(0, (1, 2))
    assert WriteMultipleCoils(0, (1, 0)) == WriteMultipleCoils(0, (True, False))


def test_an_object_longer_than_any_pdu_is_refused_at_once() -> None:
    ReadDeviceIdentificationResponse(1, 1, ((0, bytes(244)),)).encode()
    with refused(EncodeError, "object 00h has 245 bytes: more than 244 never fit a PDU"):
        ReadDeviceIdentificationResponse(1, 1, ((0, bytes(245)),))


def test_objects_that_do_not_fit_together_are_refused() -> None:
    with refused(EncodeError, "a PDU of 254 bytes: expected 1..253"):
        ReadDeviceIdentificationResponse(1, 1, ((0, bytes(200)), (1, bytes(43)))).encode()


@pytest.mark.parametrize("length", [0, 1, 2, 3, 250])
def test_query_data_may_have_any_length(length: int) -> None:
    echo = Diagnostics(0x00, bytes(length))
    assert decode_of(echo) == echo
    assert echo.read_response(echo.encode()) == DiagnosticsResponse(0x00, bytes(length))


def test_query_data_of_251_bytes_is_refused() -> None:
    with refused(EncodeError, "data length = 251: expected 0..250"):
        Diagnostics(0x00, bytes(251))


def test_a_server_id_of_252_bytes_is_refused() -> None:
    assert len(ReportServerIdResponse(bytes(251)).encode()) == 253
    with refused(EncodeError, "byte_count = 252: expected 0..251"):
        ReportServerIdResponse(bytes(252))


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


@pytest.mark.parametrize(
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


# Refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pdu", "reason", "at", "text"),
    [
        ("", "short", 0, "an empty PDU has no function code"),
        ("41", "function", 0, "function 41 is not known"),
        ("2B", "function", 0, "function 2B is not known"),
        ("2B 0C 00", "function", 0, "function 2B is not known"),
        ("83 02", "function", 0, "function 83 is not known"),
        ("03 00", "short", 2, "address needs bytes 1..2"),
        ("03 0000 0001 00", "long", 5, "1 byte is left over"),
        ("03 0000 0000", "value", 3, "quantity = 0: expected 1..125"),
        ("03 0000 007E", "value", 3, "quantity = 126: expected 1..125"),
        ("01 0000 07D1", "value", 3, "quantity = 2001: expected 1..2000"),
        ("05 0000 1234", "value", 3, "coil value 1234h: expected FF00h (on) or 0000h (off)"),
        ("0F 0000 0000 00", "value", 3, "quantity = 0: expected 1..1968"),
        ("0F 0000 0009 01 FF", "length", 5, "byte count 1 for 9 coils"),
        ("10 0000 0000 00", "value", 3, "quantity = 0: expected 1..123"),
        ("10 0000 0001 04 0001 0002", "length", 5, "byte count 4 for 1 registers"),
        ("10 0000 0001 02 00", "length", 5, "byte_count is 2, but 1 bytes of registers follow"),
        ("08 00", "short", 2, "sub_function needs bytes 1..2"),
        ("08 0001", "value", 3, "sub-function 01 has 2 bytes of data, got 0"),
        ("08 0001 00", "value", 3, "sub-function 01 has 2 bytes of data, got 1"),
        ("08 000B 000000", "value", 3, "sub-function 0B has 2 bytes of data, got 3"),
        ("08 0001 0001", "value", 3, "data 00 01 for sub-function 01: expected 00 00 or FF 00"),
        ("14 00", "value", 1, "byte_count = 0: expected 7..245"),
        ("14 06 06 0001 0000 00", "length", 1, "byte count 6: expected groups of 7 bytes"),
        ("14 07 05 0001 0000 0001", "value", 2, "reference type 5: expected 6"),
        ("14 07 06 0000 0000 0001", "value", 3, "file = 0: expected 1..65535"),
        ("14 07 06 0001 2710 0001", "value", 5, "record = 10000: expected 0..9999"),
        ("14 07 06 0001 0000 0000", "value", 7, "length = 0: expected 1..125"),
        ("14 07 06 0001 0000 007D", "value", 1, "the answer would have 254 bytes"),
        ("15 00", "value", 1, "byte_count = 0: expected 9..251"),
        ("15 06 06 0001 0000 00", "short", 2, "a group begins here, but only 6 bytes follow"),
        ("15 09 06 0001 0000 0002 0000", "short", 9, "2 registers, but 2 bytes follow"),
        ("15 09 07 0001 0000 0001 0000", "value", 2, "reference type 7: expected 6"),
        ("16 0004 00F2", "short", 5, "or_mask needs bytes 5..6"),
        ("17 0000 0000 0000 0001 02 0000", "value", 3, "read_quantity = 0: expected 1..125"),
        ("17 0000 007E 0000 0001 02 0000", "value", 3, "read_quantity = 126: expected 1..125"),
        ("17 0000 0001 0000 0000 00", "value", 7, "write_quantity = 0: expected 1..121"),
        ("17 0000 0001 0000 0002 02 0000", "length", 9, "byte count 2 for 2 registers"),
        ("18 04", "short", 2, "address needs bytes 1..2"),
        ("2B 0D 02 00 1F 1005 00 0000 0008", "value", 2, "control 02h: expected 00h (read) or 01h (write)"),
        ("2B 0D 01 00 1F 1005 00 0000 0003 0000", "length", 10, "count 3, but 2 bytes of data where 3 belong"),
        ("2B 0D 00 1F 1005 00 0000 0002 0000", "length", 9, "count 2, but 2 bytes of data where 0 belong"),
        ("2B 0E 05 00", "value", 2, "read_code = 5: expected 1..4"),
        ("2B 0E 01", "short", 3, "object_id is byte 3"),
    ],
)
def test_a_request_that_cannot_be_decoded_gives_place_and_reason(pdu: str, reason: str, at: int, text: str) -> None:
    with refused(DecodeError, text) as caught:
        decode_request(unhex(pdu))
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == (reason, at)


@pytest.mark.parametrize(
    ("pdu", "reason", "at", "text"),
    [
        ("", "short", 0, "an empty PDU has no function code"),
        ("41", "function", 0, "function 41 is not known"),
        ("83", "short", 1, "exception_code is byte 1"),
        ("83 02 00", "long", 2, "1 byte is left over behind exception_code"),
        ("03 03 000000", "length", 1, "byte count 3 is odd"),
        ("03 04 0000", "length", 1, "byte_count is 4, but 2 bytes of registers follow"),
        ("03 00", "value", 1, "quantity = 0: expected 1..125"),
        ("01 00", "value", 1, "quantity = 0: expected 1..2000"),
        ("10 0000 0000", "value", 3, "quantity = 0: expected 1..123"),
        ("0C 09 0000 0108 0121 2000", "length", 1, "byte count 9, but 8 bytes follow"),
        ("14 04 04 06 0000", "length", 2, "length 4: expected 06 and whole registers"),
        ("14 04 05 06 0000", "short", 2, "a group of 5 bytes, but 3 follow"),
        ("14 04 03 05 0000", "value", 3, "reference type 5: expected 6"),
        ("14 00", "value", 1, "byte_count = 0: expected 4..251"),
        ("18 0005 0001 0000", "length", 1, "byte count 5, but 4 bytes follow"),
        ("18 0004 0002 0000", "length", 3, "FIFO count 2 for 2 bytes of registers"),
        ("18 0042 0020" + 32 * "0000", "value", 3, "FIFO count 32: expected 0..31"),
        ("AB FF 0007 0D EC 06020000", "value", 2, "length = 07h: expected 06h"),
        ("2B 0E 01 01 01 00 00", "value", 4, "more follows is 01h: expected FFh or 00h"),
        ("2B 0E 01 01 00 00 01 00 03 5445", "short", 7, "object 0 of 1 is incomplete"),
        ("2B 0E 01 01 00 00 02 00 01 54", "short", 10, "object 1 of 2 is incomplete"),
        ("2B 0E 01 01 00 00 00 00", "long", 7, "1 bytes are left over after 0 objects"),
        ("2B 0E 07 01 00 00 00", "value", 2, "read_code = 7: expected 1..4"),
    ],
)
def test_a_response_that_cannot_be_decoded_gives_place_and_reason(pdu: str, reason: str, at: int, text: str) -> None:
    with refused(DecodeError, text) as caught:
        decode_response(unhex(pdu))
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == (reason, at)


def test_another_mei_type_is_a_mismatch() -> None:
    with refused(DecodeError, "MEI type 0Dh where 0Eh was expected"):
        ReadDeviceIdentification.decode(unhex("2B 0D 01 00"))
    with refused(DecodeError, "MEI type 0Dh where 0Eh was expected"):
        ReadDeviceIdentificationResponse.decode(unhex("2B 0D 01 01 00 00 00"))


def test_an_exception_response_has_bit_7() -> None:
    with refused(DecodeError, "function 03 is not an exception: bit 7 is not set"):
        ExceptionResponse.decode(unhex("03 02"))


@pytest.mark.parametrize("value", [2, -1, 0xFF00, None, "on", 0.5])
def test_a_coil_value_other_than_true_or_false_is_refused(value: Any) -> None:
    """For example FF00h, the value on the wire."""
    for make in (WriteSingleCoil, WriteSingleCoilResponse):
        with refused(EncodeError, f"value = {value!r}: expected True or False") as caught:
            make(0, value)
        assert isinstance(caught.value, EncodeError)
        assert caught.value.field == "value"
    with refused(EncodeError, f"bit 1 of 2: {value!r} is not True or False"):
        WriteMultipleCoils(0, (True, value))
    with refused(EncodeError, f"bit 1 of 2: {value!r} is not True or False"):
        ReadCoilsResponse((True, value)).encode()


def test_a_coil_value_may_be_0_or_1() -> None:
    one: Any = 1  # declared as bool; programs without a type checker pass numbers
    assert WriteSingleCoil(0, one) == WriteSingleCoil(0, True)
    assert WriteSingleCoil(0, one - 1).read_response(unhex("05 0000 0000")) == WriteSingleCoilResponse(0, False)
