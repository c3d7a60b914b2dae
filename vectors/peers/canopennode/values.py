"""Single values and frames: identifiers, entries of 1016h, LSS messages. Each is seen at a node that has it."""

from __future__ import annotations

import ctypes
from typing import Any

from adapter import NotOffered, Refused, hexed, octets
from adapter_canopen import ALWAYS, listed, variables
from bus import LIBRARY, NEEDED, build, feed, run, said, start, start_master

PDOS = listed("UNSIGNED32", "rw", f"1012:00={1 << 31 | 0x100}")
PDOS += [{"object": "2000:00", "type": "UNSIGNED8", "access": "rw", "value": "0", "mapped": "both"}]
for at in range(4):
    for base, first in ((0x1400, 0x200), (0x1800, 0x180)):
        PDOS += listed(
            "UNSIGNED32", "rw", f"{base + at:X}:01={first + at * 0x100} {base + at + 0x200:X}:01={0x2000_0008}"
        )
        PDOS += listed("UNSIGNED8", "rw", f"{base + at:X}:02=255 {base + at + 0x200:X}:00=1")
LETTERS = {"NMT": "N", "SYNC": "S", "EMCY": "E", "TIME": "T", "SDO request": "q", "SDO answer": "a"}
LETTERS |= {"error control": "h", "LSS request": "L", "LSS answer": "l"}


def cob_id(question: dict[str, Any]) -> dict[str, Any]:
    """Return the identifier that a node uses for a service of the predefined connection set."""
    service, node = question["service"], question["node"]
    is_pdo = service[1:4] == "PDO"
    whole_bus = ("NMT", "SYNC", "TIME", "LSS request", "LSS answer")
    if (node == 0) != (service in whole_bus):
        raise NotOffered("it has no function for an identifier alone, and no node 0")
    build([*ALWAYS, *NEEDED, *PDOS])
    if start(node or 1, lss=1):
        raise Refused(said())
    letter, number = (service[0].lower(), int(service[4:])) if is_pdo else (LETTERS[service], 0)
    return {"cob_id": f"{LIBRARY.identifier(ord(letter), number):03X}"}


def restricted(question: dict[str, Any]) -> dict[str, Any]:
    return {"restricted": bool(LIBRARY.restricted(int(question["cob_id"], 16)))}


def heartbeat_consumer(question: dict[str, Any]) -> dict[str, Any]:
    """Return what its consumer makes of an entry of 1016h."""
    value = int.from_bytes(octets(question["bytes"]), "little")
    if len(octets(question["bytes"])) != 4:
        raise NotOffered("an entry has 32 bits in its object dictionary")
    start_master({"object": "1016:01", "type": "UNSIGNED32", "access": "rw", "value": str(value)})
    node, milliseconds = ctypes.c_uint(), ctypes.c_uint()
    if not LIBRARY.consumer(ctypes.byref(node), ctypes.byref(milliseconds)):
        return {"node": None, "milliseconds": None}
    return {"node": node.value, "milliseconds": milliseconds.value}


def lss_frame(question: dict[str, Any]) -> dict[str, Any]:
    """Return the frame of a service, as the master or the slave sends it."""
    service, body = int(question["service"], 16), octets(question["body"])
    frames = from_master(service, body) if question["side"] == "request" else from_slave(service, body)
    found = [line for line in frames if int(line[4:6], 16) == service and line[:3] in ("7E4", "7E5")]
    if service == 0x51:  # one step of many: the one with this bit, part and next part
        found = [line for line in found if octets(line[14:]) == body[4:7]]
    if not found:
        raise NotOffered("CANopenNode does not send this service")
    return {"cob_id": found[-1][:3], "data": hexed(octets(found[-1][4:]))}


def from_master(service: int, body: bytes) -> list[str]:
    """Return the frames of a service of the LSS master that this message is a part of."""
    number = int.from_bytes(body[:4], "little")
    start_master()
    if 0x40 <= service <= 0x43:
        service_is, values = "S", [number if at == service - 0x40 else 0 for at in range(4)]
    elif service == 0x51 and body[5] < 4 and (body[4] in (0, 0x80) or not number):
        known = number and not body[4]
        service_is, values = "F", [number if at == body[5] and known else 0 for at in range(4)]
        values += [2 if at <= body[5] and known else 0 for at in range(4)]
    elif service == 0x04 and body[0] < 2:
        service_is, values = "WG"[body[0]], []
    else:
        raise NotOffered("asked of other services with lss-talk only")
    LIBRARY.lss_start(ord(service_is), (ctypes.c_uint32 * 8)(*values))
    frames: list[str] = []
    ended = False
    while not ended:
        run(10_000)
        lines = said()
        ended = any(line.startswith("lss") for line in lines)
        new = [line for line in lines if line.startswith("7E5")]
        frames += new
        for line in new:
            if line[4:6] == "51":
                feed("7E4#4F00000000000000")
    return frames


ERRORS = {0x11: {0: 7, 1: 128}, 0x13: {0: 4, 1: 200}, 0x17: {1: 0}}
"""What leads to these errors: a node-ID, an entry of the table of bit rates, a slave without storage."""


def from_slave(service: int, body: bytes) -> list[str]:
    """Return the answer of an LSS slave to the request for which it says this."""
    address = [0x360, 0x10203, 0x20001, 0xDEADBEEF]
    if 0x5A <= service <= 0x5D:
        address[service - 0x5A] = int.from_bytes(body[:4], "little")
    node = body[0] if service == 0x5E else 5
    others = [row for row in (*ALWAYS, *NEEDED) if row["object"] != "1018:01"]
    build([*others, *variables(0x1018, address, access="const")])
    start(None if node == 255 or service == 0x4F else node, lss=2)
    said()
    if service == 0x44:
        requests = [bytes([0x40 + at]) + number.to_bytes(4, "little") for at, number in enumerate(address)]
    elif service == 0x4F:
        requests = [bytes([0x51, 0, 0, 0, 0, 0x80])]
    elif service in ERRORS and body[0] in ERRORS[service] and not body[1]:
        number = ERRORS[service][body[0]]
        requests = [b"\x04\x01", bytes([service, *([0] if service == 0x13 else []), number])]
    elif 0x5A <= service <= 0x5E:
        requests = [b"\x04\x01", bytes([service])]
    else:
        raise NotOffered("CANopenNode does not answer so")
    for request in requests:
        feed(f"7E5#{request.ljust(8, bytes(1)).hex().upper()}")
    return said()
