"""Every message: bytes and back, limits at both ends, lengths told from beginnings, fields, and refusals."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barewire.errors import DecodeError, EncodeError
from barewire.modbus import (
    Diagnostics,
    DiagnosticsResponse,
    ExceptionResponse,
    Message,
    ReadCoils,
    ReadCoilsResponse,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
    ReadDiscreteInputs,
    ReadDiscreteInputsResponse,
    ReadExceptionStatus,
    ReadExceptionStatusResponse,
    ReadHoldingRegisters,
    ReadHoldingRegistersResponse,
    ReadInputRegisters,
    ReadInputRegistersResponse,
    ReportServerId,
    ReportServerIdResponse,
    Response,
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
from barewire.modbus.functions import AnyRequest, known, measure_request, measure_response
from tests.helpers import modest, readable, refused, unhex

ADDRESS = WORD = st.integers(0, 0xFFFF)
BYTE = st.integers(0, 0xFF)
REGISTERS = st.lists(WORD, min_size=1, max_size=125).map(tuple)
# A response decoded alone holds whole bytes of bits.
WHOLE_BYTES = st.lists(st.booleans(), min_size=1, max_size=250).map(
    lambda bits: tuple(b for b in bits for _ in range(8))
)
OBJECTS = st.lists(st.tuples(BYTE, st.binary(max_size=30)), max_size=7).map(tuple)

REQUESTS: dict[type[AnyRequest], st.SearchStrategy[AnyRequest]] = {
    ReadCoils: st.builds(ReadCoils, ADDRESS, st.integers(1, 2000)),
    ReadDiscreteInputs: st.builds(ReadDiscreteInputs, ADDRESS, st.integers(1, 2000)),
    ReadHoldingRegisters: st.builds(ReadHoldingRegisters, ADDRESS, st.integers(1, 125)),
    ReadInputRegisters: st.builds(ReadInputRegisters, ADDRESS, st.integers(1, 125)),
    WriteSingleCoil: st.builds(WriteSingleCoil, ADDRESS, st.booleans()),
    WriteSingleRegister: st.builds(WriteSingleRegister, ADDRESS, WORD),
    # Two bytes of data, as everywhere but in some echoes: those have their own tests below.
    Diagnostics: st.builds(Diagnostics, WORD, st.binary(min_size=2, max_size=2)),
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
    ReadExceptionStatusResponse: st.builds(ReadExceptionStatusResponse, BYTE),
    WriteMultipleCoilsResponse: st.builds(WriteMultipleCoilsResponse, ADDRESS, st.integers(1, 1968)),
    WriteMultipleRegistersResponse: st.builds(WriteMultipleRegistersResponse, ADDRESS, st.integers(1, 123)),
    ReportServerIdResponse: st.builds(ReportServerIdResponse, st.binary(max_size=251)),
    ReadDeviceIdentificationResponse: st.builds(
        ReadDeviceIdentificationResponse, st.integers(1, 4), BYTE, OBJECTS, st.booleans(), BYTE
    ),
    ExceptionResponse: st.builds(ExceptionResponse, st.integers(0x80, 0xFF), BYTE),
}
ANY_REQUEST = st.one_of(*REQUESTS.values())
ANY_RESPONSE = st.one_of(*RESPONSES.values())
ALL_CLASSES: list[type[Message]] = [*REQUESTS, *RESPONSES]


def test_every_known_message_is_tested_here() -> None:
    assert set(known()) == set(REQUESTS)
    assert {request.response for request in known()} | {ExceptionResponse} == set(RESPONSES)


def test_requests_are_listed_by_function_code() -> None:
    codes = [request.function_code for request in known()]
    assert codes == sorted(codes)


# There and back --------------------------------------------------------------------------------------------------


@modest
@given(ANY_REQUEST)
def test_a_request_comes_back(request: AnyRequest) -> None:
    pdu = request.encode()
    assert pdu[0] == request.function_code
    assert len(pdu) <= 253
    assert type(request).decode(pdu) == decode_request(pdu) == request


@modest
@given(ANY_RESPONSE)
def test_a_response_comes_back(response: Response) -> None:
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
        ("0F 0013 000A 02 CD01", "0F 0013 000A"),
        ("10 0001 0002 04 000A0102", "10 0001 0002"),
        ("11", "11 03 01 FF 41"),
        ("2B 0E 01 00", "2B 0E 01 01 00 00 01 00 03 54454D"),
    ],
)
def test_the_examples_that_everybody_knows(request_pdu: str, response_pdu: str) -> None:
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
def test_any_bytes_are_measured_without_stumbling(pdu: bytes) -> None:
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
        pytest.param(lambda n: ExceptionResponse(n, 1), "function_code", 0x80, 0xFF, id="exception"),
        pytest.param(lambda n: ExceptionResponse(0x83, n), "exception_code", 0, 0xFF, id="exception"),
    ],
)
def test_both_limits_can_be_said_and_one_beyond_cannot(make: Any, field: str, low: int, high: int) -> None:
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
def test_rows_have_at_least_one_and_at_most_as_many_as_fit(make: Any, high: int) -> None:
    for quantity in (1, high):
        assert len(make(quantity).encode()) <= 253
    for quantity in (0, high + 1):
        with refused(EncodeError, f"quantity = {quantity}: expected 1..{high}"):
            make(quantity)


@pytest.mark.parametrize("value", [-1, 0x10000, 1.5])
def test_each_register_is_checked_when_the_message_is_made(value: int) -> None:
    with refused(EncodeError, f"register 1 of 2: {value!r} is not a whole number in 0..65535"):
        WriteMultipleRegisters(0, (0, value))


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


# Length, told from the beginning ---------------------------------------------------------------------------------


def measures_well(pdu: bytes, measure: Any) -> None:
    """It asks for more until all is there, never for less than before, and never for too much."""
    told = [measure(pdu[:length]) for length in range(1, len(pdu) + 1)]
    assert told == sorted(told)
    assert told[-1] == len(pdu)
    for length, size in enumerate(told[:-1], start=1):
        assert length < size <= len(pdu)


@modest
@given(ANY_REQUEST, st.binary(max_size=4))
def test_the_length_of_a_request_is_told_by_its_beginning(request: AnyRequest, behind: bytes) -> None:
    pdu = request.encode()
    measures_well(pdu, measure_request)
    assert measure_request(pdu + behind) == len(pdu)


@modest
@given(ANY_RESPONSE, st.binary(max_size=4))
def test_the_length_of_a_response_is_told_by_its_beginning(response: Response, behind: bytes) -> None:
    pdu = response.encode()
    measures_well(pdu, measure_response)
    assert measure_response(pdu + behind) == len(pdu)


@pytest.mark.parametrize("pdu", ["", "00", "41", "65 00", "2B 0D", "2B FF 01"])
def test_nobody_can_count_what_nobody_knows(pdu: str) -> None:
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
def test_the_fields_of_half_a_message_lie_inside_it(message: Message, data: st.DataObject) -> None:
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
        (ReadDeviceIdentification, "2B 0E 03 00", "read_code", "extended"),
        (ReadDeviceIdentification, "2B 0E 07 00", "read_code", "not defined"),
        (ReadDeviceIdentificationResponse, "2B 0E 01 01 00 00 01 02 01 31", "object_id", "MajorMinorRevision"),
        (ReadDeviceIdentificationResponse, "2B 0E 01 01 00 00 01 80 01 31", "object_id", "private"),
    ],
)
def test_a_field_says_what_its_value_means(message: type[Message], pdu: str, name: str, meaning: str) -> None:
    assert {field.name: field.meaning for field in message.fields(unhex(pdu))}[name] == meaning


# Refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pdu", "reason", "at", "text"),
    [
        ("", "short", 0, "an empty PDU has no function code"),
        ("41", "function", 0, "function 41 is not known"),
        ("2B", "function", 0, "function 2B is not known"),
        ("2B 0D 00", "function", 0, "function 2B is not known"),
        ("83 02", "function", 0, "function 83 is not known"),
        ("03 00", "short", 2, "address needs bytes 1..2"),
        ("03 0000 0001 00", "long", 5, "1 bytes are left over"),
        ("03 0000 0000", "value", 3, "quantity = 0: expected 1..125"),
        ("03 0000 007E", "value", 3, "quantity = 126: expected 1..125"),
        ("01 0000 07D1", "value", 3, "quantity = 2001: expected 1..2000"),
        ("05 0000 1234", "value", 3, "coil value 1234h: expected FF00h (on) or 0000h (off)"),
        ("0F 0000 0000 00", "value", 3, "quantity = 0: expected 1..1968"),
        ("0F 0000 0009 01 FF", "length", 5, "byte count 1 for 9 coils"),
        ("10 0000 0000 00", "value", 3, "quantity = 0: expected 1..123"),
        ("10 0000 0001 04 0001 0002", "length", 5, "byte count 4 for 1 registers"),
        ("10 0000 0001 02 00", "length", 5, "byte_count says 2, but 1 bytes of registers follow"),
        ("08 00", "short", 2, "sub_function needs bytes 1..2"),
        ("08 0001", "value", 3, "sub-function 01 has 2 bytes of data, here are 0"),
        ("08 0001 00", "value", 3, "sub-function 01 has 2 bytes of data, here are 1"),
        ("08 000B 000000", "value", 3, "sub-function 0B has 2 bytes of data, here are 3"),
        ("2B 0E 05 00", "value", 2, "read_code = 5: expected 1..4"),
        ("2B 0E 01", "short", 3, "object_id is byte 3"),
    ],
)
def test_what_is_no_request_says_where_and_why(pdu: str, reason: str, at: int, text: str) -> None:
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
        ("83 02 00", "long", 2, "1 bytes are left over behind exception_code"),
        ("03 03 000000", "length", 1, "byte count 3 is odd"),
        ("03 04 0000", "length", 1, "byte_count says 4, but 2 bytes of registers follow"),
        ("03 00", "value", 1, "quantity = 0: expected 1..125"),
        ("01 00", "value", 1, "quantity = 0: expected 1..2000"),
        ("10 0000 0000", "value", 3, "quantity = 0: expected 1..123"),
        ("2B 0E 01 01 01 00 00", "value", 4, "more follows is 01h: expected FFh or 00h"),
        ("2B 0E 01 01 00 00 01 00 03 5445", "short", 7, "object 0 of 1 is not all there"),
        ("2B 0E 01 01 00 00 02 00 01 54", "short", 10, "object 1 of 2 is not all there"),
        ("2B 0E 01 01 00 00 00 00", "long", 7, "1 bytes are left over behind 0 objects"),
        ("2B 0E 07 01 00 00 00", "value", 2, "read_code = 7: expected 1..4"),
    ],
)
def test_what_is_no_response_says_where_and_why(pdu: str, reason: str, at: int, text: str) -> None:
    with refused(DecodeError, text) as caught:
        decode_response(unhex(pdu))
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == (reason, at)


def test_another_mei_type_is_another_message() -> None:
    with refused(DecodeError, "MEI type 0Dh where 0Eh was expected"):
        ReadDeviceIdentification.decode(unhex("2B 0D 01 00"))
    with refused(DecodeError, "MEI type 0Dh where 0Eh was expected"):
        ReadDeviceIdentificationResponse.decode(unhex("2B 0D 01 01 00 00 00"))


def test_an_exception_response_has_bit_7() -> None:
    with refused(DecodeError, "function 03 is no exception: bit 7 is not set"):
        ExceptionResponse.decode(unhex("03 02"))
