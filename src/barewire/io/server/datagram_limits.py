"""Which datagrams a server on UDP refuses: its own answers that come back, and what is too much from one host.

The answer to functions 05, 06 and 16h equals its request. The sender of a datagram is easily forged: with the address
of the server itself, or of another server, one request would go round for ever.

    server A    <--  06 0001 002A  -->    server B        each takes the answer of the other for a request

A client may repeat a request, with the same transaction number too, and nothing in it tells the two apart. But one
datagram that is lost ends the round, and costs a client one time-out. So the same datagram from the same sender,
answered with itself, is answered `COPIES` times and then refused once, if it comes at least every second.

Times are passed in.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

COPIES = 1000
"""How often the same datagram of a sender is answered with itself, before one is refused."""
_PAUSE = 1.0
"""Seconds after which a copy counts as the first one: what is as slow does no harm."""
RATE = 20_000
"""Datagrams of one host in a second: more than a client sends that waits for each answer."""
_SENDERS = 1024
"""Hosts and datagrams that are remembered. All other hosts share one limit; the oldest datagram is forgotten."""


class DatagramLimits:
    """What is remembered of the senders. `is_own(address)` tells whether that is the address of the server."""

    def __init__(self, is_own: Callable[[Any], bool]) -> None:
        self._is_own = is_own
        self._received: dict[str, int] = {}  # by host, until `_until`
        self._until = 0.0
        self._copies: dict[tuple[bytes, Any], tuple[int, float]] = {}  # how many were answered, and when the latest

    def is_too_much(self, host: str, now: float) -> bool:
        """Count a datagram of this host. Return whether it has sent more than `RATE` within a second."""
        if now >= self._until:
            self._received.clear()
            self._until = now + 1.0
        if host not in self._received and len(self._received) >= _SENDERS:
            host = ""
        count = self._received[host] = self._received.get(host, 0) + 1
        return count > RATE

    def is_own_answer(self, data: bytes, sender: Any, now: float) -> bool:
        """Return whether this is taken for an answer of the server itself, and not for a request."""
        if self._is_own(sender):
            return True
        count, latest = self._copies.get((data, sender), (0, now))
        if count < COPIES and now < latest + _PAUSE:
            return False
        self._copies.pop((data, sender), None)
        return count >= COPIES and now < latest + _PAUSE

    def answered_with_itself(self, data: bytes, sender: Any, now: float) -> None:
        """Record that the answer to this datagram equals it."""
        count, _ = self._copies.pop((data, sender), (0, now))
        if len(self._copies) >= _SENDERS:
            del self._copies[next(iter(self._copies))]
        self._copies[data, sender] = count + 1, now
