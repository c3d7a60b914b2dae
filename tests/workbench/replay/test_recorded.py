"""From the frames on a line to what is known of its units, and to text and back."""

from __future__ import annotations

from typing import Any

from barewire.errors import EncodeError
from barewire.modbus import (
    ExceptionResponse,
    Message,
    ReadCoils,
    ReadCoilsResponse,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
    ReadHoldingRegisters,
    ReadHoldingRegistersResponse,
    WriteMultipleRegisters,
    WriteMultipleRegistersResponse,
    WriteSingleRegister,
    WriteSingleRegisterResponse,
)
from barewire.rtu import RtuLine, Timing, encode
from barewire_workbench.replay.recorded import (
    RecordedAnswer,
    RecordedLine,
    RecordedRequest,
    from_toml,
    is_recorded,
    learn_line,
    to_toml,
)
from barewire_workbench.sniffer import Sniffer, SnifferEvent
from tests.helpers import every_case, refused

Heard = tuple[float, int, Message]


def overheard(*frames: Heard) -> list[SnifferEvent]:
    """Return the events of these frames: time, unit, message."""
    sniffer = Sniffer(RtuLine(Timing(0.0, 0.0, 0.0), role="listener"))
    events: list[SnifferEvent] = []
    now = 0.0
    for now, unit, message in frames:
        while (deadline := sniffer.deadline) is not None and deadline < now:
            events += sniffer.feed(None, deadline)
        events += sniffer.feed(encode(unit, message.encode()), now)
    return events + sniffer.end(now)


def reading(at: float, value: int, latency: float = 0.01, unit: int = 7) -> list[Heard]:
    return [
        (at, unit, ReadHoldingRegisters(0, 2)),
        (at + latency, unit, ReadHoldingRegistersResponse((value, 9))),
    ]


def learned(*frames: Heard, **options: Any) -> RecordedLine:
    return learn_line(overheard(*frames), **options)


def only_request(line: RecordedLine) -> RecordedRequest:
    (unit,) = line.units.values()
    (request,) = unit.requests
    return request


def test_equal_answers_in_a_row_are_one() -> None:
    request = only_request(
        learned(*(frame for second in range(10) for frame in reading(100.0 + second, 23 if second < 8 else 24)))
    )
    assert (request.function, request.table, request.address, request.quantity) == (3, "holding", 0, 2)
    assert (request.period, request.count) == (1.0, 10)
    assert request.answers == [
        RecordedAnswer(0.0, 7.0, 8, 0.01, values=(23, 9)),
        RecordedAnswer(8.0, 9.0, 2, 0.01, values=(24, 9)),
    ]


def test_a_slow_answer_is_a_row_of_its_own() -> None:
    request = only_request(learned(*reading(1.0, 5), *reading(2.0, 5, 0.4), *reading(3.0, 5, 0.012)))
    assert [(answer.times, answer.latency) for answer in request.answers] == [(1, 0.01), (1, 0.4), (1, 0.012)]


def test_exceptions_and_missing_answers() -> None:
    asked = ReadHoldingRegisters(0, 2)
    request = only_request(
        learned(
            (1.0, 7, asked),
            (1.25, 7, ExceptionResponse(0x83, 6)),
            (2.0, 7, asked),
            (4.0, 7, asked),
            *reading(6.0, 5),
        )
    )
    assert request.answers == [
        RecordedAnswer(0.0, 0.0, 1, 0.25, exception=6),
        RecordedAnswer(1.0, 3.0, 2, silent=True),
        RecordedAnswer(5.0, 5.0, 1, 0.01, values=(5, 9)),
    ]


def test_a_late_answer_is_an_answer_of_its_request() -> None:
    """The client gave up and asked something else, and then the answer came."""
    line = learned(
        (1.0, 7, ReadHoldingRegisters(0, 2)),
        (1.5, 7, ReadHoldingRegisters(5, 1)),
        (1.75, 7, ReadHoldingRegistersResponse((1, 2))),
        (1.875, 7, ReadHoldingRegistersResponse((3,))),
    )
    first, second = line.units[7].requests
    assert first.answers == [RecordedAnswer(0.0, 0.0, 1, 0.75, values=(1, 2))]
    assert second.answers == [RecordedAnswer(0.5, 0.5, 1, 0.375, values=(3,))]


def test_writes_are_one_request_for_each_place_and_have_what_they_wrote() -> None:
    line = learned(
        (1.0, 7, WriteMultipleRegisters(4, (1, 0))),
        (1.25, 7, WriteMultipleRegistersResponse(4, 2)),
        (2.0, 7, WriteMultipleRegisters(4, (2, 0))),
        (2.25, 7, WriteMultipleRegistersResponse(4, 2)),
        (3.0, 7, WriteSingleRegister(8, 3)),
        (3.25, 7, ExceptionResponse(0x86, 2)),
        (5.0, 7, WriteSingleRegister(8, 4)),
        (5.25, 7, WriteSingleRegisterResponse(8, 4)),
    )
    many, single = line.units[7].requests
    assert (many.function, many.table, many.address, many.quantity) == (16, "holding", 4, 2)
    assert [answer.wrote for answer in many.answers] == [(1, 0), (2, 0)]
    assert [(answer.wrote, answer.exception) for answer in single.answers] == [((3,), 2), ((4,), None)]


def test_bits_are_cut_to_the_quantity_and_other_functions_are_kept_as_bytes() -> None:
    identification = ReadDeviceIdentificationResponse(1, 0x81, ((0, b"ACME"), (1, b"x"), (2, b"1")))
    line = learned(
        (1.0, 7, ReadCoils(3, 5)),
        (1.25, 7, ReadCoilsResponse((True, False, True, True, False))),
        (2.0, 7, ReadDeviceIdentification(1)),
        (2.25, 7, identification),
    )
    coils, other = line.units[7].requests
    assert (coils.table, coils.answers[0].values) == ("coil", (1, 0, 1, 1, 0))
    assert (other.table, other.pdu, other.answers[0].pdu) == ("", b"\x2b\x0e\x01\x00", identification.encode())


def test_each_unit_is_learned_for_itself_and_the_rest_is_counted() -> None:
    line = learned(
        (0.5, 9, ReadHoldingRegistersResponse((1,))),
        *reading(1.0, 5),
        *reading(2.0, 6, unit=9),
        (3.0, 0, WriteSingleRegister(0, 1)),
    )
    assert list(line.units) == [7, 9]
    assert [unit.requests[0].answers[0].values for unit in line.units.values()] == [(5, 9), (6, 9)]
    assert (line.broadcasts, line.strays, line.seconds) == (1, 1, 2.5)


def test_more_rows_than_the_limit_are_counted() -> None:
    request = only_request(learned(*(frame for value in range(10) for frame in reading(1.0 + value, value)), limit=3))
    assert (len(request.answers), request.left_out, request.count) == (3, 7, 10)
    with refused(EncodeError, "limit 0: expected a number of answers, from 1 on"):
        learned(limit=0)


def test_nothing_overheard_is_a_line_without_units() -> None:
    assert learned() == RecordedLine()


# Text ----------------------------------------------------------------------------------------------------------------


def everything() -> RecordedLine:
    return learned(
        *(frame for second in range(4) for frame in reading(1.0 + second, 23)),
        (5.0, 7, ReadHoldingRegisters(0, 2)),
        (5.25, 7, ExceptionResponse(0x83, 6)),
        (6.0, 7, WriteSingleRegister(8, 3)),
        (6.25, 7, WriteSingleRegisterResponse(8, 3)),
        (8.0, 7, ReadDeviceIdentification(1)),
        *reading(9.0, 6, unit=9),
    )


def test_a_line_is_the_same_after_its_text() -> None:
    line = everything()
    text = to_toml(line, "bus\n.log")
    again = from_toml(text, "bus.toml")
    assert again.units == line.units
    assert text.startswith("# Recorded by barewire from bus .log: 2 units, 8.01 s.\n")
    assert is_recorded(text)
    assert not is_recorded('name = "x"\n[modbus]\nunit = 1\n')


GOOD = """
[[unit]]
address = 7
[[unit.request]]
read = "holding:0"
quantity = 2
answers = [{ values = [1, 2] }]
[[unit.request]]
write = "coil:5"
function = 5
answers = [{ wrote = [1] }]
[[unit.request]]
pdu = "07"
answers = [{ pdu = "07 6D" }]
"""


@every_case(
    ("old", "new", "text"),
    [
        ("[[unit]]", "[[unit]", "x.toml: not TOML: "),
        (GOOD, "", "x.toml: no [[unit]] in it; expected a file that `barewire record` wrote"),
        (GOOD, "[[unt]]", "x.toml: unknown key 'unt': expected some of unit; did you mean 'unit'?"),
        (GOOD, "unit = 7", "x.toml: key 'unit': expected tables"),
        (
            "address = 7",
            "address = 256",
            "x.toml: [[unit]] number 1: key 'address': 256: expected a whole number in 0..255",
        ),
        ("address = 7", "", "x.toml: [[unit]] number 1: key 'address': not given: expected a whole number in 0..255"),
        (GOOD, GOOD + GOOD, "x.toml: [[unit]] number 2: address 7 is given twice"),
        ('read = "holding:0"', 'raed = "holding:0"', "unit 7: request 1: unknown key 'raed'"),
        ('read = "holding:0"', "", "unit 7: request 1: expected one of the keys read, write and pdu, got none"),
        (
            '"holding:0"',
            '"holdng:0"',
            "key 'read': 'holdng:0': expected one of coil, discrete, holding, input, a colon",
        ),
        (
            '"holding:0"',
            '"holding:70000"',
            "key 'read': 'holding:70000': expected an address in 0..65535 after the colon",
        ),
        ('"holding:0"', '"holding"', "key 'read': 'holding': expected an address in 0..65535 after the colon"),
        ('"coil:5"', '"input:5"', "key 'write': 'input:5': expected one of coil, holding"),
        ("quantity = 2", "quantity = 126", "key 'quantity': 126: expected a whole number in 1..125"),
        ("function = 5", "function = 6", "key 'function': 6: expected 5 or 15"),
        ("function = 5", "function = 99", "key 'function': 99: expected 5 or 15"),
        ("function = 5", "function = []", "key 'function': []: expected 5 or 15"),
        ("function = 5", "", "key 'function': not given: expected 5 or 15"),
        ("[{ values = [1, 2] }]", "[]", "request 1: key 'answers': expected at least one answer"),
        ("[{ values = [1, 2] }]", "7", "request 1: key 'answers': 7: expected a list"),
        ("[{ values = [1, 2] }]", "[7]", "request 1: answer 1: 7: expected a table"),
        ("values = [1, 2]", "valus = [1, 2]", "answer 1: unknown key 'valus'"),
        ("values = [1, 2]", "values = [1]", "key 'values': 1 values: expected 2 values"),
        ("values = [1, 2]", "values = [1, 70000]", "key 'values': 70000: expected whole numbers in 0..65535"),
        (
            "values = [1, 2]",
            "times = 2",
            "expected exactly one of the keys values, exception, silent and pdu, got none",
        ),
        ("values = [1, 2]", "values = [1, 2], silent = true", "got values and silent"),
        ("values = [1, 2]", "silent = false", "key 'silent': False: expected true, or no such key"),
        ("values = [1, 2]", "exception = 0", "key 'exception': 0: expected a whole number in 1..255"),
        ("quantity = 2", f"quantity = {'9' * 5000}", "x.toml: not TOML: Exceeds the limit (4300"),
        ("quantity = 2", f"a = {'[' * 20_000}", "x.toml: nested too deeply to be read"),
        ("values = [1, 2]", f"values = [1, 2], latency = {'9' * 4000}", "'latency': a number of 13288 bits: expected"),
        ('"holding:0"', f'"holding:{"9" * 5000}"', "key 'read': 'holding:9999"),
        ("quantity = 2", f"{'a' * 5000} = 2", "unknown key 'aaaa"),
        ("values = [1, 2]", "values = [1, 2], latency = -1", "key 'latency': -1: expected seconds, 0 or more"),
        ("values = [1, 2]", "values = [1, 2], wrote = [1]", "key 'wrote': expected in the answers to a write only"),
        ("wrote = [1]", "wrote = [2]", "key 'wrote': 2: expected whole numbers in 0..1"),
        ("wrote = [1]", "wrote = []", "key 'wrote': expected at least one value"),
        ("{ wrote = [1] }", "{ wrote = [1] }, { wrote = [1, 1] }", "key 'wrote': expected as many values in each"),
        ('"07 6D"', '"07 6"', "key 'pdu': '07 6': expected 1 to 253 bytes in hexadecimal"),
        ('pdu = "07"', "pdu = 7", "key 'pdu': 7: expected 1 to 253 bytes in hexadecimal"),
    ],
)
def test_wrong_text_is_refused_with_its_place(old: str, new: str, text: str) -> None:
    assert old in GOOD
    from_toml(GOOD, "x.toml")
    with refused(EncodeError, text):
        from_toml(GOOD.replace(old, new), "x.toml")
