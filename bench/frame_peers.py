"""How other libraries read and build frames: the functions of each that do only this, without a port.

A reader takes the bytes of a whole answer and returns the registers, in the type of the library; a builder returns the
bytes of a request. A library without such functions (pyModbusTCP does both in its socket calls) takes part in the races
of `test_tcp` only. Imported names with an underscore are private names of those libraries.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

Reader = Callable[[bytes], Any]
Builder = Callable[[], bytes]

_FRAMERS = {"rtu": "FramerRTU", "ascii": "FramerAscii", "tcp": "FramerSocket"}


def _framer(envelope: str) -> Any:
    import pymodbus.framer
    from pymodbus.pdu import DecodePDU

    return getattr(pymodbus.framer, _FRAMERS[envelope])(DecodePDU(is_server=False))


def pymodbus(envelope: str, quantity: int) -> Reader:
    framer = _framer(envelope)

    def read(data: bytes) -> Any:
        _, pdu = framer.handleFrame(data, 0, 0)
        return pdu.registers

    return read


def pymodbus_builder(envelope: str) -> Builder:
    from pymodbus.pdu.register_message import ReadHoldingRegistersRequest

    framer = _framer(envelope)
    return lambda: framer.buildFrame(ReadHoldingRegistersRequest(address=107, count=10, dev_id=1, transaction_id=7))


def minimalmodbus(envelope: str, quantity: int) -> Reader:
    from minimalmodbus import _bytes_to_valuelist, _check_response_bytecount, _extract_payload

    def read(data: bytes) -> Any:
        payload = _extract_payload(data, 1, envelope, 3)
        _check_response_bytecount(payload)
        return _bytes_to_valuelist(payload[1:], quantity)

    return read


def minimalmodbus_builder(envelope: str) -> Builder:
    from minimalmodbus import _embed_payload, _num_to_two_bytes

    return lambda: _embed_payload(1, envelope, 3, _num_to_two_bytes(107) + _num_to_two_bytes(10))


def umodbus(envelope: str, quantity: int) -> Reader:
    if envelope == "tcp":
        from umodbus.client.tcp import parse_response_adu, read_holding_registers
    else:
        from umodbus.client.serial.rtu import parse_response_adu, read_holding_registers
    request = read_holding_registers(1, 0, quantity)
    sent = request[7:] if envelope == "tcp" else request
    return lambda data: parse_response_adu(data, sent)


def umodbus_builder(envelope: str) -> Builder:
    if envelope == "tcp":
        from umodbus.client.tcp import read_holding_registers
    else:
        from umodbus.client.serial.rtu import read_holding_registers
    return lambda: read_holding_registers(1, 107, 10)


def modbus_tk(envelope: str, quantity: int) -> Reader:
    if envelope == "tcp":
        from modbus_tk.modbus_tcp import TcpQuery as Query
    else:
        from modbus_tk.modbus_rtu import RtuQuery as Query
    query = Query()
    query.build_request(b"\x03\x00\x00\x00\x01", 1)
    if envelope == "tcp":
        query._request_mbap.transaction_id = 7

    def read(data: bytes) -> Any:
        pdu = query.parse_response(data)
        code, count = struct.unpack(">BB", pdu[:2])  # from here on as in modbus_tk's Master.execute
        if code > 0x80 or len(pdu[2:]) != count:
            raise ValueError
        return struct.unpack(">" + count // 2 * "H", pdu[2:])

    return read


def modbus_tk_builder(envelope: str) -> Builder:
    if envelope == "tcp":
        from modbus_tk.modbus_tcp import TcpQuery as Query
    else:
        from modbus_tk.modbus_rtu import RtuQuery as Query
    query = Query()
    return lambda: query.build_request(struct.pack(">BHH", 3, 107, 10), 1)


def tmodbus(envelope: str, quantity: int) -> Reader:
    """The functions that the protocol classes of tmodbus call for an answer, without the futures."""
    from tmodbus.pdu import ReadHoldingRegistersPDU

    pdu = ReadHoldingRegistersPDU(0, quantity)
    if envelope == "rtu":
        from tmodbus.utils.crc import validate_crc16

        def read(data: bytes) -> Any:
            if not validate_crc16(data) or data[0] != 1:
                raise ValueError
            return pdu.decode_response(data[1:-2])

        return read
    if envelope == "ascii":
        from tmodbus.transport.async_ascii import decode_ascii_frame, validate_ascii_frame

        def read_ascii(data: bytes) -> Any:
            raw = decode_ascii_frame(data)
            if not validate_ascii_frame(raw) or raw[0] != 1:
                raise ValueError
            return pdu.decode_response(raw[1:-1])

        return read_ascii

    def read_tcp(data: bytes) -> Any:
        _, protocol, length, unit = struct.unpack_from(">HHHB", data)
        if protocol or length + 6 != len(data) or unit != 1:
            raise ValueError
        return pdu.decode_response(data[7:])

    return read_tcp


def tmodbus_builder(envelope: str) -> Builder:
    from tmodbus.pdu import ReadHoldingRegistersPDU

    if envelope == "rtu":
        from tmodbus.utils.crc import calculate_crc16

        def build() -> bytes:
            body = bytes([1]) + ReadHoldingRegistersPDU(107, 10).encode_request()
            return body + calculate_crc16(body)

        return build
    if envelope == "ascii":
        from tmodbus.transport.async_ascii import build_ascii_frame

        return lambda: build_ascii_frame(1, ReadHoldingRegistersPDU(107, 10).encode_request())

    def build_tcp() -> bytes:
        pdu = ReadHoldingRegistersPDU(107, 10).encode_request()
        return struct.pack(">HHHB", 7, 0, len(pdu) + 1, 1) + pdu

    return build_tcp


READERS: dict[str, dict[str, Callable[[str, int], Reader]]] = {
    "rtu": {
        "pymodbus": pymodbus,
        "tmodbus": tmodbus,
        "minimalmodbus": minimalmodbus,
        "uModbus": umodbus,
        "modbus-tk": modbus_tk,
    },
    "ascii": {"pymodbus": pymodbus, "tmodbus": tmodbus, "minimalmodbus": minimalmodbus},
    "tcp": {"pymodbus": pymodbus, "tmodbus": tmodbus, "uModbus": umodbus, "modbus-tk": modbus_tk},
}
BUILDERS: dict[str, dict[str, Callable[[str], Builder]]] = {
    "rtu": {
        "pymodbus": pymodbus_builder,
        "tmodbus": tmodbus_builder,
        "minimalmodbus": minimalmodbus_builder,
        "uModbus": umodbus_builder,
        "modbus-tk": modbus_tk_builder,
    },
    "ascii": {"pymodbus": pymodbus_builder, "tmodbus": tmodbus_builder, "minimalmodbus": minimalmodbus_builder},
    "tcp": {
        "pymodbus": pymodbus_builder,
        "tmodbus": tmodbus_builder,
        "uModbus": umodbus_builder,
        "modbus-tk": modbus_tk_builder,
    },
}
