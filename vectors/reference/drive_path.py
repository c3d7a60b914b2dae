"""drive-path: the state machine of CiA 402, as the drive goes through it and as the master leads it."""

from devices import command, state_of
from texts import Refused

OFF, READY, ON, ENABLED = "switch on disabled", "ready to switch on", "switched on", "operation enabled"
STOPPING, FAULT = "quick stop active", "fault"
TRANSITIONS = {
    OFF: {"shutdown": READY},  # 2
    READY: {"switch on": ON, "enable operation": ENABLED, "disable voltage": OFF, "quick stop": OFF},  # 3, 3 and 4, 7
    ON: {"enable operation": ENABLED, "shutdown": READY, "disable voltage": OFF, "quick stop": OFF},  # 4, 6, 10
    ENABLED: {
        "disable operation": ON,
        "shutdown": READY,
        "disable voltage": OFF,
        "quick stop": STOPPING,
    },
    STOPPING: {"disable voltage": OFF},  # 12
}
COMMANDS = ("shutdown", "switch on", "disable operation", "enable operation", "disable voltage", "quick stop")
"""Those that are levels of bits. A fault reset is the rising edge of bit 7, and its other bits are no command then."""


def after(now, before, word, stays):
    """Return the state after a control word."""
    if word & 0x80:
        return OFF if now == FAULT and not before & 0x80 else now
    ways = dict(TRANSITIONS.get(now, {}))
    if now == STOPPING and stays:
        ways["enable operation"] = ENABLED  # 16
    for name in COMMANDS:
        if name in ways and command({"word": f"{word:04X}", "command": name})["matches"]:
            return ways[name]
    return now


def drive(given):
    """state, before, stays, words -> states"""
    now, before, states = given["state"], int(given["before"], 16), []
    for text in given["words"]:
        now, before = after(now, before, int(text, 16), given.get("stays")), int(text, 16)
        states.append(now)
    return {"states": states}


SHUTDOWN, SWITCH_ON, ENABLE, OFF_AT_ONCE, QUICK_STOP, RESET = "0006", "0007", "000F", "0000", "0002", "0080"
UP = {OFF: SHUTDOWN, READY: SWITCH_ON, ON: ENABLE}
"""The way up: the word that leads one state further."""
DOWN = {
    OFF: {READY: OFF_AT_ONCE, ON: OFF_AT_ONCE, ENABLED: OFF_AT_ONCE},
    READY: {ON: SHUTDOWN, ENABLED: SHUTDOWN},
    ON: {ENABLED: SWITCH_ON},
    STOPPING: {ENABLED: QUICK_STOP},
}
"""The ways down, by goal and state."""


def word_for(goal, now, stays):
    """Return the control word to write in a state; None to wait."""
    if goal not in (OFF, READY, ON, ENABLED, STOPPING):
        raise Refused("value")
    if now == goal or now in ("not ready to switch on", "fault reaction active"):
        return None
    if now in DOWN.get(goal, {}):
        return DOWN[goal][now]
    if goal == STOPPING or now is None:
        raise Refused("value")
    if now == STOPPING:
        return ENABLE if stays and goal == ENABLED else OFF_AT_ONCE
    return RESET if now == FAULT else UP[now]


def master(given):
    """goal, stays, seen -> words"""
    return {"words": [word_for(given["goal"], state_of(int(word, 16)), given.get("stays")) for word in given["seen"]]}


KINDS = {"drive-path": {"decode": drive, "encode": master}}
