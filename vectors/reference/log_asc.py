"""log-line, asc and conformance: Vector ASC, and the log of the CANopen conformance test tool.

   0.000800 1  605             Rx   d 8 40 41 60 00 00 00 00 00
Test CAN    : CAN1  604 Tx SD  8  40 00 10 00 00 00 00 00
"""

import re

from log_candump import Unread, data_of, frame_text, microseconds, remote_text

HEAD = re.compile(r"base (hex|dec)\s+timestamps (absolute|relative)")
OTHER = ("//", "date ", "internal events logged", "Begin Triggerblock", "End TriggerBlock")
TEST = re.compile(r"Test CAN\s*:\s*(\S+)\s+(\w+)\s+([TR])x\s+[SE]([DR])\s+(\d+)\s*(.*)")


class Asc:
    """A reader of Vector ASC: its first line tells the base of its numbers, and what its times count from."""

    def __init__(self):
        self.base, self.relative, self.now = 16, False, 0

    def read(self, line):
        """Return the items of a line."""
        if match := HEAD.match(line):
            self.base, self.relative = (16 if match[1] == "hex" else 10), match[2] == "relative"
            return []
        if not line.strip() or line.startswith(OTHER):
            return []
        time, _, rest = line.strip().partition(" ")
        at = microseconds(time)
        self.now = self.now + at if self.relative else at
        return self.event(rest.strip())

    def event(self, rest):
        """Return the items of what follows a time."""
        words = rest.split()
        if words[0] == "CANFD":
            return [{"at": self.now, "bus": words[1], "frame": self.fd(words[3], words[4:])}]
        if not words[0].isdigit() or words[1].startswith("Statistic"):
            return []  # "Start of measurement", "CAN 1 Status:..."
        item = {"at": self.now, "bus": words[0]}
        if words[1] == "ErrorFrame":
            return [item]
        digits, length, data = self.identifier(words[1]), words[4] if len(words) > 4 else "", words[5:]
        if words[3] == "r":
            return [item | {"frame": remote_text(digits, length)}]
        return [item | {"frame": frame_text(digits, self.data(data, int(length)))}]

    def fd(self, digits, words):
        """Return a frame of CAN FD: its name, if it has one, then two flags, the length code, the length, the bytes."""
        if not words[0].isdigit():
            words = words[1:]
        flags = int(words[0]) | int(words[1]) << 1
        return frame_text(self.identifier(digits), self.data(words[4:], int(words[3])), flags)

    def identifier(self, text):
        """Return an identifier in hexadecimal digits; an x behind it: it is extended."""
        is_extended = text[-1] == "x"
        try:
            value = int(text.removesuffix("x"), self.base)
        except ValueError:
            raise Unread from None
        if value > (0x1FFFFFFF if is_extended else 0x7FF):
            raise Unread
        return f"{value:0{8 if is_extended else 3}X}"

    def data(self, words, length):
        """Return the bytes, as many as the length says; more words may follow."""
        if len(words) < length:
            raise Unread
        words = words[:length]
        if self.base == 10:
            return bytes(int(word) for word in words)
        return data_of("".join(words))

    def finish(self, items):
        """Return the items."""
        return items


class Conformance:
    """A reader of the log of the conformance test tool."""

    def read(self, line):
        """Return the items of a line."""
        match = TEST.fullmatch(line)
        if not match:
            return []
        bus, digits, sent, kind, length, rest = match.groups()
        data = data_of(rest)
        if kind == "D" and len(data) != int(length):
            raise Unread
        found = remote_text(digits, length) if kind == "R" else frame_text(digits, data)
        return [{"bus": bus, "frame": found, "sent": sent == "T"}]

    def finish(self, items):
        """Return the items."""
        return items
