"""can-text, cob-id, cob-restricted, cob-entry, nmt, node-state, heartbeat-consumer, sdo, pdo, emcy, sync."""

from __future__ import annotations

from typing import Any

from barewire.canopen import sdo as messages
from barewire.canopen.abort_codes import AbortCode
from barewire.canopen.cob_ids import CobEntry, classify, cob_id, is_restricted
from barewire.canopen.emcy.message import Emergency
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.heartbeat import NodeState, consumer_entry
from barewire.canopen.nmt.messages import NmtCommand, NmtMessage
from barewire.canopen.pdo.mapping import MappedObject, PdoMapping
from barewire.canopen.sync import SyncMessage
from barewire.codecs import Value, codec
from barewire.errors import DecodeError
from tests.vectors_runner.common import Case, check, octets, whole_or_float

COMMANDS = {
    "start": NmtCommand.START,
    "stop": NmtCommand.STOP,
    "enter pre-operational": NmtCommand.ENTER_PRE_OPERATIONAL,
    "reset node": NmtCommand.RESET_NODE,
    "reset communication": NmtCommand.RESET_COMMUNICATION,
}

SDO_MESSAGES: dict[str, Any] = {
    "initiate-upload": messages.InitiateUpload,
    "expedited-upload": messages.ExpeditedUpload,
    "upload-initiated": messages.UploadInitiated,
    "expedited-download": messages.ExpeditedDownload,
    "initiate-download": messages.InitiateDownload,
    "download-initiated": messages.DownloadInitiated,
    "abort": messages.Abort,
}


def line(case: Case) -> str:
    """`cob_id` and `data` of a case as the text of a frame."""
    return f"{case['cob_id']}#{case['data'].replace(' ', '')}"


def frame_of(case: Case) -> CanFrame:
    """The frame; a DecodeError for what no CAN frame can hold."""
    return CanFrame.parse(line(case))


def wire(case: Case) -> str | None:
    """The expected result of encode, as text."""
    return line(case) if "cob_id" in case else None


def can_text(case: Case) -> None:
    """A frame and its text."""
    fields = case.get("frame")
    frame = None
    if fields is not None:
        flags = {name: fields[name] for name in ("extended", "remote", "requested")}
        frame = CanFrame.checked(int(fields["id"], 16), octets(fields["data"]), **flags)
    check(case, encode=lambda: str(frame), wire=case["text"], decode=lambda: CanFrame.parse(case["text"]), value=frame)


def cob_ids(case: Case) -> None:
    """The identifier of a service of a node, and the service and node of an identifier."""

    def decode() -> tuple[str, int]:
        found = classify(frame_of({"cob_id": case["cob_id"], "data": ""}))
        if found is None:
            raise DecodeError("mismatch", b"", 0, "not in the predefined connection set")
        return found[0].name, found[1]

    check(
        case,
        encode=lambda: cob_id(case["service"], case["node"]),
        wire=int(case.get("cob_id", "0"), 16),
        decode=decode,
        value=(case.get("service"), case.get("node")),
    )


def cob_restricted(case: Case) -> None:
    """Whether an identifier is restricted, so that it must not be configured."""
    assert is_restricted(int(case["cob_id"], 16)) == case["restricted"]


def cob_entry(case: Case) -> None:
    """The 32 bits of a COB-ID in the object dictionary."""
    entry = CobEntry(int(case["identifier"], 16), case["extended"], case["bit30"], case["bit31"])
    word = int(case["value"], 16)
    check(case, encode=entry.pack, wire=word, decode=lambda: CobEntry.unpack(word), value=entry)


def nmt(case: Case) -> None:
    """A command to a node."""
    message = NmtMessage(COMMANDS[case["command"]], case["node"]) if "command" in case else None
    check(
        case,
        encode=lambda: str(NmtMessage(COMMANDS[case["command"]], case["node"]).encode()),
        wire=wire(case),
        decode=lambda: NmtMessage.decode(frame_of(case)),
        value=message,
    )


def node_state(case: Case) -> None:
    """Heartbeat, boot-up, answer to guarding."""
    state = NodeState(case["node"], int(case["state"], 16), case["toggle"]) if "state" in case else None
    check(
        case,
        encode=lambda: str(state.encode()) if state else None,
        wire=wire(case),
        decode=lambda: NodeState.decode(frame_of(case)),
        value=state,
    )
    if state is not None and case.get("name") is not None:
        assert state.name == {"boot-up": "initialising"}.get(case["name"], case["name"])
        assert state.is_boot_up == (case["name"] == "boot-up")


def heartbeat_consumer(case: Case) -> None:
    """One entry of 1016h."""
    entry = None if case["node"] is None else (case["node"], case["milliseconds"] / 1000)
    word = int(case["value"])
    assert consumer_entry(word) == entry
    assert codec("u32", "DCBA").encode(word) == octets(case["bytes"])


def sdo_message(described: dict[str, Any]) -> Any:
    """The message of a case."""
    fields: dict[str, Any] = {"index": int(described["index"], 16), "sub": int(described["sub"], 16)}
    if "data" in described:
        fields |= {"data": octets(described["data"]), "indicated": described["indicated"]}
    if "size" in described:
        fields["size"] = described["size"]
    if "code" in described:
        fields["code"] = int(described["code"], 16)
    return SDO_MESSAGES[described["name"]](**fields)


def sdo(case: Case) -> None:
    """One SDO frame."""
    request = case["side"] == "request"
    identifier = cob_id("SDO request" if request else "SDO answer", case["node"])

    def decode() -> Any:
        frame = frame_of(case)
        assert frame.id == identifier
        message = messages.decode_sdo_request(frame.data) if request else messages.decode_sdo_response(frame.data)
        if isinstance(message, messages.InitiateUpload):  # the requested transfer mode is in the bytes, not in the case
            return messages.InitiateUpload(message.index, message.sub)
        return message

    expected = sdo_message(case["message"]) if "message" in case else None
    check(
        case,
        encode=lambda: str(CanFrame(identifier, sdo_message(case["message"]).encode())),
        wire=wire(case),
        decode=decode,
        value=expected,
    )
    if expected is not None and "known" in case:
        assert (expected.code in {int(code) for code in AbortCode}) == case["known"]


def pdo(case: Case) -> None:
    """Objects packed bit by bit."""
    rows = list(enumerate(case["entries"]))

    def mapping() -> PdoMapping:
        return PdoMapping(MappedObject.of_word(int(row["entry"], 16), row["type"], f"object {at}") for at, row in rows)

    def value_of(row: dict[str, Any]) -> Value:
        value = whole_or_float(row["value"])
        if row["type"].startswith("f"):
            return codec(row["type"]).decode(codec(row["type"]).encode(value))
        return value

    values = {f"object {at}": value_of(row) for at, row in rows if row.get("value") is not None}
    check(
        case,
        encode=lambda: mapping().pack(values),
        wire=octets(case.get("data", "")),
        decode=lambda: mapping().unpack(octets(case["data"])),
        value=values,
    )


def emcy(case: Case) -> None:
    """An emergency."""
    fields = (int(case["code"], 16), int(case["register"], 16), octets(case["info"])) if "code" in case else None

    def decode() -> Emergency:
        found = Emergency.decode(frame_of(case))
        assert found.padded == (len(octets(case["data"])) < 8)
        return Emergency(found.node, found.code, found.register, found.info)

    check(
        case,
        encode=lambda: str(Emergency(case["node"], *fields).encode()) if fields else None,
        wire=wire(case),
        decode=decode,
        value=Emergency(case["node"], *fields) if fields else None,
    )


def sync(case: Case) -> None:
    """A SYNC with or without its counter."""
    check(
        case,
        encode=lambda: str(SyncMessage(case["counter"]).encode()),
        wire=wire(case),
        decode=lambda: SyncMessage.decode(frame_of(case)),
        value=SyncMessage(case.get("counter")),
    )
