"""The findings of a diagnosis: a closed list of codes, each with what it says about a device or a line.

    code          text                                              proof
    crc-swapped   the two CRC bytes are exchanged                   01 03 00 00 00 0A C5 CD is a request to unit 1, ...
    bit-flip      bit 6 of byte 3 is wrong: 40h instead of 00h      01 03 00 00 00 0A C5 CD is a request to unit 1, ...

A finding is made by a trial that succeeds, and the proof is its result: the bytes that are a good frame, the checksum
that fits, or the two numbers that contradict each other. Where no trial succeeds, there is no finding.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

DiagnosisCode = Literal[
    # a Modbus frame
    "crc-swapped", "crc-span", "crc-kind", "crc-missing", "crc-wrong", "byte-lost", "byte-extra", "bit-flip",
    "byte-count", "lrc-over-characters", "lrc-kind", "ascii-on-rtu", "rtu-on-ascii", "mbap-on-serial", "rtu-on-tcp",
    "ascii-on-tcp", "crc-inside-mbap", "mbap-missing", "mbap-header", "header-byte-order", "seven-bit", "baud-rate",
    "inverted", "noise-before", "noise-after", "two-frames", "cut-frame", "role",
    # a request and its response
    "wrong-answer", "wrong-value", "address-base", "address-byte-order", "word-order",
    # CAN
    "modbus-on-can", "sdo-read-command", "sdo-toggle", "sdo-size", "foreign-cob-id", "short-pdo", "emcy-register",
    "two-masters", "bit-rate", "state", "bus-rule", "lost-frame", "no-heartbeat", "restart",
    # a line or a bus over time
    "no-frame", "no-answer", "late-answer", "two-answers", "no-bias", "echo", "parity", "two-units", "turnaround",
    "dead-unit",
]  # fmt: skip

MEANINGS: dict[DiagnosisCode, str] = {
    "crc-swapped": "The CRC is right, but its high byte was sent first. On the wire the low byte goes first.",
    "crc-span": "The CRC is right for other bytes than unit and PDU: one was left out, or one too many taken.",
    "crc-kind": "The checksum is a CRC-16, but not that of Modbus: it has another polynomial or another first value.",
    "crc-missing": "Unit and PDU are a whole message; the checksum was not sent.",
    "crc-wrong": "The bytes have the length of a whole frame, and another CRC: a byte of it or of the others is wrong.",
    "byte-lost": "With one byte more the frame is good: the receiver missed a byte, as when its buffer is full.",
    "byte-extra": "Without one of the bytes the frame is good: a disturbance looked like a byte.",
    "bit-flip": "With one bit changed the frame is good: a disturbance on the line, or a missing termination.",
    "byte-count": "The byte count does not say how many bytes follow; with the one that does, the frame is good.",
    "lrc-over-characters": "The LRC was computed over the characters; it belongs over the bytes that they encode.",
    "lrc-kind": "The checksum of the ASCII frame is not an LRC: a plain sum, an exclusive or, or a CRC.",
    "ascii-on-rtu": "The bytes are the characters of an ASCII frame: the device is set to Modbus ASCII.",
    "rtu-on-ascii": "The bytes are an RTU frame: the device is set to Modbus RTU.",
    "mbap-on-serial": "The bytes are a Modbus TCP frame: its header does not belong on a serial line.",
    "rtu-on-tcp": "The bytes are an RTU frame: it is sent on this connection without the header of Modbus TCP.",
    "ascii-on-tcp": "The bytes are the characters of an ASCII frame: they are sent without the header of Modbus TCP.",
    "crc-inside-mbap": "The Modbus TCP frame still has the CRC of the serial line; on TCP there is none.",
    "mbap-missing": "Unit and PDU are a whole message; the header of Modbus TCP was not sent.",
    "mbap-header": "Length or protocol identifier of the header is wrong; with the right one the frame is good.",
    "header-byte-order": "A number of the Modbus TCP header was sent low byte first; it goes high byte first.",
    "seven-bit": "Bit 7 of each byte is a parity bit: the device sends 7 data bits, and 8 were read.",
    "baud-rate": "Read at another baud rate, the levels of these bytes are a good frame.",
    "inverted": "Read with each level exchanged, the bytes are a good frame: the two wires are exchanged.",
    "noise-before": "A good frame follows bytes that belong to none, as when a transmitter switches on.",
    "noise-after": "A good frame is followed by bytes that belong to none, as when a transmitter switches off.",
    "two-frames": "The bytes are several frames, one behind the other: the silence between them was not noticed.",
    "cut-frame": "The frame ends before its last byte: the reader stopped too early, or the rest was lost.",
    "role": "The frame is good in the other direction: a request where a response was expected, or the reverse.",
    "wrong-answer": "The response does not fit the request: its unit, function, length or transaction is another.",
    "wrong-value": "A request has a value that its function does not have, so that a device should refuse it.",
    "address-base": "A register was asked for by its number in a manual (40001), and not by its address (0).",
    "address-byte-order": "An address or a quantity was sent low byte first; it goes high byte first.",
    "word-order": "The registers of the value are in another order; in that order the value is plausible.",
    "modbus-on-can": "The bytes are a good Modbus frame, too; of other bytes at most one in 65,536 is.",
    "sdo-read-command": "An SDO read was requested with the command byte of an answer (43h) instead of 40h.",
    "sdo-toggle": "Two segments in a row have the same toggle bit: one of the two sides repeated a segment.",
    "sdo-size": "The size announced at the start of a transfer is not that of the data sent.",
    "foreign-cob-id": "A frame has a COB-ID that no service of the known nodes uses.",
    "short-pdo": "A PDO has fewer bytes than are mapped.",
    "emcy-register": "The error register contradicts the error code of the same emergency message.",
    "two-masters": "Two masters use the line or bus: a request was sent before that of another had its response.",
    "bit-rate": "Error frames without one good frame: the bit rates of the nodes differ.",
    "state": "A node sends or is asked for what its NMT state does not allow.",
    "bus-rule": "Frames break a rule of CiA 301 that has no code of its own; the proof names it.",
    "lost-frame": "A frame on the bus did not reach its receiver, as the frames of both sides show.",
    "no-heartbeat": "The heartbeat of a node is missing.",
    "restart": "A node started again without a command.",
    "no-frame": "Bytes of a log are not a frame, and no single fault explains them.",
    "no-answer": "A request was not answered.",
    "late-answer": "An answer, or a part of it, came after the client had sent its next request.",
    "two-answers": "A request was answered twice.",
    "no-bias": "Noise between the frames: the line has no bias resistors, and its idle level is not defined.",
    "echo": "Each request is read again: the transceiver receives what it sends.",
    "parity": "The reader has another parity than the device.",
    "two-units": "Two devices answer under one unit address.",
    "turnaround": "The time between the end of a response and the next request is too short.",
    "dead-unit": "A unit did not answer one of several requests, while others answered.",
}
"""What each code says, in a sentence. This is the closed list: a finding has one of these codes."""


_SHOWN = 400
"""The most characters of a proof in a line of text; `proof` has all of them."""


class Finding(NamedTuple):
    """What is wrong, in words, and the proof: the bytes that make a good frame, or the numbers that show it."""

    code: DiagnosisCode
    text: str
    proof: str

    @property
    def line(self) -> str:
        """The finding in one line of text; a proof with many bytes is cut.

        >>> Finding("cut-frame", "the beginning of a response, 5 bytes are missing", "01 03 06 ...").line
        'diagnosis: the beginning of a response, 5 bytes are missing [cut-frame]: 01 03 06 ...'
        """
        proof = self.proof if len(self.proof) <= _SHOWN else f"{self.proof[: _SHOWN - 4]} ..."
        return f"diagnosis: {self.text} [{self.code}]: {proof}"
