"""A place without a name: what no description has, or nobody has described yet.

        holding:100                u16, the type if none is said          TABLE:ADDRESS[:TYPE[:ORDER]]
        input:0x0FB1:u32:ABCD      0FB1h is the same address              holding, input, coil, discrete
        coil:17                    a bit
        holding:40:text8           text in eight registers
        object:6041h:u16           index, always hexadecimal              object:INDEX[.SUB]:TYPE
        object:1018h.1:u32         and sub-index

Addresses are those on the wire, from 0. Without an order a value of several registers lies as those of the device do,
or high word first where there is none. The device `raw` has nothing but such places: whatever answers.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import cast, get_args

from barewire.codecs import codec
from barewire.codecs.order import ORDERS, Order
from barewire.devices.description.load import load
from barewire.devices.device import CanopenSettings, Device, ModbusSettings, fold
from barewire.devices.parameter import ModbusAt, ObjectAt, Parameter, ParameterAccess, TableName
from barewire.errors import EncodeError

RAW = Device("raw", "whatever answers", (), modbus=ModbusSettings(), canopen=CanopenSettings())

TABLES = get_args(TableName)
TYPES = ("u8", "i8", "u16", "i16", "u32", "i32", "u64", "i64", "f32", "f64", "bool")
MOST = 125
"""So many registers travel in one answer."""
FORM = "TABLE:ADDRESS[:TYPE[:ORDER]] with holding, input, coil or discrete, or object:INDEX[.SUB]:TYPE"


def device_with(name: str, wanted: Iterable[str]) -> Device:
    """The device of that name, and in it those of the names that are places. EncodeError for one that is none.

    >>> device = device_with("raw", ["input:0x0FB1:u32", "object:1018h.1:u32"])
    >>> device.find("input:0x0FB1:u32").modbus
    ModbusAt(table='input', address=4017, words=2, half=None, bit=None, order='ABCD')
    >>> device.find("object:1018h.1:u32").object
    ObjectAt(index=4120, sub=1, bit=None)
    """
    device = RAW if name == RAW.name else load(name)
    wide = (p.modbus.order for p in device.parameters if p.modbus is not None and p.modbus.words > 1)
    order = next(wide, ORDERS[0])
    known = {fold(parameter.name) for parameter in device.parameters}
    unknown = [text for text in dict.fromkeys(wanted) if fold(text) not in known]
    places = [raw_parameter(text, order) for text in unknown if is_raw_address(text) or device is RAW]
    return replace(device, parameters=(*device.parameters, *places)) if places else device


def is_raw_address(text: str) -> bool:
    """Whether this is meant as a place: no parameter of a catalogue begins like that."""
    return text.partition(":")[0].strip() in (*TABLES, "object") and ":" in text


def raw_parameter(text: str, order: Order = "ABCD") -> Parameter:
    """The parameter that a place is."""
    table, _, rest = text.strip().partition(":")
    parts = rest.split(":")
    if table == "object" and len(parts) == 2:
        index, dot, sub = parts[0].partition(".")
        at = ObjectAt(_number(text, index, 0xFFFF, base=16), _number(text, sub, 0xFF, base=16) if dot else 0)
        return Parameter(text, _type(text, parts[1]), object=at)
    if table not in TABLES or not (rest and len(parts) <= 3):
        raise EncodeError(f"{text!r} is no place: expected {FORM}")
    address = _number(text, parts[0], 0xFFFF)
    bits = table in ("coil", "discrete")
    kind = parts[1] if len(parts) > 1 else "bool" if bits else "u16"
    if bits and kind != "bool":
        raise EncodeError(f"{text!r}: a {table} is a bool")
    letters = cast(Order, parts[2].upper()) if len(parts) == 3 else order
    if letters not in ORDERS:
        raise EncodeError(f"{text!r}: order {parts[2]!r}: expected one of {', '.join(ORDERS)}")
    string = re.fullmatch(r"text(\d*)", kind)
    if string is not None:
        kind, size = "text", int(string[1][:9] or 0)
        if not 1 <= size <= MOST:
            raise EncodeError(f"{text!r}: type {parts[1]!r}: expected text1..text{MOST}, text in so many registers")
    else:
        size = 1 if _type(text, kind) == "bool" else max(1, codec(kind).size // 2)
    if address + size > 0x10000:
        raise EncodeError(f"{text!r}: there are no {size} registers from address {address} on")
    access: ParameterAccess = "ro" if table in ("input", "discrete") else "rw"
    return Parameter(text, kind, access=access, modbus=ModbusAt(cast(TableName, table), address, size, order=letters))


def _type(text: str, kind: str) -> str:
    if kind not in TYPES:
        raise EncodeError(f"{text!r}: type {kind!r}: expected one of {', '.join(TYPES)}, or textN in registers")
    return kind


def _number(text: str, digits: str, most: int, base: int = 10) -> int:
    """A decimal number, 0x1A or 1Ah; for objects hexadecimal in any case."""
    plain = digits.strip().lower()
    if plain.endswith("h"):
        plain, base = plain[:-1], 16
    elif plain.startswith("0x"):
        plain, base = plain[2:], 16
    try:
        number = int(plain, base) if plain.isalnum() else -1
    except ValueError:
        number = -1
    if not 0 <= number <= most:
        raise EncodeError(f"{text!r}: {digits!r} is no number in 0..{most}: 100, 0x64 or 64h")
    return number
