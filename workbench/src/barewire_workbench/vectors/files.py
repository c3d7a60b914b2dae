"""The files of the vectors: in a folder of the user, in the source tree, or in the installed package.

    vectors/kinds.json              the operations of each kind
    vectors/index.json              the digest of each case: a damaged file is noticed
    vectors/profiles.json           named choices of cases
    vectors/VERSION                 the version of the vectors
    vectors/cases/rtu/crc16.json    a file: one subject, one kind, its cases

A wheel has them as one compressed file, vectors.zip, which setup.py makes.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from importlib.resources import files as package_files
from importlib.resources.abc import Traversable
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from barewire.errors import EncodeError, shown
from barewire_workbench.vectors.questions import Case, Operation, Question, operations, questions

FORMAT = "barewire-vectors/1"

_DAMAGED = (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, KeyError, TypeError)
"""What zipfile raises for an archive with a wrong byte: also that it is encrypted, or needs a newer version."""


class VectorFile(NamedTuple):
    """One file: its name as "rtu/crc16", its subject, its kind, and its cases."""

    name: str
    subject: str
    kind: str
    cases: tuple[Case, ...]


class Vectors(NamedTuple):
    """All files, the operations of their kinds, the digest of each case by its id, the version, and the profiles."""

    files: tuple[VectorFile, ...]
    kinds: dict[str, tuple[Operation, ...]]
    digests: dict[str, str]
    version: str = ""
    profiles: Mapping[str, Mapping[str, Any]] = MappingProxyType({})

    def damage(self, case: Case) -> str:
        """Return what is wrong with a case that is not as it was published; nothing if it is."""
        published, present = self.digests.get(case.get("id", "")), digest(case)
        if published == present:
            return ""
        return f"the case has been changed: its digest is {present}, index.json has {published or 'no such id'}"

    def questions(self, file: VectorFile, case: Case) -> tuple[Question, ...]:
        """Return the questions of one case."""
        return tuple(questions(file.kind, case, self.kinds[file.kind]))

    def find(self, case_id: str) -> tuple[VectorFile, Case]:
        """Return a case and its file. Raise EncodeError if there is no such id."""
        for file in self.files:
            for case in file.cases:
                if case["id"] == case_id:
                    return file, case
            if case_id in (file.name, f"{file.name}.json"):
                hint = f"`barewire vectors list --only {file.name}` shows the cases of this file"
                raise EncodeError(f"no case has the id {shown(case_id)}; {hint}")
        ids = [case["id"] for file in self.files for case in file.cases]
        stems = [stem for stem in (case_id, case_id.rstrip("0123456789").removesuffix("-")) if stem]
        near = next((stem for stem in stems if any(known.startswith(stem) for known in ids)), None)
        pattern = f' --only "{near}*"' if near else ""
        raise EncodeError(f"no case has the id {shown(case_id)}; `barewire vectors list{pattern}` shows what there is")

    def __repr__(self) -> str:
        return f"Vectors: {sum(len(file.cases) for file in self.files)} cases in {len(self.files)} files"


def digest(case: Case) -> str:
    """Return the digest of a case: the first 16 digits of the SHA-256 of its JSON, keys sorted, without blanks."""
    text = json.dumps(case, ensure_ascii=False, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def load_vectors(folder: str | Path | None = None) -> Vectors:
    """Return the vectors of a folder; None: those of this package. Raise EncodeError if they cannot be read."""
    if folder is not None:
        return _loaded(Path(folder))
    try:
        return _loaded(_here())
    except (*_DAMAGED, OSError) as error:
        text = f"{type(error).__name__}: {error}"
        raise EncodeError(f"the vectors in this package are damaged, install it again: {text}") from None


def _loaded(root: Traversable) -> Vectors:
    """Return the vectors below a folder."""
    try:
        kinds: dict[str, Any] = json.loads((root / "kinds.json").read_text(encoding="utf-8"))
        digests: dict[str, str] = json.loads((root / "index.json").read_text(encoding="utf-8"))
        profiles: dict[str, Any] = json.loads((root / "profiles.json").read_text(encoding="utf-8"))
        version = (root / "VERSION").read_text(encoding="utf-8").strip()
    except (OSError, ValueError) as error:
        raise EncodeError(
            f"folder {root}: no vectors there, kinds.json, index.json, profiles.json or VERSION cannot be read: {error}"
        ) from None
    rows = {kind: operations(kinds, kind) for kind in kinds}
    files = tuple(_read(root, rows))
    if missing := digests.keys() - {case.get("id") for file in files for case in file.cases}:
        raise EncodeError(f"folder {root}: {len(missing)} cases of index.json are in no file, such as {min(missing)}")
    return Vectors(files, rows, digests, version, profiles)


def _here() -> Traversable:
    """Return the folder of the vectors: packed in an installed package, or at the top of the source tree."""
    packed = package_files("barewire_workbench.vectors") / "vectors.zip"
    if packed.is_file():
        return opened(packed.read_bytes())
    return Path(__file__).parents[4] / "vectors"


def opened(archive: bytes) -> Traversable:
    """Return the folder in an archive of the vectors."""
    return zipfile.Path(zipfile.ZipFile(io.BytesIO(archive)))


def _read(root: Traversable, kinds: dict[str, tuple[Operation, ...]]) -> Iterator[VectorFile]:
    folder = root / "cases"
    if not folder.is_dir():
        raise EncodeError(f"folder {root}: no vectors there, it has no folder cases/")
    for room in sorted((entry for entry in folder.iterdir() if entry.is_dir()), key=lambda entry: entry.name):
        for entry in sorted(room.iterdir(), key=lambda entry: entry.name):
            if entry.name.endswith(".json"):
                name = f"{room.name}/{entry.name.removesuffix('.json')}"
                try:
                    document = json.loads(entry.read_text(encoding="utf-8"))
                except (OSError, ValueError, RecursionError) as error:
                    raise EncodeError(f"vectors {name}: not JSON: {error}") from None
                if not isinstance(document, dict) or document.get("format") != FORMAT:
                    raise EncodeError(f'vectors {name}: it is no file of vectors, they have "format": "{FORMAT}"')
                if lacking := {"subject", "kind", "cases"} - document.keys():
                    raise EncodeError(f"vectors {name}: it has no {', '.join(sorted(lacking))}")
                if document["kind"] not in kinds:
                    raise EncodeError(f"vectors {name}: kinds.json has no kind {shown(document['kind'])}")
                yield VectorFile(name, document["subject"], document["kind"], tuple(document["cases"]))
