"""Excerpts of logs, as people post them: what they do not show is not said, and pieces of one frame are one frame.

TX: 01 06 04 04 00 00 C9 3B        requests alone: nobody is silent, the log shows one side only
recv: 01 04 1C 00 01               13 of 33 bytes, and the log ends: it is cut by the excerpt, no fault of the line
recv: 00 02 00 03 ...
"""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, ErrorFrame
from barewire.errors import DecodeError
from barewire.rtu import encode as rtu_frame
from barewire_workbench.diagnosis.can_log import BusDiagnosis
from barewire_workbench.diagnosis.modbus_log import ModbusLogDiagnosis
from barewire_workbench.recordings.modbus_log import read_modbus_log
from tests.helpers import every_case

ASKED = "send: 01 03 00 00 00 02 C4 0B\n"
ASKED_TCP = "send: 00 07 00 00 00 06 01 03 00 00 00 02\n"


def told(text: str) -> tuple[list[str], str]:
    """Return the findings and the verdicts on a text."""
    diagnosis = ModbusLogDiagnosis(read_modbus_log(text.encode()))
    findings = [found.sentence for found in diagnosis.findings()]
    return findings, "\n".join(verdict.sentence for _, verdict in diagnosis.verdicts())


@every_case(
    ("text", "side"),
    [
        ("TX: 01 06 04 04 00 00 C9 3B\nTX: 01 06 04 04 00 00 C9 3B\n", "request to unit 1, Write Single Register"),
        (
            "12:00:01.000 send: 01 03 00 00 00 02 C4 0B\n12:00:09.000 send: 01 03 00 00 00 02 C4 0B\n",
            "request to unit 1, ",
        ),
        ("12:00:01.000 recv: 01 04 04 00 00 01 10 FB D8\n", "response of unit 1, Read Input Registers, 2 registers"),
        (
            "Received packet (7 bytes) 0B 04 04 45 10 A1 64\nReceived packet (7 bytes) 0B 04 04 46 2E 4C 7D\n",
            "response of",
        ),
    ],
)
def test_a_log_of_one_side_accuses_nobody_of_silence(text: str, side: str) -> None:
    findings, verdicts = told(text)
    assert findings == []
    assert verdicts.startswith("verdict: undecided: ")
    assert f"this log shows one side only [open]: {side}" in verdicts
    assert verdicts.count("verdict: ") == 1


def test_a_log_whose_other_frames_are_left_out_is_not_of_one_side() -> None:
    findings, verdicts = told(
        "send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb\n>>>>> recv: 0x1 0x3 0x4 0x0 0x17 0x0 0x7 0xb 0xf5\n"
    )
    assert findings == []
    assert "one side" not in verdicts


def test_a_program_that_says_that_nothing_came_has_both_sides() -> None:
    findings, _ = told(2 * "send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb\nrecv:\n")
    assert [finding.partition("[")[2].partition("]")[0] for finding in findings] == ["no-answer", "no-answer"]


@every_case(
    "pieces",
    [["01 03", "04 00", "17 00 07 0B F5"], ["01 03 04 00", "17 00 07 0B F5"], ["01 03 04 00 17 00 07 0B F5"]],
)
def test_pieces_of_one_response_are_one_frame(pieces: list[str]) -> None:
    findings, verdicts = told(ASKED + "".join(f"recv: {piece}\n" for piece in pieces) + ASKED)
    assert findings == []
    assert "2 frames" in verdicts or "3 frames" in verdicts


def test_the_answer_to_a_second_request_that_is_not_in_the_log_is_not_late() -> None:
    findings, verdicts = told("send: 54 02 00 00 00 06 01 03 00 00 00 02\nrecv: 54 01 00 00 00 06 01 06 00 07 00 01\n")
    assert findings == []
    assert "1 response of unit 1 without its request" in verdicts


def test_a_response_that_is_quoted_again_is_read_once() -> None:
    data = "1, 3, 4, 255, 255, 255, 255, 251, 167"
    said = f"Checksums failed to match {data}\nThis is it:\nRX: {data}\n"
    findings, verdicts = told(said)
    assert findings == []
    assert "1 frame read" in verdicts


def test_a_response_that_the_end_of_the_log_cuts_is_no_fault() -> None:
    findings, verdicts = told(
        "send: 0x1 0x4 0x0 0x0 0x0 0xe 0x71 0xce\nrecv: 0x1 0x4 0x1c 0x0 0x1\nrecv: 0x0 0x2 0x0 0x3 0x0 0x4 0x0 0x5\n"
    )
    assert findings == []
    assert verdicts.count("verdict: ") == 1
    assert "the end of the last response, of unit 1: 13 of its 33 bytes are in the log" in verdicts


def test_what_pymodbus_had_in_its_buffer_belongs_to_the_bytes_behind_it() -> None:
    findings, verdicts = told(
        ">>>>> send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb\n"
        ">>>>> recv: 0x1 0x3 0x4 extra data:\n"
        ">>>>> extra: unexpected data: 0x1 0x3 0x4\n"
        ">>>>> recv: 0x0 0x17 0x0 0x7 0xb 0xf5 extra data: 0x1 0x3 0x4\n"
    )
    assert findings == []
    assert "nothing wrong" in verdicts


@every_case(
    "words",
    [
        "I read registers 10-20 at 10:20, and it fails\n",
        "the log said it read 12-13 at 14:15\n",
        "I receive 34, 35, 36, 37 in place of them\n",
        "the device answered on 05.11.2024 with version 1.2.3.4\n",
    ],
)
def test_numbers_of_a_sentence_are_no_bytes(words: str) -> None:
    findings, verdicts = told(words + ASKED + words + "recv: 01 03 04 00 17 00 07 0B F5\n")
    assert findings == []
    assert "2 frames, 1 request answered" in verdicts


@every_case(
    ("answer", "finding"),
    [
        ("00 07 00 00 00 01 01", "a header with length 1: the unit, and no function [mbap-header]"),
        ("00 07 00 00 00 03 01 83 02 00 00 00 00 00", "behind a frame, which the length in its header does not count"),
    ],
)
def test_a_wrong_length_in_the_header_is_named(answer: str, finding: str) -> None:
    findings, _ = told(f"{ASKED_TCP}recv: {answer}\n")
    assert len(findings) == 1
    assert finding in findings[0]


def test_sdo_requests_alone_are_one_side_of_a_log() -> None:
    bus = BusDiagnosis()
    for place in range(3):
        assert bus.feed(CanFrame.parse(f"603#401810{place:02d}00000000"), 0.01 * place) == []
    assert bus.end(0.03) == []
    (verdict,) = bus.verdicts()
    assert verdict.sentence.startswith("verdict: undecided: this log shows one side only [open]: each SDO request")
    assert "0 " not in verdict.evidence.replace("0 from", "")


def test_an_answer_that_does_not_state_its_size_is_legal() -> None:
    bus = BusDiagnosis()
    bus.feed(CanFrame.parse("603#4018100200000000"), 0.0)
    bus.feed(CanFrame.parse("583#4218100205000000"), 0.01)
    assert "does not state how many count (42h), which is allowed" in bus.verdicts()[0].evidence


def test_an_error_frame_of_the_controller_is_told_and_no_fault_is_counted_from_it() -> None:
    bus = BusDiagnosis()
    bus.feed(ErrorFrame(0x204, bytes.fromhex("000C000000006060")), 0.0)
    (verdict,) = bus.verdicts()
    assert (verdict.code, verdict.text) == ("nothing-heard", "no frame of a node is read")
    assert verdict.evidence.startswith("1 error frame read, the last: controller")
    assert "(receive warning, transmit warning)" in verdict.evidence


@every_case(
    ("text", "said"),
    [
        (
            ASKED + "recv: 01 03 04 00 17 00 07 0B F6\n" + ASKED,
            "a whole response by its length, whose CRC is 0B F6, and 0B F5 fits",
        ),
        ("send: 01 03 00 10 00 02 55 66\n", "a whole request by its length, whose CRC is 55 66, and C5 CE fits"),
        ("it shows 01 83 02 00 00 for that\n", "a whole response by its length, whose CRC is 00 00, and C0 F1 fits"),
    ],
)
def test_a_frame_of_which_only_the_crc_does_not_fit_is_called_that(text: str, said: str) -> None:
    findings, _ = told(text)
    assert [finding.partition("[")[2].partition("]")[0] for finding in findings] == ["crc-wrong"]
    assert said in findings[0]


def test_bytes_may_be_cut_in_one_direction_and_have_another_crc_in_the_other() -> None:
    findings, _ = told("the bytes that are sent: 01 03 80 12 33 44 55 66\n")
    text = "the beginning of a response, 125 bytes are to come, or a whole request by its length, whose CRC is 55 66"
    assert f"{text}, and D8 CC fits [no-frame]: " in findings[0]


def test_lines_of_bytes_below_a_heading_that_begin_alike_are_an_answer_each() -> None:
    rows = "00 01 03 04 00 17 00 07 0B\n00 01 03 04 00 18 00 07 3B\n"
    findings, _ = told("the request:\n01 03 00 00 00 02 C4 0B\nthe response:\n" + rows)
    assert len(findings) == 2
    for finding in findings:
        assert "1 byte before the response: 00 [noise-before]" in finding
        assert "its last 1 byte not read" in finding


def test_a_request_of_the_diagnostics_is_no_write() -> None:
    _, verdicts = told("01 08 00 00 12 34 ED 7C\n01 03 00 00 00 02 C4 0B\n")
    assert "1 diagnostic request to unit 1, or its equal response" in verdicts


@every_case("end", [" ...", " ... 14 more bytes>", "…", " xx xx xx xx"])
def test_bytes_that_a_program_printed_in_part_are_no_cut_frame(end: str) -> None:
    findings, verdicts = told(ASKED + f"recv: 01 03 04 00{end}\n" + ASKED + "recv: 01 03 04 00 17 00 07 0B F5\n")
    assert findings == []
    assert "1 request to unit 1 before bytes that cannot be read" in verdicts


def test_a_text_of_bytes_in_part_is_not_read_as_a_log() -> None:
    with pytest.raises(DecodeError):
        read_modbus_log(b"the handler has <Buffer 01 04 20 00 00 00 05 00 00 ... > for now\n")


def test_the_same_byte_before_each_answer_is_no_disturbance() -> None:
    rows = "".join(f"recv: 00 01 03 04 00 17 00 07 0B\n{ASKED}" for _ in range(4))
    findings, verdicts = told(ASKED + rows)
    assert len(findings) == 4
    assert "[disturbed]" not in verdicts


def test_a_list_of_single_bits_is_no_frame() -> None:
    findings, verdicts = told("Expected: [ 1, 0, 1, 1, 0 ]\nResponse: [ 1, 0, 0, 1, 0 ]\n" + ASKED_TCP)
    assert findings == []
    assert "1 frame read" in verdicts


def test_values_in_brackets_beside_the_output_of_libmodbus_are_no_traffic() -> None:
    answer = "[01][03][00][00][00][02][C4][0B]\nWaiting for a confirmation...\n<01><03><04><00><17><00><07><0B><F5>\n"
    findings, verdicts = told(f"values:\n<0x17> <0x07>\n{answer}values:\n<0x17> <0x0> <0x7>\n{answer}")
    assert findings == []
    assert "2 requests answered" in verdicts


def test_a_pdu_that_is_received_without_unit_and_checksum_is_no_request() -> None:
    findings, verdicts = told("the receive buffer: 03 04 41 20 42 48\n")
    assert findings == []
    assert "1 PDU without its unit and checksum" in verdicts


def test_times_in_whole_seconds_prove_no_silence_of_one_second() -> None:
    answer = "".join(f"10:00:02 recv: {byte}\n" for byte in ("01", "03", "04", "00 17 00", "07 0B F5"))
    findings, verdicts = told("10:00:01 send: 01 03 00 00 00 02 C4 0B\n" + answer)
    assert findings == []
    assert "1 request answered" in verdicts


def test_a_received_frame_that_goes_on_in_the_next_line_is_one_frame() -> None:
    findings, verdicts = told(
        ">>>>> send: 0x0 0x7 0x0 0x0 0x0 0x6 0x1 0x3 0x0 0x0 0x0 0x2 >>>>> recv: 0x0 0x7 0x0 0x0 0x0 0x7 0x1 0x3 \n"
        "0x4 0x0 0x17 0x0 0x7 extra data: >>>>> send: 0x0 0x8 0x0 0x0 0x0 0x6 0x1 0x3 0x0 0x0 0x0 0x1 >>>>> recv: 0x0\n"
        "0x8 0x0 0x0 0x0 0x5 0x1 0x3 0x2 0x0 0x17 extra data:\n"
    )
    assert findings == []
    assert "4 frames, 2 requests answered by 1 unit" in verdicts


def test_a_request_that_is_received_before_its_response_is_an_echo() -> None:
    findings, verdicts = told("the response is 01 03 00 10 00 02 C5 CE 01 03 04 00 17 00 07 0B F5\n")
    assert [finding.partition("[")[2].partition("]")[0] for finding in findings] == ["echo"]
    assert "request answered" in verdicts


def test_a_coil_that_is_read_as_off_behind_its_switching_on_is_no_good_log() -> None:
    text = "01 05 00 0A FF 00 AC 38\n01 05 00 0A FF 00 AC 38\n01 01 00 00 00 10 3D C6\n"
    for bits, said in (("04 00", "coil 2 is on"), ("00 00", "no coil is on"), ("00 04", "")):
        body = bytes.fromhex(f"01 01 02 {bits}")
        findings, _ = told(text + rtu_frame(1, body[1:]).hex(" ") + "\n")
        assert len(findings) == bool(said)
        for finding in findings:
            assert "coil 10 was switched on, and is read as off" in finding
            assert said in finding


def test_eight_times_the_quantity_of_bits_is_named_where_requests_stand_alone() -> None:
    for quantity, is_named in ((8, True), (7, False)):
        asked = [rtu_frame(1, bytes((1, 0, 0, 0, number))).hex(" ") for number in (1, quantity)]
        _, verdicts = told(f"TX: {asked[0]}\nTX: {asked[1]}\n")
        assert ("8 bits are asked where 1 was: the quantity counts bits, not bytes" in verdicts) is is_named


def test_a_cut_answer_with_the_transaction_of_an_earlier_request_is_called_that() -> None:
    findings, _ = told("send: 00 08 00 00 00 06 01 03 00 00 00 02\nrecv: 00 07 00 00 00 07 01 03 04 00 17\n")
    assert "2 bytes are to come, of transaction 7, and 8 was asked [cut-frame]" in findings[0]


def test_a_request_of_another_master_that_the_client_receives_with_its_response_is_no_echo() -> None:
    other = "01 03 00 10 00 02 C5 CE 01 03 04 00 17 00 07 0B F5"
    findings, _ = told(f"TX: 02 03 00 10 00 02 C5 FD\nRX: {other}\nTX: 02 03 00 10 00 02 C5 FD\nRX: {other}\n")
    assert findings
    assert not [finding for finding in findings if "[echo]" in finding]


def test_a_request_that_is_sent_before_the_answer_to_the_one_before_is_called_that() -> None:
    findings, _ = told(
        "12:00:01.000 Tx: 01 03 00 10 00 02 C5 CE\n12:00:01.110 Tx: 01 03 00 00 00 02 C4 0B\n"
        "12:00:01.200 Rx: 01 03 04 00 17 00 07 0B F5\n12:00:02.000 Tx: 01 03 00 00 00 02 C4 0B\n"
    )
    assert findings[0].endswith("[no-answer]: nothing for 0.110 s, then the next request")


def test_frames_of_iso_tp_are_no_heartbeats() -> None:
    bus = BusDiagnosis()
    texts = ("701#0210010000000000", "781#065001003201F400", "701#3000320000000000")
    assert [found for at, text in enumerate(texts) for found in bus.feed(CanFrame.parse(text), at)] == []
    assert "ISO-TP" in bus.verdicts()[0].evidence
    assert [found.finding.code for found in BusDiagnosis().feed(CanFrame.parse("701#0500000000000000"), 0.0)]


@every_case(
    ("text", "said"),
    [
        # the end of a text: of a response that is due, of any frame, with half a byte, and of TCP
        (ASKED_TCP + "recv: 00 07 00 00\n", "the end of the last response, of unit 1: 4 of its 13 bytes"),
        (ASKED_TCP + "recv: 00 07 00 00 00 07 01 03 04 0\n", "of the last response, of unit 1: 9 of its 13 bytes"),
        ("recv: 01 83 02 C0 F1\nsend: 01 0F 00 00 00 0", "the end of the last frame: 5 bytes of it are in the log"),
        # its beginning
        ("03 00 00 00 02 C4 0B\n01 03 04 00 17 00 07 0B F5\n", "the beginning of the first frame"),
        (
            ASKED + "recv: 01 03 04 00 17\nsome words\n" + ASKED + "recv: 01 03 04 00 17 00 07 0B F5\n",
            "",
        ),
        (
            "recv: 17 00 07 0B F5\n" + ASKED + "recv: 01 03 04 00\n" + ASKED,
            "its reader took apart: 4 bytes in line 3 and 5 in line 1, whose CRC fits together",
        ),
    ],
)  # fmt: skip
def test_what_a_quotation_cuts_is_no_fault(text: str, said: str) -> None:
    findings, verdicts = told(text)
    assert (findings == []) is (said != "")
    assert said in verdicts


def test_in_whole_seconds_no_short_silence_is_known_and_each_finding_has_the_line_of_its_request() -> None:
    lines = [f"12:00:0{second} send: 01 03 00 00 00 02 C4 0B\n" for second in (0, 0, 1, 5)]
    findings, _ = told("".join(lines) + "12:00:06 recv: 01 04 04 00 00 01 10 FB D8\n" + lines[3].replace("05", "30"))
    shown = [finding.partition("  ")[2] for finding in findings]
    assert [finding[:6] for finding in shown[:3]] == ["line 1", "line 2", "line 3"]
    assert "0.000 s" not in "".join(shown)
    assert "nothing for about 2 s" in shown[2]


@every_case(
    ("text", "said"),
    [
        (
            "send: 00 19 00 00 00 06 01 06 00 1F 00 01\nrecv: 00 19 00 00 00 06 00 00 00 00 00 00\nend\n",
            "unit 0 answers with function 00, which is none of Modbus, and unit 1 was asked",
        ),
        ("TX: F8 04 00 00 00 01 25 A3\n", "request to unit 248 (248 to 255 are reserved), Read Input Registers"),
        (
            "12:00:01.5 send: 01 03 00 00 00 01 84 0A\n12:00:04.5 send: 02 03 00 00 00 02 C4 38\n"
            "12:00:04.9 recv: 01 03 02 00 17 F8 4A\n12:00:05.0 send: 01 03 00 00 00 02 C4 0B\n"
            "12:00:05.9 recv: 02 03 04 00 17 00 07 38 F5\nend\n",
            "[late-answers]: 2 responses to 3 requests came after the next request, of unit 1, 2",
        ),
    ],
)
def test_what_the_frames_say_of_each_other(text: str, said: str) -> None:
    findings, verdicts = told(text)
    assert said in "\n".join([*findings, verdicts])


_REFUSED = "it answers with an exception, and the response is 01 83 02 C0 F1, here is the log:\n"


@every_case(
    ("text", "says"),
    [
        (_REFUSED + "12:00:01.000 " + ASKED, "exception 02 of unit 1 to Read Holding Registers, 2 from 0000h"),
        (_REFUSED + ASKED, "exception 02 of unit 1 to Read Holding Registers, 2 from 0000h"),
        (_REFUSED + 2 * ("12:00:01.000 " + ASKED), "exception 02 of unit 1;"),
        (_REFUSED + "12:00:01.000 send: 01 04 00 00 00 02 71 CB\n", "exception 02 of unit 1;"),
    ],
)
def test_an_exception_that_a_sentence_tells_answers_the_one_open_request_of_its_function(text: str, says: str) -> None:
    assert says in told(text)[1]


def test_a_quotation_that_begins_within_the_line_of_an_error_has_all_its_frames() -> None:
    findings, verdicts = told(
        "send: 0x0 0x7 0x0 0x0 0x0 0x6 0x1 0x3 0x0 0x0 0x0 0x2 >>>>> recv: 0x0 0x7 0x0 0x0 0x0 0x7 0x1 0x3 0x4 0x0 0x1 "
        "0x0 0x2 extra data: >>>>> send: 0x0 0x8 0x0 0x0 0x0 0x6 0x1 0x3 0x0 0x0 0x0 0x2 >>>>> recv: 0x0 0x8 0x0 0x"
    )
    assert findings == []
    assert "3 frames, 1 request answered" in verdicts
    assert "the end of the last response, of unit 1: 3 of its 13 bytes" in verdicts


def test_a_response_of_tcp_one_byte_short_of_both_counts_is_of_the_request_with_its_number() -> None:
    findings, _ = told(
        "send: 00 07 00 00 00 06 01 03 00 00 00 02\nrecv: 00 07 00 00 00 07 01 03 04 00 01 00\n"
        "send: 00 08 00 00 00 06 01 03 00 00 00 01\nrecv: 00 08 00 00 00 05 01 03 02 00 07\n"
    )
    assert [finding.partition("the beginning")[2] for finding in findings] == [
        " of a response, 1 byte is to come [cut-frame]: the length is 7, and 6 bytes follow; the byte count is 4, "
        "and 3 follow"
    ]


def test_a_request_before_the_last_response_is_open_though_that_is_cut() -> None:
    verdicts = told(ASKED_TCP + "send: 00 08 00 00 00 06 02 03 00 00 00 02\nrecv: 00 08 00 00 00 07 02 03 04 00\n")[1]
    assert "1 request to unit 1 at the end" in verdicts
    assert "the end of the last response, of unit 2: 10 of its 13 bytes" in verdicts


@every_case(
    ("code", "frames"),
    [
        ("f = {0x01, 0x03, 0x00, 0x00, 0x00, 0x02};\nf.push_back(0xC4);\nf.push_back(0x0B);\n", 1),
        (
            "vector<uint8_t> f = {0x01, 0x06, 0x00, 0x00, 0x00, 0x00};\nif (on) {\n  f[5] = 1; // on\n"
            "  f.push_back(0x48);\n  f.push_back(0x0A);\n} else {\n  f[5] = 0;\n  f.push_back(0x89);\n"
            "  f.push_back(0xCA);\n}\n",
            2,
        ),
        ("".join(f"buf[{at}] = {byte};\n" for at, byte in enumerate(bytes.fromhex("010300000002C40B"))), 1),
        ("".join(f"Serial.write(0x{byte:02X});\n" for byte in bytes.fromhex("010300000002C40B") * 2), 2),
    ],
)
def test_a_frame_that_code_puts_together_is_read_where_its_crc_is_complete(code: str, frames: int) -> None:
    findings, verdicts = told(f"void ask() {{\n{code}}}\n")
    assert findings == []
    assert verdicts.startswith("verdict: undecided: this log shows one side only [open]: request to unit 1, ")
    assert f"; {frames} frame{'s' * (frames > 1)} read" in verdicts


def test_bytes_of_code_whose_crc_does_not_fit_are_no_frame() -> None:
    code = "f = {0x01, 0x03, 0x00, 0x00, 0x00, 0x02};\nf.push_back(0xC4);\nf.push_back(0x0C);\n"
    with pytest.raises(DecodeError):
        read_modbus_log(f"void ask() {{\n{code}}}\n".encode())


def bus_told(*frames: str, apart: float = 0.0011) -> tuple[list[str], str]:
    """Return the texts of the findings and the verdicts on frames, one after the other."""
    bus = BusDiagnosis()
    found = [
        finding for at, text in enumerate(frames) for finding in bus.feed(CanFrame.parse(text), at * apart, at + 1)
    ]
    found += bus.end(len(frames) * apart)
    return [finding.finding.text for finding in found], "\n".join(verdict.sentence for verdict in bus.verdicts())


_FIRST, _GO_ON = "000007E8#101C000102030405", "000007E0#3000000000000000"
_OTHER_GO_ON = "000007E0#300A140000000000"
_REST = tuple(f"000007E8#2{number}06070809AAAAAA" for number in range(1, 5))


@every_case(
    ("frames", "texts"),
    [
        ([_FIRST, _GO_ON, *_REST], []),
        ([_FIRST, _GO_ON, _GO_ON, *[frame for frame in _REST for _ in range(2)]], []),  # printed twice
        ([_FIRST, _GO_ON, _OTHER_GO_ON, *_REST], ["two different flow controls answer one frame"]),
        ([_FIRST, _GO_ON, _REST[0], _REST[2], _REST[3]], ["consecutive frame 22 of a message of 28 bytes is missing"]),
        ([_FIRST, _REST[0], _REST[2]], []),  # of any other protocol
        ([_FIRST, _GO_ON, _OTHER_GO_ON, _REST[1]], []),
    ],
)
def test_messages_of_iso_tp_are_judged_where_a_flow_control_and_its_frames_prove_them(
    frames: list[str], texts: list[str]
) -> None:
    found, _ = bus_told(*frames)
    assert len(found) == len(texts)
    assert all(text in finding for text, finding in zip(texts, found))


def test_a_message_of_iso_tp_that_ends_behind_its_flow_control_is_open() -> None:
    found, verdicts = bus_told("701#0322F19000000000", "781#101462F190000000", "701#3000320000000000")
    assert found == []
    assert "1 message of 781h, 20 bytes, whose second frame does not follow the flow control; 3 frames" in verdicts


def test_bit_errors_are_of_the_controller_that_sends() -> None:
    bus = BusDiagnosis()
    for at in range(4):
        bus.feed(ErrorFrame(0x4C, bytes.fromhex("0030080000000000")), 0.1 * at)
    assert [verdict.code for verdict in bus.verdicts()] == ["no-frames"]
    assert "a dominant bit read as recessive" in bus.verdicts()[0].evidence
