"""The goals of the benchmarks: ratios between contestants of one run. `tools/bench_page.py` reports which are met."""

from __future__ import annotations

from typing import NamedTuple


class Goal(NamedTuple):
    """`contestant` takes at most `limit` times the time of `other`, or times its memory if `memory` is set."""

    text: str
    family: str
    what: str
    size: int | str
    other: str
    limit: float
    contestant: str = "barewire"
    memory: bool = False


def goals() -> list[Goal]:
    """Return all goals, in the order of the page."""
    found = [
        Goal("CRC of 254 bytes: 4 x faster than a table", "CRC-16", "one frame", 254, "byte table", 1 / 4),
        Goal("... than pymodbus", "CRC-16", "one frame", 254, "pymodbus", 1 / 4),
        Goal("CRC of 64 KiB: 20 x faster than a table", "CRC-16", "one frame", 65536, "byte table", 1 / 20),
        Goal("... at most 1.3 x crcmod's C", "CRC-16", "one frame", 65536, "crcmod in C", 1.3),
        Goal("CRC of 6 bytes: no slower than a table", "CRC-16", "one frame", 6, "byte table", 1.05),
        Goal("... of 26 bytes, the longest that uses the table", "CRC-16", "one frame", 26, "byte table", 1.05),
        Goal("... of 27 bytes, the shortest that is folded", "CRC-16", "one frame", 27, "byte table", 1.05),
    ]
    one = "registers of one answer"
    for size, limit in ((1, 2.5), (8, 2.5), (62, 1.5), (125, 1.5)):
        text = f"RTU, {size} register{'s' if size > 1 else ''}: at most {limit} x the time by hand"
        found.append(Goal(text, "RTU response", one, size, "by hand", limit))
    found.append(Goal("RTU, 8: 2.5 x faster than pymodbus", "RTU response", one, 8, "pymodbus", 1 / 2.5))
    found.append(Goal("RTU, 125: 8 x faster than pymodbus", "RTU response", one, 125, "pymodbus", 1 / 8))
    for envelope in ("ASCII", "TCP"):
        for size in (8, 125):
            text = f"{envelope}, {size}: 2 x faster than pymodbus"
            found.append(Goal(text, f"{envelope} response", one, size, "pymodbus", 1 / 2))
    for envelope in ("RTU", "ASCII", "TCP"):
        text, what = f"A request, {envelope}: faster than pymodbus", f"read 10 registers, {envelope}"
        found.append(Goal(text, "Building a request", what, 10, "pymodbus", 1.0))
    what = "TPDO of the AZ3 to named values"
    found.append(Goal("TPDO: 5 x faster than the canopen library", "PDO", what, 4, "canopen", 1 / 5))
    for how, place in (("in memory", "in memory"), ("python-can", "python-can's virtual bus")):
        text = f"SDO upload, each with its own server, {place}: 3 x faster than the canopen library"
        found.append(Goal(text, "SDO", f"upload, each with its own server, {how}", 1 << 14, "canopen", 1 / 3))
    both = ", both with our server"
    for how, server in (("the client alone", ""), ("in memory", both), ("python-can's virtual bus", both)):
        for verb in ("upload", "download"):
            text = f"SDO block {verb}, {how}{server}: 3 x faster than the canopen library"
            found.append(Goal(text, "SDO", f"block {verb}, {how}", 1 << 20, "canopen", 1 / 3))
    for place in ("two cores", "one core"):
        blocking, client, server = "TCP client, blocking", "TCP client, asyncio", "TCP server"
        found.append(
            Goal(
                f"Blocking client, {place}: 0.9 of a raw socket", blocking, "10 registers", place, "raw socket", 1 / 0.9
            )
        )
        for other in ("pymodbus", "pyModbusTCP"):
            found.append(Goal(f"... ahead of {other}", blocking, "10 registers", place, other, 1.0))
        what = "10 registers, 1 in flight"
        found.append(
            Goal(f"Asyncio client, {place}: 0.8 of a raw protocol", client, what, place, "raw protocol", 1 / 0.8)
        )
        for other in ("pymodbus", "tmodbus"):
            found.append(Goal(f"... ahead of {other}", client, what, place, other, 1.0))
        what = "10 registers, 16 in flight"
        text = f"16 in flight, {place}: 3 x one in flight"
        found.append(Goal(text, client, what, place, "barewire, 1 in flight", 1 / 3))
        what = "10 registers, 1 at once"
        for contestant in ("barewire, asyncio", "barewire"):
            kind = "Asyncio server" if contestant != "barewire" else "Server in a thread"
            text = f"{kind}, {place}: 0.8 of a raw asyncio protocol"
            found.append(Goal(text, server, what, place, "raw asyncio", 1 / 0.8, contestant))
            for other in ("pymodbus", "tmodbus", "pyModbusTCP"):
                found.append(Goal(f"... ahead of {other}", server, what, place, other, 1.0, contestant))
    many = "10 registers of each at once"
    for contestant, kind in (("barewire, asyncio", "Asyncio server"), ("barewire", "Server in a thread")):
        for other in ("raw asyncio", "pyModbusTCP"):
            text = f"{kind}, 64 connections: ahead of {other}"
            found.append(Goal(text, "TCP server, connections", many, 64, other, 1.0, contestant))
    for memory in (False, True):
        word = "memory" if memory else "time"
        for room in ("rtu", "ascii", "tcp", "codecs"):
            contestant, what = f"barewire.{room}", "in a new interpreter"
            text = f"import {contestant}, {word}: a quarter of pymodbus.client"
            found.append(Goal(text, "Import", what, "each", "pymodbus.client", 1 / 4, contestant, memory))
            found.append(
                Goal("... below minimalmodbus", "Import", what, "each", "minimalmodbus", 1.0, contestant, memory)
            )
        for more in ("", ", a URL and its first message"):
            contestant = f"barewire blocking TCP client{more}"
            text = f"{contestant}, {word}: half of pymodbus.client"
            found.append(Goal(text, "Import", what, "each", "pymodbus.client", 1 / 2, contestant, memory))
    start = ("Start", "in a new interpreter", "once", "python, import click")
    found.append(Goal('load("az3"): at most 2/3 of python with click', *start, 40 / 60, 'load("az3")'))
    found.append(Goal("barewire read, first line: at most 4.2 x python with click", *start, 250 / 60, "barewire read"))
    for count in (1, 3, 10):
        text = f"A read of {count} by name: at most 1.3 x the raw read"
        found.append(Goal(text, "Named read", "values of the ADXL", count, "raw read", 1.3))
    return found
