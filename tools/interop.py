"""Keeps docs/interop.md: `python tools/interop.py` after every change of a test in tests/interop.

    tests/interop/*.py   @pytest.mark.evidence(stranger, role, carrier, *services)     said by a test, and checked by it
            |  collected, not run
            v
    docs/interop.md      function x carrier -> tested against whom; holes and marks with a slip are errors

The tests of the page call the same functions. Collecting needs every stranger but tmodbus, which its tests import late.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from barewire.modbus.messages.diagnostics import SUB_FUNCTIONS
from barewire.modbus.messages.registry import known_requests

ROOT = Path(__file__).parent.parent
TESTS = ROOT / "tests" / "interop"
PAGE = ROOT / "docs" / "interop.md"
OURSELVES = "ourselves"

CARRIERS = ("rtu", "ascii", "tcp", "udp", "tls", "rtu+tcp", "ascii+tcp")
CAN_CARRIERS = ("virtual", "slcan", "socketcand", "socketcan", "udp_multicast", "file")
ROLES = {"server": "their clients use our server", "client": "our clients use their servers"}


class Stranger(NamedTuple):
    """Somebody else's program, and the carriers that it has itself: on others it stands behind socat or the like."""

    short: str
    what: str
    carriers: tuple[str, ...]


MODBUS = {
    "pymodbus": Stranger("pm", "Python library 3.16; blocking client, asyncio servers", CARRIERS),
    "tmodbus": Stranger("tm", "Python library 1.1 for Python 3.12 and later; asyncio", CARRIERS[:-1]),
    "libmodbus": Stranger("lm", "C library 3.1.6 of Debian, in two programs of ours", ("rtu", "tcp")),
    "mbpoll": Stranger("mb", "command line program 1.4 of Debian, on libmodbus; a client", ("rtu", "tcp")),
    "minimalmodbus": Stranger("mm", "Python library 2.1 for serial ports; a client", ("rtu", "ascii")),
    "pyModbusTCP": Stranger("pt", "Python library 0.3; blocking client and server", ("tcp",)),
    OURSELVES: Stranger("-", "nobody else speaks it: our own other side, see below", CARRIERS),
}
OTHERS = {"tshark": "the dissectors of Wireshark 4.0"}
CANOPEN = {
    "canopen": "Python library 2.4; master and node",
    "python-can": "Python library 4.6; frames",
    "candump": "can-utils of Debian; frames",
    "cansend": "can-utils of Debian; frames",
    "tshark": "the dissectors of Wireshark 4.0",
}
CANOPEN_ROLES = {"master": "our master, their device", "device": "our device, their master"}
CANOPEN_SERVICES = (
    *("SDO expedited upload", "SDO expedited download", "SDO segmented upload", "SDO segmented download"),
    *("SDO block upload", "SDO block download", "SDO abort", "NMT command", "boot-up", "heartbeat", "node guarding"),
    *("EMCY", "SYNC", "TIME", "TPDO", "RPDO", "PDO mapping", "LSS switch", "LSS identify", "LSS inquire"),
    *("LSS configure", "LSS fastscan", "EDS"),
)
STANDS_IN = {
    "2B/0D": "CANopen General Reference: no program that could be had speaks it, in any direction. Its bytes are those "
    "of two manuals (`vectors/`); both dialects go between our own client and our own server over every carrier, and "
    "tshark tells its MEI type.",
}
"""Modbus functions for which there is no stranger, and why."""
_NO_BLOCKS = "their node has none: it answers an upload with segments, which our master takes, and refuses a download"
_NO_SLAVE = "there is a master in the library, and no slave"
CANOPEN_STANDS_IN = {
    ("SDO block upload", "master"): _NO_BLOCKS,
    ("SDO block download", "master"): _NO_BLOCKS,
    ("node guarding", "master"): "their node does not answer remote frames",
    ("LSS switch", "master"): _NO_SLAVE,
    ("LSS identify", "master"): _NO_SLAVE,
    ("LSS inquire", "master"): _NO_SLAVE,
    ("LSS configure", "master"): _NO_SLAVE,
    ("LSS fastscan", "master"): _NO_SLAVE,
}
"""Service and role of CANopen for which there is none, and why."""
NOT_ONE_FRAME = ("PDO mapping", "EDS")
"""Of CANopen, what no dissector can tell: a mapping is written by SDO, and a file is no frame."""


class Evidence(NamedTuple):
    """One mark of one test."""

    stranger: str
    role: str
    carrier: str
    services: tuple[str, ...]
    test: str


def functions() -> dict[str, str]:
    """Every public function of Modbus: how it is named here, and in the standard."""
    found: dict[str, str] = {}
    for request in known_requests():
        code = f"{request.function_code:02X}"
        if code == "08":
            found |= {f"08/{sub:02X}": f"Diagnostics: {name}" for sub, name in SUB_FUNCTIONS.items()}
        elif code == "2B":
            mei = "0D" if request.name.startswith("CANopen") else "0E"
            found[f"2B/{mei}"] = request.name
        else:
            found[code] = request.name
    return found


@cache
def evidence() -> tuple[Evidence, ...]:
    """Every mark, collected by a pytest of its own: nothing is run."""
    with tempfile.TemporaryDirectory() as where:
        file = Path(where, "marks.json")
        command = [sys.executable, str(Path(__file__).resolve()), "--marks", str(file)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
        if not file.exists():
            raise SystemExit(f"the tests cannot be collected:\n{done.stdout}{done.stderr}")
        rows = json.loads(file.read_text(encoding="utf-8"))
    return tuple(Evidence(who, role, over, tuple(services), test) for who, role, over, services, test in rows)


def collect(file: Path) -> int:
    """What `evidence` has done in a process of its own. Files that are named are collected whatever conftest says."""
    import pytest

    class Collector:
        def pytest_collection_finish(self, session: pytest.Session) -> None:
            if not session.testsfailed:
                marks = [(mark.args, item.nodeid) for item in session.items for mark in item.iter_markers("evidence")]
                rows = [(*args[:3], list(args[3:]), test) for args, test in marks]
                file.write_text(json.dumps(rows), encoding="utf-8")

    files = sorted(str(path) for path in TESTS.glob("test_*.py"))
    return int(pytest.main(["--collect-only", "-p", "no:cacheprovider", *files], plugins=[Collector()]))


def slips(rows: Iterable[Evidence]) -> list[str]:
    """Marks that name what this page does not know."""
    wrong = []
    for row in rows:
        if row.role in CANOPEN_ROLES or row.carrier in CAN_CARRIERS:
            known_here: tuple[Iterable[str], ...] = (CANOPEN, CAN_CARRIERS, CANOPEN_SERVICES)
        else:
            known_here = ({**MODBUS, **OTHERS}, CARRIERS, functions())
        for names, known_names in zip(((row.stranger,), (row.carrier,), row.services), known_here):
            wrong += [f"{row.test}: {name!r}" for name in names if name not in known_names]
        if row.role not in {*ROLES, *CANOPEN_ROLES, "frames"}:
            wrong.append(f"{row.test}: {row.role!r}")
    return wrong


def strangers(rows: Iterable[Evidence], role: str, service: str, carrier: str | None = None) -> list[str]:
    """Who proves a service, in our role."""
    found = {
        row.stranger for row in rows if row.role == role and service in row.services and carrier in (None, row.carrier)
    }
    return sorted(found)


def holes(rows: tuple[Evidence, ...]) -> list[str]:
    """What was tested against nobody, and is not said to be so."""
    found = []
    for role in ROLES:
        for service in functions():
            for carrier in CARRIERS:
                who = set(strangers(rows, role, service, carrier))
                if not who - {OURSELVES} and not (service in STANDS_IN and who):
                    found.append(f"Modbus, {role}, {carrier}: {service}")
    for service in functions():
        if "tshark" not in strangers(rows, "frames", service):
            found.append(f"Modbus, dissected: {service}")
    for role in CANOPEN_ROLES:
        for service in CANOPEN_SERVICES:
            if not strangers(rows, role, service) and (service, role) not in CANOPEN_STANDS_IN:
                found.append(f"CANopen, {role}: {service}")
    for service in CANOPEN_SERVICES:
        if not strangers(rows, "frames", service) and service not in NOT_ONE_FRAME:
            found.append(f"CANopen, dissected: {service}")
    return found


def page() -> str:
    """The whole of docs/interop.md."""
    rows = evidence()
    lines = ["# Tested against whom", "", "Made by `tools/interop.py` from the marks of `tests/interop`; do not edit."]
    return "\n".join([*lines, "", *_INTRODUCTION, "", *_modbus(rows), "", *_canopen(rows)]) + "\n"


_INTRODUCTION = (
    "A test that talks to somebody else's program says which functions it exchanged, over what, and in which of our",
    "two roles; this page is nothing but what they say. A test of Modbus also notes every function that was really",
    "asked and answered with a value, and fails if that is not exactly what it says. `.ci/run` runs all of them and",
    "skips none. Here, with the programs of `.ci/apt-packages.txt`:",
    "",
    "    make suite ARGS=tests/interop",
    "    make suite ARGS=tests/interop PYTHON=python3.12 VENV=.venv-3.12      tmodbus wants Python 3.12",
)


def _modbus(rows: tuple[Evidence, ...]) -> Iterator[str]:
    yield "## Modbus"
    yield ""
    yield "| | who | what | carriers of its own |"
    yield "|---|---|---|---|"
    for name, stranger in MODBUS.items():
        carriers = "" if name == OURSELVES else "all" if stranger.carriers == CARRIERS else ", ".join(stranger.carriers)
        yield f"| {stranger.short} | {name} | {stranger.what} | {carriers} |"
    yield ""
    yield "`*` behind one: the program does not have this carrier, so something stands between that has: socat for TLS,"
    yield "a serial server for a serial line over TCP. What pymodbus does otherwise than the standard is asserted as"
    yield "what it is in `tests/interop/test_pymodbus.py`, and does not count here. Each read was as long as it can be,"
    yield "each answer was compared with the value behind it, and an address that is not there was declined with 02."
    for role, title in ROLES.items():
        yield ""
        yield f"### Our {role}: {title}"
        yield ""
        yield f"| function | {' | '.join(CARRIERS)} |"
        yield f"|---|{'---|' * len(CARRIERS)}"
        for service, name in functions().items():
            cells = [_cell(strangers(rows, role, service, carrier), carrier) for carrier in CARRIERS]
            yield f"| {service} {name} | {' | '.join(cells)} |"
    yield ""
    yield "### Dissected"
    yield ""
    yield "Requests, responses and exceptions of each function as pcapng, read by tshark, field by field against what"
    yield "`barewire explain` says of the same bytes. It has no dissector for ASCII."
    yield ""
    yield "| carrier | functions |"
    yield "|---|---|"
    for carrier in CARRIERS:
        seen = [service for service in functions() if "tshark" in strangers(rows, "frames", service, carrier)]
        if seen:
            yield f"| {carrier} | {len(seen)} of {len(functions())} |"
    yield ""
    yield "### Nobody to talk to"
    yield ""
    for service, why in STANDS_IN.items():
        yield f"- {service}, {why}"


def _cell(who: list[str], carrier: str) -> str:
    return " ".join(f"{MODBUS[one].short}{'' if carrier in MODBUS[one].carriers else '*'}" for one in who)


def _canopen(rows: tuple[Evidence, ...]) -> Iterator[str]:
    yield "## CANopen"
    yield ""
    yield "| who | what |"
    yield "|---|---|"
    for name, what in CANOPEN.items():
        if any(row.stranger == name and row.carrier in CAN_CARRIERS for row in rows):
            yield f"| {name} | {what} |"
    yield ""
    yield f"| service | {' | '.join(CANOPEN_ROLES.values())} | dissected |"
    yield "|---|---|---|---|"
    for service in CANOPEN_SERVICES:
        cells = [_canopen_cell(rows, role, service) for role in CANOPEN_ROLES]
        yield f"| {service} | {' | '.join(cells)} | {' '.join(strangers(rows, 'frames', service))} |"
    yield ""
    yield "Dissected: every kind of single frame as pcapng of link type 227, read by tshark, field by field against"
    yield "what `barewire explain` says of the same bytes. tshark 4.0 leaves undissected what begins a block transfer"
    yield "with a CRC; and segments of a block are what they are by their order only."
    if CANOPEN_STANDS_IN:
        yield ""
        yield "### Nobody to talk to, on CAN"
        yield ""
        yield "Here our master is tested against our own device, and both against vectors with a source of their own."
        yield ""
        for (service, role), why in CANOPEN_STANDS_IN.items():
            yield f"- {service}, {CANOPEN_ROLES[role]}: {why}"


def _canopen_cell(rows: tuple[Evidence, ...], role: str, service: str) -> str:
    cells = []
    for name in strangers(rows, role, service):
        over = [carrier for carrier in CAN_CARRIERS if name in strangers(rows, role, service, carrier)]
        cells.append(f"{name} ({', '.join(over)})")
    return "; ".join(cells) or "none, see below"


def main() -> int:
    """Bring the page up to date; say so if it was not, and what is missing on it."""
    if sys.argv[1:2] == ["--marks"]:
        return collect(Path(sys.argv[2]))
    wrong = slips(evidence())
    if wrong:
        sys.stdout.write("\n".join(["not a name that this page knows:", *wrong]) + "\n")
        return 1
    after = page()
    if not PAGE.exists() or PAGE.read_text(encoding="utf-8") != after:
        PAGE.write_text(after, encoding="utf-8")
        sys.stdout.write("docs/interop.md\n")
    missing = holes(evidence())
    sys.stdout.write("".join(f"no stranger: {hole}\n" for hole in missing))
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
