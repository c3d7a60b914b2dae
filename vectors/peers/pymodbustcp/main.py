"""pyModbusTCP as an adapter: its client with a connection that only plays back, and its utilities.

barewire vectors check --adapter "python vectors/peers pymodbustcp"
"""

from __future__ import annotations

from typing import Any

import pyModbusTCP
from adapter import NotOffered, Refused, crc_fields, number, octets, register_bytes, registers, serve
from adapter_client import ExceptionAnswer, client_answers
from adapter_server import Units, server_answers
from client_peers import client_runner
from pyModbusTCP import utils
from pyModbusTCP.client import ModbusClient
from pyModbusTCP.constants import MB_EXCEPT_ERR
from pyModbusTCP.server import DataBank, ModbusServer

SIZES = {"coils": "coils_size", "discrete_inputs": "d_inputs_size"}
SIZES |= {"holding_registers": "h_regs_size", "input_registers": "i_regs_size"}
CODES = {1, 2, 3, 4, 5, 6, 15, 16, 0x17, 0x2B}


class Playback(ModbusClient):
    """A client whose connection keeps what is sent, and receives the reply."""

    def __init__(self) -> None:
        super().__init__(auto_open=False)
        self.sent, self.reply = b"", b""

    def _send(self, frame: bytes) -> None:
        self.sent += frame

    def _recv_all(self, size: int) -> bytes:
        head, self.reply = self.reply[:size], self.reply[size:]
        if len(head) < size:
            raise ModbusClient._NetworkError(4, "the connection ends")
        return head


def call(code: int, fields: dict[str, Any], reply: bytes | None) -> tuple[bytes, Any]:
    """Let a client make a request, and answer it."""
    client = Playback()
    values, address = fields.get("values"), fields.get("address")
    calls = {
        1: lambda: client.read_coils(address, fields["quantity"]),
        2: lambda: client.read_discrete_inputs(address, fields["quantity"]),
        3: lambda: client.read_holding_registers(address, fields["quantity"]),
        4: lambda: client.read_input_registers(address, fields["quantity"]),
        5: lambda: client.write_single_coil(address, fields["value"]),
        6: lambda: client.write_single_register(address, fields["value"]),
        15: lambda: client.write_multiple_coils(address, values),
        16: lambda: client.write_multiple_registers(address, values),
        0x17: lambda: client.write_read_multiple_registers(
            fields["write_address"], values, fields["read_address"], fields["read_quantity"]
        ),
        0x2B: lambda: client.read_device_identification(fields["read_code"], fields["object_id"]),
    }
    if reply is not None:
        client._recv_pdu = lambda min_len=2: received(client, reply, min_len)  # type: ignore[method-assign]
    result = calls[code]()
    if reply is not None and client.last_error == MB_EXCEPT_ERR:
        raise ExceptionAnswer(client.last_except)
    if reply is not None and (result is None or result is False):
        raise Refused(client.last_error_as_txt)
    return client.sent[7:], result


def received(client: Playback, pdu: bytes, min_len: int) -> bytes:
    """Return the reply as the client takes it from its connection, in the frame of its own request."""
    client.reply = client.sent[:4] + (1 + len(pdu)).to_bytes(2, "big") + client.sent[6:7] + pdu
    return ModbusClient._recv_pdu(client, min_len)


class Server:
    """The engine of the server, without its sockets: one table of each kind, from address 0 on."""

    def __init__(self, line: str, units: Units) -> None:
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


def crc(question: dict[str, Any]) -> dict[str, Any]:
    return crc_fields(utils.crc16(octets(question["bytes"])).to_bytes(2, "little"))


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
    pyModbusTCP.__version__,
    {
        **client_answers(call, CODES),
        **server_answers(Server, CODES, {"tcp"}),
        "client": {"run": client_runner("pyModbusTCP")},
        "crc16": {"encode": crc},
        "number": {"encode": encode_number, "decode": decode_number},
        "register-part": {"encode": encode_part, "decode": decode_part},
    },
)
