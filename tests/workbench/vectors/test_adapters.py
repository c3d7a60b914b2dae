"""The adapters of other implementations: each starts, and answers as tools/scoreboard.json and the scoreboard say.

A new version of a library that answers otherwise is noticed here: then `make scoreboard` writes its new results.
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

from barewire.errors import PortError
from barewire_workbench.vectors.files import load_vectors
from tools import scoreboard
from tools.peers import PEERS, ROOT, Peer, PeerRun, confirms, python_with, run
from tools.vectors_release import meanings

pytestmark = pytest.mark.long

DATA: dict[str, Any] = json.loads(scoreboard.DATA.read_text(encoding="utf-8"))
VECTORS = load_vectors(ROOT / "vectors")
NEEDS = {"libmodbus": ("libmodbus",), "tshark": ("tshark",)}
HERE = [peer for peer in PEERS if peer.name in DATA and peer.is_here()]
"""tmodbus needs Python 3.12: `.ci/run` runs this file with it too."""


@pytest.fixture(scope="module", autouse=True)
def peers() -> None:
    """Install what pip does not."""
    subprocess.run(
        ["make", "-s", "peers", f"VENV={sys.prefix}"], cwd=ROOT, check=True, timeout=300, capture_output=True
    )


def marked(peer: Peer) -> Any:
    return pytest.param(peer, id=peer.name, marks=[pytest.mark.needs(*NEEDS[peer.name])] if peer.name in NEEDS else [])


@pytest.mark.parametrize("peer", [marked(peer) for peer in HERE])
def test_an_adapter_answers_as_the_scoreboard_says(peer: Peer) -> None:
    found = run(peer, VECTORS)
    now, then = scoreboard.measured(found), DATA[peer.name]
    assert now["kinds"], "it offers nothing"
    known = {checked.id for checked in found.cases if is_measured(checked.case, checked.file.kind, then)}
    hint = f"run `make scoreboard`: {peer.name} {now['version']}, and the scoreboard has {then['version']}"
    for state in ("failed", "open"):
        rows = [[name for name in row[state] if name in known] for row in (now, then)]
        assert rows[0] == rows[1], f"{state}; {hint}"
    assert unconfirmed(found, known) == []


def is_measured(case: Any, kind: str, data: Any) -> bool:
    """Whether a case was there when the scoreboard was made: a later one has no confirmation yet."""
    return kind in data["kinds"] and ("confirmed_by" in case or "unconfirmed" in case)


def unconfirmed(found: PeerRun, known: set[str]) -> list[str]:
    """Return the cases whose `confirmed_by` is not what the program answers now."""
    return [
        checked.id
        for checked in found.cases
        if checked.id in known and confirms(checked) is not (found.peer.name in checked.case.get("confirmed_by", ()))
    ]


def test_a_library_that_is_built_by_hand_is_named_by_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    (peer,) = [peer for peer in PEERS if peer.name == "nanoMODBUS"]
    monkeypatch.delenv("NANOMODBUS", raising=False)
    assert not peer.is_here()
    with pytest.raises(PortError, match=r"^nanoMODBUS: \$NANOMODBUS names no library and its version$"):
        peer.command()
    monkeypatch.setenv("NANOMODBUS", "/opt/libnanomodbus.so 1.9.1")
    assert peer.is_here()
    assert peer.command().endswith("vectors/peers nanomodbus /opt/libnanomodbus.so 1.9.1")


def test_the_page_is_made_of_the_data() -> None:
    text = scoreboard.PAGE.read_text(encoding="utf-8")
    assert scoreboard.with_tables(text, DATA) == text, "run python tools/scoreboard.py --page"


@pytest.mark.parametrize("arguments", [["--help"], ["pymodbuz"], ["--page", "pymodbus"]])
def test_a_name_of_no_program_is_refused_before_anything_is_written(arguments: list[str]) -> None:
    with pytest.raises(SystemExit, match=f"^{arguments[0]}: expected --page alone, or some of pymodbus, "):
        scoreboard.main(arguments)


def test_every_case_is_confirmed_or_says_why_not() -> None:
    neither = [
        case["id"]
        for file in VECTORS.files
        for case in file.cases
        if ("confirmed_by" in case) == ("unconfirmed" in case)
    ]
    assert neither == [], "run `make scoreboard`"


def test_no_confirmation_outlives_the_case_that_was_asked() -> None:
    asked, now = json.loads(scoreboard.CONFIRMED.read_text(encoding="utf-8")), meanings()
    cases = (case for file in VECTORS.files for case in file.cases if "confirmed_by" in case)
    stale = [case["id"] for case in cases if asked.get(case["id"]) != now[case["id"]]]
    assert stale == [], "run python tools/scoreboard.py"


def test_a_changed_case_loses_the_confirmations_of_those_who_are_not_asked_again() -> None:
    assert scoreboard.kept(["GMP", "canopen", "gone"], is_same=True, again={"canopen"}) == ["GMP"]
    assert scoreboard.kept(["GMP", "canopen"], is_same=False, again=set()) == []


def test_a_module_whose_package_is_not_installed_is_in_no_python() -> None:
    assert python_with("no_such_package.module") is None


def test_every_name_in_a_case_is_in_oracles() -> None:
    oracles = json.loads(scoreboard.ORACLES.read_text(encoding="utf-8"))
    named = {name for file in VECTORS.files for case in file.cases for name in case.get("confirmed_by", ())}
    assert named <= set(oracles)
    assert oracles == json.loads(scoreboard.oracles(DATA))


def test_at_least_eight_stacks_in_three_languages() -> None:
    stacks = [peer.name for peer in PEERS if peer.name in DATA and not peer.oracle]
    assert len(stacks) >= 8
    assert len({DATA[name]["language"] for name in stacks}) >= 3
