"""Changes the reference of the vectors in every small way, one at a time: do the cases notice? `make vectors-mutants`.

    python tools/vectors_mutants.py [FILE ...]     FILE: pdu, frames, ... (default: all)

A changed reference is a mutant. It runs the cases of the kinds that call the changed function, until one fails. A
mutant that no case notices survives: either a case is missing, or the change makes no difference that the standard
cares about; the tool prints it as the row of a table, and ends with status 1. vectors/reference/SURVIVORS.md may have
such rows with a reason each; then they are not printed, and a row is printed that fits no survivor any more.
After a run of all files the numbers of each kind are in vectors/mutants.json.
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
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any, NamedTuple, TypeAlias

from barewire.vectors.files import load_vectors
from barewire.vectors.judge import Verdict, judge, verdict_of_case
from barewire.vectors.questions import Case, Question

ROOT = Path(__file__).parent.parent
REFERENCE = ROOT / "vectors" / "reference"
PAGE, NUMBERS = REFERENCE / "SURVIVORS.md", REFERENCE.parent / "mutants.json"
LONGEST = 3.0
"""Seconds after which a mutant is stopped: it is in an endless loop, which a user would notice too."""

Sources: TypeAlias = Mapping[str, str]
Asked: TypeAlias = tuple[Case, tuple[Question, ...]]


# The reference ----------------------------------------------------------------------------------------------------


def sources() -> dict[str, str]:
    """Return the text of each file of the reference, by its name without .py."""
    return {file.stem: file.read_text(encoding="utf-8") for file in sorted(REFERENCE.glob("*.py"))}


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


# The mutants ------------------------------------------------------------------------------------------------------


class Mutant(NamedTuple):
    """One change: the file, the function or the constant, and its lines before and after."""

    file: str
    place: str
    before: str
    after: str
    text: str

    @property
    def row(self) -> tuple[str, str, str]:
        """What names it in the table of the page."""
        return f"{self.file}.{self.place}", self.before, self.after


_SWAPS: dict[type[ast.AST], Any] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.And: ast.Or, ast.Or: ast.And,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.FloorDiv, ast.FloorDiv: ast.Mult, ast.Div: ast.Mult,
    ast.Mod: ast.FloorDiv, ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd, ast.BitXor: ast.BitOr,
}  # fmt: skip


def mutants(file: str, text: str) -> Iterator[Mutant]:
    """Yield every mutant of a file, in the order of its lines, each one once."""
    tree, seen = ast.parse(text), {text}
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    data, lines = text.encode(), text.splitlines()
    for place, node, new in _changes(tree):
        first, last = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
        changed = (data[:first] + new.encode() + data[last:]).decode()
        if changed in seen:
            continue
        seen.add(changed)
        count = node.end_lineno - node.lineno + 1 + len(changed.splitlines()) - len(lines)
        before = _joined(lines[node.lineno - 1 : node.end_lineno])
        yield Mutant(file, place, before, _joined(changed.splitlines()[node.lineno - 1 :][:count]), changed)


def _joined(lines: Sequence[str]) -> str:
    return " ".join(line.strip() for line in lines)


def _changes(tree: ast.Module) -> Iterator[tuple[str, Any, str]]:
    """Yield the place, the node and its new text for each change. Texts of errors, imports and KINDS stay."""
    for statement in tree.body:
        if isinstance(statement, (ast.Assign, ast.AnnAssign, ast.AugAssign)):
            target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
            name = ",".join(one.id for one in ast.walk(target) if isinstance(one, ast.Name))
            if statement.value and name not in ("KINDS", "MODULES"):
                yield from _of_node(statement.value, name)
        elif isinstance(statement, ast.FunctionDef):
            yield from _of_function(statement, statement.name)
        elif isinstance(statement, ast.ClassDef):
            for method in statement.body:
                if isinstance(method, ast.FunctionDef):
                    yield from _of_function(method, f"{statement.name}.{method.name}")


def _of_function(function: ast.FunctionDef, place: str) -> Iterator[tuple[str, Any, str]]:
    for default in function.args.defaults:
        yield from _of_node(default, place)
    for statement in function.body:
        yield from _of_node(statement, place)


def _of_node(node: ast.AST, place: str) -> Iterator[tuple[str, Any, str]]:
    """Yield the changes of a node and of what it is made of."""
    if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
        return  # before Python 3.12 nothing tells where the parts of an f-string are; docstrings
    for new in _texts(node):
        yield place, node, new
    if isinstance(node, (ast.If, ast.IfExp, ast.While)):
        for value in ("False",) if isinstance(node, ast.While) else ("True", "False"):
            yield place, node.test, value
    if isinstance(node, ast.comprehension):
        for test in node.ifs:
            yield place, test, "True"
    for child in ast.iter_child_nodes(node):
        yield from _of_node(child, place)


def _texts(node: Any) -> Iterator[str]:
    """Yield the new texts of one node."""
    match node:
        case ast.Constant(value=bool()):
            yield str(not node.value)
        case ast.Constant(value=int(value)):
            yield repr(value + 1)
            if value:
                yield repr(value - 1)
        case ast.Constant(value=str(value)):
            yield repr(value + "G")
        case ast.Constant(value=bytes(data)):
            yield repr(data + b"G")
        case ast.Compare():
            for at, operator in enumerate(node.ops):
                operators = [*node.ops[:at], _SWAPS[type(operator)](), *node.ops[at + 1 :]]
                yield _text(ast.Compare(node.left, operators, node.comparators))
        case ast.BoolOp():
            yield _text(ast.BoolOp(_SWAPS[type(node.op)](), node.values))
            for at in range(len(node.values)):
                yield _text(ast.BoolOp(node.op, [*node.values[:at], *node.values[at + 1 :]]))
        case ast.BinOp():
            if type(node.op) in _SWAPS:
                yield _text(ast.BinOp(node.left, _SWAPS[type(node.op)](), node.right))
            if isinstance(node.op, ast.BitAnd):
                yield _text(node.left)
                mask = node.right.value if isinstance(node.right, ast.Constant) else 0
                if isinstance(mask, int):
                    for bit in range(mask.bit_length()):
                        if mask >> bit & 1:
                            yield _text(ast.BinOp(node.left, node.op, ast.Constant(mask ^ 1 << bit)))
        case ast.AugAssign() if type(node.op) in _SWAPS:
            yield ast.unparse(ast.AugAssign(node.target, _SWAPS[type(node.op)](), node.value))
            yield "pass"
        case ast.UnaryOp():
            yield _text(node.operand)
        case ast.Slice():
            if node.lower:
                yield ast.unparse(ast.Slice(None, node.upper, node.step))
            if node.upper:
                yield ast.unparse(ast.Slice(node.lower, None, node.step))
        case ast.Assign() | ast.Expr() | ast.Raise() | ast.Delete() | ast.Break():
            yield "pass"


def _text(node: ast.expr) -> str:
    return f"({ast.unparse(node)})"


# Which kinds a function belongs to --------------------------------------------------------------------------------


def kinds_of_functions(code: Mapping[str, CodeType], asked: Mapping[str, list[Asked]]) -> dict[str, set[str]]:
    """Return for each function "file.name" and each constant the kinds whose cases use it."""
    found: dict[str, set[str]] = {}
    reference = Reference(code)
    for kind, cases in asked.items():

        def note(frame: FrameType, event: str, _: object, kind: str = kind) -> None:
            if frame.f_code.co_filename.startswith("reference/"):
                file = frame.f_code.co_filename[len("reference/") : -len(".py")]
                place = frame.f_code.co_qualname.partition(".<")[0].partition(".<locals>")[0]
                found.setdefault(f"{file}.{place}", set()).add(kind)

        sys.setprofile(note)
        try:
            failure = first_failure(reference, cases)
        finally:
            sys.setprofile(None)
        if failure:
            raise SystemExit(f"the reference fails at {failure}: mend it first")
    return found


def _names_in(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def with_constants(texts: Sources, functions: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return the same with the constants: they belong to the kinds of the functions and constants that name them."""
    found = dict(functions)
    trees = {file: ast.parse(text) for file, text in texts.items()}
    for _ in range(3):  # a constant may be made of another one
        for file, tree in trees.items():
            importers = [other for other, text in texts.items() if f"from {file} import" in text] + [file]
            for statement in tree.body:
                if isinstance(statement, (ast.Assign, ast.AnnAssign, ast.AugAssign)):
                    target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
                    names = [node.id for node in ast.walk(target) if isinstance(node, ast.Name)]
                    kinds = {kind for other in importers for kind in _kinds_naming(trees[other], other, names, found)}
                    found[f"{file}.{','.join(names)}"] = kinds
    return found


def _kinds_naming(tree: ast.Module, file: str, names: Sequence[str], found: dict[str, set[str]]) -> set[str]:
    kinds: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            for method in node.body:
                if isinstance(method, ast.FunctionDef) and _names_in(method) & {*names}:
                    kinds |= found.get(f"{file}.{node.name}.{method.name}", set())
        elif isinstance(node, ast.FunctionDef) and _names_in(node) & {*names}:
            kinds |= found.get(f"{file}.{node.name}", set())
        elif isinstance(node, ast.Assign) and _names_in(node.value) & {*names}:
            targets = [one.id for one in ast.walk(node.targets[0]) if isinstance(one, ast.Name)]
            kinds |= found.get(f"{file}.{','.join(targets)}", set())
    return kinds


# The page and the run ---------------------------------------------------------------------------------------------

_ROW = re.compile(r"^\| `(?P<place>[^`]+)` \| `(?P<before>.+?)` \| `(?P<after>.+?)` \| (?P<why>[^|]+) \|$", re.M)


def explained(page: str) -> dict[tuple[str, str, str], str]:
    """Return the rows of the page: each surviving mutant, and why no case can notice it."""
    cells = ((match["place"], match["before"], match["after"], match["why"]) for match in _ROW.finditer(page))
    return {(place, before.replace("\\|", "|"), after.replace("\\|", "|")): why for place, before, after, why in cells}


def row(mutant: tuple[str, str, str], why: str = "") -> str:
    """Return the row of a mutant."""
    place, before, after = mutant
    return f"| `{place}` | `{before.replace('|', chr(92) + '|')}` | `{after.replace('|', chr(92) + '|')}` | {why} |"


def digests(texts: Sources) -> dict[str, str]:
    """Return a digest of each file: after a change of one the numbers are out of date."""
    return {name: hashlib.sha256(text.encode()).hexdigest()[:16] for name, text in texts.items()}


class _TooLongError(BaseException):
    """A mutant does not end."""


def _stop(*_: object) -> None:
    raise _TooLongError


def is_noticed(code: Mapping[str, CodeType], mutant: Mutant, cases: Sequence[list[Asked]]) -> bool:
    """Return whether a case fails, or the mutant cannot be started or does not end."""
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    try:
        changed = compile(mutant.text, f"reference/{mutant.file}.py", "exec")
        reference = Reference({**code, mutant.file: changed})
        return any(first_failure(reference, one) for one in cases)
    except (Exception, _TooLongError):
        return True
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _run(places: Mapping[str, set[str]], file: str) -> list[tuple[tuple[str, str, str], list[str], str]]:
    """Return the mutants of a file: its row, its kinds, and whether it was killed or survived."""
    signal.signal(signal.SIGALRM, _stop)
    resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
    texts, asked, found = sources(), asked_of_kinds(), []
    code = compiled(texts)
    for mutant in mutants(file, texts[file]):
        kinds = sorted(places.get(f"{file}.{mutant.place}", ()), key=lambda kind: len(asked[kind]))
        noticed = is_noticed(code, mutant, [asked[kind] for kind in kinds])
        found.append((mutant.row, kinds, "killed" if noticed else "survived"))
    return found


def main(names: Sequence[str]) -> int:
    """Run the mutants, compare the survivors with the page, and write the numbers."""
    texts = sources()
    code, asked = compiled(texts), asked_of_kinds()
    asked = {kind: asked[kind] for kind in Reference(code).module("main").KINDS}
    places = with_constants(texts, kinds_of_functions(code, asked))
    reasons = explained(PAGE.read_text(encoding="utf-8")) if PAGE.exists() else {}
    numbers: dict[str, Counter[str]] = {kind: Counter() for kind in asked}
    unexplained, used = 0, set()
    used_files = [name for name in texts if any(f"from {name} import" in text for text in texts.values())]
    files = names or [name for name in texts if f"import {name}\n" in texts["main"] or name in used_files]
    with ProcessPoolExecutor(mp_context=get_context("fork")) as pool:
        for file, states in zip(files, pool.map(partial(_run, places), files)):
            total: Counter[str] = Counter()
            for mutant_row, kinds, state in states:
                for count in (total, *(numbers[kind] for kind in kinds)):
                    count[state] += 1
                if state == "survived":
                    used.add(mutant_row)
                    if mutant_row not in reasons:
                        unexplained += 1
                        sys.stdout.write(f"{row(mutant_row)}\n")
            sys.stdout.write(f"{file}: {total.total()} mutants, {total['killed']} noticed\n")
            sys.stdout.flush()
    outdated = set() if names else reasons.keys() - used
    for place, before, after in sorted(outdated):
        sys.stdout.write(f"a row of {PAGE.name} is out of date: {place}: {before} -> {after}\n")
    if not names:
        rows = {kind: {state: one[state] for state in ("killed", "survived")} for kind, one in numbers.items()}
        NUMBERS.write_text(json.dumps({"files": digests(texts), "kinds": rows}, indent=1) + "\n", encoding="utf-8")
    return 1 if unexplained or outdated else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
