"""Changes the reference of the vectors in every small way, one at a time: do the cases notice? `make vectors-mutants`.

    python -m tools.vectors_mutants [FILE ...]     FILE: pdu, frames, ... (default: all)

A changed reference is a mutant. It runs the cases that use the changed function, until one fails. A mutant that no
case notices survives: either a case is missing, or the change makes no difference that the standard cares about. Such
a difference is a policy, a heading of vectors/reference/SURVIVORS.md with the rows of its mutants below:

    | `file.function` | `the lines before` | `the lines after` |

The tool ends with status 1 if a survivor has no row, which it prints ready to be put below a policy, or if a row is out
of date. It writes the numbers into vectors/mutants.json and into the table of vectors/reference/README.md.
"""

from __future__ import annotations

import ast
import builtins
import hashlib
import json
import re
import resource
import signal
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any, NamedTuple, TypeAlias

from barewire_workbench.vectors.files import load_vectors
from barewire_workbench.vectors.judge import Verdict, judge, verdict_of_case
from barewire_workbench.vectors.questions import Case, Question
from tools import vectors
from tools.vectors_changes import Mutant, Row, mutants

ROOT = Path(__file__).parent.parent
REFERENCE = ROOT / "vectors" / "reference"
PAGE, NUMBERS = REFERENCE / "SURVIVORS.md", REFERENCE.parent / "mutants.json"
LONGEST = 3.0
"""Seconds of processor time for one case: then a mutant is in an endless loop, which a user would notice too."""

Sources: TypeAlias = Mapping[str, str]
Asked: TypeAlias = tuple[Case, tuple[Question, ...]]
NOT_CHANGED = ("main", "client_peer")
"""The adapter; and the peer of a client, which belongs to the questions and not to the answers."""
STATES = ("noticed", "explained", "survived")
"""What the numbers of vectors/mutants.json count."""


# The reference ----------------------------------------------------------------------------------------------------


def sources() -> dict[str, str]:
    """Return the text of each file of the reference, by its name without .py."""
    files = sorted(REFERENCE.rglob("*.py"), key=lambda file: file.stem)
    return {file.stem: file.read_text(encoding="utf-8") for file in files}


class Reference:
    """The reference, made of source texts: its modules import each other and never the files."""

    def __init__(self, code: Mapping[str, CodeType]) -> None:
        self._code = code
        self._modules: dict[str, ModuleType] = {}
        self.answer: Callable[[dict[str, Any]], dict[str, Any]] = self.module("main").answer

    def module(self, name: str) -> ModuleType:
        """Return a module, executed at its first use."""
        if name not in self._modules:
            made = self._modules[name] = ModuleType(name)
            made.__file__ = str(REFERENCE / f"{name}.py")
            made.__dict__["__builtins__"] = {**vars(builtins), "__import__": self._import}
            exec(self._code[name], made.__dict__)
        return self._modules[name]

    def _import(self, name: str, *others: Any) -> ModuleType:
        return self.module(name) if name in self._code else __import__(name, *others)


def compiled(texts: Sources) -> dict[str, CodeType]:
    """Return the code of each file."""
    return {name: compile(text, f"reference/{name}.py", "exec") for name, text in texts.items()}


def asked_of_kinds() -> dict[str, list[Asked]]:
    """Return the questions of each case, by kind; those with few first."""
    vectors = load_vectors(ROOT / "vectors")
    found: dict[str, list[Asked]] = {}
    for file in vectors.files:
        found.setdefault(file.kind, []).extend((case, vectors.questions(file, case)) for case in file.cases)
    return {kind: sorted(cases, key=lambda asked: len(asked[1])) for kind, cases in found.items()}


def first_failure(reference: Reference, cases: Sequence[Asked]) -> str:
    """Return the id of the first case that fails; nothing if none does."""
    for case, questions in cases:
        verdicts = [_verdict(reference, question) for question in questions]
        if verdict_of_case(verdicts, compares=case.get("fails") == "compare").state == "failed":
            return str(case["id"])
    return ""


def _verdict(reference: Reference, question: Question) -> Verdict:
    try:
        return judge(question, reference.answer(question.as_json()))
    except Exception as error:
        return Verdict("failed", repr(error))


# Which cases use a function ----------------------------------------------------------------------------------------


def cases_of_functions(code: Mapping[str, CodeType], asked: Mapping[str, list[Asked]]) -> dict[str, set[str]]:
    """Return for each function "file.name" the ids of the cases that use it."""
    found: dict[str, set[str]] = {}
    reference = Reference(code)
    for case in (one for cases in asked.values() for one in cases):

        def note(frame: FrameType, event: str, _: object, case_id: str = str(case[0]["id"])) -> None:
            if event == "call" and frame.f_code.co_filename.startswith("reference/"):
                file = frame.f_code.co_filename[len("reference/") : -len(".py")]
                place = frame.f_code.co_qualname.partition(".<")[0].partition(".<locals>")[0]
                found.setdefault(f"{file}.{place}", set()).add(case_id)

        sys.setprofile(note)
        try:
            failure = first_failure(reference, [case])
        finally:
            sys.setprofile(None)
        if failure:
            raise SystemExit(f"the reference fails at {failure}: mend it first")
    return found


def _names_in(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def with_constants(texts: Sources, functions: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return the same with the constants: the cases of the functions and constants that name them use them."""
    found = dict(functions)
    trees = {file: ast.parse(text) for file, text in texts.items()}
    for _ in range(3):  # a constant may be made of another one
        for file, tree in trees.items():
            importers = [other for other, text in texts.items() if f"from {file} import" in text] + [file]
            for statement in tree.body:
                if isinstance(statement, (ast.Assign, ast.AnnAssign, ast.AugAssign)):
                    target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
                    names = [node.id for node in ast.walk(target) if isinstance(node, ast.Name)]
                    users = [_users(trees[other], other, names, found) for other in importers]
                    found[f"{file}.{','.join(names)}"] = set().union(*users)
    return found


def _users(tree: ast.Module, file: str, names: Sequence[str], found: dict[str, set[str]]) -> set[str]:
    users: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            for method in node.body:
                if isinstance(method, ast.FunctionDef) and _names_in(method) & {*names}:
                    users |= found.get(f"{file}.{node.name}.{method.name}", set())
        elif isinstance(node, ast.FunctionDef) and _names_in(node) & {*names}:
            users |= found.get(f"{file}.{node.name}", set())
        elif isinstance(node, ast.Assign) and _names_in(node.value) & {*names}:
            targets = [one.id for one in ast.walk(node.targets[0]) if isinstance(one, ast.Name)]
            users |= found.get(f"{file}.{','.join(targets)}", set())
    return users


# The page ---------------------------------------------------------------------------------------------------------

_POLICY = re.compile(r"^### (?P<name>.+)$", re.M)
_ROW = re.compile(r"^\| `([^`]+)` \| `([^`]+)` \| `([^`]+)` \|$", re.M)


def explained(page: str) -> dict[Row, str]:
    """Return the rows of the page: each surviving mutant, and the policy below whose heading it is."""
    parts = _POLICY.split(page)
    found: dict[Row, str] = {}
    for policy, text in zip(parts[1::2], parts[2::2]):
        for match in _ROW.finditer(text):
            place, before, after = (cell.replace("\\|", "|") for cell in match.groups())
            found[place, before, after] = policy
    return found


def row(mutant: Row) -> str:
    """Return the row of a mutant."""
    return "| " + " | ".join(f"`{cell.replace('|', chr(92) + '|')}`" for cell in mutant) + " |"


def digest(text: str) -> str:
    """Return the digest of a file: after a change of it its numbers are out of date."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def as_lines(numbers: Mapping[str, Any]) -> str:
    """Return the text of vectors/mutants.json: a line for each file."""
    return "{\n" + ",\n".join(f'"{file}": {json.dumps(one)}' for file, one in numbers.items()) + "\n}\n"


# The run ----------------------------------------------------------------------------------------------------------


class _TooLongError(BaseException):
    """A mutant does not end."""


def _stop(*_: object) -> None:
    raise _TooLongError


def is_noticed(code: Mapping[str, CodeType], mutant: Mutant, cases: Sequence[Asked]) -> bool:
    """Return whether a case fails, or the mutant cannot be started or does not end."""
    signal.signal(signal.SIGVTALRM, _stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)
    try:
        changed = compile(mutant.text, f"reference/{mutant.file}.py", "exec")
        reference = Reference({**code, mutant.file: changed})
        for case in cases:
            signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)
            if first_failure(reference, [case]):
                return True
    except (Exception, _TooLongError):
        return True
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    return False


class Work(NamedTuple):
    """What the processes share: the reference, its cases in the order of their work, and who uses what."""

    texts: Sources
    code: Mapping[str, CodeType]
    cases: Sequence[tuple[str, Asked]]
    users: Mapping[str, set[str]]

    @classmethod
    def of_today(cls) -> Work:
        """Read the reference and the cases, and run them once."""
        texts, asked = sources(), asked_of_kinds()
        code = compiled(texts)
        asked = {kind: asked[kind] for kind in Reference(code).module("main").KINDS}
        cases = sorted(((kind, one) for kind in asked for one in asked[kind]), key=lambda pair: len(pair[1][1]))
        return cls(texts, code, cases, with_constants(texts, cases_of_functions(code, asked)))

    def run(self, mutant: Mutant) -> tuple[set[str], bool]:
        """Return the kinds that use what the mutant changes, and whether one of their cases notices it."""
        users = self.users.get(f"{mutant.file}.{mutant.place}", set())
        cases = [(kind, one) for kind, one in self.cases if one[0]["id"] in users]
        return {kind for kind, _ in cases}, is_noticed(self.code, mutant, [one for _, one in cases])


_WORK: list[Work] = []


def _start(work: Work) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
    _WORK.append(work)


def _run(mutant: Mutant) -> tuple[set[str], bool]:
    return _WORK[0].run(mutant)


def run(work: Work, file: str, reasons: Mapping[Row, str]) -> tuple[dict[str, Any], list[Row]]:
    """Run the mutants of a file. Return its numbers, and the rows of the survivors."""
    made = list(mutants(file, work.texts[file]))
    total, kinds, survivors = Counter[str](), dict[str, Counter[str]](), list[Row]()
    with ProcessPoolExecutor(mp_context=get_context("fork"), initializer=_start, initargs=(work,)) as pool:
        for mutant, (of_kinds, noticed) in zip(made, pool.map(_run, made, chunksize=4)):
            state = "noticed" if noticed else "explained" if mutant.row in reasons else "survived"
            for counts in (total, *(kinds.setdefault(kind, Counter()) for kind in sorted(of_kinds))):
                counts[state] += 1
            if not noticed:
                survivors.append(mutant.row)
    numbers = {kind: [counts[state] for state in STATES] for kind, counts in sorted(kinds.items())}
    return {"digest": digest(work.texts[file]), "all": [total[state] for state in STATES], "kinds": numbers}, survivors


def main(names: Sequence[str]) -> int:
    """Run the mutants, compare the survivors with the page, and write the numbers."""
    if {"-h", "--help"} & {*names}:
        sys.stdout.write(__doc__ or "")
        return 0
    work = Work.of_today()
    reasons = explained(PAGE.read_text(encoding="utf-8"))
    numbers = json.loads(NUMBERS.read_text(encoding="utf-8"))
    files = list(names or (name for name in work.texts if name not in NOT_CHANGED))
    used: set[Row] = set()
    for file in files:
        numbers[file], survivors = run(work, file, reasons)
        kept = {name: numbers[name] for name in work.texts if name in numbers}
        NUMBERS.write_text(as_lines(kept), encoding="utf-8")
        used |= {*survivors}
        for one in survivors:
            if one not in reasons:
                sys.stdout.write(f"{row(one)}\n")
        noticed, explained_, survived = numbers[file]["all"]
        sys.stdout.write(f"{file}: {noticed} noticed, {explained_} explained, {survived} not explained\n")
        sys.stdout.flush()
    outdated = [one for one in reasons if one[0].partition(".")[0] in files and one not in used]
    for one in outdated:
        sys.stdout.write(f"this row of {PAGE.name} is out of date:\n{row(one)}\n")
    vectors.write_pages()
    return 1 if outdated or any(numbers[file]["all"][-1] for file in files) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
