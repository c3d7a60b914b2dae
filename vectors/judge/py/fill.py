"""Fills a case of device-conformance with the values of a device: placeholders, loops, transfers become plain steps.

`fill(question, device)` returns the steps, or None if the case is not one for this device. A judge takes the device
from the answer, `device_of(answer["is"]["device"])`; a tester makes one that reads each object when it is needed. The
rules are those of ../../kinds/device-conformance.md.
"""

from __future__ import annotations

import re
from binascii import crc_hqx
from collections.abc import Callable, Iterator
from typing import Any

Step = dict[str, Any]
PLACE = "(?:[0-9A-F]{4}|[a-z]+(?:[.][a-z]+)?):(?:[0-9A-F]{2}|[a-z]+)"
TERM = re.compile(f"([-+^|&]?)({PLACE}|[a-z]+(?:[.][a-z]+)?|[0-9A-F]+)")
BRACKETS = re.compile(r"\[.*?\]")
OPERATIONS: dict[str, Callable[[int, int], int]] = {
    "": lambda _, term: term,
    "+": int.__add__,
    "-": int.__sub__,
    "^": int.__xor__,
    "|": int.__or__,
    "&": int.__and__,
}


class Device:
    """A device under test: `read` returns the value of an object, None if it cannot be read."""

    def __init__(
        self, node: int, has: tuple[str, ...], large: tuple[int, int], read: Callable[[int, int], bytes | None]
    ):
        self.node, self.has, self.large, self.read = node, has, large, read

    def number(self, index: int, sub: int, size: int = 4) -> int:
        return int.from_bytes((self.read(index, sub) or b"")[:size], "little")

    def pdo(self, first: int) -> dict[str, int] | None:
        """Return what placeholders say of the first of four PDOs that is on, has 11 bits and maps something."""
        for record, mapping in ((first + n, first + 0x200 + n) for n in range(4)):
            word, count = self.number(record, 1), self.number(mapping, 0, 1)
            if word and not word >> 29 & 5 and 1 <= count <= 64:
                bits = [self.number(mapping, sub, 1) for sub in range(1, count + 1)]
                found = {"record": record, "mapping": mapping, "word": word, "cob": word & 0x7FF}
                return {**found, "size": (sum(bits) + 7) // 8, "toomany": 64 // (bits[0] or 64) + 1}
        return None

    def text(self) -> tuple[int, bytes] | None:
        texts = ((index, self.read(index, 0) or b"") for index in (0x1008, 0x1009, 0x100A))
        return next(((index, value) for index, value in texts if len(value) >= 8), None)


def device_of(described: Step) -> Device:
    """Return the device of an answer. Raise one of ERRORS if it is described wrongly."""
    objects = {place_of(name): bytes_of(value) for name, value in described["objects"].items()}
    node, has = described["node"], described["has"]
    if isinstance(node, bool) or node not in range(1, 128) or (0x1000, 0) not in objects:
        raise ValueError("a device has a node from 1 to 127, and the object 1000:00")
    if not isinstance(has, list) or not all(isinstance(condition, str) for condition in has):
        raise ValueError("has is a list of texts")
    large = place_of(described["large"]) if "large object" in has else (0x2000, 0)
    return Device(int(node), tuple(has), large, lambda index, sub: objects.get((index, sub)))


ERRORS = (KeyError, TypeError, ValueError, AttributeError)


def place_of(name: str) -> tuple[int, int]:
    if not re.fullmatch("[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}", name):
        raise ValueError(f"{name} is no object")
    return int(name[:4], 16), int(name[5:], 16)


def bytes_of(text: str) -> bytes:
    if not re.fullmatch("[0-9A-Fa-f ]*", text):
        raise ValueError(f"{text} has no bytes")
    return bytes.fromhex(text.replace(" ", ""))


def fill(question: Step, device: Device) -> list[Step] | None:
    """Return the steps of a case for this device, None if it is not one for it. Raise one of ERRORS if it is wrong."""
    names = {"node": device.node, "other": 125 if device.node == 126 else 126}
    values = Values(device, {**names, "large.index": device.large[0], "large.sub": device.large[1]})
    if not values.hold(question.get("if", ())) or not values.hold(question.get("needs", ())):
        return None
    return list(values.steps(question["steps"]))


class Values:
    """What stands for the placeholders of a case; `names` has the variables of loops too."""

    def __init__(self, device: Device, names: dict[str, int]) -> None:
        self.device, self.names = device, names

    def fill(self, text: str) -> str:
        return re.sub("<([^<>]+)>", lambda found: self.word(found[1]), text)

    def word(self, inside: str) -> str:
        unit, star, times = inside.partition("*")
        if star:
            return unit * self.number(times)
        expression, slash, size = inside.partition("/")
        if slash:
            return little(self.number(expression) & (1 << 8 * int(size, 16)) - 1, int(size, 16))
        return f"{self.number(expression):0{len(re.match('[0-9A-F]*', expression)[0])}X}"

    def number(self, expression: str) -> int:
        terms = list(TERM.finditer(expression))
        if "".join(term[0] for term in terms) != expression or [bool(term[1]) for term in terms] != [
            False,
            *[True] * (len(terms) - 1),
        ]:
            raise ValueError(f"placeholder {expression}")
        total = 0
        for term in terms:
            total = OPERATIONS[term[1]](total, self.term(term[2]))
        return total

    def term(self, term: str) -> int:
        index, colon, sub = term.partition(":")
        if colon:
            return int.from_bytes(self.device.read(self.term(index), self.term(sub)) or b"", "little")
        return int(term, 16) if re.fullmatch("[0-9A-F]+", term) else self.named(term)

    def named(self, name: str) -> int:
        if name in self.names:
            return self.names[name]
        group, _, field = name.partition(".")
        if group in ("servers", "clients"):
            span = range(0x1202, 0x1280) if group == "servers" else range(0x1281, 0x1300)
            pairs = (at for at in span if None not in (self.device.read(at, 1), self.device.read(at, 2)))
            return next(pairs, span[0])
        if group == "text":
            index, value = self.device.text() or (0x1008, bytes(14))
            return {"index": index, "size": len(value), "segments": len(pieces(value))}[field]
        return (self.device.pdo({"rpdo": 0x1400, "tpdo": 0x1800}[group]) or {}).get(field, 0)

    def hold(self, conditions: list[str]) -> bool:
        return all(self.holds(self.fill(condition)) for condition in conditions)

    def holds(self, condition: str) -> bool:
        left, word, right = condition.partition(" is ")
        if word:
            return left != right[4:] if right.startswith("not ") else left == right
        if condition.startswith("no "):
            return not self.holds(condition[3:])
        if condition in ("RPDO", "TPDO"):
            return self.device.pdo(0x1400 if condition == "RPDO" else 0x1800) is not None
        if condition.startswith("text of "):
            return self.device.text() is not None and (
                condition == "text of 8 bytes" or len(self.device.text()[1]) <= 140
            )
        found = re.fullmatch("([0-9A-F]{4})h(?::([0-9A-F]{2}))?", condition)
        if found is None:
            return condition in self.device.has
        return self.device.read(int(found[1], 16), int(found[2] or "0", 16)) is not None

    def steps(self, rows: list[Step]) -> Iterator[Step]:
        for row in rows:
            if "each" in row:
                for text in map(self.fill, row["in"]):
                    first, _, last = text.partition("-")
                    for value in range(int(first, 16), int(last or first, 16) + 1):
                        inner = Values(self.device, {**self.names, row["each"]: value})
                        yield from inner.steps(row["steps"]) if inner.hold(row.get("if", ())) else ()
            elif self.hold(row.get("if", ())):
                lists = {name: list(map(self.fill, row.get(name, ()))) for name in ("send", "accept", "ends")}
                lists["accept"] = lists["accept"] or [""]
                yield from self.transfer(row) if "transfer" in row else ({**row, **lists},)

    def transfer(self, row: Step) -> Iterator[Step]:
        """Yield the steps of a whole SDO transfer."""
        if row["of"] == "text":
            index, value = self.device.text() or (0x1008, bytes(14))
            place = little(index, 2) + "00"
        else:
            place, value = self.fill(row["of"]), bytes.fromhex(self.fill(row["value"]))
        size, cut, kind = little(len(value), 4), pieces(value), row["transfer"]
        last, count = len(cut), row.get("segments", len(cut))

        def request(text: str) -> str:
            return f"{0x600 + self.device.node:03X}#{text.ljust(16, '0')}"

        def answer(text: str) -> str:
            return f"{0x580 + self.device.node:03X}#{text}{'.' * (16 - len(re.sub(BRACKETS, '.', text)))}"

        def step(sent: str, *accepted: str, **more: Any) -> Step:
            return {"send": [request(sent)], "accept": [answer(text) for text in accepted] or [""], "ends": [], **more}

        def segment(number: int) -> str:
            data = cut[number - 1]
            return f"{(number - 1 & 1) << 4 | 7 - len(data) << 1 | (number == last):02X}{data.hex().upper()}"

        def numbered(number: int, begin: int) -> str:
            return f"{number - begin + 1 | (number == last) << 7:02X}{cut[number - 1].hex().upper()}"

        def block(sent: str, begin: int, end: int) -> Step:
            accepted = ", ".join(answer(numbered(number, begin)) for number in range(begin, min(end, last) + 1))
            return {"send": [sent], "accept": [accepted], "ends": []}

        done, crc = f"{0xC1 | 7 - len(cut[-1]) << 2:02X}", little(crc_hqx(value, 0), 2)
        no_blocks = ["|".join(answer(f"80......{code}") for code in ("01000405", "00000008"))]
        if kind == "upload":
            yield step("40" + place, "41" + place + size, "40" + place)
            yield from (step("70" if n % 2 else "60", segment(n + 1)) for n in range(min(count, last)))
        elif kind == "download":
            yield step("21" + place + little(row.get("size", len(value)), 4), "60" + place)
            yield from (step(segment(n + 1), "30" if n % 2 else "20") for n in range(min(count, last)))
        elif kind == "block segments":
            yield block(self.fill(row["send"][0]), row.get("from", 1), row.get("to", last))
        elif kind == "block download":
            yield step("C6" + place + size, "A[04]" + place, ends=no_blocks)
            sent = [request(numbered(number, 1)) for number in range(1, last + 1)]
            yield {"send": sent, "accept": [answer(f"A2{last:02X}")], "ends": []}
            yield step(done + crc, "A1")
        elif kind == "block upload":
            with_crc, blksize, sent = row.get("crc", True), row.get("blksize", 20), "A3"
            begin = f"{'A4' if with_crc else 'A0'}{place}{blksize:02X}"
            steps = [step(begin, f"C[26]{place}{size}", f"C[04]{place}", ends=no_blocks)]
            for first in range(1, last + 1, blksize):
                end = min(first + blksize - 1, last)
                steps.append(block(request(sent), first, end))
                sent = f"A2{end - first + 1:02X}{blksize:02X}"
            steps.append(step(sent, *([done + crc] if with_crc else []), done + "0000"))
            steps.append(step("A1", wait=20000))
            yield from steps[: {"begun": 1, "sent": -2, "ended": -1}.get(row.get("until", ""), len(steps))]
        else:
            raise ValueError(f"transfer {kind}")


def little(value: int, size: int) -> str:
    return value.to_bytes(size, "little").hex().upper()


def pieces(value: bytes) -> list[bytes]:
    return [value[at : at + 7] for at in range(0, len(value), 7)] or [b""]
