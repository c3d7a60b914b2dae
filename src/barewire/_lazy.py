"""Lazy package doors: an `__init__.py` offers names and loads the file of a name when that name is first used.

    if TYPE_CHECKING:
        from barewire.modbus.adu import Adu as Adu, Noise as Noise           # for type checkers

    __getattr__, __dir__, __all__ = lazy(__name__, {"adu": "Adu Noise", ...})         # for programs, in reading order

So `from barewire.modbus import Adu` loads `barewire.modbus.adu` and what that file needs, and no message class. A door
lists its names twice because type checkers read only import statements; `tests/test_doors.py` compares the two lists.

Depends on: nothing. Used by: the `__init__.py` of rooms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from sys import modules
from typing import Any


def lazy(room: str, files: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """The `__getattr__`, the `__dir__` and the `__all__` of the package `room`.

    `files` maps each file, relative to the room, to the names it offers, separated by spaces.

    >>> find, _, names = lazy("barewire.modbus", {"adu": "Adu Noise", "server.table": "Table"})
    >>> find("Adu").__module__, names
    ('barewire.modbus.adu', ['Adu', 'Noise', 'Table'])

    `__getattr__` raises AttributeError, as a module does, for a name that is not in the list. `__dir__` has the
    names that are not loaded yet too, so that a console completes them.
    """
    file_of = {name: file for file, names in files.items() for name in names.split()}

    def find(name: str) -> Any:
        if name in file_of:
            found = getattr(import_module(f"{room}.{file_of[name]}"), name)
            vars(modules[room])[name] = found  # from now on the package has it, and this is not called again
            return found
        raise AttributeError(f"module {room!r} has no attribute {name!r}")

    def known() -> list[str]:
        return sorted({*vars(modules[room]), *file_of})

    return find, known, list(file_of)
