"""Conformance cases of LSS, for a device that supports it and has a node-ID.   [CiA 305]"""

from __future__ import annotations

from collections.abc import Iterator

from barewire.canopen.conformance.frames import IDENTIFY, Sdo, little, make_case, silence
from barewire.canopen.conformance.model import SILENCE, Effect, NodeCase, NodeStep, Subject
from barewire.canopen.lss.messages import LssAddress

# Each case is a row: name, title, steps, needs, reason.
# fmt: off

_CLAUSE = "CiA 305 LSS"


def lss_cases(subject: Subject) -> Iterator[NodeCase]:
    """Yield the cases of this service for one device."""
    node = subject.node
    s = Sdo(node)
    address = subject.lss or LssAddress(1, 2, 3, 4)

    def case(
        name: str, title: str, *steps: NodeStep, effect: Effect = "commands", why: str = "", more: tuple[str, ...] = ()
    ) -> NodeCase:
        # However the case ends, no device is left in CONFIGURATION.
        done = (*steps, silence(_request("04 00"), wait=0.02))
        return make_case(
            subject, _CLAUSE, ("7E4#", s.responses), name, title, *done, effect=effect, needs=("LSS", *more), why=why
        )

    def ignored(*sends: str) -> NodeStep:
        return silence(*sends, wait=0.1)

    def select(*numbers: int) -> tuple[str, ...]:
        return tuple(_request(f"{0x40 + number:02X}{little(part, 4)}") for number, part in enumerate(numbers))

    def identify(vendor: int, low: int, high: int) -> tuple[str, ...]:
        numbers = (vendor, address.product, low, high, address.serial, address.serial)
        return tuple(_request(f"{0x46 + number:02X}{little(part, 4)}") for number, part in enumerate(numbers))

    switch = ignored(_request("04 01"))
    node_is = NodeStep((_request("5E"),), (_answer(f"5E{node:02X}"),))
    yield case("LSS-01", "all to CONFIGURATION: inquire the node-ID", switch, node_is)
    for number, part in enumerate(("vendor-ID", "product code", "revision number", "serial number")):
        ask = NodeStep(
            (_request(f"{0x5A + number:02X}"),), (_answer(f"{0x5A + number:02X}{little(address[number], 4)}"),)
        )
        yield case(f"LSS-0{2 + number}", f"inquire the {part}, as 1018h:0{number + 1}", switch, ask)
    yield case("LSS-06", "in WAITING there is no answer",
               ignored(_request("5E"), _request("5A"), _request("11 05"), _request("17")))
    selected = NodeStep(select(*address), (_answer("44"),))
    yield case("LSS-07", "selected by its whole address", selected, node_is)
    other = ignored(*select(*address[:3], address.serial ^ 1))
    yield case("LSS-08", "another serial number does not select the device", other, ignored(_request("5E")))
    sends = (*(select(*address)[number] for number in (1, 0, 3, 2)), _request("04 00"))
    disordered = NodeStep(sends, (SILENCE, _answer("44")), wait=0.1, full_wait=True)
    yield case("LSS-09", "the parts of the address out of order, then in order", disordered,
               ignored(_request("5E")), selected, why="devices differ in what the wrong order selects")
    found = NodeStep(identify(address.vendor, 0, 0xFFFF_FFFF), (_answer("4F"),))
    yield case("LSS-10", "identified by limits that contain it", found, effect="reads",
               more=(IDENTIFY,))
    yield case("LSS-11", "another vendor: not identified", ignored(*identify(address.vendor ^ 1, 0, 0xFFFF_FFFF)),
               effect="reads", more=(IDENTIFY,))
    highest = 0xFFFF_FFFF
    above = (address.revision + 1, highest) if address.revision < highest else (0, highest - 1)
    yield case("LSS-12", "a revision outside the limits: not identified", ignored(*identify(address.vendor, *above)),
               effect="reads", more=(IDENTIFY,))
    yield case("LSS-13", "configured: no answer to 'identify non-configured devices'", ignored(_request("4C")),
               effect="reads")
    yield case("LSS-14", "configured: no answer in a fastscan", ignored(_request("51 00000000 80")), effect="reads")
    for name, wrong_id in (("LSS-15", 0), ("LSS-16", 128)):
        wrong = NodeStep((_request(f"11{wrong_id:02X}"),), (_answer("1101"), _answer("11FF")))
        yield case(name, f"node-ID {wrong_id} is out of range", switch, wrong, node_is, why="error 1")
    same = NodeStep((_request(f"11{node:02X}"),), (_answer("1100"),))
    yield case("LSS-17", "its own node-ID again", switch, same, node_is)
    reserved = NodeStep((_request("13 00 05"),), (_answer("1301"), _answer("13FF"), SILENCE))
    optional = "error 1; no answer without this optional service"
    yield case("LSS-18", "bit rate 5 of table 0 is reserved", switch, reserved, why=optional)
    table = NodeStep((_request("13 7F 00"),), (_answer("1301"), _answer("13FF"), SILENCE))
    yield case("LSS-19", "a bit rate table that does not exist", switch, table, why=optional)
    yield case("LSS-20", "a service that does not exist", switch, ignored(_request("60")), node_is)
    stop = ignored(f"000#02{node:02X}")
    yield case("LSS-21", "LSS works in STOPPED", stop, switch, node_is)
    short = ignored("7E5#0401")
    yield case("LSS-22", "a request of two bytes is ignored", short, ignored(_request("5E")),
               why="LSS frames have 8 bytes")


def _request(text: str) -> str:
    return f"7E5#{text.replace(' ', '').ljust(16, '0')}"


def _answer(text: str) -> str:
    return f"7E4#{text.ljust(16, '.')}"
