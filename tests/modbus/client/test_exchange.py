"""One exchange of a client, in virtual time."""

from __future__ import annotations

import pytest

from barewire.ascii import AsciiLine, encode as ascii_frame
from barewire.conversation import Conversation, Heard, Listen, Send, SendAll, play
from barewire.errors import EncodeError, NoAnswer
from barewire.modbus import (
    Bus,
    ModbusException,
    ReadCoils,
    ReadDeviceIdentification,
    ReadHoldingRegisters,
    ReadHoldingRegistersResponse,
    ReportServerId,
    Server,
    Table,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from barewire.modbus.messages.registry import AnyRequest
from barewire.rtu import RtuLine, Timing, encode as rtu_frame
from barewire.tcp import TcpLine, encode as tcp_frame
from tests.helpers import Chunk, answering, refused, serving, unhex

TIMING = Timing.of(19200)
READ = ReadHoldingRegisters(0x6B, 3)
VALUE = ReadHoldingRegistersResponse((0x022B, 0, 0x0064))
ANSWER = rtu_frame(1, VALUE.encode())
EXCEPTION = rtu_frame(1, unhex("83 02"))


def rtu() -> RtuLine:
    return RtuLine(TIMING)


def test_an_endless_time_out_is_refused_because_late_answers_are_expected_for_a_multiple_of_it() -> None:
    bus = Bus(rtu())
    for timeout in (float("inf"), float("nan"), -1.0):
        with refused(EncodeError, f"time-out {timeout} s: expected 0 or more seconds, and finite"):
            bus.ask(1, READ, timeout=timeout)
    assert bus.counters.asked == 0


# The times of a line ---------------------------------------------------------------------------------------------


def test_an_exchange_takes_exactly_the_time_that_its_characters_take() -> None:
    """8 characters out, 3.5 of silence, 11 back, 11 bits each: 22.5 x 11 / 19200 = 12.890625 ms."""
    server = Server(RtuLine(TIMING, role="server"), {1: Table()}, serial=True)
    answer, end = play(
        Bus(rtu()).ask(1, READ), serving(server, TIMING), sending_takes=lambda frame: TIMING.duration(len(frame))
    )
    assert answer == ReadHoldingRegistersResponse((0, 0, 0))
    assert end == pytest.approx(0.012890625, abs=1e-12)


@pytest.mark.parametrize("strict", [False, True])
def test_the_next_exchange_keeps_the_silence_before_it(strict: bool) -> None:
    """Twice 22.5 characters, 3.5 between; a strict line also waits 3.5 before a frame is complete."""
    patience = None if strict else 0.03
    line = RtuLine(TIMING, patience=patience)
    server = Server(RtuLine(TIMING, role="server", patience=patience), {1: Table()}, serial=True)
    peer, end = serving(server, TIMING), 5.0
    for _ in range(2):
        _, end = play(Bus(line).ask(1, READ), peer, start=end, sending_takes=lambda frame: TIMING.duration(len(frame)))
    characters = 2 * (22.5 + 3.5) if strict else 22.5 + 3.5 + 22.5
    assert end - 5.0 == pytest.approx(characters * TIMING.character, abs=1e-9)


def test_a_request_waits_until_the_line_has_been_quiet() -> None:
    line = rtu()
    line.sent(10.0)
    conversation = Bus(line).ask(1, READ)
    assert next(conversation) == Listen(float("-inf"))
    assert conversation.send(Heard(None, 10.0)) == Listen(10.0 + TIMING.t35)
    assert conversation.send(Heard(None, 10.0 + TIMING.t35)) == Send(rtu_frame(1, READ.encode()))


# The answer ------------------------------------------------------------------------------------------------------


def asked(*answers: Chunk, timeout: float = 1.0) -> tuple[ReadHoldingRegistersResponse, float]:
    """Ask unit 1 over RTU; `answers` are (bytes, seconds after the request)."""
    peer = answering(*((after, data or b"") for data, after in answers))
    return play(Bus(rtu()).ask(1, READ, timeout=timeout), peer)


WHOLE = [
    pytest.param(rtu_frame(2, VALUE.encode()), id="another unit"),
    pytest.param(rtu_frame(1, unhex("04 06 022B 0000 0064")), id="another function"),
    pytest.param(rtu_frame(1, unhex("84 02")), id="another function's exception"),
    pytest.param(rtu_frame(1, unhex("03 02 022B")), id="another quantity"),
    pytest.param(rtu_frame(1, READ.encode()), id="the echo of the request"),
]
DAMAGED = [
    pytest.param(ANSWER[:-1] + b"\xff", id="a damaged one"),
    pytest.param(b"\xff\xfe\x00", id="noise"),
    pytest.param(ANSWER[:6], id="half an answer"),
    pytest.param(b"\x01\x41", id="a beginning without an end"),
]
OTHERS = [*WHOLE, *DAMAGED]


def test_the_answer_is_returned_when_it_arrives() -> None:
    assert asked((ANSWER, 0.25)) == (VALUE, 0.25)


def test_an_answer_in_pieces_is_returned_when_it_is_complete() -> None:
    assert asked((ANSWER[:4], 0.25), (ANSWER[4:], 0.26)) == (VALUE, 0.26)


def test_an_answer_that_arrives_exactly_at_the_timeout_is_returned() -> None:
    assert asked((ANSWER, 1.0)) == (VALUE, 1.0)


@pytest.mark.parametrize("other", OTHERS)
def test_other_bytes_before_the_answer_are_ignored(other: bytes) -> None:
    assert asked((other, 0.25), (ANSWER, 0.5)) == (VALUE, 0.5)


@pytest.mark.parametrize("damaged", DAMAGED)
def test_nothing_is_taken_directly_behind_damaged_bytes(damaged: bytes) -> None:
    """The answer may be data of the damaged frame. The error says what was received."""
    with refused(NoAnswer, "unit 1 did not answer Read Holding Registers within 1 s; received instead: "):
        asked((damaged + ANSWER, 0.25))


@pytest.mark.parametrize("other", [*WHOLE, pytest.param(b"\xff\x00", id="stray bytes")])
def test_other_bytes_and_the_answer_may_come_in_one_read(other: bytes) -> None:
    value, end = asked((other + ANSWER, 0.25))
    assert value == VALUE
    assert end <= 0.25 + 0.031


@pytest.mark.parametrize("other", OTHERS)
def test_other_bytes_do_not_extend_the_timeout(other: bytes) -> None:
    with refused(NoAnswer, "unit 1 did not answer Read Holding Registers within 1 s; received instead: "):
        asked((other, 0.9), (ANSWER, 1.25))


def test_an_exception_response_raises_modbus_exception() -> None:
    with pytest.raises(ModbusException) as caught:
        asked((EXCEPTION, 0.25))
    assert (caught.value.code, caught.value.function_code) == (2, 3)


def test_an_exception_response_of_another_unit_is_ignored() -> None:
    assert asked((rtu_frame(2, unhex("83 02")), 0.25), (ANSWER, 0.5)) == (VALUE, 0.5)


def test_on_a_strict_line_an_answer_ends_with_silence() -> None:
    """A strict line ends every frame by silence."""
    line = RtuLine(TIMING, patience=None)
    assert play(Bus(line).ask(1, READ), answering((0.25, ANSWER))) == (VALUE, 0.25 + TIMING.t35)


# No answer -------------------------------------------------------------------------------------------------------


def test_silence_raises_no_answer_at_the_timeout() -> None:
    conversation = Bus(rtu()).ask(7, READ, timeout=0.5)
    with pytest.raises(NoAnswer) as caught:
        play(conversation, answering())
    assert str(caught.value) == "unit 7 did not answer Read Holding Registers within 0.5 s"


@pytest.mark.parametrize(
    ("received", "text"),
    [
        (rtu_frame(2, VALUE.encode()), "a frame from unit 2, function 03"),
        (rtu_frame(1, unhex("84 02")), "function 84 where 03 (Read Holding Registers) was expected"),
        (b"\xff\xfe\x00", "3 bytes FF FE 00, then silence"),
        (b"\x01", "1 byte 01, then silence"),
        (bytes(20), "20 bytes " + "00 " * 16 + "...: CRC is 00 00, should be"),
    ],
)
def test_the_error_lists_what_was_received_instead(received: bytes, text: str) -> None:
    with refused(NoAnswer, text):
        asked((received, 0.25))


def test_the_error_mentions_an_incomplete_answer() -> None:
    with refused(NoAnswer, "received instead: 4 bytes without an end"):
        asked((ANSWER[:4], 0.99))


def test_the_error_lists_at_most_three_events() -> None:
    with pytest.raises(NoAnswer) as caught:
        asked(*((rtu_frame(2, VALUE.encode()), place / 200) for place in range(100)))
    assert str(caught.value).count("a frame from unit 2") == 3
    assert str(caught.value).endswith("; ...")


# Before sending --------------------------------------------------------------------------------------------------


def first_send(
    line: RtuLine, coming: list[tuple[float, bytes]], request: AnyRequest = READ
) -> tuple[Send[bytes] | SendAll[bytes], float]:
    """Return the first step that is a Send, and its time, if `coming` arrives before anything is sent."""
    conversation: Conversation[bytes, object] = Bus(line).ask(1, request)
    now, step = 1.0, next(conversation)
    while isinstance(step, Listen):
        if coming and coming[0][0] <= max(step.until, now):
            now = max(now, coming[0][0])
            step = conversation.send(Heard(coming.pop(0)[1], now))
        else:
            now = max(now, step.until)
            step = conversation.send(Heard(None, now))
    return step, now


def test_a_late_answer_received_before_sending_is_not_taken_for_the_answer() -> None:
    line = rtu()
    step, now = first_send(line, [(0.5, ANSWER)])
    assert isinstance(step, Send)
    assert now == 1.0 + TIMING.t35
    assert line.held == b""


def test_a_request_waits_until_an_incomplete_frame_ends() -> None:
    step, now = first_send(rtu(), [(0.5, ANSWER[:4]), (1.02, ANSWER[4:])])
    assert isinstance(step, Send)
    assert now == 1.02 + TIMING.t35


def test_an_incomplete_frame_delays_a_request_until_its_deadline() -> None:
    line = rtu()
    step, now = first_send(line, [(0.5, ANSWER[:4])])
    assert isinstance(step, Send)
    assert now == 1.0 + line.gap
    assert line.held == b""


def test_nothing_is_sent_on_a_line_that_is_never_silent() -> None:
    with refused(NoAnswer, "the line is never silent: another station has been sending for 1 s"):
        first_send(rtu(), [(place / 1000, b"\x00") for place in range(3000)])


# Other framings --------------------------------------------------------------------------------------------------


def test_an_exchange_over_ascii() -> None:
    peer = answering((0.25, ascii_frame(2, VALUE.encode())), (0.5, ascii_frame(1, VALUE.encode())))
    assert play(Bus(AsciiLine()).ask(1, READ), peer) == (VALUE, 0.5)


def test_the_error_over_ascii_describes_the_damaged_frame() -> None:
    with refused(NoAnswer, "LRC is 00, should be"):
        play(Bus(AsciiLine()).ask(1, READ), answering((0.25, ascii_frame(1, VALUE.encode())[:-4] + b"00\r\n")))


def test_an_exchange_over_tcp_accepts_only_its_transaction() -> None:
    late, right = tcp_frame(1, VALUE.encode(), 0), tcp_frame(1, VALUE.encode(), 1)
    assert play(Bus(TcpLine()).ask(1, READ), answering((0.25, late), (0.5, right))) == (VALUE, 0.5)


@pytest.mark.parametrize("serial", [True, False])
def test_a_client_and_a_server_exchange_requests(serial: bool) -> None:
    table = Table()
    line = AsciiLine() if serial else TcpLine()
    server = Server(AsciiLine() if serial else TcpLine(), {1: table}, serial=serial)
    play(Bus(line).ask(1, WriteMultipleRegisters(0x6B, (1, 2, 3))), serving(server))
    answer, _ = play(Bus(line).ask(1, READ), serving(server))
    assert answer.registers == (1, 2, 3)
    assert server.statistics.replies == server.statistics.requests == 2


# Broadcast -------------------------------------------------------------------------------------------------------


def test_a_broadcast_is_sent_to_unit_0_and_waits_for_the_turnaround() -> None:
    sent = []

    def peer(item: bytes, now: float) -> list[tuple[float, bytes]]:
        sent.append((item, now))
        return [(now + 0.05, b"\xff\xff")]

    result, end = play(Bus(rtu()).broadcast(WriteSingleRegister(0, 0x1234), turnaround=0.2), peer, start=1.0)
    assert result is None
    assert sent == [(unhex("00 06 0000 1234 856C"), 1.0)]
    assert end == 1.2


def test_a_request_after_a_broadcast_keeps_the_silence() -> None:
    line = rtu()
    play(Bus(line).broadcast(WriteSingleRegister(0, 1), turnaround=0.0), answering(), start=1.0)
    assert line.quiet_at == 1.0 + TIMING.t35


@pytest.mark.parametrize("request_", [READ, ReadCoils(0, 1), ReportServerId(), ReadDeviceIdentification()])
def test_a_broadcast_of_a_read_is_refused(request_: AnyRequest) -> None:
    with refused(EncodeError, f"{request_.name} as a broadcast: no unit answers it"):
        play(Bus(rtu()).broadcast(request_), answering())
