"""Lazy packages: an `__init__.py` exports names, and loads the file of a name when that name is first used.

    if TYPE_CHECKING:
        from barewire.modbus.adu import Adu as Adu, Noise as Noise           # for type checkers

    __getattr__, __dir__, __all__ = lazy(__name__, {"adu": "Adu Noise", ...})         # for programs, in reading order

So `from barewire.modbus import Adu` loads `barewire.modbus.adu` and its imports, but no message class. The names are
listed twice because type checkers read only import statements; `tests/test_doors.py` compares the two lists.
"""

from __future__ import annotations

from importlib import import_module
from sys import modules

TYPE_CHECKING = False  # for type checkers True; `typing` takes longer to load than the rest
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any


def lazy(room: str, files: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` for the package `room`.

    `files` maps each file, relative to the package, to the names it exports, separated by spaces.

    >>> find, _, names = lazy("barewire.modbus", {"adu": "Adu Noise", "server.table": "Table"})
    >>> find("Adu").__module__, names
    ('barewire.modbus.adu', ['Adu', 'Noise', 'Table'])

    `__getattr__` raises AttributeError for a name that is not in the list, as a module does. `__dir__` includes the
    names that are not loaded yet, so that a console completes them, and leaves out what the package itself imports.
    """
    file_of = {name: file for file, names in files.items() for name in names.split()}

    def find(name: str) -> Any:
        if name in file_of:
            value = getattr(import_module(f"{room}.{file_of[name]}"), name)
            vars(modules[room])[name] = value  # the package has the name now, so this runs once
            return value
        raise AttributeError(f"module {room!r} has no attribute {name!r}")

    def known() -> list[str]:
        return sorted({*vars(modules[room]), *file_of} - {"lazy", "TYPE_CHECKING"})

    return find, known, list(file_of)
