"""The questions that a case asks: one for each operation of its kind that it has the fields for.

    case                {"id": "lrc-1", "result": "valid", "bytes": "01 04 00 00 08", "lrc": "F3"}
    kinds.json          "lrc": {"encode": {"given": ["bytes"], "gives": ["lrc"]}}
    question            {"id": "lrc-1.encode", "kind": "lrc", "do": "encode", "bytes": "01 04 00 00 08"}
    expected            {"lrc": "F3"}

A field of `given` with a question mark is left out of the question if the case does not have it; without its other
fields a case does not ask the question. Some fields are made of others here: see `_made`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, TypeAlias

Case: TypeAlias = Mapping[str, Any]
Fields: TypeAlias = dict[str, Any]

DESCRIPTION = frozenset({"comment", "source", "printed", "why", "clause", "origin", "confirmed_by", "unconfirmed"})
"""Fields that say something about a case, and change neither its questions nor the verdict."""

FRAMES = ("rtu-frame", "ascii-frame", "tcp-frame")
TALKS = ("rtu-talk", "ascii-talk", "tcp-talk")
_NOISE = {"rtu-frame": "FF 00", "ascii-frame": "\x00\xffzz"}
"""What stands before a frame in one of its deliveries. A stream of TCP has no noise."""


class Operation(NamedTuple):
    """What an implementation is asked to do with a case of one kind, from kinds.json.

    `given` are the fields of the question, `gives` those of the answer. `inside` names for a list of objects the
    keys that belong to the answer: they are left out of the question, and the answer has only them.
    """

    do: str
    given: tuple[str, ...]
    gives: tuple[str, ...]
    inside: Mapping[str, tuple[str, ...]]


class Question(NamedTuple):
    """One operation of one case: `given` for the implementation, `expected` for the judge."""

    case: Case
    kind: str
    do: str
    given: Fields
    expected: Fields
    number: int = 0

    @property
    def id(self) -> str:
        """The id of the case and the operation; a further question of the same operation has a number."""
        return f"{self.case['id']}.{self.do}" + (f".{self.number}" if self.number else "")

    def as_json(self) -> Fields:
        """Return the question as an adapter receives it."""
        return {"id": self.id, "kind": self.kind, "do": self.do, **self.given}


def operations(kinds: Mapping[str, Any], kind: str) -> tuple[Operation, ...]:
    """Return the operations of a kind."""
    return tuple(
        Operation(
            do,
            tuple(row["given"]),
            tuple(row["gives"]),
            {field: tuple(keys) for field, keys in row.get("inside", {}).items()},
        )
        for do, row in kinds[kind].items()
    )


def questions(kind: str, case: Case, of_kind: tuple[Operation, ...]) -> Iterator[Question]:
    """Yield the questions of a case."""
    for operation in of_kind:
        if operation.do not in case.get("do", (operation.do,)) or not _is_asked(operation.do, case):
            continue
        for number, fields in enumerate(_made(kind, operation.do, case)):
            question = _question(operation, fields)
            if question is not None:
                yield Question(case, kind, operation.do, *question, number)


def _is_asked(do: str, case: Case) -> bool:
    """Whether an invalid case asks for this direction: the one of `fails`, or both for a comparison."""
    return case.get("fails", "compare") in ("compare", do)


def _question(operation: Operation, case: Case) -> tuple[Fields, Fields] | None:
    """Return the given and the expected fields; None if a field that it needs is missing, or nothing is expected."""
    given: Fields = {}
    for name in operation.given:
        field = name.removesuffix("?")
        if field in case:
            given[field] = _without(case[field], operation.inside.get(field, ()))
        elif name == field:
            return None
    expected: Fields = {
        name: [{key: item[key] for key in operation.inside[name] if key in item} for item in case[name]]
        if name in operation.inside
        else case[name]
        for name in operation.gives
        if name in case
    }
    if not expected and case.get("fails") not in ("encode", "decode"):
        return None
    return given, expected


def _without(value: Any, keys: tuple[str, ...]) -> Any:
    """Return a list of objects without these keys; any other value as it is."""
    if not keys:
        return value
    return [{name: item for name, item in row.items() if name not in keys} for row in value]


# Fields that are made of others -----------------------------------------------------------------------------------


def _made(kind: str, do: str, case: Case) -> Iterator[Case]:
    """Yield the fields of each question of one operation: those of the case, and those made of them."""
    if kind in FRAMES and do == "receive":
        if case["result"] == "valid":
            yield from _deliveries(kind, case)
    elif kind in TALKS and do == "frames":
        if not case["held"]:
            events = [event for step in case["talk"] for event in step["events"]]
            yield {**case, "frames": [event for event in events if "pdu" in event]}
    elif kind == "sdo-talk":
        if case.get("broken") != do:
            yield _side(do, case)
    elif kind == "server-conformance":
        yield from ({**case, "framing": framing} for framing in case["framings"])
    elif kind == "device-conformance":
        yield {**case, "failure": None}
    elif kind == "bits":
        yield {**case, "count": len(case["bits"].replace(" ", ""))}
    elif kind == "pdu" and "function" not in case:
        two_bytes = case["pdu"].startswith(("2B", "AB FF"))
        yield {**case, "function": case["pdu"][: 5 if two_bytes else 2]}
    elif kind == "drive-command":
        yield {**case, "matches": True}
    elif kind == "parameter" and do == "decode" and not {"registers", "bytes"} & case.keys():
        return
    elif kind == "heartbeat-consumer" and do == "encode" and case["node"] is None:
        return  # several numbers say that an entry is unused
    else:
        yield case


def _deliveries(kind: str, case: Case) -> Iterator[Case]:
    """Yield the ways to deliver a frame: whole, byte by byte, cut in two at each place, twice, behind noise.

    `pieces` are the bytes of each delivery, without a pause between two. `frames` are what must come out.
    """
    whole = case["text"] if kind == "ascii-frame" else case["frame"].split()
    joined = "".join if kind == "ascii-frame" else " ".join
    frame = {name: case[name] for name in ("transaction", "unit", "pdu") if name in case}
    ways: list[list[Any]] = [[whole], [whole[at : at + 1] for at in range(len(whole))]]
    ways += [[whole[:at], whole[at:]] for at in range(1, len(whole))]
    for way in ways:
        yield {**case, "pieces": [joined(piece) for piece in way], "frames": [frame]}
    if "uncountable" in case.get("flags", ()):
        return
    twice = [joined([*whole, *whole]) if kind != "ascii-frame" else whole + whole]
    yield {**case, "pieces": twice, "frames": [frame, frame]}
    if kind in _NOISE:
        noise = _NOISE[kind]
        behind = noise + whole if kind == "ascii-frame" else f"{noise} {joined(whole)}"
        yield {**case, "pieces": [behind], "frames": [frame]}


def _side(do: str, case: Case) -> Case:
    """Return the fields of an SDO transfer for one side: in each step what it hears, and what it must say.

    Lines of the other side that are lost are not heard; own lines that are lost are said. A step that hears nothing
    lets time pass until the side says something; the first step of a client begins the transfer.
    """
    steps: list[dict[str, list[str]]] = [{"hear": [], "say": []}] if do == "client" else []
    for side, data in case["talk"]:
        name, _, lost = side.partition(" ")
        if name == do:
            if not steps:
                steps.append({"hear": [], "say": []})
            steps[-1]["say"].append(data)
        elif not steps or steps[-1]["say"]:
            steps.append({"hear": [] if lost else [data], "say": []})
        elif not lost:
            steps[-1]["hear"].append(data)
    downloads = case["direction"] == "download"
    fields = {name: value for name, value in case.items() if name not in ("talk", "value", "ends")}
    fields |= {"talk": steps}
    if downloads is (do == "client"):
        fields |= {"value": case["value"]}  # the side that has the value
    if case["ends"] == "done" and "value" not in fields:
        fields["arrived"] = case["value"]
    ends = case["ends"] if case["ends"] == "done" else {"abort": case["ends"]["abort"]}
    return fields | ({"ends": ends} if do == "client" else {})
