"""The log of the CANopen conformance test tool of CiA: reads its frames.

        Test Info   : ### Test case : 2.1  -  Test name : SDO 01 ####      other lines are skipped
        Test CAN    : CAN1  604 Tx SD  8  40 00 10 00 00 00 00 00
                      |     |   |  ||  |  '-- the data in hexadecimal; absent for a remote frame
                      |     |   |  ||  '-- the length
                      |     |   |  |'-- D data frame, R remote frame
                      |     |   |  '-- S identifier of 11 bits, E of 29 bits
                      |     |   '-- Tx the tool sent it, Rx the device under test
                      |     '-- the identifier in hexadecimal
                      '-- the bus

The log has no times, so the lines are 1 ms apart. The form is that of version 3.0.3.10, of which a report is published
(test/test_report_CCT.md of the repository CANopenNode/CANopenDemo). That one has 11-bit data frames alone: E and R are
read by analogy.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX, CanFrame
from barewire_workbench.recordings.model import Recorded, RecordedItem, split_lines, unread

_STEP = 0.001
"""Seconds between two lines."""
_CAN = re.compile(r"Test CAN\s*:\s*(?P<text>.*)$")
_FRAME = re.compile(
    r"(?P<bus>\S+)\s+(?P<id>[0-9A-Fa-f]{1,8})\s+(?P<way>Tx|Rx)\s+(?P<kind>[SE][DR])\s+(?P<length>\d{1,2})(?P<data>.*)$"
)


def is_conformance_log(text: str) -> bool:
    """Return whether one of the lines is a frame in the form of this log.

    >>> is_conformance_log("Test CAN : CAN1  704 Rx SD  1  00"), is_conformance_log("(1.5) can0 705#05")
    (True, False)
    """
    return any((match := _CAN.match(line)) and _FRAME.match(match["text"]) for line in text.splitlines())


def read_conformance_log(text: str | Iterable[str]) -> Iterator[RecordedItem]:
    """Yield the frames of a log.

    >>> [(str(item.frame), item.sent) for item in read_conformance_log("Test CAN : CAN1  000 Tx SD  2  81 04")]
    [('000#8104', True)]
    """
    now = 0.0
    for number, line in enumerate(split_lines(text), start=1):
        found = _CAN.match(line)
        if found is None:
            continue
        now += _STEP
        match = _FRAME.match(found["text"])
        frame = None if match is None else _frame(match)
        if match is None or frame is None:
            text = "expected bus, identifier, Tx or Rx, SD (SR, ED, ER), length and as many bytes"
            yield unread(now, number, text, line)
        else:
            yield Recorded(now, match["bus"], frame, number, match["way"] == "Tx")


def _frame(match: re.Match[str]) -> CanFrame | None:
    """Return the frame of a line; None if a part of it is impossible."""
    extended, remote = match["kind"][0] == "E", match["kind"][1] == "R"
    identifier, length, digits = int(match["id"], 16), int(match["length"]), match["data"].split()
    if identifier > (EXTENDED_MAX if extended else BASE_MAX) or length > DATA_MAX:
        return None
    if remote:
        return CanFrame(identifier, b"", extended, True, length)
    if len(digits) < length or any(len(pair) != 2 for pair in digits[:length]):
        return None
    try:
        return CanFrame(identifier, bytes.fromhex(" ".join(digits[:length])), extended)
    except ValueError:
        return None
