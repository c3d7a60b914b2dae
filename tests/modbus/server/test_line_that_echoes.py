"""A server on a line that returns what it sends: an echo is no request, and the same request again is no echo.

The lines are in virtual time. An echo arrives `late` seconds behind the last byte of its response.
"""

from __future__ import annotations

import heapq

import pytest

from barewire.ascii import AsciiLine, decode as ascii_decode, encode as ascii_frame
from barewire.modbus import EchoLine, Server, Table
from barewire.modbus.framing import Line
from barewire.rtu import RtuLine, decode as rtu_decode, encode as rtu_frame
from tests.helpers import every_case, unhex
from tests.modbus.server.test_server import TIMING

FRAMINGS = pytest.mark.parametrize("framing", ["rtu", "ascii"])
LATE = every_case("late", [0.0, 0.001, 0.005, 0.02, 0.045])

WRITE, OTHER_WRITE, READ = "060001 0007", "060001 0008", "030001 0001"
BUSY = "86 06"

AT_ONCE = 0.0021
"""Seconds: just above t3.5, after which a master may send again."""


def line_of(framing: str) -> Line:
    return AsciiLine() if framing == "ascii" else RtuLine(TIMING, role="server", units={1})


class Wire:
    """A master and a server on one line. `late` is None if it does not echo; a pseudo-terminal has no speed."""

    def __init__(
        self, framing: str, late: float | None = None, *, echoes: bool | None = None, has_speed: bool = True
    ) -> None:
        is_ascii = framing == "ascii"
        self.encode, self.decode = (ascii_frame, ascii_decode) if is_ascii else (rtu_frame, rtu_decode)
        self.late, self.has_speed = late, has_speed
        self.writes: list[object] = []
        table = Table(10, on_write=lambda *change: self.writes.append(change))
        self.server = Server(line_of(framing), {1: table}, serial=True, echoes=echoes)
        self.now = 1.0
        self._arrivals: list[tuple[float, int, bytes]] = []
        self._count = 0

    def _takes(self, data: bytes) -> float:
        return TIMING.duration(len(data)) if self.has_speed else 0.0

    def _arrives(self, at: float, data: bytes) -> None:
        self._count += 1
        heapq.heappush(self._arrivals, (at, self._count, data))

    def ask(self, pdu: str, after: float = 0.5, *, unit: int = 1, pieces: int = 1) -> list[str]:
        """Send a request so long after the last response. Return the responses until it is answered, or a second has
        passed. The line may deliver the request in pieces."""
        data = self.encode(unit, unhex(pdu))
        at = self.now + after + self._takes(data)
        size = -(-len(data) // pieces)
        for number in range(pieces):
            at += 0.001 * bool(number)
            self._arrives(at, data[number * size : (number + 1) * size])
        return self._until(at + 1.0, answered_from=at)

    def rest(self, seconds: float = 1.0) -> list[str]:
        """Let time pass, and return the responses to echoes."""
        return self._until(self.now + seconds)

    def _until(self, end: float, answered_from: float = float("inf")) -> list[str]:
        said = list[str]()
        while True:
            arrival = self._arrivals[0][0] if self._arrivals else end
            deadline = self.server.deadline
            data = None
            if deadline is not None and deadline < min(arrival, end):
                self.now = deadline
            elif arrival < end:
                self.now, _, data = heapq.heappop(self._arrivals)
            else:
                self.now = end
                return said
            asked_at = self.now
            for reply in self.server.feed(data, self.now):
                takes = self._takes(reply.data)
                self.now = max(self.now, reply.at) + takes
                self.server.sent(self.now, takes)
                said.append(self.decode(reply.data).pdu.hex(" ").upper())
                if self.late is not None:
                    self._arrives(self.now + self.late, reply.data)
                if asked_at >= answered_from:
                    return said


def hexed(pdu: str) -> str:
    return unhex(pdu).hex(" ").upper()


# The same request again ------------------------------------------------------------------------------------------


@FRAMINGS
@pytest.mark.parametrize("has_speed", [True, False], ids=["a line", "a pseudo-terminal"])
@pytest.mark.parametrize("pieces", [1, 2, 3])
def test_the_same_write_is_carried_out_again(framing: str, has_speed: bool, pieces: int) -> None:
    """A UART delivers a request in pieces: the second one is received less than t3.5 behind the first."""
    wire = Wire(framing, has_speed=has_speed)
    for _ in range(50):
        assert wire.ask(WRITE, AT_ONCE, pieces=pieces) == [hexed(WRITE)]
    assert (len(wire.writes), wire.server.statistics.echoes) == (50, 0)


@FRAMINGS
def test_on_a_line_that_does_not_echo_it_is_carried_out_any_number_of_times(framing: str) -> None:
    wire = Wire(framing)
    for pdu in (READ, OTHER_WRITE, READ, WRITE):
        wire.ask(pdu)
    assert wire.server.echoes is False
    assert all(wire.ask(WRITE, AT_ONCE) == [hexed(WRITE)] for _ in range(500))


@FRAMINGS
def test_there_it_may_be_sent_faster_than_the_line_is(framing: str) -> None:
    """As by a USB device that is a serial port, but has no speed."""
    wire = Wire(framing)
    for pdu in (READ, OTHER_WRITE, READ, WRITE):
        wire.ask(pdu)
    for now in (wire.now + 0.001, wire.now + 0.002):
        assert len(wire.server.feed(wire.encode(1, unhex(WRITE)), now)) == 1
        wire.server.sent(now + 0.005, 0.005)


@FRAMINGS
def test_frames_for_other_units_show_that_a_line_does_not_echo(framing: str) -> None:
    wire = Wire(framing)
    for _ in range(3):
        assert wire.ask(WRITE, AT_ONCE) == [hexed(WRITE)]
        assert wire.ask(WRITE, AT_ONCE, unit=2) == []
    assert wire.server.echoes is False


@FRAMINGS
def test_a_master_that_sends_nothing_else_is_told_once_that_the_server_is_busy(framing: str) -> None:
    """Nothing else distinguishes it from the echoes of the server's own responses."""
    wire = Wire(framing)
    said = [wire.ask(WRITE, AT_ONCE) for _ in range(500)]
    assert said == [[hexed(WRITE)]] * 100 + [[BUSY]] + [[hexed(WRITE)]] * 399
    assert (len(wire.writes), wire.server.statistics.busy, wire.server.echoes) == (499, 1, False)


@FRAMINGS
def test_one_that_pauses_longer_than_an_echo_takes_is_never_told_that(framing: str) -> None:
    wire = Wire(framing)
    assert [wire.ask(WRITE, 0.05) for _ in range(300)] == [[hexed(WRITE)]] * 300


# Echoes ----------------------------------------------------------------------------------------------------------


@FRAMINGS
@LATE
@pytest.mark.parametrize("before", [READ, "03 0001 0000", "01 0001 0001"], ids=["values", "an exception", "one coil"])
def test_a_response_that_cannot_be_a_request_shows_that_a_line_echoes(framing: str, late: float, before: str) -> None:
    wire = Wire(framing, late)
    assert len(wire.ask(before)) == 1
    assert wire.rest() == []
    assert wire.server.echoes is True
    for number in range(1, 6):
        assert wire.ask(WRITE) == [hexed(WRITE)]
        assert wire.rest() == []
        assert len(wire.writes) == number
    assert wire.server.statistics.echoes == 6


@FRAMINGS
@pytest.mark.parametrize("pdu", [WRITE, "05 0001 FF00", "16 0001 00F2 0025", "08 0000 A537"])
def test_an_echo_that_comes_before_another_station_can_have_sent_it_is_no_request(framing: str, pdu: str) -> None:
    wire = Wire(framing, 0.001)
    for number in range(1, 4):
        assert wire.ask(pdu) == [hexed(pdu)]
        assert wire.rest() == []
        assert (wire.server.statistics.echoes, wire.server.echoes) == (number, None)


@FRAMINGS
@LATE
def test_a_server_does_not_execute_its_own_responses_for_ever(framing: str, late: float) -> None:
    wire = Wire(framing, late)
    said = wire.ask(WRITE) + wire.rest(60.0)
    early = late < 0.002 or (framing, late) == ("ascii", 0.005)
    assert said == [hexed(WRITE)] if early else [hexed(WRITE)] * 100 + [BUSY]
    assert wire.ask(WRITE) + wire.rest() == [hexed(WRITE)]


@FRAMINGS
@LATE
def test_with_echo_auto_the_first_copy_is_an_echo_until_the_line_shows_that_it_has_none(
    framing: str, late: float
) -> None:
    wire = Wire(framing, late, echoes=True)
    assert wire.ask(WRITE) + wire.rest(60.0) == [hexed(WRITE)]
    wire = Wire(framing, echoes=True)
    assert [wire.ask(WRITE, AT_ONCE) for _ in range(4)] == [[hexed(WRITE)], [], [hexed(WRITE)], []]
    assert wire.ask(WRITE) + wire.ask(WRITE, 1.0) == [hexed(WRITE)] * 2, "a second later there is no echo"
    for _ in range(3):
        wire.ask(READ)
        wire.ask(OTHER_WRITE)
    assert [wire.ask(WRITE, AT_ONCE) for _ in range(4)] == [[hexed(WRITE)]] * 4


@FRAMINGS
def test_a_frame_that_was_received_before_the_response_does_not_hide_the_echo(framing: str) -> None:
    """A slow server: its master has asked another unit meanwhile."""
    wire = Wire(framing, 0.003, echoes=True)
    wire.ask(WRITE)
    wire.ask(READ, 0.0, unit=2)
    assert wire.rest() == []
    assert (wire.server.echoes, len(wire.writes)) == (True, 1)


@FRAMINGS
def test_a_line_that_begins_to_echo(framing: str) -> None:
    wire = Wire(framing)
    for _ in range(4):
        wire.ask(READ)
    assert wire.server.echoes is False
    wire.late = 0.005
    assert wire.ask(READ) + wire.rest() == ["03 02 00 00"]
    assert wire.ask(WRITE) + wire.rest() == [hexed(WRITE)]


def test_each_request_behind_an_echo_line_is_answered_once() -> None:
    line = EchoLine(line_of("rtu"))
    server = Server(line, {1: Table(10)}, serial=True)
    frame, now = rtu_frame(1, unhex(WRITE)), 1.0
    for _ in range(3):
        (reply,) = server.feed(frame, now)
        server.sent(reply.at)
        assert server.feed(reply.data, reply.at + 0.03) == [], "from an adapter that delivers the echo late"
        now += 1.0
    assert server.statistics.requests == 3
