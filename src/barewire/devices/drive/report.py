"""What the drive code tells: one look at the drive, progress, and the error of a drive that does not get there.

    move: stuck in 'ready to switch on' after 3 s, waiting for 'operation enabled': no high voltage, bit 4 (voltage
    enabled) is off; status word 0221h: ready to switch on, quick stop, remote; last control word 0007h

I know: what the bits of a status word mean when nothing happens.  I never know: who asks the drive, and how.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from barewire.codecs import Value
from barewire.devices.drive.cia402 import State, state_of
from barewire.devices.parameter import Parameter, Reading, show
from barewire.errors import BarewireError, DecodeError

VOLTAGE_ENABLED, REMOTE, REACHED, LIMITED, MODE_BIT, MODE_ERROR = 4, 9, 10, 11, 12, 13

NAMES: dict[int, str] = {
    0: "ready to switch on",
    1: "switched on",
    2: "operation enabled",
    3: "fault",
    4: "voltage enabled",
    5: "quick stop",
    6: "switch on disabled",
    7: "warning",
    9: "remote",
    10: "target reached",
    11: "internal limit active",
    12: "bit 12",
    13: "bit 13",
}
"""The bits of the status word that CiA 402 names; 12 and 13 belong to the mode."""

FAULTED = frozenset({State.FAULT, State.FAULT_REACTION_ACTIVE})


class Look(NamedTuple):
    """What a drive said at one moment. None is "not told": the description has no such part."""

    now: float
    status_word: int
    mode: Value | None = None
    position: Value | None = None
    velocity: Value | None = None

    @property
    def state(self) -> State | None:
        """The state; None while the word is none, which a drive shows only while it changes."""
        try:
            return state_of(self.status_word)
        except DecodeError:
            return None

    @property
    def state_name(self) -> str:
        """The state in words."""
        return self.state.value if self.state else "no state of CiA 402"

    def has(self, bit: int) -> bool:
        """Whether a bit of the status word is set."""
        return bool(self.status_word >> bit & 1)


class DriveProgress(NamedTuple):
    """Told after every look at the drive: what is being done, what is waited for, and what the drive says."""

    action: str
    waiting_for: str
    look: Look

    def as_dict(self) -> dict[str, Any]:
        """For JSON: the status word as the number and its bits in words."""
        look = self.look
        return {
            "time": round(look.now, 3),
            "action": self.action,
            "waiting_for": self.waiting_for,
            "state": look.state_name,
            "status_word": look.status_word,
            "bits": bit_names(look.status_word),
            "mode": look.mode,
            "position": look.position,
            "velocity": look.velocity,
        }


class DriveStuck(BarewireError, TimeoutError):
    """The drive did not get there in the time given, or cannot from where it is. The text says where, and why."""

    def __init__(self, text: str, look: Look, error: Reading | None) -> None:
        super().__init__(text)
        self.look = look
        self.error = error
        """The drive's error code, where it has one and could be asked."""


def bit_names(word: int) -> list[str]:
    """The named bits that are set.

    >>> bit_names(0x0221)
    ['ready to switch on', 'quick stop', 'remote']
    """
    return [name for bit, name in NAMES.items() if word >> bit & 1]


def stuck(
    action: str,
    waiting_for: str,
    waited: float | None,
    look: Look,
    control: int | None,
    error: Reading | None,
    more: Sequence[str] = (),
) -> DriveStuck:
    """The error, told whole. `waited` is None where waiting longer would not help; `more` is what no look tells."""
    after = "" if waited is None else f" after {waited:g} s"
    reasons = [*why(action, look, error), *whether_it_turns(look), *more]
    said = ", ".join(bit_names(look.status_word)) or "no bit set"
    last = "" if control is None else f"; last control word {control:04X}h"
    because = f": {'; '.join(reasons)}" if reasons else ""
    text = f"{action}: stuck in {look.state_name!r}{after}, waiting for {waiting_for}{because}"
    return DriveStuck(f"{text}; status word {look.status_word:04X}h: {said}{last}", look, error)


def why(action: str, look: Look, error: Reading | None) -> list[str]:
    """What the drive's own words say about why nothing happens; the surest first."""
    reasons = []
    if look.state in FAULTED:
        told = f"{error.name} {_code(error.parameter, error.value)}" if error and error.value else "no error code"
        reasons.append(f"the drive has a fault, {told}")
        if action == "reset":
            reasons.append("its cause is still there, or the reset was not taken")
        return reasons
    if error is not None and error.value:
        reasons.append(f"{error.name} {_code(error.parameter, error.value)}")
    if not look.has(VOLTAGE_ENABLED):
        reasons.append("no high voltage, bit 4 (voltage enabled) is off")
    if not look.has(REMOTE):
        reasons.append("the drive does not take commands from the bus, bit 9 (remote) is off")
    if look.has(LIMITED):
        reasons.append("a limit of the drive is active, bit 11")
    return reasons


def whether_it_turns(look: Look) -> list[str]:
    """With the current on: a motor that stands waits for something, one that turns may need longer."""
    if look.state is not State.OPERATION_ENABLED or look.velocity is None:
        return []
    if look.velocity:
        return [f"the motor still turns, velocity {show(look.velocity)}"]
    return ["the motor stands"]


SWITCHED_OFF = "'switch on disabled'"


def _code(parameter: Parameter, value: Value) -> str:
    """An error code as manuals print it, with its meaning where the description has one."""
    meaning = parameter.values.get(int(value)) if isinstance(value, int) else None
    shown = f"{value & 0xFFFF:04X}h" if isinstance(value, int) else str(value)
    return f"{shown} ({meaning})" if meaning else shown
