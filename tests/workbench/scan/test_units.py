"""A scan of units in virtual time: each sign of life, what is none, and how long it takes."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import pytest

from barewire.ascii import AsciiLine
from barewire.conversation import Wire
from barewire.errors import PortError
from barewire.modbus.framing import Line
from barewire.rtu import RtuLine, Timing
from barewire.rtu.frame import decode, encode
from barewire.tcp import TcpLine
from barewire_workbench.scan.units import UnitScan, UnitScanner, likely_first, unit_numbers
from tests.helpers import Peer

VALUE, NO_ADDRESS = bytes.fromhex("03 02 00 2A"), bytes.fromhex("83 02")
TIMING = Timing.of(19200)


def rtu() -> RtuLine:
    return RtuLine(TIMING, role="client", patience=0.03)


def scan(
    peer: Peer, units: Iterable[int], *, line: Callable[[], Line] = rtu, timeout: float = 0.15
) -> tuple[UnitScan, float]:
    """Ask the units on one line. Returns the result and the seconds that it took."""
    wire = Wire(peer, sending_takes=lambda data: len(data) * TIMING.character)
    scanner, carrier = UnitScanner(timeout), line()
    for unit in units:
        wire.play(scanner.ask(carrier, unit))
    if not carrier.numbered:
        wire.play(scanner.listen(carrier, timeout))
    return scanner.result, wire.now


def units(answers: dict[int, list[tuple[float, bytes]]]) -> Peer:
    """The units of an RTU line: what each sends after a request to it, and how many seconds later."""

    def peer(frame: bytes, now: float) -> list[tuple[float, bytes]]:
        return [(now + after, data) for after, data in answers.get(frame[0], [])]

    return peer


def test_a_value_an_exception_and_silence() -> None:
    result, _ = scan(units({2: [(0.01, encode(2, VALUE))], 4: [(0.02, encode(4, NO_ADDRESS))]}), range(1, 6))
    assert [unit.unit for unit in result.answered] == [2, 4]
    assert [unit.exception for unit in result.answered] == [None, 2]
    assert result.units[2].answered_after == pytest.approx(0.01)
    assert result.units[4].why == "answered with exception 02 after 20 ms"
    assert list(result.asked) == [1, 2, 3, 4, 5]
    assert (result.stray, result.unreachable) == (0, set())


def test_two_answers_to_one_request_are_two_devices() -> None:
    other = bytes.fromhex("03 02 01 07")
    result, _ = scan(units({3: [(0.01, encode(3, VALUE)), (0.06, encode(3, other))]}), [3])
    assert result.units[3].is_doubled
    assert result.units[3].answers == [VALUE, other]
    assert "two devices answer as unit 3" in result.units[3].why


def test_two_devices_with_the_same_answer_are_two_devices() -> None:
    result, _ = scan(units({3: [(0.01, encode(3, VALUE)), (0.06, encode(3, VALUE))]}), [3])
    assert result.units[3].is_doubled
    assert result.units[3].answers == [VALUE]


def test_a_damaged_answer_is_a_sign_of_life_and_asked_for_again() -> None:
    asked: list[int] = []

    def peer(frame: bytes, now: float) -> list[tuple[float, bytes]]:
        asked.append(frame[0])
        return [(now + 0.01, bytes.fromhex("84 00 F8"))] if frame[0] == 4 else []

    result, _ = scan(peer, range(3, 6))
    assert asked == [3, 4, 4, 4, 5]
    assert result.units[4].damaged == 3
    assert result.answered == []
    assert result.units[4].why.startswith("damaged answers only")


def test_a_unit_whose_second_answer_is_whole_is_found_with_its_damage() -> None:
    answers = iter([bytes.fromhex("84 00 F8"), encode(4, VALUE)])
    result, _ = scan(lambda frame, now: [(now + 0.01, next(answers))], [4])
    assert result.units[4].answers == [VALUE]
    assert result.units[4].why == "answered after 10 ms; 1 damaged answers"


@pytest.mark.parametrize("later", [0.05, 0.2, 0.4], ids="{} s after the time-out".format)
def test_a_slow_unit_is_found_by_its_late_answer(later: float) -> None:
    result, _ = scan(units({5: [(0.15 + later, encode(5, VALUE))]}), range(4, 12))
    assert list(result.units) == [5]
    assert result.units[5].is_late
    assert "after more than" in result.units[5].why


def test_a_late_answer_of_the_last_unit() -> None:
    result, _ = scan(units({5: [(0.25, encode(5, VALUE))]}), [5])
    assert result.units[5].is_late


@pytest.mark.parametrize("baudrate", [1200, 9600, 115200])
def test_247_silent_units_take_their_time_outs_and_a_fifth_at_most(baudrate: int) -> None:
    timing = Timing.of(baudrate)
    timeout = 0.15 + 7 * timing.character
    wire = Wire(units({}), sending_takes=lambda data: len(data) * timing.character)
    scanner, line = UnitScanner(timeout), RtuLine(timing, role="client", patience=0.03)
    for unit in range(1, 248):
        wire.play(scanner.ask(line, unit))
    assert scanner.result.units == {}
    assert wire.now <= 247 * (1.2 * timeout + 8 * timing.character)


def test_ascii() -> None:
    from barewire.ascii import frame

    result, _ = scan(
        lambda data, now: [(now + 0.02, frame.encode(2, VALUE))] if data[1:3] == b"02" else [],
        [1, 2, 3],
        line=AsciiLine,
    )
    assert list(result.units) == [2]


def tcp_peer(answers: dict[int, bytes]) -> Peer:
    def peer(frame: bytes, now: float) -> list[tuple[float, bytes]]:
        unit = frame[6]
        if unit not in answers:
            return []
        pdu = answers[unit]
        return [(now + 0.01, frame[:4] + (len(pdu) + 1).to_bytes(2, "big") + bytes([unit]) + pdu)]

    return peer


def test_tcp_waits_no_longer_than_for_the_answer() -> None:
    result, seconds = scan(tcp_peer(dict.fromkeys(range(1, 11), VALUE)), range(1, 11), line=TcpLine, timeout=1.0)
    assert len(result.answered) == 10
    assert seconds < 0.5


@pytest.mark.parametrize("code", [0x0A, 0x0B])
def test_a_gateway_that_says_that_nobody_is_there_is_no_unit(code: int) -> None:
    peer = tcp_peer({1: VALUE, 2: bytes([0x83, code]), 3: NO_ADDRESS})
    result, _ = scan(peer, range(1, 4), line=TcpLine, timeout=1.0)
    assert list(result.units) == [1, 3]
    assert result.unreachable == {2}


def test_an_adapter_that_echoes_is_named_and_is_no_unit() -> None:
    with pytest.raises(PortError, match="add echo=1"):
        scan(lambda frame, now: [(now, frame)], range(1, 10))


def test_a_line_that_is_never_silent_ends_the_scan() -> None:
    wire = Wire[bytes](lambda frame, now: [])
    wire.coming = [(0.001 * tick, b"\x55") for tick in range(5000)]
    with pytest.raises(PortError, match="never silent"):
        wire.play(UnitScanner(0.15).ask(rtu(), 1))


def test_frames_of_another_master_are_counted_and_are_no_unit() -> None:
    request = encode(9, bytes.fromhex("06 00 01 00 03"))
    result, _ = scan(lambda frame, now: [(now + 0.01, request)] if frame[0] == 2 else [], range(1, 5))
    assert result.units == {}
    assert result.stray == 1
    assert decode(request).unit == 9


def test_numbers_of_units() -> None:
    assert unit_numbers("5, 1-3,2") == [5, 1, 2, 3]
    wrong = [("", "expected numbers"), ("a", "expected numbers"), ("3-1", "smaller number"), ("256", "0..255")]
    for text, message in wrong:
        with pytest.raises(ValueError, match=message):
            unit_numbers(text)
    assert likely_first(range(245, 249)) == ([247], [245, 246, 248])
