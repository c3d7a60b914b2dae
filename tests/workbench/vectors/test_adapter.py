"""Adapters: programs that answer, crash, hang, or write nonsense. The run goes on in every case."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from barewire.errors import PortError
from barewire_workbench.live.vector_adapter import WINDOW, VectorAdapter
from barewire_workbench.vectors.files import load_vectors
from barewire_workbench.vectors.questions import Question
from barewire_workbench.vectors.run import CheckedCase, run_cases, selected
from tests.helpers import BAREWIRE

pytestmark = pytest.mark.long

VECTORS = Path(__file__).parents[3] / "vectors"
OWN = shlex.join([sys.executable, str(VECTORS / "examples" / "own.py")])
LRC = selected(load_vectors(), kinds=["lrc"])
SECOND = "lrc-2"


def program(tmp_path: Path, answer: str) -> str:
    """A program that offers the LRC and answers as `answer` says, an expression of the question `q`."""
    file = tmp_path / "adapter.py"
    file.write_text(
        "import json, os, sys, time\n"
        "def right(q):\n"
        "    return {'id': q['id'], 'is': {'lrc': '%02X' % (-sum(bytes.fromhex(q['bytes'])) & 255)}}\n"
        "for line in sys.stdin:\n"
        "    q = json.loads(line)\n"
        "    if 'hello' in q:\n"
        "        a = {'name': 'small', 'version': '1', 'kinds': {'lrc': ['encode']}}\n"
        "    else:\n"
        f"        a = {answer}\n"
        "    print(a if isinstance(a, str) else json.dumps(a), flush=True)\n"
    )
    return f"{sys.executable} {file}"


def run(command: str, timeout: float = 10.0) -> dict[str, CheckedCase]:
    with VectorAdapter(command, timeout=timeout) as adapter:
        return {checked.id: checked for checked in run_cases(LRC, adapter)}


def test_an_adapter_answers_each_question(tmp_path: Path) -> None:
    found = run(program(tmp_path, "right(q)"))
    assert {checked.verdict.state for checked in found.values()} == {"passed"}


def test_our_own_adapter_passes_all_cases_of_a_kind() -> None:
    assert {checked.verdict.state for checked in run(OWN).values()} == {"passed"}


def test_a_wrong_answer_fails_one_case(tmp_path: Path) -> None:
    found = run(program(tmp_path, "{'id': q['id'], 'is': {'lrc': '00'}} if q['id'] == 'lrc-1.encode' else right(q)"))
    failed = [checked for checked in found.values() if checked.verdict.state == "failed"]
    assert [checked.id for checked in failed] == ["lrc-1"]
    assert failed[0].verdict.text == "encode: lrc is 00, expected F3"


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        ("os._exit(3)", "it ended without an answer (exit status 3)"),
        ("time.sleep(60)", "no answer within 3 s"),
        ("'hello there'", "its answer is not JSON: 'hello there'"),
        ("[1]", "its answer is not an object: '[1]'"),
        ("{'is': {}}", "its answer has no id of a question"),
        ("{'id': 'lrc-2', 'is': {'lrc': 'F5'}}", "its answer has the id 'lrc-2', expected 'lrc-2.encode'"),
        ("os.kill(os.getpid(), 9)", "it ended without an answer (SIGKILL)"),
        ("{'id': q['id'], 'was': 1}", "an answer needs one of is, refused and not_offered"),
        ("{'id': q['id'], 'is': 'F3'}", "is must be an object of fields, not a text"),
        ("int('x')", "ValueError: invalid literal"),
        ("'[' * 100000", "its answer is not JSON"),
        ("{'id': q['id'], 'is': {'lrc': float('nan')}}", "its answer is not JSON"),
    ],
)
def test_an_adapter_that_fails_once_fails_one_case(tmp_path: Path, answer: str, text: str) -> None:
    found = run(program(tmp_path, f"{answer} if q['id'] == '{SECOND}.encode' else right(q)"), timeout=3)
    states = {case_id: checked.verdict.state for case_id, checked in found.items()}
    assert states.pop(SECOND) == "failed"
    assert text in found[SECOND].verdict.text
    assert {*states.values()} == {"passed"}


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("['F3']", 'encode: lrc is ["F3"], expected a text'),
        ("5", "encode: lrc is 5, expected a text"),
    ],
)
def test_nonsense_does_not_pass_a_case_that_compares(tmp_path: Path, value: str, text: str) -> None:
    found = run(program(tmp_path, f"{{'id': q['id'], 'is': {{'lrc': {value}}}}}"))
    compares = [checked for checked in found.values() if checked.case.get("fails") == "compare"]
    assert {checked.verdict.text for checked in compares} == {text}


def test_an_adapter_that_always_crashes_is_given_up(tmp_path: Path) -> None:
    found = run(program(tmp_path, "os._exit(1)"))
    assert {checked.verdict.state for checked in found.values()} == {"failed"}


def test_what_is_not_offered_is_not_asked(tmp_path: Path) -> None:
    with VectorAdapter(program(tmp_path, "right(q)")) as adapter:
        states = {checked.verdict.state for checked in run_cases(selected(load_vectors(), kinds=["crc16"]), adapter)}
    assert states == {"not offered"}


@pytest.mark.parametrize(
    ("command", "text"),
    [
        ("", "the command is empty"),
        ("no-such-program-here", "no such program on the PATH"),
        ("no-such-folder/program", "No such file"),
        ("python 'x", "No closing quotation"),
        (f"{sys.executable} -c pass", "it ended"),
        (f"""{sys.executable} -c "input(); print('{{}}')" """, "its hello needs"),
    ],
)
def test_a_program_that_is_not_an_adapter_is_refused(command: str, text: str) -> None:
    with pytest.raises(PortError, match=text):
        VectorAdapter(command)


def test_an_output_that_is_not_flushed_is_suspected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("barewire_workbench.live.vector_adapter.START_TIMEOUT", 0.2)
    hint = "is its input read line by line, and its output flushed after each line"
    with pytest.raises(PortError, match=rf"no answer to the hello within 0\.2 s; {hint}"):
        VectorAdapter(f"{sys.executable} -c 'import time; time.sleep(60)'")


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize(
    ("number", "answers_hello"),
    [
        (signal.SIGTERM, True),
        (signal.SIGINT, False),
        pytest.param(signal.SIGTERM, False, marks=pytest.mark.proof),
        pytest.param(signal.SIGINT, True, marks=pytest.mark.proof),
    ],
)
def test_a_signal_ends_the_adapter_too(tmp_path: Path, number: signal.Signals, answers_hello: bool) -> None:
    silent, started = "time.sleep(600)", tmp_path / "started"
    command = program(tmp_path, f"(open({str(started)!r}, 'w').write(str(os.getpid())), {silent})")
    if not answers_hello:
        file = tmp_path / "adapter.py"
        # Behind the hello: before, `subprocess` may still be starting this program, which nobody would end then.
        writes = f"open({str(started)!r}, 'w').write(str(os.getpid()))"
        text = f"import os, sys, time\nsys.stdin.readline()\n{writes}\n{silent}\n"
        file.write_text(text)
    arguments = ["vectors", "check", "--kind", "lrc", "--adapter", command]
    checking = subprocess.Popen([BAREWIRE, *arguments], stdout=subprocess.DEVNULL)
    try:
        while not (started.exists() and started.read_text()):
            assert checking.poll() is None
            time.sleep(0.02)
        checking.send_signal(number)
        assert checking.wait(30) == {signal.SIGTERM: 143, signal.SIGINT: 130}[number]
        with pytest.raises(ProcessLookupError):
            os.kill(int(started.read_text()), 0)
    finally:
        checking.kill()
        checking.wait()


def test_answers_to_earlier_questions_do_not_put_off_the_end(tmp_path: Path) -> None:
    flood = '[print(\'{"id": "lrc-1.encode"}\', flush=True) for _ in iter(int, 1)]'
    found = run(program(tmp_path, f"{flood} if q['id'] == '{SECOND}.encode' else right(q)"), timeout=3)
    failed = {case_id: checked.verdict.text for case_id, checked in found.items() if checked.verdict.state == "failed"}
    assert failed == {SECOND: f"{found[SECOND].verdict.text}"}
    assert failed[SECOND].startswith("encode: no answer within 3 s")


@pytest.mark.skipif(sys.platform == "win32", reason="process groups of POSIX")
def test_what_an_adapter_has_started_ends_with_it(tmp_path: Path) -> None:
    """The child holds the pipes: whoever closed them would wait for it."""
    forks = "time.sleep(600) if os.fork() == 0 else os._exit(3)"
    found = run(program(tmp_path, f"right(q) if q['id'] != '{SECOND}.encode' else {forks}"), timeout=3)
    assert found[SECOND].verdict.text == "encode: no answer within 3 s (exit status 3)"


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_the_signal_that_ended_an_adapter_is_told(tmp_path: Path) -> None:
    found = run(program(tmp_path, f"os.kill(os.getpid(), 11) if q['id'] == '{SECOND}.encode' else right(q)"))
    assert found[SECOND].verdict.text == "encode: it ended without an answer (SIGSEGV)"


def test_questions_do_not_wait_for_answers(tmp_path: Path) -> None:
    """A program that reads them all before it answers the first, in any order."""
    file = tmp_path / "adapter.py"
    file.write_text(
        "import json, sys\n"
        "sys.stdin.readline()\n"
        "print(json.dumps({'name': 'late', 'kinds': {'lrc': ['encode']}}), flush=True)\n"
        f"asked = [json.loads(sys.stdin.readline()) for _ in range({len(LRC.files[0].cases)})]\n"
        "for q in reversed(asked):\n"
        "    lrc = '%02X' % (-sum(bytes.fromhex(q['bytes'])) & 255)\n"
        "    print(json.dumps({'id': q['id'], 'is': {'lrc': lrc}}), flush=True)\n"
    )
    found = run(f"{sys.executable} {file}")
    assert {checked.verdict.state for checked in found.values()} == {"passed"}


def test_a_bounded_number_of_questions_is_under_way(tmp_path: Path) -> None:
    asked = 0

    def questions() -> Iterator[Question]:
        nonlocal asked
        for number in range(500):
            asked += 1
            yield first._replace(number=number)

    (first,) = LRC.questions(LRC.files[0], LRC.files[0].cases[0])
    with VectorAdapter(program(tmp_path, "right(q)")) as adapter:
        for count, _ in enumerate(adapter.answers(questions()), start=1):
            assert asked - count <= WINDOW


def test_long_answers_are_read_while_questions_are_sent(tmp_path: Path) -> None:
    """Each side has more to say than a pipe holds: neither waits for the other for ever."""
    large = "{'id': q['id'], 'is': {'lrc': 'x' * 900000}}"
    found = run(program(tmp_path, large))
    assert found["lrc-1"].verdict.text.startswith("encode: lrc is xxx")


ODD: tuple[object, ...] = (None, -1, "x", [], {}, [{}])


def test_our_own_adapter_survives_every_question() -> None:
    questions = [
        *(b"nonsense", b"", b"\xff\xfe", b"{}", b"[]", b"5", b"null", b'"hello"', b"[" * 100_000),
        *(b'{"id": "a"}', b'{"id": "a", "kind": [], "do": "run"}', b'{"id": "a", "kind": "lrc", "do": {}}'),
        *(
            json.dumps({"id": "a", "kind": kind, "do": do, **dict.fromkeys(fields, value)}).encode()
            for kind, row in json.loads((VECTORS / "kinds.json").read_text(encoding="utf-8")).items()
            for do, operation in row.items()
            for value in ODD
            for fields in ([], [name.removesuffix("?") for name in operation["given"]])
        ),
        b'{"id": "b", "kind": "lrc", "do": "encode", "bytes": "01 04 00 00 08"}',
    ]
    given = b"\n".join(questions)
    run = subprocess.run(shlex.split(OWN), input=given, capture_output=True, timeout=60, check=True)
    answers = [json.loads(line) for line in run.stdout.splitlines()]
    assert len(answers) == len(questions)
    assert answers[-1] == {"id": "b", "is": {"lrc": "F3"}}
