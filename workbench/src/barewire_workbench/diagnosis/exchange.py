"""What is wrong with a response, given its request: another unit, function or length; an address, a word order.

    request    01 04 0F B1 00 02 22 F8       2 input registers from 0FB1h
    response   01 04 04 00 00 42 48 CB 12    0000h 4248h: as a float 2.4e-41, and with the words exchanged 50.0

The request must be a good frame. What a frame says by itself, as a wrong CRC, is found without the request too.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from barewire.ascii import frame as ascii_frame
from barewire.codecs import ORDERS, Number
from barewire.codecs.order import Order
from barewire.devices import Device
from barewire.errors import DecodeError
from barewire.modbus.adu import Adu
from barewire.modbus.exceptions import ILLEGAL_DATA_ADDRESS, ModbusException
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import decode_request, measure_response, response_class
from barewire.rtu import frame as rtu_frame
from barewire.rtu.crc import crc16
from barewire.rtu.frame import encode
from barewire.tcp import frame as tcp_frame
from barewire_workbench.diagnosis.ascii import diagnose_ascii
from barewire_workbench.diagnosis.good import (
    digits,
    good_ascii,
    good_body,
    good_rtu,
    good_tcp,
    proof_of,
    without_checksum,
)
from barewire_workbench.diagnosis.rtu import diagnose_rtu
from barewire_workbench.diagnosis.tcp import diagnose_tcp
from barewire_workbench.frames.findings import DiagnosisCode, Finding
from barewire_workbench.frames.modbus import explain_ascii, explain_pdu, explain_rtu, explain_tcp
from barewire_workbench.frames.result import Explanation, FrameRole, ProtocolName, counted
from barewire_workbench.sniffer import RequestSeen, ResponseSeen

_DIAGNOSES = {"rtu": diagnose_rtu, "ascii": diagnose_ascii, "tcp": diagnose_tcp}


def with_diagnosis(explanation: Explanation, data: bytes, role: FrameRole | None = None) -> Explanation:
    """Return the explanation of a Modbus frame with what is wrong with it; a good one gets a note if its address looks
    like the number of a manual.

    `role` is the direction that the caller gave, None if it was guessed.
    """
    if explanation.valid:
        return replace(explanation, notes=tuple(_number_notes(explanation)))
    found = tuple(_DIAGNOSES[explanation.protocol](data, role))
    if explanation.protocol == "rtu" and found and found[0].code != "crc-missing":
        explanation = explain_rtu(data, role, bare=False)
    return replace(explanation, diagnosis=found)


_DECODERS: dict[ProtocolName, Callable[[bytes], Adu]] = {
    "rtu": rtu_frame.decode,
    "ascii": ascii_frame.decode,
    "tcp": tcp_frame.decode,
}
_EXPLAINERS: dict[ProtocolName, Callable[[bytes, FrameRole | None], Explanation]] = {
    "rtu": explain_rtu,
    "ascii": lambda data, role: explain_ascii(data, role, typed=True),
    "tcp": explain_tcp,
}
_GOOD: dict[ProtocolName, Callable[[bytes], Explanation | None]] = {
    "rtu": good_rtu,
    "ascii": good_ascii,
    "tcp": good_tcp,
}

_TABLES = {
    10000: ("discrete input", (0x02,)),
    30000: ("input register", (0x04,)),
    40000: ("holding register", (0x03, 0x06, 0x10, 0x16, 0x17)),
}
"""The numbers of manuals: 40001 to 49999 are the holding registers with the addresses 0 to 9998, and so on."""

_REPEATING = {0x05, 0x06, 0x08, 0x0F, 0x10, 0x16}
"""The functions whose response begins like the request, so that a cut response is no echo."""

_SHORTEST_ECHO, _SHORTEST_DAMAGED_ECHO = 4, 6
"""Bytes of a cut echo, without and with one wrong byte among them."""

_PLAUSIBLE = 1e-6, 1e9
"""A float between these is plausible, and 0. A number whose words are exchanged has a random exponent."""


class ExpectedValue(NamedTuple):
    """A value that the response is expected to have: its name, the first of its registers, its type and order.

    `register` counts from the first one of the response. `minimum` and `maximum` are the limits of the value, if known.
    """

    name: str
    register: int
    type: str
    order: Order = "ABCD"
    minimum: float | None = None
    maximum: float | None = None


def diagnose_exchange(
    protocol: ProtocolName,
    request: bytes,
    response: bytes,
    values: Sequence[ExpectedValue] = (),
    known: Container[int] = (),
) -> list[Finding]:
    """Return what is wrong with a response to a request, the likeliest first; nothing if it answers it.

    >>> request, response = bytes.fromhex("01 03 9C 41 00 01 FA 4E"), bytes.fromhex("01 83 02 C0 F1")
    >>> diagnose_exchange("rtu", request, response)[0].text
    '9C41h is 40001, the number that manuals give the holding register with the address 0000h'

    `values` are what the registers of the response mean, and `known` the addresses that the device has, as far as they
    are known. A broken response has no finding here; those of a broken request are returned.
    """
    asked = with_diagnosis(_EXPLAINERS[protocol](request, "request"), request, "request")
    if not asked.valid:
        return [finding._replace(text=f"in the request: {finding.text}") for finding in asked.diagnosis]
    if response != request and response.startswith(request):
        rest = response[len(request) :]
        if (good := _GOOD[protocol](rest)) is not None:
            proof = f"{_shown(protocol, request)} is the request; {proof_of(rest, good)}"
            return [Finding("echo", "the reader has read its own request before the response", proof)]
    if protocol == "rtu" and (cut := _cut_echo(request, response)) is not None:
        return [cut]
    if protocol == "rtu" and (noise := _before_answer(request, response)) is not None:
        return [noise]
    try:
        sent, received = decoded(protocol, request), decoded(protocol, response)
    except DecodeError:
        return []
    return list(_exchange(asked, sent, received, values, known))


def decoded(protocol: ProtocolName, data: bytes) -> Adu:
    """Decode a frame; an ASCII frame may lack its CR LF. Raises DecodeError."""
    if protocol == "ascii" and not data.endswith(ascii_frame.END):
        data = data.rstrip(ascii_frame.END) + ascii_frame.END
    return _DECODERS[protocol](data)


def cannot_answer(protocol: ProtocolName, request: bytes, response: bytes) -> Iterator[Finding]:
    """Say why a response whose framing is intact answers no request of this function."""
    try:
        sent, received = decoded(protocol, request), decoded(protocol, response)
    except DecodeError:
        return
    try:
        decode_request(sent.pdu).read_response(received.pdu)
    except ModbusException:
        return
    except DecodeError as error:
        asked = explain_pdu(sent.pdu, "request")
        if asked.error is None and asked.role is not None and error.reason != "function":
            yield Finding("wrong-answer", f"this cannot be the response: {error.text}", f"asked: {asked.summary}")


def _before_answer(request: bytes, response: bytes) -> Finding | None:
    """The answer begins behind some bytes that belong to none, and the reader stopped before its end.

    A reader that waits for as many bytes as the answer has counts the bytes before it too.
    """
    for first in range(1, min(len(response) - 4, 4)):
        rest = response[first:]
        if rest[:1] != request[:1] or rest[1] & ~EXCEPTION_BIT != request[1]:
            continue
        size = measure_response(rest[1:])
        if size is None or not 1 + size <= len(rest) <= 2 + size:
            continue
        good = good_body(rest[: 1 + size], "response")
        if (
            good is not None
            and rest[1 + size :] == crc16(rest[: 1 + size]).to_bytes(2, "little")[: len(rest) - 1 - size]
        ):
            text = f"{counted(first)} before the response: {digits(response[:first])}"
            cut = f"its last {counted(3 + size - len(rest))} not read"
            return Finding("noise-before", text, f"{digits(rest)} is {without_checksum(good)}, {cut}")
    return None


def _cut_echo(request: bytes, response: bytes) -> Finding | None:
    """The beginning of the request, with one wrong byte at most: a reader stops when it has as many as it expects."""
    differing = sum(sent != read for sent, read in zip(request, response))
    shortest = _SHORTEST_DAMAGED_ECHO if differing else _SHORTEST_ECHO
    if request[1] in _REPEATING or differing > 1 or not shortest <= len(response) < len(request):
        return None
    damaged = ", one of them disturbed" if differing else ""
    text = f"the reader has read the first {counted(len(response))} of its own request{damaged}"
    return Finding("echo", text, f"{digits(request)} is the request")


def _shown(protocol: ProtocolName, data: bytes) -> str:
    return data.decode("latin-1").rstrip() if protocol == "ascii" else digits(data)


def _exchange(
    asked: Explanation, sent: Adu, received: Adu, values: Sequence[ExpectedValue], known: Container[int]
) -> Iterator[Finding]:
    proof = f"asked: {asked.summary}"

    def wrong(text: str) -> Finding:
        return Finding("wrong-answer", text, proof)

    if sent.transaction != received.transaction and received.transaction is not None and sent.transaction is not None:
        if received.transaction == int.from_bytes(sent.transaction.to_bytes(2, "big"), "little"):
            text = "the transaction number has its bytes exchanged; the response repeats it as it is"
            yield Finding(
                "header-byte-order", text, f"{sent.transaction:04X}h asked, {received.transaction:04X}h answered"
            )
        else:
            yield wrong(f"transaction {received.transaction} answers, and {sent.transaction} was asked")
    if sent.transaction is None and sent.unit == 0:
        yield wrong("a broadcast has no response")
        return
    if sent.unit != received.unit:
        refusal = explain_pdu(received.pdu, "response").summary if received.pdu[0] & EXCEPTION_BIT else ""
        said = f", with {refusal}" if refusal else ""
        if not received.pdu[0]:
            said = " with function 00, which is none of Modbus"
        yield wrong(f"unit {received.unit} answers{said}, and unit {sent.unit} was asked")
    if sent.pdu == received.pdu and _never_echoes(sent.pdu):
        text = "this is the request, not a response: the reader has read what it sent"
        yield Finding("echo", text, f"{digits(sent.pdu)} is the PDU of both")
        return
    if sent.pdu[0] != received.pdu[0] & ~EXCEPTION_BIT:
        answered = explain_pdu(received.pdu, "response").summary
        yield wrong(f"function {received.pdu[0]:02X} answers, and {sent.pdu[0]:02X} was asked: {answered}")
        return
    try:
        decode_request(sent.pdu).read_response(received.pdu)
    except ModbusException as error:
        if error.code == ILLEGAL_DATA_ADDRESS:
            yield from _address_base(sent.pdu, known)
    except DecodeError as error:
        is_answer = (sent.unit, sent.transaction) == (received.unit, received.transaction)
        count = other_count(sent.pdu, received.pdu) if is_answer else ""
        if count:
            yield wrong(f"the device sent {count}: {_count_causes(sent, received)}")
        elif error.reason == "mismatch":
            yield wrong(f"the response is to another request: {error.text}")
    else:
        yield from _word_order(received.pdu, values)


_REGISTERS, _BITS = (0x03, 0x04, 0x17), {0x01: "coil", 0x02: "discrete input"}


def other_count(request: bytes, response: bytes) -> str:
    """Return how many registers or bytes a whole response has, and how many were asked; empty if the numbers are equal.

    >>> other_count(bytes.fromhex("03 0010 0002"), bytes.fromhex("03 06 0017 0007 0009"))
    '3 registers where 2 were asked'
    """
    function = request[0]
    if function != response[0] or (function not in _REGISTERS and function not in _BITS) or len(request) < 5:
        return ""
    quantity, size = int.from_bytes(request[3:5], "big"), len(response) - 2
    if size < 1 or response[1] != size or (function in _REGISTERS and size % 2):
        return ""  # an empty or a broken response
    asked, sent = (quantity, size // 2) if function in _REGISTERS else ((quantity + 7) // 8, size)
    if asked == sent:
        return ""
    unit = "register" if function in _REGISTERS else "byte"
    text = f"{counted(sent, unit)} where {asked} {'was' if asked == 1 else 'were'} asked"
    return f"{text}, for {counted(quantity, _BITS[function])}" if function in _BITS else text


def _count_causes(sent: Adu, received: Adu) -> str:
    """Return what another count than asked may come from; a transaction of TCP rules out a late response."""
    causes = ["another type", "a wrong count"]
    if sent.pdu[0] in _REGISTERS and received.pdu[1] > 2 * int.from_bytes(sent.pdu[3:5], "big"):
        causes.insert(0, "longer registers")
    if sent.transaction is None:
        causes.append("a late response to an earlier request")
    return f"{', '.join(causes[:-1])}, or {causes[-1]}"


def _never_echoes(pdu: bytes) -> bool:
    """Return whether no response of this function can be equal to this request."""
    message = response_class(pdu)
    try:
        return message is None or not message.decode(pdu)
    except DecodeError:
        return True


def _address_base(pdu: bytes, known: Container[int]) -> Iterator[Finding]:
    """An address that is the number of a manual, refused with exception 02."""
    address = int.from_bytes(pdu[1:3], "big")
    if not any(pdu[0] in functions for _, functions in _TABLES.values()) or address in known:
        return
    for base, (what, functions) in _TABLES.items():
        sent = address - base - 1
        if 0 <= sent < 9999 and (pdu[0] in functions or base == 40000):  # others are addresses of many devices, too
            text = f"{address:04X}h is {address}, the number that manuals give the {what} with the address {sent:04X}h"
            other = "" if pdu[0] in functions else f"; function {functions[0]:02X} reads it"
            proof = f"exception 02 to address {address:04X}h; {address} - {base + 1} = {sent}{other}"
            yield Finding("address-base", text, proof)
    if address - 1 in known:
        text = f"the addresses count from 0: what a manual calls {address} has the address {address - 1:04X}h"
        proof = f"exception 02 to address {address:04X}h, which the device does not have; it has {address - 1:04X}h"
        yield Finding("address-base", text, proof)


def _number_notes(explanation: Explanation) -> Iterator[Finding]:
    """A good request for an address that manuals give as the number of a register of its table."""
    values = {field.name: field.value for field in explanation.fields}
    function, address = values.get("function code"), values.get("address")
    if explanation.role != "request" or not isinstance(address, int):
        return
    for base, (what, functions) in _TABLES.items():
        if function in functions and 1 <= address - base <= 9999:
            sent = address - base - 1
            text = f"if {address} is the manual's number of the {what}, send {sent}"
            yield Finding("address-base", text, f"{address:04X}h is {address}; {address} - {base + 1} = {sent}")


def _word_order(pdu: bytes, values: Sequence[ExpectedValue]) -> Iterator[Finding]:
    """Floats, or numbers with limits, that are plausible in one of the other orders only."""
    registers = pdu[2:] if pdu[0] in (0x03, 0x04, 0x17) else b""
    for value in values:
        size = Number(value.type).size
        data = registers[2 * value.register : 2 * value.register + size]
        if size < 4 or len(data) < size:
            continue
        read = {order: float(Number(value.type, order).decode(data)) for order in ORDERS}
        likely = [order for order in ORDERS if _is_likely(read[order], value)]
        if value.order in likely or not likely:
            continue
        likely.sort(key=lambda order: len(f"{read[order]:.7g}"))
        shown = ", ".join(f"{order} {read[order]:.6g}" for order in ORDERS)
        numbers = f"{read[value.order]:.6g} in the order {value.order}, and {read[likely[0]]:.6g} in {likely[0]}"
        text = f"{value.name} is {numbers}"
        yield Finding("word-order", text, f"{digits(data)}: {shown}; plausible: {', '.join(likely)}")


def is_plausible(number: float) -> bool:
    """Return whether a float is one that a device has: 0, or neither tiny nor huge."""
    least, most = _PLAUSIBLE
    return number == 0 or least <= abs(number) <= most


def _is_likely(number: float, value: ExpectedValue) -> bool:
    if value.type.startswith("f") and not is_plausible(number):
        return False
    low = value.minimum is None or number >= value.minimum
    return low and (value.maximum is None or number <= value.maximum)


_NUMBER = re.compile(r"[uif](32|64)")
_TABLE_OF_FUNCTION = {0x01: "coil", 0x02: "discrete", 0x03: "holding", 0x04: "input", 0x06: "holding", 0x10: "holding"}


def expected_values(device: Device, pdu: bytes) -> list[ExpectedValue]:
    """Return the parameters that a request to read registers asks for.

    >>> from barewire.devices import load
    >>> [(value.name, value.order) for value in expected_values(load("az3"), bytes.fromhex("03 00 04 00 02"))]
    [('SPIDAC CHANNEL 1 SCALE', 'CDAB')]
    """
    address, quantity = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
    found = []
    for parameter in device.parameters:
        place = parameter.modbus
        if place is None or place.table != _TABLE_OF_FUNCTION.get(pdu[0]) or not _NUMBER.fullmatch(parameter.type):
            continue
        if address <= place.address and place.address + place.words <= address + quantity and place.words in (2, 4):
            limits = (parameter.minimum, parameter.maximum) if parameter.scale == 1 else (None, None)
            found.append(ExpectedValue(parameter.name, place.address - address, parameter.type, place.order, *limits))
    return found


def addresses_of_table(device: Device, pdu: bytes) -> frozenset[int]:
    """Return the addresses of the table that the request reads or writes."""
    return frozenset(_addresses(device, _TABLE_OF_FUNCTION.get(pdu[0], "")))


def _addresses(device: Device, table: str) -> Iterator[int]:
    for parameter in device.parameters:
        place = parameter.modbus
        if place is not None and place.table == table:
            yield from range(place.address, place.address + place.words)


def float_values(type_name: str, pdu: bytes) -> list[ExpectedValue]:
    """Return floats of one type, one behind the other, in all registers that a request asks for."""
    size = {"f32": 2, "f64": 4}[type_name]
    count = int.from_bytes(pdu[3:5], "big") // size
    return [ExpectedValue(f"value {number}", number * size, type_name) for number in range(count)]


_SHOWN = 32
"""The most bytes in the text of a finding."""


def exchange_findings(
    protocol: ProtocolName, request: RequestSeen, response: ResponseSeen, code: DiagnosisCode
) -> list[Finding]:
    """Return the findings with this code on a request and what came after it.

    A response whose byte count is wrong is a wrong answer, too, and one that still has its CRC behind it: these have
    findings of their own.
    """
    asked = frame_of(protocol, request.transaction, request.unit, request.pdu)
    answered = frame_of(protocol, request.transaction, response.unit, response.pdu)
    found = [finding for finding in diagnose_exchange(protocol, asked, answered) if finding.code == code]
    if not found and code == "wrong-answer" and response.message is None and response.pdu[0] == request.pdu[0]:
        if protocol == "tcp":
            return diagnose_tcp(answered, "response")
        whole = encode(response.unit, response.pdu)
        return [finding for finding in diagnose_rtu(whole, "response") if finding.code == "byte-count"]
    return found


def frame_of(protocol: ProtocolName, transaction: int | None, unit: int, pdu: bytes) -> bytes:
    """Return the frame with this PDU. The transaction is that of the request in both, since the sniffer paired them."""
    if protocol == "tcp":
        return tcp_frame.encode(unit, pdu, transaction or 0)
    return (ascii_frame.encode if protocol == "ascii" else encode)(unit, pdu)


def response_size(pdu: bytes) -> int | None:
    """Return the bytes of the whole RTU frame that answers a request, None if the request does not tell.

    >>> response_size(bytes.fromhex("03 0000 0002")), response_size(bytes.fromhex("06 0001 0003"))
    (9, 8)
    """
    if len(pdu) == 5 and pdu[0] in (1, 2, 3, 4):
        count = int.from_bytes(pdu[3:5], "big")
        return 5 + (2 * count if pdu[0] > 2 else (count + 7) // 8)
    if pdu[0] in (5, 6, 15, 16):
        return 8
    return None


def lost_end(data: bytes, unit: int, request: bytes, size: int | None) -> Finding | None:
    """Return the finding of an RTU response that lacks its first or its last bytes, None if the CRC shows neither.

    >>> lost_end(bytes.fromhex("03 04 00 17 00 07 0B F5"), 1, bytes.fromhex("03 0000 0002"), 9).proof
    'with 01 the CRC fits: 01 03 04 00 17 00 07 0B F5'
    """
    head = bytes((unit, request[0]))
    for lost in (head[:1], head):
        whole = lost + data
        if crc16(whole) == 0 and measure_response(whole[1:]) == len(whole) - 3:
            which = "byte is" if len(lost) == 1 else "2 bytes are"
            return Finding(
                "byte-lost",
                f"the first {which} missing",
                f"with {shown_digits(lost)} the CRC fits: {shown_digits(whole)}",
            )
    if size is not None and len(data) == size - 1 and data[:2] == head:
        check = crc16(data[:-1]).to_bytes(2, "little")
        if check[:1] == data[-1:]:
            return Finding(
                "byte-lost", "the last byte is missing", f"the CRC is {shown_digits(check)}, its first byte is there"
            )
    return None


def shown_digits(data: bytes) -> str:
    """Return bytes as the texts of findings show them."""
    return data[:_SHOWN].hex(" ").upper() + (" ..." if len(data) > _SHOWN else "")
