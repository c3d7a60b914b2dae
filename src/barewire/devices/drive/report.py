"""Reports of the drive code: the status of a drive, progress, and the error of a drive that does not reach its goal.

An example:

    move: stuck in 'ready to switch on' after 3 s, waiting for 'operation enabled': no high voltage, bit 4 (voltage
    enabled) is off; status word 0221h: ready to switch on, quick stop, remote; last control word 0007h
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isclose
from typing import Any, NamedTuple

from barewire.codecs import Value
from barewire.devices.drive.cia402 import FAULT_STATES, State, state_of
from barewire.devices.parameter import Parameter, Reading, show
from barewire.errors import BarewireError, DecodeError

VOLTAGE_ENABLED, REMOTE, REACHED, LIMITED, MODE_BIT, MODE_ERROR = 4, 9, 10, 11, 12, 13

_DEFINED_BITS = 0x01FF
"""The bits of the control word that CiA 402 defines in these modes."""

NOT_ENABLED = "the drive is not enabled: enable it first, or together with the movement (--enable, enable=True)"

_BIT_NAMES: dict[int, str] = {
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


class DriveStatus(NamedTuple):
    """The values read of a drive at one time (seconds). None where the description has no parameter in this role."""

    now: float
    status_word: int
    mode: Value | None = None
    position: Value | None = None
    velocity: Value | None = None

    def __repr__(self) -> str:
        values = (("mode", self.mode), ("position", self.position), ("velocity", self.velocity))
        shown = "".join(f", {name} {show(value)}" for name, value in values if value is not None)
        return f"<{type(self).__name__}: {self.state_name}, status word {self.status_word:04X}h{shown}>"

    @property
    def state(self) -> State | None:
        """The state; None for a word without a state, which a drive shows only during a transition."""
        try:
            return state_of(self.status_word)
        except DecodeError:
            return None

    @property
    def state_name(self) -> str:
        """The state in words."""
        return self.state.value if self.state else "no state of CiA 402"

    @property
    def is_limited(self) -> bool:
        """Whether a limit of the drive is active (bit 11): it does less than it was told to."""
        return self.has(LIMITED)

    def has(self, bit: int) -> bool:
        """Return whether a bit of the status word is set."""
        return bool(self.status_word >> bit & 1)


class DriveProgress(NamedTuple):
    """Reported after every reading of the drive: the action, the event it waits for, and the status."""

    action: str
    waiting_for: str
    status: DriveStatus

    def as_dict(self) -> dict[str, Any]:
        """Return the progress for JSON, with the status word as a number and its bits in words."""
        status = self.status
        return {
            "time": round(status.now, 3),
            "action": self.action,
            "waiting_for": self.waiting_for,
            "state": status.state_name,
            "status_word": status.status_word,
            "bits": bit_names(status.status_word),
            "mode": status.mode,
            "position": status.position,
            "velocity": status.velocity,
        }


class DriveStuck(BarewireError, TimeoutError):
    """The drive did not reach its goal in time, or cannot from its state. The text has the state and the reasons."""

    def __init__(self, text: str, status: DriveStatus, error: Reading | None) -> None:
        super().__init__(text)
        self.status = status
        self.error = error
        """The drive's error code, if it has one and it could be read."""


def bit_names(word: int) -> list[str]:
    """Return the named bits that are set.

    >>> bit_names(0x0221)
    ['ready to switch on', 'quick stop', 'remote']
    """
    return [name for bit, name in _BIT_NAMES.items() if word >> bit & 1]


def stuck_error(
    action: str,
    waiting_for: str,
    waited: float | None,
    status: DriveStatus,
    control: int | None,
    error: Reading | None,
    further: Sequence[str] = (),
) -> DriveStuck:
    """Return the error with all reasons. `waited` (seconds) is None where more time would not help, and `further` holds
    reasons that are not in the status."""
    after = "" if waited is None else f" after {waited:g} s"
    reasons = [*_reasons(action, status, error), *_motor_reason(status), *further]
    bits = ", ".join(bit_names(status.status_word)) or "no bit set"
    last = "" if control is None else f"; last control word {control:04X}h"
    because = f": {'; '.join(reasons)}" if reasons else ""
    text = f"{action}: stuck in {status.state_name!r}{after}, waiting for {waiting_for}{because}"
    return DriveStuck(f"{text}; status word {status.status_word:04X}h: {bits}{last}", status, error)


def foreign_writes(found: Sequence[Reading], written: Mapping[str, Value], control_word: str) -> Iterator[str]:
    """Yield a reason for every value that is no longer the written one."""
    for reading in found:
        if reading.name == control_word:
            if (int(reading.value) ^ int(written[reading.name])) & _DEFINED_BITS:
                yield f"another master wrote {reading.name} {int(reading.value):04X}h"
        elif not isclose(float(reading.value), float(written[reading.name]), rel_tol=1e-6):  # an f32 rounds
            yield f"another master wrote {reading.name} {show(reading.value)}"


def _reasons(action: str, status: DriveStatus, error: Reading | None) -> list[str]:
    """Return the reasons in the error code and in the status word, the most certain first."""
    reasons = []
    code = f"{error.name} {_code(error.parameter, error.value)}" if error is not None and error.value else ""
    if status.state in FAULT_STATES:
        reasons.append(f"the drive has a fault, {code or 'no error code'}")
        if action == "reset":
            reasons.append("its cause is still there, or the reset was not taken")
        return reasons
    if code:
        reasons.append(code)
    if not status.has(VOLTAGE_ENABLED):
        reasons.append("no high voltage, bit 4 (voltage enabled) is off")
    if not status.has(REMOTE):
        reasons.append("the drive does not take commands from the bus, bit 9 (remote) is off")
    if status.has(LIMITED):
        reasons.append("a limit of the drive is active, bit 11")
    return reasons


def _motor_reason(status: DriveStatus) -> list[str]:
    """Return whether the motor of an enabled drive stands or turns: one that turns may only need more time."""
    if status.state is not State.OPERATION_ENABLED or status.velocity is None:
        return []
    if status.velocity:
        return [f"the motor still turns, velocity {show(status.velocity)}"]
    return ["the motor stands"]


def _code(parameter: Parameter, value: Value) -> str:
    """Return an error code as manuals print it, with its meaning if the description has one."""
    meaning = parameter.values.get(int(value)) if isinstance(value, int) else None
    number = f"{value & 0xFFFF:04X}h" if isinstance(value, int) else str(value)
    return f"{number} ({meaning})" if meaning else number
