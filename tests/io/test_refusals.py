"""The texts of refusals: they name the unit or node, the address, and the parameter, so that a log has it all."""

from __future__ import annotations

import asyncio
import pickle
import traceback
from collections.abc import Callable
from typing import Any

import pytest

import barewire
from barewire.errors import BarewireError, NoAnswer
from barewire.modbus import Functions, ModbusException, ReadHoldingRegisters, Table

TEXT = "unit 7, address 98: exception 02 (illegal data address) to function 03"
CALLS: list[Callable[[Any], Any]] = [
    lambda client: client.read_holding_registers(98, 5),
    lambda client: client.ask(ReadHoldingRegisters(98, 5)),
    lambda client: client.ask(ReadHoldingRegisters(98, 5), retries=2),
    lambda client: client.at(unit=7).ask(ReadHoldingRegisters(98, 5)),
    lambda client: client.run_with_bus(lambda bus: bus.ask(7, ReadHoldingRegisters(98, 5)), unit=7),
]


def check(error: ModbusException, *, has_address: bool = True) -> None:
    assert str(error) == (TEXT if has_address else TEXT.replace(", address 98", ""))
    assert (error.unit, error.code, error.function_code) == (7, 2, 3)
    assert error.address == (98 if has_address else None)
    assert error.args == (2, 3)
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


@pytest.mark.parametrize("number", range(len(CALLS)))
def test_an_exception_response_names_the_unit_and_the_address(number: int) -> None:
    with barewire.ModbusServer("tcp://127.0.0.1:0", {7: Table(100)}) as server:
        with barewire.ModbusClient(server.url, unit=7) as client, pytest.raises(ModbusException) as caught:
            CALLS[number](client)
        check(caught.value, has_address=number < 4)

        async def ask() -> None:
            async with barewire.AsyncModbusClient(server.url, unit=7) as client:
                await CALLS[number](client)

        with pytest.raises(ModbusException) as awaited:
            asyncio.run(ask())
        check(awaited.value, has_address=number < 4)


def test_an_exception_without_a_client_has_its_short_text() -> None:
    assert str(ModbusException(2, 3)) == "exception 02 (illegal data address) to function 03"
    assert (ModbusException(2).unit, ModbusException(2).address) == (None, None)


def in_traceback(error: BaseException) -> str:
    return "".join(traceback.format_exception(error))


def failing(*_: object) -> Any:
    raise ZeroDivisionError


def test_a_value_by_name_is_in_the_text_once() -> None:
    unit = Functions(read_input_registers=failing, write_registers=failing)
    with (
        barewire.ModbusServer("tcp://127.0.0.1:0", {1: unit}) as server,
        barewire.connect("adxl", server.url) as adxl,
    ):
        with pytest.raises(ModbusException) as caught:
            adxl.read("Status")
        parameter = adxl.device.find("Status")
        assert parameter.modbus is not None
        place = f"unit 1, address {parameter.modbus.address}: exception 04 (server device failure)"
        assert str(caught.value) == f"{place} to function 04; while reading Status"
        assert in_traceback(caught.value).count("while reading Status") == 1
        with pytest.raises(ModbusException) as caught:
            adxl.write("Motor start command", 1)
        parameter = adxl.device.find("Motor start command")
        assert parameter.modbus is not None
        assert str(caught.value).startswith(f"unit 1, address {parameter.modbus.address}: exception 04")
        assert str(caught.value).endswith("; while writing Motor start command")


def test_an_abort_names_the_node_and_the_parameter() -> None:
    with barewire.CanopenServer("can://virtual/refusals?node=5", device="az3") as server:
        with barewire.CanopenClient(server.url) as client, pytest.raises(barewire.SdoAbort) as caught:
            client.node(5).sdo.upload(0x2FFF)
        assert str(caught.value) == "node 5, 2FFFh:00: 0602 0000h object does not exist"
        assert caught.value.node == 5
        assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_any_error_of_a_value_by_name_has_the_name_in_its_text() -> None:
    for error in (BarewireError("a"), NoAnswer("a"), barewire.PortError("a")):
        error.add_context("while reading A")
        assert str(error) == "a; while reading A"
        error.add_context("while copying B")
        assert str(error) == "a; while reading A; while copying B"
        assert in_traceback(error).count("while reading A") == 1
    assert str(barewire.EncodeError("a")) == "a"
