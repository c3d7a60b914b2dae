"""Answers for the frames and messages of CANopen, from can-text to lss."""

from __future__ import annotations

from typing import Any

from barewire.canopen import sdo as messages
from barewire.canopen.abort_codes import AbortCode
from barewire.canopen.cob_ids import CobEntry, classify, cob_id, is_restricted
from barewire.canopen.datatypes import DAY, TimeOfDay
from barewire.canopen.emcy import Emergency
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import LssMessage
from barewire.canopen.nmt.messages import NmtCommand, NmtMessage, NodeState, consumer_entry
from barewire.canopen.pdo.mapping import MappedObject, PdoMapping
from barewire.canopen.sync import SyncMessage
from barewire.canopen.time_stamp import TimeStamp
from barewire.codecs import codec
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.vectors.answers.texts import hexed, number, octets
from barewire_workbench.vectors.questions import Fields

_COMMANDS = {
    "start": NmtCommand.START,
    "stop": NmtCommand.STOP,
    "enter pre-operational": NmtCommand.ENTER_PRE_OPERATIONAL,
    "reset node": NmtCommand.RESET_NODE,
    "reset communication": NmtCommand.RESET_COMMUNICATION,
}
_SDO: dict[str, Any] = {
    "initiate-upload": messages.InitiateUpload,
    "expedited-upload": messages.ExpeditedUpload,
    "upload-initiated": messages.UploadInitiated,
    "expedited-download": messages.ExpeditedDownload,
    "initiate-download": messages.InitiateDownload,
    "download-initiated": messages.DownloadInitiated,
    "abort": messages.Abort,
}


def frame_of(given: Fields) -> CanFrame:
    """Return the frame of `cob_id` and `data`; raise DecodeError for what no CAN frame can hold."""
    return CanFrame.parse(f"{given['cob_id']}#{given['data'].replace(' ', '')}")


def wire(frame: CanFrame) -> Fields:
    """Return a frame as `cob_id` and `data`."""
    return {"cob_id": identifier(frame.id, frame.extended), "data": hexed(frame.data)}


def identifier(value: int, extended: bool = False) -> str:
    """Return an identifier in the digits of its width."""
    return f"{value:0{8 if extended else 3}X}"


def write_can_text(given: Fields) -> Fields:
    """Write a frame as candump does."""
    fields = given["frame"]
    flags = {name: fields[name] for name in ("extended", "remote", "requested")}
    return {"text": str(CanFrame.checked(int(fields["id"], 16), octets(fields["data"]), **flags))}


def read_can_text(given: Fields) -> Fields:
    """Read a frame as candump writes it."""
    frame = CanFrame.parse(given["text"])
    return {
        "frame": {
            "id": identifier(frame.id, frame.extended),
            "data": hexed(frame.data),
            "extended": frame.extended,
            "remote": frame.remote,
            "requested": frame.requested,
        }
    }


def encode_cob_id(given: Fields) -> Fields:
    """Return the identifier of a service of a node."""
    return {"cob_id": identifier(cob_id(given["service"], given["node"]))}


def decode_cob_id(given: Fields) -> Fields:
    """Return the service and the node of an identifier."""
    found = classify(frame_of({"cob_id": given["cob_id"], "data": ""}))
    if found is None:
        raise DecodeError("mismatch", b"", 0, "not in the predefined connection set")
    return {"service": found[0].name, "node": found[1]}


def restricted(given: Fields) -> Fields:
    """Return whether an identifier must not be configured."""
    return {"restricted": is_restricted(int(given["cob_id"], 16))}


def encode_entry(given: Fields) -> Fields:
    """Return the 32 bits of a COB-ID in the object dictionary."""
    entry = CobEntry(int(given["identifier"], 16), given["extended"], given["bit30"], given["bit31"])
    return {"value": f"{entry.pack():08X}"}


def decode_entry(given: Fields) -> Fields:
    """Return the parts of a COB-ID in the object dictionary."""
    entry = CobEntry.unpack(int(given["value"], 16))
    return {
        "identifier": identifier(entry.identifier, entry.extended),
        "extended": entry.extended,
        "bit30": entry.bit30,
        "bit31": entry.bit31,
    }


def encode_nmt(given: Fields) -> Fields:
    """Return the frame of a command."""
    return wire(NmtMessage(_COMMANDS[given["command"]], given["node"]).encode())


def decode_nmt(given: Fields) -> Fields:
    """Return the command of a frame."""
    message = NmtMessage.decode(frame_of(given))
    return {"command": next(name for name, one in _COMMANDS.items() if one == message.command), "node": message.node}


def encode_state(given: Fields) -> Fields:
    """Return the frame of a heartbeat, a boot-up or an answer to node guarding."""
    return wire(NodeState(given["node"], int(given["state"], 16), given["toggle"]).encode())


def decode_state(given: Fields) -> Fields:
    """Return the state that a frame tells."""
    state = NodeState.decode(frame_of(given))
    name = "boot-up" if state.is_boot_up else state.name
    return {"node": state.node, "state": f"{state.state:02X}", "toggle": state.toggle, "name": name}


def encode_consumer(given: Fields) -> Fields:
    """Return one entry of 1016h."""
    word = 0 if given["node"] is None else given["node"] << 16 | given["milliseconds"]
    return {"value": str(word), "bytes": hexed(codec("u32", "DCBA").encode(word))}


def decode_consumer(given: Fields) -> Fields:
    """Return the node that an entry of 1016h watches, and its time."""
    entry = consumer_entry(int(codec("u32", "DCBA").decode(octets(given["bytes"]))))
    return (
        {"node": None, "milliseconds": None}
        if entry is None
        else {"node": entry[0], "milliseconds": round(entry[1] * 1000)}
    )


def encode_sdo(given: Fields) -> Fields:
    """Return the frame of an SDO message."""
    described = given["message"]
    fields: dict[str, Any] = {"index": int(described["index"], 16), "sub": int(described["sub"], 16)}
    if "data" in described:
        fields |= {"data": octets(described["data"]), "indicated": described["indicated"]}
    if "size" in described:
        fields["size"] = described["size"]
    if "code" in described:
        fields["code"] = int(described["code"], 16)
    request = given["side"] == "request"
    return wire(
        CanFrame(
            cob_id("SDO request" if request else "SDO answer", given["node"]),
            _SDO[described["name"]](**fields).encode(),
        )
    )


def decode_sdo(given: Fields) -> Fields:
    """Return the SDO message of a frame."""
    frame = frame_of(given)
    request = given["side"] == "request"
    service, node = classify(frame) or (None, 0)
    if service is None or service.name != ("SDO request" if request else "SDO answer"):
        raise DecodeError("mismatch", b"", 0, f"{given['cob_id']} is not the identifier of an SDO {given['side']}")
    message: Any = messages.decode_sdo_request(frame.data) if request else messages.decode_sdo_response(frame.data)
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


def _mapping(entries: list[Fields]) -> PdoMapping:
    return PdoMapping(
        MappedObject.of_word(int(row["entry"], 16), row["type"], f"object {at}") for at, row in enumerate(entries)
    )


def encode_pdo(given: Fields) -> Fields:
    """Pack objects into a PDO."""
    rows = given["entries"]
    values = {f"object {at}": number(row["value"]) for at, row in enumerate(rows) if row.get("value") is not None}
    return {"data": hexed(_mapping(rows).pack(values))}


def decode_pdo(given: Fields) -> Fields:
    """Unpack the objects of a PDO; a dummy entry has no value."""
    found = _mapping(given["entries"]).unpack(octets(given["data"]))
    values = [found.get(f"object {at}") for at in range(len(given["entries"]))]
    return {"entries": [{"value": None if value is None else _shown(value)} for value in values]}


def _shown(value: Any) -> str:
    return str(int(value)) if isinstance(value, bool) else str(value)


def encode_emcy(given: Fields) -> Fields:
    """Return the frame of an emergency."""
    code, register = int(given["code"], 16), int(given["register"], 16)
    return wire(Emergency(given["node"], code, register, octets(given["info"])).encode())


def decode_emcy(given: Fields) -> Fields:
    """Return the emergency of a frame."""
    found = Emergency.decode(frame_of(given))
    return {
        "node": found.node,
        "code": f"{found.code:04X}",
        "register": f"{found.register:02X}",
        "info": hexed(found.info),
    }


def encode_sync(given: Fields) -> Fields:
    """Return a SYNC with or without its counter."""
    return wire(SyncMessage(given["counter"]).encode())


def decode_sync(given: Fields) -> Fields:
    """Return the counter of a SYNC."""
    return {"counter": SyncMessage.decode(frame_of(given)).counter}


def encode_time(given: Fields) -> Fields:
    """Return the frame of a time."""
    if not 0 <= given["milliseconds"] < DAY:  # in barewire days and milliseconds are one number
        raise EncodeError(f"milliseconds {given['milliseconds']}: a day has 0 to {DAY - 1}")
    return wire(TimeStamp(TimeOfDay(given["days"] * DAY + given["milliseconds"])).encode())


def decode_time(given: Fields) -> Fields:
    """Return the time of a frame."""
    days, milliseconds = divmod(int(TimeStamp.decode(frame_of(given)).moment), DAY)
    return {"days": days, "milliseconds": milliseconds}


def encode_lss(given: Fields) -> Fields:
    """Return the frame of an LSS message."""
    return wire(LssMessage(int(given["service"], 16), octets(given["body"]), given["side"] == "answer").encode())


def decode_lss(given: Fields) -> Fields:
    """Return the LSS message of a frame."""
    found = LssMessage.decode(frame_of(given))
    return {
        "side": "answer" if found.answer else "request",
        "service": f"{found.service:02X}",
        "body": hexed(found.body),
    }
