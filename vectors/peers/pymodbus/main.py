"""pymodbus as an adapter: its messages, its three framers, its checksums, its numbers in registers."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from typing import Any
from unittest.mock import patch

from adapter import (
    FIELDS,
    NotOffered,
    Refused,
    bits,
    bitted,
    checksums,
    hexed,
    number,
    octets,
    register_bytes,
    registers,
    serve,
    worded,
    words,
)
from adapter_client import ExceptionAnswer, given
from adapter_server import Units, server_answers
from client_line import needs, over_time
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.client.mixin import ModbusClientMixin
from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.framer import FramerAscii, FramerRTU, FramerSocket, FramerType
from pymodbus.pdu import DecodePDU, ExceptionResponse
from pymodbus.pdu.device import ModbusControlBlock, ModbusDeviceIdentification
from pymodbus.pdu.file_message import FileRecord
from pymodbus.server import ModbusTcpServer

DECODERS = {"request": DecodePDU(is_server=True), "response": DecodePDU(is_server=False)}
NAMES = {  # our name of a field -> theirs; others have the same one
    "quantity": "count",
    "read_quantity": "read_count",
    "message_count": "message_count",
    "next_object": "next_object_id",
}
SHORT = {"coils": "co", "discrete_inputs": "di", "holding_registers": "hr", "input_registers": "ir"}
SILENCE = 0.3
"""Seconds after which a server that does not answer is silent."""
CODES = {1, 2, 3, 4, 5, 6, 0x0F, 0x10, 0x16, 0x17}
FRAMERS = {"rtu-frame": FramerRTU, "ascii-frame": FramerAscii, "tcp-frame": FramerSocket}


def class_of(side: str, code: bytes, sub_function: int | None = None) -> Any:
    """Return the class of a message."""
    found = DecodePDU.pdu_table.get(code[0])
    if code[0] in (0x08, 0x2B):
        found = DecodePDU.pdu_sub_table[code[0]].get(code[1] if sub_function is None else sub_function)
    if found is None:
        raise NotOffered("pymodbus has no such function")
    return found[side == "response"]


def encode_pdu(question: dict[str, Any]) -> dict[str, Any]:
    code, message, side = octets(question["function"]), dict(question["message"]), question["side"]
    if code[0] >= 0x80:
        if "exception_code" not in message:
            raise NotOffered("pymodbus has no extended exceptions")
        made: Any = ExceptionResponse(code[0] & 0x7F, message["exception_code"])
        return {"pdu": hexed(bytes([made.function_code]) + made.encode())}
    kind = class_of(side, code, message.get("sub_function"))
    fields: dict[str, Any] = {NAMES.get(name, name): value for name, value in message.items()}
    if code[0] == 0x08:
        fields = {"message": octets(message["data"])}
    elif code[0] in (0x05, 0x06):
        fields |= {"bits": [fields.pop("value")]} if code[0] == 0x05 else {"registers": [fields.pop("value")]}
    elif code[0] in (0x0B, 0x0C) and side == "response":
        fields["status"] = {0: True, 0xFFFF: False}[fields["status"]]
        fields |= {"count": fields.pop("event_count")} if code[0] == 0x0B else {"events": octets(fields["events"])}
    elif code[0] == 0x11 and side == "response":
        data = octets(fields.pop("data"))
        if data[-1:] not in (b"\x00", b"\xff"):
            raise NotOffered("pymodbus ends the data with a status of 00 or FF")
        fields = {"identifier": data[:-1], "status": data[-1] == 0xFF}
    elif code[0] == 0x14 and side == "request":
        rows = [FileRecord(row["file"], row["record"], record_length=2 * row["length"]) for row in fields.pop("places")]
        fields = {"records": rows}
    elif code[0] == 0x14:
        fields["records"] = [FileRecord(record_data=octets(register_bytes(words(row)))) for row in fields["records"]]
    elif code[0] == 0x15:
        fields["records"] = [
            FileRecord(row["file"], row["record"], octets(register_bytes(words(row["registers"]))))
            for row in fields["records"]
        ]
    elif code[0] == 0x2B and side == "response":
        made = kind(fields["read_code"], {row["id"]: octets(row["value"]) for row in fields["objects"]})
        made.conformity, made.next_object_id = fields["conformity"], fields["next_object_id"]
        made.more_follows = 0xFF if fields["more_follows"] else 0
        return {"pdu": hexed(bytes([made.function_code]) + made.encode())}
    if isinstance(fields.get("bits"), str):
        fields["bits"] = bits(fields["bits"])
    if isinstance(fields.get("registers"), str):
        fields["values" if code[0] == 0x18 else "registers"] = words(fields.pop("registers"))
    if code[0] == 0x17 and side == "request":
        fields["write_registers"] = fields.pop("registers")
    made = kind(**fields)
    return {"pdu": hexed(bytes([made.function_code]) + made.encode())}


def decode_pdu(question: dict[str, Any]) -> dict[str, Any]:
    return answer_of(question["side"], octets(question["pdu"]))


def answer_of(side: str, pdu: bytes) -> dict[str, Any]:
    """Return the function and the fields of a message."""
    if pdu and pdu[0] < 0x80:
        class_of(side, pdu[:2] + b"\0\0", int.from_bytes(pdu[1:3], "big") if pdu[0] == 0x08 else None)
    found: Any = DECODERS[side].decode(pdu)
    if found is None:
        raise Refused("None")
    code, is_request = found.function_code, side == "request"
    message: dict[str, Any] = {"function_code": code, "exception_code": found.exception_code}
    match code:
        case _ if (is_request or code == 0x16) and code not in (0x05, 0x06, 0x08, 0x14, 0x15) and code < 0x80:
            theirs = NAMES | ({"registers": "write_registers"} if code == 0x17 else {})
            shown = {"bits": bitted, "registers": worded}
            values = {name: getattr(found, theirs.get(name, name)) for name in FIELDS.get(code, ())}
            message = {name: shown.get(name, lambda value: value)(value) for name, value in values.items()}
        case 0x01 | 0x02:
            message = {"bits": bitted(found.bits)}
        case 0x03 | 0x04:
            message = {"registers": worded(found.registers)}
        case 0x05 | 0x06:
            message = {"address": found.address, "value": found.bits[0] if code == 5 else found.registers[0]}
        case 0x0F | 0x10:
            message = {"address": found.address, "quantity": found.count}
        case 0x07:
            message = {"status": found.status}
        case 0x08:
            data = found.message
            data = (
                data if isinstance(data, bytes) else octets(register_bytes([data] if isinstance(data, int) else data))
            )
            message = {"sub_function": found.sub_function_code, "data": hexed(data)}
        case 0x0B:
            message = {"status": 0 if found.status else 0xFFFF, "event_count": found.count}
        case 0x0C:
            message = {"status": 0 if found.status else 0xFFFF, "event_count": found.event_count}
            message |= {"message_count": found.message_count, "events": hexed(found.events)}
        case 0x11:
            message = {"data": hexed(found.identifier + (b"\xff" if found.status else b"\x00"))}
        case 0x14 if is_request:
            rows = [(row.file_number, row.record_number, row.record_length) for row in found.records]
            message = {"places": [dict(zip(("file", "record", "length"), row)) for row in rows]}
        case 0x14:
            message = {"records": [worded(registers(row.record_data)) for row in found.records]}
        case 0x15:
            rows = [(row.file_number, row.record_number, worded(registers(row.record_data))) for row in found.records]
            message = {"records": [dict(zip(("file", "record", "registers"), row)) for row in rows]}
        case 0x17:
            message = {"registers": worded(found.registers)}
        case 0x18:
            message = {"registers": worded(found.values)}
        case 0x2B:
            message = {"read_code": found.read_code, "conformity": found.conformity}
            message |= {"more_follows": found.more_follows == 0xFF, "next_object": found.next_object_id}
            message["objects"] = [{"id": name, "value": hexed(value)} for name, value in found.information.items()]
    return {"function": hexed(pdu[: 2 if pdu[0] == 0x2B else 1]), "message": message}


def encode_frame(question: dict[str, Any]) -> dict[str, Any]:
    framer = FRAMERS[question["kind"]](DECODERS["request"])
    frame = framer.encode(octets(question["pdu"]), question["unit"], question.get("transaction", 0))
    return {"text": frame.decode("latin-1")} if question["kind"] == "ascii-frame" else {"frame": hexed(frame)}


def decode_frame(question: dict[str, Any]) -> dict[str, Any]:
    data = question["text"].encode("latin-1") if question["kind"] == "ascii-frame" else octets(question["frame"])
    if question["kind"] == "rtu-frame":
        knows(data)
        # request or response: only the length tells
        found = [read(FramerRTU(decoder), data) for decoder in DECODERS.values()]
        frame = next((frame for frame in found if frame and len(frame["pdu"].split()) == len(data) - 3), None)
    else:
        frame = read(FRAMERS[question["kind"]](DECODERS["request"]), data)
    if frame is None:
        raise Refused("no frame")
    return frame if question["kind"] == "tcp-frame" else {"unit": frame["unit"], "pdu": frame["pdu"]}


def knows(data: bytes) -> None:
    """Raise NotOffered for a function whose frames pymodbus cannot delimit."""
    if len(data) > 1 and not any(decoder.lookupPduClass(data + bytes(4)) for decoder in DECODERS.values()):
        raise NotOffered("pymodbus does not know the function, and has no class of messages for it")


def read(framer: Any, data: bytes) -> dict[str, Any] | None:
    """Return the first frame in some bytes."""
    _used, unit, transaction, pdu = framer.decode(data)
    return {"transaction": transaction, "unit": unit, "pdu": hexed(pdu)} if pdu else None


def receive(question: dict[str, Any]) -> dict[str, Any]:
    if question["kind"] == "rtu-frame":
        knows(octets(" ".join(question["pieces"]).removeprefix("FF 00 07 ")))
    return received(question["kind"], question["side"], question["pieces"])


def talk(question: dict[str, Any]) -> dict[str, Any]:
    kind, line, steps = question["kind"].replace("talk", "frame"), question["line"], question["talk"]
    if line.get("role") == "listener" or line.get("patience", 0) is None:
        raise NotOffered("pymodbus counts bytes, and hears one side")
    longest = {"rtu-frame": line.get("patience"), "ascii-frame": line.get("timeout")}.get(kind)
    pauses = [after["at"] - before["at"] for before, after in pairwise(steps)]
    if longest and any(pause > longest for pause in pauses) and line.get("role") != "client":
        raise NotOffered("a server of pymodbus knows no time")
    if kind == "rtu-frame":
        knows(octets(" ".join(step.get("hear", "") for step in steps)))
    side = "response" if line.get("role") == "client" else "request"
    return received(kind, side, [step["hear"] for step in steps if "hear" in step])


def received(kind: str, side: str, pieces: list[str]) -> dict[str, Any]:
    """Return the frames that come out of pieces."""
    framer = FRAMERS[kind](DECODERS[side])
    frames, buffer = [], b""
    for piece in pieces:
        buffer += piece.encode("latin-1") if kind == "ascii-frame" else octets(piece)
        while buffer:
            used, unit, transaction, pdu = framer.decode(buffer)
            buffer = buffer[used:]
            if pdu:
                first = {"transaction": transaction} if kind == "tcp-frame" else {}
                frames.append({**first, "unit": unit, "pdu": hexed(pdu)})
            if not used or not pdu:
                break
    return {"frames": frames}


CALLS = {
    **{1: "read_coils", 2: "read_discrete_inputs", 3: "read_holding_registers", 4: "read_input_registers"},
    **{5: "write_coil", 6: "write_register", 15: "write_coils", 16: "write_registers"},
}


def connect(line: Any, patches: Any) -> Any:
    """Return the function that asks."""
    needs(line, "rtu", "ascii", "tcp", retries=True, echo=True)
    settings: dict[str, Any] = {"timeout": line.timeout, "retries": line.setup["retries"]}
    patches.enter_context(patch("pymodbus.transaction.transaction.monotonic", line.monotonic))
    if line.is_serial:
        patches.enter_context(patch("pymodbus.client.serial.time", line))
        patches.enter_context(patch("serial.serial_for_url", lambda *_, **__: line))
        framer = FramerType.RTU if line.setup["framing"] == "rtu" else FramerType.ASCII
        settings |= {"handle_local_echo": "echo" in line.setup, "framer": framer, "baudrate": line.baudrate}
        client: Any = ModbusSerialClient("virtual", **settings)
    else:
        patches.enter_context(patch("pymodbus.client.tcp.time", line))
        patches.enter_context(patch("pymodbus.client.tcp.select", line))
        patches.enter_context(patch("socket.create_connection", lambda *_, **__: line))
        client = ModbusTcpClient("virtual", **settings)
    client.connect()

    def ask(unit: int, code: int, fields: dict[str, Any]) -> Any:
        address, what = given(code, fields)
        how = {"count": what} if code <= 4 else {"no_response_expected": unit == 0 and line.is_serial}
        arguments = (address,) if code <= 4 else (address, what)
        response = getattr(client, CALLS[code])(*arguments, device_id=unit, **how)
        if response is None or not response.isError():
            return response and (response.bits[: fields.get("quantity", 0)] if code <= 2 else response.registers)
        raise ExceptionAnswer(response.exception_code)

    return ask


def data_type(question: dict[str, Any]) -> tuple[Any, Any]:
    """Return their type of a number, and their order of its words."""
    kind = {"u": "UINT", "i": "INT", "f": "FLOAT"}[question["type"][0]] + question["type"][1:]
    order = {"ABCD": "big", "CDAB": "little"}.get(question["order"])
    if order is None or kind not in ModbusClientMixin.DATATYPE.__members__:
        raise NotOffered("pymodbus swaps words, not bytes, and has numbers of 16, 32 and 64 bits")
    return ModbusClientMixin.DATATYPE[kind], order


def encode_number(question: dict[str, Any]) -> dict[str, Any]:
    kind, order = data_type(question)
    value = number(question["value"])
    return {"bytes": register_bytes(ModbusClientMixin.convert_to_registers(value, kind, order))}


def decode_number(question: dict[str, Any]) -> dict[str, Any]:
    kind, order = data_type(question)
    data = octets(question["bytes"])
    if len(data) % 2:
        raise NotOffered("pymodbus reads whole registers")
    return {"value": str(ModbusClientMixin.convert_from_registers(registers(data), kind, order))}


class Server:
    """A server of pymodbus, asked in RTU or TCP frames over a connection to this machine."""

    def __init__(self, line: str, units: Units, described: dict[int, Any]) -> None:
        self.framer, self.tables = FRAMERS[f"{line}-frame"], units
        names = {
            int(name, 16): octets(text)
            for unit in described.values()
            for name, text in unit.get("identification", {}).items()
        }
        ModbusControlBlock()._identity = ModbusDeviceIdentification(info=names)  # of all servers in a process
        self.loop = asyncio.new_event_loop()
        blocks = {
            unit: ModbusDeviceContext(
                **{SHORT[name]: block_of(name, rows) for name, rows in tables.items()},
            )
            for unit, tables in units.items()
        }
        framer = {"rtu": FramerType.RTU, "ascii": FramerType.ASCII, "tcp": FramerType.SOCKET}[line]
        self.loop.run_until_complete(self.start(ModbusServerContext(blocks), framer))

    async def start(self, context: ModbusServerContext, framer: FramerType) -> None:
        self.server = ModbusTcpServer(context, framer=framer, address=("127.0.0.1", 0), ignore_missing_devices=True)
        await self.server.listen()
        port = self.server.transport.sockets[0].getsockname()[1]  # type: ignore[union-attr]
        self.reader, self.writer = await asyncio.open_connection("127.0.0.1", port)

    def ask(self, unit: int, pdu: bytes) -> bytes | None:
        return self.loop.run_until_complete(self.asked(unit, pdu))

    async def asked(self, unit: int, pdu: bytes) -> bytes | None:
        self.writer.write(self.framer(DECODERS["request"]).encode(pdu, unit, 1))
        try:
            answer = await asyncio.wait_for(self.reader.read(1024), SILENCE)
        except TimeoutError:
            return None
        found = read(self.framer(DECODERS["response"]), answer)
        if found is None or found["unit"] != unit:
            raise Refused(f"an answer of another unit: {hexed(answer)}")
        return octets(found["pdu"])

    def values(self, unit: int, table: str, first: int, count: int) -> list[int]:
        code = {"coils": 1, "discrete_inputs": 2, "holding_registers": 3, "input_registers": 4}[table]
        found = self.loop.run_until_complete(self.server.context.async_getValues(unit, code, first, count))
        if not isinstance(found, list):
            raise Refused(str(found))
        return [int(value) for value in found]

    def close(self) -> None:
        """Close the connection and the server."""
        self.writer.close()
        self.loop.run_until_complete(self.server.shutdown())
        self.loop.close()


def block_of(name: str, rows: dict[int, list[int]]) -> ModbusSequentialDataBlock:
    """Return the block of a table, which begins one before the address that it is given."""
    if len(rows) > 1:
        raise NotOffered("a sequential block has no gap")
    ((first, values),) = rows.items()
    if name in ("coils", "discrete_inputs") and len(values) % 16:
        raise NotOffered("bits are kept in whole registers: there would be more of them")
    return ModbusSequentialDataBlock(first + 1, list(values))


FRAME = {"encode": encode_frame, "decode": decode_frame, "receive": receive}
serve(
    "pymodbus",
    {
        **server_answers(Server, {*CODES, 0x2B}, {"rtu", "ascii", "tcp"}, {"identification"}),
        "pdu": {"encode": encode_pdu, "decode": decode_pdu},
        "rtu-frame": FRAME,
        "ascii-frame": FRAME,
        "tcp-frame": FRAME,
        **{kind: {"frames": talk} for kind in ("rtu-talk", "ascii-talk", "tcp-talk")},
        **over_time(connect),
        **checksums(lambda data: FramerRTU.compute_CRC(data).to_bytes(2, "big"), FramerAscii.compute_LRC),
        "number": {"encode": encode_number, "decode": decode_number},
    },
)
