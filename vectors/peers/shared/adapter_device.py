"""For the adapters of CANopen devices: the kind `device-conformance`, run on the device of a library.

`make()` builds the device, switched on and in PRE-OPERATIONAL. Its `hear(frame)` takes a frame, as text, and returns
what it sends at once; `wait(seconds)` lets time pass and returns what its timers send. `has` are the conditions that it
fulfils beside objects: LSS, a large object (2100h) ... OBJECTS describes a device with most objects, as in the kind
`device`. What a case asks of this device, and which frames fit, is that of ../../judge/py.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "judge" / "py"))

import fill
from adapter import Answers, NotOffered, hexed
from adapter_canopen import listed
from patterns import fits_frames, parts

Step = dict[str, Any]
PATIENCE, A_MOMENT, TICK = 0.5, 0.01, 0.005
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
    {**row, "mapped": MAPPED.get(row["object"], "no")}
    for access, kind, places in PLAIN
    for row in listed(kind, access, places)
]


class Device(Protocol):
    """A device of a library."""

    node: int
    has: tuple[str, ...]

    def hear(self, frame: str) -> list[str]: ...

    def wait(self, seconds: float) -> list[str]: ...


class Objects:
    """The objects of a device, each read by SDO when it is asked for the first time."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.values: dict[tuple[int, int], bytes | None] = {}
        self.read(0x1000, 0)  # every device has it: without it nothing would show that the device answers

    def read(self, index: int, sub: int) -> bytes | None:
        """Return the value of an object, None if the device refuses it."""
        if (index, sub) not in self.values:
            self.values[index, sub] = self._upload(index, sub)
        return self.values[index, sub]

    def _ask(self, text: str) -> bytes:
        frames = self.device.hear(f"{0x600 + self.device.node:03X}#{text.ljust(16, '0')}")
        data = [frame[4:] for frame in frames if frame.startswith(f"{0x580 + self.device.node:03X}#")]
        return bytes.fromhex(data[0]) if data else b"\x80"

    def _upload(self, index: int, sub: int) -> bytes | None:
        answer = self._ask(f"40{fill.little(index, 2)}{sub:02X}")
        if answer[0] & 0xE0 != 0x40:
            return None
        if answer[0] & 2:
            return answer[4 : 8 - (answer[0] >> 2 & 3 if answer[0] & 1 else 0)]
        value, toggle = b"", 0
        while True:
            answer = self._ask(f"{0x60 | toggle << 4:02X}")
            value += answer[1 : 8 - (answer[0] >> 1 & 7)]
            if answer[0] & 0xE1 != 0:
                return value
            toggle ^= 1

    def described(self) -> Step:
        """Return what an answer says of the device: what it has, and the values that the case asked for."""
        read = {f"{index:04X}:{sub:02X}": value for (index, sub), value in self.values.items() if value is not None}
        device = {"node": self.device.node, "has": list(self.device.has), "large": "{:04X}:{:02X}".format(*LARGE)}
        return device | {"objects": {name: hexed(value) for name, value in read.items()}}


def carry_out(device: Device, row: Step, listens: tuple[str, ...], *, is_last: bool) -> tuple[str, list[str]]:
    """Carry out one step; return the pattern list that fits, "accept", "ends" or none, and what was received."""
    received: list[str] = []

    def judged() -> str:
        for name, patterns in (("ends", row["ends"]), ("accept", row["accept"])):
            if any(fits_frames(parts(pattern), received) for pattern in patterns):
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

    def run(question: Step) -> Step:
        asked = make()
        objects = Objects(asked)
        filled = fill.Device(asked.node, asked.has, LARGE, objects.read)
        rows = fill.fill(question, filled)
        if rows is None:
            raise NotOffered("this case is for another device")
        if question["effect"] == "power" or (question["effect"] == "stores" and "stores" not in asked.has):
            raise NotOffered("the device does not store values, or is not switched off")
        names = fill.Values(filled, {"node": asked.node})
        listens = tuple(map(names.fill, question.get("listens", ["<580+node>#"])))
        device, received = make(), []
        for number, row in enumerate(rows, 1):
            state, frames = carry_out(device, row, listens, is_last=number == len(rows))
            received.append(frames)
            if state != "accept":
                break
        return {"device": objects.described(), "received": received}

    return {"device-conformance": {"run": run}}
