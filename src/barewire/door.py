"""A door that loads what is behind it when somebody asks for it: the `__getattr__` of a room's `__init__.py`.

    __getattr__ = lazy(__name__, __all__, ("adu", "message", ...))

The files are looked through in the order given, the light ones first, so that an envelope which needs `modbus.adu` only
does not pay for all the messages.

I know: modules and names.  I never know: what is in them.  The doors of rooms import me, nobody else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

TYPE_CHECKING = False  # see `barewire.record`
if TYPE_CHECKING:
    from typing import Any


def lazy(room: str, names: Iterable[str], files: Iterable[str]) -> Callable[[str], Any]:
    """What answers for `room` when a name is asked of it that is not loaded yet.

    >>> find = lazy("barewire.modbus", ["Adu"], ["adu"])
    >>> find("Adu").__module__
    'barewire.modbus.adu'

    Raises AttributeError, as a module does, for a name that is not one of `names`.
    """
    known, searched = frozenset(names), tuple(files)

    def find(name: str) -> Any:
        if name in known:
            from importlib import import_module  # when something is asked for, and not before

            for file in searched:
                found = vars(import_module(f"{room}.{file}"))
                if name in found:
                    return found[name]
        raise AttributeError(f"module {room!r} has no attribute {name!r}")

    return find
