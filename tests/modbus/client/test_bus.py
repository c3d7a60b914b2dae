"""The bus: a late answer is never delivered to another request. In virtual time."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.ascii import AsciiLine, encode as ascii_frame
from barewire.conversation import Abandoned, Heard, Send
from barewire.errors import DecodeError, EncodeError, NoAnswer
from barewire.modbus import (
    Diagnostics,
    EchoLine,
    Line,
    ModbusException,
    ReadHoldingRegisters,
    ReadInputRegisters,
    Server,
    Unanswered,
    WriteSingleRegister,
)
from barewire.modbus.client.bus import Bus
from barewire.modbus.client.line_state import PendingAnswer, UnitOptions
from barewire.rtu import RtuLine, encode as rtu_frame
from barewire.tcp import TcpLine, encode as tcp_frame
from tests.helpers import modest
from tests.modbus.client.slow import TIMING, Clock, Slow, read, rtu_bus, sending, table


@pytest.mark.parametrize("recovery", ["probe", "wait"])
@pytest.mark.parametrize("late", [1.5, 1.99, 2.5, 3.5])
def test_a_late_answer_is_recognised_and_never_delivered(recovery: str, late: float) -> None:
    bus = rtu_bus(recovery=recovery, late_window=5.0)
    clock = Clock(Slow([late]))
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10))
    answer = clock.play(bus.ask(1, ReadHoldingRegisters(20, 1), retries=2))
    assert answer == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]
    assert bus.counters.late >= 1  # a late answer to a probe counts as well
    assert bus.counters.replies[0].request == ReadHoldingRegisters(10, 1)
    assert not bus.state.pending


def test_a_late_exception_is_not_taken_for_the_next_answer() -> None:
    bus = rtu_bus()
    clock = Clock(Slow([1.5]))
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 255 + 10))  # beyond the table: its late answer is an exception
    assert clock.play(read(bus, 20)) == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("pauses", "costs"),
    [
        ((0, 0, 0.05, 0), (1, 1, 2, 1)),  # in the third, the window ends with the probe, and the request follows
        ((0, 1.5, 0), (1, 1.5, 1)),  # half a second before the end of the window
        ((0, 10, 10), (1, 1, 1)),
    ],
)
def test_a_dead_unit_costs_its_time_out_and_what_is_left_of_the_window(
    pauses: tuple[float, ...], costs: tuple[float, ...]
) -> None:
    bus = rtu_bus(late_window=3.0)
    clock = Clock(lambda data, now: [])
    for pause, cost in zip(pauses, costs):
        clock.now += pause
        begin = clock.now
        with pytest.raises(NoAnswer):
            clock.play(read(bus, 10, timeout=1.0))
        assert clock.now - begin == pytest.approx(cost, abs=0.05)


@pytest.mark.parametrize("every", [0.2, 1.0, 10.0])
def test_a_dead_unit_among_twenty_costs_one_time_out_in_each_round_or_two_within_the_window(every: float) -> None:
    server = Server(
        RtuLine(TIMING, role="server", units=range(1, 20)), {unit: table() for unit in range(1, 20)}, serial=True
    )
    bus = rtu_bus()
    clock = Clock(lambda data, now: [(now + 0.001, reply.data) for reply in server.feed(data, now)])
    for _ in range(12):
        clock.now += every
        begin, answered = clock.now, bus.counters.answered
        for unit in range(1, 20):
            clock.play(read(bus, 10, unit=unit, timeout=0.2))
        assert bus.counters.answered == answered + 19
        round_without = clock.now - begin
        with pytest.raises(NoAnswer):
            clock.play(read(bus, 10, unit=20, timeout=0.2))
        assert clock.now - begin < round_without + (0.41 if every < 0.5 else 0.21)


def test_a_pending_answer_whose_time_is_over_needs_no_probe() -> None:
    bus = rtu_bus()
    clock = Clock(Slow([None]))
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10))
    clock.now = 3.1
    assert clock.play(read(bus, 20)) == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]
    assert bus.counters.probes == 0


@pytest.mark.parametrize("framing", ["rtu", "tcp"])
def test_a_response_with_a_wrong_byte_count_ends_the_exchange_at_once(framing: str) -> None:
    answers = iter([b"\x03\x02\x00\x01", b"\x03\x04\x00\x01\x00\x02"])

    def answer(request: bytes, now: float) -> list[tuple[float, bytes]]:
        pdu = next(answers)
        return [(now + 0.01, rtu_frame(1, pdu) if framing == "rtu" else tcp_frame(1, pdu, request[1]))]

    bus = Bus(RtuLine(TIMING) if framing == "rtu" else TcpLine())
    clock = Clock(answer)
    clock.play(read(bus, 1))
    with pytest.raises(NoAnswer, match="answered Read Holding Registers with a wrong response: byte_count 4") as caught:
        clock.play(read(bus, 2))
    assert isinstance(caught.value.__cause__, DecodeError)  # so a program can tell it from silence
    assert clock.now < 0.1
    assert not bus.state.pending


def test_a_request_to_another_unit_or_function_is_sent_without_a_probe() -> None:
    bus = rtu_bus()
    slow = Slow([None])
    clock = Clock(slow)
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10))
    before = clock.now
    clock.play(read(bus, 30, unit=2))  # another unit
    clock.play(bus.ask(1, ReadInputRegisters(20, 1)))  # another function
    assert bus.counters.probes == 0
    assert clock.now - before < 0.1


def test_a_bus_that_takes_over_a_line_knows_what_is_still_to_come() -> None:
    """The answer, the probe, and the pause of the bus before."""
    buses = [rtu_bus(late_window=60.0, options=UnitOptions(gap=5.0)) for _ in range(3)]
    slow = Slow([30.0, None])
    clock = Clock(slow)
    with pytest.raises(NoAnswer):
        clock.play(read(buses[0], 10))
    sent_at = clock.now - 1.0
    buses[1].take_over(buses[0])
    with pytest.raises(NoAnswer):  # its probe has no answer
        clock.play(read(buses[1], 15))
    assert clock.now >= sent_at + 5.0
    buses[2].take_over(buses[1])
    slow.free_at = clock.now
    answer = clock.play(read(buses[2], 20))
    assert answer == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]
    probes = [request for request in slow.asked if request[1] == 8]
    assert len(probes) == len(set(probes)) == 2


def test_a_bus_that_takes_over_a_line_knows_which_echo_is_still_to_come() -> None:
    before, after = (Bus(EchoLine(RtuLine(TIMING))) for _ in range(2))
    conversation = before.ask(1, WriteSingleRegister(1, 2))
    sent = sending(conversation, 0.0)
    conversation.send(Heard(None, 0.1))
    conversation.close()
    after.take_over(before)
    after.overhear(sent.item, 0.2)
    assert [pending.request for pending in after.state.pending] == [WriteSingleRegister(1, 2)]


def test_a_bus_with_numbered_answers_takes_over_none() -> None:
    before, after = rtu_bus(), Bus(TcpLine())
    with pytest.raises(NoAnswer):
        Clock(Slow([None])).play(read(before, 10))
    after.take_over(before)
    assert after.state.pending == []


def test_an_answer_settles_every_earlier_pending_answer_of_its_unit() -> None:
    bus = rtu_bus()
    clock = Clock(Slow([None]))
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10))
    clock.play(bus.ask(1, ReadInputRegisters(20, 1)))
    assert not bus.state.pending
    clock.play(read(bus, 30))
    assert bus.counters.probes == 0


def test_two_late_answers_are_both_recognised() -> None:
    bus = rtu_bus()
    clock = Clock(Slow([1.5, 1.5]))
    for address in (10, 11):
        with pytest.raises(NoAnswer):
            clock.play(read(bus, address) if address == 10 else bus.ask(1, ReadInputRegisters(11, 1)))
    answer = clock.play(bus.ask(1, ReadHoldingRegisters(20, 1), retries=2))
    assert answer == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]
    assert [late.request for late in bus.counters.replies][:2] == [
        ReadHoldingRegisters(10, 1),
        ReadInputRegisters(11, 1),
    ]


def test_a_late_answer_and_the_right_one_in_one_read() -> None:
    bus = rtu_bus(recovery="wait", late_window=0.0)
    slow = Slow([None])
    clock = Clock(slow)
    with pytest.raises(NoAnswer):
        clock.play(bus.ask(1, ReadHoldingRegisters(10, 2)))
    late = slow.server.feed(b"", 0.0)
    assert late == []
    glued = bytes.fromhex("01 03 04 00 0A 00 0B 9B F6")
    right = slow.server.feed(RtuLine(TIMING).request(1, ReadHoldingRegisters(20, 1).encode()), clock.now)[0].data

    def peer(data: bytes, now: float) -> list[tuple[float, bytes]]:
        return [(now + 0.01, glued + right)]

    clock.peer = peer
    answer = clock.play(read(bus, 20))
    assert answer == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]


def test_an_abandoned_request_leaves_a_pending_answer() -> None:
    bus = rtu_bus()
    slow = Slow([0.5])
    clock = Clock(slow)
    conversation = read(bus, 10)
    heard: Heard[bytes] = Heard(None, 0.0)
    clock.coming = list(slow(sending(conversation, 0.0).item, 0.0))
    conversation.send(heard)
    with pytest.raises(Abandoned):
        conversation.throw(Abandoned())
    assert bus.state.pending == [PendingAnswer(1, ReadHoldingRegisters(10, 1), 3.03)]
    assert clock.play(read(bus, 20)) == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]
    assert bus.counters.late == 1


def test_a_request_abandoned_while_being_sent_leaves_a_pending_answer() -> None:
    """It may have been sent in part; its late window counts from when sending began."""
    bus = rtu_bus(recovery="wait", late_window=2.0)
    conversation = read(bus, 10)
    sending(conversation, 100.0)
    with pytest.raises(Abandoned):
        conversation.throw(Abandoned())
    clock = Clock(Slow([]))
    clock.now = 100.5
    clock.coming = [(101.0, RtuLine(TIMING).request(1, b"\x03\x02\x00\x0a"))]
    assert clock.play(read(bus, 20)) == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]
    assert bus.counters.late == 1


def test_the_gap_of_a_unit_is_kept_between_two_requests() -> None:
    bus = rtu_bus(units={1: UnitOptions(gap=0.5)})
    clock = Clock(Slow([]))
    clock.play(read(bus, 1))
    before = clock.now
    clock.play(read(bus, 2))
    assert clock.now - before >= 0.5


def test_a_dead_unit_is_asked_at_growing_intervals() -> None:
    bus = rtu_bus(options=UnitOptions(dead_after=2), recovery="wait", late_window=0.0)
    slow = Slow([None] * 20)
    clock = Clock(slow)
    for _ in range(2):
        with pytest.raises(NoAnswer, match="did not answer"):
            clock.play(read(bus, 1, timeout=0.1))
    with pytest.raises(NoAnswer, match="left 2 requests unanswered: asked again in 1"):
        clock.play(read(bus, 1, timeout=0.1))
    assert len(slow.asked) == 2
    clock.now += 1.1
    with pytest.raises(NoAnswer, match="did not answer"):
        clock.play(read(bus, 1, timeout=0.1))
    with pytest.raises(NoAnswer, match=r"asked again in (2|1\.9)"):
        clock.play(read(bus, 1, timeout=0.1))
    clock.now += 40
    slow.delays = iter([])
    clock.play(read(bus, 1, timeout=0.1))
    assert clock.play(read(bus, 2)) is not None


delays = st.lists(st.one_of(st.none(), st.floats(0.0, 6.0)), max_size=8)


@modest
@given(
    delays=delays,
    requests=st.lists(st.tuples(st.sampled_from([1, 2]), st.integers(0, 300), st.booleans()), max_size=12),
    ascii_line=st.booleans(),
)
def test_no_late_or_lost_answer_is_delivered_to_another_request(
    delays: list[float | None], requests: list[tuple[int, int, bool]], ascii_line: bool
) -> None:
    """A unit that answers in order and within the late window, and a client that continues after every error."""
    bus = Bus(AsciiLine() if ascii_line else RtuLine(TIMING), late_window=60.0)
    clock = Clock(Slow(delays, AsciiLine() if ascii_line else None))
    for unit, address, holding in requests:
        request = ReadHoldingRegisters if holding else ReadInputRegisters
        try:
            answer = clock.play(bus.ask(unit, request(address, 1)))
        except NoAnswer:
            continue
        except ModbusException:
            assert address > 255
            continue
        assert answer.registers == (address,)


ANSWERS = st.one_of(
    st.binary(max_size=40),
    st.builds(
        lambda frame, unit, rest: frame(unit, b"\x03" + rest),
        st.sampled_from([rtu_frame, ascii_frame, lambda unit, pdu: tcp_frame(unit, pdu, 1)]),
        st.integers(0, 2),
        st.binary(max_size=8),
    ),
)


@modest
@given(
    answers=st.lists(st.lists(st.tuples(st.floats(0.0, 3.0), ANSWERS), max_size=4), max_size=6),
    framing=st.sampled_from(["rtu", "ascii", "tcp", "echo"]),
)
def test_any_received_bytes_end_in_an_answer_an_exception_or_no_answer(
    answers: list[list[tuple[float, bytes]]], framing: str
) -> None:
    """No other exception is raised, and memory stays bounded."""
    lines: dict[str, Line] = {
        "rtu": RtuLine(TIMING),
        "ascii": AsciiLine(),
        "tcp": TcpLine(),
        "echo": EchoLine(RtuLine(TIMING), echoes=None),
    }
    bus = Bus(lines[framing], late_window=1.0)
    left = iter(answers)
    clock = Clock(lambda data, now: [(now + after, item) for after, item in next(left, [])])
    for address in range(8):
        try:
            answer = clock.play(read(bus, address))
        except (NoAnswer, ModbusException):
            continue
        assert len(answer.registers) == 1  # type: ignore[attr-defined]
    assert len(bus.line.held) <= 520


def test_a_late_answer_that_is_overheard_between_two_requests_is_recorded() -> None:
    bus = rtu_bus()
    clock = Clock(Slow([None]))
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10))
    bus.overhear(rtu_frame(1, b"\x03\x02\x00\x0a"), clock.now + 0.5)
    assert [(late.request, late.at) for late in bus.counters.replies] == [
        (ReadHoldingRegisters(10, 1), clock.now + 0.5)
    ]
    assert not bus.state.pending


def test_a_broadcast_waits_one_second_and_its_turnaround_for_a_busy_line() -> None:
    bus = rtu_bus()
    clock = Clock(lambda data, now: [])
    clock.coming = [(0.001 * count, b"\x55") for count in range(5000)]
    with pytest.raises(NoAnswer, match=r"another station has been sending for 1\.2 s"):
        clock.play(bus.broadcast(WriteSingleRegister(1, 2), turnaround=0.2))
    assert 1.2 <= clock.now < 1.21


def test_unit_0_on_a_serial_line_is_refused_and_the_field_is_named() -> None:
    with pytest.raises(EncodeError) as refusal:
        read(rtu_bus(), 10, unit=0)
    assert str(refusal.value) == "unit 0 on a serial line is a broadcast, which no unit answers: use broadcast"
    assert refusal.value.field == "unit"
    assert next(read(Bus(TcpLine()), 10, unit=0)) == Send(tcp_frame(0, ReadHoldingRegisters(10, 1).encode(), 1))


@pytest.mark.parametrize("copies", [1, 2, 3, 4])
def test_copies_of_a_frame_in_one_read_are_counted_and_settle_one_request(copies: int) -> None:
    """Two requests are pending to which the frame fits."""
    bus = rtu_bus()
    for number in (b"\0\1", b"\0\2"):
        bus.state.pending.append(PendingAnswer(1, Diagnostics(0, number), 60.0))
    for round_ in (1, 2):
        bus.overhear(rtu_frame(1, b"\x88\x01") * copies, 1.0)
        assert (bus.counters.strays, bus.counters.late) == (round_ * copies, round_)
    assert bus.state.pending == []


def test_a_broadcast_that_only_reads_is_refused_and_the_field_is_named() -> None:
    with pytest.raises(EncodeError, match="only writes make sense") as refusal:
        rtu_bus().broadcast(ReadHoldingRegisters(1, 1))
    assert refusal.value.field == "unit"


def test_frames_that_arrive_with_the_answer_are_recorded() -> None:
    """Unit 1 is late; its answer arrives behind that of unit 2, with a frame of unit 3."""
    bus = rtu_bus()
    clock = Clock(lambda data, now: [])
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10))
    others = rtu_frame(1, b"\x03\x02\x00\x0a") + rtu_frame(3, b"\x03\x02\x00\x63")
    clock.peer = lambda data, now: [(now + 0.5, rtu_frame(2, b"\x03\x02\x00\x14") + others)]
    assert clock.play(read(bus, 20, unit=2)) == ReadHoldingRegisters(20, 1).response((20,))  # type: ignore[call-arg]
    assert (bus.counters.late, bus.counters.strays) == (1, 2)
    assert [late.at for late in bus.counters.replies] == [clock.now]
    assert not bus.state.pending


def test_an_answer_ends_the_listen_only_mode_that_was_assumed() -> None:
    bus = rtu_bus()
    clock = Clock(lambda data, now: [(now + 0.01, rtu_frame(1, b"\x03\x02\0\1"))] if data[1] == 3 else [])
    assert clock.play(bus.ask(1, Diagnostics(0x04))) == Unanswered(0x04)
    clock.play(read(bus, 1))
    with pytest.raises(NoAnswer):
        clock.play(bus.ask(1, Diagnostics(0x01)))


def test_where_neither_unit_nor_number_is_compared_a_late_answer_of_another_unit_is_excluded() -> None:
    """A gateway answers with unit 255 and transaction 0; the answer of unit 1 comes when that of 2 is expected."""

    def gateway(request: bytes, now: float) -> list[tuple[float, bytes]]:
        delay = 1.2 if request[6] == 1 else 0.4
        return [(now + delay, tcp_frame(255, b"\x03\x02\x00" + request[9:10], 0))] if request[7] == 3 else []

    bus = Bus(TcpLine(any_unit=True, any_transaction=True))
    clock = Clock(gateway)
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 10, unit=1))
    for address in (20, 21, 22):
        answer = clock.play(read(bus, address, unit=2))
        assert answer == ReadHoldingRegisters(address, 1).response((address,))  # type: ignore[call-arg]
    assert [late.request for late in bus.counters.replies] == [ReadHoldingRegisters(10, 1)]
