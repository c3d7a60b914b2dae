"""For the adapters of servers: units with tables, asked step by step.

`make(line, units, described)` builds the library's server: `units` are tables, `described` the units as the case has
them. It has `ask(unit, pdu)`, which returns the PDU of the answer or None for silence, and `values(unit, table, first,
count)`, which reads the tables without a request. `hear(data)` is for bytes that are no frame, `overrun()` for a
character that the port has lost, `files(unit)` for the files in the end. `more` is what a library has besides tables.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import Any, Protocol

from adapter import Answers, NotOffered, bits, bitted, hexed, octets, worded, words

TABLES = ("coils", "discrete_inputs", "holding_registers", "input_registers")
PUBLIC = {*range(1, 9), 0x0B, 0x0C, 0x0F, 0x10, 0x11, 0x14, 0x15, 0x16, 0x17, 0x18, 0x2B}
"""The functions of the standard: one that a library does not have is not offered, one that nobody has is asked."""

Units = dict[int, dict[str, dict[int, list[int]]]]


class Server(Protocol):
    """A server of a library."""

    def ask(self, unit: int, pdu: bytes) -> bytes | None: ...

    def values(self, unit: int, table: str, first: int, count: int) -> list[int]: ...


def server_answers(
    make: Callable[..., Server], codes: set[int], lines: set[str], more: Collection[str] = ()
) -> Answers:
    """Return the answers of a server that has these functions, on these lines, and `more` than tables."""

    def run(question: dict[str, Any]) -> dict[str, Any]:
        server = question["server"]
        asked = {octets(step["ask"])[0] for step in question["talk"] if step.get("ask")}
        if server["line"] not in lines:
            raise NotOffered("not on this line")
        if not hasattr(make, "stream") and any("stream" in step for step in question["talk"]):
            raise NotOffered("only its PDUs are seen")
        if not hasattr(make, "overrun") and any("overrun" in step for step in question["talk"]):
            raise NotOffered("the library is not told of lost characters")
        if any({*unit} - {*TABLES, *more} for unit in server["units"].values()):
            raise NotOffered("the library has no such setting of a unit")
        if asked & PUBLIC - codes - absent(server["units"].values()):
            raise NotOffered("the library has no such function")
        units = {
            int(address): {
                table: {int(first): numbers(table, text) for first, text in blocks.items()}
                for table, blocks in unit.items()
                if table in TABLES
            }
            for address, unit in server["units"].items()
        }
        described = {int(address): unit for address, unit in server["units"].items()}
        theirs = make(server["line"], units, described)
        if not hasattr(theirs, "hear") and any("raw" in step for step in question["talk"]):
            raise NotOffered("the library is given whole frames")
        try:
            return played(theirs, units, question["talk"])
        finally:
            getattr(theirs, "close", lambda: None)()

    return {"server": {"run": run}}


def played(theirs: Server, units: Units, steps: list[dict[str, Any]]) -> dict[str, Any]:
    """Ask step by step, then read the tables."""
    talk = []
    for step in steps:
        if "overrun" in step:
            answer = getattr(theirs, "overrun")()  # noqa: B009 - only some have it
        elif "stream" in step:
            answer = getattr(theirs, "stream")(octets(step["stream"])) or None  # noqa: B009 - only some have it
        elif "raw" in step:
            answer = getattr(theirs, "hear")(octets(step["raw"])) or None  # noqa: B009 - only some have it
        else:
            answer = theirs.ask(step["unit"], octets(step["ask"]))
        talk.append({"say": None if answer is None else hexed(answer)})
    then: dict[str, dict[str, Any]] = {
        str(address): {
            table: {
                str(first): written(table, theirs.values(address, table, first, len(row)))
                for first, row in blocks.items()
            }
            for table, blocks in unit.items()
        }
        for address, unit in units.items()
    }
    if files := getattr(theirs, "files", None):
        for address in units:
            then[str(address)]["files"] = {str(name): worded(row) for name, row in files(address).items()}
    return {"talk": talk, "then": then}


def absent(units: Iterable[dict[str, Any]]) -> set[int]:
    """Return the functions that none of the units has: a library answers them as it does unknown ones."""
    rows = [{int(code[:2], 16) for code in unit["functions"]} if "functions" in unit else PUBLIC for unit in units]
    return PUBLIC - set().union(*rows)


def numbers(table: str, text: str) -> list[int]:
    return [int(bit) for bit in bits(text)] if table in ("coils", "discrete_inputs") else words(text)


def written(table: str, row: list[int]) -> str:
    return bitted(row) if table in ("coils", "discrete_inputs") else worded(row)
