"""The measures of the ADXL: each is computed from its motor when somebody reads it (table 2), and two more registers
whose content is found and not stored: the parameter of a menu, and the text of an event."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from barewire.codecs import Value
from barewire.devices.sim.adxl.motor import FREQUENCY, PHASES, RATED_CURRENT, Phase, Sample

if TYPE_CHECKING:
    from barewire.devices.sim.adxl.machine import Adxl


def hang_values(starter: Adxl) -> None:
    """Make every measured value of the starter follow its motor."""
    motor = starter.motor

    def sample() -> Sample:
        return motor.sample(starter.now)

    def amperes(phase: int) -> float:
        return sample().current * RATED_CURRENT * PHASES[phase]

    def power(phase: int) -> float:
        return motor.power(sample()) / 3 * PHASES[phase]

    def largest() -> float:
        return max(amperes(phase) for phase in range(3))

    def bit(of: str, place: int) -> bool:
        return bool(getattr(starter, of) >> place & 1)

    measures: dict[str, Callable[[], Value]] = {
        "L3-L1 Voltage": lambda: motor.line_voltage() if starter.has_line else 0,
        "Frequency": lambda: FREQUENCY if starter.has_line else 0,
        "Total active power": lambda: motor.power(sample()),
        "Total power factor": lambda: sample().power_factor,
        "Max current": largest,
        "Torque": lambda: 100 * sample().torque,
        "Maximum instantaneous current %": lambda: 100 * largest() / RATED_CURRENT,
        "Motor hour meter": lambda: motor.seconds / 3600,
        "Start counter": lambda: motor.starts,
        "Status": starter.status,
        "Motor thermal status": lambda: motor.thermal,
        "Thyristors temperature": lambda: motor.thyristors,
        "Total active energy": lambda: motor.energy,
        "Output 1": lambda: motor.is_running,
        "Output 2": lambda: motor.phase is Phase.BYPASSED,
        "Output 3": lambda: bool(starter.alarm),
        "Events counter": lambda: len(starter.events.texts),
        "Events pointer": lambda: starter.events.pointer,
        "Event description": starter.events.text,
        "Parameter value": lambda: starter.menus.read(starter.selected()),
    }
    for place in range(3):
        line = f"L{place + 1}"
        measures[f"{line} current"] = partial(amperes, place)
        measures[f"{line} active power"] = partial(power, place)
        measures[f"{line} power factor"] = lambda: sample().power_factor
        measures[f"Input {place + 1}"] = partial(bit, "inputs", place)
    for place in range(4):
        measures[f"Remote {place + 1}"] = partial(bit, "remotes", place)
        measures[f"Limit {place + 1}"] = partial(bit, "limits", place)
    for name, read in measures.items():
        starter.store.measure(name, read)
