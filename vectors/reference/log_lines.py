"""log-line: lines of a recording and what they say; and the lines of a serial line.

12.345678 01 03 00 00 00 02 C4 0B                             a time, then bytes
00000000: 0103 0000 0002 c40b                      ........   a dump of xxd
00000000  01 03 00 00 00 02 c4 0b           |........|        a dump of hexdump -C
"""

import re
from fractions import Fraction

from log_asc import Asc, Conformance
from log_candump import Candump, Unread, data_of
from texts import hexed, octets

TIME = re.compile(r"[(\[]?((?:\d+:)*)(\d+[.,]\d+)[)\]]?")
DIRECTION = ("<", ">", "TX:", "RX:")
XXD = re.compile(r"[0-9a-f]{8}: ((?:[0-9a-f]{2,4} )+) .*")
HEXDUMP = re.compile(r"[0-9a-f]{8}  ([0-9a-f ]+)\|.*\|")


class Bytes:
    """A reader of the bytes of a serial line."""

    def __init__(self):
        self.dump = None

    def read(self, line):
        """Return the items of a line. The lines of one dump are one item."""
        if match := XXD.fullmatch(line) or HEXDUMP.fullmatch(line):
            return self.dumped(bytes.fromhex(match[1]))
        self.dump = None
        words, item = line.partition("#")[0].split(), {}
        if words and (match := TIME.fullmatch(words[0])):
            seconds = Fraction(match[2].replace(",", "."))
            for power, part in enumerate(reversed(match[1].split(":")[:-1]), 1):
                seconds += int(part) * 60**power
            item, words = {"at": int(seconds * 1_000_000)}, words[1:]
        if words and words[0] in DIRECTION:
            words = words[1:]
        if not words:
            return []
        if words[0].startswith(":"):
            return [item | {"bytes": hexed(words[0].encode("latin-1") + b"\r\n")}]
        return [item | {"bytes": hexed(data_of(" ".join(words)))}]

    def dumped(self, data):
        """Add the bytes of a line of a dump; return its item, with its first line alone."""
        if self.dump is not None:
            self.dump["bytes"] = hexed(octets(self.dump["bytes"]) + data)
            return []
        self.dump = {"bytes": hexed(data)}
        return [self.dump]

    def finish(self, items):
        """Return the items."""
        return items


READERS = {"candump": Candump, "asc": Asc, "conformance": Conformance, "bytes": Bytes}


def decode(given):
    """format, lines -> items"""
    reader, items = READERS[given["format"]](), []
    for number, line in enumerate(given["lines"], 1):
        try:
            items += reader.read(line)
        except Unread:
            items.append({"unread": number})
    return {"items": reader.finish(items)}


KINDS = {"log-line": {"decode": decode}}
