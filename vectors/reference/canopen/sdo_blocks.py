"""What both sides of an SDO transfer have in common: aborts, segments, and the blocks of a block transfer.

A side is a generator: it is sent a line of the other side, or None if time passes, and yields the lines it says.
"""

TOGGLE, TIMED_OUT, COMMAND, BLOCK_SIZE, SEQUENCE, CRC = (0x05030000, *range(0x05040000, 0x05040005))
TOO_LONG, TOO_SHORT, NO_OBJECT = 0x06070012, 0x06070013, 0x06020000


class Abort(Exception):
    """This side ends the transfer with a code."""


class Aborted(Exception):
    """The other side has ended the transfer with a code."""


def crc16(data):
    """Return the CRC of block transfers: polynomial 1021h, initial value 0."""
    register = 0
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1 ^ (0x1021 if register & 0x8000 else 0)) & 0xFFFF
    return register


def line_of(command, *parts):
    """Return eight bytes: a command, bytes and numbers of one byte, zeros."""
    return b"".join(part if isinstance(part, bytes) else bytes([part]) for part in (command, *parts)).ljust(8, b"\0")


def place_of(given):
    """Return index and sub-index as they are sent."""
    return int(given["index"], 16).to_bytes(2, "little") + bytes([int(given["sub"], 16)])


def heard(line):
    """Return a line that has come. Nothing has come: time-out. The other side may abort at any time."""
    if line is None:
        raise Abort(TIMED_OUT)
    if line[0] == 0x80:
        raise Aborted(int.from_bytes(line[4:], "little"))
    return line


def cut(value):
    """Return the parts of seven bytes of a value; no bytes are one empty part."""
    return [value[at : at + 7] for at in range(0, len(value) or 1, 7)]


def segment(parts, number, toggle):
    """Return one segment of an ordinary transfer, without the bit of its direction: toggle, unused bytes, last."""
    part, last = parts[number], number == len(parts) - 1
    return line_of(toggle << 4 | (7 - len(part)) << 1 | last, part)


def content(line):
    """Return the bytes of a segment, and whether it is the last one."""
    return line[1 : 8 - (line[0] >> 1 & 7)], line[0] & 1


def sized(value, size):
    """Return a value that has come. Abort if it has another size than was announced; None: nothing was."""
    if size is not None and len(value) != size:
        raise Abort(TOO_LONG if len(value) > size else TOO_SHORT)
    return value


def send_blocks(value, size, crc):
    """Say the blocks of a value and their end; return the line that comes then."""
    parts, done = cut(value), 0
    while done < len(parts):
        if not 1 <= size <= 127:
            raise Abort(BLOCK_SIZE)
        block = range(done, min(done + size, len(parts)))
        lines = [line_of(number - done + 1 | (number == len(parts) - 1) << 7, parts[number]) for number in block]
        answer = heard((yield lines))
        if answer[0] != 0xA2:
            raise Abort(COMMAND)
        if answer[1] > len(block):
            raise Abort(SEQUENCE)
        done, size = done + answer[1], answer[2]
    unused = 7 - len(parts[-1])
    return heard((yield [line_of(0xC1 | unused << 2, (crc16(value) if crc else 0).to_bytes(2, "little"))]))


def receive_blocks(size, wanted, crc, first):
    """Say `first`, receive blocks of `size` segments and their end; return the value of `wanted` bytes."""
    parts, says, complete = b"", first, False
    while not complete:
        count, ended = 0, False
        while not ended:
            line = yield says
            says = []
            if line is None:
                break  # the end of the block is lost
            number, last = heard(line)[0] & 0x7F, line[0] >> 7
            if number == count + 1:
                parts, count, complete = parts + line[1:], number, last
            ended = last or number == size
        says = [line_of(0xA2, count, size)]
    end = heard((yield says))
    if end[0] & 0xE3 != 0xC1:
        raise Abort(COMMAND)
    value = sized(parts[: len(parts) - (end[0] >> 2 & 7)], wanted)
    if crc and crc16(value) != int.from_bytes(end[1:3], "little"):
        raise Abort(CRC)
    return value
