"""pyModbusTCP as an adapter: its client on a connection in virtual time, and its utilities."""

from __future__ import annotations

import socket
from typing import Any
from unittest.mock import patch

from adapter import NotOffered, Refused, checksums, number, octets, register_bytes, registers, serve
from adapter_client import ExceptionAnswer, given
from adapter_server import Units, server_answers
from client_line import NAMES, clients, needs
from pyModbusTCP import utils
from pyModbusTCP.client import ModbusClient
from pyModbusTCP.server import DataBank, ModbusServer

SIZES = {"coils": "coils_size", "discrete_inputs": "d_inputs_size"}
SIZES |= {"holding_registers": "h_regs_size", "input_registers": "i_regs_size"}
CALLS = {**NAMES, 0x17: "write_read_multiple_registers", 0x2B: "read_device_identification"}


class Sockets:
    """The module socket, as the library uses it: every socket is the line."""

    AF_UNSPEC, SOCK_STREAM, IPPROTO_TCP, TCP_NODELAY, SOL_SOCKET = 0, 1, 6, 1, 1
    timeout, error = socket.timeout, socket.error

    def __init__(self, line: Any) -> None:
        self.socket = lambda *_: line

    def getaddrinfo(self, *_: Any, **__: Any) -> list[Any]:
        return [(2, 1, 6, "", ("virtual", 502))]


def connect(line: Any, patches: Any) -> Any:
    """Return the function that asks."""
    needs(line, "tcp")
    patches.enter_context(patch("pyModbusTCP.client.socket", Sockets(line)))
    client = ModbusClient(host="localhost", timeout=line.timeout, auto_open=True)

    def ask(unit: int, code: int, fields: dict[str, Any]) -> Any:
        client.unit_id = unit
        result = getattr(client, CALLS[code])(*given(code, fields))
        if not result:
            if client.last_except:
                raise ExceptionAnswer(client.last_except)
            raise Refused(client.last_error_as_txt)
        return result

    return ask


class Server:
    """The engine of the server, without its sockets: one table of each kind, from address 0 on."""

    def __init__(self, line: str, units: Units, _described: object) -> None:
        if len(units) > 1 or any({*blocks} != {0} for blocks in units[min(units)].values()):
            raise NotOffered("a data bank has tables from address 0 on, for every unit")
        ((_, tables),) = units.items()
        rows = {SIZES[name]: len(blocks[0]) for name, blocks in tables.items()}
        self.bank = DataBank(**{**dict.fromkeys(SIZES.values(), 0), **rows})
        self.server = ModbusServer(data_bank=self.bank)
        for name, blocks in tables.items():
            getattr(self.bank, f"set_{name}")(0, blocks[0])

    def ask(self, unit: int, pdu: bytes) -> bytes | None:
        session = ModbusServer.SessionData()
        session.request.mbap.raw = b"\0\1\0\0" + (1 + len(pdu)).to_bytes(2, "big") + bytes([unit])
        session.request.pdu.raw = pdu
        self.server._engine(session)
        return session.response.pdu.raw or None

    def values(self, unit: int, table: str, first: int, count: int) -> list[int]:
        return [int(value) for value in getattr(self.bank, f"get_{table}")(first, count)]


def layout(question: dict[str, Any]) -> tuple[str, int, bool]:
    """Return letter and size of a type, and whether the high word is first."""
    kind, width = question["type"][0], int(question["type"][1:])
    if width not in (32, 64) or question["order"] not in ("ABCD", "CDAB"):
        raise NotOffered("pyModbusTCP joins words to numbers of 32 and 64 bits, and does not swap bytes")
    return kind, width, question["order"] == "ABCD"


def encode_number(question: dict[str, Any]) -> dict[str, Any]:
    kind, width, big = layout(question)
    value: Any = number(question["value"])
    if kind == "f":
        value = utils.encode_ieee(float(value), double=width == 64)
    elif kind == "i":
        raise NotOffered("pyModbusTCP makes two's complements only when it decodes")
    return {"bytes": register_bytes(utils.long_list_to_word([value], big_endian=big, long_long=width == 64))}


def decode_number(question: dict[str, Any]) -> dict[str, Any]:
    kind, width, big = layout(question)
    (value,) = utils.word_list_to_long(registers(octets(question["bytes"])), big_endian=big, long_long=width == 64)
    if kind == "f":
        value = utils.decode_ieee(value, double=width == 64)
    return {"value": str(utils.get_2comp(value, width) if kind == "i" else value)}


def decode_part(question: dict[str, Any]) -> dict[str, Any]:
    if question["part"] in ("L", "H"):
        raise NotOffered("pyModbusTCP has bits, and no halves")
    return {"value": int(utils.test_bit(int(question["register"], 16), int(question["part"][4:])))}


def encode_part(question: dict[str, Any]) -> dict[str, Any]:
    if question["part"] in ("L", "H") or question["write"] not in (0, 1):
        raise NotOffered("pyModbusTCP has bits, and no halves")
    change = utils.set_bit if question["write"] else utils.reset_bit
    return {"then": f"{change(int(question['register'], 16), int(question['part'][4:])):04X}"}


serve(
    "pyModbusTCP",
    {
        **clients(connect, {*CALLS}, "tcp"),
        **server_answers(Server, {*CALLS}, {"tcp"}),
        **checksums(lambda data: utils.crc16(data).to_bytes(2, "little")),
        "number": {"encode": encode_number, "decode": decode_number},
        "register-part": {"encode": encode_part, "decode": decode_part},
    },
)
