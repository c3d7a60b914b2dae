"""Conformance of LSS, for a device that has it and has a node-ID.   [CiA 305]"""

from __future__ import annotations

from collections.abc import Iterator

from barewire.canopen.conformance.battery import SILENCE, Effect, NodeCase, NodeStep, Subject
from barewire.canopen.conformance.frames import Sdo, little, row
from barewire.canopen.lss.messages import LssAddress

CLAUSE = "CiA 305 LSS"


def rows(subject: Subject) -> Iterator[NodeCase]:
    """The cases for this device."""
    node = subject.node
    s = Sdo(node)
    address = subject.lss or LssAddress(1, 2, 3, 4)

    def case(name: str, title: str, *turns: NodeStep, effect: Effect = "commands", why: str = "") -> NodeCase:
        hears = ("7E4#", s.told("")[:4])
        # Whatever became of the case, nobody is left in CONFIGURATION.
        done = (*turns, NodeStep((_ask("04 00"),), (SILENCE,), wait=0.02))
        return row(subject, name, title, CLAUSE, done, effect=effect, hears=hears, needs=("LSS",), why=why)

    def silence(*says: str) -> NodeStep:
        return NodeStep(says, (SILENCE,), wait=0.1)

    def select(*numbers: int) -> tuple[str, ...]:
        return tuple(_ask(f"{0x40 + place:02X}{little(one, 4)}") for place, one in enumerate(numbers))

    def identify(vendor: int, low: int, high: int) -> tuple[str, ...]:
        numbers = (vendor, address.product, low, high, address.serial, address.serial)
        return tuple(_ask(f"{0x46 + place:02X}{little(one, 4)}") for place, one in enumerate(numbers))

    switch = silence(_ask("04 01"))
    node_is = NodeStep((_ask("5E"),), (_told(f"5E{node:02X}"),))
    yield case("LSS-01", "all to CONFIGURATION: it tells its node-ID", switch, node_is)
    for place, what in enumerate(("vendor-ID", "product code", "revision number", "serial number")):
        ask = NodeStep((_ask(f"{0x5A + place:02X}"),), (_told(f"{0x5A + place:02X}{little(address[place], 4)}"),))
        yield case(f"LSS-0{2 + place}", f"it tells its {what}, as 1018h:0{place + 1}", switch, ask)
    yield case("LSS-06", "in WAITING nothing is told", silence(_ask("5E"), _ask("5A"), _ask("11 05"), _ask("17")))
    selected = NodeStep(select(*address), (_told("44"),))
    yield case("LSS-07", "selected by its whole address", selected, node_is)
    other = silence(*select(*address[:3], address.serial ^ 1))
    yield case("LSS-08", "another serial number selects somebody else", other, silence(_ask("5E")))
    disordered = silence(*(select(*address)[place] for place in (1, 0, 3, 2)))
    yield case("LSS-09", "the parts of the address out of order select nobody", disordered, silence(_ask("5E")))
    found = NodeStep(identify(address.vendor, 0, 0xFFFF_FFFF), (_told("4F"),))
    yield case("LSS-10", "identified by limits that hold it", found, effect="reads")
    yield case("LSS-11", "another vendor: not identified", silence(*identify(address.vendor ^ 1, 0, 0xFFFF_FFFF)),
               effect="reads")  # fmt: skip
    highest = 0xFFFF_FFFF
    above = (address.revision + 1, highest) if address.revision < highest else (0, highest - 1)
    yield case("LSS-12", "a revision outside the limits: not identified", silence(*identify(address.vendor, *above)),
               effect="reads")  # fmt: skip
    yield case("LSS-13", "it has a node-ID: not among those without", silence(_ask("4C")), effect="reads")
    yield case("LSS-14", "it has a node-ID: no answer in a fastscan", silence(_ask("51 00000000 80")), effect="reads")
    for name, number in (("LSS-15", 0), ("LSS-16", 128)):
        wrong = NodeStep((_ask(f"11{number:02X}"),), (_told("1101"), _told("11FF")))
        yield case(name, f"node-ID {number} is out of range", switch, wrong, node_is, why="error 1")
    same = NodeStep((_ask(f"11{node:02X}"),), (_told("1100"),))
    yield case("LSS-17", "its own node-ID again", switch, same, node_is)
    reserved = NodeStep((_ask("13 00 05"),), (_told("1301"), _told("13FF")))
    yield case("LSS-18", "bit rate 5 of table 0 is reserved", switch, reserved, why="error 1")
    table = NodeStep((_ask("13 7F 00"),), (_told("1301"), _told("13FF")))
    yield case("LSS-19", "a bit rate table that does not exist", switch, table, why="error 1")
    yield case("LSS-20", "a service that does not exist", switch, silence(_ask("60")), node_is)
    stop = silence(f"000#02{node:02X}")
    yield case("LSS-21", "LSS works in STOPPED", stop, switch, node_is)
    short = silence("7E5#0401")
    yield case("LSS-22", "a request of two bytes is none", short, silence(_ask("5E")), why="LSS frames have 8 bytes")


def _ask(text: str) -> str:
    return f"7E5#{text.replace(' ', '').ljust(16, '0')}"


def _told(text: str) -> str:
    return f"7E4#{text.ljust(16, '.')}"
