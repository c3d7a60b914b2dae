"""`barewire vectors`: lists, shown cases with their frames explained, reports and exit statuses of a check."""

from __future__ import annotations

import json
import re
import shlex
import sys
from fnmatch import fnmatchcase
from pathlib import Path
from xml.etree import ElementTree

import pytest

from barewire.errors import EncodeError
from barewire_workbench.cli.vectors_show import frames_of_case, pictures_of_case
from barewire_workbench.pictures.fields import FieldsPicture, byte_boxes
from barewire_workbench.pictures.picture import as_svg
from barewire_workbench.vectors.files import Vectors, load_vectors
from barewire_workbench.vectors.profiles import badge_texts, in_profile
from tests.helpers import every_case, part_or_whole
from tests.workbench.cli.helpers import output_of, run_here
from tests.workbench.vectors.loaded import VECTORS

FIRST = {file.kind: file.cases[0]["id"] for file in reversed(VECTORS.files)}
"""By kind: the id of a case."""


@pytest.fixture(autouse=True)
def read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each command reads all files; the tests of tests/workbench/vectors do so too."""

    def load(folder: Path | None) -> Vectors:
        return VECTORS if folder is None else load_vectors(folder)

    monkeypatch.setattr("barewire_workbench.cli.vectors.load_vectors", load)


@every_case("kind", FIRST)
def test_a_case_of_every_kind_is_shown(kind: str) -> None:
    shown = output_of("vectors", "show", FIRST[kind])
    assert shown.startswith(f"{FIRST[kind]}   ")
    assert f"\nkind {kind}, " in shown
    assert f'\n> {{"id": "{FIRST[kind]}.' in shown
    assert "failed" not in shown.splitlines()[-1]


@every_case("kind", FIRST)
def test_every_case_with_frames_has_a_picture(kind: str) -> None:
    file, case = VECTORS.find(FIRST[kind])
    if not [*frames_of_case(file.kind, case)] and not kind.startswith("drive-"):
        with pytest.raises(EncodeError, match=f"a case of kind {kind} has no frames"):
            pictures_of_case(file.kind, case)
        return
    for picture in pictures_of_case(file.kind, case):
        ElementTree.fromstring(as_svg(picture))


@pytest.mark.long
@pytest.mark.parametrize("step", part_or_whole(4, 1))
def test_cases_of_every_file_can_be_drawn(step: int) -> None:
    """All frames of Modbus, and each fifth case of the others: drawings are well-formed, and no byte is missing. A part
    is a fourth of that, of every file."""
    drawn = 0
    for file in VECTORS.files:
        for case in (file.cases if file.kind.endswith("-frame") else file.cases[::5])[::step]:
            try:
                first = pictures_of_case(file.kind, case)[0]
            except EncodeError:
                continue
            texts = [*ElementTree.fromstring(as_svg(first)).itertext()]
            drawn += 1
            if isinstance(first, FieldsPicture):
                boxes = [box.text for field in first.explanation.fields for box in byte_boxes(field)]
                assert sum(text in boxes for text in texts) >= len(boxes), case["id"]
    assert drawn > 600 / step


def test_an_exchange_as_svg_and_as_html() -> None:
    assert ElementTree.fromstring(output_of("vectors", "show", "sdo-blocks-1", "--format", "svg")).get("class") == "bw"
    assert "State machine of CiA 402" in output_of("vectors", "show", "drive-states-1", "--format", "html")
    assert output_of("vectors", "show", "lrc-1", "--format", "json") == output_of("vectors", "show", "lrc-1", "--json")


@pytest.mark.parametrize(
    ("case_id", "lines"),
    [
        ("rtu-frames-1", ["2  41 12  CRC               CRC ok"]),
        ("nmt-1", ["0  01   command  01h       start"]),
        ("can-frames-1", ["COB-ID"]),
        (
            "fc03-read-holding-registers-1",
            ["request", "1  00 6B  address        006Bh (107)  0-based; number 108 in 1-based tables"],
        ),
        ("fc0f-write-multiple-coils-22", ["response", "not valid: 1 byte is left over behind quantity (byte 5)"]),
        ("exchanges-1", ["request", "response", "byte count"]),
        ("server-bits-4", ["step 1, ask unit 1", "step 1, say", "valid: Read Coils, 8 from 0003h"]),
        ("rtu-talk-1", ["at 10000 us, frame of unit 1", "valid: Read Input Registers, 2 from 0FB1h"]),
        ("node-talk-1", ["at 0 us, hear", "at 0 us, said", "error control"]),
        ("sdo-segments-1", ["client", "server", "expedited"]),
        ("sdo-blocks-1", ["segment 1 of a block", "segment 2 of a block, the last", "last segment received in order"]),
        (
            "conform-nmt-2",
            ["step 2, send 605#4000100000000000, accepted: silence:", "valid: SDO request to node 5: initiate upload"],
        ),
        ("device-access-1", ["at 0 us, say", "valid: error control from node 5: boot-up"]),
    ],
)  # fmt: skip
def test_frames_are_explained_byte_by_byte(case_id: str, lines: list[str]) -> None:
    shown = re.sub(r" +", " ", output_of("vectors", "show", case_id))
    for line in lines:
        assert re.sub(r" +", " ", line) in shown


def test_of_a_long_case_every_frame_has_one_line() -> None:
    longest = max(
        (case for file in VECTORS.files if file.kind == "sdo-talk" for case in file.cases),
        key=lambda case: len(case["talk"]),
    )
    shown = output_of("vectors", "show", longest["id"])
    explained = [line for line in shown.splitlines() if line.startswith(("client  ", "server  "))]
    assert len(explained) == len(longest["talk"])


def test_long_lists_of_a_case_have_a_line_for_each_item() -> None:
    shown = output_of("vectors", "show", "client-rtu-fates-3").splitlines()
    first = shown.index("  ask:") + 1
    assert [line[:18] for line in shown[first : first + 3]] == ['    {"at": 0, "uni'] * 3
    assert '"fates": [{"delay": 250000}]' in shown[first + 2]
    assert "ask 3, unit 1:" in shown


@pytest.mark.parametrize("pattern", ["ascii/lrc", "ascii/lrc.json", "lrc"])
def test_a_file_is_selected_with_and_without_its_folder(pattern: str) -> None:
    assert output_of("vectors", "list", "--only", pattern) == output_of("vectors", "list", "--kind", "lrc")


@pytest.mark.parametrize("step", part_or_whole(4, 1))
def test_no_case_makes_the_explanation_fail(step: int) -> None:
    """Broken frames, texts that are no frames, cases without one side. A part is a fourth of every file."""
    explained = [
        frame.explanation.lines()
        for file in VECTORS.files
        for case in file.cases[::step]
        for frame in frames_of_case(file.kind, case)
    ]
    # A diagnosis may follow the verdict.
    assert all(any(line.startswith(("valid: ", "not valid: ")) for line in lines[-2:]) for lines in explained)
    assert len(explained) > 1000 / step


def test_a_case_as_json() -> None:
    shown = json.loads(output_of("vectors", "show", "lrc-1", "--json"))
    assert shown["case"] == VECTORS.find("lrc-1")[1]
    assert [question["id"] for question in shown["questions"]] == ["lrc-1.encode"]


def test_the_list_of_files_and_of_cases() -> None:
    heading, *files = output_of("vectors", "list").splitlines()
    assert heading.split() == ["file", "kind", "valid", "invalid", "acceptable", "subject"]
    assert len(files) == len(VECTORS.files) + 1
    lrc = next(line for line in files if line.startswith("ascii/lrc "))
    assert heading.index("invalid") + len("invalid") == lrc.index("4 ") + 1
    listed = output_of("vectors", "list", "--kind", "lrc", "--flag", "manual-erratum").splitlines()
    assert [line.split()[0] for line in listed] == [
        case["id"]
        for file in VECTORS.files
        for case in file.cases
        if file.kind == "lrc" and "manual-erratum" in case.get("flags", ())
    ]


def adapter(tmp_path: Path, lrc: str) -> str:
    """An adapter that answers every question about the LRC with this one."""
    (tmp_path / "adapter.py").write_text(
        "import json, sys\n"
        "for line in sys.stdin:\n"
        "    q = json.loads(line)\n"
        "    a = {'name': 'small', 'version': '7', 'kinds': {'lrc': ['encode']}} if 'hello' in q else "
        f"{{'id': q['id'], 'is': {{'lrc': {lrc!r}}}}}\n"
        "    print(json.dumps(a), flush=True)\n"
    )
    return shlex.join([sys.executable, str(tmp_path / "adapter.py")])


def test_a_check_that_fails_has_status_1_and_names_the_cases(tmp_path: Path) -> None:
    done = run_here("vectors", "check", "--adapter", adapter(tmp_path, "F3"), "--only", "lrc-[12]")
    assert done.returncode == 0
    done = run_here("vectors", "check", "--adapter", adapter(tmp_path, "00"), "--only", "lrc-[12]")
    assert done.returncode == 1
    assert "failed  lrc-1  " in done.stdout
    assert "    encode: lrc is 00, expected F3\n" in done.stdout
    assert done.stdout.endswith("small 7: 1 of 2 cases passed\n")


def test_a_check_of_an_adapter_that_offers_nothing_has_status_1(tmp_path: Path) -> None:
    done = run_here("vectors", "check", "--adapter", adapter(tmp_path, "00"), "--kind", "crc16")
    assert done.returncode == 1
    assert done.stdout.endswith(
        "small 7: 0 of 32 cases passed, 32 not offered\n"
        "nothing was asked; for example crc16-1: encode: small does not offer crc16.encode\n"
    )


def test_the_reports_as_json_and_junit(tmp_path: Path) -> None:
    report = tmp_path / "report.xml"
    words = ("vectors", "check", "--adapter", adapter(tmp_path, "00"), "--only", "lrc-[12]", "--only", "crc16-1")
    done = run_here(*words, "--json", "--junit", str(report))
    *cases, summary = map(json.loads, done.stdout.splitlines())
    assert [(case["id"], case["state"]) for case in cases] == [
        ("lrc-1", "failed"),
        ("lrc-2", "passed"),
        ("crc16-1", "not offered"),
    ]
    assert {name: summary[name] for name in ("implementation", "passed", "failed", "not offered")} == {
        "implementation": "small 7",
        "passed": 1,
        "failed": 1,
        "not offered": 1,
    }
    rows = ElementTree.parse(report).getroot().iter("testcase")
    assert [(row.get("name"), [child.tag for child in row]) for row in rows] == [
        ("lrc-1", ["failure"]),
        ("lrc-2", []),
        ("crc16-1", ["skipped"]),
    ]


def test_control_characters_of_an_adapter_reach_neither_the_terminal_nor_the_xml(tmp_path: Path) -> None:
    adapter, report = tmp_path / "adapter.py", tmp_path / "report.xml"
    adapter.write_text(
        "import json, sys\n"
        "for line in sys.stdin:\n"
        "    q = json.loads(line)\n"
        "    a = {'name': '\\0x', 'kinds': {'lrc': ['encode']}}\n"
        "    if 'id' in q:\n"
        "        a = {'id': q['id'], 'is': {'lrc': '\\x1b[2J'}}\n"
        "    print(json.dumps(a), flush=True)\n"
    )
    command = shlex.join([sys.executable, str(adapter)])
    done = run_here("vectors", "check", "--only", "lrc-1", "--adapter", command, "--junit", str(report))
    assert "lrc is ?[2J, expected F3" in done.stdout
    assert "\x1b" not in done.stdout
    assert ElementTree.parse(report).getroot().get("name") == "barewire vectors: ?x"


# Profiles and badges ----------------------------------------------------------------------------------------------


def test_the_profiles_are_listed_with_their_numbers() -> None:
    rows = {line.split()[0]: int(line.split()[1]) for line in output_of("vectors", "list", "--profiles").splitlines()}
    assert [*rows] == [*VECTORS.profiles]
    listed = output_of("vectors", "list", "--profile", "modbus-core").splitlines()
    assert len(listed) == rows["modbus-core"]
    assert rows["minimal"] < 300
    objects = [json.loads(line) for line in output_of("vectors", "list", "--profiles", "--json").splitlines()]
    assert {one["profile"]: one["cases"] for one in objects} == rows


def test_no_profile_has_a_case_that_only_we_decided() -> None:
    for name in [name for name in VECTORS.profiles if name != "minimal"]:
        flags = {
            flag for file in in_profile(VECTORS, name).files for case in file.cases for flag in case.get("flags", ())
        }
        assert "policy" not in flags


def test_every_rule_of_a_profile_is_known_and_chooses_something() -> None:
    known = {flag for file in VECTORS.files for case in file.cases for flag in case.get("flags", ())}
    for rules in VECTORS.profiles.values():
        assert rules.keys() <= {"about", "kinds", "files", "without_kinds", "without", "without_lines", "first"}
        assert {*rules.get("without_lines", ())} <= {"rtu", "ascii", "tcp"}
        assert {*rules.get("kinds", ()), *rules.get("without_kinds", ())} <= VECTORS.kinds.keys()
        assert {*rules.get("without", ())} <= known
        for pattern in rules.get("files", ()):
            assert [file for file in VECTORS.files if fnmatchcase(file.name, pattern)], pattern


@pytest.mark.parametrize("name", ["badge.svg", "badge.json"])
def test_a_badge_has_the_profile_its_version_and_the_numbers(name: str, tmp_path: Path) -> None:
    file = tmp_path / name
    output_of("vectors", "check", "--profile", "cia402", "--badge", str(file))
    text = file.read_text(encoding="utf-8")
    count = sum(len(one.cases) for one in in_profile(VECTORS, "cia402").files)
    assert f"cia402 {VECTORS.version}" in text
    assert f"{count} of {count}" in text
    if name.endswith(".svg"):
        ElementTree.fromstring(text)
    else:
        assert json.loads(text)["schemaVersion"] == 1


@pytest.mark.parametrize(
    ("total", "colour"),
    [
        ({"passed": 3, "open": 1}, "3c9a1e"),
        ({"passed": 3, "not offered": 1}, "b5860b"),
        ({"passed": 3, "failed": 1}, "c03a2b"),
        ({"not offered": 4}, "c03a2b"),
    ],
)
def test_the_colour_of_a_badge(total: dict[str, int], colour: str) -> None:
    assert badge_texts(VECTORS, "cia402", total)[2] == f"#{colour}"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--profile", "modbus"], "profile 'modbus': expected one of modbus-core, modbus-full"),
        (["--badge", "b.png"], "--badge b.png: expected a name that ends with .svg or .json"),
        (["--kind", "lrc", "--badge", "b.svg"], "--badge: is for a whole profile"),
        (["--profile", "cia402", "--kind", "lrc"], "no case fits"),
    ],
)
def test_wrong_options_for_profiles_and_badges(arguments: list[str], text: str) -> None:
    result = run_here("vectors", "check", *arguments)
    assert text in result.stderr
    assert result.returncode == 2
