"""Faults in virtual time: the change of an answer, its frequency, and the result of a client."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

import pytest

from barewire.ascii import frame as ascii_frame
from barewire.canopen import CanFrame
from barewire.conversation import play
from barewire.errors import EncodeError, NoAnswer
from barewire.io.fault_injection.faults import LATE, PAUSE, CanWire, Faults, ModbusWire, parse_faults
from barewire.io.fault_injection.ports import FaultyPort
from barewire.modbus import Bus, ModbusException, ReadHoldingRegisters, Server, Table
from barewire.rtu import RtuLine, Timing, frame as rtu_frame
from barewire.tcp import TcpLine, frame as tcp_frame
from tests.helpers import Peer, refused, serving

ANSWER = rtu_frame.encode(1, bytes.fromhex("03 02 12 34"))
SDO = CanFrame.parse("581#4B41600037060000")
SEED = 5
"""With it the first answer of two is late."""
HEARTBEAT = CanFrame.parse("701#05")


def always(*kinds: str, wire: Any = None) -> Faults[Any]:
    return Faults(wire or ModbusWire("rtu"), dict.fromkeys(kinds, 1.0), Random(1))


# Each fault


def test_without_faults_an_answer_is_unchanged() -> None:
    assert always().pass_on(ANSWER, 5.0) == [(5.0, ANSWER)]


def test_drop_removes_and_late_delays_an_answer() -> None:
    assert always("drop").pass_on(ANSWER, 5.0) == []
    assert always("late").pass_on(ANSWER, 5.0) == [(5.0 + LATE, ANSWER)]


def test_a_late_answer_delays_the_next_on_a_line_and_not_on_tcp() -> None:
    for envelope, second_at in (("rtu", 5.0 + LATE), ("ascii", 5.0 + LATE), ("tcp", 5.1)):
        faults: Faults[bytes] = Faults(ModbusWire(envelope), {"late": 0.5}, Random(SEED))
        (first,), (second,) = faults.pass_on(ANSWER, 5.0), faults.pass_on(ANSWER, 5.1)
        assert (first, second) == ((5.0 + LATE, ANSWER), (second_at, ANSWER))


def test_flip_inverts_one_bit() -> None:
    ((_, spoiled),) = always("flip").pass_on(ANSWER, 0.0)
    difference = int.from_bytes(spoiled, "big") ^ int.from_bytes(ANSWER, "big")
    assert difference.bit_count() == 1


def test_noise_precedes_the_answer_and_split_makes_two_parts() -> None:
    (_, noise), (due, whole) = always("noise").pass_on(ANSWER, 0.0)
    assert 1 <= len(noise) <= 8
    assert (due, whole) == (0.0, ANSWER)
    (first_at, first), (second_at, second) = always("split").pass_on(ANSWER, 0.0)
    assert first + second == ANSWER
    assert second_at - first_at == PAUSE


@pytest.mark.parametrize(
    ("envelope", "frame"),
    [("rtu", rtu_frame), ("ascii", ascii_frame), ("tcp", tcp_frame)],
)
def test_an_exception_and_a_wrong_address_have_correct_check_sums(envelope: str, frame: Any) -> None:
    answer = frame.encode(247, bytes.fromhex("03 02 12 34"))
    ((_, refusal),) = always("exception", wire=ModbusWire(envelope)).pass_on(answer, 0.0)
    assert frame.decode(refusal).pdu == bytes.fromhex("83 06")
    ((_, astray),) = always("wrong-unit", wire=ModbusWire(envelope)).pass_on(answer, 0.0)
    assert frame.decode(astray)[:2] == (1, bytes.fromhex("03 02 12 34"))
    assert always("exception", "wrong-unit", wire=ModbusWire(envelope)).pass_on(b"?", 0.0) == [(0.0, b"?")]


def test_a_changed_tcp_answer_keeps_its_transaction_number() -> None:
    answer = tcp_frame.encode(1, bytes.fromhex("03 02 12 34"), transaction=0x1234)
    ((_, refusal),) = always("exception", wire=ModbusWire("tcp")).pass_on(answer, 0.0)
    assert tcp_frame.decode(refusal).transaction == 0x1234


def test_faults_on_a_can_bus() -> None:
    ((_, abort),) = always("exception", wire=CanWire()).pass_on(SDO, 0.0)
    assert str(abort) == "581#8041600000000008"
    ((_, astray),) = always("wrong-unit", wire=CanWire()).pass_on(SDO, 0.0)
    assert str(astray) == "582#4B41600037060000"
    assert always("exception", "wrong-unit", wire=CanWire()).pass_on(HEARTBEAT, 0.0) == [(0.0, HEARTBEAT)]
    (_, noise_frame), (_, whole) = always("noise", wire=CanWire()).pass_on(SDO, 0.0)
    assert noise_frame.extended
    assert whole == SDO
    with refused(EncodeError, "fault 'flip' is not possible on this wire: expected exception, wrong-unit, noise, late"):
        always("flip", wire=CanWire())


# How often


def strikes(seed: int, **chances: float) -> list[list[tuple[float, bytes]]]:
    faults: Faults[bytes] = Faults(
        ModbusWire("rtu"), {kind.replace("_", "-"): p for kind, p in chances.items()}, Random(seed)
    )
    return [faults.pass_on(ANSWER, 0.0) for _ in range(200)]


def test_the_same_seed_has_the_same_faults() -> None:
    everything = dict.fromkeys((kind.replace("-", "_") for kind in ModbusWire("rtu").kinds), 0.3)
    assert strikes(7, **everything) == strikes(7, **everything) != strikes(8, **everything)


def test_a_fault_hits_the_same_answers_with_and_without_others() -> None:
    alone = [message == [] for message in strikes(7, drop=0.1)]
    assert alone == [message == [] for message in strikes(7, drop=0.1, noise=0.9, flip=0.5)]
    assert 5 < sum(alone) < 40


def test_faults_are_counted_and_reported() -> None:
    reported: list[str] = []
    faults: Faults[bytes] = Faults(ModbusWire("rtu"), {"late": 1.0, "split": 1.0}, Random(), on_fault=reported.append)
    faults.pass_on(ANSWER, 0.0)
    assert reported == ["split", "late"]
    assert dict(faults.counts) == {"split": 1, "late": 1}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "latte",
            "fault 'latte': expected some of drop, exception, flip, late, noise, paced, split, wrong-transaction",
        ),
        ("late:2", "fault 'late:2': expected a probability, 0..1, after the colon"),
        ("late:often", "fault 'late:often': expected a probability"),
        ("", "fault '': expected some of"),
    ],
)
def test_an_unknown_fault_or_wrong_probability_is_an_error(text: str, message: str) -> None:
    with refused(EncodeError, message):
        parse_faults(text)


# The result of a client


def spoiled(peer: Peer, faults: Faults[bytes]) -> Peer:
    def answers(item: bytes, now: float) -> list[tuple[float, bytes]]:
        return [late for due, data in peer(item, now) for late in faults.pass_on(data, due)]

    return answers


def read_with_faults(*kinds: str, line: Callable[[], Any] = TcpLine, wire: str = "tcp") -> tuple[int, ...]:
    timing = Timing.of(19200)
    serial = wire == "rtu"
    server = Server(RtuLine(timing, role="server") if serial else TcpLine(), {1: Table()}, serial=serial)
    peer = spoiled(serving(server), always(*kinds, wire=ModbusWire(wire)))
    bus = Bus(RtuLine(timing) if serial else line())
    return play(bus.ask(1, ReadHoldingRegisters(0, 2), timeout=1.0), peer)[0].registers


@pytest.mark.parametrize("wire", ["rtu", "tcp"])
def test_a_client_reads_a_split_answer_and_rejects_the_others(wire: str) -> None:
    assert read_with_faults("split", wire=wire) == (0, 0)
    for kind in ("late", "drop", "wrong-unit"):
        with pytest.raises(NoAnswer):
            read_with_faults(kind, wire=wire)
    with pytest.raises(ModbusException, match="06"):
        read_with_faults("exception", wire=wire)


@pytest.mark.parametrize("kind", ["noise", "flip"])
def test_on_a_serial_line_noise_and_a_flipped_bit_are_detected(kind: str) -> None:
    """A frame behind noise is not taken: it may be the data of a damaged one."""
    with pytest.raises(NoAnswer, match="received instead"):
        read_with_faults(kind, wire="rtu")


# The port


class Clocked:
    """A port with a clock. It records items with their times, and receives nothing."""

    def __init__(self) -> None:
        self.now = 0.0
        self.sent: list[tuple[float, bytes]] = []

    def send(self, item: bytes) -> None:
        self.sent.append((self.now, item))

    def receive(self, timeout: float) -> bytes | None:
        self.now += timeout
        return None

    def close(self) -> None:
        self.now = -1.0


def test_a_late_answer_is_sent_while_the_port_receives() -> None:
    behind = Clocked()
    port: FaultyPort[bytes] = FaultyPort(behind, always("late", "split"), clock=lambda: behind.now)
    port.send(ANSWER)
    assert behind.sent == []
    assert port.receive(1.0) is None
    assert behind.sent == []
    assert port.receive(1.0) is None
    assert [due for due, _ in behind.sent] == [LATE, LATE + PAUSE]
    assert behind.now == 2.0
    port.close()
    assert behind.now == -1.0
