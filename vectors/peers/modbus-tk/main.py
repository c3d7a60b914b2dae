"""modbus-tk as an adapter: its masters on a line in virtual time, its frames and its checksum."""

from __future__ import annotations

from typing import Any
from unittest.mock import patch

from adapter import checksums, hexed, octets, serve
from adapter_client import ExceptionAnswer
from adapter_server import Units, server_answers
from client_line import clients, needs
from modbus_tk import defines, utils
from modbus_tk.exceptions import ModbusError
from modbus_tk.modbus import Databank
from modbus_tk.modbus_rtu import RtuMaster, RtuQuery
from modbus_tk.modbus_tcp import TcpMaster, TcpQuery

KINDS = {
    "coils": defines.COILS,
    "discrete_inputs": defines.DISCRETE_INPUTS,
    "holding_registers": defines.HOLDING_REGISTERS,
    "input_registers": defines.ANALOG_INPUTS,
}
CODES = {1, 2, 3, 4, 5, 6, 15, 16, 0x16, 0x17}


def connect(line: Any, patches: Any) -> Any:
    """Return the function that asks."""
    needs(line, "rtu", "tcp")
    timeout = line.timeout
    if line.is_serial:
        patches.enter_context(patch("modbus_tk.modbus_rtu.time", line))
        master: Any = RtuMaster(line)
    else:
        patches.enter_context(patch("modbus_tk.utils.select", line))
        patches.enter_context(patch("socket.socket", lambda *_: line))
        master = TcpMaster("virtual", timeout_in_sec=timeout)
    master.set_timeout(timeout)

    def ask(unit: int, code: int, fields: dict[str, Any]) -> Any:
        address, values = fields.get("address", fields.get("read_address")), fields.get("values")
        more: dict[str, Any] = {"quantity_of_x": fields.get("quantity", fields.get("read_quantity", 0))}
        if values is not None or "value" in fields:
            more["output_value"] = int(fields["value"]) if values is None else values
        if code == 0x16:
            more = {"and_mask": fields["and_mask"], "or_mask": fields["or_mask"]}
        if code == 0x17:
            more["write_starting_address_fc23"] = fields["write_address"]
        try:
            return master.execute(unit, code, address, **more)
        except ModbusError as error:
            raise ExceptionAnswer(error.get_exception_code()) from None

    return ask


class Server:
    """A databank of modbus-tk, asked with its own frames."""

    def __init__(self, line: str, units: Units, _described: object) -> None:
        self.query = {"rtu": RtuQuery, "tcp": TcpQuery}[line]
        self.bank = Databank(error_on_missing_slave=False)
        for unit, tables in units.items():
            slave = self.bank.add_slave(unit)
            for table, blocks in tables.items():
                for first, row in blocks.items():
                    slave.add_block(f"{table} {first}", KINDS[table], first, len(row))
                    slave.set_values(f"{table} {first}", first, row)

    def ask(self, unit: int, pdu: bytes) -> bytes | None:
        asked = self.query()
        answer = self.bank.handle_request(self.query(), asked.build_request(pdu, unit))
        return asked.parse_response(answer) if answer else None

    def values(self, unit: int, table: str, first: int, count: int) -> list[int]:
        return list(self.bank.get_slave(unit).get_values(f"{table} {first}", first, count))


def encode_rtu(question: dict[str, Any]) -> dict[str, Any]:
    return {"frame": hexed(RtuQuery().build_request(octets(question["pdu"]), question["unit"]))}


def decode_rtu(question: dict[str, Any]) -> dict[str, Any]:
    unit, pdu = RtuQuery().parse_request(octets(question["frame"]))
    return {"unit": unit, "pdu": hexed(pdu)}


def encode_tcp(question: dict[str, Any]) -> dict[str, Any]:
    query = TcpQuery()
    query._get_transaction_id = lambda: question["transaction"]
    return {"frame": hexed(query.build_request(octets(question["pdu"]), question["unit"]))}


def decode_tcp(question: dict[str, Any]) -> dict[str, Any]:
    query = TcpQuery()
    unit, pdu = query.parse_request(octets(question["frame"]))
    return {"transaction": query._request_mbap.transaction_id, "unit": unit, "pdu": hexed(pdu)}


serve(
    "modbus-tk",
    {
        **clients(connect, CODES, "tcp"),
        **server_answers(Server, {*CODES, 7}, {"rtu", "tcp"}),
        "rtu-frame": {"encode": encode_rtu, "decode": decode_rtu},
        "tcp-frame": {"encode": encode_tcp, "decode": decode_tcp},
        **checksums(lambda data: utils.calculate_crc(data).to_bytes(2, "big")),
    },
)
