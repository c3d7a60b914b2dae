"""What the answers to the vectors do not show of barewire: bytes counted on arrival, receivers that do not count.

A valid case of RTU must hold for every receiver that follows the standard. So it is also checked with a receiver that
uses silence and CRC only.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

import barewire.rtu
from barewire.errors import DecodeError
from barewire.modbus.adu import Noise
from barewire.modbus.framing import Line
from barewire.modbus.messages.registry import measure_request, measure_response
from barewire.rtu import Timing, crc16
from barewire.rtu.crc import crc16_bit_by_bit
from barewire.rtu.line import RtuLine
from barewire.tcp import TcpLine
from barewire_workbench.vectors.answers.values import octets
from barewire_workbench.vectors.judge import judge
from barewire_workbench.vectors.questions import Case, Question
from tests.helpers import every_case
from tests.workbench.vectors.loaded import VECTORS

CASES = [(file.kind, case) for file in VECTORS.files for case in file.cases]


def of(kind: str, result: str) -> list[Any]:
    return [pytest.param(case, id=case["id"]) for one, case in CASES if (one, case["result"]) == (kind, result)]


@every_case("case", of("pdu", "valid") + of("pdu", "acceptable"))
def test_a_pdu_is_measured_while_it_arrives(case: Case) -> None:
    """Given the start of a PDU, `measure` asks for more bytes until it has all, never for too many."""
    if "uncountable" in case.get("flags", ()):
        return
    measure: Callable[[bytes], int | None] = measure_request if case["side"] == "request" else measure_response
    pdu, have = octets(case["pdu"]), 1
    while (wanted := measure(pdu[:have])) is not None and wanted > have:
        assert wanted <= len(pdu)
        have = wanted
    assert wanted == len(pdu)


@every_case("case", of("crc16", "valid"))
def test_the_table_of_the_crc_is_that_of_the_shift_register(case: Case) -> None:
    data = octets(case["bytes"])
    assert crc16(data) == crc16_bit_by_bit(data)


@every_case("case", of("rtu-frame", "valid"))
def test_a_frame_is_uncountable_if_its_flag_says_so_and_a_strict_line_takes_it(case: Case) -> None:
    frame, pdu = octets(case["frame"]), octets(case["pdu"])
    measure: Callable[[bytes], int | None] = measure_response if case["side"] == "response" else measure_request
    assert (measure(pdu) is not None) != ("uncountable" in case.get("flags", ())) or pdu[0] < 0x64
    line = RtuLine(Timing.of(19200), role="server", units={case["unit"]}, patience=None)
    events = [*line.feed(frame, 1.0), *line.feed(None, 1e6)]
    assert [(event.unit, event.pdu) for event in events if not isinstance(event, Noise)] == [(case["unit"], pdu)]


@every_case("case", of("rtu-frame", "invalid"))
def test_a_line_reports_a_broken_frame_with_its_reason(case: Case) -> None:
    if case["fails"] == "decode":
        assert noise_of(RtuLine(Timing.of(19200), patience=None), octets(case["frame"]))[:1] in ([], [case["reason"]])


@every_case("case", of("tcp-frame", "invalid"))
def test_a_stream_reports_a_broken_header_with_its_reason(case: Case) -> None:
    if case["fails"] == "decode" and case["reason"] in ("protocol", "length"):
        assert noise_of(TcpLine(), octets(case["frame"])) == [case["reason"]]


def noise_of(line: Line, data: bytes) -> list[str]:
    """The reasons of the noise; there must be no frame."""
    events = [*line.feed(data, 1.0), *line.feed(None, 1e6)]
    noise: list[str] = [event.reason for event in events if isinstance(event, Noise)]
    assert len(noise) == len(events)
    return noise


@every_case("case", [case for kind, case in CASES if kind == "sdo-talk"])
def test_what_may_be_said_in_several_ways_is_not_heard(case: Case) -> None:
    """The side that hears it would be asked with a choice in place of bytes."""
    several = {side.partition(" ")[0] for side, data in case["talk"] if isinstance(data, dict)}
    assert several <= {"client", "server"} - {case.get("broken")}
    assert not several or "broken" in case


@every_case("case", of("rtu-talk", "valid"))
def test_a_valid_talk_holds_for_a_receiver_of_silence_and_crc(case: Case) -> None:
    setup = case["line"]
    timing = Timing.of(setup["baud"], setup["bits"])
    expected = [event for step in case["talk"] for event in step["events"] if "pdu" in event]
    assert by_silence(case, timing) == [(event["unit"], octets(event["pdu"])) for event in expected]


def by_silence(case: Case, timing: Timing) -> list[tuple[int, bytes]]:
    """The frames of a receiver that uses silence and CRC, and neither function codes nor byte counts."""
    setup, found, piece, spoiled, last_at = case["line"], list[tuple[int, bytes]](), b"", False, 0.0
    ends = timing.t35 if setup["patience"] is None else setup["patience"] / 1e6
    breaks = timing.t15 if setup["patience"] is None else ends

    def end() -> None:
        with suppress(DecodeError):
            adu = barewire.rtu.decode(piece)
            found.append((adu.unit, adu.pdu))

    for step in case["talk"]:
        data, at = octets(step.get("hear", "")), step["at"] / 1e6
        gap = at - len(data) * timing.character - last_at
        if piece and gap >= ends:
            if not spoiled:
                end()
            piece, spoiled = b"", False
        spoiled = spoiled or (bool(piece and data) and gap > breaks)
        piece, last_at = piece + data, at if data else last_at
    if piece and not spoiled and not case["held"]:
        end()
    return found


def device_verdict(say: list[str], expected: list[Any]) -> str:
    """The verdict on a device that says `say` in one step where `expected` is right."""
    case = {"id": "device-1", "result": "valid", "device": {}, "talk": [{"at": 0, "say": expected}]}
    question = Question(case, "device", "run", {"talk": [{"at": 0}]}, {"talk": [{"say": expected}]})
    return judge(question, {"is": {"talk": [{"say": say}]}}).state


def test_one_of_several_right_frames_passes_and_another_one_fails() -> None:
    expected = [{"one_of": ["585#8000200000000106", "585#8000200022000008"]}]
    assert device_verdict(["585#8000200022000008"], expected) == "passed"
    assert device_verdict(["585#8000200000000106"], expected) == "passed"
    assert device_verdict(["585#8000200000000006"], expected) == "failed"
    assert device_verdict([], expected) == "failed"


def test_the_difference_of_a_long_talk_is_told_at_its_place() -> None:
    wanted: list[dict[str, Any]] = [{"say": ["585#00"]}, {"say": ["585#01"], "held": None}, {"say": []}]
    question = Question({"result": "valid", "id": "device-1"}, "device", "run", {}, {"talk": wanted, "ends": "done"})

    def texts(*steps: dict[str, Any]) -> str:
        return judge(question, {"is": {"talk": [*steps], "ends": "done"}}).text

    first, last = wanted[0], wanted[2]
    assert texts(first, {"say": ["585#02"]}, last) == 'talk[1].say is ["585#02"], expected ["585#01"]'
    assert texts(first, {"say": ["585#01"], "held": "0A"}, last) == "talk[1].held is 0A, expected null"
    assert texts(first, last) == 'talk has 2 items, expected 3; talk[1].say is [], expected ["585#01"]'
    assert texts(*wanted, last) == "talk has 4 items, expected 3"
    missing = judge(question, {"is": {"talk": wanted}}).text
    assert missing == "ends is missing, expected done"


def test_a_long_text_is_shown_where_it_differs() -> None:
    right = " ".join(f"{byte:02X}" for byte in range(253))
    question = Question({"result": "valid", "id": "lrc-1"}, "pdu", "encode", {}, {"pdu": right})
    text = judge(question, {"is": {"pdu": right[:-2] + "00"}}).text
    assert text.endswith("F9 FA FB FC, different from byte 252 on")
    assert "FA FB 00, expected ..." in text
    assert len(text) < 200
    assert judge(question, {"is": {"pdu": "88 01"}}).text.startswith("pdu is 88 01, expected 00 01 02")


def test_a_refusal_and_a_wrong_value_are_shown_without_the_id() -> None:
    valid = Question({"result": "valid", "id": "lrc-1"}, "lrc", "encode", {}, {"lrc": "F3"})
    assert judge(valid, {"id": "lrc-1.encode", "refused": ""}).text == 'refused, expected {"lrc": "F3"}'
    refusal = judge(valid, {"id": "lrc-1.encode", "refused": "value", "text": "below 0"})
    assert refusal.text == 'refused as value: below 0, expected {"lrc": "F3"}'
    case = {"result": "invalid", "fails": "encode", "reason": "value", "id": "lrc-1"}
    invalid = Question(case, "lrc", "encode", {}, {})
    text = judge(invalid, {"id": "lrc-1.encode", "is": {"lrc": "F3"}}).text
    assert text == '{"lrc": "F3"}, expected a refusal: value'


def test_two_dots_are_a_byte_that_may_have_any_value() -> None:
    expected = [{"one_of": ["085#308111........00", "085#3081FF"]}]
    assert device_verdict(["085#308111091B00FF00"], expected) == "passed"
    assert device_verdict(["085#3081FF"], expected) == "passed"
    assert device_verdict(["085#308111091B00FF01"], expected) == "failed"
    assert device_verdict(["085#308111091B00FF"], expected) == "failed"
    assert device_verdict(["085#308110091B00FF00"], expected) == "failed"


def test_the_order_of_frames_counts_within_an_identifier() -> None:
    expected = ["705#05", "085#01", {"one_of": ["085#02", "085#12"]}]
    assert device_verdict(["085#01", "085#02", "705#05"], expected) == "passed"
    assert device_verdict(["705#05", "085#02", "085#01"], expected) == "failed"
    assert device_verdict(["705#05", "085#01"], expected) == "failed"
