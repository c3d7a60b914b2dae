"""The server: the order of its checks, unit addresses, failures of a unit, any input, and limits."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, strategies as st

from barewire.ascii import AsciiLine, encode as ascii_frame
from barewire.modbus import (
    Adu,
    Delayed,
    ModbusException,
    ReadHoldingRegistersResponse,
    ReportServerId,
    ReportServerIdResponse,
    Response,
    SdoAborted,
    Server,
    Table,
    Unit,
    decode_response,
)
from barewire.modbus.framing import Line
from barewire.rtu import RtuLine, Timing, encode as rtu_frame
from barewire.tcp import TcpLine, decode as tcp_decode, encode as tcp_frame
from tests.helpers import Chunk, FailingUnit, chunked, modest, unhex

TIMING = Timing.of(19200)


class Answering:
    """A unit that answers every request with the same response."""

    def __init__(self, response: Any) -> None:
        self.response = response

    def handle(self, request: Any, now: float) -> Response | None:
        return self.response  # type: ignore[no-any-return]


def tcp_server(unit: Unit | None = None, address: int = 1) -> Server:
    return Server(TcpLine(), {address: unit or Table(100)}, serial=False)


def rtu_server(units: dict[int, Unit] | None = None) -> Server:
    units = {1: Table(100)} if units is None else units
    return Server(RtuLine(TIMING, role="server", units=units), units, serial=True)


def answer(server: Server, pdu: str, unit: int = 1) -> str | None:
    """Return the response of the server to one PDU, as hex."""
    found = server.answer(Adu(unit, unhex(pdu)), 1.0)
    return None if found is None else found.hex().upper()


# The order of checks ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pdu", "answered"),
    [
        # 01: the function, before anything else
        pytest.param("41 00", "C101", id="unknown function"),
        pytest.param("00", "8001", id="function 0"),
        pytest.param("2B 0D 00 1F 1005 00 0000 0004", "AB01", id="unknown MEI type"),
        pytest.param("08 0000 A537", "8801", id="known function that the unit does not support"),
        pytest.param("0B", "8B01", id="another one"),
        pytest.param("08 00", "8801", id="known, not supported, and malformed"),
        pytest.param("2B 0D 00", "AB01", id="another one of these"),
        # 03: quantities, values, lengths
        pytest.param("03 0000 0000", "8303", id="quantity 0"),
        pytest.param("03 0000 007E", "8303", id="quantity 126"),
        pytest.param("01 0000 07D1", "8103", id="quantity 2001"),
        pytest.param("05 0000 1234", "8503", id="a coil that is neither on nor off"),
        pytest.param("0F 0000 0009 01 FF", "8F03", id="byte count too small for the coils"),
        pytest.param("10 0000 0001 04 0001 0002", "9003", id="byte count too large for the registers"),
        pytest.param("10 0000 0002 04 0001", "9003", id="byte count larger than what follows"),
        pytest.param("03 0000", "8303", id="truncated"),
        pytest.param("03", "8303", id="nothing but the function"),
        pytest.param("03 0000 0001 00", "8303", id="a byte too many"),
        pytest.param("2B 0E 05 00", "AB03", id="unknown read code"),
        pytest.param("14 06 06 0001 0000 00", "9403", id="no whole group of records"),
        pytest.param("17 0000 007E 0000 0001 02 0000", "9703", id="read 126, written 1"),
        pytest.param("17 0000 0001 0000 0002 02 0000", "9703", id="byte count of what is written"),
        # 03 wins over 02
        pytest.param("03 FFFF 0000", "8303", id="bad address and quantity 0"),
        pytest.param("05 FFFF 1234", "8503", id="bad address and bad value"),
        pytest.param("10 FFFF 0001 04 0001 0002", "9003", id="bad address and byte count"),
        # 02: addresses
        pytest.param("03 0064 0001", "8302", id="behind the end"),
        pytest.param("03 0063 0002", "8302", id="over the end"),
        pytest.param("03 FFFF 0002", "8302", id="over the end of all addresses"),
        pytest.param("05 0064 FF00", "8502", id="no such coil"),
        pytest.param("0F 0060 0005 01 1F", "8F02", id="coils over the end"),
        pytest.param("10 0063 0002 04 0001 0002", "9002", id="registers over the end"),
        pytest.param("16 0064 00F2 0025", "9602", id="no register to mask"),
        pytest.param("17 0063 0002 0000 0001 02 0001", "9702", id="read over the end"),
        pytest.param("17 0000 0001 0064 0001 02 0001", "9702", id="written over the end"),
        pytest.param("18 0000", "9802", id="no queue"),
        pytest.param("14 07 06 0001 0000 0001", "9402", id="no file"),
        pytest.param("14 07 05 0001 0000 0001", "9402", id="a reference type that is not 6, by figure 24"),
        pytest.param("15 09 06 0000 0000 0001 0000", "9502", id="file 0, by figure 25"),
        # valid requests
        pytest.param("03 0063 0001", "03020000", id="the last register"),
        pytest.param("05 0063 FF00", "050063FF00", id="the last coil"),
    ],
)
def test_function_then_quantity_then_address(pdu: str, answered: str) -> None:
    assert answer(tcp_server(), pdu) == answered


def test_ffff_plus_1_exists_and_ffff_plus_2_does_not() -> None:
    server = tcp_server(Table())
    assert answer(server, "03 FFFF 0001") == "03020000"
    assert answer(server, "03 FFFF 0002") == "8302"


def test_a_truncated_request_on_rtu_ends_in_silence_and_exception_03() -> None:
    server = rtu_server()
    assert server.feed(rtu_frame(1, unhex("03 0000")), 1.0) == []
    assert server.deadline is not None
    (reply,) = server.feed(None, server.deadline)
    assert reply.data == rtu_frame(1, unhex("83 03"))


def test_a_request_with_a_wrong_crc_is_not_answered() -> None:
    server = rtu_server()
    frame = rtu_frame(1, unhex("03 0000 0001"))
    assert server.feed(frame[:-1] + b"\xff", 1.0) == []
    assert server.deadline is not None
    assert server.feed(None, server.deadline) == []
    assert server.statistics.noise_bytes == len(frame)
    assert server.statistics.requests == 0


# Unit addresses --------------------------------------------------------------------------------------------------


def test_a_broadcast_is_carried_out_by_all_and_answered_by_none() -> None:
    one, two = Table(), Table()
    server = rtu_server({1: one, 2: two})
    assert server.feed(rtu_frame(0, unhex("06 0005 1234")), 1.0) == []
    assert (one.holding_registers[5], two.holding_registers[5]) == (0x1234, 0x1234)
    assert (server.statistics.broadcasts, server.statistics.replies) == (1, 0)


def test_a_bad_broadcast_is_not_answered_either() -> None:
    server = rtu_server()
    for pdu in ("41", "03 0000 0000", "06 0064 0000"):
        assert answer(server, pdu, unit=0) is None


def test_a_request_for_another_unit_is_not_answered_on_a_serial_line() -> None:
    server = rtu_server()
    assert server.feed(rtu_frame(2, unhex("06 0005 1234")), 1.0) == []
    assert (server.statistics.for_others, server.statistics.requests) == (1, 0)


@pytest.mark.parametrize("unit", [0, 255])
@pytest.mark.parametrize("address", [0, 255])
def test_on_tcp_unit_0_or_255_answers_for_every_unknown_unit(unit: int, address: int) -> None:
    server = tcp_server(address=address)
    assert answer(server, "03 0000 0001", unit) == "03020000"
    assert answer(server, "03 0000 0001", unit=17) == "03020000"


def test_unit_0_on_tcp_is_not_a_broadcast() -> None:
    server = tcp_server(address=0)
    (reply,) = server.feed(tcp_frame(0, unhex("06 0005 1234"), 9), 1.0)
    assert reply.data == tcp_frame(0, unhex("06 0005 1234"), 9)
    assert server.statistics.broadcasts == 0


def test_a_known_unit_takes_precedence_over_255_and_255_over_0() -> None:
    def unit(value: int) -> Answering:
        return Answering(ReadHoldingRegistersResponse((value,)))

    server = Server(TcpLine(), {0: unit(0), 5: unit(5), 255: unit(255)}, serial=False)
    assert [answer(server, "03 0000 0001", number) for number in (0, 5, 6, 255)] == [
        "03020000",
        "03020005",
        "030200FF",
        "030200FF",
    ]


def test_a_unit_object_that_is_falsy_is_used() -> None:
    class Empty(Answering):
        def __len__(self) -> int:
            return 0

    server = Server(TcpLine(), {255: Empty(ReadHoldingRegistersResponse((7,)))}, serial=False)
    assert answer(server, "03 0000 0001", unit=17) == "03020007"


def test_an_unknown_unit_on_tcp_is_exception_0b() -> None:
    server = tcp_server(address=1)
    assert answer(server, "03 0000 0001", unit=2) == "830B"
    assert server.statistics.for_others == 1


# Segments --------------------------------------------------------------------------------------------------------


def test_several_requests_in_one_segment_are_all_answered_in_their_order() -> None:
    server = tcp_server()
    requests = [tcp_frame(1, unhex("06 0000") + bytes([0, number]), number) for number in range(5)]
    assert [reply.data for reply in server.feed(b"".join(requests), 1.0)] == requests
    assert server.statistics.replies == 5


def test_a_request_in_two_pieces_is_answered_when_it_is_complete() -> None:
    server = tcp_server()
    frame = tcp_frame(1, unhex("03 0000 0001"), 3)
    assert server.feed(frame[:9], 1.0) == []
    (reply,) = server.feed(frame[9:], 2.0)
    assert tcp_decode(reply.data) == Adu(1, unhex("03 02 0000"), 3)


def test_a_reply_on_rtu_is_due_after_the_silence() -> None:
    (reply,) = rtu_server().feed(rtu_frame(1, unhex("03 0000 0001")), 1.0)
    assert reply.at == 1.0 + TIMING.t35


# A unit's own code -----------------------------------------------------------------------------------------------


def test_an_error_of_a_unit_is_exception_04_and_recorded() -> None:
    server = tcp_server(FailingUnit(ValueError("no sensor")))
    assert answer(server, "03 0000 0001") == "8304"
    assert server.statistics.failures == ["ValueError: no sensor"]
    assert server.statistics.exceptions == 1


def test_the_latest_ten_failures_are_kept() -> None:
    unit = FailingUnit(ValueError())
    server = tcp_server(unit)
    for number in range(25):
        unit.error = ValueError(number)
        answer(server, "03 0000 0001")
    assert server.statistics.failures == [f"ValueError: {number}" for number in range(15, 25)]


def test_an_error_whose_text_raises_is_recorded_without_text() -> None:
    class WithoutText(Exception):
        def __str__(self) -> str:
            raise ValueError

    server = tcp_server(FailingUnit(WithoutText()))
    assert answer(server, "03 0000 0001") == "8304"
    assert server.statistics.failures == ["WithoutText: (no text)"]


@pytest.mark.parametrize("code", [1, 2, 3, 4, 5, 6, 8, 10, 11, 99])
def test_a_unit_may_decline_with_any_exception_code(code: int) -> None:
    server = tcp_server(FailingUnit(ModbusException(code)))
    assert answer(server, "03 0000 0001") == f"83{code:02X}"
    assert server.statistics.failures == []


@pytest.mark.parametrize("code", [-1, 256, 1000])
def test_an_exception_code_out_of_range_is_a_failure_of_the_unit(code: int) -> None:
    server = tcp_server(FailingUnit(ModbusException(code)))
    assert answer(server, "03 0000 0001") == "8304"
    assert server.statistics.failures == [f"EncodeError: exception_code = {code}: expected 0..255"]
    assert server.statistics.exceptions == 1


class TooLong(ReportServerIdResponse):
    """A user's response that exceeds the limit of a PDU."""

    def encode(self) -> bytes:
        return bytes(254)


class Text(ReportServerIdResponse):
    """A user's response whose `encode` returns text instead of bytes."""

    def encode(self) -> Any:
        return "1101FF"


NO_RESPONSES: list[Any] = [b"\x03\x02\x00\x00", 7, "\x11\x00", ReportServerId(), TooLong]


@pytest.mark.parametrize("response", [TooLong(b""), Text(b""), *NO_RESPONSES, Delayed(NO_RESPONSES[2], 0.0)])
def test_an_invalid_response_is_a_failure_of_the_unit(response: object) -> None:
    server = tcp_server(Answering(response))
    (reply,) = server.feed(tcp_frame(1, unhex("11")), 1.0)
    assert tcp_decode(reply.data).pdu == unhex("91 04")
    assert len(server.statistics.failures) == 1


def test_a_unit_may_stay_silent() -> None:
    server = tcp_server(Answering(None))
    assert answer(server, "03 0000 0001") is None
    assert (server.statistics.requests, server.statistics.replies) == (1, 0)


# Any input -------------------------------------------------------------------------------------------------------

PDUS = st.one_of(st.binary(min_size=1, max_size=30), st.builds(lambda code, rest: bytes([code]) + rest,
    st.sampled_from([*range(1, 9), 11, 12, *range(15, 25), 43]), st.binary(max_size=12)))  # fmt: skip


@modest
@given(st.lists(PDUS.filter(lambda pdu: pdu[0] < 0x80), max_size=5))
def test_any_request_is_answered_with_its_own_function_code(pdus: list[bytes]) -> None:
    server = tcp_server()
    for number, pdu in enumerate(pdus):
        (reply,) = server.feed(tcp_frame(1, pdu, number), 1.0)
        adu = tcp_decode(reply.data)
        assert (adu.unit, adu.transaction) == (1, number)
        assert adu.pdu[0] in (pdu[0], pdu[0] | 0x80)
        if adu.pdu[0] < 0x80:
            decode_response(adu.pdu)
    assert server.statistics.failures == []


TRAFFIC = st.one_of(
    st.binary(max_size=30),
    st.builds(lambda unit, pdu: rtu_frame(unit, pdu), st.integers(0, 3), PDUS),
    st.builds(lambda unit, pdu: tcp_frame(unit, pdu), st.integers(0, 3), PDUS),
    st.builds(lambda unit, pdu: ascii_frame(unit, pdu), st.integers(0, 3), PDUS),
    st.builds(lambda end: ascii_frame(1, b"\x08\0\x03" + end + b"\0") * 2, st.binary(min_size=1, max_size=1)),
)


@modest
@given(chunked(TRAFFIC, longest_pause=0.1))
def test_feeding_any_bytes_never_raises(chunks: list[Chunk]) -> None:
    lines: list[tuple[Line, bool]] = [
        (RtuLine(TIMING, role="server", units=(1,)), True),
        (RtuLine(TIMING, role="server", patience=None), True),
        (AsciiLine(), True),
        (TcpLine(), False),
    ]
    for line, serial in lines:
        server = Server(line, {1: Table(100), 2: FailingUnit(KeyError("x"))}, serial=serial)
        for data, now in chunks:
            server.feed(data, now)
            assert server.deadline is None or server.deadline >= now or data is None
            assert len(line.held) <= 520


# Limits and permissions ------------------------------------------------------------------------------------------


def test_transactions_beyond_the_limit_are_answered_busy() -> None:
    server = Server(TcpLine(), {1: Table(10)}, serial=False, transactions=2)
    request = unhex("03 0000 0001")
    data = b"".join(tcp_frame(1, request, number) for number in range(4))
    answers = [tcp_decode(reply.data) for reply in server.feed(data, 1.0)]
    assert [adu.pdu.hex() for adu in answers] == ["03020000", "03020000", "8306", "8306"]
    assert [adu.transaction for adu in answers] == [0, 1, 2, 3]
    assert len(server.feed(data[:12], 2.0)) == 1


def test_the_default_limit_is_16_transactions() -> None:
    data = b"".join(tcp_frame(1, unhex("03 0000 0001"), number) for number in range(18))
    answers = [tcp_decode(reply.data).pdu.hex() for reply in tcp_server().feed(data, 1.0)]
    assert answers == ["03020000"] * 16 + ["8306"] * 2


def test_a_request_that_is_not_permitted_is_exception_01() -> None:
    server = Server(TcpLine(), {1: Table(10)}, serial=False, permits=lambda unit, request: not request.writes)
    assert answer(server, "03 0000 0001") == "03020000"
    assert answer(server, "06 0000 0001") == "8601"
    assert answer(server, "06 0000") == "8603", "a request that cannot be decoded is declined before"


def test_an_sdo_abort_is_an_extended_exception_response() -> None:
    server = tcp_server(FailingUnit(SdoAborted(0x06020000)))
    assert answer(server, "2B 0D 00 1F 1005 00 0000 0008") == "ABFF00060DEC06020000"
