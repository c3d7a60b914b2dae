"""A door that loads what is behind it when somebody asks for it: the `__getattr__` of a room's `__init__.py`.

    __getattr__ = lazy(__name__, {"adu": "Adu Noise", "message": "Message Request Response", ...})

Whoever asks for a name loads the one file that holds it, and what that file needs: an envelope which wants `Adu` does
not pay for all the messages. A door says its names three times, each for another reader: in imports for type checkers,
in `__all__` for `import *`, by file for me. `tests/test_doors.py` holds the three against each other.

I know: modules and names.  I never know: what is in them.  The doors of rooms import me, nobody else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any


def lazy(room: str, files: Mapping[str, str]) -> Callable[[str], Any]:
    """What answers for `room` when a name is asked of it that is not loaded yet.

    `files`: for each file the names that it holds and the door offers, with spaces between them.

    >>> find = lazy("barewire.modbus", {"adu": "Adu Noise", "table": "Table"})
    >>> find("Adu").__module__
    'barewire.modbus.adu'

    Raises AttributeError, as a module does, for a name that no file holds.
    """
    file_of = {name: file for file, names in files.items() for name in names.split()}

    def find(name: str) -> Any:
        if name in file_of:
            return getattr(__import__(f"{room}.{file_of[name]}", fromlist=[name]), name)
        raise AttributeError(f"module {room!r} has no attribute {name!r}")

    return find
