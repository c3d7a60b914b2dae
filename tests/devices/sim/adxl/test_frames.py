"""The soft starter byte for byte: the example of its manual in the three envelopes, and the procedure for events."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.ascii import AsciiLine, frame as ascii_frame
from barewire.devices.sim import MachineUnits, simulator
from barewire.devices.sim.adxl import REBOOT_TAKES
from barewire.modbus.adu import Adu
from barewire.modbus.messages.registers import (
    ReadInputRegisters,
)
from barewire.modbus.server.server import Server
from barewire.rtu import RtuLine, Timing, decode, encode
from barewire.tcp import TcpLine, frame as tcp_frame
from tests.devices.sim.adxl.adxl_bench import starter
from tests.devices.sim.bench import Bench


@pytest.fixture
def bench() -> Bench:
    return Bench(simulator("adxl"))


# The example of the manual: set P01.04 to 10 s, steps 1 to 4. The answers to 1, 2 and 3 are echoes.
STEPS = [
    ("01 06 4F FF 00 01 6E EE", True),
    ("01 06 50 01 00 04 C8 C9", True),
    ("01 06 50 03 00 0A E8 CD", True),
    ("01 06 2F 02 00 05 E0 DD", False),
]


def test_the_parameter_setting_example_byte_for_byte(bench: Bench) -> None:
    assert bench.machine.modbus is not None
    server = Server(RtuLine(Timing.of(9600, bits=10), role="server", units={1}), {1: bench.machine.modbus}, serial=True)
    starter(bench).menus.values[1, 0, 4] = 30
    for second, (frame, answered) in enumerate(STEPS):
        replies = server.feed(bytes.fromhex(frame), float(second))
        assert [reply.data.hex(" ").upper() for reply in replies] == ([frame] if answered else [])
    assert starter(bench).menus.saved[1, 0, 4] == 10
    # Rebooting: exception 06, then everything as saved.
    request = encode(1, ReadInputRegisters(0x0FB1, 2).encode())
    (busy,) = server.feed(request, 4.0)
    assert decode(busy.data) == Adu(1, bytes.fromhex("8406"))
    (answer,) = server.feed(request, 3.0 + REBOOT_TAKES)
    assert decode(answer.data) == Adu(1, bytes.fromhex("0404000000F5"))
    assert answer.data.hex(" ").upper() == "01 04 04 00 00 00 F5 3B C3"  # the manual prints this CRC


ENVELOPES: dict[str, tuple[Any, Any, bool]] = {
    "ascii": (AsciiLine, lambda pdu: ascii_frame.encode(1, pdu), True),
    "tcp": (TcpLine, lambda pdu: tcp_frame.encode(1, pdu, 0x2A), False),
}


@pytest.mark.parametrize("envelope", ENVELOPES)
def test_the_same_example_in_the_other_envelopes(bench: Bench, envelope: str) -> None:
    line, frame, serial = ENVELOPES[envelope]
    server = Server(line(), MachineUnits(bench.machine), serial=serial)
    requests = [bytes.fromhex(rtu)[1:-2] for rtu, _ in STEPS]
    replies = [
        b"".join(reply.data for reply in server.feed(frame(pdu), float(second))) for second, pdu in enumerate(requests)
    ]
    assert replies == [*map(frame, requests[:3]), b""]
    assert (
        replies[0]
        == {
            "ascii": b":01064FFF0001AA\r\n",
            "tcp": bytes.fromhex("002A 0000 0006 01 06 4FFF 0001"),
        }[envelope]
    )
    assert starter(bench).menus.saved[1, 0, 4] == 10


def test_the_procedure_for_reading_events_byte_for_byte(bench: Bench) -> None:
    """Table 4, steps 1 to 4, in the frames of RTU."""
    server = Server(
        RtuLine(Timing.of(9600, bits=10), role="server", units={1}), MachineUnits(bench.machine), serial=True
    )
    now = [1.0]

    def answer_to(pdu: str) -> str:
        now[0] += 1.0
        (reply,) = server.feed(encode(1, bytes.fromhex(pdu)), now[0])
        return decode(reply.data).pdu.hex(" ").upper()

    answer_to("06 10 01 00 01")  # start the motor: a second event
    assert answer_to("04 50 2F 00 01") == "04 02 02 02"  # 1: two are stored (MSB), the second was the last (LSB)
    assert answer_to("06 50 2F 00 00") == "06 50 2F 00 00"  # 2: the first one, number 0
    first, second = answer_to("04 50 31 00 1C"), answer_to("04 50 31 00 1C")  # 3, and 4: the next by the same step
    texts = [bytes.fromhex(answer)[2:].rstrip(b"\0 ").decode() for answer in (first, second)]
    assert texts == ["00000000 POWER ON", "00000000 MOTOR START COMMAND"]
    assert [len(bytes.fromhex(answer)) for answer in (first, second)] == [2 + 56] * 2
    assert answer_to("04 50 31 00 1C") == "84 04"  # nothing is left
    assert answer_to("06 50 2F 00 01") == "06 50 2F 00 01"  # 4: or any other event, by step 2
    assert answer_to("04 50 31 00 1C") == second
