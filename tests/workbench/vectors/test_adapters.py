"""The adapters of other implementations: each starts, and answers as tools/scoreboard.json and the scoreboard say.

A new version of a library that answers otherwise is noticed here: then `make scoreboard` writes its new results.
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from barewire.errors import PortError
from barewire_workbench.vectors.files import Vectors
from barewire_workbench.vectors.run import selected
from tests.helpers import part_or_whole
from tests.workbench.vectors.loaded import VECTORS
from tools import scoreboard
from tools.peers import ADAPTERS, PEERS, ROOT, Peer, PeerRun, build, confirms, run
from tools.vectors_release import meanings

pytestmark = pytest.mark.long

DATA: dict[str, Any] = json.loads(scoreboard.DATA.read_text(encoding="utf-8"))
NEEDS = {"libmodbus": ("libmodbus",), "tshark": ("tshark",)}
HERE = [peer for peer in PEERS if peer.name in DATA and peer.is_here() and peer.name != "mbusd"]
"""tmodbus needs Python 3.12: `.ci/run` runs this file with it too. Those in C are here if they are built.
mbusd runs in real time: on a busy machine it answers otherwise."""


@pytest.fixture(scope="module", autouse=True)
def peers() -> None:
    """Install what pip does not."""
    subprocess.run(
        ["make", "-s", "peers", f"VENV={sys.prefix}"], cwd=ROOT, check=True, timeout=300, capture_output=True
    )


def marked(peer: Peer) -> Any:
    return pytest.param(peer, id=peer.name, marks=[pytest.mark.needs(*NEEDS[peer.name])] if peer.name in NEEDS else [])


def cases_for(then: Any, step: int) -> Vectors:
    """The cases of the kinds that a program offered: every `step`th, and those that say more than that it passed."""
    telling = {*then["failed"], *then["open"], *then["shown"]}
    files = [
        file._replace(
            cases=tuple(case for place, case in enumerate(file.cases) if place % step == 0 or case["id"] in telling)
        )
        for file in VECTORS.files
        if file.kind in then["kinds"]
    ]
    return VECTORS._replace(files=tuple(files))


@pytest.mark.parametrize("step", part_or_whole(12, 1))
@pytest.mark.parametrize("peer", [marked(peer) for peer in HERE])
def test_an_adapter_answers_as_the_scoreboard_says(peer: Peer, step: int) -> None:
    """Another version answers otherwise in what it refuses or decides by itself, which all of `cases_for` ask."""
    vectors = cases_for(DATA[peer.name], step) if step > 1 else VECTORS
    found = run(peer, vectors)
    now, then = scoreboard.measured(found), DATA[peer.name]
    assert now["kinds"], "it offers nothing"
    known = {checked.id for checked in found.cases if is_measured(checked.case, checked.file.kind, then)}
    hint = f"run `make scoreboard`: {peer.name} {now['version']}, and the scoreboard has {then['version']}"
    for state in ("failed", "open"):
        rows = [[name for name in row[state] if name in known] for row in (now, then)]
        assert rows[0] == rows[1], f"{state}; {hint}"
    said = {name: text for name, text in now["shown"].items() if name in then["shown"]}
    assert said == then["shown"], f"what findings show; {hint}"
    assert unconfirmed(found, known) == []


def is_measured(case: Any, kind: str, data: Any) -> bool:
    """Whether a case was there when the scoreboard was made: a later one has no confirmation yet."""
    return kind in data["kinds"] and ("confirmed_by" in case or "unconfirmed" in case)


def unconfirmed(found: PeerRun, known: set[str]) -> list[str]:
    """Return the cases whose `confirmed_by` is not what the program answers now."""
    return [
        checked.id
        for checked in found.cases
        if checked.id in known
        and confirms(found.peer, checked) is not (found.peer.name in checked.case.get("confirmed_by", ()))
    ]


RECIPE = """
name = "small"
language = "C"
what = "a program of this test"
version = "1.0"
repository = "unused"
commit = "HEAD"
product = "small.so"
build = ["cat {here}/part.c {source}/whole.c > {product}"]

[[restates]]
kind = "lrc"
having = '"lrc": "F.'
why = "the adapter adds the bytes up"
"""


@pytest.fixture
def small(tmp_path: Path) -> Peer:
    """A program with a recipe, and a repository with its sources."""
    folder, sources = tmp_path / "small", tmp_path / "sources"
    for made in (folder, sources):
        made.mkdir()
    (folder / "peer.toml").write_text(RECIPE)
    (folder / "part.c").write_text("part, ")
    (sources / "whole.c").write_text("whole")
    for words in (["init", "-q"], ["add", "."], ["-c", "user.name=a", "-c", "user.email=a@b.c", "commit", "-qm", "a"]):
        subprocess.run(["git", "-C", str(sources), *words], check=True)
    return Peer(folder)


def test_a_program_is_built_by_its_recipe_and_again_when_the_recipe_changes(small: Peer) -> None:
    assert not small.is_here()
    with pytest.raises(PortError, match=r"^small: not here, `python -m tools.peers build small` makes it$"):
        small.command()
    build(small, str(small.folder.parent / "sources"))
    assert small.is_built()
    assert small.product is not None
    assert small.product.read_text() == "part, whole"
    assert small.command().endswith("vectors/peers small")
    (small.folder / "part.c").write_text("another part, ")
    assert not Peer(small.folder).is_here()


def test_a_recipe_that_fails_says_which_command(small: Peer) -> None:
    (small.folder / "peer.toml").write_text(RECIPE.replace("cat {here}/part.c", "cat {here}/no-such-file"))
    with pytest.raises(PortError, match=r"(?s)no-such-file.*exit status 1.*No such file"):
        build(Peer(small.folder), str(small.folder.parent / "sources"))


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


PEER_OF = {peer.name: peer for peer in PEERS}


def test_no_confirmation_outlives_the_case_the_program_or_the_adapter_that_was_asked() -> None:
    asked, now = scoreboard.load_asked(), meanings()
    stale = {
        name
        for file in VECTORS.files
        for case in file.cases
        for name in case.get("confirmed_by", ())
        if not asked.holds(PEER_OF[name], case["id"], now[case["id"]])
        or asked.programs[name]["version"] != DATA[name]["version"]
    }
    assert sorted(stale) == [], "ask these again: python -m tools.peers build, then python tools/scoreboard.py"


def test_what_was_asked_holds_no_more_when_case_or_adapter_have_changed(small: Peer) -> None:
    asked = scoreboard.Asked({"small": {"version": "1.0", "adapter": small.digest}}, {"lrc-1": "0123"})
    assert asked.holds(small, "lrc-1", "0123")
    assert not asked.holds(small, "lrc-1", "4567")
    assert not asked.holds(small, "lrc-2", "0123")
    (small.folder / "main.py").write_text("another adapter")
    assert not asked.holds(Peer(small.folder), "lrc-1", "0123")


def test_a_case_that_the_adapter_answers_itself_is_not_confirmed(small: Peer) -> None:
    answers = {"F3": True, "0D": False}
    assert {lrc: small.restates("lrc", {"lrc": lrc}) for lrc in answers} == answers
    assert not small.restates("crc16", {"lrc": "F3"})


def test_each_restated_row_names_cases_and_none_of_them_is_confirmed_by_its_program() -> None:
    for peer in PEERS:
        for row in peer.recipe.get("restates", ()):
            only = Peer(peer.folder)
            only.recipe = {**peer.recipe, "restates": [row]}
            cases = [case for file in VECTORS.files for case in file.cases if only.restates(file.kind, case)]
            assert cases, f"{peer.name}: {row['having']}"
            assert [case["id"] for case in cases if peer.name in case.get("confirmed_by", ())] == []


COMPUTES = re.compile(r"\b(to_bytes|from_bytes|struct\.(un)?pack|crc_hqx|writeUInt\d+|readUInt\d+)")
MADE_OF_NUMBERS = {
    "adapter.js": "the order of the two bytes of a CRC",
    "adapter.py": "the order of the two bytes of a CRC",
    "adapter_canopen.py": "values of objects, which a stack is given as memory",
    "adapter_client.py": "requests of a case as arguments; echoed fields are restated",
    "adapter_conformance.py": "frames of the tester",
    "c-modbus-slave": "the order of the two bytes of a CRC",
    "canopen": "a request to its server, a delay as an argument",
    "canopennode": "numbers of requests",
    "crcmod": "the order of the two bytes of a CRC",
    "cryptography": "a list around the extensions, which the decoder wants",
    "freemodbus": "the order of the two bytes of a CRC",
    "lely": "the objects that say how a slave is booted as memory, and memory as numbers",
    "mbusd": "the length of a frame that it has sent",
    "modbus-pdu": "registers that it gives as bytes",
    "modbus-serial": "the CRC of a reply to it; arguments of a request",
    "modbus-tk": "the order of the two bytes of a CRC",
    "nanomodbus": "the header of a request, registers as memory",
    "pymodbus": "the order of the two bytes of a CRC, the number of a sub-function",
    "pymodbustcp": "the header of a reply to it, the order of the two bytes of a CRC",
    "struct": "struct itself",
    "tmodbus": "the number of a sub-function; data of diagnostics are restated",
    "tshark": "the capture that it reads; the fields that it shows, one behind the other",
}
"""The adapters, and what they share, that make bytes of numbers or numbers of bytes, and why that is no answer."""


def test_an_adapter_that_computes_with_bytes_says_why() -> None:
    files = [*ADAPTERS.glob("*/*.py"), *ADAPTERS.glob("*/*.js")]
    computing = {file for file in files if COMPUTES.search(file.read_text(encoding="utf-8"))}
    names = {file.name if file.parent.name == "shared" else file.parent.name for file in computing}
    assert names == set(MADE_OF_NUMBERS), "add a reason, and what it makes of answers to `restates` in peer.toml"


def test_every_name_in_a_case_is_in_oracles() -> None:
    oracles = json.loads(scoreboard.ORACLES.read_text(encoding="utf-8"))
    named = {name for file in VECTORS.files for case in file.cases for name in case.get("confirmed_by", ())}
    assert named <= set(oracles)
    assert oracles == json.loads(scoreboard.oracles(DATA))


def test_at_least_eight_stacks_in_three_languages() -> None:
    stacks = [peer.name for peer in PEERS if peer.name in DATA and not peer.oracle]
    assert len(stacks) >= 8
    assert len({DATA[name]["language"] for name in stacks}) >= 3


LATE = """
import json, sys

asked = []
for line in sys.stdin:
    question = json.loads(line)
    asked.append(question.get("id"))
    total = -sum(bytes.fromhex(question.get("bytes", ""))) & 0xFF
    is_late = asked.count("lrc-1.encode") == 1 and asked[-1] == "lrc-1.encode"
    wrong = is_late or asked[-1] == "lrc-3.encode"
    answer = {"id": asked[-1], "is": {"lrc": f"{total ^ wrong:02X}"}}
    print(json.dumps(answer if asked[-1] else {"name": "late", "kinds": {"lrc": ["encode"]}}), flush=True)
"""


@pytest.mark.parametrize(("again", "failed"), [("", {"lrc-1", "lrc-3"}), ("again = 1\n", {"lrc-3"})])
def test_a_program_in_real_time_is_asked_again_what_failed(tmp_path: Path, again: str, failed: set[str]) -> None:
    """What was late passes then; what is wrong fails again."""
    (tmp_path / "peer.toml").write_text('name = "late"\nlanguage = "Python"\nwhat = "LRC"\n' + again)
    (tmp_path / "late.py").write_text(LATE)
    peer = Peer(tmp_path)
    peer.command = lambda: shlex.join([sys.executable, str(tmp_path / "late.py")])  # type: ignore[method-assign]
    found = run(peer, selected(VECTORS, only=["lrc-[123]"]))
    assert {case_id for _, case_id, state in found.states() if state == "failed"} == failed
    assert [checked.id for checked in found.cases] == ["lrc-1", "lrc-2", "lrc-3"]
