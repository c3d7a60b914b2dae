"""Ends connections in a child process that has inherited them by `fork`.

        parent    client ---- socket ----.
                                          >---- one connection: an answer goes to whichever process reads first
        child     client ---- socket ----'

Two processes on one connection would get each other's answers. So the child's copy of an open client raises PortError,
and the parent's stays as it is: nothing is sent, and no connection is shut down. `multiprocessing` forks by default on
Linux up to Python 3.13.
"""

from __future__ import annotations

import os
from typing import Protocol
from weakref import WeakSet

OPENED_BEFORE_FORK = "opened before fork: open one in this process"
"""The end of the error in the child."""


class _Inheritable(Protocol):
    def end_in_child(self) -> None:
        """Make this copy raise PortError. Called in a child process, whose only thread is the caller's."""


_open: WeakSet[_Inheritable] | None = None


def end_after_fork(connection: _Inheritable) -> None:
    """Call `end_in_child` of this connection in each process that is forked from this one, while the object lives."""
    global _open
    if _open is None:
        _open = WeakSet()
        if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
            os.register_at_fork(after_in_child=_end_all)
    _open.add(connection)


def _end_all() -> None:
    for connection in tuple(_open or ()):
        connection.end_in_child()
