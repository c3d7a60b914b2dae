"""Profiles: named choices of cases, such as `modbus-core`, and the badge that says what a stack has passed of one.

vectors/profiles.json has the rules. A case belongs to a profile if all of these hold that the profile has:

    kinds           its kind is one of these
    files           its file fits one of these names, in which * stands for any characters
    without_kinds   its kind is none of these
    without         it has none of these flags
    without_lines   the line of its server is none of these
    first           it is one of the first so many of its file that fit the other rules
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from fnmatch import fnmatchcase
from html import escape
from typing import Any

from barewire.errors import EncodeError, shown, suggest
from barewire_workbench.vectors.files import VectorFile, Vectors

_GOOD, _PARTLY, _BAD = "#3c9a1e", "#b5860b", "#c03a2b"


def in_profile(vectors: Vectors, name: str) -> Vectors:
    """Return the cases of a profile. Raise EncodeError if there is no such profile."""
    rules = vectors.profiles.get(name)
    if rules is None:
        hint = suggest(name, vectors.profiles)
        raise EncodeError(f"profile {shown(name)}: expected one of {', '.join(vectors.profiles)}{hint}")
    chosen = (file._replace(cases=_chosen(file, rules)) for file in vectors.files if _has_file(file, rules))
    return vectors._replace(files=tuple(file for file in chosen if file.cases))


def _has_file(file: VectorFile, rules: Mapping[str, Any]) -> bool:
    if file.kind in rules.get("without_kinds", ()) or file.kind not in rules.get("kinds", [file.kind]):
        return False
    return any(fnmatchcase(file.name, pattern) for pattern in rules.get("files", "*"))


def _chosen(file: VectorFile, rules: Mapping[str, Any]) -> tuple[Any, ...]:
    flags, lines = {*rules.get("without", ())}, {*rules.get("without_lines", ())}
    cases = (case for case in file.cases if not flags & {*case.get("flags", ())})
    return tuple(case for case in cases if case.get("server", {}).get("line") not in lines)[: rules.get("first")]


# The badge --------------------------------------------------------------------------------------------------------


def badge_texts(vectors: Vectors, profile: str, total: Mapping[str, int]) -> tuple[str, str, str]:
    """Return what a badge says: its label, how many cases have not failed, and its colour."""
    count, good = sum(total.values()), total.get("passed", 0) + total.get("open", 0)
    colour = _BAD if total.get("failed") or not good else _PARTLY if good < count else _GOOD
    return f"{profile or 'vectors'} {vectors.version}", f"{good} of {count}", colour


def badge_json(label: str, message: str, colour: str) -> str:
    """Return a badge in the form that shields.io reads from a URL."""
    return json.dumps({"schemaVersion": 1, "label": label, "message": message, "color": colour.lstrip("#")}) + "\n"


def badge_svg(label: str, message: str, colour: str) -> str:
    """Return a badge as a picture."""
    widths = [7 * len(text) + 12 for text in (label, message)]
    whole = sum(widths)
    text = 'y="14" fill="#fff" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11" text-anchor="middle"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{whole}" height="20" role="img">'
        f"<title>{escape(label)}: {escape(message)}</title>"
        f'<rect width="{whole}" height="20" rx="3" fill="#555"/>'
        f'<path d="M{widths[0]} 0h{widths[1] - 3}a3 3 0 0 1 3 3v14a3 3 0 0 1 -3 3h-{widths[1] - 3}z" fill="{colour}"/>'
        f'<text x="{widths[0] / 2:g}" {text}>{escape(label)}</text>'
        f'<text x="{widths[0] + widths[1] / 2:g}" {text}>{escape(message)}</text></svg>\n'
    )
