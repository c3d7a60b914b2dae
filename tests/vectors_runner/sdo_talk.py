"""sdo-talk, object-value: whole SDO transfers, each side alone, and values that are not numbers."""

from __future__ import annotations

from typing import Any

from barewire.canopen.abort_codes import SdoAbort
from barewire.canopen.cob_ids import cob_id
from barewire.canopen.datatypes import DATA_TYPES, object_codec
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import Entry, ObjectDictionary
from barewire.canopen.sdo import BlockSettings, SdoServer, download, upload
from barewire.canopen.time_types import DAY, TimeDifference, TimeOfDay
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import EncodeError
from tests.vectors_runner.common import Case, check, octets

TYPES = {row.standard: row.name for row in DATA_TYPES}


def sdo_talk(case: Case) -> None:
    """Test each side with the frames of the other. A failing transfer is a valid case: `ends` has the abort."""
    assert case["result"] == "valid"
    if case.get("broken") != "client":
        run_client(case)
    if case.get("broken") != "server":
        run_server(case)


def run_client(case: Case) -> None:
    """Feed the lines of the server to our client: it must send the client's lines, and end as `ends` states."""
    node, place = case["node"], (int(case["index"], 16), int(case["sub"], 16))
    settings = case.get("block")
    block: BlockSettings | bool = BlockSettings(**settings) if settings else False
    value = octets(case["value"])
    conversation: Conversation[CanFrame, Any]
    if case["direction"] == "upload":
        conversation = upload(node, *place, block=block)
    else:
        conversation = download(node, *place, value, indicated=case.get("indicated", True), block=block)
    talk = list(case["talk"])
    whole = value if case["direction"] == "upload" else None
    wanted = whole if case["ends"] == "done" else case["ends"]["abort"]
    assert outcome(conversation, talk, node, in_blocks=bool(block)) == wanted
    assert talk == []


def outcome(conversation: Conversation[CanFrame, Any], talk: list[list[str]], node: int, *, in_blocks: bool) -> Any:
    """The result of the conversation: a value, or the code of the abort that it sends or receives. Consumes `talk`."""
    now = 0.0
    try:
        step = next(conversation)
        while True:
            if not isinstance(step, Listen):
                for item in step.items:
                    side, data = talk.pop(0)
                    assert side.startswith("client")
                    assert item == CanFrame(cob_id("SDO request", node), octets(data))
                step = conversation.send(Heard(None, now))
                continue
            while talk and talk[0][0] == "server lost":
                talk.pop(0)
            if talk and talk[0][0] == "server" and (step.until > now or not in_blocks):
                now += 0.001
                step = conversation.send(Heard(CanFrame(cob_id("SDO answer", node), octets(talk.pop(0)[1])), now))
            else:
                now = max(now, step.until)
                step = conversation.send(Heard(None, now))
    except StopIteration as stop:
        return stop.value
    except SdoAbort as abort:
        return f"{abort.code:08X}"


def run_server(case: Case) -> None:
    """Feed the lines of the client to our server: it must send the server's lines, and store a written value."""
    node, value = case["node"], octets(case["value"])
    written = case["direction"] == "download"
    objects = ObjectDictionary([Entry(0x2100, 0, "value", "domain", "rw", b"" if written else value)])
    server = SdoServer(node, objects, blksize=case.get("blksize", 127))
    now = 0.0
    sent: list[str] = []
    for side, data in case["talk"]:
        frame = CanFrame(cob_id("SDO request" if side.startswith("client") else "SDO answer", node), octets(data))
        if side.startswith("client"):
            assert sent == [], "the server sent more than the talk has"
            if side == "client":
                now += 0.001
                sent += [str(answer) for answer in server.feed(frame, now)]
            continue
        while not sent:
            assert server.deadline is not None, f"the server does not send {frame}"
            now = max(now, server.deadline)
            sent += [str(answer) for answer in server.feed(None, now)]
        assert sent.pop(0) == str(frame)
    assert sent == []
    if case["ends"] == "done" and written:
        assert objects.read(0x2100, 0) == value


def object_value(case: Case) -> None:
    """A value and the bytes that an SDO carries."""
    name = TYPES[case["type"]]
    codec = object_codec(name)

    def value() -> Any:
        given = case["value"]
        if name in ("octets", "domain"):
            return octets(given)
        if isinstance(given, dict):
            if not 0 <= given["milliseconds"] < DAY:
                raise EncodeError(f"a day has no {given['milliseconds']} ms")
            total = given["days"] * DAY + given["milliseconds"]
            return TimeOfDay(total) if name == "time_of_day" else TimeDifference(total)
        return given

    check(
        case,
        encode=lambda: codec.encode(value()),
        wire=octets(case.get("bytes", "")),
        decode=lambda: codec.decode(octets(case["bytes"])),
        value=value() if "value" in case else None,
    )
