"""GMP (C, gmp_pro) as an adapter: the state machine of its drives by CiA 402, called by ctypes.

peer.toml builds it with machine.c and port.c, which stand for its platform.
"""

from __future__ import annotations

import ctypes
import sys
from ctypes import CFUNCTYPE, Structure, c_int32, c_uint16, c_uint32, c_void_p
from typing import Any

from adapter import NotOffered, serve

LIBRARY = ctypes.CDLL(sys.argv[1])
STATES = ("not ready to switch on", "switch on disabled", "ready to switch on", "switched on", "operation enabled")
STATES += ("quick stop active", "fault reaction active", "fault")
COMMANDS = ("", "disable voltage", "shutdown", "switch on", "enable operation", "quick stop", "fault reset")
READY = CFUNCTYPE(c_int32, c_void_p)
HANDLERS = ("disabled", "ready", "switched_on", "enabled", "quick_stop", "reaction", "fault")


class Machine(Structure):
    """cia402_sm_t."""

    _fields_ = (
        *(("control_word", c_uint16), ("status_word", c_uint16), ("state", c_int32), ("command", c_int32)),
        *((name, READY) for name in HANDLERS),
        *((name, c_int32) for name in ("result", "reset_requested", "obeys", "delayed")),
        *(("entered", c_uint32), ("cycles", c_uint32), ("delays", c_uint32 * 4)),
        *(("ready_since", c_uint32), ("tick", c_uint32), ("last_reset_bit", c_int32)),
    )


YES, WAITS = READY(lambda _machine: 1), READY(lambda _machine: 0)
"""What its application says of the power: the next state is possible; or the drive stays."""


def machine(state: str = "switch on disabled", before: int = 0) -> Machine:
    """Return a drive in a state, whose last control word was `before`."""
    found = Machine()
    LIBRARY.init_cia402_state_machine(ctypes.byref(found))
    for name in HANDLERS:
        setattr(found, name, YES if name in ("disabled", "ready", "switched_on") else WAITS)
    found.state, found.obeys, found.last_reset_bit = STATES.index(state), 1, before >> 7 & 1
    found.delays = (c_uint32 * 4)()
    LIBRARY.cia402_update_status_word(ctypes.byref(found))
    return found


def states(question: dict[str, Any]) -> dict[str, Any]:
    if question["state"] == "not ready to switch on":
        raise NotOffered("it leaves this state with its first cycle")
    drive, answer = machine(question["state"], int(question["before"], 16)), []
    for word in question["words"]:
        drive.control_word = int(word, 16)
        LIBRARY.cia402_dispatch(ctypes.byref(drive))
        answer.append(STATES[drive.state])
    return {"states": answer}


def command(question: dict[str, Any]) -> dict[str, Any]:
    name = COMMANDS[LIBRARY.get_cia402_control_cmd(c_uint16(int(question["word"], 16)))]
    return {"matches": name == question["command"].replace("disable operation", "switch on")}


def state(question: dict[str, Any]) -> dict[str, Any]:
    found = LIBRARY.get_cia402_state(c_uint16(int(question["word"], 16)))
    return {"state": STATES[found] if 0 <= found < len(STATES) else "unknown"}


serve(
    "GMP",
    {"drive-path": {"decode": states}, "drive-command": {"decode": command}, "drive-state": {"decode": state}},
)
