"""The questions that a case asks: one for each operation of its kind that it has the fields for.

    case                {"id": "lrc-1", "result": "valid", "bytes": "01 04 00 00 08", "lrc": "F3"}
    kinds.json          "lrc": {"encode": {"given": ["bytes"], "gives": ["lrc"]}}
    question            {"id": "lrc-1.encode", "kind": "lrc", "do": "encode", "bytes": "01 04 00 00 08"}
    expected            {"lrc": "F3"}

A field of `given` with a question mark is left out of the question if the case does not have it; without its other
fields a case does not ask the question. Some fields are made of others: see `_MADE`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple, TypeAlias

Case: TypeAlias = Mapping[str, Any]
Fields: TypeAlias = dict[str, Any]

DESCRIPTION = frozenset(
    {"comment", "source", "printed", "why", "clause", "origin", "by", "confirmed_by", "unconfirmed"}
)
"""Fields that say something about a case, and change neither its questions nor the verdict."""


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
        do = operation.do
        # An invalid case asks for the direction of `fails`, or for both in a comparison.
        if do not in case.get("do", (do,)) or case.get("fails", "compare") not in ("compare", do):
            continue
        rows = _MADE[kind](do, case) if kind in _MADE else [case]
        for number, fields in enumerate(rows):
            question = _question(operation, fields)
            if question is not None:
                yield Question(case, kind, do, *question, number)


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

_NOISE = {"rtu": "FF 00", "ascii": "\x00\xffzz"}
"""What stands before a frame in one of its deliveries. A stream of TCP has no noise."""


def _frame(framing: str, do: str, case: Case) -> Iterable[Case]:
    if do != "receive":
        return [case]
    return _deliveries(framing, case) if case["result"] == "valid" else []


def _deliveries(framing: str, case: Case) -> Iterator[Case]:
    """Yield the ways to deliver a frame: whole, byte by byte, cut in two at each place, twice, behind noise.

    `pieces` are the bytes of each delivery, without a pause between two. `frames` are what must come out.
    """
    whole = case["text"] if framing == "ascii" else case["frame"].split()
    joined = "".join if framing == "ascii" else " ".join
    frame = {name: case[name] for name in ("transaction", "unit", "pdu") if name in case}
    ways: list[list[Any]] = [[whole], [whole[at : at + 1] for at in range(len(whole))]]
    ways += [[whole[:at], whole[at:]] for at in range(1, len(whole))]
    for way in ways:
        yield {**case, "pieces": [joined(piece) for piece in way], "frames": [frame]}
    if "uncountable" in case.get("flags", ()):  # its length is not in its bytes: behind others it is not found
        return
    yield {**case, "pieces": [joined([*whole, *whole])], "frames": [frame, frame]}
    if framing in _NOISE:
        yield {**case, "pieces": [joined([_NOISE[framing], joined(whole)])], "frames": [frame]}


def _talk(do: str, case: Case) -> Iterable[Case]:
    if do != "frames":
        return [case]
    events = [event for step in case["talk"] for event in step["events"]]
    # Bytes that are still held could become a frame in the silence that is added.
    return [] if case["held"] else [{**case, "frames": [event for event in events if "pdu" in event]}]


def _pdu(do: str, case: Case) -> Iterable[Case]:
    if "function" in case:
        return [case]
    has_two_bytes = case["pdu"].startswith(("2B", "AB FF"))
    return [{**case, "function": case["pdu"][: 5 if has_two_bytes else 2]}]


def _parameter(do: str, case: Case) -> Iterable[Case]:
    return [] if do == "decode" and not {"registers", "bytes"} & case.keys() else [case]


def _consumer(do: str, case: Case) -> Iterable[Case]:
    # Several numbers say that an entry is unused.
    return [] if do == "encode" and case["node"] is None else [case]


def _transfer(do: str, case: Case) -> Iterable[Case]:
    return [] if case.get("broken") == do else [_side(do, case)]


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
    # `never` is a wrong value, or a wrong end: "done", or the abort of another object.
    never = case.get("never")
    is_end = never == "done" or isinstance(never, dict)
    if case["ends"] == "done" and "value" not in fields:
        fields["arrived"] = case["value"] if is_end else _but_never(case["value"], case)
    if do == "client":
        ends = case["ends"] if case["ends"] == "done" else {"abort": case["ends"]["abort"]}
        fields["ends"] = _but_never(ends, case) if is_end else ends
    return fields


def _but_never(expected: Any, case: Case) -> Any:
    """Return what is expected, and what would be wrong in any case, `never` of the case."""
    return {"one_of": [expected], "never": [case["never"]]} if "never" in case else expected


_MADE: dict[str, Callable[[str, Case], Iterable[Case]]] = {
    **{f"{framing}-frame": partial(_frame, framing) for framing in ("rtu", "ascii", "tcp")},
    **dict.fromkeys(("rtu-talk", "ascii-talk", "tcp-talk"), _talk),
    "pdu": _pdu,
    "bits": lambda do, case: [{**case, "count": len(case["bits"].replace(" ", ""))}],
    "parameter": _parameter,
    "drive-command": lambda do, case: [{**case, "matches": True}],
    "sdo-talk": _transfer,
    "heartbeat-consumer": _consumer,
    "server-conformance": lambda do, case: [{**case, "framing": framing} for framing in case["framings"]],
    "device-conformance": lambda do, case: [{**case, "device": {}, "received": case["steps"]}],
}
"""By kind: the fields of each question of an operation, those of the case and those made of them."""
