"""Answers for CANopen nodes over time: SDO transfers, nodes that are asked, whole devices, and masters."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import cob_id
from barewire.canopen.communication_objects import lss_address
from barewire.canopen.configuration.configure import ConciseValue
from barewire.canopen.datatypes import object_codec, type_name
from barewire.canopen.device.device import LocalNode
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss import master
from barewire.canopen.lss.messages import LssAddress, LssRefused, LssState
from barewire.canopen.lss.slave import LssSlave
from barewire.canopen.manager.boot_slave import boot_slave
from barewire.canopen.manager.network_list import BootSlave
from barewire.canopen.nmt.error_control import Guard, GuardedNode, GuardingMaster, HeartbeatConsumer
from barewire.canopen.nmt.messages import NmtState
from barewire.canopen.object_dictionary import Entry, ObjectAddress, ObjectDictionary
from barewire.canopen.pdo.config import pdos_of
from barewire.canopen.sdo import BlockSettings, SdoServer, download, upload
from barewire.codecs import Value
from barewire.conversation import Conversation, Heard, Listen, play
from barewire.errors import NoAnswer
from barewire_workbench.ascii_gateway.session import GatewaySession
from barewire_workbench.vectors.answers.values import START, Answers, hexed, number, octets, word
from barewire_workbench.vectors.questions import Fields

_RESPONSE_TIME = 0.001
_TIMERS_MAX = 1000
"""Timers that may end between two steps."""


def _timers_until(machine: Any, since: float, now: float) -> list[Any]:
    """Let the time pass from `since` to `now`, timer by timer. Return what is sent or reported on the way."""
    events: list[Any] = []
    for _ in range(_TIMERS_MAX):
        if machine.deadline is None or machine.deadline > now:
            break
        events += machine.feed(None, max(machine.deadline, since))
    return events


def _address_of(text: str) -> ObjectAddress:
    """Return index and sub-index of "1017:00"."""
    index, _, sub = text.partition(":")
    return word(index), word(sub)


# Transfers

_PATIENCE = 60.0
"""Seconds of waiting after which a transfer does not end any more."""
_STORED = (0x2100, 0)
"""The only object of the server."""


def _sdo_client(given: Fields) -> Fields:
    node, place = given["node"], (word(given["index"]), word(given["sub"]))
    block: BlockSettings | bool = BlockSettings(**given["block"]) if "block" in given else False
    conversation: Conversation[CanFrame, Any]
    if given["direction"] == "upload":
        conversation = upload(node, *place, block=block)
    else:
        value, indicated = octets(given["value"]), given.get("indicated", True)
        conversation = download(node, *place, value, indicated=indicated, block=block)
    steps: list[Fields] = [{"say": []} for _ in given["talk"]]
    try:
        _play(conversation, given["talk"], steps, node)
    except SdoAbort as abort:
        return {"talk": steps, "ends": {"abort": f"{abort.code:08X}"}}
    except NoAnswer:
        return {"talk": steps, "ends": {"abort": f"{AbortCode.TIMED_OUT:08X}"}}  # what it has told the server
    except StopIteration as stop:
        arrived = {"arrived": hexed(stop.value)} if given["direction"] == "upload" else {}
        return {"talk": steps, "ends": "done", **arrived}
    return {"talk": steps, "ends": "running"}


def _play(conversation: Conversation[CanFrame, Any], talk: list[Fields], steps: list[Fields], node: int) -> None:
    """Feed the lines of each step, and then, until the client says something, nothing but time."""
    now, place = START, 0
    lines = list(talk[0]["hear"])
    step = next(conversation)
    while True:
        if not isinstance(step, Listen):
            steps[place]["say"] += [hexed(item.data) for item in step.items]
            step = conversation.send(Heard(None, now))
            continue
        has_said, is_last = bool(steps[place]["say"]), place + 1 == len(talk)
        if not lines and has_said and not is_last and step.until > now:
            place += 1
            lines = list(talk[place]["hear"])
        if lines:
            now += _RESPONSE_TIME
            frame = CanFrame(cob_id("SDO answer", node), octets(lines.pop(0)))
            step = conversation.send(Heard(frame, now))
        elif has_said and is_last and step.until > now + _PATIENCE:
            return
        else:
            now = max(now, step.until)
            step = conversation.send(Heard(None, now))


def _sdo_server(given: Fields) -> Fields:
    node, written = given["node"], given["direction"] == "download"
    objects = ObjectDictionary([Entry(*_STORED, "value", "domain", "rw", b"" if written else octets(given["value"]))])
    device = SdoServer(node, objects, blksize=given.get("blksize", 127))
    now = 0.0
    steps = []
    for step in given["talk"]:
        said: list[CanFrame] = []
        for line in step["hear"]:
            now += _RESPONSE_TIME
            said += device.feed(CanFrame(cob_id("SDO request", node), octets(line)), now)
        if not said and device.deadline is not None:
            now = max(now, device.deadline)
            said += device.feed(None, now)
        while device.deadline is not None and device.deadline <= now:  # a long block is sent in several parts
            said += device.feed(None, now)
        steps.append({"say": [hexed(frame.data) for frame in said]})
    return {"talk": steps, "arrived": hexed(objects.read(*_STORED))} if written else {"talk": steps}


def _node_talk(given: Fields) -> Fields:
    """Feed a guarded node or an LSS slave step by step."""
    setup = given["node"]
    machine: GuardedNode | LssSlave
    if setup["machine"] == "guarded-node":
        machine = GuardedNode(setup["id"])
        machine.state = NmtState.PRE_OPERATIONAL
        machine.life_time = setup.get("life_time", 0) / 1e6
    else:
        machine = LssSlave(LssAddress(*map(word, setup["address"])), setup["id"])
    steps = []
    for step in given["talk"]:
        frame = None if step["hear"] is None else CanFrame.parse(step["hear"])
        events = machine.feed(frame, step["at"] / 1e6)
        steps.append({"said": [str(event) if isinstance(event, CanFrame) else event.kind for event in events]})
    return {"talk": steps}


# Devices

_EVERY_DEVICE: tuple[tuple[str, str, str], ...] = (
    ("1000:00", "UNSIGNED32", "const"),
    ("1001:00", "UNSIGNED8", "ro"),
    ("1018:01", "UNSIGNED32", "const"),
)
"""The objects that a device has beside those of the case; their values are 0."""
_MAPPED: dict[str, Any] = {"no": (), "RPDO": ("RPDO",), "TPDO": ("TPDO",), "both": ("RPDO", "TPDO")}


def _value_of(type: str, text: str) -> Value:
    """Return the value of a text: decimal for numbers, hexadecimal for bytes, the characters for strings."""
    name = type_name(type)
    if name in ("octets", "domain"):
        return octets(text)
    if name in ("string", "unicode"):
        return text
    if name in ("time_of_day", "time_difference"):
        return object_codec(name).decode(octets(text))
    return bool(int(text)) if name == "bool" else number(text)


def _dictionary(rows: Iterable[Fields]) -> ObjectDictionary:
    described = {row["object"]: row for row in rows}
    for place, type, access in _EVERY_DEVICE:
        described.setdefault(place, {"object": place, "type": type, "access": access, "value": "0"})
    return ObjectDictionary(map(_entry, described.values()))


def _entry(row: Fields) -> Entry:
    index, sub = _address_of(row["object"])
    return Entry(
        index,
        sub,
        row["object"],
        row["type"],
        row["access"],
        _value_of(row["type"], row["value"]),
        minimum=_limit(row.get("low")),
        maximum=_limit(row.get("high")),
        mappable=_MAPPED[row.get("mapped", "no")],
    )


def _limit(text: str | None) -> float | None:
    if text is None:
        return None
    limit = float(text)
    return int(limit) if limit.is_integer() else limit


def _device(given: Fields) -> Fields:
    """Run a device step by step: what it sends, by its timers and as response."""
    described = given["device"]
    objects, node = _dictionary(described["objects"]), described["id"]
    lss = LssSlave(lss_address(objects), node, store=lambda *stored: True) if described.get("lss") else None
    machine = LocalNode(node, objects, pdos_of(objects, node or 1), lss=lss)
    steps, now = [], 0.0
    for place, step in enumerate(given["talk"]):
        since, now = now, step["at"] / 1e6
        said = machine.start(0.0) if place == 0 else []
        said += _timers_until(machine, since, now)
        for text in step.get("hear", ()):
            said += machine.feed(CanFrame.parse(text), now)
        for act in step.get("act", ()):
            said += _act(machine, act, now)
        said += machine.feed(None, now) + _timers_until(machine, now, now)
        steps.append({"say": [str(frame) for frame in said]})
    return {"talk": steps}


def _act(machine: LocalNode, act: Fields, now: float) -> list[CanFrame]:
    """Do what the application of a device does: set a value, or report an error or its end."""
    if "set" in act:
        index, sub = _address_of(act["set"])
        machine.objects.set(index, sub, _value_of(machine.objects.entry(index, sub).type, act["value"]))
        return []
    if "error" in act:
        return machine.error(word(act["error"]), now, info=octets(act.get("info", "")))
    return machine.error_gone(word(act["clear"]), now)


# Masters

_BOOT = {"rebooted": "booted", "answered": "active"}
_Peer = Callable[[CanFrame, float], list[tuple[float, CanFrame]]]


def _watch(given: Fields) -> Fields:
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
        now = step["at"] / 1e6
        items = _timers_until(machine, 0.0, now)
        for text in step.get("hear", ()):
            items += machine.feed(CanFrame.parse(text), now)
        said = [str(item) for item in items if isinstance(item, CanFrame)]
        steps.append({"say": said, "events": [_event(item) for item in items if not isinstance(item, CanFrame)]})
    return {"talk": steps}


def _event(item: Any) -> str:
    kind = _BOOT.get(item.kind, item.kind)
    return f"{item.node} {kind} {item.state:02X}" if kind in ("active", "state") else f"{item.node} {kind}"


def _bus(replies: Iterable[Sequence[str]], said: list[str]) -> _Peer:
    """Return a bus that replies to each frame with the next of `replies`."""
    to_come = deque(replies)

    def reply(frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        said.append(str(frame))
        frames = to_come.popleft() if to_come else ()
        return [(now + _RESPONSE_TIME * place, CanFrame.parse(text)) for place, text in enumerate(frames, 1)]

    return reply


def _service(ask: Fields) -> Conversation[CanFrame, Any]:
    """Return the conversation of an LSS service."""
    match ask["do"]:
        case "switch global":
            return master.switch_global(LssState(ask["mode"]))
        case "switch selective":
            return master.switch_selective(LssAddress(*map(word, ask["address"])))
        case "identify":
            vendor, product, *limits = map(word, ask["limits"])
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
            return master.fastscan([None if part is None else word(part) for part in ask["known"]])


def _talk_lss(given: Fields) -> Fields:
    """Run an LSS service of the master against recorded answers."""
    said: list[str] = []
    ends: Fields
    try:
        result, _ = play(_service(given["ask"]), _bus((row["hear"] for row in given["talk"]), said))
    except LssRefused as error:
        ends = {"error": error.code, "detail": error.detail}
    except NoAnswer:
        ends = {"no_answer": True}
    else:
        ends = _lss_result(given["ask"]["do"], result)
    return {"talk": [{"say": text} for text in said], "ends": ends}


def _lss_result(do: str, result: Any) -> Fields:
    if isinstance(result, LssAddress):
        return {"address": [f"{part:08X}" for part in result]}
    if do == "fastscan":
        return {"address": None}
    if do == "switch selective":
        return {"found": result}
    if do.startswith("identify"):
        return {"count": result}
    return {"node": result} if do == "inquire node" else {"done": True}


def _talk_gateway(given: Fields) -> Fields:
    """Execute lines of the ASCII gateway, one after the other. Comments of its answers are left out."""
    session = GatewaySession(given.get("net", 1))
    steps = []
    for step in given["lines"]:
        said: list[str] = []
        texts, _ = play(session.answer(step["line"]), _bus(step.get("hear", ()), said))
        steps.append({"say": said, "text": [text if '"' in text else text.partition(" #")[0] for text in texts]})
    return {"lines": steps}


def _boot(given: Fields) -> Fields:
    """Carry out the boot slave process of a CANopen manager with one node."""
    described, said = dict(given["slave"]), list[str]()
    for name in ("heartbeat", "guard_time"):
        described[name] = described.get(name, 0) / 1000
    for name in ("device_type", "vendor", "product", "revision", "serial"):
        described[name] = word(described.get(name, "0"))
    described["configuration"] = tuple(
        ConciseValue(*_address_of(row["object"]), octets(row["bytes"])) for row in described.pop("writes", ())
    )
    described["date"] = tuple(described.get("date", (0, 0)))
    result, _ = play(boot_slave(BootSlave(**described)), _bus((row["hear"] for row in given["talk"]), said))
    return {"talk": [{"say": text} for text in said], "ends": "ok" if result.error is None else result.error.name}


ANSWERS: Answers = {
    "sdo-talk": {"client": _sdo_client, "server": _sdo_server},
    "node-talk": {"run": _node_talk},
    "device": {"run": _device},
    "heartbeat-watch": {"run": _watch},
    "lss-talk": {"run": _talk_lss},
    "boot-slave": {"run": _boot},
    "gateway-309-3": {"run": _talk_gateway},
}
