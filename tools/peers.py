"""The programs of others that answer the vectors: what each is, how it is built, and which cases it confirms.

    PEERS       a Peer for each folder of vectors/peers with a peer.toml
    build       makes a program as its recipe says, from the pinned version of its sources or package
    run         every case, asked of one program
    confirms    whether a program confirms a case

A peer.toml has `name`, `language`, `what`, and one recipe:

    requirement     a package of Python with its version; `module` is what its adapter imports, `python` the oldest one
    repository      a git repository with `commit`, `version`, the commands of `build` and their `product`
    package         a package of the distribution
    (neither)       for a main.js: a package of npm, whose version is in vectors/peers/package-lock.json

In the commands of `build`, {source} is the folder of the sources (only `paths` of them, if given), {here} the folder of
the peer, {product} the file to make. What is built is in vectors/peers/NAME/build.

`again` is for a program in real time: so many times its cases that failed are asked again, and one that passes then has
passed. A busy machine is late now and then; a wrong answer comes each time.

A row of `restates` names cases whose answer the adapter makes itself, wholly or in part: the program does not confirm
them. `having` is a regular expression that the case has, as JSON.

python -m tools.peers build                     all that is not built yet
python -m tools.peers build Lely --from DIR     the sources from a git repository here
python -m tools.peers list                      which are here
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache, cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from barewire.errors import PortError
from barewire_workbench.live.vector_adapter import VectorAdapter
from barewire_workbench.vectors.files import Vectors
from barewire_workbench.vectors.questions import Question
from barewire_workbench.vectors.run import CheckedCase, run_cases, selected

ROOT = Path(__file__).parent.parent
ADAPTERS = ROOT / "vectors" / "peers"
"""Run with a name: `python vectors/peers pymodbus`."""
JUDGE, REFERENCE = ADAPTERS.parent / "judge" / "py", ADAPTERS.parent / "reference" / "modbus"
SHARED = ADAPTERS / "shared", JUDGE / "fill.py", JUDGE / "patterns.py", REFERENCE / "client_peer.py"
"""What the adapters import."""
PYTHONS = ("python3.12", "python3.13", "python3.14")
"""Tried for a package that needs a later Python than this one."""
TIMEOUT = 20.0


class Peer:
    """A program that answers: its recipe, and the command of its adapter."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.recipe: dict[str, Any] = tomllib.loads((folder / "peer.toml").read_text(encoding="utf-8"))
        self.name, self.language, self.what = (str(self.recipe[key]) for key in ("name", "language", "what"))
        self.oracle = bool(self.recipe.get("oracle"))
        """Whether it confirms values only, and is no stack: it has no row in the scoreboard."""

    @property
    def product(self) -> Path | None:
        """The file that the recipe makes; None if there is none to make."""
        if "requirement" in self.recipe:
            return self.folder / "build" / "bin" / "python"
        return self.folder / "build" / self.recipe["product"] if "product" in self.recipe else None

    def is_built(self) -> bool:
        """Whether the product is there, made by the recipe as it is now."""
        stamp = self.folder / "build" / "recipe"
        return self.product is not None and stamp.exists() and stamp.read_text(encoding="utf-8") == self._stamp

    @cached_property
    def _stamp(self) -> str:
        made_of = [file for file in sorted(self.folder.iterdir()) if file.suffix in (".c", ".h")]
        recipe = {key: value for key, value in self.recipe.items() if key not in ("restates", "again")}
        return _digest([json.dumps(recipe).encode(), *(file.read_bytes() for file in made_of)])

    @cached_property
    def digest(self) -> str:
        """The digest of what asks this program: its recipe, its adapter, and what adapters share."""
        files = [file for folder in (self.folder, SHARED[0]) for file in sorted(folder.glob("*.*")) if file.is_file()]
        files = [file for file in files if file.name != "findings.toml"]
        return _digest([file.read_bytes() for file in (*files, *SHARED[1:])])

    def is_here(self) -> bool:
        """Whether it can be asked, as far as can be told without starting it."""
        return self.is_built() or ("commit" not in self.recipe and self._python() is not None)

    def _python(self) -> str | None:
        if "requirement" in self.recipe and self.is_built():
            return str(self.product)
        module = self.recipe.get("module", "json")
        return sys.executable if _has_module(module) else None

    def command(self) -> str:
        """Return the command of the adapter. Raise PortError if the program is not here."""
        if not self.is_here():
            raise PortError(f"{self.name}: not here, `python -m tools.peers build {self.name}` makes it")
        if (script := self.folder / "main.js").exists():
            return shlex.join(["node", str(script)])
        return shlex.join([self._python() or sys.executable, str(ADAPTERS), self.folder.name])

    def restates(self, kind: str, case: Mapping[str, Any]) -> bool:
        """Return whether the adapter makes the answer to a case of this kind itself."""
        rows = [row for row in self.recipe.get("restates", ()) if row["kind"] == kind]
        return any(re.search(row["having"], json.dumps(case, ensure_ascii=False)) for row in rows)


def _digest(parts: list[bytes]) -> str:
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


@cache
def _has_module(module: str) -> bool:
    with suppress(ModuleNotFoundError):  # the package that the module is in is not here either
        return find_spec(module) is not None
    return False


def _peers() -> tuple[Peer, ...]:
    """Return the peers in the order of oracles.json, those that are not in it last."""
    order = [*json.loads((ADAPTERS.parent / "oracles.json").read_text(encoding="utf-8"))]
    found = [Peer(file.parent) for file in sorted(ADAPTERS.glob("*/peer.toml"))]
    return tuple(sorted(found, key=lambda peer: order.index(peer.name) if peer.name in order else len(order)))


PEERS = _peers()


# Building ----------------------------------------------------------------------------------------------------------


def build(peer: Peer, repository: str | None = None) -> None:
    """Make a program as its recipe says; `repository` has the sources in the place of that of the recipe."""
    product = peer.product
    if product is None:
        return
    shutil.rmtree(peer.folder / "build", ignore_errors=True)
    product.parent.mkdir(parents=True)
    if "requirement" in peer.recipe:
        _call([_python_for(peer), "-m", "venv", "--clear", str(peer.folder / "build")])
        _call([str(product), "-m", "pip", "install", "-q", "--disable-pip-version-check", peer.recipe["requirement"]])
    else:
        with tempfile.TemporaryDirectory() as scratch:
            source = Path(scratch, "source")
            _fetch(peer.recipe, repository, source)
            names = {"source": source, "here": peer.folder, "product": product}
            for line in peer.recipe["build"]:
                _call(["sh", "-c", line.format(**{name: shlex.quote(str(path)) for name, path in names.items()})])
    (peer.folder / "build" / "recipe").write_text(peer._stamp, encoding="utf-8")


def _python_for(peer: Peer) -> str:
    oldest = tuple(map(int, peer.recipe.get("python", "3.11").split(".")))
    if sys.version_info >= oldest:
        return sys.executable
    found = next((path for path in map(shutil.which, PYTHONS) if path), None)
    if found is None:
        raise PortError(
            f"{peer.name}: it needs Python {peer.recipe['python']}, and none of {', '.join(PYTHONS)} is here"
        )
    return found


def _fetch(recipe: Mapping[str, Any], repository: str | None, source: Path) -> None:
    """Put the sources of the pinned commit into a folder."""
    with tempfile.TemporaryDirectory() as scratch:
        if repository is None:
            repository = str(Path(scratch, "repository"))
            _call(["git", "clone", "-q", "--bare", recipe["repository"], repository])
        archive = Path(scratch, "sources.tar")
        paths = [recipe["paths"]] if "paths" in recipe else []
        _call(["git", "-C", repository, "archive", "-o", str(archive), recipe["commit"], *paths])
        source.mkdir()
        _call(["tar", "-xf", str(archive), "-C", str(source)])


def _call(words: list[str]) -> None:
    """Run a program. Raise PortError with its last words if it fails."""
    done = subprocess.run(words, capture_output=True, text=True, errors="replace")
    if done.returncode:
        last = "\n".join((done.stderr or done.stdout).splitlines()[-8:])
        raise PortError(f"{shlex.join(words)}: exit status {done.returncode}\n{last}")


# Asking ------------------------------------------------------------------------------------------------------------


class PeerRun(NamedTuple):
    """What one program made of all cases."""

    peer: Peer
    version: str
    cases: tuple[CheckedCase, ...]

    def states(self) -> Iterator[tuple[str, str, str]]:
        """Yield kind, id and state of each case that it offers."""
        for checked in self.cases:
            if checked.verdict.state != "not offered":
                yield checked.file.kind, checked.id, checked.verdict.state


def run(peer: Peer, vectors: Vectors) -> PeerRun:
    """Ask a program every case. Raise PortError if it does not start."""
    with VectorAdapter(peer.command(), timeout=TIMEOUT) as adapter:
        cases = {checked.id: checked for checked in run_cases(vectors, adapter)}
        for _ in range(peer.recipe.get("again", 0)):
            failed = [checked.id for checked in cases.values() if checked.verdict.state == "failed"]
            if failed:
                asked_again = run_cases(selected(vectors, only=failed), adapter)
                cases |= {checked.id: checked for checked in asked_again if checked.verdict.state == "passed"}
        return PeerRun(peer, adapter.version, tuple(cases.values()))


def confirms(peer: Peer, checked: CheckedCase) -> bool:
    """Return whether the answers confirm a case: none is wrong, one could be, the adapter made none itself."""
    if checked.verdict.state != "passed" or peer.restates(checked.file.kind, checked.case):
        return False
    return any(verdict.state == "passed" and bites(question) for question, verdict in checked.questions)


def bites(question: Question) -> bool:
    """Return whether the judge expects something: an acceptable case may be encoded in any way."""
    case: Any = question.case
    return case["result"] != "acceptable" or question.do != "encode" or "tolerant" in case.get("flags", ())


def main() -> int:
    """Build or list. Return the exit status: 1 if something could not be built."""
    parser = argparse.ArgumentParser(prog="python -m tools.peers", description="Programs that answer the vectors.")
    parser.add_argument("do", choices=("build", "list"))
    parser.add_argument("names", nargs="*", metavar="NAME", help="without names: all")
    parser.add_argument("--from", dest="repository", metavar="DIR", help="a git repository with the sources")
    options = parser.parse_args()
    by_name = {peer.name: peer for peer in PEERS}
    if unknown := [name for name in options.names if name not in by_name]:
        parser.error(f"{', '.join(unknown)}: expected some of {', '.join(by_name)}")
    failed = False
    for peer in [by_name[name] for name in options.names] or PEERS:
        try:
            if options.do == "build" and peer.product is not None and (options.names or not peer.is_built()):
                build(peer, options.repository)
            text = "built" if peer.is_built() else "here" if peer.is_here() else "not here"
        except PortError as error:
            failed, text = True, str(error)
        sys.stdout.write(f"{peer.name:16} {text}\n")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
