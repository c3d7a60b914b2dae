"""Writes docs/reference/interop.md: run `python tools/interop.py` after every change of a test in tests/interop.

    tests/interop/**.py  @pytest.mark.evidence(peer, role, carrier, *services)     the test checks what it claims
            |  collected, not run
            v
    docs/reference/interop.md      function x carrier -> the programs tested against; gaps and invalid marks are errors

The tests of the page call the same functions. Collecting needs every peer but tmodbus, which its tests import late.
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

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from barewire.modbus.messages.diagnostics import SUB_FUNCTIONS  # noqa: E402
from barewire.modbus.messages.registry import known_requests  # noqa: E402
from tests.interop.services import CARRIERS, NO_PEER  # noqa: E402

TESTS = ROOT / "tests" / "interop"
PAGE = ROOT / "docs" / "reference" / "interop.md"
OURSELVES = "ourselves"

CAN_CARRIERS = ("virtual", "slcan", "socketcand", "socketcan", "udp_multicast", "file")
ROLES = {"server": "their clients use our server", "client": "our clients use their servers"}


class Peer(NamedTuple):
    """Another program or library, and the carriers that it supports itself; others go through socat or the like."""

    short: str
    what: str
    carriers: tuple[str, ...]


MODBUS = {
    "pymodbus": Peer("pm", "Python library 3.16; blocking client, asyncio servers", CARRIERS),
    "tmodbus": Peer("tm", "Python library 1.1 for Python 3.12 and later; asyncio", CARRIERS[:-1]),
    "libmodbus": Peer("lm", "C library 3.1.6 of Debian, with two programs from `tests/interop`", ("rtu", "tcp")),
    "mbpoll": Peer("mb", "command line program 1.4 of Debian, on libmodbus; a client", ("rtu", "tcp")),
    "minimalmodbus": Peer("mm", "Python library 2.1 for serial ports; a client", ("rtu", "ascii")),
    "pyModbusTCP": Peer("pt", "Python library 0.3; blocking client and server", ("tcp",)),
    OURSELVES: Peer("-", "our own other side, for 2B/0D only, see below", CARRIERS),
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
_NO_BLOCKS = "their node has none: it answers an upload with segments, which our master accepts, and refuses a download"
_NO_SLAVE = "the library has a master, but no slave"
CANOPEN_NO_PEER = {
    ("SDO block upload", "master"): _NO_BLOCKS,
    ("SDO block download", "master"): _NO_BLOCKS,
    ("node guarding", "master"): "their node does not answer remote frames",
    ("LSS switch", "master"): _NO_SLAVE,
    ("LSS identify", "master"): _NO_SLAVE,
    ("LSS inquire", "master"): _NO_SLAVE,
    ("LSS configure", "master"): _NO_SLAVE,
    ("LSS fastscan", "master"): _NO_SLAVE,
}
"""CANopen services and roles without a peer, with the reason."""
NOT_ONE_FRAME = ("PDO mapping", "EDS")
"""CANopen services that no dissector recognises: a mapping is written by SDO, and an EDS is a file."""


class Evidence(NamedTuple):
    """One mark of one test."""

    peer: str
    role: str
    carrier: str
    services: tuple[str, ...]
    test: str


def functions() -> dict[str, str]:
    """Return every public function of Modbus: its short name -> its name in the standard."""
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
    """Return every mark of the tests, collected by pytest in a new process; no test is run."""
    with tempfile.TemporaryDirectory() as where:
        file = Path(where, "marks.json")
        command = [sys.executable, str(Path(__file__).resolve()), "--marks", str(file)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
        if not file.exists():
            raise SystemExit(f"the tests cannot be collected:\n{done.stdout}{done.stderr}")
        rows = json.loads(file.read_text(encoding="utf-8"))
    return tuple(Evidence(peer, role, over, tuple(services), test) for peer, role, over, services, test in rows)


def collect(file: Path) -> int:
    """Collect the marks into a JSON file, for `evidence`. The files are named, so pytest ignores `collect_ignore`;
    tests marked `proof` are evidence too."""
    import pytest

    class Collector:
        def pytest_collection_finish(self, session: pytest.Session) -> None:
            if not session.testsfailed:
                marks = [(mark.args, item.nodeid) for item in session.items for mark in item.iter_markers("evidence")]
                rows = [(*args[:3], list(args[3:]), test) for args, test in marks]
                file.write_text(json.dumps(rows), encoding="utf-8")

    files = sorted(str(path) for path in TESTS.rglob("test_*.py"))
    return int(pytest.main(["--collect-only", "-m", "", "-p", "no:cacheprovider", *files], plugins=[Collector()]))


def invalid_marks(rows: Iterable[Evidence]) -> list[str]:
    """Return the marks with a peer, carrier, role or service that does not exist."""
    wrong = []
    for row in rows:
        if row.role in CANOPEN_ROLES or row.carrier in CAN_CARRIERS:
            known_here: tuple[Iterable[str], ...] = (CANOPEN, CAN_CARRIERS, CANOPEN_SERVICES)
        else:
            known_here = ({**MODBUS, **OTHERS}, CARRIERS, functions())
        for names, known_names in zip(((row.peer,), (row.carrier,), row.services), known_here):
            wrong += [f"{row.test}: {name!r}" for name in names if name not in known_names]
        if row.role not in {*ROLES, *CANOPEN_ROLES, "frames"}:
            wrong.append(f"{row.test}: {row.role!r}")
    return wrong


def peers(rows: Iterable[Evidence], role: str, service: str, carrier: str | None = None) -> list[str]:
    """Return the peers that prove a service in our role."""
    found = {
        row.peer for row in rows if row.role == role and service in row.services and carrier in (None, row.carrier)
    }
    return sorted(found)


def gaps(rows: tuple[Evidence, ...]) -> list[str]:
    """Return the services without a test against a peer that are not listed as such."""
    found = []
    for role in ROLES:
        for service in functions():
            for carrier in CARRIERS:
                found_peers = set(peers(rows, role, service, carrier))
                if not found_peers - {OURSELVES} and not (service in NO_PEER and found_peers):
                    found.append(f"Modbus, {role}, {carrier}: {service}")
    for service in functions():
        if "tshark" not in peers(rows, "frames", service):
            found.append(f"Modbus, dissected: {service}")
    for role in CANOPEN_ROLES:
        for service in CANOPEN_SERVICES:
            if not peers(rows, role, service) and (service, role) not in CANOPEN_NO_PEER:
                found.append(f"CANopen, {role}: {service}")
    for service in CANOPEN_SERVICES:
        if not peers(rows, "frames", service) and service not in NOT_ONE_FRAME:
            found.append(f"CANopen, dissected: {service}")
    return found


def page() -> str:
    """Return the whole of docs/reference/interop.md."""
    rows = evidence()
    lines = [
        "# Interoperability tests",
        "",
        "Made by `tools/interop.py` from the marks of `tests/interop`; do not edit.",
    ]
    return "\n".join([*lines, "", *_INTRODUCTION, "", *_modbus(rows), "", *_canopen(rows)]) + "\n"


_INTRODUCTION = (
    "Each test against another program is marked with that program, the functions that it exchanges, the carrier and",
    "our role; this page is generated from these marks. A test of Modbus also records every function that was",
    "requested and answered with a value, and fails if these are not exactly the marked ones. `.ci/run` runs all of",
    "these tests and skips none. To run them, with the programs of `.ci/apt-packages.txt` installed:",
    "",
    "    make suite ARGS=tests/interop",
    "    make suite ARGS=tests/interop PYTHON=python3.12 VENV=.venv-3.12      tmodbus needs Python 3.12",
)
_CANOPENNODE = (
    "### The test scripts of CANopenNode",
    "",
    "CANopenDemo 1f16f49 has 31 tests in three scripts: `cocomm` gives commands to `canopend`, node 1, and the",
    "frames of node 4 are compared. They ran on vcan in the guest kernel on 2026-11-22, with programs that are",
    "built elsewhere (CANopenNode v4.0-384-gfbd42d4). The conformance battery against the demo device is on the page",
    "[conform-canopen](conform-canopen.md#canopennodes-demo-device).",
    "",
    "    python -m tests.interop.canopen.canopennode scripts CANopenDemo/test cocomm canopend ours demoDevice.eds",
    "    python -m tests.interop.canopen.canopennode scripts CANopenDemo/test cocomm ours demoLinuxDevice \\",
    "        demoDevice.eds DS301_profile.eds",
    "",
    "| node 1 | node 4 | passed | the others |",
    "|---|---|---|---|",
    "| canopend | our device with their EDS | 28 of 31 | three tests of the heartbeat consumer compare whole"
    " emergencies. The error codes 8130h and 0000h are equal; our error register is 11h with bit 0, which CiA 301"
    " sets with every error, theirs 10h; the last five bytes are the manufacturer's: theirs an error number (1Bh,"
    " 1Ch), ours the node-ID |",
    "| our gateway with the EDS of their example | their demo device | 30 of 31 | one test expects that node 1"
    " starts itself, and that its heartbeat time stays over a reset of communication, which by CiA 301 restores"
    " 1017h |",
)


def _modbus(rows: tuple[Evidence, ...]) -> Iterator[str]:
    yield "## Modbus"
    yield ""
    yield "| | program | what | carriers of its own |"
    yield "|---|---|---|---|"
    for name, peer in MODBUS.items():
        carriers = "" if name == OURSELVES else "all" if peer.carriers == CARRIERS else ", ".join(peer.carriers)
        yield f"| {peer.short} | {name} | {peer.what} | {carriers} |"
    yield ""
    yield "`*`: the program does not support this carrier itself; socat adds TLS, a serial server adds TCP to a serial"
    yield "line. Deviations of pymodbus from the standard are asserted in `tests/interop/test_pymodbus.py` and do not"
    yield "count here. Each read has the largest possible quantity, each answer is compared with the stored value, and"
    yield "a read behind the last address is answered with exception 02."
    for role, title in ROLES.items():
        yield ""
        yield f"### Our {role}: {title}"
        yield ""
        yield f"| function | {' | '.join(CARRIERS)} |"
        yield f"|---|{'---|' * len(CARRIERS)}"
        for service, name in functions().items():
            cells = [_cell(peers(rows, role, service, carrier), carrier) for carrier in CARRIERS]
            yield f"| {service} {name} | {' | '.join(cells)} |"
    yield ""
    yield "### Dissected"
    yield ""
    yield "Requests, responses and exceptions of each function are written as pcapng and read by tshark; each field is"
    yield "compared with that of `barewire explain` for the same bytes. tshark has no dissector for ASCII."
    yield ""
    yield "| carrier | functions |"
    yield "|---|---|"
    for carrier in CARRIERS:
        seen = [service for service in functions() if "tshark" in peers(rows, "frames", service, carrier)]
        if seen:
            yield f"| {carrier} | {len(seen)} of {len(functions())} |"
    yield ""
    yield "### Functions without another program"
    yield ""
    for service, why in NO_PEER.items():
        yield f"- {service}, {why}"


def _cell(names: list[str], carrier: str) -> str:
    return " ".join(f"{MODBUS[name].short}{'' if carrier in MODBUS[name].carriers else '*'}" for name in names)


def _canopen(rows: tuple[Evidence, ...]) -> Iterator[str]:
    yield "## CANopen"
    yield ""
    yield "| program | what |"
    yield "|---|---|"
    for name, what in CANOPEN.items():
        if any(row.peer == name and row.carrier in CAN_CARRIERS for row in rows):
            yield f"| {name} | {what} |"
    yield ""
    yield f"| service | {' | '.join(CANOPEN_ROLES.values())} | dissected |"
    yield "|---|---|---|---|"
    for service in CANOPEN_SERVICES:
        cells = [_canopen_cell(rows, role, service) for role in CANOPEN_ROLES]
        yield f"| {service} | {' | '.join(cells)} | {' '.join(peers(rows, 'frames', service))} |"
    yield ""
    yield "Dissected: every kind of single frame is written as pcapng of link type 227 and read by tshark; each field"
    yield "is compared with that of `barewire explain` for the same bytes. tshark 4.0 does not dissect the start of a"
    yield "block transfer with a CRC, and the segments of a block are recognised by their order only."
    yield ""
    yield from _CANOPENNODE
    if CANOPEN_NO_PEER:
        yield ""
        yield "### CANopen services without another program"
        yield ""
        yield "For these our master is tested against our own device, and both against vectors from other sources."
        yield ""
        for (service, role), why in CANOPEN_NO_PEER.items():
            yield f"- {service}, {CANOPEN_ROLES[role]}: {why}"


def _canopen_cell(rows: tuple[Evidence, ...], role: str, service: str) -> str:
    cells = []
    for name in peers(rows, role, service):
        over = [carrier for carrier in CAN_CARRIERS if name in peers(rows, role, service, carrier)]
        cells.append(f"{name} ({', '.join(over)})")
    return "; ".join(cells) or "none, see below"


def main() -> int:
    """Write the page if it is out of date; print its name, and the services without a peer."""
    if sys.argv[1:2] == ["--marks"]:
        return collect(Path(sys.argv[2]))
    wrong = invalid_marks(evidence())
    if wrong:
        sys.stdout.write("\n".join(["unknown names in marks:", *wrong]) + "\n")
        return 1
    after = page()
    if not PAGE.exists() or PAGE.read_text(encoding="utf-8") != after:
        PAGE.write_text(after, encoding="utf-8")
        sys.stdout.write("docs/reference/interop.md\n")
    missing = gaps(evidence())
    sys.stdout.write("".join(f"no peer: {gap}\n" for gap in missing))
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
