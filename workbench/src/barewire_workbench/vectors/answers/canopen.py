"""Answers for the frames and messages of CANopen, from can-text to lss, and for texts: logs and an EDS."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from barewire.canopen import eds, sdo
from barewire.canopen.abort_codes import AbortCode
from barewire.canopen.cob_ids import CobEntry, classify, cob_id, is_restricted
from barewire.canopen.datatypes import BY_NAME, TimeOfDay
from barewire.canopen.eds.value_syntax import Expression, Formula
from barewire.canopen.emcy import Emergency
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import LssMessage
from barewire.canopen.nmt.messages import NmtCommand, NmtMessage, NodeState, consumer_entry
from barewire.canopen.pdo.mapping import MappedObject, PdoMapping
from barewire.canopen.pdo.multiplexed import Mpdo
from barewire.canopen.sync import SyncMessage
from barewire.canopen.time_stamp import TimeStamp
from barewire.codecs import codec
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.recordings.can_texts import read_asc, read_conformance_log
from barewire_workbench.recordings.candump import log_line, read_candump
from barewire_workbench.recordings.modbus_log.octets import parse_log
from barewire_workbench.recordings.model import Dropped, Recorded, RecordedItem
from barewire_workbench.vectors.answers.values import (
    Answers,
    days_of,
    hexed,
    milliseconds_of,
    number,
    octets,
    value_text,
    word,
)
from barewire_workbench.vectors.questions import Fields

# Frames and identifiers


def _frame_of(given: Fields) -> CanFrame:
    """Return the frame of `cob_id` and `data`; raise DecodeError for what no CAN frame can hold."""
    return CanFrame.parse(f"{given['cob_id']}#{given['data'].replace(' ', '')}")


def _wire(frame: CanFrame) -> Fields:
    return {"cob_id": _identifier(frame.id, frame.extended), "data": hexed(frame.data)}


def _identifier(value: int, extended: bool = False) -> str:
    return f"{value:0{8 if extended else 3}X}"


def _write_can_text(given: Fields) -> Fields:
    fields = given["frame"]
    flags = {name: fields[name] for name in ("extended", "remote", "requested")}
    return {"text": str(CanFrame.checked(word(fields["id"]), octets(fields["data"]), **flags))}


def _read_can_text(given: Fields) -> Fields:
    frame = CanFrame.parse(given["text"])
    flags = {name: getattr(frame, name) for name in ("extended", "remote", "requested")}
    return {"frame": {"id": _identifier(frame.id, frame.extended), "data": hexed(frame.data), **flags}}


def _decode_cob_id(given: Fields) -> Fields:
    service_and_node = classify(_frame_of({"cob_id": given["cob_id"], "data": ""}))
    if service_and_node is None:
        raise DecodeError("mismatch", b"", 0, "not in the predefined connection set")
    return {"service": service_and_node[0].name, "node": service_and_node[1]}


def _encode_entry(given: Fields) -> Fields:
    entry = CobEntry(word(given["identifier"]), given["extended"], given["bit30"], given["bit31"])
    return {"value": f"{entry.pack():08X}"}


def _decode_entry(given: Fields) -> Fields:
    entry = CobEntry.unpack(word(given["value"]))
    flags = {name: getattr(entry, name) for name in ("extended", "bit30", "bit31")}
    return {"identifier": _identifier(entry.identifier, entry.extended), **flags}


# NMT and error control

_NMT_COMMANDS = {
    "start": NmtCommand.START,
    "stop": NmtCommand.STOP,
    "enter pre-operational": NmtCommand.ENTER_PRE_OPERATIONAL,
    "reset node": NmtCommand.RESET_NODE,
    "reset communication": NmtCommand.RESET_COMMUNICATION,
}


def _decode_nmt(given: Fields) -> Fields:
    message = NmtMessage.decode(_frame_of(given))
    name = next(name for name, command in _NMT_COMMANDS.items() if command == message.command)
    return {"command": name, "node": message.node}


def _encode_state(given: Fields) -> Fields:
    return _wire(NodeState(given["node"], word(given["state"]), given["toggle"]).encode())


def _decode_state(given: Fields) -> Fields:
    state = NodeState.decode(_frame_of(given))
    name = "boot-up" if state.is_boot_up else state.name
    return {"node": state.node, "state": f"{state.state:02X}", "toggle": state.toggle, "name": name}


def _encode_consumer(given: Fields) -> Fields:
    """Return one entry of 1016h."""
    node, milliseconds = given["node"], given["milliseconds"]
    if not (1 <= node <= 127 and 1 <= milliseconds <= 0xFFFF):
        raise EncodeError(f"node {node}, {milliseconds} ms: expected 1..127, 1..65535 ms")
    entry = node << 16 | milliseconds
    return {"value": str(entry), "bytes": hexed(codec("u32", "DCBA").encode(entry))}


def _decode_consumer(given: Fields) -> Fields:
    entry = consumer_entry(int(codec("u32", "DCBA").decode(octets(given["bytes"]))))
    if entry is None:
        return {"node": None, "milliseconds": None}
    return {"node": entry[0], "milliseconds": round(entry[1] * 1000)}


# SDO and PDO

_SDO: dict[str, Any] = {
    "initiate-upload": sdo.InitiateUpload,
    "expedited-upload": sdo.ExpeditedUpload,
    "upload-initiated": sdo.UploadInitiated,
    "expedited-download": sdo.ExpeditedDownload,
    "initiate-download": sdo.InitiateDownload,
    "download-initiated": sdo.DownloadInitiated,
    "abort": sdo.Abort,
}


def _encode_sdo(given: Fields) -> Fields:
    described = given["message"]
    fields: dict[str, Any] = {"index": word(described["index"]), "sub": word(described["sub"])}
    if "data" in described:
        fields |= {"data": octets(described["data"]), "indicated": described["indicated"]}
    if "size" in described:
        fields["size"] = described["size"]
    if "code" in described:
        fields["code"] = word(described["code"])
    identifier = cob_id("SDO request" if given["side"] == "request" else "SDO answer", given["node"])
    return _wire(CanFrame(identifier, _SDO[described["name"]](**fields).encode()))


def _decode_sdo(given: Fields) -> Fields:
    frame, is_request = _frame_of(given), given["side"] == "request"
    service, node = classify(frame) or (None, 0)
    if service is None or service.name != ("SDO request" if is_request else "SDO answer"):
        raise DecodeError("mismatch", b"", 0, f"{given['cob_id']} is not the identifier of an SDO {given['side']}")
    message: Any = sdo.decode_sdo_request(frame.data) if is_request else sdo.decode_sdo_response(frame.data)
    name = next((name for name, kind in _SDO.items() if type(message) is kind), type(message).__name__)
    fields: Fields = {"name": name}
    if hasattr(message, "index"):
        fields |= {"index": f"{message.index:04X}", "sub": f"{message.sub:02X}"}
    if hasattr(message, "indicated"):
        fields |= {"data": hexed(message.data), "indicated": message.indicated}
    if hasattr(message, "size"):
        fields["size"] = message.size
    answer: Fields = {"node": node, "message": fields}
    if hasattr(message, "code"):
        fields["code"] = f"{message.code:08X}"
        answer["known"] = message.code in {int(code) for code in AbortCode}
    return answer


def _pdo_mapping(entries: list[Fields]) -> PdoMapping:
    return PdoMapping(
        MappedObject.of_word(word(row["entry"]), row["type"], f"object {at}") for at, row in enumerate(entries)
    )


def _encode_pdo(given: Fields) -> Fields:
    rows = given["entries"]
    values = {f"object {at}": number(row["value"]) for at, row in enumerate(rows) if row.get("value") is not None}
    return {"data": hexed(_pdo_mapping(rows).pack(values))}


def _decode_pdo(given: Fields) -> Fields:
    """Unpack the objects of a PDO; a dummy entry has no value."""
    by_name = _pdo_mapping(given["entries"]).unpack(octets(given["data"]))
    values = [by_name.get(f"object {at}") for at in range(len(given["entries"]))]
    return {"entries": [{"value": None if value is None else value_text(value)} for value in values]}


def _encode_mpdo(given: Fields) -> Fields:
    place = word(given["index"]), word(given["sub"])
    return {"bytes": hexed(Mpdo(given["addressing"], given["node"], *place, octets(given["data"])).pack())}


def _decode_mpdo(given: Fields) -> Fields:
    mpdo = Mpdo.decode(CanFrame(0x181, octets(given["bytes"])))
    place = {"index": f"{mpdo.index:04X}", "sub": f"{mpdo.sub:02X}"}
    return {"addressing": mpdo.addressing, "node": mpdo.node, **place, "data": hexed(mpdo.data)}


# Emergencies, times, LSS


def _encode_emcy(given: Fields) -> Fields:
    code, register = word(given["code"]), word(given["register"])
    return _wire(Emergency(given["node"], code, register, octets(given["info"])).encode())


def _decode_emcy(given: Fields) -> Fields:
    emergency = Emergency.decode(_frame_of(given))
    code, register = f"{emergency.code:04X}", f"{emergency.register:02X}"
    return {"node": emergency.node, "code": code, "register": register, "info": hexed(emergency.info)}


def _encode_time(given: Fields) -> Fields:
    return _wire(TimeStamp(TimeOfDay(milliseconds_of(given["days"], given["milliseconds"]))).encode())


def _encode_lss(given: Fields) -> Fields:
    return _wire(LssMessage(word(given["service"]), octets(given["body"]), given["side"] == "answer").encode())


def _decode_lss(given: Fields) -> Fields:
    message = LssMessage.decode(_frame_of(given))
    side = "answer" if message.answer else "request"
    return {"side": side, "service": f"{message.service:02X}", "body": hexed(message.body)}


# Texts: lines of recordings, and parts of an EDS or DCF

_READERS: dict[str, Callable[[str], Iterator[RecordedItem]]] = {
    "candump": read_candump,
    "asc": read_asc,
    "conformance": read_conformance_log,
}
_RULES_OF_FILES = {"not-listed", "no-object", "no-name"}
"""Rules about whole files, which a part of one breaks."""


def _read_lines(given: Fields) -> Fields:
    """Read the lines of a recording."""
    text = "\n".join(given["lines"]) + "\n"
    if given["format"] != "bytes":
        return {"items": [_item_fields(item) for item in _READERS[given["format"]](text)]}
    try:
        chunks = parse_log(text).chunks
    except DecodeError as error:
        return {"items": [{"unread": int(error.text.split()[1].rstrip(":"))}]}
    return {"items": [{"at": round(chunk.at * 1e6), "bytes": hexed(chunk.data)} for chunk in chunks]}


def _item_fields(item: RecordedItem) -> Fields:
    if isinstance(item, Recorded):
        frame = log_line(0.0, "x", item.frame).split()[2]
        fields: Fields = {"at": round(item.at * 1e6), "bus": item.bus, "frame": frame}
        return fields if item.sent is None else fields | {"sent": item.sent}
    if isinstance(item, Dropped):
        return {"bus": item.bus, "dropped": item.frames}
    return {"unread": item.line}


def _parsed_eds(given: Fields) -> eds.Eds:
    return eds.parse("\n".join(given["lines"]).encode())


def _read_eds(given: Fields) -> Fields:
    """Return the objects that lines of an EDS describe."""
    rows = [
        {
            "object": f"{described.index:04X}:{item.sub:02X}",
            "name": item.name,
            "type": BY_NAME[item.type].standard,
            "access": item.access,
            "default": _eds_value(item.default),
            "low": _eds_value(item.low),
            "high": _eds_value(item.high),
            "value": _eds_value(item.value),
            "mapped": item.pdo,
        }
        for described in _parsed_eds(given).objects.values()
        for item in described.items
    ]
    return {"objects": rows}


def _eds_value(value: Expression | None) -> str | None:
    if value is None:
        return None
    if isinstance(value, Formula):
        return f"$NODEID+{value.offset}"
    return hexed(value) if isinstance(value, bytes) else value_text(value)


def _check_eds(given: Fields) -> Fields:
    """Return the numbers of the lines that depart from CiA 306."""
    findings = _parsed_eds(given).diagnostics
    return {"wrong": sorted({finding.line for finding in findings if finding.rule not in _RULES_OF_FILES})}


ANSWERS: Answers = {
    "can-text": {"encode": _write_can_text, "decode": _read_can_text},
    "cob-id": {
        "encode": lambda given: {"cob_id": _identifier(cob_id(given["service"], given["node"]))},
        "decode": _decode_cob_id,
    },
    "cob-restricted": {"decode": lambda given: {"restricted": is_restricted(word(given["cob_id"]))}},
    "cob-entry": {"encode": _encode_entry, "decode": _decode_entry},
    "nmt": {
        "encode": lambda given: _wire(NmtMessage(_NMT_COMMANDS[given["command"]], given["node"]).encode()),
        "decode": _decode_nmt,
    },
    "node-state": {"encode": _encode_state, "decode": _decode_state},
    "heartbeat-consumer": {"encode": _encode_consumer, "decode": _decode_consumer},
    "sdo": {"encode": _encode_sdo, "decode": _decode_sdo},
    "pdo": {"encode": _encode_pdo, "decode": _decode_pdo},
    "mpdo": {"encode": _encode_mpdo, "decode": _decode_mpdo},
    "emcy": {"encode": _encode_emcy, "decode": _decode_emcy},
    "sync": {
        "encode": lambda given: _wire(SyncMessage(given["counter"]).encode()),
        "decode": lambda given: {"counter": SyncMessage.decode(_frame_of(given)).counter},
    },
    "time": {
        "encode": _encode_time,
        "decode": lambda given: days_of(int(TimeStamp.decode(_frame_of(given)).moment)),
    },
    "lss": {"encode": _encode_lss, "decode": _decode_lss},
    "log-line": {"decode": _read_lines},
    "eds": {"read": _read_eds, "check": _check_eds},
}
