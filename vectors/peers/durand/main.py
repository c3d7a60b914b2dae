"""durand as an adapter: its CANopen devices, on a network that only records, in its virtual time."""

from __future__ import annotations

import logging
from functools import partial
from threading import Lock
from typing import Any

from adapter import NotOffered, number, octets, serve
from adapter_canopen import place_of
from adapter_device import NODE, OBJECTS, device_answers
from durand.datatypes import DatatypeEnum
from durand.network import NetworkABC
from durand.node import Node, NodeCapabilities
from durand.object_dictionary import Record, Variable
from durand.scheduler import AbstractScheduler, set_scheduler

logging.disable()
SERVICES = {0x1000, 0x1001, 0x1005, 0x1014, 0x1015, 0x1017, 0x1018, 0x1200, 0x1201}
PDO = {0x1400, 0x1600, 0x1800, 0x1A00}
ACCESS = {"ro": "ro", "const": "const", "wo": "wo", "rw": "rw", "rwr": "rw", "rww": "rw"}
UNCONFIGURED = 0xFF


class Clock(AbstractScheduler[int]):
    """Virtual time: its own one stands still while a callback runs."""

    def __init__(self) -> None:
        self.now, self.count, self.lock_of_it = 0.0, 0, Lock()
        self.entries: dict[int, tuple[float, Any]] = {}

    def add(self, delay: float, callback: Any, args: Any = (), kwargs: Any = None) -> int:
        self.count += 1
        self.entries[self.count] = (self.now + delay, partial(callback, *args, **(kwargs or {})))
        return self.count

    def cancel(self, entry: int) -> None:
        self.entries.pop(entry, None)

    @property
    def lock(self) -> Lock:
        return self.lock_of_it

    def run(self, until: float) -> None:
        """Let the time pass."""
        while self.entries and (first := min((at, entry) for entry, (at, _) in self.entries.items()))[0] <= until:
            self.now, callback = self.entries.pop(first[1])
            callback()
        self.now = until


class Recorder(NetworkABC):
    """A network that keeps what is sent."""

    def __init__(self) -> None:
        self.callbacks: dict[int, Any] = {}
        self.sent: list[str] = []

    def add_subscription(self, cob_id: int, callback: Any) -> None:
        self.callbacks[cob_id] = callback

    def remove_subscription(self, cob_id: int, callback: Any = None) -> None:
        self.callbacks.pop(cob_id, None)

    def send(self, cob_id: int, msg: bytes) -> None:
        self.sent.append(f"{cob_id:03X}#{bytes(msg).hex().upper()}")

    def hear(self, frame: str) -> None:
        name, _, data = frame.partition("#")
        if data.startswith(("R", "#")) or len(name) > 3:
            raise NotOffered("its networks have neither remote nor extended frames")
        if callback := self.callbacks.get(int(name, 16)):
            callback(int(name, 16), octets(data))

    def take(self) -> list[str]:
        sent, self.sent = self.sent, []
        return sent


def value_of(row: dict[str, Any]) -> Any:
    """Return the value of an object as the library keeps it."""
    value = row.get("value")
    if row["type"] == "VISIBLE_STRING":
        return (value or "").encode("latin-1")
    if row["type"] in ("OCTET_STRING", "DOMAIN"):
        return octets(value or "")
    return bool(int(value)) if row["type"] == "BOOLEAN" and value else number(value or "0")


def variable(row: dict[str, Any]) -> Variable:
    if row["type"] not in DatatypeEnum.__members__:
        raise NotOffered(f"it has no {row['type']}")
    limits = {name: number(row[key]) for name, key in (("minimum", "low"), ("maximum", "high")) if key in row}
    return Variable(DatatypeEnum[row["type"]], ACCESS[row["access"]], value_of(row), **limits)


class Device:
    """A device of the library, switched on."""

    def __init__(self, rows: dict[tuple[int, int], dict[str, Any]], node: int | None, *, lss: bool) -> None:
        self.clock, self.network = Clock(), Recorder()
        set_scheduler(self.clock)
        here = [
            sum((first + at, 1) in rows or (first + at, 0) in rows for at in range(4)) for first in (0x1400, 0x1800)
        ]
        capabilities = NodeCapabilities(sdo_servers=2 if (0x1201, 1) in rows else 1, rpdos=here[0], tpdos=here[1])
        self.own = Node(self.network, node or UNCONFIGURED, capabilities=capabilities)
        if node is None:
            self.network.take()  # its application connects it to the bus only now: the library boots as node FFh
        if not lss:
            self.network.remove_subscription(0x7E5)
        configure(self.own, rows)


def device(question: dict[str, Any]) -> dict[str, Any]:
    setup = question["device"]
    rows = {place_of(row): row for row in setup["objects"]}
    if not all(known(index) for index, _ in rows):
        raise NotOffered("it has no such service")
    if any("error" in act or "clear" in act for step in question["talk"] for act in step.get("act", ())):
        raise NotOffered("which errors are active, its application keeps")
    here = Device(rows, setup["id"], lss=bool(setup.get("lss")))
    talk = []
    for step in question["talk"]:
        here.clock.run(step["at"] / 1e6)
        for frame in step.get("hear", ()):
            here.network.hear(frame)
        for act in step.get("act", ()):
            here.own.object_dictionary.write(*place_of({"object": act["set"]}), number(act["value"]))
        talk.append({"say": here.network.take()})
    return {"talk": talk}


class Tested(Device):
    """The device with most objects, for device-conformance."""

    node, has = NODE, ("LSS", "LSS identify remote slave", "large object")

    def __init__(self) -> None:
        super().__init__({place_of(row): row for row in OBJECTS if known(place_of(row)[0])}, NODE, lss=True)
        self.network.take()

    def hear(self, frame: str) -> list[str]:
        self.network.hear(frame)
        return self.network.take()

    def wait(self, seconds: float) -> list[str]:
        self.clock.run(self.clock.now + seconds)
        return self.network.take()


def known(index: int) -> bool:
    """Return whether the library has the service of an object, or it belongs to the application."""
    return index >= 0x2000 or index in SERVICES or any(index in range(first, first + 4) for first in PDO)


def configure(node: Node, rows: dict[tuple[int, int], dict[str, Any]]) -> None:
    """Give a device the objects of a case: its own services keep theirs, and take the values of the case."""
    dictionary = node.object_dictionary
    listed = {index for index, _ in rows} | {0x1000, 0x1001, 0x1018}
    for index in [index for index, _ in dictionary if index not in listed]:
        dictionary._variables.pop(index, None)
        dictionary._objects.pop(index, None)
    late = []
    for (index, sub), row in rows.items():
        mapping = index & 0xFE00 in PDO and index >= 0x1600 and index & 0x0200
        if index in dictionary and index < 0x1A10 and (mapping or has(dictionary, index, sub)):
            late.append((sub == 0, index, sub, value_of(row)))  # the number of mapped objects last
        elif sub or any(place == (index, 1) for place in rows):
            if index not in dictionary:
                dictionary[index] = Record()
            if sub:
                dictionary[index][sub] = variable(row)
        else:
            dictionary[index] = variable(row)
    for _, index, sub, value in sorted(late):
        if index in (0x1000, 0x1018):
            dictionary.write(index, sub, value)
        elif (index, sub) != (0x1018, 0) and not (sub == 0 and isinstance(dictionary[index], Record)):
            dictionary.write(index, sub, value, downloaded=True)


def has(dictionary: Any, index: int, sub: int) -> bool:
    found = dictionary[index]
    return sub == 0 if isinstance(found, Variable) else sub in found


serve("durand", {"device": {"run": device}, **device_answers(Tested)})
