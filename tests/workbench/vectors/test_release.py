"""A release of the vectors: released cases keep their meaning, and the archives are complete and always the same."""

from __future__ import annotations

import copy
import hashlib
import io
import json
import os
import posixpath
import re
import shlex
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from barewire_workbench.vectors.files import load_vectors
from barewire_workbench.vectors.profiles import badge_svg, badge_texts, in_profile
from tests.helpers import part_or_whole, some_of
from tests.workbench.vectors.loaded import VECTORS
from tools import vectors_release as release, vectors_verdicts
from tools.vectors_verdicts import Demand

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[3]
CHANGELOG = (ROOT / "vectors" / "CHANGELOG.md").read_text(encoding="utf-8")


def test_every_released_case_keeps_its_meaning() -> None:
    wrong = release.problems(release.meanings(), release.released(), CHANGELOG, release.version())
    assert not wrong, "\n" + "\n".join(wrong)


def test_every_case_has_a_meaning() -> None:
    assert {*release.meanings()} == {*VECTORS.digests}


# What the test above would notice ---------------------------------------------------------------------------------

NOW = {"lrc-1": "a", "lrc-2": "b"}
RELEASED = {"1.0.0": {"lrc-1": "a"}, "1.1.0": {"lrc-2": "b"}}
LOG = "# Changelog\n\n## 1.2.0\n\nNot released yet.\n{}\n## 1.1.0\n\n- corrected `lrc-1`: it was another one\n"


@pytest.mark.parametrize(
    ("now", "line", "version", "noticed"),
    [
        (NOW, "", "1.2.0", ""),
        ({**NOW, "lrc-3": "c"}, "", "1.2.0", ""),
        ({**NOW, "lrc-2": "x"}, "- corrected `lrc-2`: the sum\n", "1.2.0", ""),
        ({"lrc-1": "a"}, "", "1.2.0", "lrc-2 was released and is not there any more"),
        ({"lrc-1": "a"}, "- corrected `lrc-2`: gone\n", "1.2.0", "lrc-2 was released and is not there any more"),
        ({**NOW, "lrc-1": "x"}, "", "1.2.0", "lrc-1 was released with another meaning"),
        ({**NOW, "lrc-1": "x"}, "- corrected `lrc-2`: the sum\n", "1.2.0", "lrc-1 was released with another meaning"),
        (NOW, "- corrected `lrc-2`: the sum\n", "1.2.0", "lrc-2 is listed as corrected"),
        (NOW, "- corrected `lrc-9`: the sum\n", "1.2.0", "lrc-9 is listed as corrected"),
        (NOW, "", "1.3.0", "CHANGELOG.md has no section ## 1.3.0"),
        (NOW, "", "1.1.0", ""),
        ({**NOW, "lrc-3": "c"}, "", "1.1.0", "VERSION is 1.1.0, but 1.1.0 is released"),
        ({**NOW, "lrc-1": "x"}, "", "1.1.0", "lrc-1 was released with another meaning"),
    ],
)
def test_a_change_of_released_cases_is_noticed(now: dict[str, str], line: str, version: str, noticed: str) -> None:
    found = release.problems(now, RELEASED, LOG.format(line), version)
    assert noticed in "\n".join(found)
    assert bool(found) is bool(noticed)


def test_the_changelog_by_id_has_every_version() -> None:
    log = LOG.format("- corrected `lrc-2`: the sum\n  of all bytes\n- more\n")
    assert release.changes({**NOW, "lrc-3": "c"}, RELEASED, log, "1.2.0") == {
        "1.2.0": {"added": ["lrc-3"], "corrected": {"lrc-2": "the sum\n  of all bytes"}},
        "1.1.0": {"added": ["lrc-2"], "corrected": {"lrc-1": "it was another one"}},
        "1.0.0": {"added": ["lrc-1"], "corrected": {}},
    }


def test_a_recorded_release_has_the_new_meanings() -> None:
    now = {f"lrc-{number}": Demand(meaning, "valid", "7") for number, meaning in enumerate("xbc", 1)}
    assert json.loads(release.recorded(now, RELEASED, "1.2.0")) == {
        "1.0.0": {"lrc-1": "x valid 7"},
        "1.1.0": {"lrc-2": "b valid 7"},
        "1.2.0": {"lrc-3": "c valid 7"},
    }


# What a stack that passed must expect ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("before", "now", "effect"),
    [
        ("a valid 1", "a valid 1", ""),
        ("a valid 1", "a valid 2", ""),  # a digest of what is asked is made otherwise now; the meaning is the same
        (None, "a valid 1", "new"),
        (None, "a invalid 1", "new"),
        (None, "a acceptable 1", "new-open"),
        ("a valid 1", "b acceptable 1", "loosened"),
        ("a invalid 1", "b acceptable 2", "loosened"),
        ("a acceptable 1", "b invalid 1", "tightened"),
        ("a valid 1", "b valid 1", "changed"),
        ("a valid 1", "b invalid 1", "changed"),
        ("a acceptable 1", "b acceptable 2", "reasked"),
    ],
)
def test_the_effect_of_a_case_on_a_stack_that_passed(before: str | None, now: str, effect: str) -> None:
    assert vectors_verdicts.effect(before and Demand.parse(before), Demand.parse(now)) == effect  # type: ignore[arg-type]


def test_a_case_that_asks_and_answers_otherwise_demands_otherwise() -> None:
    (kind, case), operations = next(
        ((file.kind, case), VECTORS.kinds[file.kind])
        for file in VECTORS.files
        for case in file.cases
        if case["id"] == "lrc-1"
    )

    def demanded(**changed: str) -> Demand:
        other = {**case, **changed}
        return vectors_verdicts.demand(kind, other, release.meaning(kind, other), operations)

    whole = demanded()
    assert vectors_verdicts.effect(whole, demanded(comment="another remark")) == ""
    assert vectors_verdicts.effect(whole, demanded(lrc="00")) == "changed"
    assert vectors_verdicts.effect(whole, demanded(bytes="01")) == "reasked"
    assert vectors_verdicts.effect(whole, demanded(result="acceptable")) == "loosened"


def test_the_archive_says_which_verdicts_can_change(archive: zipfile.ZipFile) -> None:
    rows = json.loads(archive.read(f"{TOP}changes.json"))
    newest, (last, before) = next(iter(rows)), release.last_demands()
    if newest == last:
        assert "verdicts" not in rows[newest]
        return
    found = rows[newest]["verdicts"]
    assert found["since"] == last
    assert sorted([*found["new"], *found["new-open"]]) == sorted(rows[newest]["added"])
    corrected = [name for effect in ("tightened", "loosened", "changed", "reasked") for name in found[effect]]
    assert sorted(corrected) == sorted(rows[newest]["corrected"])
    assert {*found["profiles"]} == {*VECTORS.profiles}
    core = {case["id"] for file in in_profile(VECTORS, "modbus-core").files for case in file.cases}
    assert found["profiles"]["modbus-core"]["new"] == len(core & {*found["new"]})
    assert len(before) + len(rows[newest]["added"]) == len(VECTORS.digests)


def test_verdicts_of_a_profile_are_printed() -> None:
    lines = release.verdicts("modbus-core").splitlines()
    assert lines[0] == f"since {release.last_demands()[0]}"
    assert [line.split()[1] for line in lines[1:]] == [*vectors_verdicts.EFFECTS]


DESCRIPTIONS = ("id", "comment", "source", "flags", "confirmed_by", "unconfirmed")


def test_the_meaning_is_in_every_field_that_an_answer_needs() -> None:
    kind, case = "pdu", next(case for file in VECTORS.files for case in file.cases if case["id"] == "lrc-2")
    whole = release.meaning(kind, case)
    for field in case:
        other: dict[str, Any] = copy.deepcopy(dict(case))
        del other[field]
        assert (release.meaning(kind, other) == whole) is (field in DESCRIPTIONS), field
    assert release.meaning("lrc", case) != whole
    assert release.meaning(kind, {**case, "flags": ["tolerant"]}) != whole
    assert release.meaning(kind, {**case, "flags": ["limit"], "clause": "x", "confirmed_by": []}) == whole


# The archive ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def content() -> release.Content:
    return release.content()


@pytest.fixture(scope="module")
def built(content: release.Content) -> tuple[bytes, bytes]:
    """The archive and the package of npm."""
    return release.archive(content), release.npm(content)


@pytest.fixture(scope="module")
def archive(built: tuple[bytes, bytes]) -> zipfile.ZipFile:
    return zipfile.ZipFile(io.BytesIO(built[0]))


TOP = f"barewire-vectors-{release.version()}/"


def test_the_archive_has_all_files_and_their_checksums(archive: zipfile.ZipFile) -> None:
    names = {name.removeprefix(TOP) for name in archive.namelist()}
    assert all(name.startswith(TOP) for name in archive.namelist())
    assert names >= {f"cases/{file.name}.json" for file in VECTORS.files}
    assert names >= {"README.md", "CHANGELOG.md", "LICENSE", "VERSION", "SHA256SUMS", "reference/main.py"}
    assert not [name for name in names if name.startswith(("peers/", "examples/", "npm/"))]
    assert names >= {"kinds.json", "schema.json", "index.json", "released.json", "changes.json", "questions.jsonl"}
    rows = [line.split("  ") for line in archive.read(f"{TOP}SHA256SUMS").decode().splitlines()]
    assert {name for _, name in rows} == names - {"SHA256SUMS"}
    assert all(hashlib.sha256(archive.read(TOP + name)).hexdigest() == digest for digest, name in rows)


def test_the_archive_is_a_folder_of_vectors(archive: zipfile.ZipFile, tmp_path: Path) -> None:
    archive.extractall(tmp_path)
    assert load_vectors(tmp_path / TOP) == VECTORS


def test_no_page_of_the_archive_has_a_link_out_of_it(archive: zipfile.ZipFile) -> None:
    names = [name.removeprefix(TOP) for name in archive.namelist()]
    for page in [name for name in names if name.endswith(".md")]:
        links = re.findall(r"\]\(([^)#\s]+)", archive.read(TOP + page).decode())
        inside = [
            posixpath.normpath(posixpath.join(posixpath.dirname(page), link)) for link in links if "://" not in link
        ]
        assert [link for link in inside if not any(name.startswith(link) for name in names)] == [], page


def test_the_changelog_of_the_archive_has_every_id(archive: zipfile.ZipFile) -> None:
    rows = json.loads(archive.read(f"{TOP}changes.json"))
    ids = [case_id for row in rows.values() for case_id in row["added"]]
    assert sorted(ids) == sorted(VECTORS.digests)


def test_the_archive_has_every_question_as_an_adapter_reads_it(archive: zipfile.ZipFile) -> None:
    rows = [json.loads(line) for line in archive.read(f"{TOP}questions.jsonl").splitlines()]
    asked = {row["question"]["id"]: row for row in rows}
    wanted = {
        question.id: (question, case)
        for file in VECTORS.files
        for case in file.cases
        for question in VECTORS.questions(file, case)
    }
    assert len(asked) == len(rows)
    assert asked.keys() == wanted.keys()
    for case_id, (question, case) in wanted.items():
        row = asked[case_id]
        assert (row["question"], row["expected"]) == (question.as_json(), question.expected)
        assert row["case"] == case["id"]
        assert [row.get(name) for name in JUDGED] == [case.get(name) for name in JUDGED]


JUDGED = ("result", "fails", "reason", "flags")


@pytest.mark.parametrize("longest", part_or_whole(10_000, 0))
def test_the_command_builds_both_and_the_same_bytes_every_time(
    longest: int, content: release.Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A part has the files of so many bytes at most: what differs is the order of the files or a time."""
    if longest:
        content = {name: data for name, data in content.items() if len(data) <= longest}
        monkeypatch.setattr(release, "content", lambda: content)
    monkeypatch.setattr("sys.argv", ["vectors_release", "--to", str(tmp_path / "dist")])
    assert release.main() == 0
    files = {file.suffix: file.read_bytes() for file in (tmp_path / "dist").iterdir()}
    assert files == {".zip": release.archive(content), ".tgz": release.npm(content)}


# The npm package --------------------------------------------------------------------------------------------------

COUNT = """
const { version, kinds, files, cases, index, schema, changes, questions } = require('barewire-vectors');
const find = (id) => cases.find((one) => one.id === id);
console.log(JSON.stringify({
  version, files: files.length, cases: cases.length, kinds: Object.keys(kinds).length, schema: schema.title,
  lrc: find('lrc-1'), digests: Object.keys(index).length, versions: Object.keys(changes),
  asked: questions().filter((one) => one.case === 'lrc-1'),
}));
"""


@pytest.fixture(scope="module")
def node_modules(built: tuple[bytes, bytes], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the package, as `npm install` puts it there."""
    folder = tmp_path_factory.mktemp("node_modules")
    with tarfile.open(fileobj=io.BytesIO(built[1])) as package:
        for row in package:
            content = package.extractfile(row)
            assert content is not None
            file = folder / "barewire-vectors" / row.name.removeprefix("package/")
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content.read())
    return folder


@pytest.fixture
def installed(node_modules: Path, tmp_path: Path) -> Path:
    """A folder in which the package is installed."""
    (tmp_path / "node_modules").symlink_to(node_modules)
    return tmp_path


@pytest.mark.needs("node")
def test_the_package_has_files_and_cases(installed: Path) -> None:
    run = subprocess.run(["node", "-e", COUNT], cwd=installed, capture_output=True, text=True, check=True, timeout=60)
    found = json.loads(run.stdout)
    _, case = VECTORS.find("lrc-1")
    assert found == {
        "version": release.version(),
        "files": len(VECTORS.files),
        "cases": len(VECTORS.digests),
        "kinds": len(VECTORS.kinds),
        "schema": "barewire-vectors/1",
        "lrc": {"id": "lrc-1", "kind": "lrc", "file": "ascii/lrc", "case": dict(case)},
        "digests": len(VECTORS.digests),
        "asked": [
            {
                "case": "lrc-1",
                **{name: case[name] for name in JUDGED if name in case},
                "question": {"id": "lrc-1.encode", "kind": "lrc", "do": "encode", "bytes": case["bytes"]},
                "expected": {"lrc": "F3"},
            }
        ],
        "versions": [*reversed({**release.released(), release.version(): 0})],
    }


@pytest.mark.needs("node")
def test_a_module_imports_the_package(installed: Path) -> None:
    (installed / "main.mjs").write_text("import { cases } from 'barewire-vectors'; console.log(cases.length)\n")
    run = subprocess.run(["node", "main.mjs"], cwd=installed, capture_output=True, text=True, check=True, timeout=60)
    assert int(run.stdout) == len(VECTORS.digests)


# The command of the package -----------------------------------------------------------------------------------------

OWN = [sys.executable, str(ROOT / "vectors" / "examples" / "own.py")]


def npx(installed: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `npx barewire-vectors` in an empty folder."""
    command = ["node", str(installed / "node_modules" / "barewire-vectors" / "check.js"), *arguments]
    folder = installed / "empty"
    folder.mkdir(exist_ok=True)
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)


@pytest.mark.needs("node")
@pytest.mark.parametrize("name", some_of(VECTORS.profiles, 2))
def test_a_profile_has_the_same_cases_in_both_commands(installed: Path, name: str) -> None:
    found = [line.split()[0] for line in npx(installed, "list", "--profile", name).stdout.splitlines()]
    assert found == [case["id"] for file in in_profile(VECTORS, name).files for case in file.cases]


@pytest.mark.needs("node")
def test_npx_checks_an_adapter_and_reports(installed: Path) -> None:
    run = npx(installed, "check", "--profile", "minimal", "--junit", "r.xml", "--badge", "b.svg", "--", *OWN)
    assert run.returncode == 0, run.stdout + run.stderr
    count = len(in_profile(VECTORS, "minimal").files)
    assert re.search(r"barewire [\d.]+: (\d+) of \1 cases passed$", run.stdout)
    root = ElementTree.parse(installed / "empty" / "r.xml").getroot()
    assert len(root.findall("testsuite")) == count
    assert root.findall(".//failure") == []
    result = badge_texts(VECTORS, "minimal", {"passed": int(run.stdout.split()[-5])})
    assert (installed / "empty" / "b.svg").read_text() == badge_svg(*result)


FAULTY = """
import json, os, sys, time
for line in sys.stdin:
    q = json.loads(line)
    if "hello" in q:
        a = {"name": "faulty", "version": "1", "kinds": {"lrc": ["encode"]}}
    else:
        a = {"id": q["id"], "is": {"lrc": "%02X" % (-sum(bytes.fromhex(q["bytes"])) & 255)}}
        if q["id"] == "lrc-3.encode":
            FAULT
    print(json.dumps(a), flush=True)
"""


@pytest.mark.needs("node")
@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ("a['is']['lrc'] = '<&>'", 'encode: answered {"lrc":"<&>"}, expected {"lrc":'),
        ("sys.exit('no lrc')", "it ended without an answer (exit status 1): no lrc"),
        ("print('debug', flush=True)", "its line is no answer to a question"),
        pytest.param("time.sleep(60)", "no answer within 3 s", marks=pytest.mark.proof),
        pytest.param("sys.stdout.write('x' * 3000000)", "a line of more than 1 MiB", marks=pytest.mark.proof),
        pytest.param("a = {'id': 'lrc-3'}", "its line is no answer to a question", marks=pytest.mark.proof),
    ],
)
def test_npx_fails_one_case_for_one_fault(installed: Path, fault: str, text: str) -> None:
    program = installed / "faulty.py"
    program.write_text(FAULTY.replace("FAULT", fault))
    arguments = ["--kind", "lrc", "--timeout", "3", "--junit", "r.xml", "--", sys.executable, str(program)]
    run = npx(installed, "check", *arguments)
    failures = ElementTree.parse(installed / "empty" / "r.xml").findall(".//failure")
    assert run.returncode == 1
    assert [line.split()[1] for line in run.stdout.splitlines() if line.startswith("failed")] == ["lrc-3"]
    assert text in run.stdout
    assert text in (failures[0].get("message") or "")


@pytest.mark.needs("node")
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["check"], "a command is needed, behind --"),
        (["check", "./my-adapter"], "expected check or list, and the adapter behind --"),
        (["check", "--", "/no/such/program"], "adapter /no/such/program: there is no such program"),
        (["check", "--", sys.executable, "-c", "pass"], "it ended without an answer"),
        (["check", "--profile", "modbus", "--", "x"], "profile modbus: expected one of modbus-core, "),
        (["check", "--kind", "crc", "--", "x"], "kind crc: there is no such kind"),
        (["check", "--only", "rtu/crc", "--", "x"], "no case fits the options"),
        (["check", "--badge", "b.png", "--", "x"], "expected a name that ends with .svg or .json"),
        (["check", "--kind", "lrc", "--badge", "b.svg", "--", "x"], "is for a whole profile"),
        (["check", "--fast"], "Unknown option '--fast'"),
    ],
)
def test_npx_says_what_is_wrong_with_its_options(installed: Path, arguments: list[str], text: str) -> None:
    run = npx(installed, *arguments)
    assert run.returncode == 2
    assert text in run.stderr
    assert len(run.stderr.splitlines()) == 1


# The action for GitHub ----------------------------------------------------------------------------------------------


@pytest.mark.needs("node")
@pytest.mark.parametrize(("adapter", "status"), [(OWN, 0), (["false"], 2)])
def test_the_action_runs_the_package(installed: Path, adapter: list[str], status: int) -> None:
    """Its script is run as GitHub runs it: inputs as variables of the environment, in bash; npx is ours."""
    lines = (ROOT / "vectors" / "action.yml").read_text(encoding="utf-8").splitlines()
    begin = lines.index("      run: |")
    script = "\n".join(line.removeprefix("        ") for line in lines[begin + 1 :])
    inputs = dict(re.findall(r"^        ([A-Z]+): \${{ inputs\.([a-z]+) }}$", "\n".join(lines), flags=re.MULTILINE))
    given = {
        "adapter": shlex.join(adapter),
        "profile": "cia402",
        "package": "p.tgz",
        "junit": "r.xml",
        "badge": "b.json",
    }
    assert {*inputs.values()} == given.keys()
    npx_here = installed / "bin" / "npx"
    npx_here.parent.mkdir()
    check = installed / "node_modules" / "barewire-vectors" / "check.js"
    npx_here.write_text(
        f'#!/bin/bash\n[[ "$1 $2 $3 $4" == "--yes --package p.tgz barewire-vectors" ]] && node "{check}" "${{@:5}}"\n'
    )
    npx_here.chmod(0o755)
    environment = {name: given[source] for name, source in inputs.items()}
    environment |= {"PATH": f"{npx_here.parent}:{os.environ['PATH']}"}
    command = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", script]
    run = subprocess.run(command, cwd=installed, env=environment, capture_output=True, text=True, timeout=60)
    assert run.returncode == status, run.stdout + run.stderr
    if status == 0:
        assert ElementTree.parse(installed / "r.xml").getroot().findall(".//failure") == []
        assert json.loads((installed / "b.json").read_text())["label"] == f"cia402 {VECTORS.version}"
