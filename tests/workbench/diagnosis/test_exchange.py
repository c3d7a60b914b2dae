"""A response with its request: what fits and what does not."""

from __future__ import annotations

import pytest
from hypothesis import given, settings, strategies as st

from barewire import ascii as ascii_room, rtu, tcp
from barewire.devices import load
from barewire.errors import DecodeError, EncodeError
from barewire_workbench import Explanation, explain, explain_exchange


def exchanged(request: str, response: str, unit: int = 1, answering: int = 1, **options: object) -> Explanation:
    """Explain two PDUs as RTU frames."""
    asked = rtu.encode(unit, bytes.fromhex(request)).hex(" ")
    return explain_exchange("rtu", asked, rtu.encode(answering, bytes.fromhex(response)).hex(" "), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("request_pdu", "response_pdu"),
    [
        ("03 0000 0001", "03 02 0007"),
        ("03 0000 0001", "83 02"),
        ("01 0000 000A", "01 02 FF03"),
        ("05 0001 FF00", "05 0001 FF00"),
        ("06 0001 0007", "06 0001 0007"),
        ("08 0000 1234", "08 0000 1234"),
        ("10 0001 0002 04 00010002", "10 0001 0002"),
        ("16 0004 00F2 0025", "16 0004 00F2 0025"),
        ("2B 0E 01 00", "2B 0E 01 01 00 00 01 00 01 41"),
    ],
)
def test_a_response_to_its_request_has_no_finding(request_pdu: str, response_pdu: str) -> None:
    explanation = exchanged(request_pdu, response_pdu)
    assert (explanation.valid, explanation.role, explanation.diagnosis) == (True, "response", ())


@pytest.mark.parametrize(
    ("request_pdu", "response_pdu", "code", "words"),
    [
        ("03 0000 0001", "04 02 0007", "wrong-answer", "function 04 answers, and 03 was asked"),
        ("03 0000 0001", "84 02", "wrong-answer", "function 84 answers, and 03 was asked"),
        ("03 0000 0001", "03 04 0007 0008", "wrong-answer", "2 registers where 1 was asked"),
        ("06 0001 0007", "06 0002 0007", "wrong-answer", "address 2 where 1 was asked"),
        ("03 0000 0001", "03 0000 0001", "echo", "the reader has read what it sent"),
        ("03 9C41 0001", "83 02", "address-base", "9C41h is 40001"),
        ("10 9C42 0001 02 0000", "90 02", "address-base", "the holding register with the address 0001h"),
        ("04 7531 0001", "84 02", "address-base", "the input register with the address 0000h"),
    ],
)
def test_a_response_to_another_request_is_found(request_pdu: str, response_pdu: str, code: str, words: str) -> None:
    first = exchanged(request_pdu, response_pdu).diagnosis[0]
    assert (first.code, words in first.text) == (code, True), first


@pytest.mark.parametrize(("address", "response"), [("9C41", "03 02 0007"), ("9C41", "83 03"), ("0064", "83 02")])
def test_an_address_is_only_doubted_if_it_is_the_number_of_a_manual_and_is_refused(address: str, response: str) -> None:
    assert exchanged(f"03 {address} 0001", response).diagnosis == ()


def test_another_unit_or_a_broadcast_is_found() -> None:
    assert exchanged("03 0000 0001", "03 02 0007", answering=2).diagnosis[0].text == (
        "unit 2 answers, and unit 1 was asked"
    )
    broadcast = exchanged("06 0000 0001", "06 0000 0001", unit=0)
    assert [finding.text for finding in broadcast.diagnosis] == ["a broadcast has no response"]


def test_the_transaction_of_tcp_is_compared() -> None:
    asked = tcp.encode(1, bytes.fromhex("03 0000 0001"), 0x0102).hex(" ")
    answers = {
        number: tcp.encode(1, bytes.fromhex("03 02 0007"), number).hex(" ") for number in (0x0102, 0x0201, 0x0103)
    }
    codes = {
        number: [finding.code for finding in explain_exchange("tcp", asked, answer).diagnosis]
        for number, answer in answers.items()
    }
    assert codes == {0x0102: [], 0x0201: ["header-byte-order"], 0x0103: ["wrong-answer"]}


def test_ascii_frames_are_compared_with_and_without_cr_lf() -> None:
    asked = ascii_room.encode(1, bytes.fromhex("03 0000 0001")).decode()
    answer = ascii_room.encode(1, bytes.fromhex("04 02 0007")).decode()
    for request, response in ((asked, answer), (asked.strip(), answer.strip())):
        assert explain_exchange("ascii", request, response).diagnosis[0].code == "wrong-answer"


def test_the_request_before_its_response_is_an_echo() -> None:
    asked, answer = "01 03 00 00 00 01 84 0A", "01 03 02 00 07 F9 86"
    assert explain_exchange("rtu", asked, f"{asked} {answer}").diagnosis[0].code == "echo"


@pytest.mark.parametrize("response", ["01 03 00 00", "01 03 00 00 00 01 84", "81 03 00 00 00 01 84"])
def test_the_beginning_of_the_request_is_an_echo(response: str) -> None:
    assert explain_exchange("rtu", "01 03 00 00 00 01 84 0A", response).diagnosis[0].code == "echo"


def test_the_beginning_of_a_response_that_repeats_the_request_is_a_cut_frame() -> None:
    asked = rtu.encode(1, bytes.fromhex("06 0001 0007"))
    assert explain_exchange("rtu", asked.hex(), asked[:-1].hex()).diagnosis[0].code == "cut-frame"


def test_what_is_wrong_with_the_request_or_with_the_response_alone_is_found() -> None:
    asked, answer = "01 03 00 00 00 01 84 0A", "01 03 02 00 07 F9 86"
    swapped = explain_exchange("rtu", "01 03 00 00 00 01 0A 84", answer).diagnosis
    assert [(finding.code, finding.text[:15]) for finding in swapped] == [("crc-swapped", "in the request:")]
    assert explain_exchange("rtu", answer, answer).diagnosis[0].code == "role"
    assert explain_exchange("rtu", asked, "01 03 02 00 07 86 F9").diagnosis[0].code == "crc-swapped"


# The order of words --------------------------------------------------------------------------------------------------


def test_a_float_that_is_plausible_in_another_order_only_has_that_order() -> None:
    (found,) = exchanged("03 0000 0004", "03 08 0000 4248 3333 42C7", floats="f32").diagnosis[:1]
    assert found.code == "word-order"
    assert found.text == "value 0 is 2.37772e-41 in the order ABCD, and 50 in CDAB"
    assert "plausible: CDAB" in found.proof


@pytest.mark.parametrize("registers", ["42480000", "00000000", "C2C73333"])
def test_a_plausible_float_has_no_finding(registers: str) -> None:
    assert exchanged("03 0000 0002", f"03 04 {registers}", floats="f32").diagnosis == ()


def test_without_a_type_nothing_is_said_about_the_order() -> None:
    assert exchanged("03 0000 0002", "03 04 00004248").diagnosis == ()


def test_a_device_gives_the_types_orders_and_addresses() -> None:
    az3 = load("az3")
    (found,) = exchanged("03 0004 0002", "03 04 4248 0000", device=az3).diagnosis
    assert found.text == "SPIDAC CHANNEL 1 SCALE is 2.37772e-41 in the order CDAB, and 50 in ABCD"
    assert exchanged("03 0004 0002", "03 04 0000 4248", device=az3).diagnosis == ()


# Wrong use -----------------------------------------------------------------------------------------------------------


def test_can_has_no_request_and_unreadable_text_is_refused() -> None:
    with pytest.raises(EncodeError, match="expected rtu, ascii or tcp"):
        explain_exchange("can", "605#40", "585#40")
    with pytest.raises(DecodeError, match="is not a hexadecimal digit"):
        explain_exchange("rtu", "01 0G", "01 03 02 00 07 F9 86")


@settings(max_examples=40, deadline=None, derandomize=True, database=None)
@given(
    st.sampled_from(["rtu", "ascii", "tcp"]),
    st.sampled_from(
        [bytes.fromhex("03 0000 0002"), bytes.fromhex("06 0001 0007"), bytes.fromhex("2B 0E 01 00"), b"\x41"]
    ),
    st.one_of(st.binary(min_size=1, max_size=20), st.builds(lambda rest: b"\x03" + rest, st.binary(max_size=8))),
    st.booleans(),
    st.sampled_from([None, "f32", "f64"]),
)
def test_any_exchange_is_explained(framing: str, asked: bytes, answered: bytes, cut: bool, floats: str | None) -> None:
    encode = {"rtu": rtu.encode, "ascii": ascii_room.encode, "tcp": tcp.encode}[framing]
    request, response = encode(1, asked), encode(1, answered)
    texts = [
        frame.decode() if framing == "ascii" else frame.hex(" ") for frame in (request, response[cut:] or response)
    ]
    explanation = explain_exchange(framing, *texts, floats=floats)
    assert all(finding.text.isprintable() and finding.proof for finding in explanation.diagnosis)
    explain_exchange(framing, texts[1], texts[0], device=load("adxl"))


@pytest.mark.parametrize(
    ("pdu", "note"),
    [
        ("03 9C41 0001", "if 40001 is the manual's number of the holding register, send 0"),
        ("06 9C4F 0001", "if 40015 is the manual's number of the holding register, send 14"),
        ("10 C34F 0001 02 0000", "if 49999 is the manual's number of the holding register, send 9998"),
        ("04 7532 0001", "if 30002 is the manual's number of the input register, send 1"),
        ("02 2711 0008", "if 10001 is the manual's number of the discrete input, send 0"),
        ("03 9C40 0001", ""),  # 40000 is no number
        ("03 C350 0001", ""),  # neither is 50000
        ("03 7531 0001", ""),  # 30001 is none of a holding register
        ("01 9C41 0001", ""),
        ("83 02", ""),
    ],
)
def test_a_good_request_for_the_number_of_a_manual_gets_a_note(pdu: str, note: str) -> None:
    explained = explain("rtu", rtu.encode(1, bytes.fromhex(pdu)), None if pdu == "83 02" else "request")
    assert explained.valid
    assert explained.diagnosis == ()
    assert [(found.code, found.text) for found in explained.notes] == ([("address-base", note)] if note else [])


# A byte count that was not asked for ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("request_pdu", "response_pdu", "words"),
    [
        (
            "03 0010 0002",
            "03 08 0001 0002 0003 0004",
            "the device sent 4 registers where 2 were asked: longer registers",
        ),
        ("04 0010 0001", "04 04 0001 0002", "the device sent 2 registers where 1 was asked: longer registers"),
        ("03 0010 0003", "03 02 0001", "the device sent 1 register where 3 were asked: another type"),
        ("17 0000 0002 0005 0001 02 0007", "17 06 0001 0002 0003", "the device sent 3 registers where 2 were asked"),
        ("01 0000 0008", "01 02 0100", "the device sent 2 bytes where 1 was asked, for 8 coils"),
        ("02 0000 0010", "02 03 010000", "the device sent 3 bytes where 2 were asked, for 16 discrete inputs"),
    ],
)
def test_a_byte_count_that_was_not_asked_for_is_called_that(request_pdu: str, response_pdu: str, words: str) -> None:
    (finding,) = exchanged(request_pdu, response_pdu).diagnosis
    assert finding.code == "wrong-answer"
    assert finding.text.startswith(words)
    assert "a wrong count" in finding.text
    assert "another request" not in finding.text


def test_a_serial_line_may_bring_a_late_response_and_a_transaction_of_tcp_may_not() -> None:
    asked, answered = bytes.fromhex("03 0010 0002"), bytes.fromhex("03 08 0001 0002 0003 0004")
    texts = {
        "rtu": explain_exchange("rtu", rtu.encode(1, asked).hex(), rtu.encode(1, answered).hex()),
        "tcp": explain_exchange("tcp", tcp.encode(1, asked, 7).hex(), tcp.encode(1, answered, 7).hex()),
    }
    late = {framing: "a late response" in explained.diagnosis[0].text for framing, explained in texts.items()}
    assert late == {"rtu": True, "tcp": False}


def test_a_byte_count_of_another_unit_or_transaction_is_no_answer_to_this_request() -> None:
    other_unit = exchanged("03 0010 0002", "03 08 0001 0002 0003 0004", answering=2).diagnosis
    assert [finding.text.partition(":")[0] for finding in other_unit] == [
        "unit 2 answers, and unit 1 was asked",
        "the response is to another request",
    ]
