"""Units that get each request as its bytes, before the server judges it, and that may answer later."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from barewire.modbus import Authorization, Caller, LaterResponse, ModbusException, PduUnit, Reply, Server
from barewire.modbus.messages.base import Request
from barewire.rtu import RtuLine, Timing, encode as rtu_frame
from barewire.tcp import TcpLine, encode as tcp_frame

READ = bytes.fromhex("03 00 00 00 01")
UNKNOWN = bytes.fromhex("41 01 02")
TRUNCATED = bytes.fromhex("03 00 00")


class Recorded:
    """A unit that keeps the requests it gets, and answers with what `answer` returns or raises."""

    def __init__(self, answer: Callable[[bytes], Any]) -> None:
        self.answer = answer
        self.requests: list[bytes] = []
        self.callers: list[Caller] = []

    def handle_pdu(self, pdu: bytes, caller: Caller) -> Any:
        self.requests.append(pdu)
        self.callers.append(caller)
        return self.answer(pdu)


def tcp_server(unit: PduUnit, **options: Any) -> Server:
    return Server(TcpLine(), {1: unit}, serial=False, **options)


def answers_to(server: Server, *pdus: bytes) -> list[str]:
    """The PDUs of the replies to these requests, which arrive together with transaction numbers from 1 on."""
    data = b"".join(tcp_frame(1, pdu, number) for number, pdu in enumerate(pdus, 1))
    return [reply.data[7:].hex(" ") for reply in server.feed(data, 0.0)]


@pytest.mark.parametrize("pdu", [READ, UNKNOWN, TRUNCATED, bytes.fromhex("2b 99"), bytes.fromhex("08 00 00 12 34")])
def test_a_unit_gets_every_request_as_its_bytes(pdu: bytes) -> None:
    unit = Recorded(lambda pdu: pdu[:1] + b"\x07")
    caller = Caller("10.0.0.7:1234")
    assert answers_to(tcp_server(unit, caller=caller), pdu) == [f"{pdu[0]:02x} 07"]
    assert unit.requests == [pdu]
    assert unit.callers == [caller]


def decline(pdu: bytes) -> bytes:
    raise ModbusException(2)


def decline_in_full(pdu: bytes) -> bytes:
    declined = ModbusException(0xFF)
    declined.pdu = bytes.fromhex("ab ff 00 06 0d ec 06 02 00 00")
    raise declined


def fail(pdu: bytes) -> bytes:
    raise ZeroDivisionError


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (lambda pdu: None, []),
        (decline, ["83 02"]),
        (decline_in_full, ["ab ff 00 06 0d ec 06 02 00 00"]),
        (fail, ["83 04"]),
        (lambda pdu: b"", ["83 04"]),
        (lambda pdu: "text", ["83 04"]),
        (lambda pdu: bytes(254), ["83 04"]),
        (lambda pdu: LaterResponse(), ["83 04"]),  # nobody who could send it
    ],
)
def test_what_a_unit_returns_or_raises(answer: Callable[[bytes], Any], expected: list[str]) -> None:
    server = tcp_server(Recorded(answer))
    assert answers_to(server, READ) == expected
    is_failure = expected == ["83 04"]
    assert bool(server.statistics.failures) is is_failure
    assert server.statistics.exceptions == len(expected)


def test_responses_come_later_in_any_order() -> None:
    sent: list[Reply] = []
    later = [LaterResponse(), LaterResponse(), LaterResponse()]
    waiting = iter(later)
    server = tcp_server(Recorded(lambda pdu: next(waiting)), send_later=lambda reply, caller: sent.append(reply))
    assert answers_to(server, READ, READ, READ) == []
    later[2].give(b"\x03\x02\x00\x03")
    later[0].give(ModbusException(0x0B))
    later[1].give(None)
    later[1].give(b"\x03\x02\x00\x02")
    assert [reply.data.hex(" ") for reply in sent] == [
        "00 03 00 00 00 05 01 03 02 00 03",
        "00 01 00 00 00 03 01 83 0b",
    ]
    assert server.statistics.replies == 2


def test_a_response_may_be_given_before_handle_pdu_returns() -> None:
    def answer(pdu: bytes) -> LaterResponse:
        later = LaterResponse()
        later.give(b"\x03\x02\x00\x07")
        return later

    sent: list[Reply] = []
    assert answers_to(tcp_server(Recorded(answer), send_later=lambda reply, _: sent.append(reply)), READ) == []
    assert [reply.data.hex(" ") for reply in sent] == ["00 01 00 00 00 05 01 03 02 00 07"]


def test_a_connection_has_as_many_open_requests_as_it_may_have_transactions() -> None:
    sent: list[Reply] = []
    later: list[LaterResponse] = []

    def answer(pdu: bytes) -> LaterResponse:
        later.append(LaterResponse())
        return later[-1]

    unit = Recorded(answer)
    server = tcp_server(unit, transactions=2, send_later=lambda reply, caller: sent.append(reply))
    assert answers_to(server, READ, READ, READ) == ["83 06"]
    assert answers_to(server, READ) == ["83 06"]
    later[0].give(b"\x03\x02\x00\x00")
    assert answers_to(server, READ) == []
    later[1].give(None)  # a place is free again, though nothing was sent
    assert answers_to(server, READ) == []
    assert len(unit.requests) == 4


def test_a_client_that_left_gets_no_response() -> None:
    sent: list[Reply] = []
    later, caller = LaterResponse(), Caller("10.0.0.7:1")
    server = tcp_server(Recorded(lambda pdu: later), caller=caller, send_later=lambda reply, _: sent.append(reply))
    assert answers_to(server, READ) == []
    caller.is_gone = True
    later.give(b"\x03\x02\x00\x00")
    assert not sent


def test_roles_hold_for_unknown_functions_too() -> None:
    table = Authorization.parse('{"Some": [{"functions": [3, 65]}], "Few": [{"functions": [3], "addresses": "0-9"}]}')
    refused: list[Any] = []

    def permits(role: str) -> Callable[[int, Request[Any]], bool]:
        return lambda number, request: table.allows(role, number, request)

    unit = Recorded(lambda pdu: pdu)
    for role, expected in (("Some", ["03 00 00 00 01", "41 01 02", "84"]), ("Few", ["03 00 00 00 01", "c1 01"])):
        server = tcp_server(unit, permits=permits(role), on_refusal=lambda *refusal: refused.append(refusal))
        assert answers_to(server, READ, UNKNOWN) == expected[:2]
    assert refused[0][1].function_code == 0x41
    assert unit.requests == [READ, UNKNOWN, READ]


TIMING = Timing.of(19200)


def test_a_later_response_on_a_serial_line_waits_for_silence_and_is_dropped_after_another_request() -> None:
    sent: list[Reply] = []
    later: list[LaterResponse] = []

    def answer(pdu: bytes) -> LaterResponse:
        later.append(LaterResponse())
        return later[-1]

    line = RtuLine(TIMING, role="server", units=(1,))
    server = Server(line, {1: Recorded(answer)}, serial=True, send_later=lambda reply, _: sent.append(reply))
    assert server.feed(rtu_frame(1, READ), 1.0) == []
    later[0].give(b"\x03\x02\x00\x07")
    assert [reply.data for reply in sent] == [rtu_frame(1, b"\x03\x02\x00\x07")]
    assert sent[0].at == pytest.approx(1.0 + TIMING.t35, abs=1e-6)
    server.feed(rtu_frame(1, READ), 2.0)
    server.feed(rtu_frame(1, READ), 3.0)
    later[1].give(b"\x03\x02\x00\x08")
    assert len(sent) == 1
    later[2].give(b"\x03\x02\x00\x09")
    assert len(sent) == 2


def test_a_unit_0_gets_a_broadcast_in_place_of_all() -> None:
    units = {number: Recorded(lambda pdu: None) for number in (0, 1, 2)}
    server = Server(RtuLine(TIMING, role="server", units=(1, 2)), dict(units), serial=True)
    server.feed(rtu_frame(0, bytes.fromhex("06 00 01 00 02")), 1.0)
    assert [len(unit.requests) for unit in units.values()] == [1, 0, 0]


def test_a_broadcast_reaches_every_unit_and_nothing_is_sent() -> None:
    sent: list[Reply] = []
    units = {number: Recorded(lambda pdu: LaterResponse()) for number in (1, 2)}
    line = RtuLine(TIMING, role="server", units=(1, 2))
    server = Server(line, dict(units), serial=True, send_later=lambda reply, _: sent.append(reply))
    assert server.feed(rtu_frame(0, bytes.fromhex("06 00 01 00 02")), 1.0) == []
    assert [unit.requests for unit in units.values()] == [[bytes.fromhex("06 00 01 00 02")]] * 2
    assert not sent
