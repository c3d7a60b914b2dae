"""Formats vectors/: run `python tools/vectors.py` after every change of a case.

    ids     a case without an id gets the next free number of its file: <file>-<n>. An id is never reused
    form    few lines for a case: result, comment, source, then the fields; no line longer than 120 characters
    tables  those of the pages in vectors/, each between its two markers: see `tables`
    index   the digest of each case, in vectors/index.json

The tests call the same functions, and fail if a file is not as this tool would write it.
"""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

from barewire_workbench.vectors.files import digest, load_vectors
from barewire_workbench.vectors.profiles import in_profile

VECTORS = Path(__file__).parent.parent / "vectors"
CASES = VECTORS / "cases"
WIDTH = 120
BY = ("standard", "manual", "convention", "barewire")
RESULTS = ("valid", "invalid", "acceptable")

# The first keys of a case, in rows. The other keys follow in the order of the file.
ROWS = (
    ("id", "result", "reason", "fails", "flags"),
    ("comment",),
    ("source",),
    ("clause", "origin", "by"),
    ("confirmed_by", "unconfirmed"),
)


def files() -> list[Path]:
    """Return every vector file, in the order of the table."""
    rooms = ("codecs", "modbus", "rtu", "ascii", "tcp", "client", "canopen", "devices")
    return [file for room in rooms for file in sorted((CASES / room).glob("*.json"))]


def number(document: dict[str, Any], stem: str) -> None:
    """Give each case without an id the next number, above all numbers of the file."""
    last = max([int(case["id"].rpartition("-")[2]) for case in document["cases"] if "id" in case], default=0)
    for case in document["cases"]:
        if "id" not in case:
            last += 1
            case["id"] = f"{stem}-{last}"


def _flat(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _pack(items: list[str], indent: str) -> list[str]:
    """Return the items joined to lines of at most WIDTH characters."""
    lines: list[str] = []
    line = indent
    for item in items:
        if line != indent and len(line) + 1 + len(item) > WIDTH:
            lines.append(line)
            line = indent
        line += ("" if line == indent else " ") + item
    return [*lines, line] if line != indent else lines


def _value(value: Any, indent: str, used: int) -> str:
    """Return the text of a value: on one line if it fits or is a scalar, otherwise one element on each line."""
    flat = _flat(value)
    if used + len(flat) + 1 <= WIDTH or not isinstance(value, (list, dict)) or not value:
        return flat
    inner = indent + "  "
    if isinstance(value, dict):
        body = ",\n".join(inner + _entry(name, one, inner) for name, one in value.items())
        return f"{{\n{body}\n{indent}}}"
    if all(isinstance(item, str) for item in value):
        body = "\n".join(_pack([_flat(item) + "," for item in value], inner)).removesuffix(",")
    else:
        body = ",\n".join(inner + _value(item, inner, len(inner)) for item in value)
    return f"[\n{body}\n{indent}]"


def _entry(key: str, value: Any, indent: str) -> str:
    return f"{_flat(key)}: {_value(value, indent, len(indent) + len(key) + 4)}"


def _case(case: dict[str, Any]) -> str:
    indent = " " * 6
    rest = tuple(key for key in case if not any(key in row for row in ROWS))
    lines: list[str] = []
    for row in (*ROWS, rest):
        entries = [_entry(key, case[key], indent) + "," for key in row if key in case]
        while entries:
            tall = next((place for place, entry in enumerate(entries) if "\n" in entry), len(entries))
            lines += _pack(entries[:tall], indent) + [indent + entry for entry in entries[tall : tall + 1]]
            entries = entries[tall + 1 :]
    return "    {\n" + "\n".join(lines).removesuffix(",") + "\n    }"


def form(document: dict[str, Any]) -> str:
    """Return the text of a vector file."""
    head = [f"  {_entry(key, value, '  ')}," for key, value in document.items() if key != "cases"]
    cases = ",\n".join(_case(case) for case in document["cases"])
    return "{\n" + "\n".join(head) + '\n  "cases": [\n' + cases + "\n  ]\n}\n"


def counts() -> str:
    """Return the table: each file with its subject, its kind, and the number of cases with each result."""
    rows = ["| file | subject | kind | valid | invalid | acceptable |", "|---|---|---|--:|--:|--:|"]
    total: Counter[str] = Counter()
    for file in files():
        document = json.loads(file.read_text(encoding="utf-8"))
        results = Counter(case["result"] for case in document["cases"])
        total += results
        name = file.relative_to(CASES).as_posix()
        numbers = " | ".join(str(results[result] or "") for result in RESULTS)
        rows.append(f"| [{name}](cases/{name}) | {document['subject']} | `{document['kind']}` | {numbers} |")
    numbers = " | ".join(str(total[result]) for result in RESULTS)
    rows.append(f"| **{len(files())} files** | **{sum(total.values())} cases** | | {numbers} |")
    return "\n".join(rows)


def confirmations() -> str:
    """Return the table: by kind, how many cases other implementations confirm, and which ones."""
    cases: dict[str, list[dict[str, Any]]] = {}
    for file in files():
        document = json.loads(file.read_text(encoding="utf-8"))
        cases.setdefault(document["kind"], []).extend(document["cases"])
    rows = ["| kind | cases | confirmed | | by |", "|---|--:|--:|--:|---|"]
    for kind, of_kind in [*cases.items(), ("", [case for row in cases.values() for case in row])]:
        done = sum("confirmed_by" in case for case in of_kind)
        by = Counter(name for case in of_kind for name in case.get("confirmed_by", ())) if kind else {}
        names = ", ".join(f"{name} {count}" for name, count in by.items())
        shown = f"`{kind}`" if kind else "**all**"
        rows.append(f"| {shown} | {len(of_kind)} | {done} | {100 * done // len(of_kind)} % | {names} |")
    return "\n".join(rows)


def confirmers() -> str:
    """Return the table: by kind, how many cases no program, one, two or more confirm."""
    found: dict[str, Counter[int]] = {}
    for file in files():
        document = json.loads(file.read_text(encoding="utf-8"))
        numbers = Counter(min(len(case.get("confirmed_by", ())), 3) for case in document["cases"])
        found[document["kind"]] = found.get(document["kind"], Counter()) + numbers
    rows = ["| kind | 0 | 1 | 2 | more |", "|---|--:|--:|--:|--:|"]
    for name, row in [
        *((f"`{kind}`", row) for kind, row in found.items()),
        ("**all**", sum(found.values(), Counter[int]())),
    ]:
        rows.append(f"| {name} | {' | '.join(str(row[number] or '') for number in range(4))} |")
    return "\n".join(rows)


def authorities() -> str:
    """Return the table: how many cases each authority decides."""
    documents = [json.loads(file.read_text(encoding="utf-8")) for file in files()]
    found = Counter(
        (case.get("by", document["by"]), case["result"]) for document in documents for case in document["cases"]
    )
    rows = [f"| by | {' | '.join(RESULTS)} |", "|---|--:|--:|--:|"]
    for by in BY:
        rows.append(f"| `{by}` | {' | '.join(str(found[by, result] or '') for result in RESULTS)} |")
    return "\n".join(rows)


def mutants() -> str:
    """Return the table: by kind, how many changes of its reference a case notices, from mutants.json."""
    numbers: dict[str, Any] = json.loads((VECTORS / "mutants.json").read_text(encoding="utf-8"))
    total: dict[str, list[int]] = {}
    for counts in [one["kinds"] for one in numbers.values()]:
        for kind, row in counts.items():
            total[kind] = [old + new for old, new in zip(total.get(kind, [0, 0, 0]), row)]
    kinds = [kind for kind in json.loads((VECTORS / "kinds.json").read_text(encoding="utf-8")) if kind in total]
    whole = [sum(one["all"][place] for one in numbers.values()) for place in range(3)]
    rows = ["| kind | changes | noticed | | a policy | open |", "|---|--:|--:|--:|--:|--:|"]
    for name, (noticed, explained, left) in [*((f"`{kind}`", total[kind]) for kind in kinds), ("**all**", whole)]:
        made = noticed + explained + left
        rows.append(f"| {name} | {made} | {noticed} | {100 * noticed // made} % | {explained or ''} | {left or ''} |")
    return "\n".join(rows)


def mistakes() -> str:
    """Return the table: how many mistakes of mistakes.json were met in a thread, in a program asked, and nowhere."""
    catalogue: list[dict[str, Any]] = json.loads((VECTORS / "mistakes.json").read_text(encoding="utf-8"))
    rows = ["| class | mistakes | in a thread | in a program asked | not met |", "|---|--:|--:|--:|--:|"]
    for name, count in [*Counter(row["class"] for row in catalogue).most_common(), ("**all**", len(catalogue))]:
        of_class = [row for row in catalogue if name in (row["class"], "**all**")]
        met = [sum(bool(row[where]) for row in of_class) for where in ("seen", "programs")]
        unmet = sum(not row["seen"] and not row["programs"] for row in of_class)
        rows.append(f"| {name} | {count} | {' | '.join(str(number or '') for number in (*met, unmet))} |")
    return "\n".join(rows)


def profiles() -> str:
    """Return the table: the profiles, and how many cases each has."""
    vectors = load_vectors(VECTORS)
    rows = ["| profile | cases | what it is about |", "|---|--:|---|"]
    for name, rules in vectors.profiles.items():
        count = sum(len(file.cases) for file in in_profile(vectors, name).files)
        rows.append(f"| `{name}` | {count} | {rules['about']} |")
    return "\n".join(rows)


@cache
def _counted() -> list[tuple[str, str, int]]:
    """The name of each file, its kind, and the number of its cases."""
    documents = [(file, json.loads(file.read_text(encoding="utf-8"))) for file in files()]
    return [(file.relative_to(CASES).as_posix(), read["kind"], len(read["cases"])) for file, read in documents]


def asked(kind: str) -> str:
    """Return for a page of a kind: what each operation is given and gives, and the files with such cases."""
    operations = json.loads((VECTORS / "kinds.json").read_text(encoding="utf-8"))[kind]
    rows = ["| do | given | gives |", "|---|---|---|"]
    for do, operation in operations.items():
        given, gives = (", ".join(f"`{name}`" for name in operation[side]) for side in ("given", "gives"))
        rows.append(f"| `{do}` | {given} | {gives} |")
    listed = [f"[{name}](../cases/{name}) ({count})" for name, of_kind, count in _counted() if of_kind == kind]
    return "\n".join([*rows, "", *_pack([f"{text}," for text in listed], "")]).removesuffix(",")


def tables() -> dict[str, dict[str, Callable[[], str]]]:
    """Return the tables by the page that has them, and the name between its markers."""
    kinds = json.loads((VECTORS / "kinds.json").read_text(encoding="utf-8"))
    return {
        "README.md": {"profiles": profiles},
        "CASES.md": {"counts": counts},
        "AUTHORITY.md": {"authorities": authorities, "confirmers": confirmers, "confirmations": confirmations},
        "reference/README.md": {"mutants": mutants, "mistakes": mistakes},
        **{f"kinds/{kind}.md": {"questions": partial(asked, kind)} for kind in kinds},
    }


def with_tables(page: str, made: Mapping[str, Callable[[], str]]) -> str:
    """Return a page with its tables up to date: each between `<!-- NAME: ... -->` and `<!-- end of NAME -->`."""
    for name, table in made.items():
        before, begin, rest = re.split(f"(<!-- {name}: [^>]*-->)", page)
        end = f"<!-- end of {name} -->"
        page = f"{before}{begin}\n\n{table()}\n\n{end}{rest.partition(end)[2]}"
    return page


def index() -> str:
    """Return the text of index.json: id -> digest."""
    documents = [json.loads(file.read_text(encoding="utf-8")) for file in files()]
    digests = {case["id"]: digest(case) for document in documents for case in document["cases"]}
    return json.dumps(digests, indent=0) + "\n"


def main() -> None:
    """Format all files; print the names of the changed ones."""
    for file in files():
        before = file.read_text(encoding="utf-8")
        document = json.loads(before)
        number(document, file.stem)
        if (after := form(document)) != before:
            file.write_text(after, encoding="utf-8")
            sys.stdout.write(f"{file.relative_to(VECTORS)}\n")
    (VECTORS / "index.json").write_text(index(), encoding="utf-8")
    write_pages()


def write_pages() -> None:
    """Bring the tables of the pages up to date; print the names of the changed ones."""
    for name, made in tables().items():
        page = VECTORS / name
        before = page.read_text(encoding="utf-8")
        if (after := with_tables(before, made)) != before:
            page.write_text(after, encoding="utf-8")
            sys.stdout.write(f"{name}\n")


if __name__ == "__main__":
    main()
