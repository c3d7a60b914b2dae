"""EchoLine compares received bytes with the sent ones, and removes the echo; a damaged echo is a collision."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, strategies as st

from barewire.ascii import AsciiLine, encode as encode_ascii
from barewire.conversation import play
from barewire.errors import NoAnswer
from barewire.modbus import (
    Adu,
    Bus,
    EchoLine,
    Line,
    ModbusException,
    Noise,
    ReadHoldingRegisters,
    Server,
    Table,
    WriteOutcomeUnknown,
    WriteSingleRegister,
)
from barewire.modbus.echo import DETECTING
from barewire.rtu import RtuLine, Timing, encode
from tests.helpers import answering, bytes_of, modest

TIMING = Timing.of(19200)
REQUEST = encode(1, ReadHoldingRegisters(107, 1).encode())
ANSWER = encode(1, b"\x03\x02\x00\x2a")
WRITE = encode(1, WriteSingleRegister(1, 2).encode())


def line_of(inside: Line | None = None) -> EchoLine:
    return EchoLine(inside or RtuLine(TIMING))


@pytest.mark.parametrize("cut", range(1, len(REQUEST) + len(ANSWER)))
def test_the_echo_is_removed_in_any_pieces(cut: int) -> None:
    line = line_of()
    assert line.request(1, ReadHoldingRegisters(107, 1).encode()) == REQUEST
    line.sent(0.0)
    received = REQUEST + ANSWER
    events = line.feed(received[:cut], 0.001) + line.feed(received[cut:], 0.02)
    assert events == [Adu(1, b"\x03\x02\x00\x2a")]
    assert (line.echoed, line.collisions, line.held) == (len(REQUEST), 0, b"")


def test_a_client_on_an_echoing_line() -> None:
    line = line_of()
    answer, _ = play(Bus(line).ask(1, ReadHoldingRegisters(107, 1)), answering((0.001, REQUEST), (0.02, ANSWER)))
    assert answer.registers == (42,)
    write = encode(1, WriteSingleRegister(1, 2).encode())
    play(Bus(line).ask(1, WriteSingleRegister(1, 2)), answering((0.001, write), (0.02, write)))


def test_an_echo_is_not_taken_for_the_answer_that_looks_like_it() -> None:
    write = encode(1, WriteSingleRegister(1, 2).encode())
    with pytest.raises(NoAnswer):
        play(Bus(line_of()).ask(1, WriteSingleRegister(1, 2)), answering((0.001, write)))


def test_a_damaged_echo_is_a_collision_with_the_received_bytes() -> None:
    line = line_of()
    damaged = REQUEST[:4] + b"\xff" + REQUEST[5:]
    with pytest.raises(NoAnswer, match="collision: sent 01 03 00 6B 00 01 F5 D6, received 01 03 00 6B FF 01 F5 D6"):
        play(Bus(line).ask(1, ReadHoldingRegisters(107, 1)), answering((0.001, damaged)))
    assert line.collisions == 1


def test_a_good_answer_after_a_damaged_echo_is_found() -> None:
    line = line_of()
    damaged = b"\x00" + REQUEST[1:]
    answer, _ = play(Bus(line).ask(1, ReadHoldingRegisters(107, 1)), answering((0.001, damaged), (0.1, ANSWER)))
    assert answer.registers == (42,)
    assert line.collisions == 1


def test_without_echo_the_answer_is_found() -> None:
    line = line_of()
    for _ in range(3):
        answer, _ = play(Bus(line).ask(1, ReadHoldingRegisters(107, 1)), answering((0.02, ANSWER)))
        assert answer.registers == (42,)


def test_an_echo_that_ends_early() -> None:
    line = line_of()
    line.request(1, ReadHoldingRegisters(107, 1).encode())
    line.sent(0.0)
    assert line.feed(REQUEST[:5], 0.01) == []
    assert line.deadline == pytest.approx(0.11)
    assert line.held == REQUEST[:5]
    (collision, *rest) = line.feed(None, 0.11)
    assert isinstance(collision, Noise)
    assert collision.text == "collision: the echo ended after 5 bytes of 8"
    assert line.feed(None, 1.0) + rest == [Noise(REQUEST[:5], "checksum", "CRC is 6B 00, should be 20 F0")]


# What the adapter had received before it received the echo -------------------------------------------------------

OTHERS = encode(9, b"\x03\x02\x00\x2a")


@pytest.mark.parametrize("echoes", [True, None], ids=["echo=1", "echo=auto"])
@pytest.mark.parametrize("pieces", [[(0.01, OTHERS), (0.02, WRITE)], [(0.01, OTHERS + WRITE)]], ids=["two", "one"])
def test_an_echo_behind_another_frame_does_not_confirm_a_write(
    echoes: bool | None, pieces: list[tuple[float, bytes]]
) -> None:
    line = EchoLine(RtuLine(TIMING), echoes=echoes)
    with pytest.raises(WriteOutcomeUnknown):
        play(Bus(line).ask(1, WriteSingleRegister(1, 2)), answering(*pieces))
    play(Bus(line).ask(1, WriteSingleRegister(1, 2)), answering(*pieces, (0.1, WRITE)))


def test_the_echo_of_a_request_that_was_given_up_is_not_its_late_response() -> None:
    line = line_of()
    line.request(1, WriteSingleRegister(1, 2).encode())
    line.sent(0.0)
    line.request(1, ReadHoldingRegisters(107, 1).encode())
    line.sent(0.01)
    assert [event for event in line.feed(WRITE, 0.02) if isinstance(event, Adu)] == []
    events = line.feed(REQUEST + ANSWER, 0.03) + line.feed(None, 0.1)
    assert [event for event in events if isinstance(event, Adu)] == [bytes_to_adu(ANSWER)]


def test_an_echo_that_comes_after_the_port_was_opened_again_is_no_late_response() -> None:
    """The line is a new one then, and the answers of the requests before stay pending."""
    bus = Bus(line_of())
    with pytest.raises(WriteOutcomeUnknown):
        play(bus.ask(1, WriteSingleRegister(1, 2), timeout=0.1), answering())
    pending = bus.state.pending
    bus.continue_on(line_of())
    bus.overhear(WRITE, 0.12)
    assert bus.state.pending == pending != []
    bus.overhear(WRITE, 0.2)
    assert bus.state.pending == []


def test_the_echoes_of_two_equal_requests_are_both_removed() -> None:
    """And with the first of them not the echo of a request between them."""
    line, broadcast = line_of(), encode(0, WriteSingleRegister(1, 2).encode())
    for now, frame in (0.0, broadcast), (0.01, WRITE), (0.02, broadcast):
        line.request(frame[0], frame[1:-2])
        line.sent(now)
    for now, frame in (0.03, broadcast), (0.04, WRITE), (0.05, broadcast):
        assert line.feed(frame, now) == []
    assert line.feed(WRITE, 0.06) == [bytes_to_adu(WRITE)]
    assert line.echoed == 3 * len(WRITE)


def test_an_echo_that_does_not_come_within_a_second_is_not_expected_any_more() -> None:
    line = line_of()
    for now in range(20):
        line.request(1, WriteSingleRegister(1, 2).encode())
        line.sent(now)
    assert line.feed(WRITE + WRITE, 19.1) == [bytes_to_adu(WRITE)]


def bytes_to_adu(frame: bytes) -> Adu:
    return Adu(frame[0], frame[1:-2])


def test_a_server_on_an_echoing_line() -> None:
    line = EchoLine(RtuLine(TIMING, role="server", units=(1,)))
    server = Server(line, {1: Table()}, serial=True)
    for now in (1.0, 2.0):
        (reply,) = server.feed(REQUEST, now)
        line.sent(now + 0.01)
        assert server.feed(reply.data, now + 0.02) == []
    assert line.collisions == 0


@modest
@given(
    sends=st.booleans(),
    chunks=st.lists(st.one_of(st.none(), st.binary(max_size=20), st.just(REQUEST), st.just(ANSWER[:5])), max_size=8),
    ascii_inside=st.booleans(),
)
def test_every_byte_is_a_frame_noise_held_or_echoed(
    sends: bool, chunks: list[bytes | None], ascii_inside: bool
) -> None:
    line = line_of(AsciiLine() if ascii_inside else None)
    if sends:
        line.request(1, ReadHoldingRegisters(107, 1).encode())
    fed = reported = 0
    for step, chunk in enumerate(chunks):
        events = line.feed(chunk, 0.05 * step)
        fed += len(chunk or b"")
        reported += len(bytes_of(events, lambda adu: encode(adu.unit, adu.pdu)))
        if not ascii_inside:
            assert reported + len(line.held) + line.echoed == fed


# Detecting whether a line echoes ---------------------------------------------------------------------------------


def unknown() -> EchoLine:
    return EchoLine(RtuLine(TIMING), echoes=None)


@pytest.mark.parametrize("cut", range(1, len(REQUEST) + len(ANSWER)))
def test_an_echo_is_detected_by_the_first_detecting_request(cut: int) -> None:
    line = unknown()
    line.request(1, ReadHoldingRegisters(107, 1).encode())
    line.sent(0.0)
    received = REQUEST + ANSWER
    assert line.feed(received[:cut], 0.001) + line.feed(received[cut:], 0.02) == [Adu(1, b"\x03\x02\x00\x2a")]
    assert line.echoes is True
    with pytest.raises(NoAnswer):  # the echo alone is not the answer
        play(Bus(line).ask(1, WriteSingleRegister(1, 2)), answering((0.001, WRITE)))


@pytest.mark.parametrize("cut", range(1, len(ANSWER)))
def test_the_absence_of_an_echo_is_detected(cut: int) -> None:
    line = unknown()
    line.request(1, ReadHoldingRegisters(107, 1).encode())
    line.sent(0.0)
    assert line.feed(ANSWER[:cut], 0.001) + line.feed(ANSWER[cut:], 0.002) == [Adu(1, b"\x03\x02\x00\x2a")]
    assert line.echoes is False
    play(Bus(line).ask(1, WriteSingleRegister(1, 2)), answering((0.02, WRITE)))
    assert line.collisions == 0


def test_a_late_response_to_another_function_decides_nothing() -> None:
    line = unknown()
    line.request(1, ReadHoldingRegisters(107, 1).encode())
    line.sent(0.0)
    assert line.feed(WRITE, 0.01) == [bytes_to_adu(WRITE)]
    assert line.echoes is None


@pytest.mark.parametrize("framing", [RtuLine(TIMING), AsciiLine()], ids=["RTU", "ASCII"])
def test_an_echo_behind_another_echo_is_not_the_absence_of_an_echo(framing: Line) -> None:
    line = EchoLine(framing, echoes=None)
    to_wire = encode if isinstance(framing, RtuLine) else encode_ascii
    for now, frame in (0.0, WRITE), (0.01, REQUEST):
        line.request(frame[0], frame[1:-2])
        line.sent(now)
    for now, frame in (0.02, WRITE), (0.03, REQUEST), (0.04, ANSWER):
        events = line.feed(to_wire(frame[0], frame[1:-2]), now)
    events += line.feed(None, 0.1)
    assert events[-1] == bytes_to_adu(ANSWER)
    assert line.echoes is not False


def test_an_exception_response_detects_as_well() -> None:
    line = unknown()
    with pytest.raises(ModbusException):
        play(Bus(line).ask(1, ReadHoldingRegisters(107, 1)), answering((0.02, encode(1, b"\x83\x02"))))
    assert line.echoes is False


@pytest.mark.parametrize(
    "received",
    [b"", REQUEST[:5], b"\xff" + REQUEST[1:] + ANSWER, b"\x00" + ANSWER, encode(7, b"\x03\x02\x00\x2a") + ANSWER],
    ids=["nothing", "half of it", "a damaged echo", "noise", "another unit"],
)
def test_ambiguous_bytes_decide_nothing(received: bytes) -> None:
    line = unknown()
    with contextlib.suppress(NoAnswer):
        play(Bus(line).ask(1, ReadHoldingRegisters(107, 1)), answering((0.02, received)))
    assert line.echoes is None


def test_until_detected_a_copy_is_taken_for_an_echo() -> None:
    line = unknown()
    with pytest.raises(WriteOutcomeUnknown):
        play(Bus(line).ask(1, WriteSingleRegister(1, 2)), answering((0.02, WRITE)))
    assert line.echoes is None
    play(Bus(line).ask(1, WriteSingleRegister(1, 2)), answering((0.001, WRITE), (0.02, WRITE)))
    assert line.echoes is None
    assert play(Bus(line).ask(1, ReadHoldingRegisters(107, 1)), answering((0.02, ANSWER)))[0].registers == (42,)
    play(Bus(line).ask(1, WriteSingleRegister(1, 2)), answering((0.02, WRITE)))


@pytest.mark.parametrize("code", sorted(DETECTING))
def test_a_response_to_a_detecting_function_never_has_the_bytes_of_its_request(code: int) -> None:
    """The lengths of all requests of this function differ from the lengths of all responses."""
    lengths: dict[int, tuple[list[int], list[int]]] = {
        0x03: ([5], [2 + 2 * n for n in range(1, 126)]),
        0x04: ([5], [2 + 2 * n for n in range(1, 126)]),
        0x07: ([1], [2]),
        0x0B: ([1], [5]),
        0x0C: ([1], list(range(8, 73))),
        0x0F: (list(range(7, 253)), [5]),
        0x10: (list(range(8, 253)), [5]),
        0x11: ([1], list(range(2, 254))),
        0x18: ([3], [5 + 2 * n for n in range(32)]),
    }
    requests, answers = lengths[code]
    assert not set(requests) & set(answers)


def test_the_echo_of_the_first_of_many_requests_within_a_second_is_removed() -> None:
    line = EchoLine(RtuLine(Timing.of(19200)))
    first = line.request(1, bytes.fromhex("06 0007 0001"))
    line.sent(0.01)
    for number in range(2, 40):
        line.request(number, bytes.fromhex("06 0007 0001"))
        line.sent(0.02 * number)
    assert [event for event in line.feed(first, 0.9) if isinstance(event, Adu)] == []
