"""Runs the tests of modbus-connection with barewire as its backend, and writes docs/how-to/home-assistant.md.

    make modbus-connection PYTHON=python3.12

modbus-connection needs Python 3.12. An environment of its own, in build/modbus-connection, gets both packages of this
repository as anyone would install them, and modbus-connection from its source distribution, which has the tests. pip
checks the distribution against the hash below; none of their files is kept in this repository.

Their tests run three times: as they are, and with barewire in the place of each of their backends
(integrations/modbus-connection/in_their_suite.py). A test that fails, or one that is exempt and does not fail, ends
this with status 1 and leaves the page as it was. Some of theirs have limits of 50 ms, which a busy machine misses: one
that fails is run again, up to three times, and the count of those is printed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
OURS = ROOT / "integrations" / "modbus-connection"
WORK = ROOT / "build" / "modbus-connection"
PYTHON = WORK / "venv" / "bin" / "python"
PAGE = ROOT / "docs" / "how-to" / "home-assistant.md"
BEGIN, END = "<!-- written by make modbus-connection -->\n", "<!-- end of what make modbus-connection writes -->\n"

VERSION = "4.12.7"
SDIST = f"modbus-connection=={VERSION} --hash=sha256:794556c938e7c34ae7edeb03cae46a5e777009163e7ca866625f091b398b805b\n"
BACKENDS = ("pymodbus", "tmodbus")
PINNED = {"pymodbus": "3.16.1", "tmodbus": "1.1.0"}
"""The libraries below their backends, and their server. Other versions can fail where these tests look inside."""
TOOLS = ("mypy>=1.19", "pytest>=8", "pytest-asyncio>=0.24", "pytest-rerunfailures>=15")
CARRIERS = {
    "any": "all of them",
    "tcp": "TCP",
    "udp": "UDP",
    "tls": "TLS",
    "serial": "serial, RTU and ASCII",
    "rtu+tcp": "RTU over TCP",
    "ascii+tcp": "ASCII over TCP",
}
LATE, THEN = 100, (200, 300, 400)
"""The registers of tests/late_answers.py."""
# Some of their tests clone a repository of SunSpec, and are skipped if that is not possible: without asking a network.
ENVIRONMENT = {**os.environ, "GIT_ALLOW_PROTOCOL": "none", "PYTHONPATH": str(OURS)}


def run(*command: object, cwd: Path = ROOT) -> str:
    """Run a command and return its output. If it fails, show that and end."""
    done = subprocess.run([*map(str, command)], cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


def say(what: str, output: str) -> None:
    """Print the last line of an output."""
    sys.stdout.write(f"{what}: {output.splitlines()[-1].strip('= ')}\n")


def install() -> Path:
    """Make the environment, and return the folder of their source distribution."""
    venv.create(WORK / "venv", clear=True, with_pip=True)
    pip = (PYTHON, "-m", "pip", "-q", "--disable-pip-version-check")
    (WORK / "sdist.txt").write_text(SDIST, encoding="utf-8")
    run(
        *pip, "download", "--require-hashes", "--no-deps", "--no-binary=:all:", "--dest", WORK, "-r", WORK / "sdist.txt"
    )
    run("tar", "-xzf", f"modbus_connection-{VERSION}.tar.gz", cwd=WORK)
    theirs = WORK / f"modbus_connection-{VERSION}"
    pinned = (f"pymodbus[serial]=={PINNED['pymodbus']}", f"tmodbus[async-serial]=={PINNED['tmodbus']}")
    run(*pip, "install", theirs, *pinned, *TOOLS, ".[serial]", OURS)
    return theirs


def their_tests(folder: Path, replaced: str | None) -> dict[str, dict[str, int]]:
    """Run their tests, and return the counts."""
    results = WORK / f"{replaced or 'own'}.json"
    place = () if replaced is None else (f"--in-place-of={replaced}",)
    # Options as one word: before pytest knows them, it takes a word that is a file for one of its tests.
    plugin = ("-p", "in_their_suite", "-p", "no:cacheprovider", "--reruns=3", *place, f"--results={results}")
    output = run(PYTHON, "-m", "pytest", "-q", *plugin, cwd=folder)
    say(f"their tests, {replaced or 'no backend'} replaced", output)
    counts: dict[str, dict[str, int]] = json.loads(results.read_text(encoding="utf-8"))
    return counts


def exempt() -> Mapping[str, Mapping[str, str]]:
    """Return the exempt tests and their reasons, as the plugin has them."""
    listed: dict[str, dict[str, str]] = json.loads(
        run(PYTHON, "-c", "import json, in_their_suite as plugin; print(json.dumps(plugin.EXEMPT))")
    )
    return listed


def page(own: Any, placed: Mapping[str, Any], late: Mapping[str, Mapping[str, list[Any]]]) -> str:
    """Return the part of the documentation that is counted."""
    columns = [(own, "tmodbus"), (placed["tmodbus"], "barewire"), (own, "pymodbus"), (placed["pymodbus"], "barewire")]

    def row(name: str, cells: Iterable[object]) -> str:
        return f"| {name} | {' | '.join(map(str, cells))} |"

    lines = [
        f"modbus-connection {VERSION}, tmodbus {PINNED['tmodbus']}, pymodbus {PINNED['pymodbus']}; the server is",
        "that of tmodbus, and of pymodbus for ASCII over TCP.",
        "",
        "| tests passed | tmodbus | barewire in its place | pymodbus | barewire in its place |",
        "|---|---|---|---|---|",
        row("the whole suite", (counts["all"]["passed"] for counts, _ in columns)),
    ]
    for carrier, name in CARRIERS.items():
        label = "of these, those that connect" if carrier == "any" else f"… over {name}"
        lines.append(row(label, (counts["used"].get(f"{who} {carrier} passed", 0) for counts, who in columns)))
    lines += [
        row("failed", (counts["all"].get("failed", 0) for counts, _ in columns)),
        row("exempt", (counts["all"].get("exempt", 0) for counts, _ in columns)),
        "",
        f"In each run {own['all']['skipped']} tests are skipped: those that fetch the SunSpec models from the network.",
        "",
        f"The late answer: a unit behind a serial server answers its first request, for register {LATE}, when the next",
        f"one arrives. Then registers {', '.join(map(str, THEN))} are read; register N holds N.",
        "",
        "| values | barewire | tmodbus | pymodbus |",
        "|---|---|---|---|",
    ]
    for way in late["barewire"]:
        lines.append(row(way, (", ".join(map(str, late[who][way])) for who in ("barewire", "tmodbus", "pymodbus"))))
    lines += ["", "Exempt tests, by what they are about:", ""]
    for replaced, tests in exempt().items():
        by_reason: dict[str, list[str]] = {}
        for test, reason in tests.items():
            by_reason.setdefault(reason, []).append(f"`{test.partition('::')[2]}`")
        lines += [f"- in the place of {replaced}, {reason}: {', '.join(names)}" for reason, names in by_reason.items()]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Install, run everything, write the page."""
    if sys.version_info < (3, 12):
        version = ".".join(map(str, sys.version_info[:3]))
        sys.exit(
            f"modbus-connection needs Python 3.12 or later, this is {version}: make modbus-connection PYTHON=python3.12"
        )
    theirs = install()
    say("types", run(PYTHON, "-m", "mypy", cwd=OURS))
    say("tests of the backend", run(PYTHON, "-m", "pytest", "-p", "no:cacheprovider", cwd=OURS))
    with ThreadPoolExecutor() as runs:
        own, *placed = runs.map(lambda replaced: their_tests(theirs, replaced), (None, *BACKENDS))
    late = json.loads(run(PYTHON, "tests/late_answers.py", cwd=OURS))
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    written = f"{BEGIN}\n{page(own, dict(zip(BACKENDS, placed)), late)}\n{END}"
    PAGE.write_text(before + written + rest.partition(END)[2], encoding="utf-8")
    say("written", str(PAGE.relative_to(ROOT)))


if __name__ == "__main__":
    main()
