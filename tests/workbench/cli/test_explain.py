"""`barewire explain`: single frames and recordings."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

from tests.workbench.cli.helpers import error_of, output_of, run_here

EXCHANGE = """\
(1.000000) can0 705#00
(1.100000) can0 605#4041600000000000
(1.101200) can0 585#4B41600037060000
what is this
(1.200000) can0 205#0F00A8610000
(1.200000) can1 705#06
"""


def test_a_request() -> None:
    text = output_of("explain", "rtu", "01 04 0F B1 00 02 22 F8")
    for part in ("unit 1", "Read Input Registers", "0FB1h", "quantity", "CRC ok"):
        assert part in text


def test_a_response_with_a_wrong_crc() -> None:
    frame = json.loads(output_of("explain", "rtu", "01 04 04 00 00 01 10 3B C3", "--role", "response", "--json"))
    assert frame["valid"] is False
    assert frame["role"] == "response"
    assert frame["error"]["reason"] == "checksum"
    assert frame["error"]["at"] == 7
    assert "FB D8" in frame["error"]["text"]
    assert [field["length"] for field in frame["fields"]] == [1, 1, 1, 2, 2, 2]


def test_an_invalid_frame_is_a_failure_only_with_check() -> None:
    assert run_here("explain", "rtu", "01 04", "--check").returncode == 1
    assert run_here("explain", "rtu", "01 04").returncode == 0


def test_text_that_is_not_hexadecimal_is_an_error() -> None:
    assert "'G' at 4 is not a hexadecimal digit" in error_of("explain", "rtu", "01 0G", status=2)
    error = error_of("explain", "can", "bus.log", status=2)
    assert error.endswith("is not a hexadecimal digit; there is no file 'bus.log' either\n")


def test_a_recording_frame_by_frame(tmp_path: Path) -> None:
    log = tmp_path / "bus.log"
    log.write_text(
        EXCHANGE + "(1.3) can0 605#C600210007000000\n(1.4) can0 585#A40021007F000000\n(1.5) can0 605#8100010203040506\n"
    )
    text = output_of("explain", "can", str(log), "--device", "az3", "--node", "5")
    assert "valid: SDO answer from node 5: initiate upload, 6041h:00 STATUS WORD, 2 bytes: 0637h" in text
    assert "valid: RPDO1 to node 5: CONTROL WORD = 15 (" in text
    assert "605#8100010203040506  valid: SDO request to node 5: segment 1 of a block, the last" in text
    assert "    1.200000  node 6    VIOLATION" not in text
    assert "UNREAD      line 4: " in text
    assert run_here("explain", "can", str(log), "--check").returncode == 1
    rows = [json.loads(line) for line in output_of("explain", "can", str(log), "--json").splitlines()]
    assert [row["frame"] for row in rows if "frame" in row and "fields" in row][1] == "605#4041600000000000"


def test_objects_of_a_recording_have_their_names(tmp_path: Path) -> None:
    log = tmp_path / "sdo.log"
    log.write_text(
        "(1.0) can0 605#4041600000000000\n(1.1) can0 585#4B41600037060000\n(1.2) can0 585#4108100004000000\n"
    )
    first, second, third, *_ = output_of("explain", "can", str(log), "--device", "az3", "--node", "5").splitlines()
    assert first.endswith("SDO request to node 5: initiate upload, 6041h:00 STATUS WORD")
    assert "initiate upload, 6041h:00 STATUS WORD, 2 bytes: 0637h, 1591 (ready to switch on, " in second
    assert third.endswith("initiate upload, 1008h:00")  # the description does not have this object


def test_a_can_frame_with_the_names_of_a_device() -> None:
    az3 = ("--device", "az3", "--node", "5")
    rows = output_of("explain", "can", "585#4B41600037060000", *az3).splitlines()
    assert rows[2].split() == ["1", "41", "60", "index", "6041h", "STATUS", "WORD"]
    assert "1591 (ready to switch on, " in rows[4]
    assert "TARGET VELOCITY" in output_of("explain", "can", "205#0F00A8610000", *az3)
    assert "not valid: 6 bytes are mapped, got 2" in output_of("explain", "can", "205#0F00", *az3)
    assert "--device is for can" in error_of("explain", "rtu", "01", "--device", "az3", status=2)


def test_can_fd_frames_and_error_frames() -> None:
    assert "CAN FD frame" in output_of("explain", "can", "123##1AABB")
    assert "controller problem: receive buffer overrun" in output_of("explain", "can", "20000004#0001000000000000")


def test_the_fault_of_a_can_frame_is_said_with_its_proof_unless_the_device_is_known_to_have_it() -> None:
    fault = "diagnosis: 4Bh is how a server answers; a read request is 40h [sdo-read-command]: 605#4041600000000000 is"
    assert fault in output_of("explain", "can", "605#4B41600000000000")
    known = output_of("explain", "can", "605#4B41600000000000", "--device", "az3", "--node", "5")
    assert "diagnosis" not in known


def test_the_bytes_of_an_rtu_frame_are_explained_as_can_and_said_to_be_one() -> None:
    command = ("explain", "can", "01 03 00 00 00 0A C5 CD")
    verdict, finding = output_of(*command, "--check").splitlines()[-2:]
    assert verdict == "valid: not in the predefined connection set: 7 bytes"
    assert finding.startswith(
        "diagnosis: the bytes are a good RTU frame: to explain them so, give rtu in place of can "
    )
    assert json.loads(output_of(*command, "--json"))["valid"] is True
    assert output_of(*command, "--device", "az3", "--node", "5").splitlines()[-2:] == [verdict, finding]


def test_a_frame_as_svg_html_and_json() -> None:
    frame = ("explain", "rtu", "01 03 00 00 00 02 C4 0B")
    assert ElementTree.fromstring(output_of(*frame, "--format", "svg")).get("class") == "bw"
    page = output_of(*frame, "--format", "html")
    assert "RTU frame, 8 bytes" in page
    assert "Levels on the line: 8 characters" in page
    assert output_of(*frame, "--format", "json") == output_of(*frame, "--json")
    assert output_of(*frame, "--format", "text") == output_of(*frame)


def test_the_levels_of_a_frame() -> None:
    assert "byte 1, 03h: function code" in output_of("explain", "rtu", "01 03 00 00 00 02 C4 0B", "--picture", "levels")
    levels = json.loads(output_of("explain", "can", "605#40", "--picture", "levels", "--json"))
    assert levels["crc"] == 0x0950
    assert "Levels" not in output_of("explain", "can", "605#40", "--picture", "levels", "--format", "html")


def test_the_levels_on_another_line() -> None:
    frame = ("explain", "rtu", "01 03", "--picture", "levels", "--line", "9600,8N1")
    assert "8N1 at 9600 bit/s: a bit lasts 104.2 us, a character of 10 bits 1.042 ms" in output_of(*frame)
    assert "9600 bit/s" in output_of("explain", "ascii", ":010300", "--format", "html", "--line", "9600,7O1")


def test_a_recording_has_no_picture_of_a_frame(tmp_path: Path) -> None:
    (tmp_path / "bus.log").write_text(EXCHANGE)
    for option in (("--format", "svg"), ("--picture", "levels")):
        assert "is a recording" in error_of("explain", "can", str(tmp_path / "bus.log"), *option, status=2)
    rows = output_of("explain", "can", str(tmp_path / "bus.log"), "--format", "json").splitlines()
    assert all(json.loads(row) for row in rows)


def test_a_damaged_frame_has_its_diagnosis_as_text_and_as_json() -> None:
    rows = output_of("explain", "rtu", "01 03 00 00 00 0A CD C5").splitlines()
    assert rows[-1] == (
        "diagnosis: the two CRC bytes are exchanged; the low byte goes first [crc-swapped]: "
        "01 03 00 00 00 0A C5 CD is a request to unit 1, Read Holding Registers, 10 from 0000h; CRC ok"
    )
    (found,) = json.loads(output_of("explain", "rtu", "01 03 00 00 00 0A CD C5", "--json"))["diagnosis"]
    assert list(found) == ["code", "text", "proof"]
    assert json.loads(output_of("explain", "rtu", "01 03 00 00 00 0A C5 CD", "--json"))["diagnosis"] == []


def test_a_response_is_compared_with_its_request() -> None:
    request = ("--request", "01 03 00 04 00 02 85 CA")
    assert "to 03 Read Holding Registers, and unit 1 was asked [wrong-answer]" in output_of(
        "explain", "rtu", "02 83 02 30 F1", *request
    )
    floats = output_of("explain", "rtu", "01 03 04 00 00 42 48 CA A5", *request, "--floats", "f32")
    assert "50 in CDAB [word-order]" in floats
    known = output_of("explain", "rtu", "01 03 04 42 48 00 00 6E 5D", *request, "--device", "az3")
    assert "SPIDAC CHANNEL 1 SCALE is 2.37772e-41 in the order CDAB, and 50 in ABCD" in known
    address = output_of("explain", "rtu", "01 83 02 C0 F1", "--request", "01 03 9C 41 00 01 FA 4E")
    assert "9C41h is 40001" in address


def test_wrong_uses_of_a_request() -> None:
    request = ("--request", "01 03 00 04 00 02 85 CA")
    answer = ("explain", "rtu", "01 83 02 C0 F1")
    for options, words in (
        (("--floats", "f32"), "--floats needs --request"),
        (("--device", "az3"), "--device is for can, or for a response with its --request"),
        ((*request, "--role", "request"), "with --request the frame is the response"),
        ((*request, "--node", "5", "--device", "az3"), "--request needs one --device, and no --node"),
        ((*request, "--device", "az3", "--floats", "f32"), "--floats: the --device has its own types"),
        (("--request", "0G"), "'G' at 1 is not a hexadecimal digit"),
    ):
        assert words in error_of(*answer, *options, status=2)
    assert "expected rtu, ascii or tcp" in error_of("explain", "can", "605#40", "--request", "605#40", status=2)
