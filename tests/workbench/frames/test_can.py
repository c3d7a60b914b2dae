"""Explained CAN frames: identifier, service, bits."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame
from barewire.canopen.lss.messages import LSS_ANSWERS, LSS_REQUESTS
from barewire.errors import EncodeError
from barewire_workbench import Explanation, FrameRole, explain, explain_text
from barewire_workbench.frames.can import explain_segment
from tests.helpers import every_case


def of(frame: str) -> Explanation:
    return explain("can", CanFrame.parse(frame))


def meaning(frame: str, name: str) -> str:
    return next(field.meaning for field in of(frame).fields if field.name == name)


@every_case(
    ("frame", "verdict"),
    [
        ("000#0105", "NMT: start, node 5"),
        ("000#8000", "NMT: enter pre operational, all nodes"),
        ("080#", "SYNC"),
        ("080#07", "SYNC: number 7"),
        ("085#3081110200000000", "EMCY from node 5: 8130h life guarding or heartbeat error"),
        ("100#952CB3024D39", "TIME: 2024-02-29 12:34:56"),
        ("185#37060000", "TPDO1 from node 5: 4 bytes"),
        ("205#0F", "RPDO1 to node 5: 1 byte"),
        ("605#4041600000000000", "SDO request to node 5: initiate upload, 6041h:00"),
        ("585#4B41600037060000", "SDO answer from node 5: initiate upload, 6041h:00, 2 bytes: 0637h"),
        ("605#2B4060000F000000", "SDO request to node 5: initiate download, 6040h:00, 2 bytes: 000Fh"),
        ("585#8041600000000206", "SDO answer from node 5: abort, 6041h:00, 0602 0000h object does not exist"),
        ("705#00", "error control from node 5: boot-up"),
        ("705#7F", "error control from node 5: pre-operational"),
        ("705#R1", "node guarding of node 5: a remote frame requests its state"),
        ("185#R8", "TPDO1 from node 5: a remote frame requests 8 bytes"),
        ("7E5#1105000000000000", "LSS request: configure node-ID"),
        ("7E4#4F00000000000000", "LSS answer: identify device: identified"),
        ("690#01", "not in the predefined connection set: 1 byte"),
        ("00000605#40", "extended identifier, which CANopen does not predefine: 1 byte"),
    ],
)
def test_the_verdict_names_service_node_and_content(frame: str, verdict: str) -> None:
    assert of(frame).verdict == f"valid: {verdict}"


@pytest.mark.parametrize(
    ("frame", "reason", "at"),
    [
        ("000#01", "short", 1),
        ("000#0305", "function", 0),
        ("000#0180", "value", 1),
        ("080#0102", "long", 1),
        ("080#00", "value", 0),
        ("085#3081", "short", 2),
        ("605#40416000", "short", 4),
        ("605#", "short", 0),
        ("605#R", "mismatch", 0),
        ("705#0500", "long", 1),
        ("705#", "short", 0),
        ("705#06", "value", 0),
        ("7E5#FF00000000000000", "function", 0),
        ("7E5#", "short", 0),
    ],
)
def test_the_error_has_reason_and_place(frame: str, reason: str, at: int) -> None:
    explanation = of(frame)
    assert explanation.error is not None
    assert (explanation.error.reason, explanation.error.at) == (reason, at)


@pytest.mark.parametrize(("frame", "role"), [("605#40", "request"), ("585#60", "response"), ("185#01", None)])
def test_the_identifier_gives_the_role(frame: str, role: FrameRole | None) -> None:
    assert of(frame).role == role


def test_the_identifier_is_a_field_of_length_0() -> None:
    first = of("605#4041600000000000").fields[0]
    assert first == (0, 0, "COB-ID", "605", 0x605, "SDO request to node 5")


# SDO: the bits of byte 0 -----------------------------------------------------------------------------------------

DIALECT = "CiA 301 has 40h for every read request; the AZ3 manual uses this form"


@every_case(
    ("frame", "words"),
    [
        ("605#40", "initiate upload request (ccs 2)"),
        ("605#43", f"initiate upload request (ccs 2); {DIALECT}"),
        ("605#4B", f"initiate upload request (ccs 2); {DIALECT}"),
        ("605#4F", f"initiate upload request (ccs 2); {DIALECT}"),
        (
            "605#41",
            "initiate upload request (ccs 2); 010- ----: reserved bits are set, which a receiver ignores",
        ),
        ("605#2F", "initiate download request: expedited, 1 byte, size indicated (ccs 1, n 3, e 1, s 1)"),
        ("605#22", "initiate download request: expedited, size not indicated (ccs 1, n 0, e 1, s 0)"),
        ("605#21", "initiate download request: in segments, size indicated (ccs 1, n 0, e 0, s 1)"),
        ("605#20", "initiate download request: in segments, size not indicated (ccs 1, n 0, e 0, s 0)"),
        ("605#1B", "download segment request: toggle bit 1, 2 bytes, the last (ccs 0, t 1, n 5, c 1)"),
        ("605#70", "upload segment request: toggle bit 1 (ccs 3, t 1)"),
        ("605#80", "abort (cs 4)"),
        ("605#A4", "initiate block upload request: with CRC (ccs 5, c 1)"),
        ("605#A3", "start block upload request (ccs 5)"),
        ("605#A2", "acknowledge block upload request (ccs 5)"),
        ("605#A1", "end block upload request (ccs 5)"),
        ("605#C2", "initiate block download request: without CRC (ccs 6, c 0, s 1)"),
        ("605#D1", "end block download request: 3 bytes in the last segment (ccs 6, n 4)"),
        ("585#4B", "initiate upload response: expedited, 2 bytes, size indicated (scs 2, n 2, e 1, s 1)"),
        ("585#41", "initiate upload response: in segments, size indicated (scs 2, n 0, e 0, s 1)"),
        ("585#60", "initiate download response (scs 3)"),
        ("585#30", "download segment response: toggle bit 1 (scs 1, t 1)"),
        ("585#00", "upload segment response: toggle bit 0, 7 bytes, more follow (scs 0, t 0, n 0, c 0)"),
        ("585#A0", "initiate block download response: without CRC (scs 5, c 0)"),
        ("585#A2", "acknowledge block download response (scs 5)"),
        ("585#A1", "end block download response (scs 5)"),
        ("585#C6", "initiate block upload response: with CRC (scs 6, c 1, s 1)"),
        ("585#C1", "end block upload response: 7 bytes in the last segment (scs 6, n 0)"),
    ],
)
def test_every_command_byte_is_explained_bit_by_bit(frame: str, words: str) -> None:
    assert meaning(frame, "command") == words
    assert of(frame.ljust(20, "0")).valid


@pytest.mark.parametrize(
    ("frame", "reading"),
    [
        ("585#4F41600001000000", "u8 1"),
        ("585#4B416000FBFF0000", "u16 65531, i16 -5"),
        ("585#47416000FFFFFF00", "u24 16777215, i24 -1"),
        ("585#43416000CDCC8C3F", "u32 1066192077, f32 1.1"),
        ("605#2241600001000000", "no size is indicated; all 4 bytes: u32 1, f32 1.401298e-45"),
    ],
)
def test_a_value_is_shown_as_every_number_of_its_width(frame: str, reading: str) -> None:
    assert meaning(frame, "data") == reading


def test_bytes_after_a_short_value_are_unused() -> None:
    explanation = of("605#2B4060000F00AABB")
    assert [(field.name, field.hex) for field in explanation.fields[-2:]] == [("data", "0F 00"), ("unused", "AA BB")]


@pytest.mark.parametrize(
    ("frame", "numbers"),
    [
        ("585#A24A7F0000000000", [("sequence", 74), ("block size", 127)]),
        ("605#D1589C0000000000", [("CRC", 0x9C58)]),
    ],
)
def test_the_numbers_of_block_messages_are_fields(frame: str, numbers: list[tuple[str, int]]) -> None:
    assert [(field.name, field.value) for field in of(frame).fields[2 : 2 + len(numbers)]] == numbers


# The other fields ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frame", "name", "words"),
    [
        ("605#A408100014150000", "protocol switch", "ordinary upload up to this many bytes"),
        ("605#A408100014000000", "protocol switch", "no ordinary upload"),
        ("585#0048656C6C6F2121", "data", "'Hello!!'"),
        ("605#4041600000000001", "reserved", "should be 0"),
        ("085#3081110200000000", "error register", "generic, communication"),
        ("085#0000000000000000", "error register", "no error left"),
        ("705#85", "state", "operational; toggle bit 1: the answer to node guarding"),
        ("000#0305", "command", "not an NMT command"),
        ("7E5#0401000000000000", "mode", "configuration"),
        ("7E5#11FF000000000000", "node-ID", "no node-ID yet"),
        ("7E4#1101000000000000", "result", "refused"),
        ("7E5#15E8030000000000", "delay", "ms before the change, and the same again after it"),
        ("7E5#41112233", "product code", "cut short"),
    ],
)
def test_a_field_has_its_meaning(frame: str, name: str, words: str) -> None:
    assert meaning(frame, name) == words


def test_more_than_eight_bytes_are_an_error() -> None:
    explanation = explain("can", CanFrame(0x605, bytes(9)))
    assert explanation.error == ("long", 8, "a CAN frame carries at most 8 bytes, got 9")


def test_bytes_for_a_frame_and_a_frame_for_bytes_are_refused() -> None:
    with pytest.raises(EncodeError, match="can: expected a CanFrame"):
        explain("can", b"\x00")
    with pytest.raises(EncodeError, match="rtu: expected bytes"):
        explain("rtu", CanFrame(0))


def test_only_80h_is_an_abort() -> None:
    """81h to 9Fh are not an abort; in a block transfer they are its last segment, which the frame alone cannot show."""
    assert of("585#8041600000000206").valid
    for command in range(0x81, 0xA0):
        number = command & 0x7F
        expected = f"SDO answer from node 5: only in a block upload: segment {number}, the last, 7 bytes"
        assert of(f"585#{command:02X}41600000000206").verdict == f"valid: {expected}"
        error = of(f"585#{command:02X}416000000002").error  # a segment has 8 bytes
        assert error is not None
        assert error.reason in ("function", "short")
    text = "no command of an SDO request; in a block download segment 3, the last: only the frames before show that"
    assert meaning("605#8321000500000000", "segment") == text
    assert explain_segment(CanFrame.parse("585#8341600000000206")).verdict.endswith("segment 3 of a block, the last")


@every_case("service", sorted(LSS_REQUESTS | LSS_ANSWERS))
def test_an_lss_service_is_valid_only_in_its_directions(service: int) -> None:
    for identifier, known in ((0x7E5, LSS_REQUESTS), (0x7E4, LSS_ANSWERS)):
        explanation = explain("can", CanFrame(identifier, bytes([service]) + bytes(7)))
        assert explanation.valid == (service in known), explanation.lines()
        assert (explanation.fields[1].meaning == "unknown") == (service not in known)


def test_a_day_of_more_than_24_hours() -> None:
    explanation = of("100#005C26054D39")
    assert explanation.error is not None
    assert explanation.error.reason == "value"
    assert of("100#FF5B2605FFFF").verdict == "valid: TIME: 2163-06-06 23:59:59"
    assert of("100#FF5B26F54D39").valid  # the four void bits


FD = "CAN FD frame, which classical CANopen does not have"
ERROR = "error frame, a report of the controller"


@pytest.mark.parametrize(
    ("text", "verdict"),
    [
        ("123##1AABB", f"{FD}: 2 bytes"),
        ("(1.0) can0 123##1AABB", f"{FD}: 2 bytes"),
        ("can0  123  [12]  00 11 22 33 44 55 66 77 88 99 AA BB", f"{FD}: 12 bytes"),
        ("20000040#0000000000000000", f"{ERROR}: bus off"),
        ("can0 20000004 [8] 00 02 00 00 00 00 00 00", f"{ERROR}: controller problem: transmit buffer overrun"),
        ("20000200#0000000000006007", f"{ERROR}: error counters (96 transmit, 7 receive)"),
    ],
)
def test_fd_and_error_frames_are_explained(text: str, verdict: str) -> None:
    explanation = explain_text("can", text)
    assert explanation.verdict == f"valid: {verdict}"
    assert explanation.lines()


def test_the_counters_of_an_error_frame_are_fields() -> None:
    fields = explain_text("can", "20000204#0020000000008001").fields
    assert [(field.name, field.value) for field in fields[1:]] == [
        ("data", "00 20 00 00 00 00"), ("transmit errors", 128), ("receive errors", 1),
    ]  # fmt: skip
