"""The bounds in the source of the Modbus and SDO clients, and whether the runs of the model cross each of them.

    min(timeout, rest)              each argument is the smallest one in some run
    len(alike) >= _PROBES_KEPT      true in some run, false in another: comparisons with a constant or with the time
    deque(maxlen=_KEPT)             full in some run, with room in another

`sites` finds them in a file. As a program (`python -m tests.model.bounds`) this module has the files compiled with a
note at each of them, plays `RUNS`, and prints which outcomes each had, as JSON.
"""

from __future__ import annotations

import ast
import builtins
import json
import random
import re
import sys
from collections import Counter, defaultdict, deque
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import Any

SOURCE = Path(__file__).parent.parent.parent / "src" / "barewire"
ROOMS = ("modbus/client", "rtu", "ascii", "tcp", "io/modbus")
SDO_CLIENT = tuple(f"canopen/sdo/{name}.py" for name in ("channel", "transfer", "client", "plain"))
_CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")


def files() -> dict[str, Path]:
    """Return the files that have bounds of the client, by their module."""
    paths = [path for room in ROOMS for path in sorted((SOURCE / room).glob("*.py"))]
    paths += [SOURCE / name for name in SDO_CLIENT]
    return {".".join(path.relative_to(SOURCE.parent).with_suffix("").parts): path for path in paths}


class Noting(ast.NodeTransformer):
    """Adds a call to each bound. `outcomes` has the name of each bound, and the outcomes that it can have."""

    def __init__(self, path: Path) -> None:
        self.outcomes: dict[str, list[str]] = {}
        self._place = path.relative_to(SOURCE).as_posix()
        self._seen: Counter[str] = Counter()

    def _note(self, node: ast.expr, outcomes: list[str], function: str, arguments: list[ast.expr]) -> ast.Call:
        text = ast.unparse(node)
        self._seen[text] += 1
        name = f"{self._place}: {text}" + (f" (number {self._seen[text]})" if self._seen[text] > 1 else "")
        self.outcomes[name] = outcomes
        call = ast.Call(ast.Name(function, ast.Load()), [ast.Constant(name), *arguments], [])
        return ast.fix_missing_locations(ast.copy_location(call, node))

    def visit_Call(self, node: ast.Call) -> ast.expr:
        """Note which argument of `min` and `max` is the result, and whether a `deque` is full."""
        function = node.func.id if isinstance(node.func, ast.Name) else ""
        original = ast.parse(ast.unparse(node), mode="eval").body
        self.generic_visit(node)
        if function in ("min", "max"):
            plain = len(node.args) > 1 and not any(isinstance(argument, ast.Starred) for argument in node.args)
            outcomes = [ast.unparse(argument) for argument in node.args] if plain else ["called"]
            noted = self._note(original, outcomes, "__note_smallest__", [node.func, *node.args])
            noted.keywords = node.keywords
            return noted
        limits = [keyword.value for keyword in node.keywords if keyword.arg == "maxlen"]
        if function == "deque" and limits:
            return self._note(original, ["full", "room"], "__note_deque__", limits)
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        """Note the result of a comparison with a constant, of a length with a number, and with the time."""
        original = ast.parse(ast.unparse(node), mode="eval").body
        self.generic_visit(node)
        names = [child.id for child in ast.walk(original) if isinstance(child, ast.Name)]
        names += [child.attr for child in ast.walk(original) if isinstance(child, ast.Attribute)]  # heard.now
        numbers = [child.value for child in ast.walk(original) if isinstance(child, ast.Constant)]
        is_order = any(isinstance(kind, ast.Lt | ast.LtE | ast.Gt | ast.GtE) for kind in node.ops)
        has_constant = any(_CONSTANT.fullmatch(name) for name in names)
        has_length = "len" in names and any(isinstance(number, int) and number > 1 for number in numbers)
        if not is_order or not (has_constant or has_length or "now" in names):
            return node
        return self._note(original, ["False", "True"], "__note__", [node])


def sites() -> dict[str, list[str]]:
    """Return all bounds, each with the outcomes that it can have."""
    found: dict[str, list[str]] = {}
    for path in files().values():
        noting = Noting(path)
        noting.visit(ast.parse(path.read_text(encoding="utf-8")))
        found |= noting.outcomes
    return found


_crossed: defaultdict[str, set[str]] = defaultdict(set)
_of: dict[str, list[str]] = {}


def _note(name: str, result: object) -> object:
    _crossed[name].add(str(bool(result)))
    return result


def _note_smallest(name: str, function: Any, *arguments: Any, **keywords: Any) -> Any:
    result = function(*arguments, **keywords)
    _crossed[name].add(_of[name][arguments.index(result) if len(_of[name]) > 1 else 0])
    return result


def _note_deque(name: str, limit: int) -> deque[Any]:
    class Noted(deque[Any]):
        def append(self, item: Any) -> None:
            _crossed[name].add("full" if len(self) == limit else "room")
            super().append(item)

    return Noted(maxlen=limit)


class _Loader(SourceFileLoader):
    def get_code(self, fullname: str) -> CodeType:
        """Compile the file with its notes, without a cache."""
        path = Path(self.path)
        noting = Noting(path)
        tree = noting.visit(ast.parse(path.read_text(encoding="utf-8")))
        _of.update(noting.outcomes)
        return compile(tree, self.path, "exec")


class _Finder(MetaPathFinder):
    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        """Return a spec whose loader adds the notes."""
        spec = PathFinder.find_spec(fullname, path) if fullname in files() else None
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(fullname, spec.origin)
        return spec


def main() -> None:
    """Play the runs on files with notes, and print the outcomes of each bound."""
    for name, function in {"note": _note, "note_smallest": _note_smallest, "note_deque": _note_deque}.items():
        setattr(builtins, f"__{name}__", function)
    sys.meta_path.insert(0, _Finder())
    from tests.model.choices import Choices, run_random
    from tests.model.client_setups import CARRIERS, OTHER_CARRIERS, default_options, every_option
    from tests.model.clients import clients_scenario
    from tests.model.one_line import Tally
    from tests.model.sdo import DEFAULT_OPTIONS, SdoTally, sdo_scenario
    from tests.model.sdo_two import TwoClients, TwoTally, two_clients_scenario

    dice = random.Random(1)
    for carrier in CARRIERS | OTHER_CARRIERS:
        for setup in (default_options(carrier), every_option(carrier)):
            tally = Tally()
            play = clients_scenario(setup, tally)
            for _ in range(int(sys.argv[1])):
                play(Choices(dice=dice))
    run_random(sdo_scenario(DEFAULT_OPTIONS, SdoTally()), 5 * int(sys.argv[1]))
    run_random(two_clients_scenario(TwoClients(transfers=4), TwoTally()), 5 * int(sys.argv[1]))
    sys.stdout.write(json.dumps({name: sorted(outcomes) for name, outcomes in _crossed.items()}))


if __name__ == "__main__":
    main()
