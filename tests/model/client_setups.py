"""The alphabets of `clients`: the carriers, every option of a client, and all trouble that the assumptions allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

from barewire.rtu import encode
from tests.model.units import (
    DIAGNOSE,
    ECHO,
    PLAIN,
    READ,
    READ_IMAGE,
    READ_INPUT,
    READ_OTHER_UNIT,
    SLOW_ECHO,
    WRITE,
    Adapter,
    Fate,
    Framing,
    Setup,
)

TIMEOUT = 0.3
WINDOW = 3 * TIMEOUT
MILLISECONDS = tuple(step / 1000 for step in range(int(1000 * WINDOW)))
OTHERS_SEND = (False,) * 100 + (True,)
"""Whether a question has to wait for another master, which never makes a pause of t3.5 for longer than a time-out."""
OTHERS = tuple((0.0019 * step, encode(9, b"\x03\x02\xee\xee")) for step in range(300))
Stretch = Literal["trouble", "burst", "calm", "dead"]
World = Literal["blocking", "asyncio", "gateway"]


class Carrier(NamedTuple):
    """A URL, and how answers travel."""

    url: str
    framing: Framing
    any_transaction: bool = False
    any_unit: bool = False
    adapters: tuple[Adapter, ...] = ()


CARRIERS = {
    "RTU": Carrier("rtu:///dev/virtual", "rtu"),
    "ASCII": Carrier("ascii:///dev/virtual", "ascii"),
    "RTU over TCP": Carrier("rtu+tcp://unit:4001", "rtu"),
    "TCP": Carrier("tcp://unit", "tcp"),
    "TCP, any_transaction": Carrier("tcp://unit?any_transaction=1", "tcp", any_transaction=True),
    "UDP": Carrier("udp://unit", "tcp"),
}
"""Those that are played with default options."""
OTHER_CARRIERS = {
    "RTU, echo": Carrier("rtu:///dev/virtual?echo=1", "rtu", adapters=(ECHO, SLOW_ECHO)),
    "RTU, echo to be detected": Carrier("rtu:///dev/virtual?echo=auto", "rtu", adapters=(SLOW_ECHO, PLAIN)),
    "RTU, strict": Carrier("rtu:///dev/virtual?patience=strict", "rtu"),
    "RTU, UART": Carrier("rtu:///dev/virtual?latency=uart", "rtu"),
    "RTU, 600 bit/s": Carrier("rtu:///dev/virtual?baudrate=600", "rtu"),
    "RTU, 115200 bit/s": Carrier("rtu:///dev/virtual?baudrate=115200", "rtu"),
    "ASCII over TCP": Carrier("ascii+tcp://unit:4001", "ascii"),
    "TCP, any_unit": Carrier("tcp://unit?any_unit=1", "tcp"),
    "TCP, any_transaction, any_unit": Carrier("tcp://unit?any_transaction=1&any_unit=1", "tcp", True, True),
}
"""Those whose options concern their frames."""
OPTIONS: tuple[dict[str, Any], ...] = (
    {},
    {"recovery": "wait"},
    {"late_window": 0.2},
    {"late_window": 0.9},
    {"late_window": 2.0},
    {"retries": 2},
    {"retries": 1, "recovery": "wait"},
    {"gap": 0.05},
    {"units": {1: {"gap": 0.1}}},
    {"units": {1: {"timeout": 0.6, "gap": 0.02}, 2: {"timeout": 0.1, "dead_after": 1, "longest_pause": 2.0}}},
    {"gap": 0.05, "dead_after": 1, "units": {1: {"gap": 0.0, "dead_after": 0}, 2: {"timeout": 0.05}}},
    {"dead_after": 2},
    {"dead_after": 1, "longest_pause": 4.0},
    {"reconnect_first": 0.01, "reconnect_longest": 0.02},
)
CALLS: tuple[dict[str, Any], ...] = (
    *({}, {}, {"timeout": 0.1}, {"timeout": 0.5}, {"retries": 1}, {"retries": 1, "repeat_writes": True}),
)


@dataclass(frozen=True)
class Clients:
    """The alphabet of a scenario. `line` has the choices of the line."""

    carrier: Carrier
    line: Setup
    length: int = 48
    worlds: tuple[World, ...] = ("blocking", "asyncio")
    workers: tuple[int, ...] = (1, 1, 3)
    """How many threads, or tasks, ask at the same time."""
    stretches: tuple[Stretch, ...] = ("trouble",) * 6 + ("burst",) + ("calm",) * 3
    give_up_after: Sequence[float | None] = (*[None] * 12, 0.0, 0.001, 0.02, 0.1, 0.31, 0.6)
    fail_after: tuple[float | None, ...] = (None,) * 60 + (0.05, 0.4)
    """When the connection fails, in seconds after a question began."""
    lines_until_error: Sequence[int | None] = (None,)
    """After how many executed lines of barewire an exception is raised in a question, as by a handler of a signal."""
    options: tuple[dict[str, Any], ...] = ({},)
    """Options of the client besides the URL and the time-out."""
    calls: tuple[dict[str, Any], ...] = ({},)
    """Arguments of `ask` besides the request and the unit."""
    in_flight: tuple[int, ...] = (1,)
    """For asyncio."""


FATES = (
    *[Fate.ARRIVES] * 8,
    *[Fate.LOST, Fate.IS_AN_EXCEPTION, Fate.DAMAGED, Fate.DOUBLED_AT_ONCE] * 2,
    *(Fate.IN_PIECES, Fate.FLOODED, Fate.AFTER_STRAY),
)
TROUBLE = Setup(
    questions=(READ, READ, READ_INPUT, READ_OTHER_UNIT, WRITE, READ_IMAGE, DIAGNOSE),
    fates=FATES,
    delays=(*[0.002] * 300, *MILLISECONDS),
    probing=("echoes", "declines", "declines", "ignores"),
    timeout=TIMEOUT,
    any_damage=True,
)


def default_options(name: str) -> Clients:
    """The alphabet of a carrier: everything that the assumptions allow, and no option."""
    carrier = (CARRIERS | OTHER_CARRIERS)[name]
    line = replace(TROUBLE, framing=carrier.framing, any_transaction=carrier.any_transaction, adapters=carrier.adapters)
    if carrier.any_unit:  # the assumption of this option
        line = replace(line, questions=tuple(question for question in line.questions if question.unit == 1))
    if line.framing == "tcp":  # TCP and UDP carry no damaged bytes, and a number tells late answers and copies apart
        fates = tuple(fate for fate in FATES if fate not in (Fate.DAMAGED, Fate.AFTER_STRAY))
        line = replace(line, fates=fates)
    if line.numbered:
        line = replace(line, fates=(*line.fates, Fate.DOUBLED_LATER, Fate.AFTER_ANOTHER_NUMBER), probing=("ignores",))
        line = replace(line, delays=(*line.delays, 1.2, 2.0))
    return Clients(carrier, line)


def every_option(name: str) -> Clients:
    """The same with every option of a client and of its calls."""
    setup = default_options(name)
    in_flight = (1, 2, 16) if setup.line.numbered else (1,)
    stretches: tuple[Stretch, ...] = (*setup.stretches, "dead")
    worlds: tuple[World, ...] = ("blocking", "asyncio", "asyncio", "gateway")
    return replace(setup, worlds=worlds, options=OPTIONS, calls=CALLS, in_flight=in_flight, stretches=stretches)


def errors_at_lines(name: str) -> Clients:
    """The same as with default options, and exceptions at any line of the package."""
    return replace(default_options(name), lines_until_error=(None,) * 600 + tuple(range(300)))
