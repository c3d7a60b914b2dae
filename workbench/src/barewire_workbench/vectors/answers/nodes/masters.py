"""Answers for masters: what one reports of nodes over time, LSS services, the text gateway of CiA 309-3."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from barewire.canopen.configuration.concise_dcf import ConciseValue
from barewire.canopen.frame import CanFrame
from barewire.canopen.gateway.session import GatewaySession
from barewire.canopen.lss import master
from barewire.canopen.lss.messages import LssAddress, LssRefused, LssState
from barewire.canopen.manager.boot_slave import boot_slave
from barewire.canopen.manager.network_list import BootSlave
from barewire.canopen.nmt.error_control import Guard, GuardingMaster, HeartbeatConsumer
from barewire.conversation import Conversation, play
from barewire.errors import NoAnswer
from barewire_workbench.vectors.answers.texts import octets
from barewire_workbench.vectors.questions import Fields

_BOOT = {"rebooted": "booted", "answered": "active"}
_RESPONSE_TIME = 0.001
_TIMERS_MAX = 1000
_Peer = Callable[[CanFrame, float], list[tuple[float, CanFrame]]]


def watch(given: Fields) -> Fields:
    """Run the consumer of heartbeats, or the master of node guarding, step by step."""
    described = given["watch"]
    machine: HeartbeatConsumer | GuardingMaster
    if "heartbeat" in described:
        machine = HeartbeatConsumer({int(node): time / 1000 for node, time in described["heartbeat"].items()})
    else:
        guards = {int(node): Guard(row["time"] / 1000, row["factor"]) for node, row in described["guard"].items()}
        machine = GuardingMaster(guards, 0.0)
    steps = []
    for step in given["talk"]:
        now, items = step["at"] / 1e6, list[Any]()
        for _ in range(_TIMERS_MAX):
            due = machine.deadline
            if due is None or due > now:
                break
            items += machine.feed(None, due)
        for text in step.get("hear", ()):
            items += machine.feed(CanFrame.parse(text), now)
        said = [str(item) for item in items if isinstance(item, CanFrame)]
        steps.append({"say": said, "events": [_event(item) for item in items if not isinstance(item, CanFrame)]})
    return {"talk": steps}


def _event(item: Any) -> str:
    kind = _BOOT.get(item.kind, item.kind)
    return f"{item.node} {kind} {item.state:02X}" if kind in ("active", "state") else f"{item.node} {kind}"


def _bus(
    replies: Sequence[Sequence[str]], said: list[str]
) -> Callable[[CanFrame, float], list[tuple[float, CanFrame]]]:
    """Return a bus that replies to each frame with the next of `replies`."""
    left = deque(replies)

    def reply(frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        said.append(str(frame))
        frames = left.popleft() if left else ()
        return [(now + _RESPONSE_TIME * place, CanFrame.parse(text)) for place, text in enumerate(frames, 1)]

    return reply


def _service(ask: Fields) -> Conversation[CanFrame, Any]:
    """Return the conversation of an LSS service."""
    match ask["do"]:
        case "switch global":
            return master.switch_global(LssState(ask["mode"]))
        case "switch selective":
            return master.switch_selective(LssAddress(*_numbers(ask["address"])))
        case "identify":
            vendor, product, *limits = _numbers(ask["limits"])
            return master.identify_slaves(vendor, product, (limits[0], limits[1]), (limits[2], limits[3]))
        case "identify unconfigured":
            return master.identify_unconfigured()
        case "inquire address":
            return master.inquire_address()
        case "inquire node":
            return master.inquire_node()
        case "configure node":
            return master.configure_node(ask["node"])
        case "configure bit rate":
            return master.configure_bit_timing(ask["entry"], ask["table"])
        case "activate bit rate":
            return master.activate_bit_timing(ask["delay"] / 1000)
        case "store":
            return master.store_configuration()
        case _:
            return master.fastscan([None if part is None else int(part, 16) for part in ask["known"]])


def _numbers(parts: Sequence[str]) -> list[int]:
    return [int(part, 16) for part in parts]


def talk_lss(given: Fields) -> Fields:
    """Run an LSS service of the master against recorded answers."""
    said: list[str] = []
    ends: Fields
    try:
        found, _ = play(_service(given["ask"]), _bus([row["hear"] for row in given["talk"]], said))
    except LssRefused as error:
        ends = {"error": error.code, "detail": error.detail}
    except NoAnswer:
        ends = {"no_answer": True}
    else:
        ends = _result(given["ask"]["do"], found)
    return {"talk": [{"say": text} for text in said], "ends": ends}


def _result(do: str, found: Any) -> Fields:
    if isinstance(found, LssAddress):
        return {"address": [f"{part:08X}" for part in found]}
    if do == "fastscan":
        return {"address": None}
    if do == "switch selective":
        return {"found": found}
    if do.startswith("identify"):
        return {"count": found}
    return {"node": found} if do == "inquire node" else {"done": True}


def talk_gateway(given: Fields) -> Fields:
    """Execute lines of the text gateway, one after the other. Comments of its answers are left out."""
    session = GatewaySession(given.get("net", 1))
    steps = []
    for step in given["lines"]:
        said: list[str] = []
        texts, _ = play(session.answer(step["line"]), _bus(step.get("hear", ()), said))
        steps.append({"say": said, "text": [text if '"' in text else text.partition(" #")[0] for text in texts]})
    return {"lines": steps}


def boot(given: Fields) -> Fields:
    """Carry out the boot slave process of a CANopen manager with one node."""
    described, said = dict(given["slave"]), list[str]()
    for name in ("heartbeat", "guard_time"):
        described[name] = described.get(name, 0) / 1000
    for name in ("device_type", "vendor", "product", "revision", "serial"):
        described[name] = int(described.get(name, "0"), 16)
    values = [(int(row["object"][:4], 16), int(row["object"][5:], 16), row) for row in described.pop("writes", ())]
    described["configuration"] = tuple(ConciseValue(index, sub, octets(row["bytes"])) for index, sub, row in values)
    described["date"] = tuple(described.get("date", (0, 0)))
    result, _ = play(boot_slave(BootSlave(**described)), _bus([row["hear"] for row in given["talk"]], said))
    return {"talk": [{"say": text} for text in said], "ends": "ok" if result.error is None else result.error.name}
