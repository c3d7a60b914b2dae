"""The node of CANopenNode in the library that the first argument names: objects, frames, time.

build(rows)               the object dictionary, from rows as a case has them
start(5)                  the node, as after power-on
feed("605#40..."), run(1000)
said()                    frames and events since the last call, a line of text each
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterable
from typing import Any

from adapter import NotOffered, octets
from adapter_canopen import ALWAYS, STRINGS, listed, placed, value_bytes, variables

LIBRARY = ctypes.CDLL(sys.argv[1])
LIBRARY.take.restype = ctypes.c_char_p

ACCESS = {"ro": 1, "const": 1, "wo": 2, "rw": 3, "rwr": 3, "rww": 3}
MAPPED = {"TPDO": 4, "RPDO": 8, "both": 12}
SPACE = 300
NEEDED = listed("UNSIGNED32", "rw", "1003:01=0 1005:00=128 1006:00=0 1014:00=128")
NEEDED += listed("UNSIGNED16", "rw", "100C:00=0 1017:00=0") + listed("UNSIGNED8", "rw", "100D:00=0")
"""Objects without which CANopenNode does not start; it is not asked about them where a device has none."""

OWN = 126
"""The node-ID of a node that is a master."""

SECOND = 1_000_000


def run(microseconds: int) -> None:
    LIBRARY.run(microseconds)


def feed(line: str) -> None:
    """Let a frame arrive: "605#4000200000000000"."""
    ident, _, text = line.partition("#")
    if len(ident) > 3:
        return  # an extended frame passes no filter of CANopenNode's drivers
    remote = text.startswith("R")
    data = b"" if remote else octets(text)
    LIBRARY.feed(int(ident, 16), remote, int(text[1:] or 0) if remote else len(data), data)


def said() -> list[str]:
    """Return what CANopenNode said since the last call."""
    return LIBRARY.take().decode("latin-1").splitlines()


def stored(row: dict[str, Any]) -> tuple[bytes, int, int]:
    """Return the bytes of the default value of an object, the room of a domain, and the attributes for its type."""
    kind = row["type"]
    if kind.startswith("TIME_"):
        raise NotOffered("its editor of object dictionaries makes no variable of this type")
    data = value_bytes(kind, row.get("value"))
    if kind in ("DOMAIN", "OCTET_STRING"):
        return data, SPACE * 8, 0
    if kind in STRINGS:
        return (data if row.get("mapped", "no") != "no" else data.ljust(SPACE, b"\0")), 0, 0x80
    return data, 0, 0x40 if len(data) > 1 else 0


def build(rows: Iterable[dict[str, Any]]) -> None:
    """Make the object dictionary."""
    LIBRARY.clear()
    objects = placed(rows)
    records = {index for index, sub in objects if sub}
    for (index, sub), row in sorted(objects.items()):
        data, room, kind = stored(row)
        attribute = ACCESS[row["access"]] | MAPPED.get(row.get("mapped", "no"), 0) | kind
        if LIBRARY.object(index, sub, index not in records, attribute, data, len(data), room):
            raise NotOffered("more objects than the adapter has room for")


def settled(heard: bool = True) -> list[str]:
    """Return what is said until it is silent; after a step that hears nothing time passes until something is said."""
    lines: list[str] = []
    for _ in range(600):
        run(0)
        new = said()
        lines += new
        if not new and (heard or lines):
            break
        if not lines:
            run(100_000)
    return lines


def start(node: int | None, *, lss: int = 0, master: bool = False, control: int = 0) -> int:
    """Switch the node on and return 0, or CANopenNode's number of what it does not start with."""
    wrong: int = LIBRARY.start(node or 255, lss, master, control)
    run(0)
    return wrong if wrong != UNCONFIGURED else 0


UNCONFIGURED = -19
"""CANopenNode waits for a node-ID."""

MASTER = (
    variables(0x1280, [1 << 31] * 2) + listed("UNSIGNED8", "rw", "1280:03=1") + listed("UNSIGNED8", "ro", "1280:00=3")
)


def start_master(*rows: dict[str, Any]) -> None:
    """Start a node with all masters; what it says while it starts is not of interest."""
    build([*ALWAYS, *NEEDED, *MASTER, *rows])
    start(OWN, master=True)
    run(SECOND)
    said()
