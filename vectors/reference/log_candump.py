"""log-line, candump: the log of candump, and its screen.

(1700000000.000100) can0 605#4041600000000000        the log
 (000.000100)  can0  605   [8]  40 41 60 00 00 ...   the screen, with -t z
"""

import re
from datetime import UTC, datetime
from fractions import Fraction
from itertools import pairwise

from texts import hexed

ERROR = 1 << 29
FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
COLOUR = re.compile(r"\x1b\[[0-9;]*m")
LOST = re.compile(r"DROPCOUNT: dropped (\d+) CAN frames? on '(\S+)' socket")
LOG = re.compile(r"\((\S+)\) (\S+) ([0-9A-Fa-f]+)#(\S*?)(?:_[9A-Fa-f])?(?: [RT])?")
SCREEN = re.compile(
    r"\s*(?:\(([^)]*)\)\s+)?(\w+)  (?:[RT]X [B-] [E-]  )?\s*([0-9A-Fa-f]+)\s+\[(\d+)\]\s*"
    r"(.*?)(?:\s+'.*'|\s+ERRORFRAME)?"
)
DATE = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d+")


class Unread(Exception):
    """A line that is none of this format."""


def frame_text(digits, data, flags=None):
    """Return a frame as text; `flags` are those of CAN FD, `data` None for a remote frame."""
    if len(digits) not in (3, 8) or int(digits, 16) > (0x7FF if len(digits) == 3 else ERROR | 0x1FFFFFFF):
        raise Unread
    if len(data) > 8 if flags is None else len(data) not in FD_LENGTHS:
        raise Unread
    mark = "#" if flags is None else f"##{flags:X}"
    return f"{digits.upper()}{mark}{hexed(data).replace(' ', '')}"


def remote_text(digits, length):
    """Return a remote frame as text; its length may be missing."""
    return f"{digits.upper()}#R{length}"


def data_of(digits):
    """Return the bytes in hexadecimal digits."""
    try:
        return bytes.fromhex(digits)
    except ValueError:
        raise Unread from None


def microseconds(text):
    """Return a time: seconds, or the time of day in UTC."""
    if DATE.fullmatch(text):
        day, _, part = text.partition(".")
        return int(datetime.fromisoformat(day).replace(tzinfo=UTC).timestamp()) * 1_000_000 + int(part)
    if not re.fullmatch(r"\d+\.\d+", text):
        raise Unread
    return int(Fraction(text) * 1_000_000)


def read_log(match):
    """Return the item of a line of the log."""
    time, bus, digits, rest = match.groups()
    item = {"at": microseconds(time), "bus": bus}
    if rest[:1] == "R":
        return item | {"frame": remote_text(digits, rest[1:])}
    if rest[:1] == "#":
        if len(rest) < 2:
            raise Unread
        return item | {"frame": frame_text(digits, data_of(rest[2:]), int(rest[1], 16))}
    return item | {"frame": frame_text(digits, data_of(rest))}


def read_screen(match):
    """Return the item of a line of the screen."""
    time, bus, digits, length, rest = match.groups()
    item = {"bus": bus} if time is None else {"at": microseconds(time), "bus": bus}
    if rest == "remote request":
        return item | {"frame": remote_text(digits, int(length))}
    if "`" in rest:
        data = data_of(rest.replace("`", ""))[::-1]  # the last byte first
    elif re.fullmatch(r"[01]{8}(?: [01]{8})*", rest):
        data = bytes(int(bits, 2) for bits in rest.split())
    else:
        data = data_of(rest)
    if len(data) != int(length):
        raise Unread
    return item | {"frame": frame_text(digits, data, 0 if len(length) == 2 else None)}


class Candump:
    """A reader of lines."""

    def read(self, line):
        """Return the items of a line."""
        line = COLOUR.sub("", line)
        if not line.strip() or line[0] in "#\t":  # a tab: the text of the error frame before
            return []
        if match := LOST.match(line):
            return [{"bus": match[2], "dropped": int(match[1])}]
        if match := LOG.fullmatch(line):
            return [read_log(match)]
        if match := SCREEN.fullmatch(line):
            return [read_screen(match)]
        raise Unread

    def finish(self, items):
        """Return the items with their times: if one is smaller than the one before, each counts from that one."""
        timed = [item for item in items if "at" in item]
        if any(later["at"] < earlier["at"] for earlier, later in pairwise(timed)):
            total = 0
            for item in timed:
                total += item["at"]
                item["at"] = total
        return items
