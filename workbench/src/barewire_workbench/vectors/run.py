"""Runs cases: asks an implementation each question of a case, and judges its answers.

`ask` is any function from a question to an answer. If it raises `AdapterFailure`, the question has failed, and the run
continues. A program behind a pipe takes all questions at once (`AsksMany`), so that none waits for the one before it.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from fnmatch import fnmatchcase
from typing import NamedTuple, Protocol, TypeAlias, runtime_checkable

from barewire.errors import EncodeError, shown, suggest
from barewire_workbench.vectors.files import VectorFile, Vectors
from barewire_workbench.vectors.judge import Answer, Verdict, judge, verdict_of_case
from barewire_workbench.vectors.questions import Case, Question

Ask: TypeAlias = Callable[[Question], Answer]


class AdapterFailure(Exception):
    """The program that answers has crashed, does not answer in time, or answers what is not JSON."""


@runtime_checkable
class AsksMany(Protocol):
    """An implementation that is asked the next questions while it answers."""

    def answers(self, questions: Iterable[Question]) -> Iterator[Answer | AdapterFailure]:
        """Yield the answers to questions in their order, or why there is none."""


class CheckedCase(NamedTuple):
    """One case with its verdict, and the verdict on each of its questions."""

    file: VectorFile
    case: Case
    verdict: Verdict
    questions: tuple[tuple[Question, Verdict], ...]

    @property
    def id(self) -> str:
        """The id of the case."""
        return str(self.case["id"])


def selected(
    vectors: Vectors, *, kinds: Iterable[str] = (), only: Iterable[str] = (), flags: Iterable[str] = ()
) -> Vectors:
    """Return the cases of these kinds, whose id or file fits one of the patterns, and that have all these flags.

    A pattern is an id, a file with or without its folder, a folder, or has * for any characters.
    Raise EncodeError for a filter that nothing fits.
    """
    kinds, only, flags = [*kinds], [*only], {*flags}
    for kind in kinds:
        if kind not in vectors.kinds:
            hint = suggest(kind, vectors.kinds)
            raise EncodeError(f"kind {shown(kind)}: expected one of {', '.join(vectors.kinds)}{hint}")
    known = {flag for file in vectors.files for case in file.cases for flag in case.get("flags", ())}
    for flag in sorted(flags - known):
        raise EncodeError(f"flag {shown(flag)}: expected one of {', '.join(sorted(known))}{suggest(flag, known)}")
    files = []
    for file in vectors.files:
        if kinds and file.kind not in kinds:
            continue
        cases = tuple(case for case in file.cases if _fits(file, case, only) and flags <= {*case.get("flags", ())})
        if cases:
            files.append(file._replace(cases=cases))
    if not files:
        filters = ", ".join(map(shown, [*kinds, *only, *sorted(flags)]))
        raise EncodeError(f"no case fits {filters}; `barewire vectors list` shows all files")
    return vectors._replace(files=tuple(files))


def _fits(file: VectorFile, case: Case, patterns: list[str]) -> bool:
    folder, _, name = file.name.partition("/")
    names = (case["id"], file.name, f"{file.name}.json", folder, name)
    return not patterns or any(fnmatchcase(name, pattern) for pattern in patterns for name in names)


def run_cases(vectors: Vectors, ask: Ask | AsksMany, *, exact: bool = False) -> Iterator[CheckedCase]:
    """Yield each case with its verdict, in the order of the files."""
    coming: deque[tuple[VectorFile, Case, tuple[Question, ...]]] = deque()

    def questions() -> Iterator[Question]:
        for file in vectors.files:
            for case in file.cases:
                asked = vectors.questions(file, case)
                coming.append((file, case, asked))
                yield from asked

    answers = ask.answers(questions()) if isinstance(ask, AsksMany) else _one_by_one(ask, questions())
    judged: list[Verdict] = []
    for answer in answers:
        while not coming[0][2]:
            yield _checked(vectors, *coming.popleft(), [])
        file, case, asked = coming[0]
        judged.append(_judged(asked[len(judged)], answer, exact))
        if len(judged) == len(asked):
            coming.popleft()
            yield _checked(vectors, file, case, asked, judged)
            judged = []
    for left in coming:
        yield _checked(vectors, *left, [])


def _one_by_one(ask: Ask, questions: Iterable[Question]) -> Iterator[Answer | AdapterFailure]:
    for question in questions:
        try:
            yield ask(question)
        except AdapterFailure as failure:
            yield failure


def _judged(question: Question, answer: Answer | AdapterFailure, exact: bool) -> Verdict:
    if isinstance(answer, AdapterFailure):
        return Verdict("failed", str(answer))
    return judge(question, answer, exact=exact)


def _checked(
    vectors: Vectors, file: VectorFile, case: Case, questions: tuple[Question, ...], judged: list[Verdict]
) -> CheckedCase:
    verdicts = [
        verdict if verdict.state == "passed" else Verdict(verdict.state, f"{question.do}: {verdict.text}")
        for question, verdict in zip(questions, judged)
    ]
    verdict = verdict_of_case(verdicts, compares=case.get("fails") == "compare")
    if not questions:
        verdict = Verdict("failed", "the case asks no question: its kind or kinds.json has been changed")
    if damage := vectors.damage(case):
        verdict = Verdict("failed", damage)
    return CheckedCase(file, case, verdict, tuple(zip(questions, judged)))


class CheckSummary:
    """How many cases of each kind have passed, failed, ...: the numbers of a run."""

    def __init__(self) -> None:
        self.by_kind: dict[str, Counter[str]] = {}
        self.total: Counter[str] = Counter()
        self.failures: list[str] = []

    def add(self, checked: CheckedCase) -> None:
        """Count a case."""
        self.by_kind.setdefault(checked.file.kind, Counter())[checked.verdict.state] += 1
        self.total[checked.verdict.state] += 1
        if checked.verdict.state == "failed":
            self.failures.append(checked.id)

    def __repr__(self) -> str:
        return f"CheckSummary: {', '.join(f'{count} {state}' for state, count in self.total.items()) or 'no case'}"
