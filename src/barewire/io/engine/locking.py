"""Locks for machines that are served on several ports: one thread at a time enters a machine.

        server of rtu://, thread 1 --handle--> SharedUnit --.
                                                             >-- the machine's lock --> machine
        server of can://, thread 2 --feed----> SharedNode --'
        the caller's thread        ---------->  with exclusive(machine): machine.fault(0x3210, now)

The rooms below have no threads and so no locks: servers wrap what they serve. All servers of a machine use the same
lock, because it is an attribute of the machine: of the `machine` of a unit or node, or of the unit or node itself if it
has none. Servers within one asyncio loop need no lock, because nothing in a machine awaits.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from barewire.canopen import CanFrame
    from barewire.modbus import AnyUnit, Caller, Delayed, PduUnit, Response, Unit


class CanopenNode(Protocol):
    """A node on a CAN bus: it is fed with frames and time, and returns frames."""

    @property
    def deadline(self) -> float | None:
        """When it has to be fed None, if no frame arrives before."""

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]: ...


_LOCK = "_barewire_lock"


class _MachineLock(type(threading.RLock())):  # type: ignore[misc]  # the class has no public name
    """The lock of one machine. A copy of the machine, and a pickled one, has a new lock."""

    def __reduce__(self) -> tuple[type[_MachineLock], tuple[()]]:
        return _MachineLock, ()


_shared_lock = threading.RLock()
"""For objects that cannot have attributes, and so no lock of their own."""


def exclusive(thing: object) -> AbstractContextManager[Any]:
    """Return the lock of a machine, or of the machine of a unit or node: `with exclusive(machine): ...`.

    The thread that holds the lock may acquire it again.

    >>> from barewire.modbus import Table
    >>> table = Table()
    >>> with exclusive(table), exclusive(table):
    ...     print("no other thread is in the table")
    no other thread is in the table
    """
    owner = getattr(thing, "machine", thing)
    attributes = getattr(owner, "__dict__", None)
    if not isinstance(attributes, dict):
        return _shared_lock
    lock: AbstractContextManager[Any] | None = attributes.get(_LOCK)
    # `setdefault` is one step of the interpreter, so two threads at the same time get the same lock.
    return attributes.setdefault(_LOCK, _MachineLock()) if lock is None else lock


class SharedUnit:
    """A unit that handles one request at a time, from any thread."""

    def __init__(self, unit: Unit) -> None:
        self._unit = unit
        self._lock = exclusive(unit)
        if (supports := getattr(unit, "supports", None)) is not None:
            self.supports = supports  # called with every request, so it is not looked up each time

    def handle(self, request: Any, now: float) -> Response | Delayed | None:
        """Return the response of the unit."""
        with self._lock:
            return self._unit.handle(request, now)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._unit, name)  # optional members of a unit, such as `diagnostics`


class SharedPduUnit:
    """The same for a unit that gets each request as its bytes."""

    def __init__(self, unit: PduUnit) -> None:
        self._unit = unit
        self._lock = exclusive(unit)

    def handle_pdu(self, pdu: bytes, caller: Caller) -> Any:
        """Return the response of the unit."""
        with self._lock:
            return self._unit.handle_pdu(pdu, caller)


class SharedUnits(Mapping[int, "AnyUnit"]):
    """Units by address, each as a `SharedUnit`. The mapping inside may change, as when a drive gets another address."""

    def __init__(self, units: Mapping[int, AnyUnit]) -> None:
        self._units = units
        self._shared: dict[int, tuple[AnyUnit, SharedUnit | SharedPduUnit]] = {}

    def __getitem__(self, address: int) -> AnyUnit:
        return self._wrapped(address, self._units[address])

    def get(self, address: int, default: Any = None) -> Any:
        """Return the unit at this address, or the default."""
        unit = self._units.get(address)
        return default if unit is None else self._wrapped(address, unit)

    def _wrapped(self, address: int, unit: Any) -> AnyUnit:
        known = self._shared.get(address)
        if known is None or known[0] is not unit:
            shared = SharedUnit(unit) if hasattr(unit, "handle") else SharedPduUnit(unit)
            known = self._shared[address] = unit, shared
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
        self.served = node
        self._lock = exclusive(node)

    @property
    def deadline(self) -> float | None:
        """When the node has to be fed None, if no frame arrives before."""
        with self._lock:
            return self.served.deadline

    def start(self, now: float) -> list[CanFrame]:
        """Switch the node on, if it has a `start`; other nodes start by themselves."""
        with self._lock:
            start = getattr(self.served, "start", None)
            return [] if start is None else list(start(now))

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return the frames with which the node answers."""
        with self._lock:
            return self.served.feed(frame, now)

    def do(self, action: Callable[[float], Iterable[CanFrame] | None], now: float) -> list[CanFrame]:
        """Call `action(now)` while no other thread uses the node; return its frames."""
        with self._lock:
            return [*(action(now) or ())]

    def bus_off(self, now: float) -> None:
        """Report to the node that the CAN controller left the bus, if the node has a method for that."""
        with self._lock:
            bus_off = getattr(self.served, "bus_off", None)
            if bus_off is not None:
                bus_off(now)

    def recovered(self, now: float) -> list[CanFrame]:
        """Report to the node that the CAN controller is back on the bus."""
        with self._lock:
            recovered = getattr(self.served, "recovered", None)
            return [] if recovered is None else list(recovered(now))
