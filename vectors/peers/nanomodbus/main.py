"""nanoMODBUS (C) as an adapter: its server and its client, called by ctypes.

nanomodbus.c is built by peer.toml.
"""

from __future__ import annotations

import ctypes
import sys
from ctypes import CFUNCTYPE, POINTER, c_bool, c_int, c_int32, c_uint8, c_uint16, c_uint32, c_void_p
from typing import Any

from adapter import NotOffered, Refused, checksums, octets, serve, words
from adapter_client import ExceptionAnswer, given_to_c
from adapter_conformance import conformance_answers, wrapped
from adapter_server import Units, server_answers
from client_line import NAMES, clients, needs

LIBRARY = ctypes.CDLL(sys.argv[1])
LIBRARY.nmbs_crc_calc.restype = c_uint16
SIZE = 8192
"""More than an instance takes."""

READ = CFUNCTYPE(c_int32, POINTER(c_uint8), c_uint16, c_int32, c_void_p)
CRC = CFUNCTYPE(c_uint16, POINTER(c_uint8), c_uint32, c_void_p)
BITS = CFUNCTYPE(c_int, c_uint16, c_uint16, POINTER(c_uint8), c_uint8, c_void_p)
WORDS = CFUNCTYPE(c_int, c_uint16, c_uint16, POINTER(c_uint16), c_uint8, c_void_p)
BIT = CFUNCTYPE(c_int, c_uint16, c_bool, c_uint8, c_void_p)
WORD = CFUNCTYPE(c_int, c_uint16, c_uint16, c_uint8, c_void_p)
FILE = CFUNCTYPE(c_int, c_uint16, c_uint16, POINTER(c_uint16), c_uint16, c_uint8, c_void_p)
NAME = CFUNCTYPE(c_int, c_uint8, POINTER(c_uint8))
MAP = CFUNCTYPE(c_int, POINTER(c_uint8))


class Platform(ctypes.Structure):
    """nmbs_platform_conf."""

    _fields_ = (
        *(("transport", c_int), ("read", READ), ("write", READ), ("crc", CRC)),
        *(("arg", c_void_p), ("initialized", c_uint32)),
    )


class Callbacks(ctypes.Structure):
    """nmbs_callbacks: a function that is left out is exception 01."""

    _fields_ = (
        *(("read_coils", BITS), ("read_discrete_inputs", BITS)),
        *(("read_holding_registers", WORDS), ("read_input_registers", WORDS)),
        *(("write_single_coil", BIT), ("write_single_register", WORD)),
        *(("write_multiple_coils", BITS), ("write_multiple_registers", WORDS)),
        *(("read_file_record", FILE), ("write_file_record", FILE)),
        *(("read_device_identification", NAME), ("read_device_identification_map", MAP)),
        *(("arg", c_void_p), ("initialized", c_uint32)),
    )


CLIENT = {**NAMES, 0x17: "read_write_registers"}
CALLS = {
    **{"01": ("read_coils",), "02": ("read_discrete_inputs",), "03": ("read_holding_registers",)},
    **{"04": ("read_input_registers",), "05": ("write_single_coil",), "06": ("write_single_register",)},
    **{"0F": ("write_multiple_coils",), "10": ("write_multiple_registers",)},
    **{"14": ("read_file_record",), "15": ("write_file_record",)},
    **{"2B": ("read_device_identification", "read_device_identification_map")},
}


class Line:
    """A line in memory: what was sent, and what is to be received."""

    def __init__(self, transport: str) -> None:
        self.tcp, self.sent, self.waiting = transport == "tcp", b"", b""
        self.platform = Platform()
        LIBRARY.nmbs_platform_conf_create(ctypes.byref(self.platform))
        self.platform.transport = 2 if self.tcp else 1
        self.platform.read, self.platform.write = READ(self.read), READ(self.write)
        self.instance = ctypes.create_string_buffer(SIZE)

    def read(self, data: Any, count: int, timeout: int, arg: Any) -> int:
        """Take bytes; fewer than asked for are a time-out."""
        part, self.waiting = self.waiting[:count], self.waiting[count:]
        ctypes.memmove(data, part, len(part))
        return len(part)

    def write(self, data: Any, count: int, timeout: int, arg: Any) -> int:
        self.sent += ctypes.string_at(data, count)
        return count

    def take(self) -> bytes:
        sent, self.sent = self.sent, b""
        return sent


def checksum(data: bytes) -> bytes:
    # the library hands the value over with its bytes swapped, as it is sent
    return int(LIBRARY.nmbs_crc_calc(data, len(data), None)).to_bytes(2, "big")


class Unit:
    """One server of the library, with the callbacks of an application that holds the tables of a case."""

    def __init__(self, line: str, address: int, described: dict[str, Any]) -> None:
        self.line, self.described = Line(line), described
        self.tables = {
            name: {
                first + at: value
                for first, row in described["tables"].get(name, {}).items()
                for at, value in enumerate(row)
            }
            for name in ("coils", "discrete_inputs", "holding_registers", "input_registers")
        }
        self.files = {int(name): words(text) for name, text in described.get("files", {}).items()}
        self.names = {int(name, 16): octets(text) for name, text in described.get("identification", {}).items()}
        self.callbacks = Callbacks()
        LIBRARY.nmbs_callbacks_create(ctypes.byref(self.callbacks))
        kinds = dict(Callbacks._fields_)
        functions = {code[:2] for code in described.get("functions", CALLS)}
        for code, names in CALLS.items():
            for name in names if code in functions else ():
                setattr(self.callbacks, name, kinds[name](getattr(self, name)))
        error = LIBRARY.nmbs_server_create(
            self.line.instance, c_uint8(address), ctypes.byref(self.line.platform), ctypes.byref(self.callbacks)
        )
        if error:
            raise NotOffered(f"no server with this address: error {error}")
        LIBRARY.nmbs_set_read_timeout(self.line.instance, 10)
        LIBRARY.nmbs_set_byte_timeout(self.line.instance, 10)

    def hear(self, data: bytes) -> bytes:
        """Return what the server sends when these bytes have come."""
        self.line.waiting = data
        LIBRARY.nmbs_server_poll(self.line.instance)
        self.line.waiting = b""
        return self.line.take()

    def refused(self, table: str, first: int, count: int, writes: bool = False) -> int:
        """Return the exception of an access, 0 if there is none."""
        places = range(first, first + count)
        if any(place not in self.tables[table] for place in places):
            return 2
        if writes and any(place in self.described.get("read_only", {}).get(table, ()) for place in places):
            return 2
        faults = self.described.get("faults", ())
        return next((row["exception"] for row in faults if row["table"] == table and row["address"] in places), 0)

    def get_bits(self, table: str, first: int, count: int, out: Any) -> int:
        if error := self.refused(table, first, count):
            return error
        for at in range(count):
            bit = 1 << at % 8
            out[at // 8] = out[at // 8] & ~bit | bit * self.tables[table][first + at]
        return 0

    def read_coils(self, first: int, count: int, out: Any, unit: int, arg: Any) -> int:
        return self.get_bits("coils", first, count, out)

    def read_discrete_inputs(self, first: int, count: int, out: Any, unit: int, arg: Any) -> int:
        return self.get_bits("discrete_inputs", first, count, out)

    def get_words(self, table: str, first: int, count: int, out: Any) -> int:
        if error := self.refused(table, first, count):
            return error
        for at in range(count):
            out[at] = self.tables[table][first + at]
        return 0

    def read_holding_registers(self, first: int, count: int, out: Any, unit: int, arg: Any) -> int:
        return self.get_words("holding_registers", first, count, out)

    def read_input_registers(self, first: int, count: int, out: Any, unit: int, arg: Any) -> int:
        return self.get_words("input_registers", first, count, out)

    def put(self, table: str, first: int, values: list[int]) -> int:
        if error := self.refused(table, first, len(values), writes=True):
            return error
        self.tables[table].update(zip(range(first, first + len(values)), values))
        return 0

    def write_single_coil(self, first: int, value: bool, unit: int, arg: Any) -> int:
        return self.put("coils", first, [int(value)])

    def write_single_register(self, first: int, value: int, unit: int, arg: Any) -> int:
        return self.put("holding_registers", first, [value])

    def write_multiple_coils(self, first: int, count: int, bits: Any, unit: int, arg: Any) -> int:
        return self.put("coils", first, [bits[at // 8] >> at % 8 & 1 for at in range(count)])

    def write_multiple_registers(self, first: int, count: int, values: Any, unit: int, arg: Any) -> int:
        return self.put("holding_registers", first, [*values[:count]])

    def read_file_record(self, file: int, record: int, out: Any, count: int, unit: int, arg: Any) -> int:
        row = self.files.get(file, [])
        if record + count > len(row):
            return 2
        out_bytes = b"".join(value.to_bytes(2, sys.byteorder) for value in row[record : record + count])
        ctypes.memmove(out, out_bytes, len(out_bytes))
        return 0

    def write_file_record(self, file: int, record: int, values: Any, count: int, unit: int, arg: Any) -> int:
        row = self.files.get(file, [])
        if record + count > len(row):
            return 2
        row[record : record + count] = values[:count]
        return 0

    def read_device_identification(self, name: int, out: Any) -> int:
        ctypes.memmove(out, self.names[name] + b"\0", len(self.names[name]) + 1)
        return 0

    def read_device_identification_map(self, out: Any) -> int:
        for name in self.names:
            out[name // 8] |= 1 << name % 8
        return 0


class Server:
    """The units of a case on one line, each a server of its own; on TCP one server has one unit."""

    def __init__(self, line: str, units: Units, described: dict[int, Any]) -> None:
        self.tcp = line == "tcp"
        if self.tcp and len(units) > 1:
            raise NotOffered("which unit is meant, its application decides")
        self.units = {
            address: Unit(line, address, {**described[address], "tables": tables}) for address, tables in units.items()
        }

    def ask(self, unit: int, pdu: bytes) -> bytes | None:
        if self.tcp and unit not in self.units:
            raise NotOffered("which unit is meant, its application decides")
        if any(len(value) > 127 for one in self.units.values() for value in one.names.values()):
            raise NotOffered("its texts are C strings of at most 127 characters")
        answer = self.hear(wrapped("tcp" if self.tcp else "rtu", unit, pdu.hex(), 1))
        return (answer[7:] if self.tcp else answer[1:-2]) or None

    def hear(self, data: bytes) -> bytes:
        return b"".join(one.hear(data) for one in self.units.values())

    def stream(self, data: bytes) -> bytes:
        """Return what the server sends to frames: it reads one when it is polled, and waits for its end."""
        said = b""
        while data:
            size = 6 + int.from_bytes(data[4:6], "big")
            if len(data) < size:
                raise NotOffered("it waits for the rest of a frame while it reads")
            said, data = said + self.hear(data[:size]), data[size:]
        return said

    def values(self, unit: int, table: str, first: int, count: int) -> list[int]:
        return [self.units[unit].tables[table][first + at] for at in range(count)]

    def files(self, unit: int) -> dict[int, list[int]]:
        return self.units[unit].files


def called(one: Any, code: int, fields: dict[str, Any]) -> tuple[int, list[int]]:
    """Return the error of a call of the client, and the values that it has read."""
    values = fields.get("values", ())
    if len(values) > 2000:
        raise NotOffered("its arguments have 2000 bits at most")
    count = fields.get("quantity", fields.get("read_quantity", len(values)))
    if code in (1, 2, 0x0F):
        found, packed = (c_uint8 * 250)(), (c_uint8 * 250)()
        for at, bit in enumerate(values):
            packed[at // 8] |= bool(bit) << at % 8
    else:
        found, packed = (c_uint16 * 256)(), (c_uint16 * max(len(values), 1))(*values)
    arguments = given_to_c(code, fields, found, packed)
    if code == 0x17:
        arguments = arguments[3:] + arguments[:3]  # it reads first in the list of its arguments, too
    error = getattr(LIBRARY, f"nmbs_{CLIENT[code]}")(one, *arguments)
    if code in (1, 2):
        return error, [found[at // 8] >> at % 8 & 1 for at in range(count)]
    return error, [*found[:count]]


class TimedLine(Line):
    """The line of a client: time passes while the library reads."""

    def __init__(self, virtual: Any) -> None:
        super().__init__(virtual.setup["framing"])
        self.virtual = virtual
        LIBRARY.nmbs_client_create(self.instance, ctypes.byref(self.platform))
        LIBRARY.nmbs_set_read_timeout(self.instance, round(virtual.timeout * 1000))
        LIBRARY.nmbs_set_byte_timeout(self.instance, round(virtual.timeout * 1000))

    def read(self, data: Any, count: int, timeout: int, arg: Any) -> int:
        self.virtual.timeout = timeout / 1000
        part = self.virtual.read(count)
        ctypes.memmove(data, part, len(part))
        return len(part)

    def write(self, data: Any, count: int, timeout: int, arg: Any) -> int:
        self.virtual.write(ctypes.string_at(data, count))
        return count


def connect(virtual: Any, _patches: Any) -> Any:
    """Return the function that asks."""
    needs(virtual, "rtu", "tcp")
    line = TimedLine(virtual)

    def ask(unit: int, code: int, fields: dict[str, Any]) -> list[int]:
        if unit == 0 and line.tcp:
            raise NotOffered("unit 0 is a broadcast to it on TCP, too")
        LIBRARY.nmbs_set_destination_rtu_address(line.instance, c_uint8(unit))
        error, found = called(line.instance, code, fields)
        if 1 <= error <= 4:
            raise ExceptionAnswer(error)
        if error:
            raise Refused(f"error {error}")
        return found

    return ask


SERVED = {1, 2, 3, 4, 5, 6, 0x0F, 0x10, 0x14, 0x15, 0x17, 0x2B}
MORE = {"files", "identification", "functions", "faults", "read_only"}
serve(
    "nanoMODBUS",
    {
        **clients(connect, SERVED - {0x14, 0x15, 0x2B}, "rtu"),
        **server_answers(Server, SERVED, {"rtu", "tcp"}, MORE),
        **conformance_answers(Server, {"rtu", "tcp"}),
        **checksums(checksum),
    },
)
