"""The clock of a simulated machine, and the protocol of a machine that the bus adapters use."""

from __future__ import annotations

from typing import Protocol

from barewire.devices.sim.core.store import MachineStore


class MachineClock:
    """The time of one machine in seconds, as it was last passed in. All parts of the machine share one clock.

    >>> clock = MachineClock()
    >>> clock.advance(5.0)
    >>> clock.advance(7.5)
    >>> clock.now, clock.uptime
    (7.5, 2.5)
    """

    def __init__(self, now: float = 0.0) -> None:
        self.now = now
        self.on_since: float | None = None
        """The time of power-on: the first time that was passed in, or the last power cycle."""

    def advance(self, now: float) -> None:
        """Set the time. A time before the present one is ignored."""
        if self.on_since is None:
            self.on_since = now
        self.now = max(self.now, now)

    @property
    def uptime(self) -> float:
        """Seconds since power-on."""
        return 0.0 if self.on_since is None else self.now - self.on_since


class SimulatedMachine(Protocol):
    """The part of a machine that the bus adapters use: values, clock, and resets from a bus."""

    store: MachineStore
    clock: MachineClock

    def tick(self, now: float) -> None:
        """Advance to the time `now`: carry out everything that is due until then."""

    def reset(self) -> None:
        """Restore every value as at power-on (NMT reset node)."""

    def reset_communication(self) -> None:
        """React to an NMT reset communication; the saved values of 1000h to 1FFFh have been restored."""
