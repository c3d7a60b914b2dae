"""PDUs that cannot be decoded: each error gives the reason, the place and what was expected."""

from __future__ import annotations

from barewire.errors import DecodeError
from barewire.modbus import (
    ExceptionResponse,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
    decode_request,
    decode_response,
)
from tests.helpers import every_case, refused, unhex


@every_case(
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


@every_case(
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
