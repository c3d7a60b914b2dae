"""Runs cases: asks an implementation each question of a case, and judges its answers.

`ask` is any function from a question to an answer: ours, or a program behind a pipe. If it raises `AdapterFailure`, the
question has failed, and the run continues.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from fnmatch import fnmatchcase
from typing import NamedTuple, TypeAlias

from barewire.errors import EncodeError, shown, suggest
from barewire_workbench.vectors.files import VectorFile, Vectors
from barewire_workbench.vectors.judge import Answer, Verdict, judge, verdict_of_case
from barewire_workbench.vectors.questions import Case, Question

Ask: TypeAlias = Callable[[Question], Answer]


class AdapterFailure(Exception):
    """The program that answers has crashed, does not answer in time, or answers what is not JSON."""


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


def run_cases(vectors: Vectors, ask: Ask, *, exact: bool = False) -> Iterator[CheckedCase]:
    """Yield each case with its verdict, in the order of the files."""
    for file in vectors.files:
        for case in file.cases:
            judged = tuple((question, _judged(question, ask, exact)) for question in vectors.questions(file, case))
            verdicts = [
                verdict if verdict.state == "passed" else Verdict(verdict.state, f"{question.do}: {verdict.text}")
                for question, verdict in judged
            ]
            verdict = verdict_of_case(verdicts, compares=case.get("fails") == "compare")
            if not judged:
                verdict = Verdict("failed", "the case asks no question: its kind or kinds.json has been changed")
            if damage := vectors.damage(case):
                verdict = Verdict("failed", damage)
            yield CheckedCase(file, case, verdict, judged)


def _judged(question: Question, ask: Ask, exact: bool) -> Verdict:
    try:
        answer = ask(question)
    except AdapterFailure as failure:
        return Verdict("failed", str(failure))
    return judge(question, answer, exact=exact)


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
