"""The goals of the benchmarks: ratios between contestants of one run. `tools/bench_page.py` reports which are met."""

from __future__ import annotations

from collections.abc import Iterator
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
    return [
        *_of_checksums(),
        *_of_frames(),
        *_of_canopen(),
        *_of_can_buses(),
        *_of_tcp(),
        *_of_imports(),
        *_of_commands(),
    ]


def _of_checksums() -> Iterator[Goal]:
    for text, size, other, limit in (
        ("CRC of 254 bytes: 4 x faster than a table", 254, "byte table", 1 / 4),
        ("... than pymodbus", 254, "pymodbus", 1 / 4),
        ("CRC of 64 KiB: 20 x faster than a table", 65536, "byte table", 1 / 20),
        ("... at most 1.3 x crcmod's C", 65536, "crcmod in C", 1.3),
        ("CRC of 6 bytes: no slower than a table", 6, "byte table", 1.05),
        ("... of 26 bytes, the longest that uses the table", 26, "byte table", 1.05),
        ("... of 27 bytes, the shortest that is folded", 27, "byte table", 1.05),
    ):
        yield Goal(text, "CRC-16", "one frame", size, other, limit)


def _of_frames() -> Iterator[Goal]:
    registers = "registers of one answer"
    for size, limit in ((1, 2.5), (8, 2.5), (62, 1.5), (125, 1.5)):
        text = f"RTU, {size} register{'s' if size > 1 else ''}: at most {limit} x the time by hand"
        yield Goal(text, "RTU response", registers, size, "by hand", limit)
    yield Goal("RTU, 8: 2.5 x faster than pymodbus", "RTU response", registers, 8, "pymodbus", 1 / 2.5)
    yield Goal("RTU, 125: 8 x faster than pymodbus", "RTU response", registers, 125, "pymodbus", 1 / 8)
    for framing in ("ASCII", "TCP"):
        for size in (8, 125):
            text = f"{framing}, {size}: 2 x faster than pymodbus"
            yield Goal(text, f"{framing} response", registers, size, "pymodbus", 1 / 2)
    for framing in ("RTU", "ASCII", "TCP"):
        text, what = f"A request, {framing}: faster than pymodbus", f"read 10 registers, {framing}"
        yield Goal(text, "Building a request", what, 10, "pymodbus", 1.0)


def _of_canopen() -> Iterator[Goal]:
    what = "TPDO of the AZ3 to named values"
    yield Goal("TPDO: 5 x faster than the canopen library", "PDO", what, 4, "canopen", 1 / 5)
    for how, place in (("in memory", "in memory"), ("python-can", "python-can's virtual bus")):
        text = f"SDO upload, each with its own server, {place}: 3 x faster than the canopen library"
        yield Goal(text, "SDO", f"upload, each with its own server, {how}", 1 << 14, "canopen", 1 / 3)
    both = ", both with our server"
    for how, server in (("the client alone", ""), ("in memory", both), ("python-can's virtual bus", both)):
        for verb in ("upload", "download"):
            text = f"SDO block {verb}, {how}{server}: 3 x faster than the canopen library"
            yield Goal(text, "SDO", f"block {verb}, {how}", 1 << 20, "canopen", 1 / 3)


def _of_can_buses() -> Iterator[Goal]:
    family, pair = "CAN bus", "a socket pair"
    for place, text, limit in (
        (pair, "2 x faster than the canopen library", 1 / 2),
        ("python-can's virtual bus", "ahead of the canopen library", 1.0),
    ):
        what = f"expedited read, {place}"
        yield Goal(f"Expedited reads, {place}: {text}", family, what, 4, "canopen", limit)
        yield Goal("... asyncio at most 1.3 x blocking", family, what, 4, "barewire", 1.3, "barewire, asyncio")
    for verb in ("upload", "download"):
        what = f"block {verb}, {pair}"
        yield Goal(f"1 MiB block {verb}, {pair}: 3 x the canopen library", family, what, 1 << 20, "canopen", 1 / 3)
    for verb in ("received", "sent"):
        yield Goal(f"A frame {verb}: 4 x python-can", family, f"a frame {verb}, {pair}", 8, "python-can", 1 / 4)
    what = f"a frame of 2,000 a second, {pair}"
    yield Goal("`frames()`: at most 1.5 x our raw port", family, what, 8, "barewire, the port", 1.5)


def _of_tcp() -> Iterator[Goal]:
    for place in ("two cores", "one core"):
        family, what = "TCP client, blocking", "10 registers"
        yield Goal(f"Blocking client, {place}: 0.9 of a raw socket", family, what, place, "raw socket", 1 / 0.9)
        for other in ("pymodbus", "pyModbusTCP"):
            yield Goal(f"... ahead of {other}", family, what, place, other, 1.0)
        family, what = "TCP client, asyncio", "10 registers, 1 in flight"
        yield Goal(f"Asyncio client, {place}: 0.8 of a raw protocol", family, what, place, "raw protocol", 1 / 0.8)
        for other in ("pymodbus", "tmodbus"):
            yield Goal(f"... ahead of {other}", family, what, place, other, 1.0)
        text, what = f"16 in flight, {place}: 3 x one in flight", "10 registers, 16 in flight"
        yield Goal(text, family, what, place, "barewire, 1 in flight", 1 / 3)
        family, what = "TCP server", "10 registers, 1 at once"
        for contestant, server in _SERVERS:
            text = f"{server}, {place}: 0.8 of a raw asyncio protocol"
            yield Goal(text, family, what, place, "raw asyncio", 1 / 0.8, contestant)
            for other in ("pymodbus", "tmodbus", "pyModbusTCP"):
                yield Goal(f"... ahead of {other}", family, what, place, other, 1.0, contestant)
    family, what = "TCP server, connections", "10 registers of each at once"
    for contestant, server in _SERVERS:
        for other in ("raw asyncio", "pyModbusTCP"):
            yield Goal(f"{server}, 64 connections: ahead of {other}", family, what, 64, other, 1.0, contestant)


_SERVERS = (("barewire, asyncio", "Asyncio server"), ("barewire", "Server in a thread"))


def _of_imports() -> Iterator[Goal]:
    place = ("Import", "in a new interpreter", "each")
    for memory in (False, True):
        word = "memory" if memory else "time"
        for room in ("rtu", "ascii", "tcp", "codecs"):
            contestant = f"barewire.{room}"
            text = f"import {contestant}, {word}: a quarter of pymodbus.client"
            yield Goal(text, *place, "pymodbus.client", 1 / 4, contestant, memory)
            yield Goal("... below minimalmodbus", *place, "minimalmodbus", 1.0, contestant, memory)
        for more in ("", ", a URL and its first message"):
            contestant = f"barewire blocking TCP client{more}"
            text = f"{contestant}, {word}: half of pymodbus.client"
            yield Goal(text, *place, "pymodbus.client", 1 / 2, contestant, memory)


def _of_commands() -> Iterator[Goal]:
    start = ("Start", "in a new interpreter", "once", "python, import click")
    yield Goal('load("az3"): at most 2/3 of python with click', *start, 40 / 60, 'load("az3")')
    yield Goal("barewire read, first line: at most 4.2 x python with click", *start, 250 / 60, "barewire read")
    for count in (1, 3, 10):
        text = f"A read of {count} by name: at most 1.3 x the raw read"
        yield Goal(text, "Named read", "values of the ADXL", count, "raw read", 1.3)
