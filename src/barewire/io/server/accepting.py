"""Accepting connections, the same way in a thread and in asyncio: several at a time, and without free descriptors too.

asyncio's own way logs a traceback for each attempt without a descriptor, and accepts nobody for a second after it.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from typing import Any

from barewire.io.ports.tcp import readiness, reason, set_socket_options
from barewire.io.server.base import POLL_INTERVAL
from barewire.io.server.connection_limits import ConnectionTable

BATCH = 16
"""Connections that are accepted before the next requests are answered."""
_RESERVE = 32
"""Descriptors kept for the rest of the program, and for a batch that is accepted before others are closed."""
_FULL = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
"""Errors of a system that has no room for another connection."""


class Acceptor:
    """Accepts the clients of one listener. Its constructor lowers the limit of `connections` if the process has fewer
    descriptors left: without one the system accepts no client for whom another connection could be closed."""

    def __init__(self, listener: socket.socket, connections: ConnectionTable[Any]) -> None:
        listener.setblocking(False)
        self._listener = listener
        self._connections = connections
        self._is_ready = readiness(listener)
        left = _free_descriptors(listener)
        if left is not None:
            connections.lower_limit(left - min(_RESERVE, left // 4), f"{left} file descriptors are left")

    def accept(self, *accepted: tuple[socket.socket, Any]) -> list[tuple[socket.socket, Any]]:
        """Accept the clients that wait, `BATCH` with those `accepted` already. Raises OSError if it is none."""
        batch = list(accepted)
        try:
            while len(batch) < BATCH:
                batch.append(self._listener.accept())
        except OSError:
            if not batch:
                raise
        for connection, _ in batch:
            connection.setblocking(False)
            with contextlib.suppress(OSError):  # the client has left already
                set_socket_options(connection)
        return batch

    def failed(self, error: OSError) -> float:
        """Make room if `accept` found none. Return the seconds to wait before it is tried again."""
        if isinstance(error, (BlockingIOError, InterruptedError, ConnectionError)):
            return 0.0
        why = f"there was no room for another connection: {reason(error)}"
        if error.errno not in _FULL:
            self._connections.log.warning("accept", f"a connection was not accepted: {reason(error)}")
        elif not self._is_ready(0):
            pass  # Linux needs a descriptor to find out that no client waits
        elif self._connections.open:
            self._connections.close_longest_silent(why)
            return 0.0
        else:
            self._connections.log.warning("full", why)
        return POLL_INTERVAL


def _free_descriptors(listener: socket.socket) -> int | None:
    """Return how many files the process may still open; None where there is no such limit, as on Windows."""
    try:
        import resource
    except ImportError:
        return None
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return None
    try:
        used = len(os.listdir("/dev/fd"))
    except OSError:
        used = listener.fileno() + 1  # the system gives the lowest free number
    return max(0, soft - used)
