"""Builds a release of the vectors in dist/:  make vectors-release

    barewire-vectors-1.1.0.zip     vectors/ without adapters, LICENSE, changes.json, questions.jsonl, and SHA256SUMS
    barewire-vectors-1.1.0.tgz     the same files as a package of npm, with index.js

vectors/VERSION is the version of the next release. vectors/released.json has what was released: by the version that
added them the ids, with what each case demands (tools/vectors_verdicts.py), first of it a digest of its meaning. A case
that was released keeps its meaning. If it was wrong, it is corrected, and vectors/CHANGELOG.md says so in the section
of the next version:

    - corrected `lrc-2`: the LRC was that of other bytes

`python -m tools.vectors_release --record` writes released.json after a release. The same vectors make the same bytes.
`--verdicts PROFILE`, or `all`, prints which verdicts can change since the last release, and builds nothing.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import json
import re
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from barewire_workbench.vectors.files import load_vectors
from barewire_workbench.vectors.profiles import in_profile
from barewire_workbench.vectors.questions import DESCRIPTION
from tools.vectors_verdicts import Demand, by_profile, demands, effects

ROOT = Path(__file__).parent.parent
VECTORS = ROOT / "vectors"
NAME = "barewire-vectors"
LEFT_OUT = {"peers", "examples", "npm", "node_modules", "__pycache__", "build", "action.yml"}
"""Folders below vectors/ that are not released: adapters, files that only npm needs, what programs put there."""
OUTSIDE = re.compile(r"\[([^]]+)\]\((?:\.\./)*(?:peers|examples|docs)\b[^)]*\)")
"""A link of a page to what is not released."""
DESCRIBES = {*DESCRIPTION, "id", "flags"}
"""Fields that describe a case without a change of its meaning."""
DECIDING_FLAGS = {"tolerant", "uncountable"}
"""Flags that decide what is asked, or how an answer is judged."""

Content: TypeAlias = dict[str, bytes]
Releases: TypeAlias = dict[str, dict[str, str]]


# What was released ------------------------------------------------------------------------------------------------


def meaning(kind: str, case: Mapping[str, Any]) -> str:
    """Return a digest of what a case demands: 16 digits of the SHA-256 of its kind and its fields."""
    fields = {name: value for name, value in case.items() if name not in DESCRIBES}
    fields["flags"] = sorted(DECIDING_FLAGS & {*case.get("flags", ())})
    text = json.dumps([kind, fields], ensure_ascii=False, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def meanings() -> dict[str, str]:
    """Return the digests of all cases by id, in the order of the files."""
    documents = [json.loads(file.read_bytes()) for file in sorted(VECTORS.glob("cases/*/*.json"))]
    return {case["id"]: meaning(document["kind"], case) for document in documents for case in document["cases"]}


def version() -> str:
    """Return the version of the next release."""
    return (VECTORS / "VERSION").read_text(encoding="utf-8").strip()


def released() -> Releases:
    """Return the ids and digests of released cases, by the version that added them; the last version comes last."""
    rows = _released()
    return {one: {case_id: demand.meaning for case_id, demand in row.items()} for one, row in rows.items()}


def last_demands() -> tuple[str, dict[str, Demand]]:
    """Return the version of the last release, and what its cases demanded."""
    rows = _released()
    return [*rows][-1], {case_id: demand for row in rows.values() for case_id, demand in row.items()}


def _released() -> dict[str, dict[str, Demand]]:
    found: Releases = json.loads((VECTORS / "released.json").read_text(encoding="utf-8"))
    return {one: {case_id: Demand.parse(text) for case_id, text in row.items()} for one, row in found.items()}


def sections(changelog: str) -> dict[str, str]:
    """Return the sections of the changelog by version, the newest first."""
    parts = re.split(r"^## (\S+).*\n", changelog, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2]))


def corrections(section: str) -> dict[str, str]:
    """Return the corrected cases of a section, with the reasons."""
    return dict(re.findall(r"^- corrected `([^`]+)`: (.+(?:\n  .+)*)", section, flags=re.MULTILINE))


def problems(now: Mapping[str, str], before: Releases, changelog: str, new: str) -> list[str]:
    """Return what forbids a release of the version `new`, as sentences."""
    parts, last = sections(changelog), [*before][-1]
    known = {case_id: digest for row in before.values() for case_id, digest in row.items()}
    fixed = corrections(parts.get(new, "")) if new != last else {}
    wrong = [f"VERSION is {new}, but CHANGELOG.md has no section ## {new}"] * (new not in parts)
    for case_id, digest in known.items():
        if case_id not in now:
            wrong.append(f"{case_id} was released and is not there any more: a wrong case is corrected, not removed")
        elif now[case_id] != digest and case_id not in fixed:
            wrong.append(
                f"{case_id} was released with another meaning: if it was wrong, write into vectors/CHANGELOG.md, "
                f"below ## {new}:  - corrected `{case_id}`: why.  Otherwise make a new case"
            )
    wrong += [
        f"{case_id} is listed as corrected, but its meaning is that of version {last}"
        for case_id in fixed
        if case_id not in known or now.get(case_id) == known[case_id]
    ]
    if _number(new) <= _number(last) and now != known:
        wrong.append(f"VERSION is {new}, but {last} is released, and cases have been added or corrected since")
    return wrong


def _number(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split("."))


def changes(now: Mapping[str, str], before: Releases, changelog: str, new: str) -> dict[str, Any]:
    """Return the changelog by case id: for each version, the newest first, added ids and corrected ones."""
    known = {case_id for row in before.values() for case_id in row}
    added = {**before, new: [case_id for case_id in now if case_id not in known]} if new not in before else before
    parts = sections(changelog)
    return {
        one: {"added": [*ids], "corrected": corrections(parts.get(one, ""))} for one, ids in reversed(added.items())
    }


def with_verdicts(rows: dict[str, Any]) -> dict[str, Any]:
    """Return the changelog by case id, with the verdicts that can change in the version that is released next."""
    last, before = last_demands()
    new = next(iter(rows))
    if new != last:
        vectors = load_vectors(VECTORS)
        found = effects(before, demands(vectors, meanings()))
        rows[new]["verdicts"] = {"since": last, **found, "profiles": by_profile(vectors, found)}
    return rows


def recorded(now: Mapping[str, Demand], before: Releases, new: str) -> str:
    """Return the text of released.json after the release of the version `new`."""
    known = {case_id for row in before.values() for case_id in row}
    rows = {one: {case_id: str(now[case_id]) for case_id in row} for one, row in before.items()}
    added = {case_id: str(demand) for case_id, demand in now.items() if case_id not in known}
    rows.setdefault(new, {}).update(added)
    return json.dumps(rows, indent=0) + "\n"


def questions() -> Iterator[bytes]:
    """Yield the lines of questions.jsonl: each question of each case, and what a judge needs for its answer."""
    vectors = load_vectors(VECTORS)
    for file in vectors.files:
        for case in file.cases:
            judged = {name: case[name] for name in ("result", "fails", "reason", "flags") if name in case}
            for question in vectors.questions(file, case):
                row = {"case": case["id"], **judged, "question": question.as_json(), "expected": question.expected}
                yield json.dumps(row, ensure_ascii=False).encode() + b"\n"


# The archives -----------------------------------------------------------------------------------------------------


def content() -> Content:
    """Return the released files by name, without checksums."""
    found = {"LICENSE": (ROOT / "LICENSE").read_bytes()}
    for file in sorted(VECTORS.rglob("*")):
        parts = file.relative_to(VECTORS).parts
        if file.is_file() and not LEFT_OUT & {*parts} and not parts[-1].startswith("."):
            found["/".join(parts)] = file.read_bytes()
    for name in [name for name in found if name.endswith(".md")]:
        found[name] = OUTSIDE.sub(r"\1", found[name].decode()).encode()
    changelog = found["CHANGELOG.md"].decode()
    found["questions.jsonl"] = b"".join(questions())
    found["changes.json"] = _json(with_verdicts(changes(meanings(), released(), changelog, version())))
    return dict(sorted(found.items()))


def archive(files: Content) -> bytes:
    """Return the archive for everybody: a zip file with one folder."""
    sums = "".join(f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in files.items())
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as target:
        for name, data in {**files, "SHA256SUMS": sums.encode()}.items():
            row = zipfile.ZipInfo(f"{NAME}-{version()}/{name}", (1980, 1, 1, 0, 0, 0))
            row.compress_type, row.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            target.writestr(row, data)
    return made.getvalue()


def package(files: Content) -> Content:
    """Return the files of the npm package."""
    ours = {file.name: file.read_bytes() for file in sorted((VECTORS / "npm").iterdir())}
    described = {
        "name": NAME,
        "version": version(),
        "description": "Test cases for Modbus and CANopen as JSON: frames, messages, transfers, behaviour",
        "keywords": ["modbus", "canopen", "test-vectors", "conformance", "fieldbus"],
        "license": "MIT",
        "main": "index.js",
        "types": "index.d.ts",
        "bin": {NAME: "check.js"},
        "engines": {"node": ">=18.3"},
    }
    return dict(sorted({**files, **ours, "package.json": _json(described)}.items()))


def npm(files: Content) -> bytes:
    """Return the npm package: what `npm pack` would make of these files, with fixed times."""
    made = io.BytesIO()
    with (
        gzip.GzipFile("", "wb", 9, made, mtime=0) as squeezed,
        tarfile.open(fileobj=squeezed, mode="w", format=tarfile.USTAR_FORMAT) as target,
    ):
        for name, data in package(files).items():
            row = tarfile.TarInfo(f"package/{name}")
            mode = 0o755 if name == "check.js" else 0o644
            row.size, row.mode, row.mtime = len(data), mode, 499162500  # the time that npm writes, too
            target.addfile(row, io.BytesIO(data))
    return made.getvalue()


def _json(value: Any) -> bytes:
    return json.dumps(value, indent=2, ensure_ascii=False).encode() + b"\n"


def verdicts(profile: str) -> str:
    """Return the cases of a profile by their effect on a stack that passed the last release, as lines."""
    vectors, (last, before) = load_vectors(VECTORS), last_demands()
    found = effects(before, demands(vectors, meanings()))
    chosen = vectors if profile == "all" else in_profile(vectors, profile)
    ids = {case["id"] for file in chosen.files for case in file.cases}
    lines = [f"since {last}"]
    for name, cases in found.items():
        listed = [case_id for case_id in cases if case_id in ids]
        lines.append(f"{len(listed):>5}  {name}  {'' if name.startswith('new') else ' '.join(listed)}".rstrip())
    return "\n".join(lines) + "\n"


def is_tagged(tag: str) -> bool:
    """Return whether the repository has a tag; False where there is no repository, or no git."""
    try:
        done = subprocess.run(["git", "tag", "--list", tag], cwd=ROOT, capture_output=True, check=False)
    except OSError:
        return False
    return bool(done.stdout.strip())


def main() -> int:
    """Check what is to be released, then build it, or record it. Return the exit status."""
    parser = argparse.ArgumentParser(description="Build a release of the vectors.")
    parser.add_argument("--record", action="store_true", help="write vectors/released.json: this version is released")
    parser.add_argument("--verdicts", metavar="PROFILE", help="print which verdicts can change; all: of all cases")
    parser.add_argument("--to", type=Path, default=ROOT / "dist", help="the folder of the archives (dist)")
    options = parser.parse_args()
    now, before, new = meanings(), released(), version()
    if options.verdicts:
        sys.stdout.write(verdicts(options.verdicts))
        return 0
    changelog = (VECTORS / "CHANGELOG.md").read_text(encoding="utf-8")
    wrong = problems(now, before, changelog, new)
    if not options.record and new not in before and is_tagged(tag := f"vectors-v{new}"):
        wrong.append(f"the tag {tag} exists, and released.json does not have it: --record, then the next VERSION")
    if wrong:
        sys.stderr.write("\n".join(wrong) + "\n")
        return 1
    if options.record:
        (VECTORS / "released.json").write_text(
            recorded(demands(load_vectors(VECTORS), now), before, new), encoding="utf-8"
        )
        sys.stdout.write(f"vectors/released.json: version {new} with {len(now)} cases is released\n")
        return 0
    options.to.mkdir(parents=True, exist_ok=True)
    files = content()
    for name, data in {f"{NAME}-{new}.zip": archive(files), f"{NAME}-{new}.tgz": npm(files)}.items():
        (options.to / name).write_bytes(data)
        sys.stdout.write(f"{options.to / name}  {len(data)} bytes\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
