"""The battery that is held against strangers, held against ourselves: Server and Table, in virtual time."""

from __future__ import annotations

import pytest

from barewire.ascii import AsciiLine, encode as ascii_frame
from barewire.modbus import Adu, Server, Table
from barewire.modbus.conformance.cases import CASES_ASCII, CASES_RTU, CASES_TCP
from barewire.modbus.conformance.model import CLOSED, SILENCE, ServerCase, StepAnswer, answer_text, difference
from barewire.rtu import RtuLine, Timing, decode as rtu_decode, encode as rtu_frame
from barewire.tcp import TcpLine, decode as tcp_decode, encode as tcp_frame
from tests.helpers import unhex

UNIT = 1
TIMING = Timing.of(9600)


def over_tcp(case: ServerCase, unit: int = UNIT) -> list[StepAnswer]:
    """Every step in one segment; after a hang-up the next one has a new connection."""
    units = {UNIT: Table(100)}
    server, heard, number = Server(TcpLine(), units, serial=False), list[StepAnswer](), 0
    for step in case.steps:
        data, numbers = b"", []
        for stimulus in step.stimuli:
            number += 1
            numbers.append(number)
            data += stimulus.framed(lambda to, pdu: tcp_frame(to, pdu, number), unit)  # noqa: B023 - called at once
        answers = [tcp_decode(reply.data) for reply in server.feed(data, 1.0)]
        assert [adu.transaction for adu in answers] == numbers[: len(answers)]
        heard.append(answers)
        if server.line.broken is not None:
            heard[-1] = answers or None
            server = Server(TcpLine(), units, serial=False)
    return heard


def over_rtu(case: ServerCase, *, strict: bool, chunk: int = 256) -> list[StepAnswer]:
    """Every step at the speed of the line, in chunks of so many bytes, and then silence."""
    units = {UNIT: Table(100)}
    line = RtuLine(TIMING, role="server", units=units, patience=None if strict else 0.03)
    server, heard, now = Server(line, units, serial=True), list[StepAnswer](), 1.0
    for step in case.steps:
        now += step.after
        replies = []
        data = b"".join(stimulus.framed(rtu_frame, UNIT) for stimulus in step.stimuli)
        for at in range(0, len(data), chunk):
            part = data[at : at + chunk]
            now += TIMING.duration(len(part))
            replies += server.feed(part, now)
        while (deadline := server.deadline) is not None:
            now = max(now, deadline)
            replies += server.feed(None, now)
        heard.append([rtu_decode(reply.data) for reply in replies])
        for reply in replies:
            now = max(now, reply.at) + TIMING.duration(len(reply.data))
            line.sent(now)
        now += TIMING.t35
    return heard


def over_ascii(case: ServerCase, chunk: int = 600) -> list[StepAnswer]:
    """Every step in chunks of so many characters, and then nothing for a while."""
    units = {UNIT: Table(100)}
    line = AsciiLine()
    server, heard, now = Server(line, units, serial=True), list[StepAnswer](), 1.0
    ears = AsciiLine()
    for step in case.steps:
        now += step.after
        replies = []
        data = b"".join(stimulus.framed(ascii_frame, UNIT) for stimulus in step.stimuli)
        for at in range(0, len(data), chunk):
            now += 0.001
            replies += server.feed(data[at : at + chunk], now)
        now += 0.2
        replies += server.feed(None, now)
        heard.append([event for reply in replies for event in ears.feed(reply.data, now) if isinstance(event, Adu)])
        assert len(heard[-1] or ()) == len(replies)
    return heard


@pytest.mark.parametrize("case", CASES_TCP, ids=lambda case: case.name)
def test_a_tcp_server(case: ServerCase) -> None:
    assert difference(case, over_tcp(case), UNIT) is None


@pytest.mark.parametrize("chunk", [1, 7, 256])
@pytest.mark.parametrize("case", CASES_RTU, ids=lambda case: case.name)
def test_an_rtu_server(case: ServerCase, chunk: int) -> None:
    assert difference(case, over_rtu(case, strict=False, chunk=chunk), UNIT) is None


@pytest.mark.parametrize("case", CASES_RTU, ids=lambda case: case.name)
def test_an_rtu_server_by_the_letter(case: ServerCase) -> None:
    assert difference(case, over_rtu(case, strict=True), UNIT) is None


@pytest.mark.parametrize("chunk", [1, 7, 600])
@pytest.mark.parametrize("case", CASES_ASCII, ids=lambda case: case.name)
def test_an_ascii_server(case: ServerCase, chunk: int) -> None:
    assert difference(case, over_ascii(case, chunk), UNIT) is None


def test_what_ours_does_where_there_is_a_choice() -> None:
    """The ways that the battery leaves open, decided."""
    said = {case.name: [answer_text(one) for one in over_tcp(case)] for case in CASES_TCP}
    assert said["80h is no function"] == [SILENCE]
    assert said["10 cut short"] == ["90 03"]
    assert said["length 0"] == [CLOSED, "03 02 00 00"]
    assert said["another protocol identifier is discarded"] == [CLOSED, "03 02 00 00"]
    assert said["unit 0, if it is nobody"] == said["unit 255, if it is nobody"] == ["83 0B"]
    assert said["08/0B bus message count, if it has diagnostics"] == ["88 01"]
    assert said["2B/0D, which hardly anybody has"] == ["AB 01"]
    said = {case.name: [answer_text(one) for one in over_ascii(case)] for case in CASES_ASCII}
    assert said["lower-case digits: answered or not, and the next one is"] == ["03 02 00 00"] * 2
    assert said["08/03 another delimiter, if it can be changed, until 08/01"][0] == "08 00 03 3B 00"
    said = {case.name: [answer_text(one) for one in over_rtu(case, strict=False)] for case in CASES_RTU}
    assert said["08/04 listen only: silence from then on, until 08/01"] == [SILENCE, SILENCE, SILENCE, "03 02 00 00"]
    assert said["08/0B bus message count, if it has diagnostics"] == ["08 00 0B 00 01"]
    assert said["03 cut short"] == ["83 03"]


# The checker checked ---------------------------------------------------------------------------------------------

BY_NAME = {case.name: case for case in (*CASES_RTU, *CASES_ASCII, *CASES_TCP)}


@pytest.mark.parametrize(
    ("name", "answers", "said"),
    [
        ("03 with quantity 0", ["80 01"], "03 with quantity 0: 80 01, expected 83 03"),
        ("03 with quantity 0", [None], "03 with quantity 0: closed, expected 83 03"),
        ("03 cut short", [""], "03 cut short: silence, expected 83 03 or closed"),
        ("five requests in one segment", ["03 02 00 00"], "five requests in one segment: 03 02 00 00, expected"),
        ("17 writes before it reads", ["06 00 00 12 34", "17 02 12 34"], "17 writes before it reads: 06 00 00 12 34, "),
        ("a request to nobody is not answered", ["83 04", "03 02 00 00"], "a request to nobody is not answered: 83 04"),
        ("80h is no function", ["00 01"], "80h is no function: 00 01, expected silence or closed or 80 01"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_in_one_sentence(name: str, answers: list[str | None], said: str) -> None:
    heard: list[StepAnswer] = [None if one is None else [Adu(UNIT, unhex(one))] * bool(one) for one in answers]
    assert (difference(BY_NAME[name], heard, UNIT) or "").startswith(said)


def test_a_server_that_is_silent_must_stay_so() -> None:
    case = BY_NAME["08/04 listen only: silence from then on, until 08/01"]
    value, silence = [Adu(UNIT, unhex("03 02 0000"))], list[Adu]()
    assert difference(case, [silence, silence, silence, value], UNIT) is None
    assert difference(case, [silence, value, silence, value], UNIT) is not None


def test_an_answer_in_another_units_name_is_found() -> None:
    heard: list[StepAnswer] = [[Adu(9, unhex("83 03"))]]
    assert difference(CASES_TCP[0], heard, UNIT) == "03 with quantity 0: an answer from unit 9"


def test_cases_have_names_of_their_own_and_a_clause() -> None:
    for cases in (CASES_TCP, CASES_RTU, CASES_ASCII):
        assert len({case.name for case in cases}) == len(cases)
    for case in BY_NAME.values():
        assert case.clause.startswith("MB-")
        assert {len(way) for way in case.ways} == {len(case.steps)}
