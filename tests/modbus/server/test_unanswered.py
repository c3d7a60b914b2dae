"""Frames on a serial line that a server must not answer: stale requests and exceptions."""

from __future__ import annotations

import pytest

from barewire.ascii import AsciiLine
from barewire.modbus import Server, Table
from barewire.rtu import encode as rtu_frame
from tests.helpers import unhex
from tests.modbus.server.test_server import answer, rtu_server, tcp_server

# Stale requests --------------------------------------------------------------------------------------------------

READ_0, WRITE_7 = rtu_frame(1, unhex("03 0000 0001")), rtu_frame(1, unhex("06 0000 0007"))
READ_OTHER, BROADCAST_9 = rtu_frame(2, unhex("03 0000 0001")), rtu_frame(0, unhex("06 0000 0009"))


def replies_to(server: Server, data: bytes, now: float = 1.0) -> list[bytes]:
    """Return the replies to these bytes in one read and to the silence after them."""
    replies = server.feed(data, now)
    while server.deadline is not None:
        replies += server.feed(None, server.deadline)
    return [reply.data for reply in replies]


def test_of_several_requests_in_one_read_only_the_latest_is_answered() -> None:
    server = rtu_server()
    assert replies_to(server, READ_0 + READ_0 + READ_0) == [rtu_frame(1, unhex("03 02 0000"))]
    assert (server.statistics.stale, server.statistics.replies, server.statistics.requests) == (2, 1, 1)


def test_a_stale_write_is_carried_out_without_response() -> None:
    server = rtu_server()
    assert replies_to(server, WRITE_7 + READ_0) == [rtu_frame(1, unhex("03 02 0007"))]
    assert server.statistics.stale == 1


def test_stale_writes_are_carried_out_in_order() -> None:
    table = Table(10)
    server = rtu_server({1: table})
    assert replies_to(server, WRITE_7 + BROADCAST_9 + READ_0) == [rtu_frame(1, unhex("03 02 0009"))]
    assert replies_to(server, BROADCAST_9 + WRITE_7, now=2.0) == [WRITE_7]
    assert table.holding_registers[0] == 7


@pytest.mark.parametrize("behind", [READ_OTHER, BROADCAST_9, b"\x55" * 4, READ_0[:5]])
def test_a_request_followed_by_other_traffic_is_not_answered(behind: bytes) -> None:
    server = rtu_server()
    assert replies_to(server, READ_0 + behind) == []
    assert server.statistics.stale == 1


@pytest.mark.parametrize("behind", [b"\x00", b"\xff\xff", b"\x00\x00\x00"])
def test_a_glitch_after_a_request_only_delays_its_response(behind: bytes) -> None:
    server = rtu_server()
    assert server.feed(READ_0 + behind, 1.0) == []
    assert server.deadline is not None
    (reply,) = server.feed(None, server.deadline)
    assert reply.data == rtu_frame(1, unhex("03 02 0000"))
    assert server.statistics.stale == 0


def test_a_glitch_that_grows_into_a_frame_makes_the_request_stale() -> None:
    server = rtu_server()
    assert server.feed(READ_0 + READ_OTHER[:2], 1.0) == []
    assert replies_to(server, READ_OTHER[2:], 1.005) == []
    assert server.statistics.stale == 1


def test_an_ascii_line_does_not_wait_a_second_for_a_glitch() -> None:
    server = Server(AsciiLine(), {1: Table(10)}, serial=True)
    (reply,) = server.feed(b":010300000001FB\r\n\xff", 1.0)
    assert reply.data == b":0103020000FA\r\n"
    assert server.feed(b":010300000001FB\r\n:0203", 2.0) == []


# Frames that are not requests ------------------------------------------------------------------------------------


@pytest.mark.parametrize("pdu", ["83 02", "80", "FF 01"])
def test_a_function_with_bit_7_is_not_a_request(pdu: str) -> None:
    for server in (rtu_server(), tcp_server()):
        assert answer(server, pdu) is None
        assert (server.statistics.not_requests, server.statistics.requests, server.statistics.exceptions) == (1, 0, 0)
