"""`Functions`: plain functions as a unit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from barewire.errors import EncodeError
from barewire.modbus import Adu, Functions, Identity, ModbusException, ReadHoldingRegisters, Response, Server
from barewire.tcp import TcpLine
from tests.helpers import every_case, refused, unhex


def answered(unit: Functions, pdu: str) -> str:
    """Return the response of a server with this unit, as hex."""
    found = Server(TcpLine(), {1: unit}, serial=False).answer(Adu(1, unhex(pdu)), 1.0)
    assert found is not None
    return found.hex().upper()


class Plant:
    """Values that are not in a table, and functions that access them."""

    def __init__(self) -> None:
        self.words = dict(enumerate(range(100, 110)))
        self.bits = dict.fromkeys(range(10), False)
        self.files = {(1, record): record for record in range(10)}

    def read(self, address: int, quantity: int) -> list[int]:
        if address + quantity > 10:
            raise ModbusException(2)
        return [self.words[place] for place in range(address, address + quantity)]

    def write(self, address: int, values: Sequence[int]) -> None:
        self.words.update(enumerate(values, start=address))

    def read_bits(self, address: int, quantity: int) -> list[bool]:
        return [self.bits[place] for place in range(address, address + quantity)]

    def write_bits(self, address: int, values: Sequence[bool]) -> None:
        self.bits.update(enumerate(values, start=address))

    def read_file(self, file: int, record: int, length: int) -> list[int]:
        return [self.files[file, number] for number in range(record, record + length)]

    def write_file(self, file: int, record: int, registers: Sequence[int]) -> None:
        self.files.update(((file, number), value) for number, value in enumerate(registers, start=record))

    def unit(self) -> Functions:
        return Functions(
            read_coils=self.read_bits,
            read_discrete_inputs=lambda address, quantity: [True] * quantity,
            write_coils=self.write_bits,
            read_holding_registers=self.read,
            read_input_registers=lambda address, quantity: range(quantity),
            write_registers=self.write,
            read_file=self.read_file,
            write_file=self.write_file,
            read_queue=lambda address: [address, 2],
            read_exception_status=lambda: 0x6D,
            report_server_id=lambda: b"\x01\xff",
            identity=Identity({0: "A", 1: "B", 2: "C"}),
        )


@every_case(
    ("pdu", "answer"),
    [
        ("01 0000 0003", "010100"),
        ("02 0000 0003", "020107"),
        ("03 0001 0002", "030400650066"),
        ("03 0009 0002", "8302"),
        ("04 0001 0002", "040400000001"),
        ("05 0001 FF00", "050001FF00"),
        ("06 0001 0007", "0600010007"),
        ("07", "076D"),
        ("0F 0000 0003 01 05", "0F00000003"),
        ("10 0000 0002 04 0001 0002", "1000000002"),
        ("11", "110201FF"),
        ("14 07 06 0001 0002 0002", "1406050600020003"),
        ("15 09 06 0001 0000 0001 1234", "15090600010000" + "00011234"),
        ("16 0000 00F0 0005", "16000000F00005"),
        ("17 0000 0002 0000 0001 02 0007", "170400070065"),
        ("18 0001", "180006000200010002"),
        ("2B 0E 01 00", "2B0E0181000003000141010142020143"),
        ("08 0000 A537", "8801"),
    ],
)
def test_each_function_is_called_and_its_result_sent(pdu: str, answer: str) -> None:
    assert answered(Plant().unit(), pdu) == answer


def test_write_functions_receive_the_values() -> None:
    plant = Plant()
    unit = plant.unit()
    for pdu in ("05 0001 FF00", "0F 0004 0003 01 05", "06 0001 0007", "10 0004 0002 04 0008 0009", "16 0000 00F0 0005"):
        answered(unit, pdu)
    answered(unit, "15 09 06 0001 0000 0001 1234")
    assert [place for place, on in plant.bits.items() if on] == [1, 4, 6]
    assert [plant.words[place] for place in (0, 1, 4, 5)] == [100 & 0xF0 | 5, 7, 8, 9]
    assert plant.files[1, 0] == 0x1234


@every_case(
    "pdu",
    [
        *("01 0000 0001", "02 0000 0001", "03 0000 0001", "04 0000 0001", "05 0000 FF00", "06 0000 0001", "07", "11"),
        *("0F 0000 0001 01 01", "10 0000 0001 02 0001", "14 07 06 0001 0000 0001", "15 09 06 0001 0000 0001 0000"),
        *("16 0000 0000 0000", "17 0000 0001 0000 0001 02 0001", "18 0000", "2B 0E 01 00", "2B 0D 00 01 1000 00"),
        *("03", "17", "2B 0E"),
    ],
)
def test_a_function_that_is_not_given_is_exception_01_even_for_malformed_requests(pdu: str) -> None:
    assert answered(Functions(), pdu)[2:] == "01"


@pytest.mark.parametrize(
    ("result", "failure"),
    [
        ([1], "EncodeError: a function returned 1 values where 2 were asked"),
        ([1, 2, 3], "EncodeError: a function returned 3 values where 2 were asked"),
        ([1, 0x10000], "EncodeError: register 1 of 2: 65536 is not a whole number in 0..65535"),
        ([1, "x"], "EncodeError: register 1 of 2: 'x' is not a whole number in 0..65535"),
        (None, "TypeError: object of type 'NoneType' has no len()"),
    ],
)
def test_an_invalid_result_is_exception_04_and_recorded(result: Any, failure: str) -> None:
    unit = Functions(read_holding_registers=lambda address, quantity: result)
    server = Server(TcpLine(), {1: unit}, serial=False)
    assert server.answer(Adu(1, unhex("03 0000 0002")), 1.0) == unhex("83 04")
    (kept,) = server.statistics.failures
    assert kept.startswith(failure)


def test_a_queue_that_is_too_long_is_exception_04() -> None:
    assert answered(Functions(read_queue=lambda address: [0] * 32), "18 0000") == "9804"


def test_a_mask_needs_both_a_read_and_a_write() -> None:
    assert answered(Functions(read_holding_registers=lambda address, quantity: [0]), "16 0000 0000 0000") == "9601"


def test_own_functions_take_precedence() -> None:
    from barewire.modbus import ReadExceptionStatus, ReadExceptionStatusResponse

    def own(request: ReadExceptionStatus) -> Response | None:
        return ReadExceptionStatusResponse(1)

    unit = Functions(read_exception_status=lambda: 2, own={ReadExceptionStatus: own})
    assert answered(unit, "07") == "0701"


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"read_input_registers": [1]}, "Functions: read_input_registers = [1]: expected a function"),
        ({"write_coils": 5}, "Functions: write_coils = 5: expected a function"),
        ({"own": {ReadHoldingRegisters: None}}, "Functions: own[ReadHoldingRegisters] = None: expected a function"),
        ({"own": [ReadHoldingRegisters]}, "expected request classes and functions"),
        ({"identity": "ACME"}, "Functions: identity = 'ACME': expected an Identity"),
    ],
)
def test_functions_refuse_what_cannot_be_called(wrong: dict[str, Any], text: str) -> None:
    with refused(EncodeError, text):
        Functions(**wrong)
