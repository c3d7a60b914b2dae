"""Addresses in place of names: their forms, their errors, reading and writing them."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest

from barewire.codecs import Value
from barewire.conversation import play
from barewire.devices import ModbusAt, ObjectAt, Parameter, UnknownName, read_modbus, write_modbus
from barewire.errors import EncodeError
from barewire.modbus import Bus, Server, Table
from barewire.tcp import TcpLine
from barewire_workbench.cli.raw_address import RAW, device_with, expanded, raw_parameter, wire_address
from barewire_workbench.cli.value_text import parse_value
from tests.helpers import every_case, refused, serving


@pytest.mark.parametrize(
    ("text", "type", "at"),
    [
        ("holding:100", "u16", ModbusAt("holding", 100)),
        ("input:0x0FB1:u32", "u32", ModbusAt("input", 0x0FB1, 2)),
        ("input:0FB1h:f32:cdab", "f32", ModbusAt("input", 0x0FB1, 2, order="CDAB")),
        ("holding:7:f64", "f64", ModbusAt("holding", 7, 4)),
        ("holding:7:u8", "u8", ModbusAt("holding", 7)),
        ("holding:7:bool", "bool", ModbusAt("holding", 7)),
        ("holding:40:text8", "text", ModbusAt("holding", 40, 8)),
        ("coil:17", "bool", ModbusAt("coil", 17)),
        ("discrete:65535:bool", "bool", ModbusAt("discrete", 65535)),
    ],
)
def test_addresses_on_modbus(text: str, type: str, at: ModbusAt) -> None:
    found = raw_parameter(text)
    assert (found.name, found.type, found.modbus) == (text, type, at)
    assert found.writable is (at.table in ("holding", "coil"))


def test_objects_are_hexadecimal_in_any_form() -> None:
    for text in ("object:6041h:u16", "object:0x6041:u16", "object:6041:u16"):
        assert raw_parameter(text).object == ObjectAt(0x6041)
    assert raw_parameter("object:1018h.10h:u32").object == ObjectAt(0x1018, 0x10)


@every_case(
    ("text", "message"),
    [
        ("holding", "'holding' is not an address: expected TABLE:ADDRESS"),
        ("holding:", "'holding:' is not an address"),
        ("holding::u16", "'' is not a number in 0..65535"),
        ("holding:-1", "'-1' is not a number"),
        ("holding:65536", "'65536' is not a number in 0..65535"),
        ("holding:65535:u32", "there are no 2 registers from address 65535 on"),
        ("holding:1:u17", "type 'u17': expected one of bool, u8, u16"),
        ("holding:1:u32:ACDB", "order 'ACDB': expected one of ABCD, CDAB, BADC, DCBA"),
        ("holding:1:u16:ABCD:x", "is not an address"),
        ("holding:1:text0", "type 'text0': expected text1..text125, text in that number of registers"),
        ("holding:1:text300", "type 'text300': expected text1..text125"),
        ("holding:1:text", "type 'text': expected text1..text125"),
        ("holding:1:text9999999999", "expected text1..text125"),
        ("holding:65535:text2", "there are no 2 registers from address 65535 on"),
        ("coil:1:u16", "a coil is a bool"),
        ("object:6041h", "its type is missing: expected object:INDEX[.SUB]:TYPE"),
        ("object:", "is not an address"),
        ("object:6041h:u16:ABCD", "is not an address"),
        ("object:10000h:u8", "'10000h' is not a number in 0..65535"),
        ("object:6041h.100:u8", "'100' is not a number in 0..255"),
        ("Status Word", "is not an address"),
    ],
)
def test_wrong_addresses(text: str, message: str) -> None:
    with refused(EncodeError, message):
        device_with("raw", [text])


def test_a_negative_address_is_no_range() -> None:
    with refused(EncodeError, "'-5' is not a number in 0..65535"):
        device_with("raw", expanded(["holding:-5"]))
    with refused(EncodeError, "'-5' is not a number in 0..65535"):
        expanded(["holding:-5-3"])


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("coil:5", "0", False),
        ("coil:5", "1", True),
        ("coil:5", "on", True),
        ("holding:5:bool", "0x1", True),
        ("holding:5", "64h", 100),
        ("holding:5", "0FB1h", 0x0FB1),
        ("holding:5", "FFFFh", 0xFFFF),
        ("holding:5", "-0x10", -16),
        ("holding:5", "-10h", -16),
        ("holding:5", "1", 1),
    ],
)
def test_values_as_users_type_them(name: str, text: str, value: Value) -> None:
    found = parse_value(raw_parameter(name), text)
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize("text", ["profile velocity", " Profile Velocity ", "3"])
def test_the_name_of_a_value_is_its_number(text: str) -> None:
    assert parse_value(device_with("az3").find("MODES OF OPERATION"), text) == 3


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("coil:5", "yes", "expected on or off"),
        ("holding:5:f32", "1e400", "expected a number"),
        ("holding:5", "each", "expected a number"),
        ("holding:5", "h", "a number"),
    ],
)
def test_text_that_is_no_value(name: str, text: str, message: str) -> None:
    with refused(EncodeError, message):
        parse_value(raw_parameter(name), text)


def test_an_address_beside_names_of_a_device_has_its_word_order() -> None:
    az3 = device_with("az3", ["STATUS WORD", "holding:84:u32", "holding:84:u32"])
    found, row = az3.find("holding:84:u32").modbus, az3.find("MAX MOTOR SPEED").modbus
    assert found is not None
    assert row is not None
    assert found.order == row.order == "CDAB"
    assert device_with("az3", ["STATUS WORD"]) is device_with("az3", [])
    assert RAW.parameters == ()
    with pytest.raises(UnknownName):
        device_with("az3", ["Statos"]).find("Statos")


def test_what_is_written_is_read() -> None:
    names = ["holding:10:f32", "coil:3", "holding:20:text3", "input:5:i16"]
    device = device_with("raw", names)
    bus, server = Bus(TcpLine()), serving(Server(TcpLine(), {1: Table()}, serial=False))
    values: dict[str, Value] = {names[0]: -1.5, names[1]: True, names[2]: "AZ3"}
    play(write_modbus(bus, 1, device, values), server)
    readings, _ = play(read_modbus(bus, 1, device, names), server)
    assert [reading.value for reading in readings] == [-1.5, True, "AZ3", 0]
    with refused(EncodeError, "input:5:i16 is read only"):
        write_modbus(bus, 1, device, {"input:5:i16": 1})


@every_case(
    ("text", "address"),
    [
        ("40001", "holding:0"),
        ("400001", "holding:0"),
        ("4x0001", "holding:0"),
        ("4X1", "holding:0"),
        ("465536", "holding:65535"),
        ("30002:u32:CDAB", "input:1:u32:CDAB"),
        ("10001-10003", "discrete:0-2"),
        ("0x0001", "coil:0"),
        ("00001", "coil:0"),
        ("HR:5", "holding:5"),
        ("ir:0x10:f32", "input:0x10:f32"),
        ("co:1", "coil:1"),
        ("di:1", "discrete:1"),
        # what is none of these is left as it is
        ("40000", "40000"),
        ("465537", "465537"),
        ("40001-30002", "40001-30002"),
        ("4001", "4001"),
        ("20001", "20001"),
        ("Status", "Status"),
        ("holding:40001", "holding:40001"),
    ],
)
def test_numbers_as_manuals_print_them(text: str, address: str) -> None:
    assert wire_address(text) == address


def test_the_name_of_a_parameter_is_no_number_of_a_manual() -> None:
    device = replace(RAW, parameters=(replace(raw_parameter("holding:100"), name="40001"),))
    assert expanded(["40001", "40002"], device) == ("40001", "holding:1")
    place = device_with(device, expanded(["40001"], device)).find("40001").modbus
    assert place is not None
    assert place.address == 100
    assert wire_address("4\N{ARABIC-INDIC DIGIT ONE}001") != "holding:1000"


def test_addresses_beside_names_have_the_same_order() -> None:
    machine = device_with("csd-mt?order=ABCD", ["holding:100:f32"])
    place = machine.find("holding:100:f32").modbus
    assert place is not None
    assert place.order == "ABCD"


@pytest.mark.parametrize("scale", [Fraction(1), Fraction(1, 10)])
def test_digits_that_a_float_would_round_off_are_refused(scale: Fraction) -> None:
    energy = Parameter("Energy", "i64", scale=scale)
    for text in ("500000000000000000.5", "1.00000000000000000001", "1e-400"):
        with refused(EncodeError, f"Energy = '{text}': a float cannot hold these digits"):
            parse_value(energy, text)
    whole = {"5e17": 5 * 10**17, "9007199254740993.0": 9007199254740993, "3.0": 3}
    assert {text: parse_value(energy, text) for text in whole} == whole
    assert parse_value(Parameter("Energy", "f64"), "1.00000000000000000001") == 1.0
