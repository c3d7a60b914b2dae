"""Recordings of Modbus: good ones in every form have no finding; each fault of a line yields its verdict."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import get_args

import pytest

from barewire.ascii import encode as ascii_frame
from barewire.rtu import RtuLine, Timing, encode
from barewire.tcp import encode as tcp_frame
from barewire_workbench.diagnosis.modbus_log import LiveDiagnosis, ModbusLogDiagnosis
from barewire_workbench.diagnosis.verdict import VERDICTS, VerdictCode
from barewire_workbench.recordings.modbus_log import read_modbus_log
from barewire_workbench.sniffer import WINDOW
from barewire_workbench.wire import CharacterFormat, ReceiverFault, UartLine
from tests.helpers import every_case, part_or_whole, some_of
from tests.workbench.diagnosis.modbus_cases import (
    DEVICES,
    FORMS,
    Sent,
    Traffic,
    diagnosed,
    flipped,
    injected,
    log_of,
    misread,
    noisy,
    of_device,
    of_tables,
    spaced,
    without_responses,
)

SAMPLES = Path(__file__).parents[1] / "recordings" / "modbus_log" / "samples"
N81, E81 = CharacterFormat(8, "N", 1), CharacterFormat(8, "E", 1)

NO_FAULT = {"nothing-wrong", "refused", "open"}
"""The verdicts on a good line: most of these logs have exceptions, and some end before a response."""

GOOD = [
    (framing, source, form)
    for framing, devices in DEVICES.items()
    for source in ("tables", *devices)
    for form in FORMS
    if (framing, form) not in (("ascii", "capture"), ("tcp", "pieces"))
]


@pytest.mark.parametrize("seeds", part_or_whole(1, 3))
@every_case(("framing", "source", "form"), GOOD)
def test_a_good_recording_has_no_finding(framing: str, source: str, form: str, seeds: int) -> None:
    for seed in range(seeds):
        traffic = of_tables(framing, seed) if source == "tables" else of_device(framing, source, seed)
        findings, verdicts = diagnosed(log_of(traffic, form, seed))
        assert [found.sentence for found in findings] == [], seed
        assert {verdict.code for verdict in verdicts} <= NO_FAULT, seed


@pytest.mark.parametrize("form", ["times", "marks", "words", "capture", "pieces"])
def test_a_recording_may_begin_and_end_anywhere(form: str) -> None:
    traffic = of_tables("rtu", 11, 30)
    for first in range(0, 12, 3):
        findings, verdicts = diagnosed(log_of(traffic[first : len(traffic) - first], form))
        assert [found.sentence for found in findings] == []
        assert {verdict.code for verdict in verdicts} <= NO_FAULT


def read(unit: int, start: float, *, words: int = 2, late: float = 0.02) -> Traffic:
    """Return a read of registers, and its response."""
    request = encode(unit, bytes((3, 0, 0, 0, words)))
    return [
        Sent(start, request, True),
        Sent(start + late, encode(unit, bytes((3, 2 * words, *range(2 * words)))), False),
    ]


def polls(count: int, *units: int, period: float = 0.1) -> Traffic:
    """Return reads of several units in turn."""
    return [sent for place in range(count) for sent in read(units[place % len(units)], 1.0 + period * place)]


def of_a_bias_fault() -> Traffic:
    return noisy(polls(20, 1, 2), Random(1))


def of_an_echo() -> Traffic:
    done = []
    for sent in polls(12, 1, 2):
        done += [sent, sent._replace(at=sent.at + 0.001, from_client=False)] if sent.from_client else [sent]
    return done


def of_two_units() -> Traffic:
    done = []
    for sent in polls(12, 1, 2):
        second = sent._replace(at=sent.at + 0.004, data=encode(2, bytes((3, 4, 9, 9, 9, 9))))
        done += [sent, second] if not sent.from_client and sent.data[0] == 2 else [sent]
    return done


def of_a_collision() -> Traffic:
    random, done = Random(3), []
    for sent in polls(30, 1, 2, 3):
        if not sent.from_client and sent.data[0] == 2:
            mixed = sent.data[:2] + bytes(random.randrange(256) for _ in range(13))
            sent = sent._replace(data=mixed)
        done.append(sent)
    return done


def of_a_short_turnaround(*, first: bool = True) -> Traffic:
    part = slice(1, None) if first else slice(0, -1)
    return [sent if sent.from_client or place % 4 == 1 else sent._replace(data=sent.data[part])
            for place, sent in enumerate(polls(20, 1, 2))]  # fmt: skip


def of_unit_2(change: Callable[[bytes], bytes]) -> Traffic:
    """Return reads of units 1 and 2, with changed responses of unit 2."""
    changed = [not sent.from_client and sent.data[0] == 2 for sent in polls(12, 1, 2)]
    return [sent._replace(data=change(sent.data)) if hit else sent for hit, sent in zip(changed, polls(12, 1, 2))]


def of_a_crc_in_the_wrong_order() -> Traffic:
    return of_unit_2(lambda data: data[:-2] + data[:-3:-1])


def of_a_gateway() -> Traffic:
    return of_unit_2(lambda data: encode(2, b"\x83\x0b"))


TABLES = spaced(of_tables("rtu", 4, 40))
FAULTS: dict[str, tuple[Traffic, str, str]] = {
    "no bias": (of_a_bias_fault(), "no-bias", "of 20 responses had up to 2 bytes of noise before them"),
    "noise before requests": (noisy(TABLES, Random(2), 0.5, "all"), "no-bias", "requests had up to 2 bytes of noise"),
    "echo": (of_an_echo(), "echo", "12 of 12 requests were received again at once"),
    "two units": (of_two_units(), "two-units", "6 of 6 requests to it were answered twice"),
    "two units at once": (of_a_collision(), "two-units", "10 of 10 responses are damaged and longer than a response"),
    "a short turnaround": (of_a_short_turnaround(), "turnaround", "10 of 20 responses lack their first bytes"),
    "a short transmission": (of_a_short_turnaround(first=False), "turnaround", "10 of 20 responses lack their last"),
    "a dead unit": (
        without_responses(spaced(polls(12, 1, 2, 3)), 2), "dead-unit", "0 of 4 requests answered; others answered 8",
    ),
    "a unit that falls silent": (
        without_responses(spaced(polls(21, 1, 2, 3)), 2, 3), "dead-unit", "the last 4 of 7 requests have no answer",
    ),
    "a unit behind a gateway": (of_a_gateway(), "dead-unit", "0 of 6 requests answered; others answered 6"),
    "no unit": (without_responses(TABLES), "no-answers", "and no response"),
    "half the baud rate": (
        misread(polls(8, 1, 2), UartLine(N81, ReceiverFault(faster=2))), "baud-rate", "are good frames then",
    ),
    "no parity": (misread(polls(8, 1, 2), UartLine(N81, ReceiverFault(), E81)), "parity", "are good frames then"),
    "exchanged wires": (
        misread(polls(8, 1, 2), UartLine(N81, ReceiverFault(inverted=True))), "inverted", "are good frames then",
    ),
    "bits flipped": (flipped(polls(60, 1, 2), Random(5), 0.2), "disturbed", "bit-flip"),
    "bits of one unit flipped": (
        flipped(polls(60, 1, 2, 3), Random(5), 0.5, 2), "disturbed", "40 responses of other units are good",
    ),
    "a device with an exchanged CRC": (of_a_crc_in_the_wrong_order(), "malformed", "6 of 6 damaged pieces"),
    "random bytes": (
        [Sent(0.1 * place, Random(place).randbytes(9), True) for place in range(5)], "no-frames", "45 bytes in 5",
    ),
}  # fmt: skip


def test_a_damaged_character_of_ascii_is_no_second_device() -> None:
    """The characters of a response are twice its bytes."""
    traffic = []
    for sent in polls(20, 1, 2):
        frame = ascii_frame(sent.data[0], sent.data[1:-2])
        is_damaged = sent.data[0] == 2 and not sent.from_client
        traffic.append(sent._replace(data=frame[:7] + b"J" + frame[8:] if is_damaged else frame))
    _, verdicts = diagnosed(log_of(traffic, "words"))
    assert [verdict.code for verdict in verdicts] == ["disturbed"], verdicts


@every_case("name", FAULTS)
def test_a_fault_of_the_line_yields_its_verdict(name: str) -> None:
    traffic, code, evidence = FAULTS[name]
    findings, verdicts = diagnosed(log_of(traffic, "times"))
    shown = [verdict.sentence for verdict in verdicts]
    assert [verdict.code for verdict in verdicts] == [code], shown
    assert evidence in verdicts[0].evidence, shown
    assert findings
    assert all(found.finding.proof and found.line for found in findings)


@pytest.mark.parametrize("name", sorted(set(FAULTS) - {"random bytes"}))
@pytest.mark.parametrize("form", some_of(["words", "marks"], 1))
def test_the_form_of_the_log_does_not_change_the_verdict(name: str, form: str) -> None:
    traffic, code, _ = FAULTS[name]
    if name == "no unit":
        code = "open"  # with directions a log may show those of one side only
    assert [verdict.code for verdict in diagnosed(log_of(traffic, form))[1]] == [code]


def test_a_finding_has_the_line_and_the_time_of_its_place() -> None:
    first = diagnosed(log_of(of_a_bias_fault(), "times"))[0][0]
    assert (first.line, first.at, first.place) == (4, 1.12, "unit 2")
    assert first.sentence.startswith(
        "1.120000  line 4  unit 2  2 bytes of noise before a response of unit 2 [noise-before]:"
    )
    untimed = diagnosed(log_of(of_a_crc_in_the_wrong_order(), "plain"))[0][0]
    assert untimed.sentence.startswith("line 4  unit 2  the two CRC bytes are exchanged")
    assert untimed.as_dict()["at"] is None


def test_a_missing_response_is_at_the_line_of_its_request() -> None:
    findings, _ = diagnosed(log_of(without_responses(spaced(polls(4, 1, 2)), 2), "times"))
    assert [(found.line, found.finding.code) for found in findings] == [(3, "no-answer")]
    assert findings[0].finding.proof == "nothing for 1.000 s"


INJECTED = {
    "drop:0.4": {"lost-answers"},
    "flip:0.5": {"disturbed"},
    "noise:0.6": {"no-bias"},
    "wrong-unit:0.5": {"nothing-proved"},
    "late:0.4": {"nothing-proved", "late-answers", "refused", "open"},  # of one alone nothing follows
    "split:0.7": {"refused"},
    "paced:0.5": {"refused", "nothing-proved"},  # a long response takes longer than the time for it
    "exception:0.5": {"refused"},
}


@pytest.mark.parametrize("seeds", part_or_whole(1, 4))
@every_case("faults", INJECTED)
def test_the_faults_of_the_simulators_are_named_for_what_they_are(faults: str, seeds: int) -> None:
    for seed in range(seeds):
        findings, verdicts = diagnosed(log_of(injected(faults, seed), "marks"))
        assert {verdict.code for verdict in verdicts} <= INJECTED[faults], [found.sentence for found in findings]
        assert len(verdicts) == 1 or verdicts[0].code == "late-answers", seed


def test_a_request_at_the_end_of_a_recording_is_open() -> None:
    findings, verdicts = diagnosed(log_of(polls(4, 1)[:-1], "times"))
    assert findings == []
    assert [(verdict.code, verdict.evidence.partition(";")[0]) for verdict in verdicts] == [
        ("open", "1 request to unit 1 at the end")
    ]


def test_a_client_that_repeats_a_request_after_its_time_out_is_no_echo() -> None:
    retried = [sent for place in range(6) for sent in (read(1, 2.0 * place)[0], *read(1, 2.0 * place + 0.3))]
    findings, verdicts = diagnosed(log_of(retried, "times"))
    assert {found.finding.code for found in findings} == {"no-answer"}
    assert [(verdict.code, verdict.evidence) for verdict in verdicts] == [
        ("lost-answers", "6 of 12 requests have no response, of unit 1")
    ]


LONG = bytes.fromhex("03 06 0017 0007 0009")


@pytest.mark.parametrize("form", ["times", "words"])
@pytest.mark.parametrize("framing", ["rtu", "ascii", "tcp"])
def test_the_verdict_names_the_byte_count_that_was_not_asked_for(framing: str, form: str) -> None:
    encoded = {"rtu": encode, "ascii": ascii_frame, "tcp": tcp_frame}[framing]
    traffic = [Sent(1.0, encoded(1, bytes.fromhex("03 0010 0002")), True), Sent(1.02, encoded(1, LONG), False)]
    findings, verdicts = diagnosed(log_of(traffic, "capture" if framing == "tcp" else form))
    assert [found.finding.code for found in findings] == ["wrong-answer"]
    assert findings[0].finding.text.startswith("the device sent 3 registers where 2 were asked")
    (verdict,) = verdicts
    assert verdict.code == "nothing-proved"
    assert "1 wrong-answer of unit 1 (3 registers where 2 were asked)" in verdict.evidence
    assert "without its request" not in verdict.evidence


def test_an_earlier_open_request_of_that_length_proves_a_late_response() -> None:
    earlier = Sent(1.0, encode(1, bytes.fromhex("03 0010 0003")), True)
    request = Sent(2.0, encode(1, bytes.fromhex("03 0010 0002")), True)
    findings, _ = diagnosed(log_of([earlier, request, Sent(2.02, encode(1, LONG), False)], "times"))
    assert "late-answer" in {found.finding.code for found in findings}
    assert not any("3 registers where 2" in found.finding.text for found in findings)


@pytest.mark.parametrize("order", [(7, 8), (8, 7)])
def test_on_tcp_another_open_request_of_that_length_proves_an_exchanged_transaction(order: tuple[int, int]) -> None:
    pdus = {7: bytes.fromhex("03 0010 0003"), 8: bytes.fromhex("03 0010 0002")}
    requests = [
        Sent(1.0 + 0.001 * place, tcp_frame(1, pdus[number], number), True) for place, number in enumerate(order)
    ]
    findings, _ = diagnosed(log_of([*requests, Sent(1.02, tcp_frame(1, LONG, 8), False)], "capture"))
    (wrong,) = [found.finding for found in findings if found.finding.code == "wrong-answer"]
    assert wrong.text.startswith("the response is to another request: to that of transaction 7")


def test_a_response_of_another_unit_is_a_wrong_answer() -> None:
    request, response = read(1, 1.0)
    traffic = [request, response._replace(data=encode(2, bytes((3, 4, 0, 1, 2, 3)))), *read(1, 2.5)]
    findings, verdicts = diagnosed(log_of(traffic, "times"))
    assert [(found.finding.code, found.line) for found in findings] == [("wrong-answer", 2)]
    assert [verdict.code for verdict in verdicts] == ["nothing-proved"]


@pytest.mark.parametrize(("asked", "answered"), [("Tx", "Rx"), ("request", "response"), ("> ", "< ")])
def test_an_answer_with_a_wrong_byte_count_is_read_in_the_direction_that_the_log_states(
    asked: str, answered: str
) -> None:
    """Neither a request nor a response has this length; the CRC is right, and the log says that it was received."""
    frames = encode(1, bytes.fromhex("03 0000 0004")), encode(1, bytes.fromhex("03 00 0000 0000 0000 00"))
    text = f"{asked}: {frames[0].hex(' ')}\n{answered}: {frames[1].hex(' ')}\n"
    for repeated in (1, 3):
        findings, _ = diagnosed((repeated * text).encode())
        assert [found.finding.code for found in findings] == repeated * ["byte-count"]


def test_the_number_of_a_manual_in_place_of_an_address_is_found_when_it_is_refused() -> None:
    traffic = [Sent(1.0, encode(1, bytes.fromhex("03 9C41 0002")), True), Sent(1.02, encode(1, b"\x83\x02"), False)]
    findings, _ = diagnosed(log_of(traffic, "times"))
    assert [(found.finding.code, found.line) for found in findings] == [("address-base", 2)]
    accepted = [traffic[0], Sent(1.02, encode(1, bytes.fromhex("03 04 0000 0000")), False)]
    assert diagnosed(log_of(accepted, "times"))[0] == []


def test_a_late_response_is_no_second_one() -> None:
    traffic = [*read(1, 1.0, late=1.5)[:1], *read(1, 2.2), Sent(2.23, encode(1, bytes((3, 4, 1, 1, 1, 1))), False)]
    findings, verdicts = diagnosed(log_of(traffic, "times"))
    assert [found.finding.code for found in findings] == ["no-answer", "late-answer"]
    assert [verdict.code for verdict in verdicts] == ["nothing-proved"]


def test_of_two_responses_that_fit_the_first_is_the_late_one() -> None:
    given_up = read(1, 1.0)[:1]
    late, right = (Sent(1.33, encode(1, bytes((3, 4, value, 0, 0, 0))), False) for value in (1, 2))
    findings, _ = diagnosed(log_of([*given_up, *read(1, 1.3)[:1], late, right], "times"))
    assert [(found.line, found.finding.code) for found in findings] == [(1, "no-answer"), (3, "late-answer")]


def frames(*rows: tuple[float, int, str]) -> Traffic:
    """Return frames (time, unit, PDU) of a log without directions."""
    return [Sent(at, encode(unit, bytes.fromhex(pdu)), True) for at, unit, pdu in rows]


OTHER = frames((0.5, 3, "03 0000 0001"), (0.52, 3, "03 02 0017"))
"""An exchange of another unit, so that the log has a good one."""


@pytest.mark.parametrize("second", [1.3, 2.3])
def test_one_response_that_fits_two_requests_is_open(second: float) -> None:
    """`sniff` names both requests; the first of them has no answer that is its own for certain."""
    rows = (1.0, 1, "03 0000 0002"), (second, 1, "03 0010 0002"), (second + 0.005, 1, "03 04 0001 0002")
    findings, (verdict,) = diagnosed(log_of(frames(*rows), "times"))
    assert [(found.line, found.finding.code) for found in findings] == [(1, "no-answer")]
    assert verdict.evidence.endswith("; 1 response of unit 1 that fits two requests")


TWO_UNITS = [(1.0, 1, "03 0000 0002"), (1.004, 2, "03 0000 0003")]
"""Two requests, 4 ms apart."""
ANSWER_1, ANSWER_2 = "03 04 0001 0002", "03 06 0001 0002 0003"


@pytest.mark.parametrize(
    "rows",
    [
        [*TWO_UNITS, (1.02, 1, ANSWER_1), (1.03, 2, ANSWER_2)],
        [*TWO_UNITS, (1.02, 2, ANSWER_2), (1.03, 1, ANSWER_1)],
        [(1.0, 1, "03 0000 0002"), (1.004, 1, "03 0010 0002"), (1.02, 1, ANSWER_1), (1.03, 1, "03 04 0003 0004")],
        [(1.0, 1, "03 0000 0002"), (1.004, 2, "06 0001 0003"), (1.02, 2, "06 0001 0003"), (1.03, 1, ANSWER_1)],
    ],
)
def test_two_requests_at_once_that_are_both_answered_are_of_two_masters(rows: list[tuple[float, int, str]]) -> None:
    again = [(at + 2.0, unit, pdu) for at, unit, pdu in rows]
    findings, (verdict,) = diagnosed(log_of(OTHER + frames(*rows, *again), "times"))
    assert [(found.finding.code, found.line) for found in findings] == [("two-masters", 4), ("two-masters", 8)]
    assert " is the response to the first, " in findings[0].finding.proof
    assert (verdict.code, verdict.evidence.partition(",")[0]) == ("two-masters", "2 times")


@pytest.mark.parametrize(
    ("rows", "codes"),
    [
        ([*TWO_UNITS, (1.02, 1, ANSWER_1)], ["no-answer", "late-answer"]),
        ([*TWO_UNITS, (1.02, 2, ANSWER_2), (2.5, 2, "03 0000 0003"), (2.52, 2, ANSWER_2)], ["no-answer"]),
        (
            [TWO_UNITS[0], (1.2, 2, "03 0000 0003"), (1.22, 2, ANSWER_2), (1.23, 1, ANSWER_1)],
            ["no-answer", "late-answer"],
        ),
    ],
)
def test_two_requests_at_once_prove_two_masters_only_if_both_are_answered(
    rows: list[tuple[float, int, str]], codes: list[str]
) -> None:
    findings, _ = diagnosed(log_of(OTHER + frames(*rows), "times"))
    assert [found.finding.code for found in findings] == codes


def test_equal_times_prove_nothing_about_two_masters_or_a_wrong_echo() -> None:
    """A log whose times are whole seconds: the client may have given up the first request in between."""
    rows = [(1.0, unit, pdu) for _, unit, pdu in (*TWO_UNITS, (0, 1, ANSWER_1), (0, 2, ANSWER_2))]
    findings, _ = diagnosed(log_of(OTHER + frames(*rows), "times"))
    assert [found.finding.code for found in findings] == ["no-answer", "late-answer"]
    writes = frames((1.0, 1, "06 0001 0003"), (1.0, 1, "06 0001 0004"))
    assert [verdict.code for verdict in diagnosed(log_of(OTHER + writes, "times"))[1]] == ["open"]


ECHOES = {
    "06 value": ("06 0001 0003", "06 0001 0004", "value 4 where 3 was asked"),
    "06 address": ("06 0001 0003", "06 0002 0003", "address 2 where 1 was asked"),
    "05 value": ("05 0001 FF00", "05 0001 0000", "value"),
    "05 address": ("05 0001 FF00", "05 0002 FF00", "address 2 where 1 was asked"),
    "10 count": ("10 0001 0002 04 0001 0002", "10 0001 0003", "quantity 3 where 2 was asked"),
    "10 address": ("10 0001 0002 04 0001 0002", "10 0002 0002", "address 2 where 1 was asked"),
    "0F count": ("0F 0001 0008 01 FF", "0F 0001 0007", "quantity 7 where 8 was asked"),
    "0F address": ("0F 0001 0008 01 FF", "0F 0002 0008", "address 2 where 1 was asked"),
}


@every_case("form", ["times", "words"])
@every_case("name", ECHOES)
def test_the_response_to_a_write_with_another_field_is_named(name: str, form: str) -> None:
    request, response, text = ECHOES[name]
    exchange = frames((1.0, 1, request), (1.02, 1, response))
    traffic = [*OTHER, exchange[0], exchange[1]._replace(from_client=False)]
    traffic[1] = traffic[1]._replace(from_client=False)
    for log in (traffic, [*traffic, *(sent._replace(at=sent.at + 4.0) for sent in OTHER)]):
        findings, verdicts = diagnosed(log_of(log, form))
        assert [(found.finding.code, found.line) for found in findings] == [("wrong-answer", 4)]
        assert text in findings[0].finding.text
        assert [verdict.code for verdict in verdicts] == ["nothing-proved"]


def test_two_different_writes_that_are_far_apart_may_be_two_requests() -> None:
    findings, (verdict,) = diagnosed(
        log_of(OTHER + frames((1.0, 1, "06 0001 0003"), (1.4, 1, "06 0001 0004")), "times")
    )
    assert findings == []
    assert (verdict.code, verdict.evidence.partition(";")[0]) == (
        "open",
        "1 write to unit 1 and a response with another value, or two writes without their responses",
    )


@pytest.mark.parametrize("answer", ["05 0001 0001", "85 03"])
@pytest.mark.parametrize("form", ["times", "words"])
def test_a_request_with_a_value_that_its_function_does_not_have_is_named(answer: str, form: str) -> None:
    """A coil is written with FF00h or 0000h."""
    sent = frames((1.0, 1, "05 0001 0001"), (1.02, 1, answer))
    findings, _ = diagnosed(log_of([sent[0], sent[1]._replace(from_client=False)], form))
    assert [(found.finding.code, found.line, found.place) for found in findings] == [("wrong-value", 1, "unit 1")]
    assert "0001h" in findings[0].finding.text or "value 1" in findings[0].finding.text


def test_a_line_whose_bytes_cannot_be_read_is_not_nothing_wrong() -> None:
    log = b"Tx: 01 03 00 00 00 01 84 0A\nRx: 01 03 02 00 17 F8 4A\nRx: 01 03 02 00 17 F8 4A 9 bytes\n"
    assert [(verdict.code, verdict.evidence.partition(";")[0]) for verdict in diagnosed(log)[1]] == [
        ("not-seen", "1 line whose bytes cannot be read")
    ]


def test_a_repeated_request_behind_noise_in_one_read_is_no_echo() -> None:
    request = "01 03 10 01 00 06 90 C8"
    findings, verdicts = diagnosed(f"{request}\n{'00 ' * 8}{request}\n".encode())
    assert [(found.line, found.finding.code) for found in findings] == [(2, "noise-before")]
    assert "request to unit 1 twice: repeated, or its own echo" in verdicts[0].evidence


def test_a_slow_response_for_which_the_client_waited_is_not_late() -> None:
    """No later request says that the client gave up, although the time for the response was over."""
    findings, verdicts = diagnosed(log_of([*read(1, 1.0), *read(1, 2.0, late=3.2)], "times"))
    assert findings == []
    assert verdicts[0].sentence.endswith("4 frames, 2 requests answered by 1 unit")


def test_a_transaction_with_its_bytes_exchanged_answers_no_request() -> None:
    log = b"send: 00 01 00 00 00 06 01 03 0b b7 00 02\nrecv: 01 00 00 00 00 07 01 03 04 00 00 00 00\n"
    findings, _ = diagnosed(log)
    assert [(found.line, found.finding.code, found.finding.proof) for found in findings] == [
        (2, "header-byte-order", "the request has 0001h, the response 0100h")
    ]
    assert diagnosed(log.replace(b"recv: 01 00", b"recv: 02 00"))[0] == []  # it may answer a request before the log


def test_an_rtu_answer_to_a_request_of_tcp_has_no_transaction_that_could_be_late() -> None:
    log = b"00 01 00 00 00 06 E3 03 00 00 00 04\nE3 03 08 9B 95 00 AA 00 28 6B F1 32 DE\n"
    assert not any("transaction" in found.finding.text for found in diagnosed(log)[0])


def test_a_unit_that_was_told_to_listen_only_is_not_dead() -> None:
    commanded = [Sent(0.5, encode(2, bytes.fromhex("08 0004 0000")), True)]
    traffic = [*commanded, *without_responses(spaced(polls(12, 1, 2)), 2)]
    findings, verdicts = diagnosed(log_of(traffic, "times"))
    assert findings == []
    assert [verdict.code for verdict in verdicts] == ["nothing-wrong"]


def test_ascii_on_a_line_that_is_read_as_rtu() -> None:
    log = "\n".join(f"{place}.0 {ascii_frame(1, bytes((3, 0, 0, 0, 1))).hex(' ')}" for place in range(4)).encode()
    diagnosis = ModbusLogDiagnosis(read_modbus_log(log, protocol="rtu"), WINDOW, "rtu")
    assert {found.finding.code for found in diagnosis.findings()} == {"ascii-on-rtu"}
    assert [verdict.code for _, verdict in diagnosis.verdicts()] == ["wrong-protocol"]


@pytest.mark.parametrize("time", ["", "1.0 "])
def test_one_frame_with_a_fault_is_no_frame_of_another_protocol(time: str) -> None:
    """Its first bytes are those of a header of Modbus TCP: 01 03, 00 00, 00 02."""
    findings, verdicts = diagnosed(f"{time}01 03 00 00 00 02 0B C4\n".encode())
    assert [found.finding.code for found in findings] == ["crc-swapped"]
    assert [verdict.code for verdict in verdicts] == ["nothing-proved"]  # a device that builds frames so does it again


def test_seven_bits_and_parity_read_as_eight_bits() -> None:
    def with_parity(data: bytes) -> bytes:
        return bytes(byte | (byte.bit_count() & 1) << 7 for byte in data)

    log = "\n".join(f"{place}.0 {with_parity(ascii_frame(1, bytes((3, 0, 0, 0, 1)))).hex(' ')}" for place in range(4))
    assert [verdict.code for verdict in diagnosed(log.encode())[1]] == ["parity"]


@every_case("name", sorted(file.name for file in SAMPLES.iterdir() if "without-bytes" not in file.name))
def test_recordings_of_other_programs_have_no_finding_but_their_silent_unit(name: str) -> None:
    findings, verdicts = diagnosed((SAMPLES / name).read_bytes())
    assert {(found.finding.code, found.place) for found in findings} <= {("no-answer", "unit 9")}
    assert {verdict.code for verdict in verdicts} <= ({"nothing-proved"} if findings else NO_FAULT)


def test_two_connections_have_their_own_verdicts() -> None:
    log = ModbusLogDiagnosis(read_modbus_log(log_of(of_tables("tcp", 1), "capture")))
    assert list(log.findings()) == []
    assert [(name, verdict.code) for name, verdict in log.verdicts()] == [("", "nothing-wrong")]
    empty = ModbusLogDiagnosis(read_modbus_log(log_of([], "capture")))
    assert list(empty.findings()) == []
    assert [verdict.code for _, verdict in empty.verdicts()] == ["nothing-heard"]


def test_a_live_line_is_diagnosed_as_its_bytes_come() -> None:
    live = LiveDiagnosis(RtuLine(Timing.of(19200), role="listener"), "rtu")
    findings, now = [], 0.0
    for at, data, _ in of_a_bias_fault():
        for byte in range(0, len(data), 5):
            now = at + 0.003 * byte
            while (deadline := live.deadline) is not None and deadline < now:
                findings += live.feed(None, deadline)
            findings += live.feed(data[byte : byte + 5], now)
    findings += live.end(now + 2.0)
    assert {found.finding.code for found in findings} == {"noise-before"}
    assert {found.line for found in findings} == {0}
    assert [verdict.code for verdict in live.verdicts()] == ["no-bias"]


@pytest.mark.long
def test_a_long_damaged_log_costs_no_more_than_its_first_pieces() -> None:
    traffic = [Sent(0.1 * place, Random(place).randbytes(12), False) for place in range(200)]
    findings, verdicts = diagnosed(log_of(traffic, "times"))
    assert len(findings) == 200
    assert [verdict.code for verdict in verdicts] == ["no-frames"]


def test_the_page_has_a_row_for_every_verdict() -> None:
    page = (Path(__file__).parents[3] / "docs" / "how-to" / "diagnose-a-line.md").read_text(encoding="utf-8")
    rows = [line.split("`")[1] for line in page.splitlines() if line.startswith("| `")]
    assert rows == list(dict.fromkeys(rows))
    assert set(rows) == set(VERDICTS) == set(get_args(VerdictCode))


def test_a_request_that_its_own_client_sends_again_at_once_is_no_echo() -> None:
    sent = b"2024/03/14 17:03:45 send 00 46 00 00 00 06 01 03 05 c4 00 01\n"
    log = ModbusLogDiagnosis(read_modbus_log(2 * sent))
    assert "echo" not in [found.finding.code for found in log.findings()]


def test_a_refusal_is_beside_what_the_unit_serves() -> None:
    text = "".join(
        f"{'TX' if sent else 'RX'}: {encode(71, bytes.fromhex(pdu)).hex(' ')}\n"
        for sent, pdu in ((1, "109D19000102001E"), (0, "9002"), (1, "069D19001E"), (0, "069D19001E"))
    )
    findings, verdicts = diagnosed(text.encode())
    assert [found.sentence for found in findings] == []  # 9D19h is no number of a manual: function 06 writes it
    (verdict,) = verdicts
    assert verdict.code == "refused"
    assert "exception 02 of unit 71 to Write Multiple Registers, 1 from 9D19h" in verdict.evidence
    assert verdict.evidence.endswith("unit 71 refuses function 10 at 9D19h, and serves function 06 there")


def test_an_answer_with_the_transaction_of_a_request_before_the_log_is_late() -> None:
    late, answer = tcp_frame(50, bytes.fromhex("0302 0001"), 15), tcp_frame(50, bytes.fromhex("0304 0001 0002"), 16)
    text = f"10.5 TX {tcp_frame(50, bytes.fromhex('03 0A8B 0002'), 16).hex(' ')}\n30.5 RX {(late + answer).hex(' ')}\n"
    findings, _ = diagnosed(text.encode())
    assert [found.finding.code for found in findings] == ["no-answer", "late-answer"]


def test_no_response_is_missing_before_a_line_whose_bytes_cannot_be_read() -> None:
    asked = encode(1, bytes.fromhex("03 0000 0002")).hex(" ")
    text = f"TX: {asked}\nand then 01 03 04 0x 11 22 33 44 came\nTX: {asked}\nRX: 01 83 02 C0 F1\n"
    findings, verdicts = diagnosed(text.encode())
    assert [found.sentence for found in findings] == []
    assert "no-answers" not in {verdict.code for verdict in verdicts}


def test_a_request_twice_in_one_read_of_a_server_is_no_silence() -> None:
    asked, answer = (encode(33, bytes.fromhex(pdu)).hex(":") for pdu in ("03 0083 0001", "03 02 0000"))
    findings, verdicts = diagnosed(f"<<< {asked}:{asked}\n>>> {answer}\n".encode())
    assert [found.sentence for found in findings] == []
    assert "twice in one read" in verdicts[0].evidence
