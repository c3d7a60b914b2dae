"""c-modbus-slave (C, Siemens Energy) as an adapter: its server on RTU, ASCII and TCP, called by ctypes.

Its sources are built by peer.toml.
"""

from __future__ import annotations

import ctypes
import sys
from ctypes import CFUNCTYPE, POINTER, Structure, c_int, c_size_t, c_uint8, c_uint16, c_void_p
from typing import Any

from adapter import NotOffered, checksums, serve, words
from adapter_conformance import conformance_answers, unwrapped, wrapped
from adapter_server import Units, server_answers

LIBRARY = ctypes.CDLL(sys.argv[1])
LIBRARY.mbcrc16.restype = c_uint16
HANDLERS = {"rtu": "mbadu_handle_req", "ascii": "mbadu_ascii_handle_req", "tcp": "mbadu_tcp_handle_req"}
for name in HANDLERS.values():
    getattr(LIBRARY, name).restype = c_size_t
READ_POINTER, WRITE_POINTER, U16 = 2, 4, 17
STATUS, REGISTER, RESET = CFUNCTYPE(c_uint8), CFUNCTYPE(c_uint16), CFUNCTYPE(None)
COUNTERS = ("0B", "0C", "0D", "0E", "0F", "10", "11", "12")


class Coil(Structure):
    """mbcoil_desc_s: a bit in memory."""

    _fields_ = (
        *(("address", c_uint16), ("access", c_int)),
        *(("read", POINTER(c_uint8)), ("read_bit", c_uint8), ("write", POINTER(c_uint8)), ("write_bit", c_uint8)),
        *((name, c_void_p) for name in ("rlock", "wlock", "after")),
    )


class Register(Structure):
    """mbreg_desc_s: a register in memory."""

    _fields_ = (
        *(("address", c_uint16), ("type", c_int), ("access", c_int)),
        *(("read", POINTER(c_uint16)), ("write", POINTER(c_uint16))),
        *((name, c_void_p) for name in ("rlock", "wlock", "override")),
        *(("block", c_size_t), ("after", c_void_p)),
    )


class File(Structure):
    """mbfile_desc_s."""

    _fields_ = (("number", c_uint16), ("records", POINTER(Register)), ("count", c_size_t))


class Serial(Structure):
    """What only a serial line has."""

    _fields_ = (
        *(("address", c_uint8), ("exception_status", STATUS)),
        *(("diagnostics", REGISTER), ("reset_diagnostics", RESET), ("restart", c_void_p)),
        ("default_address", c_int),
    )


class State(Structure):
    """The counters and the event log."""

    _fields_ = (
        *(("listen_only", c_int), ("status", c_uint16), ("events", c_uint16)),
        *(("log", c_uint8 * 64), ("log_at", c_int), ("log_count", c_int)),
        *((f"counter_{name}", c_uint16) for name in COUNTERS),
        ("delimiter", c_uint8),
    )


class Instance(Structure):
    """mbinst_s: a server."""

    _fields_ = (
        *(("discrete_inputs", POINTER(Coil)), ("n_discrete_inputs", c_size_t)),
        *(("coils", POINTER(Coil)), ("n_coils", c_size_t)),
        *(("input_registers", POINTER(Register)), ("n_input_registers", c_size_t)),
        *(("holding_registers", POINTER(Register)), ("n_holding_registers", c_size_t)),
        *(("files", POINTER(File)), ("n_files", c_size_t)),
        *((name, c_void_p) for name in ("handle", "after_coils", "after_registers")),
        *(("long_files", c_int), ("serial", Serial), ("swap_words", c_int), ("state", State)),
    )


def registers(cells: dict[int, Any], writable: bool) -> Any:
    """Return the descriptions of registers: an address each, and the memory behind it."""
    access = READ_POINTER | (WRITE_POINTER if writable else 0)
    rows = [
        Register(address=address, type=U16, access=access, read=cell, write=cell if writable else None)
        for address, cell in sorted((address, ctypes.pointer(cell)) for address, cell in cells.items())
    ]
    return (Register * max(len(rows), 1))(*rows)


class Unit:
    """One server of the library, with the memory of a case behind it."""

    def __init__(self, line: str, address: int, tables: dict[str, Any], described: dict[str, Any]) -> None:
        self.handle, self.instance = getattr(LIBRARY, HANDLERS[line]), Instance()
        self.cells: dict[str, dict[int, Any]] = {}
        self.kept: list[Any] = []
        for table in ("coils", "discrete_inputs", "holding_registers", "input_registers"):
            kind = c_uint16 if "registers" in table else c_uint8
            blocks = tables.get(table, {})
            self.cells[table] = {
                first + at: kind(value) for first, row in blocks.items() for at, value in enumerate(row)
            }
        for table in ("holding_registers", "input_registers"):
            self.install(table, registers(self.cells[table], table == "holding_registers"), len(self.cells[table]))
        for table in ("coils", "discrete_inputs"):
            access = READ_POINTER | (WRITE_POINTER if table == "coils" else 0)
            pointers = sorted((place, ctypes.pointer(cell)) for place, cell in self.cells[table].items())
            rows = [Coil(address=place, access=access, read=cell, write=cell) for place, cell in pointers]
            self.install(table, (Coil * max(len(rows), 1))(*rows), len(rows))
        self.files = {
            int(number): {at: c_uint16(value) for at, value in enumerate(words(text))}
            for number, text in described.get("files", {}).items()
        }
        rows = [
            File(number=number, records=registers(cells, True), count=len(cells))
            for number, cells in sorted(self.files.items())
        ]
        self.install("files", (File * max(len(rows), 1))(*rows), len(rows))
        LIBRARY.mbinst_init(ctypes.byref(self.instance))
        self.instance.serial.address = address
        if "exception_status" in described:
            self.instance.serial.exception_status = STATUS(lambda: int(described["exception_status"], 16))
        counters = described.get("counters", {})
        self.diagnostics = counters.get("02", 0)
        self.instance.serial.diagnostics = REGISTER(lambda: self.diagnostics)
        self.instance.serial.reset_diagnostics = RESET(lambda: setattr(self, "diagnostics", 0))
        for counter in counters.keys() - {"02"}:
            setattr(self.instance.state, "events" if counter == "events" else f"counter_{counter}", counters[counter])

    def install(self, name: str, rows: Any, count: int) -> None:
        self.kept.append(rows)
        setattr(self.instance, name, ctypes.cast(rows, dict(Instance._fields_)[name]))
        setattr(self.instance, f"n_{name}", count)

    def hear(self, data: bytes) -> bytes:
        answer = (c_uint8 * 1024)()
        size = self.handle(ctypes.byref(self.instance), data, c_size_t(len(data)), answer)
        return bytes(answer[:size])


def checksum(data: bytes) -> bytes:
    return int(LIBRARY.mbcrc16(data, c_size_t(len(data)))).to_bytes(2, "little")


class Server:
    """The units of a case on one line: each is a server of its own, which hears everything."""

    def __init__(self, line: str, units: Units, described: dict[int, Any]) -> None:
        self.line = line
        if line == "tcp" and len(units) > 1:
            raise NotOffered("on TCP it answers for every unit")
        if any(not 1 <= unit <= 247 for unit in units):
            raise NotOffered("addresses of a serial line")
        self.units = {unit: Unit(line, unit, tables, described[unit]) for unit, tables in units.items()}

    def ask(self, unit: int, pdu: bytes) -> bytes | None:
        if self.line == "tcp" and unit not in self.units:
            raise NotOffered("on TCP it answers for every unit")
        answer = self.hear(wrapped(self.line, unit, pdu.hex(), 1))
        return unwrapped(self.line, answer)[1] if answer else None

    def overrun(self) -> None:
        """Count a lost character, as the library leaves it to the port to do."""
        for unit in self.units.values():
            unit.instance.state.counter_12 += 1

    def hear(self, data: bytes) -> bytes:
        return b"".join(unit.hear(data) for unit in self.units.values())

    def values(self, unit: int, table: str, first: int, count: int) -> list[int]:
        return [self.units[unit].cells[table][first + at].value for at in range(count)]

    def files(self, unit: int) -> dict[int, list[int]]:
        return {name: [cell.value for cell in cells.values()] for name, cells in self.units[unit].files.items()}


SERVED = {*range(1, 9), 0x0B, 0x0C, 0x0F, 0x10, 0x14, 0x15, 0x16, 0x17}
MORE = {"files", "exception_status", "counters"}
serve(
    "c-modbus-slave",
    {
        **server_answers(Server, SERVED, {"rtu", "ascii", "tcp"}, MORE),
        **conformance_answers(Server, {"rtu", "ascii", "tcp"}),
        **checksums(checksum),
    },
)
