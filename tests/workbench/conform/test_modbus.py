"""The conformance cases, run against Server and Table in virtual time; and the comparison of the answers."""

from __future__ import annotations

import pytest

from barewire.ascii import AsciiLine, encode as ascii_frame
from barewire.modbus import Adu, Server, Table
from barewire.rtu import RtuLine, Timing, decode as rtu_decode, encode as rtu_frame
from barewire.tcp import TcpLine, decode as tcp_decode, encode as tcp_frame
from barewire_workbench.conform.modbus import CLOSED, SILENCE, ServerCase, StepAnswer, answer_text, difference
from barewire_workbench.live.modbus_conformance import cases_of
from tests.helpers import every_case, unhex

CASES_TCP, CASES_RTU, CASES_ASCII = map(cases_of, ("tcp", "rtu", "ascii"))
UNIT = 1
TIMING = Timing.of(9600)


def over_tcp(case: ServerCase, unit: int = UNIT) -> list[StepAnswer]:
    """Return the answers over TCP: every step in one segment, after a closed connection on a new one."""
    units = {UNIT: Table(100)}
    server, results, number = Server(TcpLine(), units, serial=False), list[StepAnswer](), 0
    for step in case.steps:
        data, numbers = b"", []
        for stimulus in step.stimuli:
            number += 1
            numbers.append(number)
            data += stimulus.framed(lambda to, pdu: tcp_frame(to, pdu, number), unit)  # noqa: B023 - called at once
        answers = [tcp_decode(reply.data) for reply in server.feed(data, 1.0)]
        assert [adu.transaction for adu in answers] == numbers[: len(answers)]
        results.append(answers)
        if server.line.broken is not None:
            results[-1] = answers or None
            server = Server(TcpLine(), units, serial=False)
    return results


def over_rtu(case: ServerCase, *, strict: bool, chunk: int = 256) -> list[StepAnswer]:
    """Return the answers over RTU: every step at the speed of the line, in chunks of `chunk` bytes, then silence."""
    units = {UNIT: Table(100)}
    line = RtuLine(TIMING, role="server", units=units, patience=None if strict else 0.03)
    server, results, now = Server(line, units, serial=True), list[StepAnswer](), 1.0
    for step in case.steps:
        now += step.after
        replies = []
        data = b"".join(stimulus.framed(rtu_frame, UNIT) for stimulus in step.stimuli)
        for start in range(0, len(data), chunk):
            part = data[start : start + chunk]
            now += TIMING.duration(len(part))
            replies += server.feed(part, now)
        while (deadline := server.deadline) is not None:
            now = max(now, deadline)
            replies += server.feed(None, now)
        results.append([rtu_decode(reply.data) for reply in replies])
        for reply in replies:
            now = max(now, reply.at) + TIMING.duration(len(reply.data))
            line.sent(now)
        now += TIMING.t35
    return results


def over_ascii(case: ServerCase, chunk: int = 600) -> list[StepAnswer]:
    """Return the answers over ASCII: every step in chunks of `chunk` characters, then 0.2 s of silence."""
    units = {UNIT: Table(100)}
    line = AsciiLine()
    server, results, now = Server(line, units, serial=True), list[StepAnswer](), 1.0
    client_line = AsciiLine()
    for step in case.steps:
        now += step.after
        replies = []
        data = b"".join(stimulus.framed(ascii_frame, UNIT) for stimulus in step.stimuli)
        for start in range(0, len(data), chunk):
            now += 0.001
            replies += server.feed(data[start : start + chunk], now)
        now += 0.2
        replies += server.feed(None, now)
        results.append(
            [event for reply in replies for event in client_line.feed(reply.data, now) if isinstance(event, Adu)]
        )
        assert len(results[-1] or ()) == len(replies)
    return results


@every_case("case", CASES_TCP)
def test_a_tcp_server(case: ServerCase) -> None:
    assert difference(case, over_tcp(case), UNIT) is None


@every_case("chunk", [1, 7, 256])
@every_case("case", CASES_RTU)
def test_an_rtu_server(case: ServerCase, chunk: int) -> None:
    assert difference(case, over_rtu(case, strict=False, chunk=chunk), UNIT) is None


@every_case("case", CASES_RTU)
def test_an_rtu_server_with_strict_t35(case: ServerCase) -> None:
    assert difference(case, over_rtu(case, strict=True), UNIT) is None


@every_case("chunk", [1, 7, 600])
@every_case("case", CASES_ASCII)
def test_an_ascii_server(case: ServerCase, chunk: int) -> None:
    assert difference(case, over_ascii(case, chunk), UNIT) is None


def test_the_answers_of_our_server_where_several_are_accepted() -> None:
    answers = {case.name: [answer_text(answer) for answer in over_tcp(case)] for case in CASES_TCP}
    assert answers["80h is not a function"] == [SILENCE]
    assert answers["10 cut short"] == ["90 03"]
    assert answers["length 0"] == [CLOSED, "03 02 00 00"]
    assert answers["another protocol identifier is discarded"] == [CLOSED, "03 02 00 00"]
    assert answers["unit 0, if it is unknown"] == answers["unit 255, if it is unknown"] == ["83 0B"]
    assert answers["08/0B bus message count, if it has diagnostics"] == ["88 01"]
    assert answers["2B/0D, which is rarely implemented"] == ["AB 01"]
    answers = {case.name: [answer_text(answer) for answer in over_ascii(case)] for case in CASES_ASCII}
    assert answers["lower-case digits: answered or not, and the next one is"] == ["03 02 00 00"] * 2
    assert answers["08/03 another delimiter, if it can be changed, until 08/01"][0] == "08 00 03 3B 00"
    answers = {case.name: [answer_text(answer) for answer in over_rtu(case, strict=False)] for case in CASES_RTU}
    assert answers["08/04 listen only: silence from then on, until 08/01"] == [SILENCE, SILENCE, SILENCE, "03 02 00 00"]
    assert answers["08/0B bus message count, if it has diagnostics"] == ["08 00 0B 00 01"]
    assert answers["03 cut short"] == ["83 03"]


# The comparison of answers ---------------------------------------------------------------------------------------

BY_NAME = {case.name: case for case in (*CASES_RTU, *CASES_ASCII, *CASES_TCP)}


@pytest.mark.parametrize(
    ("name", "answers", "text"),
    [
        ("03 with quantity 0", ["80 01"], "03 with quantity 0: 80 01, expected 83 03"),
        ("03 with quantity 0", [None], "03 with quantity 0: closed, expected 83 03"),
        ("03 cut short", [""], "03 cut short: silence, expected 83 03 or closed"),
        ("five requests in one segment", ["03 02 00 00"], "five requests in one segment: 03 02 00 00, expected"),
        ("17 writes before it reads", ["06 00 00 12 34", "17 02 12 34"], "17 writes before it reads: 06 00 00 12 34, "),
        ("a wrong CRC is not answered", ["83 04", "03 02 00 00"], "a wrong CRC is not answered: 83 04"),
        ("80h is not a function", ["00 01"], "80h is not a function: 00 01, expected silence or closed or 80 01"),
    ],
)  # fmt: skip
def test_a_difference_is_one_sentence(name: str, answers: list[str | None], text: str) -> None:
    received: list[StepAnswer] = [None if pdu is None else [Adu(UNIT, unhex(pdu))] * bool(pdu) for pdu in answers]
    assert (difference(BY_NAME[name], received, UNIT) or "").startswith(text)


def test_a_server_in_listen_only_mode_must_stay_silent() -> None:
    case = BY_NAME["08/04 listen only: silence from then on, until 08/01"]
    value, silence = [Adu(UNIT, unhex("03 02 0000"))], list[Adu]()
    assert difference(case, [silence, silence, silence, value], UNIT) is None
    assert difference(case, [silence, value, silence, value], UNIT) is not None


def test_an_answer_from_another_unit_is_a_difference() -> None:
    received: list[StepAnswer] = [[Adu(9, unhex("83 03"))]]
    assert difference(CASES_TCP[0], received, UNIT) == "03 with quantity 0: an answer from unit 9"


def test_every_case_has_a_unique_name_and_a_clause() -> None:
    for cases in (CASES_TCP, CASES_RTU, CASES_ASCII):
        assert len({case.name for case in cases}) == len(cases)
    for case in BY_NAME.values():
        assert case.clause.startswith("MB-")
        assert {len(sequence) for sequence in case.accepts} == {len(case.steps)}
