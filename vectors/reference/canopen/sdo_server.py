"""sdo-talk, the server: its only object is 2100h, sub-index 0, and its steps are what it says to what it hears."""

from sdo_blocks import (
    BLOCK_SIZE,
    COMMAND,
    NO_OBJECT,
    TOGGLE,
    Abort,
    Aborted,
    content,
    cut,
    heard,
    line_of,
    receive_blocks,
    segment,
    send_blocks,
    sized,
)
from sdo_client import size_in
from texts import hexed, octets

OBJECT = b"\x00\x21\x00"
BEGINS = {1: 0, 2: 0, 5: 3, 6: 1}
"""The services that begin a transfer, the upper three bits of a command, and the bits that others of them have."""


class Server:
    """A server with one object, which is written or read in any way."""

    def __init__(self, value, blksize):
        self.value, self.blksize, self.place = value, blksize, OBJECT

    def run(self):
        """Serve transfers for ever."""
        says = []
        while True:
            line = yield says
            try:
                says = [] if line is None else (yield from self.transfer(line))
            except Abort as abort:
                says = [line_of(0x80, self.place, abort.args[0].to_bytes(4, "little"))]
            except Aborted:
                says = []

    def transfer(self, line):
        """Serve one transfer from its first line on; return the last lines to say."""
        command, self.place = heard(line)[0], line[1:4]
        if command >> 5 not in BEGINS or command & BEGINS[command >> 5]:
            raise Abort(COMMAND)
        if self.place != OBJECT:
            raise Abort(NO_OBJECT)
        if command >> 5 == 1:
            return (yield from self.write(line))
        if command >> 5 == 2:
            return (yield from self.read())
        if command >> 5 == 6 and self.blksize:
            first = line_of(0xA4, self.place, self.blksize)
            wanted, crc = size_in(line, 2), command & 4
            self.value = yield from receive_blocks(self.blksize, wanted, crc, [first])
            return [line_of(0xA1)]
        if command >> 5 == 5 and self.blksize:
            return (yield from self.read_blocks(line))
        raise Abort(COMMAND)

    def write(self, line):
        """Receive a value at once or in segments."""
        confirmed = line_of(0x60, self.place)
        if line[0] & 2:
            self.value = line[4 : 8 - (line[0] >> 2 & 3 if line[0] & 1 else 0)]
            return [confirmed]
        value, toggle, last, size, says = b"", 0, False, size_in(line, 1), confirmed
        while not last:
            line = heard((yield [says]))
            if line[0] & 0xE0:
                raise Abort(COMMAND)
            if line[0] >> 4 & 1 != toggle:
                raise Abort(TOGGLE)
            part, last = content(line)
            value += part
            says = line_of(0x20 | toggle << 4, b"")
            toggle ^= 1
        self.value = sized(value, size)
        return [says]

    def read(self):
        """Say a value at once or in segments."""
        size = len(self.value)
        if 1 <= size <= 4:
            return [line_of(0x43 | (4 - size) << 2, self.place, self.value)]
        says, parts = line_of(0x41, self.place, size.to_bytes(4, "little")), cut(self.value)
        for number in range(len(parts)):
            line = heard((yield [says]))
            if line[0] & 0xE0 != 0x60:
                raise Abort(COMMAND)
            if line[0] >> 4 & 1 != number & 1:
                raise Abort(TOGGLE)
            says = segment(parts, number, number & 1)
        return [says]

    def read_blocks(self, line):
        """Say a value in blocks; as in an ordinary upload if it is no longer than the protocol switch threshold."""
        blksize, switch, size = line[4], line[5], len(self.value)
        if not 1 <= blksize <= 127:
            raise Abort(BLOCK_SIZE)
        if switch and size <= switch:
            return (yield from self.read())
        begin = heard((yield [line_of(0xC6, self.place, size.to_bytes(4, "little"))]))
        if begin[0] != 0xA3:
            raise Abort(COMMAND)
        end = yield from send_blocks(self.value, blksize, line[0] & 4)
        if end[0] != 0xA1:
            raise Abort(COMMAND)
        return []


def server(given):
    """node, direction, index, sub, blksize, value, talk -> talk, arrived"""
    machine = Server(octets(given.get("value", "")), given.get("blksize", 127))
    side, steps = machine.run(), []
    next(side)
    for step in given["talk"]:
        says = []
        for line in step["hear"]:
            says += side.send(octets(line))
        if not says:
            says += side.send(None)  # time passes
        steps.append({"say": [hexed(line) for line in says]})
    return {"talk": steps, "arrived": hexed(machine.value)}


KINDS = {"sdo-talk": {"server": server}}
