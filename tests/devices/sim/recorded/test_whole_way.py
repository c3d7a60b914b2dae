"""Random traffic, recorded, as text and replayed: the same requests in the same order get the same answers."""

from __future__ import annotations

from random import Random

import pytest

from barewire.devices.sim.recorded import from_toml, learn_line, to_toml
from barewire.devices.sim.replay import ReplayedUnit
from barewire.modbus import (
    MaskWriteRegister,
    ModbusException,
    ReadCoils,
    ReadDeviceIdentification,
    ReadFifoQueue,
    ReadHoldingRegisters,
    ReadWriteMultipleRegisters,
    Server,
    Table,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)
from barewire.modbus.messages.registry import AnyRequest
from barewire.modbus.sniffer import RequestSeen, ResponseMissing, ResponseSeen
from barewire.rtu import encode
from barewire.tcp import TcpLine, decode as tcp_decode, encode as tcp_frame
from barewire_workbench.recordings.modbus_replay import replay

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


@pytest.mark.parametrize("seed", range(20))
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
