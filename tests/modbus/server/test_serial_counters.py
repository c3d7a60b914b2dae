"""SerialCounters: the counters of 08, the event counter, the event log, and listen only mode."""

from __future__ import annotations

import pytest

from barewire.ascii import AsciiLine, decode as ascii_decode, encode as ascii_frame
from barewire.modbus import (
    Diagnostics,
    GetCommEventCounter,
    GetCommEventCounterResponse,
    GetCommEventLog,
    GetCommEventLogResponse,
    ModbusException,
    ReadHoldingRegisters,
    ReadWriteMultipleRegisters,
    Response,
    SerialCounters,
    Server,
    Table,
    Unit,
    event_text,
)
from barewire.modbus.messages.registry import AnyRequest
from barewire.rtu import RtuLine, Timing, decode as rtu_decode, encode as rtu_frame
from tests.helpers import FailingUnit, unhex

TIMING = Timing.of(19200)
RESTART, CLEAR_LOG = "08 0001 0000", "08 0001 FF00"
READ = "03 0000 0001"


class Bench:
    """A server on an RTU line; requests are sent frame by frame, half a second apart."""

    def __init__(self, units: dict[int, Unit] | None = None) -> None:
        self.units = {1: Table(10)} if units is None else units
        self.line = RtuLine(TIMING, role="server", units=self.units)
        self.server = Server(self.line, self.units, serial=True)
        self.now = 0.0

    def receive(self, data: bytes) -> list[bytes]:
        """Return the PDUs that answer bytes on the line and the silence behind them."""
        self.now += 0.5
        replies = self.server.feed(data, self.now)
        while self.server.deadline is not None:
            replies += self.server.feed(None, self.server.deadline)
        return [rtu_decode(reply.data).pdu for reply in replies]

    def send(self, pdu: str, unit: int = 1) -> str | None:
        """Send a request, and return the PDU of the response as hex; None for silence."""
        answers = self.receive(rtu_frame(unit, unhex(pdu)))
        return answers[0].hex().upper() if answers else None

    def count(self, sub_function: int, unit: int = 1) -> int:
        """Read a counter over the line."""
        answer = self.send(f"08 00{sub_function:02X} 0000", unit)
        assert answer is not None
        assert answer[:6] == f"0800{sub_function:02X}"
        return int(answer[6:], 16)

    def events(self) -> list[str]:
        """Return the log, without the request that reads it."""
        response = GetCommEventLogResponse.decode(unhex(self.send("0C") or ""))
        return response.texts()[1:]


# The counters ----------------------------------------------------------------------------------------------------


def test_bus_messages_count_good_frames_for_any_unit() -> None:
    bench = Bench()
    bench.send(READ)
    bench.send(READ, unit=2)
    bench.send("06 0000 0001", unit=0)
    bench.receive(b"\xff\xff\xff\xff\xff")
    assert bench.count(0x0B) == 4, "including this request"
    assert bench.count(0x0E) == 4, "the requests for this unit or for all, including the one before"


def test_bus_errors_count_bytes_that_are_no_frame() -> None:
    bench = Bench()
    frame = rtu_frame(1, unhex(READ))
    bench.receive(frame[:-1] + b"\x00")
    bench.receive(frame[:2])
    assert bench.count(0x0C) == 2


def test_exceptions_are_counted_also_for_broadcasts() -> None:
    bench = Bench()
    assert bench.send("41") == "C101"
    assert bench.send("03 0000 0000") == "8303"
    assert bench.send("06 0064 0000", unit=0) is None
    assert bench.count(0x0D) == 3


def test_no_responses_count_broadcasts_and_unanswered_requests() -> None:
    bench = Bench()
    bench.send("06 0000 0001", unit=0)
    bench.send("08 0004 0000")
    bench.send(READ)
    counters = bench.server.counters[1]
    assert counters.no_responses == 3


@pytest.mark.parametrize(("code", "naks", "busy"), [(7, 1, 0), (6, 0, 1), (5, 0, 0)])
def test_naks_and_busy_answers(code: int, naks: int, busy: int) -> None:
    """08/11 counts Server Device Busy (06) only; Acknowledge (05) shares its bit of the event log."""

    class Busy(Table):
        def handle(self, request: AnyRequest, now: float) -> Response | None:
            if isinstance(request, ReadHoldingRegisters):
                raise ModbusException(code)
            return super().handle(request, now)

    bench = Bench({1: Busy(10)})
    bench.send(READ)
    assert (bench.count(0x10), bench.count(0x11)) == (naks, busy)


def test_overruns_are_counted_for_the_port_and_cleared_separately() -> None:
    bench = Bench()
    bench.server.overrun()
    assert bench.count(0x12) == 1
    assert bench.send("08 0014 0000") == "0800140000"
    assert bench.count(0x12) == 0
    assert bench.count(0x0B) == 4


def test_counters_wrap() -> None:
    counters = SerialCounters()
    for _ in range(0x10000):
        counters.frame()
    assert counters.bus_messages == 0
    counters.frame()
    assert counters.bus_messages == 1


def test_each_unit_on_a_line_has_its_own_counters() -> None:
    bench = Bench({1: Table(10), 2: Table(10)})
    bench.send(READ)
    bench.send("41", unit=2)
    assert (bench.count(0x0D, unit=1), bench.count(0x0D, unit=2)) == (0, 1)
    assert (bench.server.counters[1].bus_messages, bench.server.counters[2].bus_messages) == (4, 4)


def test_the_diagnostic_register_is_set_by_its_owner() -> None:
    bench = Bench()
    bench.server.counters[1].diagnostic_register = 0xBEEF
    assert bench.count(0x02) == 0xBEEF
    assert bench.send("08 000A 0000") == "08000A0000"
    assert bench.count(0x02) == 0
    assert bench.count(0x0B) == 2, "everything since it was cleared"


# The event counter -----------------------------------------------------------------------------------------------


def test_the_event_counter_counts_requests_that_were_carried_out() -> None:
    bench = Bench()
    bench.send(READ)
    bench.send("06 0000 0001", unit=0)
    bench.send("03 0000 0000")
    bench.send("0B")
    assert bench.send("0B") == "0B00000002", "no exceptions, and not 0B itself"
    bench.send("08 000A 0000")
    assert bench.send("0B") == "0B00000000"


def test_the_status_word_is_busy_when_is_busy_is_set() -> None:
    counters = SerialCounters()
    counters.is_busy = True
    assert counters.answer(GetCommEventCounter()) == GetCommEventCounterResponse(0xFFFF, 0)
    answer = counters.answer(GetCommEventLog())
    assert isinstance(answer, GetCommEventLogResponse)
    assert answer.status == 0xFFFF


# The log ---------------------------------------------------------------------------------------------------------


def test_the_log_lists_events_newest_first() -> None:
    bench = Bench()
    bench.send(READ)
    bench.send("06 0000 0001", unit=0)
    bench.receive(b"\xff\xff\xff\xff\xff")
    bench.send("03 0000 0000")
    assert bench.events() == [
        *("sent: exception 1..3", "received"),
        "received: communication error",
        *("sent", "received: broadcast"),
        *("sent", "received"),
    ]


def test_the_log_has_at_most_64_events() -> None:
    bench = Bench()
    for _ in range(40):
        bench.send(READ)
    assert len(bench.server.counters[1].events) == 64
    assert len(bench.events()) == 63


@pytest.mark.parametrize(("code", "text"), [(4, "exception 4"), (6, "exception 5 or 6"), (7, "exception 7")])
def test_exceptions_in_the_log(code: int, text: str) -> None:
    bench = Bench({1: FailingUnit(ModbusException(code))})
    bench.send(READ)
    assert event_text(bench.server.counters[1].events[0]) == f"sent: {text}"


@pytest.mark.parametrize(
    ("event", "text"),
    [
        (0x00, "communications restarted"),
        (0x04, "entered listen only mode"),
        (0x80, "received"),
        (0xF2, "received: communication error, character overrun, in listen only mode, broadcast"),
        (0x40, "sent"),
        (0x70, "sent: write time-out, in listen only mode"),
        (0x20, "undefined event"),
    ],
)
def test_events_in_words(event: int, text: str) -> None:
    assert event_text(event) == text


# Listen only -----------------------------------------------------------------------------------------------------


def test_listen_only_is_silence_until_a_restart_that_is_not_answered() -> None:
    table = Table(10)
    bench = Bench({1: table})
    assert bench.send("08 0004 0000") is None
    assert bench.send(READ) is None
    assert bench.send("06 0000 0001") is None
    assert bench.send("06 0000 0001", unit=0) is None
    assert bench.send("08 0001 1234") is None
    assert bench.send("08 000A 0000") is None
    assert table.holding_registers[0] == 0, "nothing was carried out"
    assert bench.send(RESTART) is None
    assert bench.send(READ) == "03020000"


def test_a_restart_is_answered_and_clears_the_counters() -> None:
    bench = Bench()
    bench.send("41")
    assert bench.send(RESTART) == "0800010000"
    assert bench.count(0x0D) == 0
    assert bench.server.counters[1].event_count == 1, "the request before"


def test_a_restart_keeps_the_log_or_clears_it() -> None:
    bench = Bench()
    bench.send(READ)
    bench.send(RESTART)
    assert bench.events() == ["communications restarted", "received", "sent", "received"]
    bench.send(CLEAR_LOG)
    assert bench.events() == ["communications restarted"]


def test_the_log_marks_events_in_listen_only_mode() -> None:
    bench = Bench()
    bench.send("08 0004 0000")
    bench.send(READ)
    bench.send(RESTART)
    assert bench.events() == [
        "communications restarted",
        *("received: in listen only mode", "received: in listen only mode"),
        "entered listen only mode",
        "received",
    ]


def test_listen_only_mode_is_per_unit() -> None:
    bench = Bench({1: Table(10), 2: Table(10)})
    bench.send("08 0004 0000", unit=1)
    assert bench.send(READ, unit=1) is None
    assert bench.send(READ, unit=2) == "03020000"


# Diagnostics of the counters and of the unit ---------------------------------------------------------------------


@pytest.mark.parametrize("pdu", ["08 0003 0D00", "08 0099 0000", "08 0015 0000", "08 FFFF 01"])
def test_unsupported_sub_functions_are_exception_01(pdu: str) -> None:
    assert Bench().send(pdu) == "8801"


class AsciiBench(Bench):
    """The same on an ASCII line, with a choice of the delimiter."""

    def __init__(self) -> None:
        super().__init__()
        self.line = AsciiLine()  # type: ignore[assignment]
        self.server = Server(self.line, self.units, serial=True)

    def exchange(self, pdu: str, end: str = "\n", unit: int = 1) -> str | None:
        """Send a request, and return the PDU of the response as hex, followed by its last character."""
        self.now += 0.5
        replies = self.server.feed(ascii_frame(unit, unhex(pdu))[:-1] + end.encode(), self.now)
        if not replies:
            return None
        data = replies[0].data
        return ascii_decode(data[:-1] + b"\n").pdu.hex().upper() + data[-1:].decode()


CHANGE = "08 0003 3B00"


def test_the_ascii_delimiter_changes_after_the_response_and_a_restart_restores_lf() -> None:
    bench = AsciiBench()
    assert bench.exchange(CHANGE) == "0800033B00\n"
    assert bench.exchange(READ, ";") == "03020000;"
    assert bench.exchange(READ) == "03020000;", "frames with LF are received too, because other units still use it"
    assert bench.exchange(RESTART, ";") == "0800010000;"
    assert bench.exchange(READ) == "03020000\n"
    assert bench.exchange(READ, ";") is None


def test_a_restart_without_response_restores_lf() -> None:
    bench = AsciiBench()
    bench.exchange(CHANGE)
    assert bench.exchange("08 0004 0000", ";") is None
    assert bench.exchange(READ, ";") is None
    assert bench.exchange(RESTART, ";") is None
    assert bench.exchange(READ) == "03020000\n"


def test_a_delimiter_changed_by_a_broadcast_applies_to_all_units() -> None:
    bench = AsciiBench()
    assert bench.exchange(CHANGE, unit=0) is None
    assert bench.exchange(READ, ";") == "03020000;"


@pytest.mark.parametrize("pdu", ["08 0003 3A00", "08 0003 8000", "08 0003 3B01", "08 0003 3B"])
def test_an_invalid_delimiter_is_exception_03(pdu: str) -> None:
    bench = AsciiBench()
    assert bench.exchange(pdu) == "8803\n"
    assert bench.exchange(READ) == "03020000\n"


@pytest.mark.parametrize("pdu", ["08 0001 0001", "08 000B 0001", "08 000B 00", "08 0002 FFFF"])
def test_wrong_diagnostics_data_is_exception_03(pdu: str) -> None:
    assert Bench().send(pdu) == "8803"


@pytest.mark.parametrize("data", ["", "A537", "01 02 03 04 05"])
def test_return_query_data_echoes_its_data(data: str) -> None:
    assert Bench().send(f"08 0000 {data}") == f"080000{data}".replace(" ", "")


def test_a_unit_that_answers_diagnostics_itself_takes_precedence() -> None:
    class Own:
        def handle(self, request: AnyRequest, now: float) -> Response | None:
            assert isinstance(request, Diagnostics)
            return request.response(request.sub_function, b"\x12\x34")  # type: ignore[call-arg]

    assert Bench({1: Own()}).count(0x0B) == 0x1234


def test_a_unit_with_diagnostics_false_keeps_its_exception_01() -> None:
    class Plain(Table):
        diagnostics = False

    assert Bench({1: Plain(10)}).send("08 000B 0000") == "8801"


def test_on_tcp_there_are_no_counters() -> None:
    from barewire.tcp import TcpLine, encode as tcp_frame

    server = Server(TcpLine(), {1: Table(10)}, serial=False)
    (reply,) = server.feed(tcp_frame(1, unhex("0B"), 1), 1.0)
    assert reply.data == tcp_frame(1, unhex("8B 01"), 1)
    assert not server.counters


def test_other_requests_raise_exception_01() -> None:
    with pytest.raises(ModbusException) as caught:
        SerialCounters().answer(ReadWriteMultipleRegisters(0, 1, 0, (1,)))
    assert caught.value.code == 1
