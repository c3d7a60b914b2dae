"""time, lss, node-talk: TIME, LSS, and devices with node guarding and LSS."""

from __future__ import annotations

from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import LssAddress, LssMessage
from barewire.canopen.lss.slave import LssSlave
from barewire.canopen.nmt.messages import NmtState
from barewire.canopen.nmt.node_guarding import GuardedNode
from barewire.canopen.time_stamp import TimeStamp
from barewire.canopen.time_types import DAY, TimeOfDay
from barewire.errors import EncodeError
from tests.vectors_runner.canopen import frame_of, wire
from tests.vectors_runner.common import Case, check, octets


def time(case: Case) -> None:
    """The time of day of one day."""

    def stamp() -> TimeStamp:
        if not 0 <= case["milliseconds"] < DAY:
            raise EncodeError(f"a day has no {case['milliseconds']} ms")  # in barewire both are one number
        return TimeStamp(TimeOfDay(case["days"] * DAY + case["milliseconds"]))

    check(
        case,
        encode=lambda: str(stamp().encode()),
        wire=wire(case),
        decode=lambda: TimeStamp.decode(frame_of(case)),
        value=stamp() if case["result"] != "invalid" else None,
    )


def lss(case: Case) -> None:
    """One message."""
    message = None
    if "service" in case:
        message = LssMessage(int(case["service"], 16), octets(case["body"]), case["side"] == "answer")
    check(
        case,
        encode=lambda: str(message.encode()) if message else None,
        wire=wire(case),
        decode=lambda: LssMessage.decode(frame_of(case)),
        value=message,
    )


def node_talk(case: Case) -> None:
    """A machine, fed step by step, and the frames and events that it returns."""
    assert case["result"] == "valid"
    node = case["node"]
    machine: GuardedNode | LssSlave
    if node["machine"] == "guarded-node":
        machine = GuardedNode(node["id"])
        machine.state = NmtState.PRE_OPERATIONAL
        machine.life_time = node.get("life_time", 0) / 1e6
    else:
        machine = LssSlave(LssAddress(*(int(part, 16) for part in node["address"])), node["id"])
    for step in case["talk"]:
        frame = None if step["hear"] is None else CanFrame.parse(step["hear"])
        found = machine.feed(frame, step["at"] / 1e6)
        assert [str(item) if isinstance(item, CanFrame) else item.kind for item in found] == step["said"], step
