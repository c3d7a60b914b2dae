"""The values of the AZ3 that are measured: each is computed from the axis when somebody reads it.

Some measured values are listed as read/write in the guides (HEATSINK TEMPERATURE, CUSTOM POSITION ACTUAL VALUE,
SENSORLESS MEASURED SPEED, the coil PHASING IN PROGRESS). A write to them is taken and has no effect, since the next
measurement stands there at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from barewire.canopen.nmt.messages import NmtState
from barewire.codecs import get_bit, set_bit
from barewire.devices.drive.cia402 import State
from barewire.devices.sim.motion.trajectory import wrapped

if TYPE_CHECKING:
    from barewire.devices.sim.az3.machine import Az3

# The bits 1 to 8 of 201Bh, coils 81 to 88 (ST.TEC.071, 5.3).
STATE_BITS = {
    State.NOT_READY_TO_SWITCH_ON: 1,
    State.SWITCH_ON_DISABLED: 2,
    State.READY_TO_SWITCH_ON: 3,
    State.SWITCHED_ON: 4,
    State.OPERATION_ENABLED: 5,
    State.QUICK_STOP_ACTIVE: 6,
    State.FAULT: 7,
    State.FAULT_REACTION_ACTIVE: 8,
}

MONITORED: dict[int, str] = {
    0: "",
    1: "VELOCITY ACTUAL VALUE",
    2: "POSITION ACTUAL VALUE",
    3: "TORQUE ACTUAL VALUE",
    4: "RMS CURRENT",
    5: "VBUS MEAN",
    6: "TARGET VELOCITY",
    7: "HEATSINK TEMPERATURE",
}
"""What CHANNEL_SEL_1 to 4 can choose here, and 8, the voltage reference; any other number shows 0, as number 0 does."""

REFERENCE = 8
INTERNAL_LIMIT = 0x0800
PHASING, BRAKE_USED, BRAKE_OPEN = 0, 7, 8
"""Bits of 2018h and 2019h."""

AMBIENT = 25.0
WARMING = 0.5  # °C per ampere, at once: the time constant of the heatsink is left out


def hang_values(drive: Az3) -> None:
    """Make every measured value of the drive follow its axis."""
    store = drive.store
    phases, brakes, states = (store.cell(f"COIL WORD {word}") for word in (0, 1, 5))

    def position(bits: int) -> int:
        return wrapped(drive.motion.shown_position(drive.axis.trajectory.position(drive.now)), bits)

    def status() -> int:
        return drive.axis.status(drive.now) | (INTERNAL_LIMIT if drive.motion.is_limited() else 0)

    def brake_word() -> int:
        word = int(brakes.held)
        return set_bit(word, BRAKE_OPEN, drive.axis.brake_is_open(drive.now)) if get_bit(word, BRAKE_USED) else word

    measures: dict[str, Callable[[], float]] = {
        "STATUS WORD": status,
        "COIL WORD 0": lambda: set_bit(int(phases.held), PHASING, drive.service.is_phasing),
        "COIL WORD 1": brake_word,
        "COIL WORD 5": lambda: int(states.held) | 1 << STATE_BITS[drive.axis.state],
        # A drive with nothing on its CAN connector has booted all the same.
        "NODE STATE": lambda: int(drive.canopen.state if drive.canopen else 0) or NmtState.PRE_OPERATIONAL,
        "CAN BITRATE INDEX": lambda: drive.service.rate,
        "BOOT CAN NODE READ ONLY": lambda: drive.service.node,
        "BOOT MODBUS NODE": lambda: drive.address & 0xFF,
        "ERROR REGISTER": lambda: drive.error_register,
        "POSITION ACTUAL VALUE": lambda: position(32),
        "CUSTOM POSITION ACTUAL VALUE": lambda: position(16),
        "VELOCITY ACTUAL VALUE": lambda: drive.speed,
        "VL VELOCITY ACTUAL VALUE": lambda: drive.speed,
        "CUSTOM VELOCITY ACTUAL VALUE": lambda: drive.speed,
        "SENSORLESS MEASURED SPEED": lambda: drive.speed,
        "TORQUE ACTUAL VALUE": lambda: drive.torque_permille,
        "TORQUE DEMAND": lambda: drive.torque_permille,
        "TORQUE ACTUAL VALUE NM": lambda: drive.torque_nm,
        "TORQUE SHAFT VALUE": lambda: drive.torque_nm,
        "CURRENT ACTUAL VALUE": lambda: drive.torque_permille,
        "RMS CURRENT": lambda: drive.current,
        "IQRMSX10": lambda: 10 * drive.current,
        "DC LINK CIRCUIT VOLTAGE": lambda: 1000 * drive.bus_voltage,
        "VBUS MEAN": lambda: drive.bus_voltage,
        "HEATSINK TEMPERATURE": lambda: AMBIENT + WARMING * drive.current,
    }
    for name, read in measures.items():
        store.measure(name, read)
    for place in range(8):
        store.measure(f"ERROR CODE {place + 1}", _error(drive, place))
    for place in range(len(drive.service.captures)):
        store.measure(f"PHASE DATA INCREMENTAL CAPTURES {place}", _capture(drive, place))
    for channel in range(1, 5):
        store.measure(f"MONITOR VAR {channel}", _monitor(drive, channel))


def _error(drive: Az3, place: int) -> Callable[[], int]:
    return lambda: drive.errors[place] & 0xFFFF if place < len(drive.errors) else 0


def _capture(drive: Az3, place: int) -> Callable[[], int]:
    return lambda: drive.service.captures[place]


def _monitor(drive: Az3, channel: int) -> Callable[[], float]:
    def read() -> float:
        if drive.store.whole(f"CHANNEL_SEL_{channel}") == REFERENCE:
            return drive.reference.position(drive.now)
        name = MONITORED.get(drive.store.whole(f"CHANNEL_SEL_{channel}"), "")
        return drive.store.number(name) if name else 0.0

    return read
