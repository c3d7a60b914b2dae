"""Plants mistakes in two stacks, one at a time: does a case fail for each? `make vectors-mistakes`.

    python -m tools.vectors_mistakes [WORD ...]     WORD: only mistakes of this stack or class, or with it in their text

vectors/mistakes.json is the catalogue: what is wrong, its class, the kinds whose cases have to notice it, who makes it
(`seen`), and the change that makes it in a file of a stack:

    javascript    vectors/examples/javascript, the second implementation
    canopen       the package of pip, by its adapter

The tool writes the first `case` that fails for it and passes without it. A mistake that no case notices needs a `why`;
the tool ends with status 1 if there is none. Mutation (tools/vectors_mutants.py) cannot find a check that the
reference does not have; this catalogue is written by hand, of what implementers forget.
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
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

from barewire.errors import PortError
from barewire_workbench.live.vector_adapter import VectorAdapter
from barewire_workbench.vectors.files import Vectors, load_vectors
from barewire_workbench.vectors.run import run_cases, selected
from tools.peers import ADAPTERS, ROOT

CATALOGUE = ROOT / "vectors" / "mistakes.json"
Mistake: TypeAlias = dict[str, Any]
JAVASCRIPT = ROOT / "vectors" / "examples" / "javascript"
TIMEOUT = 3.0


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


def failures(stack: str, vectors: Vectors) -> set[str]:
    """Return the cases that fail without a mistake."""
    with planted(stack, None) as command, VectorAdapter(command, timeout=TIMEOUT) as adapter:
        return {checked.id for checked in run_cases(vectors, adapter) if checked.verdict.state == "failed"}


def noticed(mistake: Mistake, vectors: Vectors, known: dict[str, set[str]]) -> str:
    """Return the first case that fails with the mistake and passes without it; nothing if there is none.

    Raise ValueError if the stack does not start with it: then it is no mistake that somebody could make.
    """
    of_kinds = selected(vectors, kinds=mistake["kinds"])
    try:
        with planted(mistake["stack"], mistake) as command, VectorAdapter(command, timeout=TIMEOUT) as adapter:
            for checked in run_cases(of_kinds, adapter):
                if checked.verdict.state == "failed" and checked.id not in known[mistake["stack"]]:
                    return checked.id
    except PortError:
        raise ValueError(f"{mistake['stack']} does not start with the mistake: {mistake['what']}") from None
    return ""


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
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = pool.map(partial(noticed, vectors=vectors, known=known), chosen)
        for mistake, case in zip(chosen, found):
            mistake.pop("case", None)
            if case:
                mistake["case"] = case
            elif "why" not in mistake:
                sys.stdout.write(f"nobody notices: {mistake['stack']}, {mistake['file']}: {mistake['what']}\n")
    CATALOGUE.write_text(as_lines(catalogue), encoding="utf-8")
    cases = [one for one in chosen if "case" in one]
    sys.stdout.write(f"{len(chosen)} mistakes, {len(cases)} noticed, {len(chosen) - len(cases)} not\n")
    return 1 if any("case" not in one and "why" not in one for one in chosen) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
