"""Force Listen Only Mode (08/04), whose result is silence, and Change ASCII Input Delimiter (08/03)."""

from __future__ import annotations

import pytest

from barewire.ascii import AsciiLine
from barewire.errors import EncodeError, NoAnswer
from barewire.modbus import (
    Adu,
    Bus,
    Diagnostics,
    DiagnosticsResponse,
    Line,
    ModbusException,
    ReadHoldingRegisters,
    Server,
    Unanswered,
    Unit,
)
from barewire.rtu import RtuLine, encode as rtu_frame
from barewire.tcp import TcpLine, encode as tcp_frame
from tests.modbus.client.slow import TIMING, Clock, Slow, WithoutDiagnostics, read, rtu_bus, table

LISTEN_ONLY, RESTART = Diagnostics(0x04), Diagnostics(0x01)


def slow_unit(unit: Unit, *delays: float) -> Slow:
    """Return a peer with this unit, which answers with these delays."""
    slow = Slow(delays)
    slow.server = Server(RtuLine(TIMING, role="server", units=(1,)), {1: unit}, serial=True)
    return slow


@pytest.mark.parametrize("framing", ["rtu", "ascii"])
def test_force_listen_only_returns_unanswered(framing: str) -> None:
    bus = Bus(AsciiLine()) if framing == "ascii" else rtu_bus()
    clock = Clock(Slow([], AsciiLine() if framing == "ascii" else None))
    for _ in range(2):
        assert clock.play(bus.ask(1, LISTEN_ONLY)) == Unanswered(0x04)
    with pytest.raises(NoAnswer):
        clock.play(read(bus, 5))
    assert clock.play(bus.ask(1, RESTART)) == Unanswered(0x01), "a restart in listen only mode is not answered"
    assert clock.play(read(bus, 6)) == ReadHoldingRegisters(6, 1).response((6,))  # type: ignore[call-arg]
    assert clock.play(bus.ask(1, RESTART)) == DiagnosticsResponse(0x01, b"\0\0"), "a restart in normal mode is"
    assert bus.counters.lost == 1


def test_an_exception_to_force_listen_only_is_raised() -> None:
    slow, bus = slow_unit(WithoutDiagnostics(10)), rtu_bus()
    with pytest.raises(ModbusException, match="illegal function"):
        Clock(slow).play(bus.ask(1, LISTEN_ONLY))


def test_a_response_to_force_listen_only_is_returned() -> None:
    class Answers:
        def handle(self, request: Diagnostics, now: float) -> DiagnosticsResponse:
            return DiagnosticsResponse(request.sub_function, request.data)

    answer = Clock(slow_unit(Answers())).play(rtu_bus().ask(1, LISTEN_ONLY))
    assert answer == DiagnosticsResponse(0x04, b"\0\0")
    assert not isinstance(answer, Unanswered)


@pytest.mark.parametrize("framing", ["rtu", "tcp"])
def test_an_incomplete_response_to_force_listen_only_is_ignored(framing: str) -> None:
    def answer(request: bytes, now: float) -> list[tuple[float, bytes]]:
        if framing == "tcp":
            return [(now + 0.01, tcp_frame(1, b"\x08\x00\x04", request[1]))]
        return [(now + 0.01, rtu_frame(1, b"\x08\x00\x04" if request[1] == 8 else b"\x03\x02\x00\x05"))]

    bus, clock = Bus(TcpLine()) if framing == "tcp" else rtu_bus(), Clock(answer)
    if framing == "rtu":
        clock.play(read(bus, 5))
    assert clock.play(bus.ask(1, LISTEN_ONLY)) == Unanswered(0x04)


def test_a_late_exception_to_listen_only_is_not_taken_for_the_restarts() -> None:
    bus, clock = rtu_bus(), Clock(slow_unit(WithoutDiagnostics(10), 1.5))
    assert clock.play(bus.ask(1, LISTEN_ONLY)) == Unanswered(0x04)
    assert clock.play(read(bus, 1)) is not None
    assert bus.counters.late == 1


def test_a_restart_without_listen_only_mode_before_it_must_be_answered() -> None:
    with pytest.raises(NoAnswer, match="did not answer"):
        Clock(lambda data, now: []).play(rtu_bus().ask(1, RESTART))


def test_the_silence_after_listen_only_is_no_lost_answer() -> None:
    bus, clock = rtu_bus(), Clock(lambda data, now: [])
    for lost in (1, 2):
        with pytest.raises(NoAnswer):
            clock.play(read(bus, 1, unit=lost))
        assert clock.play(bus.ask(9, LISTEN_ONLY)) == Unanswered(0x04)
        assert bus.counters.lost == lost


def test_unanswered_cannot_be_encoded() -> None:
    with pytest.raises(EncodeError, match="stands for silence and cannot be encoded"):
        Unanswered(0x04).encode()


def test_a_delimiter_is_changed_by_a_client_and_used_by_both() -> None:
    bus, slow = Bus(AsciiLine()), Slow([], AsciiLine())
    clock = Clock(slow)
    change = Diagnostics(0x03, b";\0")
    assert clock.play(bus.ask(1, change)) == DiagnosticsResponse(0x03, b";\0")
    assert clock.play(read(bus, 5)) == ReadHoldingRegisters(5, 1).response((5,))  # type: ignore[call-arg]
    assert clock.play(read(bus, 6, unit=2)) == ReadHoldingRegisters(6, 1).response((6,))  # type: ignore[call-arg]
    assert clock.play(bus.ask(1, RESTART)) == DiagnosticsResponse(0x01, b"\0\0")
    assert clock.play(read(bus, 7)) == ReadHoldingRegisters(7, 1).response((7,))  # type: ignore[call-arg]
    assert [data[-2:] for data in slow.asked] == [b"\r\n", b"\r;", b"\r\n", b"\r;", b"\r\n"]


@pytest.mark.parametrize("framing", ["rtu", "tcp"])
def test_only_ascii_lines_have_a_delimiter(framing: str) -> None:
    line: Line = RtuLine(TIMING, role="server", units=(1,)) if framing == "rtu" else TcpLine()
    server = Server(line, {1: table()}, serial=not line.numbered)
    assert server.answer(Adu(1, Diagnostics(0x03, b";\0").encode()), 1.0) == b"\x88\x01"
