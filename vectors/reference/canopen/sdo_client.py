"""sdo-talk, the client: it begins a transfer, and its steps are what it says to what it hears."""

from sdo_blocks import (
    COMMAND,
    TOGGLE,
    Abort,
    Aborted,
    content,
    cut,
    heard,
    line_of,
    place_of,
    receive_blocks,
    segment,
    send_blocks,
    sized,
)
from texts import hexed, octets


def size_in(line, bit):
    """Return the size that a line announces; None if its bit says that there is none."""
    return int.from_bytes(line[4:], "little") if line[0] & bit else None


def answer_to(place, says):
    """Say lines, and return the answer about this object; one about another object is late, or another client's."""
    return heard((yield from about(place, says)))


def about(place, says):
    """Say lines, and return the line about this object, which may be an abort."""
    line = yield says
    while line is not None and line[1:4] != place:
        line = yield []
    return line


def download(given):
    """Write a value."""
    value, place = octets(given["value"]), place_of(given)
    size = len(value).to_bytes(4, "little")
    if "block" in given:
        crc = given["block"]["crc"]
        answer = yield from first_answer(place, line_of(0xC2 | crc << 2, place, size))
        if not refused(answer):
            if answer[0] & 0xE3 != 0xA0:
                raise Abort(COMMAND)
            answer = yield from send_blocks(value, answer[4], crc and answer[0] & 4)
            if answer[0] != 0xA1:
                raise Abort(COMMAND)
            return None
    if not given.get("indicated", True):
        first = line_of(0x20, place)
    elif 1 <= len(value) <= 4:
        first = line_of(0x23 | (4 - len(value)) << 2, place, value)
    else:
        first = line_of(0x21, place, size)
    if (yield from answer_to(place, [first]))[0] != 0x60:
        raise Abort(COMMAND)
    parts = cut(value) if not first[0] & 2 else []
    for number in range(len(parts)):
        answer = heard((yield [segment(parts, number, number & 1)]))
        if answer[0] & 0xE0 != 0x20:
            raise Abort(COMMAND)
        if answer[0] >> 4 & 1 != number & 1:
            raise Abort(TOGGLE)
    return None


def first_answer(place, line):
    """Say the first line of a block transfer, and return the answer; that there are no block transfers is one too."""
    answer = yield from about(place, [line])
    return answer if refused(answer) else heard(answer)


def refused(answer):
    """Return whether a server has no block transfer: it aborts the first line, and the client goes on in segments."""
    return answer is not None and answer[0] == 0x80 and answer[4:] == COMMAND.to_bytes(4, "little")


def upload(given):
    """Read a value."""
    place, answer = place_of(given), None
    if "block" in given:
        block = given["block"]
        first = line_of(0xA0 | block["crc"] << 2, place, block["size"], block["switch"])
        answer = yield from first_answer(place, first)
        if not refused(answer) and answer[0] & 0xE1 == 0xC0:
            crc = block["crc"] and answer[0] & 4
            value = yield from receive_blocks(block["size"], size_in(answer, 2), crc, [line_of(0xA3)])
            return value, [line_of(0xA1)]
    if answer is None or refused(answer):
        answer = yield from answer_to(place, [line_of(0x40, place)])
    if answer[0] & 0xE0 != 0x40:
        raise Abort(COMMAND)
    if answer[0] & 2:
        return answer[4 : 8 - (answer[0] >> 2 & 3 if answer[0] & 1 else 0)], []
    value, toggle, last, size = b"", 0, False, size_in(answer, 1)
    while not last:
        line = heard((yield [line_of(0x60 | toggle << 4, b"")]))
        if line[0] & 0xE0:
            raise Abort(COMMAND)
        if line[0] >> 4 & 1 != toggle:
            raise Abort(TOGGLE)
        part, last = content(line)
        value += part
        toggle ^= 1
    return sized(value, size), []


def client(given):
    """node, direction, index, sub, indicated, block, value, talk -> talk, ends, arrived"""
    side = upload(given) if given["direction"] == "upload" else download(given)
    steps, ends, answer = [], "running", {}
    for number, step in enumerate(given["talk"]):
        says = []
        steps.append({"say": says})
        if ends != "running":
            continue
        try:
            lines = [octets(line) for line in step["hear"]]
            if number == 0:
                lines.insert(0, None)  # begins the generator
            for line in lines:
                says += map(hexed, side.send(line))
            if not says:
                says += map(hexed, side.send(None))
        except StopIteration as stop:
            ends = "done"
            if stop.value:
                answer["arrived"] = hexed(stop.value[0])
                says += map(hexed, stop.value[1])
        except Abort as abort:
            ends = {"abort": f"{abort.args[0]:08X}"}
            says.append(hexed(line_of(0x80, place_of(given), abort.args[0].to_bytes(4, "little"))))
        except Aborted as abort:
            ends = {"abort": f"{abort.args[0]:08X}"}
    return {"talk": steps, "ends": ends, **answer}


KINDS = {"sdo-talk": {"client": client}}
