"""The Python side of the explorer, on this Python: what each view of the page is given."""

from __future__ import annotations

import json
from base64 import b64encode
from typing import Any

import pytest
from hypothesis import given, strategies as st

from barewire.canopen import CanFrame
from barewire.devices import load
from barewire.rtu import decode
from barewire_workbench.eds.export import export
from barewire_workbench.recordings.capture import file_header, packet_block, to_packet
from docs.explorer.bridge import CALLS, call


def ask(name: str, **values: Any) -> Any:
    """Return the result of a call. An error is an assertion error here."""
    answer = json.loads(call(name, json.dumps(values)))
    assert "error" not in answer, answer["error"]
    return answer["result"]


def refused(name: str, **values: Any) -> str:
    """Return the error of a call that must have one."""
    error: str = json.loads(call(name, json.dumps(values)))["error"]
    return error


def test_a_frame_has_its_verdict_its_bytes_and_pictures() -> None:
    found = ask("frame", protocol="rtu", text="01 03 00 00 00 02 C4 0B", role="")
    assert found["valid"]
    assert [byte["hex"] for byte in found["bytes"]] == ["01", "03", "00", "00", "00", "02", "C4", "0B"]
    assert [byte["name"] for byte in found["bytes"]][-2:] == ["CRC", "CRC"]
    assert set(found["pictures"]) == {"fields", "levels"}


def test_a_broken_frame_has_a_diagnosis() -> None:
    found = ask("frame", protocol="rtu", text="01 03 00 00 00 0A CD C5")
    assert not found["valid"]
    assert [finding["code"] for finding in found["diagnosis"]][:1] == ["crc-swapped"]


@pytest.mark.parametrize(
    ("protocol", "text", "at", "hex_", "edited"),
    [
        ("rtu", "01 03 00 00 00 02 C4 0B", 5, "3", "01 03 00 00 00 03 C4 0B"),
        ("tcp", "000100000006010300000001", 11, "ff", "00 01 00 00 00 06 01 03 00 00 00 FF"),
        ("ascii", ":01040FB1000239", 14, "8", ":01040FB1000238"),
        ("can", "605#4041600000000000", 0, "43", "605#43 41 60 00 00 00 00 00"),
    ],
)
def test_a_byte_is_edited_in_the_text(protocol: str, text: str, at: int, hex_: str, edited: str) -> None:
    assert ask("edit", protocol=protocol, text=text, at=at, hex=hex_) == edited


def test_an_edit_outside_the_frame_and_a_byte_that_is_none_are_refused() -> None:
    assert refused("edit", protocol="rtu", text="01 03", at=2, hex="00") == "byte 2: the frame has 2"
    assert "'1G' is not a hexadecimal number" in refused("edit", protocol="rtu", text="01 03", at=0, hex="1G")
    assert "'-1' is not a hexadecimal number" in refused("edit", protocol="can", text="605#40", at=0, hex="-1")


@given(st.binary(min_size=2, max_size=60))
def test_a_mended_frame_of_any_bytes_has_the_right_crc(body: bytes) -> None:
    mended = ask("mend", protocol="rtu", text=(body + b"\0\0").hex(" "))
    assert decode(bytes.fromhex(mended)).pdu == body[1:]


def test_mending_computes_lrc_and_length() -> None:
    assert ask("mend", protocol="ascii", text=":01040FB1000200") == ":01040FB1000239"
    assert (
        ask("mend", protocol="tcp", text="00 01 00 09 00 00 01 03 00 00 00 01") == "00 01 00 00 00 06 01 03 00 00 00 01"
    )


@given(st.sampled_from(["rtu", "ascii", "tcp", "can"]), st.text(max_size=40))
def test_no_text_raises(protocol: str, text: str) -> None:
    for name in ("frame", "mend"):
        assert set(json.loads(call(name, json.dumps({"protocol": protocol, "text": text})))) <= {"result", "error"}


LINKTYPE_CAN = 227
NUMBERED = "the number of a holding register in a manual"
LOG = "Tx:000000-01 03 00 00 00 02 C4 0B\nRx:000001-01 03 04 00 00 01 10 FA 6F"
BUS = "(1.0) can0 705#00\n(1.1) can0 705#05"


@pytest.mark.parametrize(
    ("text", "says", "view"),
    [
        ("01 04 0F B1 00 02 22 F8", "a frame of Modbus RTU, valid (certain)", "frame"),
        ("01 04 0F B1 00 02 22 F9", "a frame of Modbus RTU, with a mistake (likely)", "frame"),
        ("00 01 00 00 00 06 01 03 00 6B 00 03", "a frame of Modbus TCP, valid (certain)", "frame"),
        (":01040FB1000239", "a frame of Modbus ASCII, valid (certain)", "frame"),
        ("605#4041600000000000", "a CAN frame (certain)", "frame"),
        ("00000000: 0103 0000 000a c5cd  ........", "a frame of Modbus RTU, valid (certain)", "frame"),
        ("3F8C CCCD", "registers (likely)", "values"),
        ("1,1", "a number (likely)", "values"),
        ("58Fh", "a status word of a drive (possible)", "steps"),
        (
            "40108",
            "the number of a holding register in a manual, address 107 on the wire: a request for it (likely)",
            "frame",
        ),
        (LOG, "a log, with 2 frames or pieces of frames (certain)", "log"),
        (BUS, "a log, with 2 frames or pieces of frames (certain)", "log"),
        ("DEBUG send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb", "a log, with 1 frame or pieces of frames (likely)", "log"),
        ("[DeviceInfo]\nProductName=x", "an electronic data sheet (certain)", "eds"),
    ],
)
def test_a_guess_says_what_it_is_and_its_view_shows_it(text: str, says: str, view: str) -> None:
    found = ask("guess", text=text)
    assert (f"{found[0]['says']} ({found[0]['sure']})", found[0]["view"]) == (says, view)
    for guess in found:
        name, values = guess["view"], guess["values"]
        ask({"values": "placed" if "value" in values else "values"}.get(name, name), **values)


def test_a_capture_is_shown_as_a_log() -> None:
    frames = [CanFrame.parse("705#00"), CanFrame.parse("605#4041600000000000")]
    capture = [file_header(LINKTYPE_CAN), *(packet_block(1.0, to_packet(frame)) for frame in frames)]
    (found,) = ask("guess", data=b64encode(b"".join(capture)).decode())
    assert (found["says"], found["view"]) == ("a capture", "log")
    assert "boot-up" in ask("log", **found["values"])["lines"][0]


def test_what_is_nothing_is_said() -> None:
    assert refused("guess", text="hello").startswith("no frame, log, EDS or value is in it")
    assert refused("guess", text="  ").startswith("nothing there")
    assert "at most" in refused("guess", data=b64encode(bytes(4_000_001)).decode())


@given(st.text(max_size=60) | st.from_regex(r"[0-9A-F :#\[\]\n]{0,40}", fullmatch=True))
def test_no_guess_raises(text: str) -> None:
    answer = json.loads(call("guess", json.dumps({"text": text})))
    assert set(answer) <= {"result", "error"}


def test_a_data_sheet_has_its_objects_and_findings() -> None:
    found = ask("eds", text=export(load("az3")).encode().decode())
    assert found["rows"][0][0] == "1000h:00"


def test_registers_are_every_type_in_every_order() -> None:
    found = ask("values", text="3F8C CCCD 0001")
    rows = {row["type"]: row["values"] for row in found["rows"]}
    assert rows["f32"][0] == "1.100000023841858"
    assert rows["u32"][1] == str(0xCCCD3F8C)
    assert rows["u64"] == [None] * 4
    assert ask("values", text="3F8C CCCD 0001", start=2)["rows"][0]["values"][0] == "1"
    assert refused("values", text="3F8C CC") == "3 bytes are not whole registers of two bytes"
    assert refused("values", text="3F8C", start=1) == "register 1: there are 1, counted from 0"


def test_a_value_is_placed_in_registers() -> None:
    found = ask("placed", type="f32", value="1.1")
    assert {row["order"]: row["registers"] for row in found["rows"]}["CDAB"] == ["CCCD", "3F8C"]
    assert not found["exact"]
    assert ask("placed", type="u32", value="0x10000")["exact"]
    assert "does not fit u16" in refused("placed", type="u16", value="65536")
    assert refused("placed", type="f32", value="one") == "'one' is not a number"


@pytest.mark.parametrize("device", ["csd-mt", "az3"])
def test_a_drive_is_enabled_and_turns(device: str) -> None:
    started = ask("drive", device=device)
    for action in ("shutdown", "switch-on", "enable"):
        ask("act", action=action)
    ask("act", action="set", values={"mode": started["modes"]["velocity"], "target_velocity": 2000})
    now = 0.0
    for _ in range(30):
        found = ask("sample", now=(now := now + 0.1))
    assert found["state"] == "operation enabled"
    assert found["velocity"] > 1500
    assert found["position"] > 0
    assert {frame["role"] for frame in found["frames"]} == {"request", "response"}
    assert [frame["number"] for frame in found["frames"]] == sorted(frame["number"] for frame in found["frames"])
    assert len(found["frames"]) <= 200
    ask("act", action="quick-stop")
    assert ask("sample", now=now + 0.2)["state"] != "operation enabled"


@pytest.mark.parametrize("device", ["csd-mt", "az3"])
def test_a_supply_out_of_range_is_a_fault_that_is_reset(device: str) -> None:
    ask("drive", device=device)
    for action in ("shutdown", "switch-on", "enable"):
        ask("act", action=action)
    ask("sample", now=0.2)
    ask("act", action="volts", values={"volts": 100})
    assert ask("sample", now=0.4)["state"].startswith("fault")
    ask("act", action="volts", values={"volts": 48})
    ask("sample", now=0.6)
    ask("act", action="reset")
    found = ask("sample", now=0.8)
    assert found["state"] == "switch on disabled"
    assert "fault" in found["states"]


def test_frames_of_a_sample_come_once() -> None:
    ask("drive", device="csd-mt")
    first = ask("sample", now=0.1)["frames"]
    again = ask("sample", now=0.2, after=first[-1]["number"])["frames"]
    assert again[0]["number"] == first[-1]["number"] + 1


def test_unknown_names_are_refused() -> None:
    assert "expected one of csd-mt, az3" in refused("drive", device="x")
    assert "expected one of shutdown" in refused("act", action="jump")


def test_every_call_is_used_by_the_page() -> None:
    from tools.website.explorer import SOURCE

    scripts = "".join(file.read_text(encoding="utf-8") for file in SOURCE.glob("*.js"))
    assert [name for name in CALLS if f'call("{name}"' not in scripts and name != "style"] == []


def test_every_calculation_has_steps_for_what_it_shows_at_first() -> None:
    for kind in ask("kinds"):
        inputs = {given["name"]: given["value"] for given in kind["inputs"]}
        assert not {"view", "kind", "at"} & inputs.keys(), "names of the link"
        assert ask("steps", kind=kind["name"], **inputs)["result"]
    assert refused("steps", kind="timing", baudrate="fast", form="8E1") == "'fast' is not a whole number"
    assert "expected one of crc, lrc" in refused("steps", kind="x")


def test_a_log_of_modbus_and_one_of_can() -> None:
    found = ask("log", text="Tx:000000-01 03 00 00 00 02 C4 0B\nRx:000001-01 03 04 00 00 01 10 FA 6F\n")
    assert found["kind"] == "Modbus"
    assert found["lines"] == ["unit 1  Read Holding Registers, 2 from 0000h -> 0 272"]
    assert "unit 1" in found["picture"]
    assert (found["findings"], len(found["verdicts"])) == ([], 1)
    assert "nothing wrong" in found["verdicts"][0]
    found = ask("log", text="(1.0) can0 705#00\n(1.3) can0 605#4041600000000000\n")
    assert found["kind"] == "CAN"
    assert any("boot-up" in line for line in found["lines"])
    sent = "10:00:00,100 DEBUG send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb\n"
    received = "10:00:00,200 DEBUG recv: 0x1 0x3 0x4 0x0 0x0 0x1 0x10 0xfa 0x6f\n"
    again = sent.replace(",100", ",150")
    found = ask("log", text=f"2026-03-01 {sent}2026-03-01 {again}2026-03-01 {received}")
    assert [line[:17] for line in (found["lines"][0], found["findings"][0])] == [
        "10:00:00.100000  ",
        "10:00:00.150000  ",
    ]
    assert ">10:00:00.100000<" in found["picture"]
    assert "time, s" not in found["picture"]
    lines = ask("log", text=f"2026-03-01 {sent}2026-03-02 {sent}")["lines"]
    assert [line[:28] for line in lines] == ["2026-03-01 10:00:00.100000  ", "2026-03-02 10:00:00.100000  "]
    unanswered = "".join(f"{second}.0 01 03 00 00 00 02 C4 0B\n" for second in range(6))
    assert "no-answers" in str(ask("log", text=unanswered)["verdicts"])
    many = "".join(f"({number}.0) can0 585#80181005000000{number % 256:02X}\n" for number in range(700))
    assert "more than 500 lines" in ask("log", text=many)["lines"][-1]


@given(st.text(max_size=60))
def test_no_log_raises(text: str) -> None:
    assert set(json.loads(call("log", json.dumps({"text": text})))) <= {"result", "error"}


def test_a_device_gives_a_response_its_types_and_a_pdo_its_names() -> None:
    found = ask("frame", protocol="can", text="185#3706000000000000", device="az3")
    assert any("STATUS WORD" in field["name"] for field in found["fields"])
    found = ask("frame", protocol="rtu", text="02 03 02 00 07 BD 86", request="01 03 00 00 00 01 84 0A")
    assert found["diagnosis"][0]["code"] == "wrong-answer"
