"""The head of a file: what it is, the licence, the command that made it, and a digest of the rest.

    # barewire vendor modbus-rtu-client --with coils
    # version 0.1.0, sha256 5f0c...

The digest is that of the whole file without its own digits, so it shows whether the file was edited.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from typing import NamedTuple

from barewire.errors import EncodeError

LICENCE = """\
MIT License

Copyright (c) 2026 the barewire authors

Permission is hereby granted, free of charge, to any person obtaining a copy of this software and associated
documentation files (the "Software"), to deal in the Software without restriction, including without limitation the
rights to use, copy, modify, merge, publish, distribute, sublicense, and/or sell copies of the Software, and to permit
persons to whom the Software is furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all copies or substantial portions of the
Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE
WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR
COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR
OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
"""

_COMMAND = re.compile(r"^# barewire vendor (\S+)((?: --with \S+)*)$", re.MULTILINE)
_STATE = re.compile(r"^# version (\S+), sha256 ([0-9a-f]{64})$", re.MULTILINE)
_NO_DIGEST = "0" * 64


class Head(NamedTuple):
    """What the head of a file says: its name and options, the version that made it, and whether it was edited since."""

    name: str
    families: tuple[str, ...]
    version: str
    is_edited: bool


def command(name: str, families: Sequence[str]) -> str:
    """Return the command that makes a file."""
    return " ".join(["barewire vendor", name, *(f"--with {family}" for family in families)])


def comment(name: str, families: Sequence[str], version: str) -> str:
    """Return the comment of the head, its digest not filled in."""
    lines = [*LICENCE.splitlines(), "", command(name, families), f"version {version}, sha256 {_NO_DIGEST}"]
    return "".join(f"# {line}".rstrip() + "\n" for line in lines)


def sealed(text: str) -> str:
    """Return the text of a file with its digest."""
    return text.replace(_NO_DIGEST, _digest(text), 1)


def read_head(text: str) -> Head:
    """Return the head of a file. Raise EncodeError if it has none."""
    made, state = _COMMAND.search(text), _STATE.search(text)
    if made is None or state is None:
        raise EncodeError("no file of `barewire vendor`: its head names no command, or no version and digest")
    name, options = made.groups()
    version, digest = state.groups()
    is_edited = _digest(text.replace(digest, _NO_DIGEST, 1)) != digest
    return Head(name, tuple(options.split()[1::2]), version, is_edited)


def _digest(text: str) -> str:
    return hashlib.sha256(text.replace("\r\n", "\n").encode()).hexdigest()
