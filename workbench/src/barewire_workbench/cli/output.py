"""What commands print and write: things as text or as JSON, notes, a line that counts, and files."""

from __future__ import annotations

import errno
import json
import math
import os
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import click

from barewire.errors import EncodeError, PortError


class Output:
    """Prints things in the form that was asked for: as text for people, or as one JSON object a line.

    >>> Output("text").show("5 mA", {"value": 5})
    5 mA
    >>> Output("json").show("5 mA", {"value": 5})
    {"value": 5}
    """

    def __init__(self, form: str) -> None:
        self.as_json = form == "json"

    def show(self, text: object, fields: Mapping[str, object] | Callable[[], Mapping[str, object]]) -> None:
        """Print one thing: its fields, or what a function returns for them, as JSON, otherwise its text."""
        if self.as_json:
            print_json(fields() if callable(fields) else fields)
        else:
            print(printable(text), flush=True)

    def text(self, *lines: object) -> None:
        """Print lines that only people read, such as a title or a total."""
        if not self.as_json:
            for line in lines:
                print(printable(line), flush=True)


def printable(text: object) -> str:
    r"""Return a text with "?" for each control character but the ends of lines: a terminal obeys those in the names of
    an EDS, in the strings of a device and in the answers of a program.

    >>> printable("Speed\x1b[2J")
    'Speed?[2J'
    """
    lines = str(text).split("\n")
    return "\n".join("".join(letter if letter.isprintable() else "?" for letter in line) for line in lines)


output_option = click.option(
    "--json",
    "output",
    is_flag=True,
    help="Print one JSON object a line.",
    callback=lambda context, parameter, as_json: Output("json" if as_json else "text"),
)
"""`--json` of a command that has no other forms: the command gets its `Output`."""


def output_form(form: str | None, *, as_json: bool) -> str:
    """Return the form of the output that `--format` and `--json` ask for. Raise EncodeError if they are at odds."""
    if as_json and form not in (None, "json"):
        raise EncodeError(f"--json and --format {form}: give one of them")
    return "json" if as_json else form or "text"


def print_json(fields: Any) -> None:
    """Print one object on one line, and flush it."""
    print(json.dumps(_for_json(fields), ensure_ascii=False, allow_nan=False), flush=True)


def _for_json(value: Any) -> Any:
    # JSON has no bytes, and no numbers for NaN and the infinities: they become text.
    if isinstance(value, bytes):
        return value.hex(" ").upper()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, dict):
        return {key: _for_json(item) for key, item in value.items()}
    return [_for_json(item) for item in value] if isinstance(value, (list, tuple)) else value


def note(text: str) -> None:
    """Print a line on stderr about something that is no error."""
    print(f"barewire: {printable(text)}", file=sys.stderr, flush=True)


def note_refused_pdos(file: str, reasons: Iterable[str]) -> None:
    """Print why PDOs of an EDS are switched off."""
    for reason in reasons:
        note(f"{file}: PDO switched off: {reason}")


@contextmanager
def status_line() -> Iterator[Callable[[str], None] | None]:
    """Yield a function that shows the present step in one line of the terminal; None if stderr is not one."""
    if not sys.stderr.isatty():
        yield None
        return

    def show(text: str) -> None:
        print(f"\r\x1b[K{text}"[:120], end="", file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        show("")


@contextmanager
def needs_extra(what: str, name: str, package: str) -> Iterator[None]:
    """Within the block, where a package of an extra is imported, raise PortError with the name of that extra."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != package:
            raise
        raise PortError(f"{what} needs the extra '{name}': pip install 'barewire[{name}]'") from None


# Files


@contextmanager
def port_error(path: str | Path) -> Iterator[None]:
    """Make PortError with the path of an OSError."""
    try:
        yield
    except OSError as error:
        raise PortError(f"{path}: {error.strerror or error}") from None


def check_no_device(path: str | Path) -> None:
    """Raise PortError for a path that does not exist, or is a device, which may have no end."""
    with port_error(path):
        mode = os.stat(path).st_mode
        if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            raise OSError(errno.EINVAL, "a device, not a file")


def opened_file(path: str | Path) -> BinaryIO:
    """Return a file to read. Raise PortError if it cannot be opened, or is a device."""
    check_no_device(path)
    with port_error(path):
        return Path(path).open("rb")


def file_content(path: str | Path) -> bytes:
    """Return the bytes of a file. Raise PortError if it cannot be read; as `opened_file`."""
    with opened_file(path) as file, port_error(path):
        return file.read()


def check_not_overwritten(option: str, target: str | Path, *sources: str) -> None:
    """Raise EncodeError if the file that an option names for writing is one of those that are read."""
    for source in sources:
        if os.path.isfile(target) and os.path.exists(source) and os.path.samefile(source, target):
            raise EncodeError(f"{option} {target}: {source} is the same file, which would be overwritten")


def replace_file(path: str | Path, data: bytes) -> None:
    """Write a file so that its name has the old content or the new one at any moment, never a part; `-` is stdout.

    The new content is in a file of its own beside it until it is on the disk. Raises PortError.
    """
    if str(path) == "-":
        sys.stdout.buffer.write(data)
        return
    target = Path(os.path.realpath(path))
    with port_error(path):
        if target.exists() and not target.is_file():  # a pipe or a device: there is nothing to replace
            target.write_bytes(data)
            return
        mode = stat.S_IMODE(target.stat().st_mode) if target.exists() else 0o666 & ~_umask()
        descriptor, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.chmod(name, mode)
            os.replace(name, target)
        except BaseException:
            os.unlink(name)
            raise
        if os.name == "posix":  # the new name is on the disk too
            directory = os.open(target.parent, os.O_RDONLY)
            try:
                os.fsync(directory)
            finally:
                os.close(directory)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
