"""A recorded unit answers as it did, also to random traffic that was recorded, kept as text and replayed."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

from barewire.errors import EncodeError
from barewire.modbus import (
    Delayed,
    MaskWriteRegister,
    ModbusException,
    ReadCoils,
    ReadDeviceIdentification,
    ReadExceptionStatus,
    ReadFifoQueue,
    ReadHoldingRegisters,
    ReadInputRegisters,
    ReadWriteMultipleRegisters,
    Server,
    Table,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)
from barewire.modbus.messages.registry import AnyRequest
from barewire.rtu import encode
from barewire.tcp import TcpLine, decode as tcp_decode, encode as tcp_frame
from barewire_workbench.recordings.modbus_replay import replay
from barewire_workbench.replay.recorded import from_toml, learn_line, to_toml
from barewire_workbench.replay.unit_replay import ReplayedUnit, recorded_units
from barewire_workbench.sniffer import RequestSeen, ResponseMissing, ResponseSeen
from tests.helpers import every_case, refused


def unit(requests: str, **options: Any) -> ReplayedUnit:
    (found,) = from_toml(f"[[unit]]\naddress = 7\n{requests}", "x.toml").units.values()
    return ReplayedUnit(found, **options)


def answer(replayed: ReplayedUnit, request: AnyRequest) -> Any:
    """Return the values of a read, the exception code, None for silence, and True for a write."""
    try:
        found = replayed.handle(request, 0.0)
    except ModbusException as declined:
        return declined.code
    if found is None:
        return None
    assert isinstance(found, Delayed)
    response: Any = found.response
    if isinstance(response, ModbusException):
        return response.code
    return getattr(response, "registers", None) or getattr(response, "bits", None) or True


READ = ReadHoldingRegisters(0, 2)
POLLED = """
[[unit.request]]
read = "holding:0"
quantity = 2
answers = [
  { at = 0.0, until = 2.0, times = 3, latency = 0.01, values = [0, 9] },
  { at = 3.0, latency = 0.3, exception = 6 },
  { at = 4.0, silent = true },
  { at = 5.0, until = 6.0, times = 2, latency = 0.02, values = [1, 9] },
]
"""


def test_a_recorded_read_has_its_answers_in_order_and_then_the_last_again() -> None:
    replayed = unit(POLLED)
    everything = [(0, 9), (0, 9), (0, 9), 6, None, (1, 9), (1, 9), (1, 9), (1, 9)]
    assert [answer(replayed, READ) for _ in everything] == everything
    replayed.rewind()
    assert answer(replayed, READ) == (0, 9)


def test_answers_have_their_latencies_or_none() -> None:
    for options, expected in (({}, [0.01, 0.01, 0.01, 0.3]), ({"latencies": False}, [0.0] * 4)):
        replayed = unit(POLLED, **options)
        found = [replayed.handle(READ, 0.0) for _ in expected]
        assert [one.seconds for one in found if isinstance(one, Delayed)] == expected


def test_a_part_of_a_recorded_read_is_the_part_of_its_next_answer() -> None:
    replayed = unit(POLLED)
    second = ReadHoldingRegisters(1, 1)
    assert [answer(replayed, second) for _ in range(6)] == [(9,), (9,), (9,), 6, None, (9,)]
    assert answer(replayed, ReadHoldingRegisters(0, 1)) == (1,)


TWO = """
[[unit.request]]
read = "holding:0"
quantity = 2
answers = [{ values = [1, 2] }, { values = [3, 4] }]
[[unit.request]]
read = "holding:2"
quantity = 1
answers = [{ latency = 0.5, values = [5] }]
[[unit.request]]
read = "coil:0"
quantity = 3
answers = [{ values = [1, 0, 1] }]
"""


def test_a_read_over_several_recorded_ones_has_the_present_values() -> None:
    replayed = unit(TWO)
    whole = ReadHoldingRegisters(0, 3)
    assert answer(replayed, whole) == (1, 2, 5)
    assert [answer(replayed, READ) for _ in range(2)] == [(1, 2), (3, 4)]
    assert answer(replayed, whole) == (3, 4, 5)
    assert answer(replayed, ReadCoils(0, 3)) == (True, False, True)


def test_what_was_never_seen_is_exception_02_or_01() -> None:
    replayed = unit(TWO)
    for request in (
        ReadHoldingRegisters(2, 2),
        ReadHoldingRegisters(3, 1),
        ReadInputRegisters(0, 1),
        WriteSingleRegister(3, 1),
        WriteMultipleRegisters(2, (1, 1)),
        WriteMultipleCoils(2, (1, 1)),
    ):
        assert answer(replayed, request) == 2
    assert answer(replayed, ReadExceptionStatus()) == 1


def test_a_write_that_was_not_recorded_is_stored() -> None:
    replayed = unit(TWO)
    assert answer(replayed, WriteSingleRegister(1, 77)) is True
    assert answer(replayed, WriteSingleCoil(1, True)) is True
    assert [answer(replayed, READ) for _ in range(2)] == [(1, 77), (3, 77)]
    assert answer(replayed, ReadCoils(1, 1)) == (True,)


PUMP = """
[[unit.request]]
read = "holding:0"
quantity = 1
answers = [
  { at = 0.0, until = 9.0, times = 10, values = [0] },
  { at = 10.5, until = 19.5, times = 10, values = [1] },
  { at = 20.5, values = [0] },
]
[[unit.request]]
write = "holding:5"
function = 6
answers = [{ at = 10.0, wrote = [1] }, { at = 20.0, wrote = [0] }]
"""
STATE = ReadHoldingRegisters(0, 1)


def test_reads_go_on_behind_a_recorded_write() -> None:
    replayed = unit(PUMP)
    assert answer(replayed, STATE) == (0,)
    assert answer(replayed, WriteSingleRegister(5, 1)) is True
    assert [answer(replayed, STATE) for _ in range(3)] == [(1,)] * 3
    assert answer(replayed, WriteSingleRegister(5, 0)) is True
    assert answer(replayed, STATE) == (0,)
    assert answer(replayed, WriteSingleRegister(5, 1)) is True, "a second time, after the end of the recording"
    assert answer(replayed, STATE) == (1,)


def test_a_write_does_not_go_back_while_it_comes_in_order() -> None:
    replayed = unit(PUMP)
    assert [answer(replayed, STATE) for _ in range(25)][-1] == (0,), "the client is faster than it was"
    answer(replayed, WriteSingleRegister(5, 1))
    assert answer(replayed, STATE) == (0,)


def test_a_write_within_a_row_of_equal_answers_keeps_the_rest_of_the_row() -> None:
    replayed = unit(PUMP.replace("at = 10.0, wrote", "at = 4.5, wrote"))
    answer(replayed, WriteSingleRegister(5, 1))
    assert [answer(replayed, STATE) for _ in range(6)] == [(0,)] * 5 + [(1,)]


WATCHDOG = """
[[unit.request]]
read = "holding:0"
quantity = 1
answers = [{ at = 0.0, values = [1] }, { at = 1.0, values = [2] }, { at = 2.0, values = [3] }]
[[unit.request]]
write = "holding:9"
function = 6
answers = [{ at = 0.5, until = 1.5, times = 2, wrote = [1] }]
"""
"""A unit that counts up when register 9 is written, twice in the recording."""


def test_the_last_writes_of_a_recording_may_go_on() -> None:
    replayed = unit(WATCHDOG)
    values = []
    for _ in range(5):
        answer(replayed, WriteSingleRegister(9, 1))
        values.append(answer(replayed, STATE)[0])
    assert values == [2, 3, 3, 3, 3]


def test_a_row_of_equal_writes_is_taken_one_by_one() -> None:
    replayed = unit(WATCHDOG.replace("wrote = [1] }", "wrote = [1] }, { at = 5.0, wrote = [0] }"))
    values = []
    for _ in range(2):
        answer(replayed, WriteSingleRegister(9, 1))
        values.append(answer(replayed, STATE)[0])
    assert values == [2, 3]


def test_a_recorded_write_ends_what_another_one_changed() -> None:
    replayed = unit(PUMP + '[[unit.request]]\nread = "holding:5"\nquantity = 1\nanswers = [{ values = [4] }]\n')
    asked = ReadHoldingRegisters(5, 1)
    answer(replayed, WriteSingleRegister(5, 9))
    assert answer(replayed, asked) == (9,)
    answer(replayed, WriteSingleRegister(5, 1))
    assert answer(replayed, asked) == (4,), "as it was recorded"


REFUSED = """
[[unit.request]]
write = "holding:5"
function = 6
answers = [{ wrote = [1], latency = 0.2, exception = 2 }, { wrote = [2], silent = true }]
[[unit.request]]
write = "coil:5"
function = 5
answers = [{ wrote = [1], exception = 4 }]
[[unit.request]]
pdu = "07"
answers = [{ pdu = "07 6D" }, { exception = 1 }]
"""


def test_recorded_writes_are_refused_as_they_were() -> None:
    replayed = unit(REFUSED)
    assert answer(replayed, WriteSingleRegister(5, 1)) == 2
    assert answer(replayed, WriteSingleRegister(5, 2)) is None
    assert answer(replayed, WriteSingleRegister(5, 3)) is True, "another value was not refused"
    assert answer(replayed, WriteSingleCoil(5, False)) == 4, "every recorded write was refused"


def test_other_functions_are_repeated_byte_by_byte() -> None:
    replayed = unit(REFUSED)
    found = replayed.handle(ReadExceptionStatus(), 0.0)
    assert isinstance(found, Delayed)
    assert found.response.encode() == b"\x07\x6d"  # type: ignore[union-attr]
    assert answer(replayed, ReadExceptionStatus()) == 1


def test_units_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "pump.toml"
    file.write_text(f"[[unit]]\naddress = 7\n{POLLED}\n[[unit]]\naddress = 9\n", encoding="utf-8")
    units = recorded_units(file)
    assert list(units) == [7, 9]
    assert answer(units[7], READ) == (0, 9)
    with refused(EncodeError, "No such file or directory"):
        recorded_units(tmp_path / "other.toml")
    file.write_bytes(b"\xff")
    with refused(EncodeError, "pump.toml: 'utf-8' codec"):
        recorded_units(file)


UNITS = (1, 7)


def random_request(random: Random) -> AnyRequest:
    address = random.randrange(40)
    words = [random.randrange(65536) for _ in range(random.randrange(1, 5))]
    bits = [random.random() < 0.5 for _ in range(random.randrange(1, 15))]
    return random.choice(
        (
            ReadHoldingRegisters(address, random.randrange(1, 20)),
            ReadCoils(address, random.randrange(1, 20)),
            WriteSingleRegister(address, words[0]),
            WriteSingleCoil(3, bits[0]),
            WriteMultipleRegisters(address, words),
            WriteMultipleCoils(address, bits),
            MaskWriteRegister(address, 1, 2),
            ReadWriteMultipleRegisters(0, 2, 0, words),
            ReadFifoQueue(2),
            ReadDeviceIdentification(1),
        )
    )


def random_log(random: Random) -> bytes:
    """Return a log of two units that answer, now and then late, wrongly, with a damaged frame or not at all."""
    tables = {unit: Table(size) for unit, size in zip(UNITS, (50, 20), strict=True)}
    rows, now = [], 0.0
    for _ in range(60):
        unit, request = random.choice(UNITS), random_request(random)
        now += random.uniform(0.05, 1.5)
        rows.append((now, encode(unit, request.encode())))
        if random.random() < 0.1:
            continue
        try:
            response = tables[unit].handle(request, now)
            assert response is not None
            pdu = response.encode()
        except ModbusException as declined:
            pdu = bytes([request.function_code | 0x80, declined.code])
        now += random.uniform(0.001, 0.8 if random.random() < 0.1 else 0.02)
        frame = bytearray(encode(unit, pdu))
        frame[2] ^= 4 if random.random() < 0.05 else 0
        rows.append((now, bytes(frame)))
    return "".join(f"{at:.6f} {data.hex(' ')}\n" for at, data in rows).encode()


@every_case("seed", range(20))
def test_the_same_requests_get_the_same_answers(seed: int) -> None:
    events = list(replay(random_log(Random(seed))))
    line = from_toml(to_toml(learn_line(events), "a log"), "a log")
    server = Server(
        TcpLine(), {address: ReplayedUnit(unit, latencies=False) for address, unit in line.units.items()}, serial=False
    )
    answers: dict[int, bytes | None] = {}  # by the identity of the request
    for event in events:
        if isinstance(event, ResponseSeen) and event.request is not None:
            answers[id(event.request)] = event.pdu
        elif isinstance(event, ResponseMissing):
            answers.setdefault(id(event.request), None)
    compared = 0
    for event in events:
        if isinstance(event, RequestSeen) and id(event) in answers:
            replies = server.feed(tcp_frame(event.unit, event.pdu, 1), 0.0)
            assert (tcp_decode(replies[0].data).pdu if replies else None) == answers[id(event)], event.message
            compared += 1
    assert compared > 30
    assert not server.statistics.failures
