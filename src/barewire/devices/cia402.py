"""The states of a drive: the state in a status word, the control word for each transition.   [CiA 402, device control]

              0 | power on                                                14 (by itself)
       NOT READY TO SWITCH ON          any state --13, a fault--> FAULT REACTION ACTIVE ---> FAULT
              1 | by itself                                                                    |
       SWITCH ON DISABLED <----------------------------------- 15, fault reset ----------------'
       2 shutdown |  ^ 7 disable voltage                    ^ ^  ^
       READY TO SWITCH ON <--------------------.            | |  |
       3 switch on |  ^ 6 shutdown             |            | |  | 12 disable voltage, or by itself
       SWITCHED ON ----------------------------|-- 10 ------' |  |
       4 enable |  ^ 5 disable operation       |              |  |
       OPERATION ENABLED -- 8 shutdown --------' -- 9 --------'  |
              11 | quick stop                                    |
       QUICK STOP ACTIVE ----------------------------------------'    16 enable: back, if the drive stays here

Pure functions without time. Both buses carry these words: objects 6040h and 6041h on CANopen, registers on Modbus.
"""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import NamedTuple

from barewire.errors import DecodeError, EncodeError


class State(Enum):
    """A state of the device control, in the words of the standard."""

    NOT_READY_TO_SWITCH_ON = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY_TO_SWITCH_ON = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION_ACTIVE = "fault reaction active"
    FAULT = "fault"


FAULT_STATES = frozenset({State.FAULT, State.FAULT_REACTION_ACTIVE})


class DriveCommand(IntEnum):
    """A command; its value is the simplest control word that gives it. Switch on is also disable operation."""

    DISABLE_VOLTAGE = 0x0000
    QUICK_STOP = 0x0002
    SHUTDOWN = 0x0006
    SWITCH_ON = 0x0007
    ENABLE_OPERATION = 0x000F
    FAULT_RESET = 0x0080

    @property
    def text(self) -> str:
        """The command in the words of the standard, such as "enable operation"."""
        return self.name.lower().replace("_", " ")


# The status word under this mask has this value in this state, and in no other state.
#   bit 6 switch on disabled, 5 quick stop (0: active), 3 fault, 2 operation enabled, 1 switched on, 0 ready
STATUS_PATTERNS: dict[State, tuple[int, int]] = {
    State.NOT_READY_TO_SWITCH_ON: (0x4F, 0x00),
    State.SWITCH_ON_DISABLED: (0x4F, 0x40),
    State.READY_TO_SWITCH_ON: (0x6F, 0x21),
    State.SWITCHED_ON: (0x6F, 0x23),
    State.OPERATION_ENABLED: (0x6F, 0x27),
    State.QUICK_STOP_ACTIVE: (0x6F, 0x07),
    State.FAULT_REACTION_ACTIVE: (0x4F, 0x0F),
    State.FAULT: (0x4F, 0x08),
}

# The control word: bits 7, 3, 2, 1, 0 are the command, the others belong to the mode. Fault reset is the edge of bit 7.
CONTROL_PATTERNS: dict[DriveCommand, tuple[int, int]] = {
    DriveCommand.DISABLE_VOLTAGE: (0x82, 0x00),
    DriveCommand.QUICK_STOP: (0x86, 0x02),
    DriveCommand.SHUTDOWN: (0x87, 0x06),
    DriveCommand.SWITCH_ON: (0x8F, 0x07),
    DriveCommand.ENABLE_OPERATION: (0x8F, 0x0F),
}


NEW_SET_POINT, IMMEDIATELY, RELATIVE, HALT = 0x10, 0x20, 0x40, 0x100
"""Bits of the control word in profile position; 4 starts a homing run in homing, 8 halts in every mode."""

VOLTAGE_ENABLED, QUICK_STOP, REMOTE, REACHED, LIMITED, MODE_BIT, MODE_ERROR = 4, 5, 9, 10, 11, 12, 13
"""Numbers of bits of the status word. The mode gives 12 and 13 their meaning: set-point acknowledge, speed is 0, homing
attained; following error, homing error."""

STATUS_BITS: dict[int, str] = {
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
"""The bits of the status word by the names of CiA 402; 8, 14 and 15 belong to the manufacturer."""


class Transition(NamedTuple):
    """One arrow of the drawing. Without a command the drive makes it by itself."""

    number: int
    source: State
    target: State
    command: DriveCommand | None


_S = State
TRANSITIONS: tuple[Transition, ...] = (
    Transition(1, _S.NOT_READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED, None),
    Transition(2, _S.SWITCH_ON_DISABLED, _S.READY_TO_SWITCH_ON, DriveCommand.SHUTDOWN),
    Transition(3, _S.READY_TO_SWITCH_ON, _S.SWITCHED_ON, DriveCommand.SWITCH_ON),
    Transition(3, _S.READY_TO_SWITCH_ON, _S.SWITCHED_ON, DriveCommand.ENABLE_OPERATION),  # and 4 follows at once
    Transition(4, _S.SWITCHED_ON, _S.OPERATION_ENABLED, DriveCommand.ENABLE_OPERATION),
    Transition(5, _S.OPERATION_ENABLED, _S.SWITCHED_ON, DriveCommand.SWITCH_ON),
    Transition(6, _S.SWITCHED_ON, _S.READY_TO_SWITCH_ON, DriveCommand.SHUTDOWN),
    Transition(7, _S.READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED, DriveCommand.DISABLE_VOLTAGE),
    Transition(7, _S.READY_TO_SWITCH_ON, _S.SWITCH_ON_DISABLED, DriveCommand.QUICK_STOP),
    Transition(8, _S.OPERATION_ENABLED, _S.READY_TO_SWITCH_ON, DriveCommand.SHUTDOWN),
    Transition(9, _S.OPERATION_ENABLED, _S.SWITCH_ON_DISABLED, DriveCommand.DISABLE_VOLTAGE),
    Transition(10, _S.SWITCHED_ON, _S.SWITCH_ON_DISABLED, DriveCommand.DISABLE_VOLTAGE),
    Transition(10, _S.SWITCHED_ON, _S.SWITCH_ON_DISABLED, DriveCommand.QUICK_STOP),
    Transition(11, _S.OPERATION_ENABLED, _S.QUICK_STOP_ACTIVE, DriveCommand.QUICK_STOP),
    Transition(12, _S.QUICK_STOP_ACTIVE, _S.SWITCH_ON_DISABLED, DriveCommand.DISABLE_VOLTAGE),
    Transition(14, _S.FAULT_REACTION_ACTIVE, _S.FAULT, None),
    Transition(15, _S.FAULT, _S.SWITCH_ON_DISABLED, DriveCommand.FAULT_RESET),
    Transition(16, _S.QUICK_STOP_ACTIVE, _S.OPERATION_ENABLED, DriveCommand.ENABLE_OPERATION),
)

_LADDER: dict[State, DriveCommand] = {
    _S.SWITCH_ON_DISABLED: DriveCommand.DISABLE_VOLTAGE,
    _S.READY_TO_SWITCH_ON: DriveCommand.SHUTDOWN,
    _S.SWITCHED_ON: DriveCommand.SWITCH_ON,
    _S.OPERATION_ENABLED: DriveCommand.ENABLE_OPERATION,
}
"""The states from current off to enabled, and the command to each: upwards it takes one step, downwards all at once."""


def state_of(status_word: int) -> State:
    """Return the state in a status word.

    >>> state_of(0x0637)
    <State.OPERATION_ENABLED: 'operation enabled'>

    Raises DecodeError for a word that shows none of the eight states, which a drive shows only during a transition.
    """
    for state, (mask, value) in STATUS_PATTERNS.items():
        if status_word & mask == value and 0 <= status_word <= 0xFFFF:
            return state
    data = (status_word & 0xFFFF).to_bytes(2, "big")
    raise DecodeError("value", data, 0, f"status word {status_word:04X}h is not a state of CiA 402")


def with_state(status_word: int, state: State) -> int:
    """Return the status word with the bits of `state` and every other bit kept, as a simulated drive reports it.

    >>> hex(with_state(0x0600, State.OPERATION_ENABLED))
    '0x627'
    """
    mask, value = STATUS_PATTERNS[state]
    return status_word & ~mask | value


def command_of(control_word: int, previous: int = 0) -> DriveCommand | None:
    """Return the command in a control word that follows `previous`: fault reset is an edge. None while bit 7 stays set.

    >>> command_of(0x001F), command_of(0x0080), command_of(0x0080, previous=0x0080)
    (<DriveCommand.ENABLE_OPERATION: 15>, <DriveCommand.FAULT_RESET: 128>, None)
    """
    if control_word & ~previous & DriveCommand.FAULT_RESET:
        return DriveCommand.FAULT_RESET
    for command, (mask, value) in CONTROL_PATTERNS.items():
        if control_word & mask == value:
            return command
    return None


def after(state: State, control_word: int, previous: int = 0, *, stays_in_quick_stop: bool = False) -> State:
    """Return the state after a control word. Transition 16 exists only in a drive that stays in its quick stop.

    >>> after(State.READY_TO_SWITCH_ON, 0x000F)
    <State.OPERATION_ENABLED: 'operation enabled'>
    """
    for transition in transitions_by(state, control_word, previous, stays_in_quick_stop=stays_in_quick_stop):
        state = transition.target
    return state


def transitions_by(
    state: State, control_word: int, previous: int = 0, *, stays_in_quick_stop: bool = False
) -> list[Transition]:
    """Return the transitions that a control word makes from a state, one after the other.

    >>> [transition.number for transition in transitions_by(State.READY_TO_SWITCH_ON, 0x000F)]
    [3, 4]
    """
    command, passed = command_of(control_word, previous), []
    for transition in TRANSITIONS:
        # In the order of the list one word can make two transitions: 000Fh switches a ready drive on and enables it.
        is_made = transition.source is state and command is not None and transition.command is command
        if is_made and (transition.number != 16 or stays_in_quick_stop):
            passed.append(transition)
            state = transition.target
    return passed


def next_control_word(state: State, goal: State, *, stays_in_quick_stop: bool = False) -> int | None:
    """Return the control word for the next step from `state` to `goal`, or None where no command is needed.

    None is returned at the goal, and in states that the drive leaves by itself. A fault is left by the edge of bit 7:
    if the control word is 0080h already, write 0000h first.

    >>> [next_control_word(state, State.OPERATION_ENABLED) for state in (State.SWITCH_ON_DISABLED, State.FAULT)]
    [6, 128]

    Raises EncodeError for a goal that no command reaches: a fault, or a quick stop of a drive that is not enabled.
    """
    goals = (*_LADDER, State.QUICK_STOP_ACTIVE)
    if goal not in goals:
        expected = ", ".join(possible.value for possible in goals)
        raise EncodeError(f"no control word leads to {goal.value!r}: expected one of {expected}", "goal")
    if state is goal or state in (State.NOT_READY_TO_SWITCH_ON, State.FAULT_REACTION_ACTIVE):
        return None
    if goal is State.QUICK_STOP_ACTIVE:
        if state is not State.OPERATION_ENABLED:
            raise EncodeError(f"a quick stop needs an enabled drive, this one is {state.value!r}", "goal")
        return int(DriveCommand.QUICK_STOP)
    if state is State.FAULT:
        return int(DriveCommand.FAULT_RESET)
    if state is State.QUICK_STOP_ACTIVE:
        resumes = stays_in_quick_stop and goal is State.OPERATION_ENABLED
        return int(DriveCommand.ENABLE_OPERATION if resumes else DriveCommand.DISABLE_VOLTAGE)
    rungs = list(_LADDER)
    return int(_LADDER[rungs[min(rungs.index(state) + 1, rungs.index(goal))]])
