"""For the adapters of CANopen devices: the kind `device-conformance`, run on the device of a library.

`make()` builds the device, switched on and in PRE-OPERATIONAL. Its `hear(frame)` takes a frame, as text, and returns
what it sends at once; `wait(seconds)` lets time pass and returns what its timers send. `has` are the conditions that it
fulfils beside objects: LSS, a large object (2100h) ... OBJECTS describes a device with most objects, as in the kind
`device`.
"""

from __future__ import annotations

import re
from binascii import crc_hqx
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from adapter import Answers, NotOffered, hexed

Step = dict[str, Any]
TERM = re.compile("([-+^|&]?)((?:[0-9A-F]{4}|[a-z.]+):(?:[0-9A-F]{2}|[a-z]+)|[a-z.]+|[0-9A-F]+)")
BRACKETS = re.compile(r"\[.*?\]")
PATIENCE, A_MOMENT, TICK = 0.5, 0.01, 0.005
TEXTS = (0x1008, 0x1009, 0x100A)
NODE, LARGE = 5, (0x2100, 0)
MAPPED = {"6040:00": "RPDO", "6041:00": "TPDO"}
PLAIN = (
    ("const", "UNSIGNED32", "1000:00=131474 1018:01=864 1018:02=4660 1018:03=65538 1018:04=7"),
    ("const", "VISIBLE_STRING", "1008:00=a_device_with_most_objects"),
    ("ro", "UNSIGNED8", "1001:00=0"),
    ("ro", "UNSIGNED16", "6041:00=1591"),
    ("ro", "UNSIGNED32", "1003:01=0 1003:02=0 1003:03=0 1003:04=0 1200:01=1541 1200:02=1413"),
    ("rw", "UNSIGNED8", "100D:00=0 1019:00=0 1029:01=0 1400:02=255 1600:00=1 1800:02=1 1800:06=0 1A00:00=1"),
    ("rw", "UNSIGNED16", "100C:00=0 1017:00=0 1400:05=0 1800:03=0 1800:05=0 6040:00=0"),
    ("rw", "UNSIGNED32", "1005:00=128 1006:00=0 1014:00=133 1016:01=0 1016:02=0 1016:03=0 1016:04=0"),
    ("rw", "UNSIGNED32", "1400:01=517 1600:01=1614807056 1800:01=389 1A00:01=1614872592"),
    ("rw", "UNSIGNED32", " ".join(f"{index}:{sub:02X}=0" for index in ("1600", "1A00") for sub in range(2, 9))),
    ("rw", "UNSIGNED32", "1012:00=256 1007:00=0"),
    ("rw", "UNSIGNED32", " ".join(f"{index}:0{sub}=2147483648" for index in (1201, 1280) for sub in (1, 2))),
    ("rw", "DOMAIN", "2100:00="),
)
OBJECTS = [
    {"object": place, "type": kind, "access": access, "value": value, "mapped": MAPPED.get(place, "no")}
    for access, kind, listed in PLAIN
    for place, _, value in (one.partition("=") for one in listed.split())
]


class Device(Protocol):
    """A device of a library."""

    node: int
    has: tuple[str, ...]

    def hear(self, frame: str) -> list[str]: ...

    def wait(self, seconds: float) -> list[str]: ...


class Values:
    """What stands for the placeholders of a case."""

    def __init__(self, device: Device) -> None:
        self.device, self.node = device, device.node
        self.variables = {"node": device.node, "other": 125 if device.node == 126 else 126}
        self.variables |= {"large.index": LARGE[0], "large.sub": LARGE[1]}
        self.read: dict[tuple[int, int], bytes | None] = {}
        self.upload(0x1000, 0)  # every device has it: without it nothing would show that the device answers

    def upload(self, index: int, sub: int) -> bytes | None:
        """Return the value of an object, None if the device refuses it."""
        if (index, sub) not in self.read:
            self.read[index, sub] = self._upload(index, sub)
        return self.read[index, sub]

    def _upload(self, index: int, sub: int) -> bytes | None:
        def ask(text: str) -> bytes:
            frames = self.device.hear(f"{0x600 + self.node:03X}#{text.ljust(16, '0')}")
            data = [frame[4:] for frame in frames if frame.startswith(f"{0x580 + self.node:03X}#")]
            return bytes.fromhex(data[0]) if data else b"\x80"

        answer = ask("40" + place(index, sub))
        if answer[0] & 0xE0 != 0x40:
            return None
        if answer[0] & 2:
            return answer[4 : 8 - (answer[0] >> 2 & 3 if answer[0] & 1 else 0)]
        value, toggle = b"", 0
        while True:
            answer = ask(f"{0x60 | toggle << 4:02X}")
            value += answer[1 : 8 - (answer[0] >> 1 & 7)]
            if answer[0] & 0xE1 != 0:
                return value
            toggle ^= 1

    def number(self, index: int, sub: int) -> int:
        return int.from_bytes(self.upload(index, sub) or b"", "little")

    def pdo(self, kind: str) -> dict[str, int] | None:
        """Return the first PDO that is on, and what the placeholders say of it."""
        first = 0x1400 if kind == "rpdo" else 0x1800
        for record, mapping in ((first + n, first + 0x200 + n) for n in range(4)):
            word, count = self.number(record, 1), self.number(mapping, 0)
            if word and not word >> 31 and not word >> 29 & 1 and 1 <= count <= 64:
                bits = [self.number(mapping, sub) & 0xFF for sub in range(1, count + 1)]
                found = {"record": record, "mapping": mapping, "word": word, "cob": word & 0x7FF}
                return found | {"size": (sum(bits) + 7) // 8, "toomany": 64 // (bits[0] or 64) + 1}
        return None

    def text(self) -> tuple[int, bytes] | None:
        found = ((index, self.upload(index, 0) or b"") for index in TEXTS)
        return next(((index, value) for index, value in found if len(value) >= 8), None)

    def named(self, name: str) -> int:
        if name in self.variables:
            return self.variables[name]
        group, _, field = name.partition(".")
        if group in ("servers", "clients"):
            span = range(0x1202, 0x1280) if group == "servers" else range(0x1281, 0x1300)
            pairs = (at for at in span if self.upload(at, 1) is not None and self.upload(at, 2) is not None)
            return next(pairs, span[0])
        if group == "text":
            index, value = self.text() or (0x1008, bytes(8))
            return {"index": index, "size": len(value), "segments": len(pieces(value))}[field]
        return (self.pdo(group) or {}).get(field, 0)

    def calculate(self, expression: str) -> int:
        total = 0
        for sign, term in TERM.findall(expression):
            if ":" in term:
                index, _, sub = term.partition(":")
                value = self.number(self.calculate(index), self.calculate(sub))
            else:
                value = int(term, 16) if re.fullmatch("[0-9A-F]+", term) else self.named(term)
            total = {
                "": value,
                "+": total + value,
                "-": total - value,
                "^": total ^ value,
                "|": total | value,
                "&": total & value,
            }[sign]
        return total

    def fill(self, text: str) -> str:
        return re.sub("<(.*?)>", lambda found: self.word(found[1]), text)

    def word(self, inside: str) -> str:
        unit, star, times = inside.partition("*")
        if star:
            return unit * self.calculate(times)
        expression, slash, size = inside.partition("/")
        value = self.calculate(expression)
        if slash:
            width = int(size)
            return (value & (1 << 8 * width) - 1).to_bytes(width, "little").hex().upper()
        digits = re.match("[0-9A-F]+", inside)
        assert digits is not None
        return f"{value:0{len(digits[0])}X}"

    def has(self, condition: str) -> bool:
        """Return whether a condition holds."""
        if " is " in condition:
            left, right = condition.split(" is ")
            return left != right[4:] if right.startswith("not ") else left == right
        if condition.startswith("no "):
            return not self.has(condition[3:])
        if condition in ("RPDO", "TPDO"):
            return self.pdo(condition.lower()) is not None
        if condition.startswith("text of"):
            text = self.text()
            return text is not None and (condition == "text of 8 bytes" or len(text[1]) <= 140)
        if not re.match("[0-9A-F]{4}h", condition):
            return condition in self.device.has
        return self.upload(int(condition[:4], 16), int(condition[6:] or "0", 16)) is not None

    def described(self) -> dict[str, Any]:
        """Return what an answer says of the device: what it has, and the values that the case asked for."""
        read = {f"{index:04X}:{sub:02X}": value for (index, sub), value in self.read.items() if value is not None}
        device = {"node": self.node, "has": list(self.device.has), "large": "{:04X}:{:02X}".format(*LARGE)}
        return device | {"objects": {name: hexed(value) for name, value in read.items()}}

    def holds(self, row: Step) -> bool:
        return all(self.has(self.fill(one)) for one in row.get("if", ()))


def place(index: int, sub: int) -> str:
    return f"{index & 0xFF:02X}{index >> 8:02X}{sub:02X}"


def pieces(value: bytes) -> list[bytes]:
    return [value[at : at + 7] for at in range(0, len(value), 7)] or [b""]


def steps(rows: list[Step], values: Values) -> Iterator[Step]:
    """Yield the steps with what the loops, transfers and placeholders stand for."""
    for row in rows:
        if "each" in row:
            for text in map(values.fill, row["in"]):
                first, _, last = text.partition("-")
                for one in range(int(first, 16), int(last or first, 16) + 1):
                    values.variables[row["each"]] = one
                    if values.holds(row):
                        yield from steps(row["steps"], values)
        elif values.holds(row):
            if "transfer" in row:
                yield from transfer(row, values)
            else:
                lists = {
                    name: [values.fill(text) for text in row[name]]
                    for name in ("send", "accept", "ends")
                    if name in row
                }
                yield {**row, **lists}


def transfer(row: Step, values: Values) -> Iterator[Step]:
    """Yield the steps of a transfer."""
    if row["of"] == "text":
        index, value = values.text() or (0, b"")
        at = place(index, 0)
    else:
        at, value = values.fill(row["of"]), bytes.fromhex(values.fill(row["value"]))
    size, cut, kind = len(value).to_bytes(4, "little").hex(), pieces(value), row["transfer"]
    last, aborted = len(cut), ["80......01000405|", "80......00000008"]

    def step(request: str, *accept: str, **more: Any) -> Step:
        sends = [f"{0x600 + values.node:03X}#{request.ljust(16, '0').upper()}"]
        return {"send": sends, "accept": [answer(text) for text in accept] or [""], **more}

    def answer(text: str) -> str:
        return f"{0x580 + values.node:03X}#{text.upper()}{'.' * (16 - len(re.sub(BRACKETS, '.', text)))}"

    def segment(number: int) -> str:
        data = cut[number - 1]
        return f"{(number - 1 & 1) << 4 | 7 - len(data) << 1 | (number == last):02X}{data.hex()}"

    def numbered(number: int, begin: int) -> str:
        return f"{number - begin + 1 | (number == last) << 7:02X}{cut[number - 1].hex()}"

    def block(begin: int, end: int) -> str:
        return ", ".join(answer(numbered(number, begin)) for number in range(begin, min(end, last) + 1))

    ends = f"{0xC1 | 7 - len(cut[-1]) << 2:02X}"
    crc = crc_hqx(value, 0).to_bytes(2, "little").hex()
    no_blocks = ["|".join(answer(text.strip("|")) for text in aborted)]
    count = row.get("segments", last)
    if kind == "upload":
        yield step("40" + at, "41" + at + size, "40" + at)
        yield from (step("6070"[(n - 1) % 2 * 2 :][:2], segment(n)) for n in range(1, count + 1))
    elif kind == "download":
        announced = row.get("size", len(value)).to_bytes(4, "little").hex()
        yield step("21" + at + announced, "60" + at)
        yield from (step(segment(n), "2030"[(n - 1) % 2 * 2 :][:2]) for n in range(1, count + 1))
    elif kind == "block segments":
        yield {
            "send": [values.fill(text) for text in row["send"]],
            "accept": [block(row.get("from", 1), row.get("to", last))],
        }
    elif kind == "block download":
        yield step("C6" + at + size, "A[04]" + at, ends=no_blocks)
        sends = [f"{0x600 + values.node:03X}#{numbered(n, 1).ljust(16, '0').upper()}" for n in range(1, last + 1)]
        yield {"send": sends, "accept": [answer(f"A2{last:02X}")]}
        yield step(ends + crc, "A1")
    else:
        with_crc, blksize = row.get("crc", True), row.get("blksize", 20)
        begun = step(f"{'A4' if with_crc else 'A0'}{at}{blksize:02X}", f"C[26]{at}{size}", f"C[04]{at}", ends=no_blocks)
        done, request = [begun], "A3"
        for first in range(1, last + 1, blksize):
            end = min(first + blksize - 1, last)
            done.append(step(request, accept=[block(first, end)]) | {"accept": [block(first, end)]})
            request = f"A2{end - first + 1:02X}{blksize:02X}"
        done.append(step(request, *([ends + crc] if with_crc else []), ends + "0000"))
        done.append(step("A1", wait=20000))
        yield from done[: {"begun": 1, "sent": -2, "ended": -1}.get(row.get("until", ""), len(done))]


def fits(pattern: str, frames: list[str]) -> bool:
    """Return whether the frames that were received are those of a pattern."""
    regex = ""
    for part in re.split(r",(?![0-9])", pattern) if pattern else ():
        frame, brace, count = part.strip().partition("{")
        regex += f"(?:(?:{frame.replace('.', '[0-9A-F]')}) ){brace}{count}"
    return re.fullmatch(regex, "".join(f"{frame} " for frame in frames)) is not None


def carry_out(device: Device, row: Step, listens: tuple[str, ...], *, is_last: bool) -> tuple[str, list[str]]:
    """Carry out one step; return the pattern list that fits, "accept", "ends" or none, and what was received."""
    received: list[str] = []

    def judged() -> str:
        for name, patterns in (("ends", row.get("ends", [])), ("accept", row.get("accept", [""]))):
            if any(fits(pattern, received) for pattern in patterns):
                return name
        return ""

    for frame in row.get("send", ()):
        received += [one for one in device.hear(frame) if one.startswith(listens)]
    left = row["wait"] / 1e6 - 1e-6 if "wait" in row else PATIENCE  # without what comes at the end itself
    while left > 0 and (row.get("whole") or not received or not judged()):
        received += [one for one in device.wait(min(left, TICK)) if one.startswith(listens)]
        left -= TICK
    if is_last and left > 0:
        received += [one for one in device.wait(A_MOMENT) if one.startswith(listens)]
    return judged(), received


def device_answers(make: Callable[[], Device]) -> Answers:
    """Return the answers of an adapter."""

    def run(question: dict[str, Any]) -> dict[str, Any]:
        values = Values(make())
        if not values.holds(question):
            raise NotOffered("another device has this case")
        for need in question.get("needs", ()):
            if not values.has(values.fill(need)):
                raise NotOffered(f"the device lacks {values.fill(need)}")
        if question["effect"] == "power" or (question["effect"] == "stores" and "stores" not in values.device.has):
            raise NotOffered("the device does not store values, or is not switched off")
        rows = list(steps(question["steps"], values))
        listens = tuple(map(values.fill, question.get("listens", ["<580+node>#"])))
        device, received = make(), []
        for number, row in enumerate(rows, 1):
            state, frames = carry_out(device, row, listens, is_last=number == len(rows))
            received.append(frames)
            if state != "accept":
                break
        return {"device": values.described(), "received": received}

    return {"device-conformance": {"run": run}}
