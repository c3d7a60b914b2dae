"""Runs the vectors over the adapters of other implementations: who answers what, and who confirms which case.

    PEERS       the programs: a name, the command of its adapter, how it is installed
    run         every case, asked of one program
    confirms    whether a program confirms a case: all that it offers passed, and at least one answer could have failed

`make peers` installs those that pip does not. A program that is not installed here is left out; tmodbus runs on the
first Python that has it. Libraries in C that no distribution has are built by hand, outside this repository; an
environment variable names each.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from barewire.errors import PortError
from barewire_workbench.live.vector_adapter import VectorAdapter
from barewire_workbench.vectors.files import Vectors
from barewire_workbench.vectors.questions import Question
from barewire_workbench.vectors.run import CheckedCase, run_cases

ROOT = Path(__file__).parent.parent
ADAPTERS = ROOT / "vectors" / "peers"
"""Run with a name: `python vectors/peers pymodbus`."""
OTHER_PYTHONS = (".venv-3.12", ".venv-3.13", ".venv-3.14")
TIMEOUT = 20.0


class Peer(NamedTuple):
    """A program that answers: the words of its command behind the interpreter, its language, what it is."""

    name: str
    language: str
    what: str
    words: tuple[str, ...]
    module: str = ""
    oracle: bool = False
    """Whether it confirms values only, and is no stack: it has no row in the scoreboard."""
    by_hand: str = ""
    """The environment variable with a library that somebody has built, and its version: "libnanomodbus.so 1.9.1"."""

    def is_here(self) -> bool:
        """Whether it is installed, as far as Python can tell."""
        if self.by_hand and not os.environ.get(self.by_hand):
            return False
        return not self.module or python_with(self.module) is not None

    def command(self) -> str:
        """Return the command of the adapter. Raise PortError if no Python here has its module."""
        if not self.module:
            return shlex.join([str(ROOT / word) if (ROOT / word).exists() else word for word in self.words])
        python = python_with(self.module)
        if python is None:
            raise PortError(f"{self.name}: no Python here can import {self.module}")
        given = shlex.split(os.environ.get(self.by_hand, "")) if self.by_hand else []
        if self.by_hand and len(given) != 2:
            raise PortError(f"{self.name}: ${self.by_hand} names no library and its version")
        return shlex.join([python, str(ADAPTERS), *self.words, *given])


NODE = "vectors/peers"
PEERS = (
    Peer("pymodbus", "Python", "Modbus library, clients and servers", ("pymodbus",), "pymodbus"),
    Peer("tmodbus", "Python", "Modbus library for asyncio", ("tmodbus",), "tmodbus"),
    Peer("minimalmodbus", "Python", "Modbus client for serial lines", ("minimalmodbus",), "minimalmodbus"),
    Peer("uModbus", "Python", "Modbus library", ("umodbus",), "umodbus"),
    Peer("pyModbusTCP", "Python", "Modbus TCP library", ("pymodbustcp",), "pyModbusTCP"),
    Peer("modbus-tk", "Python", "Modbus test kit", ("modbus-tk",), "modbus_tk"),
    Peer("libmodbus", "C", "Modbus library", ("libmodbus",), "ctypes"),
    Peer(
        *("nanoMODBUS", "C", "Modbus library for microcontrollers", ("nanomodbus",), "ctypes"),
        by_hand="NANOMODBUS",
    ),
    Peer(
        *("c-modbus-slave", "C", "Modbus server for microcontrollers", ("c-modbus-slave",), "ctypes"),
        by_hand="CMODBUSSLAVE",
    ),
    Peer(
        *("FreeModbus", "C", "Modbus server for microcontrollers", ("freemodbus",), "ctypes"),
        by_hand="FREEMODBUS",
    ),
    Peer("mbusd", "C", "Modbus gateway", ("mbusd",), "pty", by_hand="MBUSD"),
    Peer("modbus-serial", "JavaScript", "Modbus library", ("node", f"{NODE}/modbus-serial/main.js")),
    Peer("jsmodbus", "JavaScript", "Modbus library", ("node", f"{NODE}/jsmodbus/main.js")),
    Peer("modbus-pdu", "JavaScript", "codec of Modbus messages", ("node", f"{NODE}/modbus-pdu/main.js")),
    Peer("canopen", "Python", "CANopen library", ("canopen",), "canopen"),
    Peer(
        *("CANopenNode", "C", "CANopen stack for microcontrollers", ("canopennode",), "ctypes"),
        by_hand="CANOPENNODE",
    ),
    Peer(*("Lely", "C", "CANopen stack, Lely core libraries", ("lely",), "ctypes"), by_hand="LELY"),
    Peer("GMP", "C", "motor control", ("gmp",), "ctypes", by_hand="GMP402"),
    Peer("durand", "Python", "CANopen devices", ("durand",), "durand"),
    Peer("tshark", "C", "dissectors of Wireshark", ("tshark",), "json", oracle=True),
    Peer("struct", "C", "numbers of Python's standard library", ("python-values", "struct"), "struct", oracle=True),
    Peer("numpy", "C", "numbers of numpy", ("python-values", "numpy"), "numpy", oracle=True),
    Peer("crcmod", "C", "catalogue of checksums", ("python-values", "crcmod"), "crcmod", oracle=True),
    Peer("python-can", "Python", "lines of candump", ("python-logs", "python-can"), "can", oracle=True),
    Peer("cryptography", "Rust", "decoder of DER", ("cryptography",), "cryptography.hazmat.asn1", oracle=True),
    Peer("arithmetic", "Python", "our arithmetic done another way", ("arithmetic",), "ctypes", oracle=True),
    Peer("cantools", "Python", "lines of candump", ("python-logs", "cantools"), "cantools", oracle=True),
)


@cache
def python_with(module: str) -> str | None:
    """Return the first Python here that can import a module."""
    with suppress(ModuleNotFoundError):  # the package that the module is in is not here either
        if find_spec(module) is not None:
            return sys.executable
    beside = [ROOT / name / "bin" / "python" for name in OTHER_PYTHONS]
    for python in (*os.environ.get("BAREWIRE_PYTHONS", "").split(), *map(str, beside)):
        probe = [python, "-c", f"import {module}"]
        if Path(python).exists() and subprocess.run(probe, capture_output=True).returncode == 0:
            return python
    return None


class PeerRun(NamedTuple):
    """What one program made of all cases."""

    peer: Peer
    version: str
    cases: tuple[CheckedCase, ...]

    def states(self) -> Iterator[tuple[str, str, str]]:
        """Yield kind, id and state of each case that it offers."""
        for checked in self.cases:
            if checked.verdict.state != "not offered":
                yield checked.file.kind, checked.id, checked.verdict.state


def run(peer: Peer, vectors: Vectors) -> PeerRun:
    """Ask a program every case. Raise PortError if it does not start."""
    with VectorAdapter(peer.command(), timeout=TIMEOUT) as adapter:
        return PeerRun(peer, adapter.version, tuple(run_cases(vectors, adapter)))


def confirms(checked: CheckedCase) -> bool:
    """Return whether the answers confirm a case: none is wrong, and at least one could have been wrong."""
    if checked.verdict.state != "passed":
        return False
    return any(verdict.state == "passed" and bites(question) for question, verdict in checked.questions)


def bites(question: Question) -> bool:
    """Return whether the judge expects something: an acceptable case may be encoded in any way."""
    case: Any = question.case
    return case["result"] != "acceptable" or question.do != "encode" or "tolerant" in case.get("flags", ())
