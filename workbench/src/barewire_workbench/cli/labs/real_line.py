"""Lab 11: the log of a real line, as its author posted it.

Somebody connects a computer to the line between a heat pump and its energy meter, and polls the meter. Nothing in the
log is simulated. Each answer is the traffic of another master, and three bytes are missing in it, whose values and
places the CRC proves: 13h once, 11h twice.
"""

from __future__ import annotations

from functools import partial

from barewire.rtu.crc import crc16
from barewire_workbench import explain
from barewire_workbench.cli.labs.model import (
    AnswerCheck,
    Lab,
    any_number,
    check_of_meaning,
    checked_length,
    hex_number,
    in_hex,
    right,
    typed_octets,
    typed_words,
    wrong,
)

HEAT_PUMP_LOG = """\
# The first three polls of the log in https://github.com/serhmarch/ModbusTools/issues/45
14.05.2025 09:57:07.113 'Port' Info: Start polling
14.05.2025 09:57:07.113 'Device' Tx: 01 03 00 00 00 0A C5 CD
14.05.2025 09:57:07.298 'Device' Rx: 02 03 28 FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF \
FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF 44 DA 02 03 2B D3 00 14 BD EB 02 03 28 32 34 30 38 30 37 31 30 38 \
31 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 4C BC
14.05.2025 09:57:07.299 'Device' Error: RTU. Wrong CRC
14.05.2025 09:57:08.075 'Device' Tx: 01 03 00 00 00 0A C5 CD
14.05.2025 09:57:08.267 'Device' Rx: 02 03 08 47 00 B6 41 02 03 26 00 00 00 00 00 00 01 18 00 72 00 06 F5 F8 00 00 0E \
30 0B B8 0B B8 00 00 10 92 10 B3 12 51 79 12 25 0B B8 00 00 0A DF
14.05.2025 09:57:08.269 'Device' Error: RTU. Wrong CRC
14.05.2025 09:57:09.076 'Device' Tx: 01 03 00 00 00 0A C5 CD
14.05.2025 09:57:09.252 'Device' Rx: 14 04 00 34 00 02 32 C0 14 04 04 14 00 00 FA 7D
14.05.2025 09:57:09.252 'Device' Error: RTU. Wrong CRC
"""
"""The recording, one line for each piece; the file has the name of HEAT_PUMP_FILE."""
HEAT_PUMP_FILE = "heat-pump.log"

_FIRST, _SECOND, _THIRD = (
    bytes.fromhex(line.partition("Rx: ")[2]) for line in HEAT_PUMP_LOG.splitlines() if "Rx: " in line
)
_BEFORE, _ASKED, _BEHIND = _FIRST[:45], _FIRST[45:53], _FIRST[53:]
"""The three frames of the first answer."""
_CUT_REQUEST, _CUT_ANSWER = _SECOND[:7], _THIRD[8:]
_POLLED, _OTHERS = 1, (2, 20)
_XOFF, _XON = 0x13, 0x11

# The exercises

REAL_LINE_LAB = Lab(
    *(11, "A real line"),
    "Find out from the log of a real line which stations send on it, and which bytes never reached the computer.",
    *(30, "11-a-real-line.md"),
    devices=("barewire lab 11 recordings",),
)


@REAL_LINE_LAB.ask(
    f"The first answer in {HEAT_PUMP_FILE} is three frames. The one in the middle is a request. Which bytes is it?",
    "the bytes of a frame",
    in_hex(_ASKED),
)
def _middle(answer: str) -> AnswerCheck:
    given = typed_octets(answer)
    if given in (_ASKED, _ASKED[:-2]):
        return right(f"{explain('rtu', _ASKED, 'request').summary}. The program of this log has not sent it")
    if given not in _FIRST:
        return wrong("these bytes do not stand one behind the other in the first answer")
    if given[:3] == _BEFORE[:3]:
        return wrong("that begins as a response does: 28h = 40 bytes follow, then two of the CRC")
    return wrong(f"as a request that is not valid: {explain('rtu', given, 'request').verdict}")


@REAL_LINE_LAB.ask(
    f"The program of this log asks unit {_POLLED} only. Which two units does another client ask?",
    "two decimal numbers",
    " ".join(map(str, _OTHERS)),
)
def _asked_units(answer: str) -> AnswerCheck:
    given = [any_number(word) for word in typed_words(answer) if word.lower() != "and"]
    if len(given) != len(_OTHERS):
        return wrong(f"{len(given)} numbers; the task asks for two")
    for meanings in given:
        if not meanings & set(_OTHERS):
            known = "the program of this log asks it itself" if _POLLED in meanings else "no frame has it"
            return wrong(f"unit {min(meanings)}: {known}. The first byte of a request is the unit, in hexadecimal")
    if not set(_OTHERS) <= given[0] | given[1]:
        return wrong("that is one of them, twice")
    return right("another master asks them, and does not know that there is a second one on its line")


def _missing(frame: bytes, at: int, byte: int, because: str, hints: dict[int, str], answer: str) -> AnswerCheck:
    """Check the byte that is missing in a frame before the byte `at`."""
    given = hex_number(answer)
    if given > 0xFF:
        return wrong(f"{given:X}h is no byte: expected 00 to FF")
    whole = frame[:at] + bytes([given]) + frame[at:]
    if given == byte:
        return right(f"{in_hex(whole)}: the CRC fits, {because}")
    check = in_hex(crc16(whole[:-2]).to_bytes(2, "little"))
    otherwise = f"the CRC of {in_hex(whole[:-2])} is {check}; the frame came with {in_hex(whole[-2:])}"
    return check_of_meaning({given}, {number: wrong(hint) for number, hint in hints.items()}, wrong(otherwise))


REAL_LINE_LAB.add(
    f"The second answer begins with a request that lacks a byte: {in_hex(_CUT_REQUEST)}. Which byte is missing "
    "behind 00? The frame behind it is the response.",
    "a byte in hexadecimal",
    f"{_XOFF:02X}",
    partial(
        _missing,
        _CUT_REQUEST,
        5,
        _XOFF,
        "and the response announces 26h = 38 bytes, which are 19 registers",
        {0x26: "that is the byte count of the response; the request says how many registers, of two bytes each"},
    ),
)
REAL_LINE_LAB.add(
    f"The last frame of the log lacks a byte as well: {in_hex(_CUT_ANSWER)}. Which one?",
    "a byte in hexadecimal",
    f"{_XON:02X}",
    partial(
        _missing,
        _CUT_ANSWER,
        3,
        _XON,
        "and the same byte is missing in the second answer",
        {0x04: "that byte is there: 4 bytes are announced, and 3 of them came"},
    ),
)


@REAL_LINE_LAB.ask(
    "All three missing bytes are of two values. Which setting of the computer's serial port takes them for itself?",
    "its name",
    "XON/XOFF",
)
def _setting(answer: str) -> AnswerCheck:
    typed = "".join(sign for sign in checked_length(answer).lower() if sign.isalnum())
    if "xon" in typed or "software" in typed or typed in ("flowcontrol", "handshake", "ixon"):
        return right(
            f"{_XON:02X}h is XON and {_XOFF:02X}h is XOFF: with software flow control the port obeys them, and hands "
            "on neither"
        )
    if "rts" in typed or "hardware" in typed:
        return wrong("that uses wires of its own, and takes no bytes away")
    if any(word in typed for word in ("parity", "baud", "stop", "data")):
        return wrong("then no frame of the line would be good; most of them are")
    return wrong(f"not {answer.strip()[:40]}. Which control characters of ASCII are the two bytes?")
