"""Answers for sdo-talk, object-value and node-talk: whole transfers, values, and devices that are asked."""

from __future__ import annotations

from typing import Any

from barewire.canopen.abort_codes import SdoAbort
from barewire.canopen.cob_ids import cob_id
from barewire.canopen.datatypes import DATA_TYPES, DAY, TimeDifference, TimeOfDay, object_codec
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import LssAddress
from barewire.canopen.lss.slave import LssSlave
from barewire.canopen.nmt.error_control import GuardedNode
from barewire.canopen.nmt.messages import NmtState
from barewire.canopen.object_dictionary import Entry, ObjectDictionary
from barewire.canopen.sdo import BlockSettings, SdoServer, download, upload
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import EncodeError
from barewire_workbench.vectors.answers.texts import hexed, octets
from barewire_workbench.vectors.questions import Fields

_TYPES = {row.standard: row.name for row in DATA_TYPES}


def client(given: Fields) -> Fields:
    """Run our client against the lines of a server."""
    node, place = given["node"], (int(given["index"], 16), int(given["sub"], 16))
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
    except StopIteration as stop:
        arrived = {"arrived": hexed(stop.value)} if given["direction"] == "upload" else {}
        return {"talk": steps, "ends": "done", **arrived}
    return {"talk": steps, "ends": "running"}


def _play(conversation: Conversation[CanFrame, Any], talk: list[Fields], steps: list[Fields], node: int) -> None:
    """Feed the lines of each step, and then, until the client says something, nothing but time."""
    now, at = 0.0, 0
    waiting = list(talk[0]["hear"])
    step = next(conversation)
    while True:
        if not isinstance(step, Listen):
            steps[at]["say"] += [hexed(item.data) for item in step.items]
            step = conversation.send(Heard(None, now))
            continue
        if not waiting and steps[at]["say"] and at + 1 < len(talk) and step.until > now:
            at += 1
            waiting = list(talk[at]["hear"])
        if waiting:
            now += 0.001
            frame = CanFrame(cob_id("SDO answer", node), octets(waiting.pop(0)))
            step = conversation.send(Heard(frame, now))
        elif steps[at]["say"] and at + 1 == len(talk) and step.until > now + _PATIENCE:
            return
        else:
            now = max(now, step.until)
            step = conversation.send(Heard(None, now))


_PATIENCE = 60.0
"""Seconds of waiting after which a transfer does not end any more."""


_STORED = (0x2100, 0)
"""The only object of the server."""


def server(given: Fields) -> Fields:
    """Run our server against the lines of a client."""
    node, written = given["node"], given["direction"] == "download"
    objects = ObjectDictionary([Entry(*_STORED, "value", "domain", "rw", b"" if written else octets(given["value"]))])
    device = SdoServer(node, objects, blksize=given.get("blksize", 127))
    now = 0.0
    steps = []
    for step in given["talk"]:
        said: list[CanFrame] = []
        for line in step["hear"]:
            now += 0.001
            said += device.feed(CanFrame(cob_id("SDO request", node), octets(line)), now)
        if not said and device.deadline is not None:
            now = max(now, device.deadline)
            said += device.feed(None, now)
        while device.deadline is not None and device.deadline <= now:  # a long block is sent in several parts
            said += device.feed(None, now)
        steps.append({"say": [hexed(frame.data) for frame in said]})
    return {"talk": steps, "arrived": hexed(objects.read(*_STORED))} if written else {"talk": steps}


def encode_object(given: Fields) -> Fields:
    """Encode a value of the object dictionary."""
    name = _TYPES[given["type"]]
    value = given["value"]
    if name in ("octets", "domain"):
        value = octets(value)
    elif isinstance(value, dict):
        if not 0 <= value["milliseconds"] < DAY:
            raise EncodeError(f"milliseconds {value['milliseconds']}: a day has 0 to {DAY - 1}")
        total = value["days"] * DAY + value["milliseconds"]
        value = TimeOfDay(total) if name == "time_of_day" else TimeDifference(total)
    return {"bytes": hexed(object_codec(name).encode(value))}


def decode_object(given: Fields) -> Fields:
    """Decode a value of the object dictionary."""
    value: Any = object_codec(_TYPES[given["type"]]).decode(octets(given["bytes"]))
    if isinstance(value, bytes):
        return {"value": hexed(value)}
    if isinstance(value, (TimeOfDay, TimeDifference)):
        days, milliseconds = divmod(int(value), DAY)
        return {"value": {"days": days, "milliseconds": milliseconds}}
    return {"value": value}


def node(given: Fields) -> Fields:
    """Feed a guarded node or an LSS slave step by step."""
    setup = given["node"]
    machine: GuardedNode | LssSlave
    if setup["machine"] == "guarded-node":
        machine = GuardedNode(setup["id"])
        machine.state = NmtState.PRE_OPERATIONAL
        machine.life_time = setup.get("life_time", 0) / 1e6
    else:
        machine = LssSlave(LssAddress(*(int(part, 16) for part in setup["address"])), setup["id"])
    steps = []
    for step in given["talk"]:
        frame = None if step["hear"] is None else CanFrame.parse(step["hear"])
        found = machine.feed(frame, step["at"] / 1e6)
        steps.append({"said": [str(item) if isinstance(item, CanFrame) else item.kind for item in found]})
    return {"talk": steps}
