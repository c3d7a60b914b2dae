"""Faults in virtual time: the change of an answer, which answers are hit, their text, and the result of a client."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

import pytest

from barewire.ascii import frame as ascii_frame
from barewire.canopen import CanFrame
from barewire.conversation import play
from barewire.errors import EncodeError, NoAnswer
from barewire.io.fault_injection.faults import (
    LATE,
    PAUSE,
    CanWire,
    Fault,
    Faults,
    ModbusWire,
    faults_on_can,
    parse_faults,
)
from barewire.io.fault_injection.ports import FaultyPort
from barewire.modbus import (
    Adu,
    Bus,
    MaskWriteRegister,
    ModbusException,
    ReadCoils,
    ReadDeviceIdentification,
    ReadDiscreteInputs,
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
from barewire.rtu import RtuLine, Timing, frame as rtu_frame
from barewire.tcp import TcpLine, frame as tcp_frame
from tests.helpers import Peer, every_case, refused, serving

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


def test_faults_are_replaced_from_the_next_answer_on_and_wrong_ones_change_nothing() -> None:
    faults = always("drop")
    assert faults.pass_on(ANSWER, 5.0) == []
    faults.replace("late=2@every=2")
    assert [faults.pass_on(ANSWER, now)[0][0] for now in (6.0, 7.0)] == [6.0, 9.0]
    with pytest.raises(EncodeError, match="is not possible on this wire"):
        faults.replace("wrong-transaction")
    assert [fault.kind for fault in faults.present] == ["late"]
    faults.replace(())
    assert faults.pass_on(ANSWER, 20.0) == [(20.0, ANSWER)]
    assert faults.counts == {"drop": 1, "late": 1}


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


def faults(given: Any, framing: str = "rtu") -> Faults[bytes]:
    return Faults(ModbusWire(framing), given, Random(1))


def hit(given: Any, request: AnyRequest) -> bool:
    """Whether the answer to this request is dropped."""
    return faults(given).pass_on(ANSWER, 0.0, request.encode()) == []


# By address


@pytest.mark.parametrize(
    ("text", "hits", "misses"),
    [
        ("drop@20", [ReadHoldingRegisters(20, 1), ReadHoldingRegisters(11, 10)], [ReadHoldingRegisters(21, 5)]),
        ("drop@20", [ReadCoils(13, 8), ReadInputRegisters(20, 1)], [ReadCoils(12, 8), ReadDeviceIdentification(1)]),
        ("drop@0x14", [WriteSingleRegister(20, 1)], [WriteSingleRegister(14, 20)]),
        ("drop@20-22", [WriteSingleCoil(22, True)], [WriteSingleCoil(23, True), WriteSingleCoil(19, True)]),
        ("drop@holding:20", [ReadHoldingRegisters(20, 1)], [ReadInputRegisters(20, 1), ReadCoils(20, 1)]),
        ("drop@input:20", [ReadInputRegisters(20, 1)], [ReadHoldingRegisters(20, 1)]),
        ("drop@coil:20", [ReadCoils(20, 1), WriteMultipleCoils(19, (1, 1))], [ReadDiscreteInputs(20, 1)]),
        ("drop@discrete:20", [ReadDiscreteInputs(20, 1)], [WriteSingleCoil(20, True)]),
        ("drop@20", [WriteMultipleRegisters(18, (0, 0, 0))], [WriteMultipleRegisters(17, (0, 0, 0))]),
        ("drop@20", [MaskWriteRegister(20, 0, 0), ReadFifoQueue(20)], [MaskWriteRegister(0, 20, 20), ReadFifoQueue(2)]),
        ("drop@20", [ReadWriteMultipleRegisters(19, 2, 0, (1,))], [ReadWriteMultipleRegisters(0, 20, 21, (20,))]),
        ("drop@20", [ReadWriteMultipleRegisters(0, 1, 20, (1,))], []),
    ],
)
def test_a_fault_hits_requests_that_touch_its_address(
    text: str, hits: list[AnyRequest], misses: list[AnyRequest]
) -> None:
    for request in hits:
        assert hit(text, request), request
    for request in misses:
        assert not hit(text, request), request
    assert faults(text).pass_on(ANSWER, 0.0) == [(0.0, ANSWER)], "an answer whose request is unknown"


def test_an_exception_has_the_code_given() -> None:
    """A code is hexadecimal, as everywhere in barewire."""
    found = faults("exception=04@20,exception=0x0B@30,exception@40,exception=0B@50,exception=10@1Fh,exception=10h@0x60")
    codes = {}
    for address in (20, 30, 40, 50, 0x1F, 0x60):
        ((_, answer),) = found.pass_on(ANSWER, 0.0, ReadHoldingRegisters(address, 1).encode())
        codes[address] = rtu_frame.decode(answer).pdu
    assert codes == {
        20: b"\x83\x04",
        30: b"\x83\x0b",
        40: b"\x83\x06",
        50: b"\x83\x0b",
        0x1F: b"\x83\x10",
        0x60: b"\x83\x10",
    }


def test_a_probability_and_a_selection_must_both_hit() -> None:
    found = faults("drop:0.5@every=2")
    hits = [not found.pass_on(ANSWER, 0.0) for _ in range(400)]
    assert not any(hits[0::2])
    assert 60 < sum(hits[1::2]) < 140


# By number


def hits_of(given: Any, *requests: AnyRequest) -> list[int]:
    """Return the numbers, from 1 on, of the answers that are dropped."""
    found = faults(given)
    return [
        number for number, request in enumerate(requests, start=1) if not found.pass_on(ANSWER, 0.0, request.encode())
    ]


def test_every_third_answer_and_the_fifth_only() -> None:
    reads = [ReadHoldingRegisters(0, 1)] * 12
    assert hits_of("drop@every=3", *reads) == [3, 6, 9, 12]
    assert hits_of("drop@nth=5", *reads) == [5]
    assert hits_of("drop@nth=5,drop@every=6", *reads) == [5, 6, 12]


def test_only_the_answers_that_fit_the_address_are_counted() -> None:
    one, other = ReadHoldingRegisters(0, 1), ReadHoldingRegisters(20, 1)
    assert hits_of("drop@20@every=2", one, other, one, one, other, other, other) == [5, 7]
    assert hits_of("drop@nth=2@20", one, other, one, one, other, other, other) == [5]


def test_selected_answers_may_be_hit_by_dice() -> None:
    number = len(hits_of("drop:0.5@20", *[ReadHoldingRegisters(20, 1)] * 200))
    assert 60 < number < 140
    assert hits_of("drop:0@20", ReadHoldingRegisters(20, 1)) == []


# The new kinds


def test_a_paced_answer_comes_byte_by_byte() -> None:
    sent = faults("paced=0.25@20").pass_on(ANSWER, 5.0, ReadHoldingRegisters(20, 1).encode())
    assert sent == [(5.0 + 0.25 * place, ANSWER[place : place + 1]) for place in range(len(ANSWER))]
    found = faults("paced:1,split:1")
    first = found.pass_on(ANSWER, 0.0)
    assert [data for _, data in first] == [bytes([byte]) for byte in ANSWER]
    assert first[1][0] == 0.005
    assert found.pass_on(ANSWER, 0.0)[0][0] == pytest.approx(0.005 * (len(ANSWER) - 1)), "no answer overtakes another"


def test_a_wrong_transaction_number_is_the_next_one() -> None:
    for number, wrong in ((7, 8), (0xFFFF, 0)):
        answer = tcp_frame.encode(1, bytes.fromhex("03 02 12 34"), number)
        ((_, sent),) = faults("wrong-transaction:1", "tcp").pass_on(answer, 0.0)
        assert tcp_frame.decode(sent) == Adu(1, bytes.fromhex("03 02 12 34"), wrong)


def test_a_late_answer_has_its_own_delay() -> None:
    ((at, _),) = faults("late=0.4@20").pass_on(ANSWER, 1.0, ReadHoldingRegisters(20, 1).encode())
    assert at == 1.4


def test_a_client_on_a_line_reads_a_paced_answer_within_the_pauses_of_its_line() -> None:
    timing = Timing.of(9600)
    server = Server(RtuLine(timing, role="server"), {1: Table(holding_registers=[7])}, serial=True)
    slow = faults(f"paced={timing.t15 / 2}:1")

    def line(item: bytes, now: float) -> list[tuple[float, bytes]]:
        return [sent for reply in server.feed(item, now) for sent in slow.pass_on(reply.data, reply.at, reply.request)]

    assert play(Bus(RtuLine(timing)).ask(1, ReadHoldingRegisters(0, 1), timeout=1.0), line)[0].registers == (7,)


def test_the_server_passes_the_request_to_the_faults() -> None:
    server = Server(TcpLine(), {1: Table()}, serial=False)
    chosen = faults("exception=04@20", "tcp")

    def wire(item: bytes, now: float) -> list[tuple[float, bytes]]:
        return [sent for reply in server.feed(item, now) for sent in chosen.pass_on(reply.data, now, reply.request)]

    bus = Bus(TcpLine())
    assert play(bus.ask(1, ReadHoldingRegisters(19, 1), timeout=1.0), wire)[0].registers == (0,)
    with pytest.raises(ModbusException, match="04"):
        play(bus.ask(1, ReadHoldingRegisters(19, 2), timeout=1.0), wire)


def test_an_ascii_answer_is_paced_by_characters() -> None:
    answer = ascii_frame.encode(1, bytes.fromhex("03 02 12 34"))
    assert b"".join(part for _, part in faults("paced:1", "ascii").pass_on(answer, 0.0)) == answer


# The text


def test_a_text_becomes_faults() -> None:
    assert parse_faults("late=2:0.5, drop@every=3,exception=04@holding:20-29@nth=2") == (
        Fault("late", 0.5, value=2.0),
        Fault("drop", every=3),
        Fault("exception", value=4, table="holding", addresses=range(20, 30), nth=2),
    )
    assert hit([Fault("drop", addresses=range(20, 21))], ReadCoils(20, 1))
    assert hit({"drop": 1}, ReadCoils(20, 1))


@every_case(
    ("text", "message"),
    [
        ("drp", "fault 'drp': expected some of drop, exception, flip,"),
        ("drp", "; did you mean 'drop'?"),
        ("drp@20", "; did you mean 'drop'?"),
        ("wrong_unit", "; did you mean 'wrong-unit'"),
        ("drop=3", "fault 'drop': 3.0: only exception, late and paced have a value"),
        ("exception=0", "fault 'exception': 0: expected an exception code, 1..255"),
        ("exception=100", "fault 'exception': 256: expected an exception code, 1..255"),
        (
            "exception=busy",
            "fault 'exception=busy': expected an exception code in hexadecimal, 01..FF, such as exception=0B",
        ),
        ("late=soon", "fault 'late=soon': expected a number after the equals sign, such as drop:0.5,"),
        ("late=-1", "fault 'late': -1.0: expected seconds, from 0 on and below 3600"),
        ("paced=nan", "fault 'paced': nan: expected seconds"),
        ("drop:2@20", "fault 'drop:2@20': expected a probability, 0..1, after the colon"),
        ("drop@", "fault 'drop@': '': expected an address, such as 20, 20-29, 14h or holding:20, every=N or nth=N"),
        ("drop@70000", "fault 'drop': addresses range(70000, 70001): expected a range of addresses in 0..65535"),
        ("drop@29-20", "fault 'drop': addresses range(29, 21): expected a range of addresses"),
        (
            "drop@holdng:20",
            "'holdng': expected coil, discrete, holding, input before the address; did you mean 'holding'?",
        ),
        ("drop@evry=2", "'evry': expected every=N or nth=N after the at sign; did you mean 'every'?"),
        ("drop@every=0", "fault 'drop': every = 0: expected a whole number, from 1 on"),
        ("drop@every=x", "'every=x': expected a whole number, such as every=3"),
        ("drop@20@30", "fault 'drop@20@30': '30' is one selection too many, expected such as drop:0.5,"),
        ("drop@every=2@nth=3", "'nth=3' is one selection too many"),
        ("drop@nth=2@every=3", "'every=3' is one selection too many"),
    ],
)
def test_a_wrong_text_is_refused(text: str, message: str) -> None:
    with refused(EncodeError, message):
        parse_faults(text)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (5, "faults 5: expected a text such as 'late:0.5,drop', or a dict"),
        ([1], "faults [1]: expected a text such as"),
        ({"drop": 2}, "fault 'drop': 2: expected a probability, 0..1"),
        ("wrong-transaction", "fault 'wrong-transaction' is not possible on this wire: expected"),
    ],
)
def test_wrong_faults_are_refused(given: Any, message: str) -> None:
    with refused(EncodeError, message):
        faults(given)


def test_a_can_bus_has_numbers_and_no_addresses() -> None:
    found = faults_on_can("drop@every=2")
    assert [found.pass_on(SDO, 0.0) for _ in range(4)] == [[(0.0, SDO)], []] * 2
    with refused(EncodeError, "fault 'drop': an address selects requests of Modbus, not of CAN"):
        Faults(CanWire(), "drop@20", Random(1))
    with refused(EncodeError, "CAN has SDO aborts and no exception codes"):
        Faults(CanWire(), "exception=4", Random(1))
    with refused(EncodeError, "fault 'paced' is not possible on this wire"):
        Faults(CanWire(), "paced", Random(1))
