"""One machine, one owner at a time: a simulator that is served on two ports in two threads is entered by one of them.

        rtu:// host, thread 1 --handle--> SharedUnit --.
                                                        >-- the machine's lock --> machine
        can:// host, thread 2 --feed----> SharedNode --'
        a test                --------->  with alone(machine): machine.fault(0x3210, now)

The rooms below have no threads and so no locks. `open_host` puts these doors in front of whatever it serves; two hosts
of one machine find the same lock, because it belongs to the machine: the `machine` of a unit or node that has one, and
otherwise the unit or node itself. Within an asyncio loop nothing is needed: nothing in a machine awaits.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from barewire.canopen import CanFrame
    from barewire.modbus import Response, Unit


class CanopenNode(Protocol):
    """A device on a CAN bus, as a machine."""

    @property
    def deadline(self) -> float | None: ...

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]: ...


_finding = threading.Lock()
_locks: dict[int, tuple[weakref.ref[Any], AbstractContextManager[Any]]] = {}
_anybody = threading.RLock()
"""For what cannot be watched going away, and so can have no lock of its own."""


def alone(thing: object) -> AbstractContextManager[Any]:
    """Nobody else enters the machine meanwhile: `with alone(machine): ...`. A thread may enter twice.

    >>> from barewire.modbus import Table
    >>> table = Table()
    >>> with alone(table), alone(table):
    ...     print("no other thread is in the table")
    no other thread is in the table
    """
    owner = getattr(thing, "machine", thing)
    # By identity: equal machines are still two, and some cannot be hashed.
    key = id(owner)
    with _finding:
        known = _locks.get(key)
        if known is None or known[0]() is not owner:
            try:
                known = weakref.ref(owner, lambda gone: _forget(key, gone)), threading.RLock()
            except TypeError:
                return _anybody
            _locks[key] = known
        return known[1]


def _forget(key: int, gone: weakref.ref[Any]) -> None:
    # No lock here: this may be called in the middle of anything, and what it does is one step of the interpreter.
    known = _locks.get(key)
    if known is not None and known[0] is gone:
        _locks.pop(key, None)


class SharedUnit:
    """A unit that answers one request at a time, whoever asks."""

    def __init__(self, unit: Unit) -> None:
        self._unit = unit
        self._lock = alone(unit)
        if (supports := getattr(unit, "supports", None)) is not None:
            self.supports = supports  # asked with every request

    def handle(self, request: Any, now: float) -> Response | None:
        """As the unit does."""
        with self._lock:
            return self._unit.handle(request, now)

    def __getattr__(self, name: str) -> Any:
        # What a unit may have besides: `supports`, `diagnostics`.
        return getattr(self._unit, name)


class SharedUnits(Mapping[int, "Unit"]):
    """Units by address, each behind its door. Which addresses there are may change: a drive that gets another one."""

    def __init__(self, units: Mapping[int, Unit]) -> None:
        self._units = units
        self._doors: dict[int, tuple[Unit, SharedUnit]] = {}

    def __getitem__(self, address: int) -> Unit:
        return self._door(address, self._units[address])

    def get(self, address: int, default: Any = None) -> Any:
        """The unit at this address, or the default."""
        unit = self._units.get(address)
        known = self._doors.get(address)
        if known is not None and known[0] is unit:
            return known[1]
        return default if unit is None else self._door(address, unit)

    def _door(self, address: int, unit: Unit) -> Unit:
        known = self._doors.get(address)
        if known is None or known[0] is not unit:
            known = self._doors[address] = unit, SharedUnit(unit)
        return known[1]

    def __contains__(self, address: object) -> bool:
        return address in self._units

    def __iter__(self) -> Iterator[int]:
        return iter(self._units)

    def __len__(self) -> int:
        return len(self._units)


class SharedNode:
    """A node that is fed by one thread at a time."""

    def __init__(self, node: CanopenNode) -> None:
        self._node = node
        self._lock = alone(node)

    @property
    def deadline(self) -> float | None:
        """As the node has it."""
        with self._lock:
            return self._node.deadline

    def start(self, now: float) -> list[CanFrame]:
        """Switch it on, where it has to be switched on; others begin by themselves."""
        with self._lock:
            start = getattr(self._node, "start", None)
            return [] if start is None else list(start(now))

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """As the node does."""
        with self._lock:
            return self._node.feed(frame, now)

    def do(self, action: Callable[[float], Iterable[CanFrame] | None], now: float) -> list[CanFrame]:
        """`action(now)`, the frames that it returns, and what the node has to say then."""
        with self._lock:
            return [*(action(now) or ()), *self._node.feed(None, now)]

    def bus_off(self, now: float) -> None:
        """The CAN controller left the bus, if the node cares."""
        with self._lock:
            bus_off = getattr(self._node, "bus_off", None)
            if bus_off is not None:
                bus_off(now)

    def recovered(self, now: float) -> list[CanFrame]:
        """It is back."""
        with self._lock:
            recovered = getattr(self._node, "recovered", None)
            return [] if recovered is None else list(recovered(now))
