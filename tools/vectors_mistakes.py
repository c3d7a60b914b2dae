"""Plants mistakes in three stacks, one at a time: does a case fail for each? `make vectors-mistakes`.

    python -m tools.vectors_mistakes [WORD ...]     WORD: only mistakes of this stack or class, or with it in their text

vectors/mistakes.json is the catalogue: what is wrong, its class, the kinds whose cases have to notice it, and the
change that makes it in a file of a stack:

    pymodbus, canopen    the packages of pip, by their adapters: stacks of others
    javascript           vectors/examples/javascript, the second implementation here

The tool writes `case`, the first that fails for the mistake and passes without it, and `programs`: those of others that
give the same wrong answer in one of the cases that notice it. `seen` are threads, read by hand, in which somebody
describes the mistake, or a file that makes it. A mistake with neither was not met: the table in
vectors/reference/README.md (`python -m tools.vectors`) counts them. A mistake that no case notices needs a `why`; the
tool ends with status 1 if there is none. What the standard permits, a change that changes nothing, and one that an
adapter cannot reach, is no mistake. Mutation (tools/vectors_mutants.py) cannot find a check that the reference does not
have; this catalogue is written by hand.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

from barewire.errors import PortError
from barewire_workbench.live.vector_adapter import VectorAdapter
from barewire_workbench.vectors.files import Vectors, load_vectors
from barewire_workbench.vectors.judge import Answer
from barewire_workbench.vectors.questions import Question
from barewire_workbench.vectors.run import AdapterFailure, Ask, run_cases, selected
from tools.peers import ADAPTERS, PEERS, ROOT

CATALOGUE = ROOT / "vectors" / "mistakes.json"
Mistake: TypeAlias = dict[str, Any]
Answers: TypeAlias = dict[str, str]
"""Wrong answers by the id of the question, as JSON."""
JAVASCRIPT = ROOT / "vectors" / "examples" / "javascript"
TIMEOUT = 3.0
MOST = 12
"""After so many cases that fail a mistake is noticed enough, and after one without an answer in time."""
SLOW = ("mbusd",)
"""In real time, and of a kind of which no mistake is planted."""


def source(stack: str) -> Path:
    """Return the folder of a stack. Exits if its package is not installed."""
    if stack == "javascript":
        return JAVASCRIPT
    found = find_spec(stack)
    if found is None or found.origin is None:
        sys.exit(f"{stack} is not installed: pip install '.[dev]'")
    return Path(found.origin).parent


def problem(mistake: Mistake) -> str:
    """Return why a mistake cannot be planted: its stack has changed."""
    text = (source(mistake["stack"]) / mistake["file"]).read_text(encoding="utf-8")
    return "" if mistake["before"] in text else f"{mistake['file']} of {mistake['stack']} has no such text any more"


@contextmanager
def planted(stack: str, mistake: Mistake | None) -> Iterator[str]:
    """Yield the command of an adapter whose stack is a copy with this mistake; None: without one."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / stack
        shutil.copytree(source(stack), copy, ignore=shutil.ignore_patterns("__pycache__"))
        if mistake is not None:
            file = copy / mistake["file"]
            text = file.read_text(encoding="utf-8")
            file.write_text(text.replace(mistake["before"], mistake["after"], 1), encoding="utf-8")
        if stack == "javascript":
            yield shlex.join(["node", str(copy / "main.mjs")])
        else:
            path = os.pathsep.join([folder, *filter(None, [os.environ.get("PYTHONPATH")])])
            yield shlex.join(["env", f"PYTHONPATH={path}", sys.executable, str(ADAPTERS), stack])


def asked_all(adapter: Ask, vectors: Vectors, most: int) -> tuple[list[str], Answers]:
    """Return the cases that fail, in order, and the wrong answers by question; not more than `most` cases."""
    answers, failed, wrong, hung = dict[str, Answer](), list[str](), dict[str, str](), list[str]()

    def ask(question: Question) -> Answer:
        try:
            answers[question.id] = adapter(question)
        except AdapterFailure:
            hung.append(question.id)
            raise
        return answers[question.id]

    for checked in run_cases(vectors, ask):
        if checked.verdict.state == "failed":
            failed.append(checked.id)
            for question, verdict in checked.questions:
                if verdict.state == "failed" and "is" in answers.get(question.id, {}):
                    wrong[question.id] = json.dumps(answers[question.id]["is"], sort_keys=True)
            if len(failed) >= most or (hung and most == MOST):
                break
    return failed, wrong


def failures(stack: str, vectors: Vectors) -> set[str]:
    """Return the cases that fail without a mistake."""
    with planted(stack, None) as command, VectorAdapter(command, timeout=TIMEOUT) as adapter:
        return {*asked_all(adapter, vectors, sys.maxsize)[0]}


def others(vectors: Vectors) -> dict[str, Answers]:
    """Return the wrong answers of the programs of others that are here, by name."""
    found = {}
    for peer in PEERS:
        if peer.is_here() and not peer.oracle and peer.name not in SLOW:
            with suppress(PortError), VectorAdapter(peer.command(), timeout=TIMEOUT) as adapter:
                found[peer.name] = asked_all(adapter, vectors, sys.maxsize)[1]
    return found


def noticed(mistake: Mistake, vectors: Vectors, known: dict[str, set[str]]) -> tuple[str, Answers]:
    """Return the first case that fails with the mistake and passes without it, nothing if none does; and wrong answers.

    Raise ValueError if the stack does not start with it: then it is no mistake that somebody could make.
    """
    of_kinds = selected(vectors, kinds=mistake["kinds"])
    unknown = [
        file._replace(cases=tuple(case for case in file.cases if case["id"] not in known[mistake["stack"]]))
        for file in of_kinds.files
    ]
    of_kinds = of_kinds._replace(files=tuple(unknown))
    try:
        with planted(mistake["stack"], mistake) as command, VectorAdapter(command, timeout=TIMEOUT) as adapter:
            failed, wrong = asked_all(adapter, of_kinds, MOST)
    except PortError:
        raise ValueError(f"{mistake['stack']} does not start with the mistake: {mistake['what']}") from None
    return failed[0] if failed else "", wrong


def making(wrong: Answers, programs: dict[str, Answers]) -> list[str]:
    """Return the programs that give one of these wrong answers, each with the question."""
    found = []
    for name, answers in programs.items():
        same = next((question for question, answer in wrong.items() if answers.get(question) == answer), "")
        if same:
            found.append(f"{name} ({same.partition('.')[0]})")
    return found


def as_lines(catalogue: list[Mistake]) -> str:
    """Return the text of the catalogue: a line for each mistake."""
    return "[\n" + ",\n".join(json.dumps(mistake, ensure_ascii=False) for mistake in catalogue) + "\n]\n"


def main(words: list[str]) -> int:
    """Plant the mistakes, and write the cases that notice them."""
    catalogue: list[Mistake] = json.loads(CATALOGUE.read_text(encoding="utf-8"))
    chosen = [one for one in catalogue if not words or {*words} & {one["stack"], one["class"], *one["what"].split()}]
    if wrong := [f"{one['what']}: {text}" for one in chosen if (text := problem(one))]:
        sys.exit("\n".join(wrong))
    vectors = load_vectors(ROOT / "vectors")
    known = {stack: failures(stack, vectors) for stack in dict.fromkeys(one["stack"] for one in chosen)}
    programs = others(vectors)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = pool.map(partial(noticed, vectors=vectors, known=known), chosen)
        for mistake, (case, wrong_answers) in zip(chosen, found):
            mistake.pop("case", None)
            mistake["programs"] = making(wrong_answers, programs)
            if case:
                mistake["case"] = case
            elif "why" not in mistake:
                sys.stdout.write(f"nobody notices: {mistake['stack']}, {mistake['file']}: {mistake['what']}\n")
    CATALOGUE.write_text(as_lines(catalogue), encoding="utf-8")
    cases = [one for one in chosen if "case" in one]
    seen = [one for one in chosen if one["seen"] or one["programs"]]
    sys.stdout.write(
        f"{len(chosen)} mistakes, {len(cases)} noticed, {len(chosen) - len(cases)} not, {len(seen)} seen\n"
    )
    return 1 if any("case" not in one and "why" not in one for one in chosen) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
