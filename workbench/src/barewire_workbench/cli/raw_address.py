"""Parameters given by their address instead of a name, for values that no description has.

        holding:100                u16, the type if none is given         TABLE:ADDRESS[:TYPE[:ORDER]]
        input:0x0FB1:u32:ABCD      0FB1h is the same address              holding, input, coil, discrete
        coil:17                    a bit
        holding:0-9:u32            the five values in registers 0 to 9, for reading: `expanded`
        holding:40:text8           text in eight registers
        object:6041h:u16           index, always hexadecimal              object:INDEX[.SUB]:TYPE
        object:1018h.1:u32         and sub-index
        object:1008h:string        TYPE is a data type of CiA 301, also by its name there: VISIBLE_STRING
        1018h.1, 1018h:01          the parameter of the device with this object, which has a type
        40001, 400001, 4x0001      holding:0                              as manuals print them, from 1:
        30001, 3x0001, 10001, 1x0001, 00001, 0x0001                       input, discrete, coil
        hr:0, ir:0, di:0, co:0     the tables by their short names

Addresses are those on the wire, from 0, and printed as such. Without an order, long values have the order of the long
values of the device, or the high word first if it has none. The device `raw` has no parameters but such addresses, and
stands for any device.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Sequence
from dataclasses import replace
from typing import cast

from barewire.canopen.datatypes import DATA_TYPES
from barewire.codecs import codec
from barewire.codecs.order import ORDERS, Order
from barewire.devices.device import CanopenSettings, Device, ModbusSettings, UnknownName
from barewire.devices.parameter import (
    TABLE_NAMES,
    VALUE_TYPES,
    ModbusAt,
    ObjectAt,
    Parameter,
    ParameterAccess,
)
from barewire.errors import EncodeError, fold, shown, suggest
from barewire_workbench.cli.arguments import load_device
from barewire_workbench.cli.output import note
from barewire_workbench.live.read_values import is_pattern, read_alone, readable_names, selected
from barewire_workbench.settings.rules import SettingRules

RAW = Device("raw", "any device", (), modbus=ModbusSettings(), canopen=CanopenSettings())

_TYPES = tuple(name for name in VALUE_TYPES if name != "text")
_REGISTERS_MAX = 125
"""The most registers in one response."""
_FIRST_DIGIT = {"0": "coil", "1": "discrete", "3": "input", "4": "holding"}
_SHORT = {"hr": "holding", "ir": "input", "di": "discrete", "co": "coil"}
_PRINTED = re.compile(r"[0134](?:(?P<short>\d{4})|(?P<long>\d{5})|x(?P<x>\d{1,5}))", re.IGNORECASE | re.ASCII)
"""A number that says its table: five digits, six, or the first digit and an x."""
_OBJECT = re.compile(
    r"(?:object:(?:0x)?(?P<index>[0-9a-f]{4})h?|(?P<plain>[0-9a-f]{4})h)(?:[.:](?P<sub>[0-9a-f]{1,2})h?)?",
    re.IGNORECASE,
)
_FORM = (
    "TABLE:ADDRESS[:TYPE[:ORDER]] with holding, input, coil or discrete, a number as in manuals, from 40001 on, or"
    " object:INDEX[.SUB]:TYPE"
)


def device_with(name: str | Device, wanted: Iterable[str] = (), endpoint: str = "") -> Device:
    """Return the device, or that of the name, with a further parameter for each of the `wanted` that is an address.

    `endpoint` gives the node-ID to an EDS. Raises EncodeError for a wrong address, UnknownName for a setting behind a
    menu, which is no parameter.

    >>> device = device_with("raw", ["input:0x0FB1:u32", "object:1018h.1:u32"])
    >>> device.find("input:0x0FB1:u32").modbus
    ModbusAt(table='input', address=4017, words=2, half=None, bit=None, order='ABCD')
    >>> device.find("object:1018h.1:u32").object
    ObjectAt(index=4120, sub=1, bit=None, type='')
    """
    device = name if isinstance(name, Device) else RAW if name == RAW.name else load_device(name, endpoint)
    places = (parameter.modbus for parameter in device.parameters)
    order = next((place.order for place in places if place is not None and place.words > 1), ORDERS[0])
    names = _folded_names(device)
    unknown = [text for text in dict.fromkeys(wanted) if fold(text) not in names]
    if unknown:
        _check_menus(device, {fold(text) for text in unknown})
    # "raw" has nothing but addresses, so what is not one gets the error of an address there.
    added = [raw_parameter(text, order) for text in unknown if is_raw_address(text) or device is RAW]
    return replace(device, parameters=(*device.parameters, *added)) if added else device


def _check_menus(device: Device, folded: Container[str]) -> None:
    """Raise UnknownName for a name that `barewire save` gives to a setting behind a menu, with what reads it."""
    for setting in SettingRules.of(device).behind_menus(is_can=False).values():
        if fold(setting.name) in folded:
            numbers = " ".join(f'"{name}={number}"' for name, number in setting.select.items())
            text = f"is behind a menu: `barewire save` and `restore` have it by this name; by hand write {numbers}"
            raise UnknownName(f'{setting.name} {text}, then read or write "{setting.read_as}"')


def _folded_names(device: Device) -> set[str]:
    return {fold(parameter.name) for parameter in device.parameters}


def names_to_read(
    device: Device,
    endpoint: str,
    names: Sequence[str],
    *,
    groups: Sequence[str] = (),
    access: str | None = None,
) -> list[str]:
    """Return the names that a call asks for. Note those that only their own names read, and leave them out."""
    selection = selected(device, readable_names(device, endpoint), names, groups=groups, access=access)
    alone = read_alone(device)
    by_name = {device.find(name).name for name in names if not is_pattern(name)}
    left_out = [name for name in selection if name in alone and name not in by_name]
    if left_out:
        reasons = ", ".join(f"{shown(name)} ({alone[name]})" for name in left_out)
        note(f"left out, each is read by its name: {reasons}")
    return [name for name in selection if name not in left_out]


def expanded(names: Iterable[str], device: Device = RAW) -> tuple[str, ...]:
    """Return the names with each range of addresses replaced by its addresses, one for each value. The name of a
    parameter of `device` stays as it is.

    >>> expanded(["holding:0-1", "input:10-13:f32", "Status"])
    ('holding:0', 'holding:1', 'input:10:f32', 'input:12:f32', 'Status')

    Raises EncodeError for a range that is wrong.
    """
    return tuple(name for text in names for name in _spread(wire_address(text, device)))


def wire_address(text: str, device: Device = RAW) -> str:
    """Return an address as manuals print it in the form on the wire; every other text as it is, and so the name of a
    parameter of `device`: 40001 may be one.

    >>> [wire_address(text) for text in ("40001", "400011:f32", "3x0002", "10001-10004", "00001", "hr:7", "Status")]
    ['holding:0', 'holding:10:f32', 'input:1', 'discrete:0-3', 'coil:0', 'holding:7', 'Status']
    """
    if fold(text) in _folded_names(device):
        return text
    if (parameter := _of_dictionary(text, device)) is not None:
        return parameter.name
    first, colon, rest = text.strip().partition(":")
    if colon and first.lower() in _SHORT:
        return f"{_SHORT[first.lower()]}:{rest}"
    numbers = [_printed_number(part) for part in first.split("-")]
    places = [number for number in numbers if number is not None]
    tables = {table for table, _ in places}
    if len(places) != len(numbers) or len(tables) != 1:
        return text
    addresses = "-".join(str(address) for _, address in places)
    return f"{tables.pop()}:{addresses}{colon}{rest}"


def _of_dictionary(text: str, device: Device) -> Parameter | None:
    """Return the parameter whose object has this address, or whose name ends with this name of a sub-index; None if
    there is none, or are several.

    >>> from barewire import load
    >>> [_of_dictionary(text, load("az3")).name for text in ("6041h", "6041h:00", "object:6041h")]
    ['STATUS WORD', 'STATUS WORD', 'STATUS WORD']
    """
    match = _OBJECT.fullmatch(text.strip())
    if match is None:
        ending = f" / {fold(text)}"
        named = [parameter for parameter in device.parameters if fold(parameter.name).endswith(ending)]
        return named[0] if len(named) == 1 else None
    address = int(match["index"] or match["plain"], 16), int(match["sub"] or "0", 16)
    for parameter in device.parameters:
        place = parameter.object
        if place is not None and place.bit is None and (place.index, place.sub) == address:
            return parameter
    return None


def _printed_number(text: str) -> tuple[str, int] | None:
    """Return table and address of 40001, 400001 or 4x0001; None for anything else."""
    match = _PRINTED.fullmatch(text.strip())
    if match is None:
        return None
    number = int(match["short"] or match["long"] or match["x"])
    return (_FIRST_DIGIT[text.strip()[0]], number - 1) if 1 <= number <= 0x10000 else None


def printed_number_hint(table: str, address: int) -> str:
    """Return what an address that the device does not have probably is, if it looks like the number of a manual.

    >>> printed_number_hint("holding", 40001)
    'if 40001 is the number in the manual, the address is holding:0'
    >>> printed_number_hint("input", 1)
    ''
    """
    printed = _printed_number(str(address))
    if printed is None or printed[0] != table:
        return ""
    return f"if {address} is the number in the manual, the address is {table}:{printed[1]}"


def _spread(text: str) -> Iterable[str]:
    """Return the addresses of a range, one for each value; any other text alone."""
    table, _, rest = text.strip().partition(":")
    addresses, colon, form = rest.partition(":")
    if not _is_range(addresses) or table not in TABLE_NAMES:
        return (text,)
    low, _, high = addresses.rpartition("-")
    first, last = _number(text, low, 0xFFFF), _number(text, high, 0xFFFF)
    if last < first:
        raise EncodeError(f"{text!r}: {addresses!r}: expected the lower address first")
    type_name = form.partition(":")[0]
    if type_name.startswith("text"):
        expected = "expected a type with a size of its own, such as u32"
        raise EncodeError(f"{text!r}: type {type_name!r} in a range: {expected}")
    place = raw_parameter(f"{table}:{first}{colon}{form}").modbus
    size = 1 if place is None else place.words
    count = last - first + 1
    if count % size:
        raise EncodeError(f"{text!r}: {addresses!r} has {count} registers, a {type_name} has {size}")
    return [f"{table}:{address}{colon}{form}" for address in range(first, last + 1, size)]


def _is_range(addresses: str) -> bool:
    return "-" in addresses.strip()[1:]  # at the beginning it is the sign of a negative number, which is refused as one


def is_raw_address(text: str) -> bool:
    """Return whether the text begins like an address; no name of a parameter in the catalogue does."""
    return text.partition(":")[0].strip() in (*TABLE_NAMES, "object") and ":" in text


def raw_parameter(text: str, order: Order = "ABCD") -> Parameter:
    """Return the parameter at an address; `order` is for long values without one. Raises EncodeError if it is wrong."""
    table, _, rest = text.strip().partition(":")
    parts = rest.split(":")
    if table == "object" and rest and len(parts) <= 2:
        return _raw_object(text, *parts)
    if table not in TABLE_NAMES or not (rest and len(parts) <= 3):
        hint = suggest(table, (*TABLE_NAMES, "object"))
        raise EncodeError(f"{shown(text)} is not an address: expected {_FORM}{hint}")
    if _is_range(parts[0]):
        raise EncodeError(f"{text!r}: a range of addresses can only be read: give one address for each value")
    address, is_bit = _number(text, parts[0], 0xFFFF), table in ("coil", "discrete")
    type_name, words = _type_and_words(text, parts[1] if len(parts) > 1 else "bool" if is_bit else "u16")
    if is_bit and type_name != "bool":
        raise EncodeError(f"{shown(text)}: a {table} is a bool")
    letters = cast(Order, parts[2].upper()) if len(parts) == 3 else order
    if letters not in ORDERS:
        expected = f"expected one of {', '.join(ORDERS)}{suggest(parts[2], ORDERS)}"
        raise EncodeError(f"{shown(text)}: order {shown(parts[2])}: {expected}")
    if address + words > 0x10000:
        raise EncodeError(f"{shown(text)}: there are no {words} registers from address {address} on")
    access: ParameterAccess = "ro" if table in ("input", "discrete") else "rw"
    return Parameter(text, type_name, access=access, modbus=ModbusAt(table, address, words, order=letters))


def _raw_object(text: str, number: str, type_name: str = "") -> Parameter:
    index, dot, sub = number.partition(".")
    place = _number(text, index, 0xFFFF, base=16), _number(text, sub, 0xFF, base=16) if dot else 0
    if not type_name:
        known = _type_in_cia_301(*place)
        hint = f"; CiA 301 has {known} for it: {text.strip().rstrip(':')}:{known}" if known else ""
        raise EncodeError(f"{shown(text)}: its type is missing: expected object:INDEX[.SUB]:TYPE, such as u16{hint}")
    kind = _object_type(text, type_name)
    if kind in ("string", "unicode"):
        return Parameter(text, "text", object=ObjectAt(*place, type=kind))
    return Parameter(text, kind, object=ObjectAt(*place))


def _type_and_words(text: str, type_name: str) -> tuple[str, int]:
    """Return a type and the registers that it takes: text8 is text in 8 registers."""
    match = re.fullmatch(r"text(\d*)", type_name)
    if match is None:
        if type_name not in _TYPES:
            expected = f"expected one of {', '.join(_TYPES)}, or textN in registers{suggest(type_name, _TYPES)}"
            raise EncodeError(f"{shown(text)}: type {shown(type_name)}: {expected}")
        return type_name, 1 if type_name == "bool" else max(1, codec(type_name).size // 2)
    words = int(match[1][:9] or 0)  # more digits are too many registers anyway, and `int` refuses thousands of them
    if not 1 <= words <= _REGISTERS_MAX:
        expected = f"expected text1..text{_REGISTERS_MAX}, text in that number of registers"
        raise EncodeError(f"{shown(text)}: type {shown(type_name)}: {expected}")
    return "text", words


def _object_type(text: str, name: str) -> str:
    """Return a data type of CiA 301 by its name here, for which the name in the standard may stand too."""
    known = {fold(name): row.name for row in DATA_TYPES for name in (row.name, row.standard)} | {"text": "string"}
    kind = known.get(fold(name))
    if kind is None:
        names = ", ".join(row.name for row in DATA_TYPES)
        raise EncodeError(f"{shown(text)}: type {shown(name)}: expected one of {names}{suggest(name, known)}")
    return kind


def _type_in_cia_301(index: int, sub: int) -> str:
    """Return the type that CiA 301 has for a communication object; empty if it has none."""
    from barewire.canopen.communication_objects import standard_objects

    if index in (0x1009, 0x100A):
        return "string"
    if 0x1600 <= index < 0x1800 or 0x1A00 <= index < 0x1C00:
        return "u32" if sub else "u8"
    types = {(entry.index, entry.sub): entry.type for entry in standard_objects(name="name", servers=2)}
    is_record = any(index == known for known, _ in types)
    return types.get((index, sub)) or ("u8" if sub == 0 and is_record else "")  # sub-index 0 is the number of entries


def _number(text: str, digits: str, most: int, base: int = 10) -> int:
    """Return the number in 26, 0x1A or 1Ah; with base 16, 26 is hexadecimal too."""
    plain = digits.strip().lower()
    if plain.endswith("h"):
        plain, base = plain[:-1], 16
    elif plain.startswith("0x"):
        plain, base = plain[2:], 16
    try:
        number = int(plain, base) if plain.isalnum() else -1  # `int` alone accepts 1_000, +5 and blanks
    except ValueError:
        number = -1
    if not 0 <= number <= most:
        raise EncodeError(f"{shown(text)}: {shown(digits)} is not a number in 0..{most}, such as 100, 0x64 or 64h")
    return number
