"""The judges in vectors/judge: each in its language gives the same verdicts as `barewire vectors check`.

They judge good answers and bad ones: the reference, two stacks of others, programs that say nothing, and random damage.
A part of the cases is judged here, all of them in `make proof`.
"""

from __future__ import annotations

import copy
import json
import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from barewire_workbench.live.vector_adapter import VectorAdapter
from barewire_workbench.vectors.answers.table import own_answer
from barewire_workbench.vectors.judge import Answer, judge
from barewire_workbench.vectors.questions import Question
from barewire_workbench.vectors.run import AdapterFailure
from tests.workbench.vectors.loaded import VECTORS
from tools.peers import PEERS

JUDGE = Path(__file__).parents[3] / "vectors" / "judge"
DAMAGES = 4
"""Damaged answers to each question."""


# The answers ------------------------------------------------------------------------------------------------------


def peer(name: str) -> str:
    return next(one for one in PEERS if one.name == name).command()


SILENT: dict[str, Callable[[Question], Answer]] = {
    "null": lambda question: {"is": {}},
    "echo": lambda question: {"is": question.as_json()},
    "null in each field": lambda question: {"is": dict.fromkeys(question.expected)},
    "what is expected": lambda question: {"is": question.expected},
    "always invalid": lambda question: {"refused": ""},
    "always short": lambda question: {"refused": "short"},
    "never": lambda question: {"not_offered": "nothing is"},
    "two answers": lambda question: {"is": question.expected, "refused": ""},
    "none": lambda question: {},
    "no fields": lambda question: {"is": [1], "refused": None},
}
OTHERS = {
    "the reference": f'"{sys.executable}" "{JUDGE.parent / "reference" / "main.py"}"',
    **{name: peer(name) for name in ("uModbus", "canopen")},
}


def places(answer: Any) -> Iterator[tuple[Any, Any]]:
    """Yield each list or object inside an answer, with the key of each of its items."""
    for key in list(answer) if isinstance(answer, dict) else range(len(answer)) if isinstance(answer, list) else ():
        yield answer, key
        yield from places(answer[key])


def damaged(answer: Any, chance: random.Random) -> Any:
    """An answer with one or two damages: something is missing, of another type, written otherwise, or in disorder."""
    made = copy.deepcopy(answer)
    for _ in range(chance.choice((1, 1, 2))):
        if not (found := list(places(made))):
            break
        inside, key = chance.choice(found)
        old = inside[key]
        others: list[Any] = [None, "", [], {}, 0, True, "00", -1, 1.5, "1.0", {"one_of": True}]
        if isinstance(old, str):
            at = chance.randrange(len(old) + 1)
            others += [old.lower().replace(" ", ""), old[:at] + chance.choice("019AF .#zé\0") + old[at + 1 :]]
            others += [old + more for more in ("0", ".0", "e0", " 00", "00")]
        elif isinstance(old, list):
            others += [[*old, *old[:1]], old[1:], chance.sample(old, len(old))] * 3
        elif type(old) is int:
            others += [old + more for more in (1, -1, 0.5, 0.0)]
        if chance.random() < 0.1:
            del inside[key]
        else:
            inside[key] = chance.choice(others)
    return made


def answered(step: int) -> Iterator[tuple[Question, Answer]]:
    """Yield the questions of every `step`th case of each file with all answers to it."""
    cases = [(file, case) for file in VECTORS.files for case in file.cases[::step]]
    questions = [question for file, case in cases for question in VECTORS.questions(file, case)]
    chance = random.Random(26)
    for question in questions:
        own = json.loads(json.dumps(own_answer(json.loads(json.dumps(question.as_json())))))
        yield from ((question, answer) for answer in (own, *(ask(question) for ask in SILENT.values())))
        yield from ((question, damaged(own, chance)) for _ in range(DAMAGES))
        yield question, {"is": damaged(question.expected, chance)}
    for command in OTHERS.values():
        with VectorAdapter(command, timeout=60) as adapter:
            for question in questions:
                try:
                    yield question, adapter(question)
                except AdapterFailure:  # it has crashed: nothing to judge
                    continue


# The rows, and the verdicts ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fill() -> Any:
    sys.path.insert(0, str(JUDGE / "py"))
    try:
        return __import__("fill")
    finally:
        sys.path.remove(str(JUDGE / "py"))


@pytest.fixture(
    scope="module", params=[pytest.param(40, id="a part"), pytest.param(1, id="all", marks=pytest.mark.proof)]
)
def step(request: pytest.FixtureRequest) -> int:
    """The judges are given every `step`th case of each file."""
    return int(request.param)


@pytest.fixture(scope="module")
def rows(step: int, fill: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A file of rows for the judges, and the verdicts of `barewire vectors check` on them."""
    file, verdicts = tmp_path_factory.mktemp("judge") / "rows.jsonl", []
    with file.open("w", encoding="utf-8") as lines:
        for question, answer in answered(step):
            judged = {
                name: question.case[name] for name in ("result", "fails", "reason", "flags") if name in question.case
            }
            row = {**judged, "question": question.as_json(), "expected": question.expected, "answer": answer}
            if question.kind == "device-conformance":
                row["filled"] = filled(fill, question, answer)
            lines.write(f"{json.dumps(row)}\n")
            verdicts.append(f"{question.id} {judge(question, answer).state}")
    return file, verdicts


def filled(fill: Any, question: Question, answer: Any) -> Any:
    try:
        return fill.fill(question.as_json(), fill.device_of(answer["is"]["device"]))
    except fill.ERRORS:
        return None


COMMANDS = {
    "py": [sys.executable, "judge.py"],
    "js": ["node", "judge.js"],
    "c": ["cc", "-O2", "-Wall", "-Wextra", "-Werror", "-o", "{judge}", "judge.c", "-lm"],
    "go": ["go", "build", "-o", "{judge}", "judge.go", "equal.go", "patterns.go"],
    "rust": ["rustc", "-O", "-D", "warnings", "-o", "{judge}", "judge.rs"],
}
"""By language: what runs the judge, or compiles it to {judge}."""
OPTIMIZED = ("-O2", "-O")
"""Left out for a part: to optimize takes longer than to judge it."""
NEEDS = {"js": "node", "c": "cc", "go": "go", "rust": "rustc"}


@pytest.mark.long
@pytest.mark.parametrize(
    "language",
    [pytest.param(one, marks=[pytest.mark.needs(NEEDS[one])] if one in NEEDS else []) for one in COMMANDS],
)
def test_each_judge_gives_the_verdicts_of_vectors_check(
    language: str, step: int, rows: tuple[Path, list[str]], tmp_path: Path
) -> None:
    file, verdicts = rows
    made = tmp_path / "judge"
    words = [word for word in COMMANDS[language] if step == 1 or word not in OPTIMIZED]
    command = [word.format(judge=made) for word in words]
    if str(made) in command:
        subprocess.run(command, cwd=JUDGE / language, check=True, timeout=300)
        command = [str(made)]
    with file.open("rb") as given:
        run = subprocess.run(command, cwd=JUDGE / language, stdin=given, capture_output=True, text=True, timeout=300)
    assert run.stderr == ""
    found = run.stdout.splitlines()
    assert len(found) == len(verdicts)
    assert [pair for pair in zip(found, verdicts) if pair[0] != pair[1]] == []


def test_there_are_answers_with_each_verdict(rows: tuple[Path, list[str]]) -> None:
    _, verdicts = rows
    states = {verdict.partition(" ")[2] for verdict in verdicts}
    assert states == {"passed", "open", "failed", "not offered"}


@pytest.mark.long
@pytest.mark.needs("node")
def test_a_case_is_filled_alike_in_both_languages(rows: tuple[Path, list[str]]) -> None:
    file, _ = rows
    program = """
      const { fill } = require('./fill.js');
      require('node:readline').createInterface({ input: process.stdin }).on('line', (line) => {
        const { question, answer } = JSON.parse(line);
        console.log(JSON.stringify(fill(question, answer.is?.device)));
      });"""
    lines = [line for line in file.read_text(encoding="utf-8").splitlines() if '"filled"' in line]
    run = subprocess.run(
        ["node", "-e", program], cwd=JUDGE / "js", input="\n".join(lines), capture_output=True, text=True, check=True
    )
    wanted = [json.loads(line)["filled"] for line in lines]
    assert any(wanted)
    found = [json.loads(line) for line in run.stdout.splitlines()]
    answers = [json.loads(line)["answer"] for line in lines]
    assert [row for row in zip(answers, found, wanted, strict=True) if row[1] != row[2]] == []
