"""Every request that the four manuals print, sent to the simulators: the answer has the shape that the manual shows."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.ascii import AsciiLine
from barewire.devices.sim import MachineUnits, Simulator, simulator
from barewire.modbus import Server
from barewire.modbus.messages import registers
from barewire.rtu import RtuLine, Timing, crc16
from tests.devices.sim.bench import Bench


def rtu_answer(machine: Simulator, request: str) -> str:
    """Return the answer in hexadecimal, without its CRC."""
    line = RtuLine(Timing.of(19200), role="server", units={machine.address})
    return b"".join(_sent(Server(line, MachineUnits(machine), serial=True), bytes.fromhex(request)))[:-2].hex(" ")


def _sent(server: Any, request: bytes) -> list[bytes]:
    return [reply.data for reply in server.feed(request, 0.0)]


# The request as printed, and the beginning and the length of the answer as printed. The values in it are the machine's.
ADXL_RTU = [
    ("01 04 0F B1 00 02 22 F8", "01 04 04", 7),  # the temperature of the thyristors
    ("01 04 00 0F 00 08 C1 CF", "01 04 10", 19),  # 10h to 17h; 10h to 13h are in no row of table 2
    ("01 06 4F FF 00 01 6E EE", "01 06 4f ff 00 01", 6),
    ("01 06 50 01 00 04 C8 C9", "01 06 50 01 00 04", 6),
    ("01 07 41 E2", "01 07", 3),
    ("01 11 C0 2C", "01 11 08 01 02 00 00 05 00 00 00", 11),
]


@pytest.mark.parametrize(("request_hex", "begins", "length"), ADXL_RTU, ids=[row[0][:17] for row in ADXL_RTU])
def test_requests_of_the_adxl_manual(request_hex: str, begins: str, length: int) -> None:
    answer = rtu_answer(simulator("adxl"), request_hex)
    assert answer.startswith(begins)
    assert len(bytes.fromhex(answer)) == length


def test_the_ascii_request_of_the_adxl_manual() -> None:
    (answer,) = _sent(Server(AsciiLine(), MachineUnits(simulator("adxl")), serial=True), b":01040FB1000239\r\n")
    assert answer.startswith(b":010404")
    assert len(answer) == len(b":010404000000FFF8\r\n")


def test_gaps_in_the_tables_of_the_adxl() -> None:
    """Registers between two measures read 0; a request with no measure in it, or beyond a table, gets exception 02."""
    bench = Bench(simulator("adxl"))
    assert bench.words(0x000F, 8, "input") == (0,) * 8
    assert bench.words(0x0005, 10, "input") == (*bench.words(0x0005, 8, "input"), 0, 0)  # E and F are in no row
    for request in (registers.ReadInputRegisters, registers.ReadHoldingRegisters):
        assert bench.refused(request(0x000F, 8)) == 0
        assert bench.refused(request(0x000F, 4)) == 2  # 10h to 13h alone
        assert bench.refused(request(0x0004, 2)) == 2  # before the first measure
        assert bench.refused(request(0x0079, 3)) == 2  # behind the last of this table
        assert bench.refused(request(0x0F7F, 6)) == 0
        assert bench.refused(request(0x2040, 1)) == 2
    assert bench.refused(registers.ReadInputRegisters(0x5000, 4)) == 2  # settings: 5003h is no register
    assert bench.refused(registers.WriteSingleRegister(0x000F, 0)) == 2


AZ3_RTU = [
    ("0C 03 00 0F 00 03 34 D5", "0c 03 06", 9),
    ("0C 0F 00 00 00 0A 02 72 02", "0c 0f 00 00 00 0a", 6),  # the bits as the standard packs them, see the guide 6.2.1
]


@pytest.mark.parametrize(("request_hex", "begins", "length"), AZ3_RTU, ids=[row[0][:17] for row in AZ3_RTU])
def test_requests_of_the_modbus_guide_of_the_az3(request_hex: str, begins: str, length: int) -> None:
    frame = bytes.fromhex(request_hex)
    if crc16(frame):
        frame += crc16(frame).to_bytes(2, "little")  # the guide prints "crch crcl"
    answer = rtu_answer(simulator("az3", unit=12), frame.hex())
    assert answer.startswith(begins)
    assert len(bytes.fromhex(answer)) == length


def test_requests_of_the_canopen_guide_of_the_az3() -> None:
    bench = Bench(simulator("az3", node=15))
    assert bench.frames() == ["70F#00"]
    # 4.3.1: read and write CONTROL WORD; it is a 16-bit word, and the guide prints 32-bit commands and answers
    assert bench.frames("60F#4340600000000000") == ["58F#4340600000000000"]
    for command in ("23", "2B"):
        assert bench.frames(f"60F#{command}4060000F000000") == ["58F#6040600000000000"]
    assert bench.frames("60F#4040600000000000") == ["58F#4B4060000F000000"]
    # 4.2.1: each of the five states by node and by broadcast; a reset is answered with the boot-up message of 4.4
    for node in ("0F", "00"):
        for command, answer in (("01", []), ("02", []), ("80", []), ("81", ["70F#00"]), ("82", ["70F#00"])):
            assert bench.frames(f"000#{command}{node}") == answer
    # 4: the bit rate, 2068h UNS16
    assert bench.frames("60F#2B68200007000000") == ["58F#6068200000000000"]
    assert bench.frames("60F#4068200000000000") == ["58F#4B68200007000000"]


CSD_MT_TABLES = {
    15: ((1042, 240_000), (1044, 100_000), (1046, 80_000), (1072, 80_000)),
    16: ((1048, 140_000), (1046, 80_000)),
    17: ((1058, 0), (1050, 19), (1052, 40_000), (1054, 3200), (1056, 100_000)),
}


@pytest.mark.parametrize("table", CSD_MT_TABLES)
def test_setting_examples_of_the_csd_mt_manual(table: int) -> None:
    """Both ways of chapter 10: function 06 for each word, the low one first, and function 10h for both."""
    bench = Bench(simulator("csd-mt"))
    for address, value in CSD_MT_TABLES[table]:
        words = (value,) if address == 1050 else (value & 0xFFFF, value >> 16)
        for offset, word in enumerate(words):
            bench.ask(registers.WriteSingleRegister(address + offset, word))
        assert bench.words(address, len(words)) == words
        bench.ask(registers.WriteMultipleRegisters(address, words))
        assert bench.words(address, len(words)) == words


def test_the_control_word_sequence_of_the_csd_mt_manual() -> None:
    bench = Bench(simulator("csd-mt"), now=10.0)
    bench.write("Mode of Operation", 1)
    for word, shown in ((0x0006, (0x0231, 0x1231)), (0x0007, (0x0233, 0x1233)), (0x000F, (0x0637, 0x1637, 0x1237))):
        bench.ask(registers.WriteSingleRegister(1040, word))
        bench.now += 1.0
        assert bench.words(1001)[0] in shown
