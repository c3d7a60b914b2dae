"""Part of the adapter of the `canopen` library: its object dictionary, its reader of EDS, its state machine of drives.

EDS_ANSWERS, DRIVE_ANSWERS, OBJECT_ANSWERS      the answers that main.py adds to its own
"""

from __future__ import annotations

from contextlib import suppress
from fractions import Fraction
from io import StringIO
from typing import Any

import canopen
from adapter import Answers, NotOffered, Refused, hexed, number, octets
from adapter_canopen import placed
from canopen.objectdictionary import ObjectDictionaryError, ODArray, ODRecord, ODVariable, datatypes
from canopen.objectdictionary.eds import import_eds
from canopen.profiles.p402 import BaseNode402, State402

EXACT = {"u": "UNSIGNED", "i": "INTEGER", "f": "REAL"}
NAMES = {
    value: name
    for name, value in vars(datatypes).items()
    if isinstance(value, int) and name.split("_")[-1].rstrip("0123456789") in ("BOOLEAN", "UNSIGNED", "INTEGER", "REAL")
} | {getattr(datatypes, name): name for name in ("VISIBLE_STRING", "OCTET_STRING", "UNICODE_STRING", "DOMAIN")}
UNITS_OF_TIME = {0x0C: "TIME_OF_DAY", 0x0D: "TIME_DIFFERENCE"}


def variable(kind: str, index: int = 0x2000, sub: int = 0) -> ODVariable:
    """Return an object of a type: "u16", "bool" or a name of the standard."""
    name = {"bool": "BOOLEAN"}.get(kind) or (EXACT.get(kind[0], "") + kind[1:] if kind[1:].isdigit() else kind)
    found = ODVariable(f"{index:04X}:{sub}", index, sub)
    found.data_type = getattr(datatypes, name, None)
    if found.data_type is None or name.startswith("TIME_"):
        raise NotOffered(f"canopen has no codec for {kind}")
    return found


def default(row: dict[str, Any]) -> Any:
    """Return the default value of an object."""
    value = row.get("value")
    if value is None or row["type"] in ("VISIBLE_STRING", "UNICODE_STRING"):
        return value
    return octets(value) if row["type"] in ("DOMAIN", "OCTET_STRING") else number(value)


def limit(text: str | None) -> int | None:
    """Return a limit as the library's reader of an EDS does: what is no whole number is none."""
    with suppress(TypeError, ValueError):
        return int(text or "")
    return None


def objects(rows: list[dict[str, Any]]) -> list[Any]:
    """Return the objects of a device as the library has them."""
    places = placed(rows)
    found: dict[int, Any] = {index: ODRecord(f"{index:04X}", index) for index, sub in places if sub}
    for (index, sub), row in places.items():
        one = variable(row["type"], index, sub)
        one.access_type, one.default = row["access"], default(row)
        one.min, one.max = (limit(row.get(name)) for name in ("low", "high"))
        if index in found:
            found[index].add_member(one)
        else:
            found[index] = one
    return [*found.values()]


# EDS ---------------------------------------------------------------------------------------------------------------


def read_eds(question: dict[str, Any]) -> dict[str, Any]:
    dictionary = import_eds(StringIO("\n".join(question["lines"]) + "\n"), 0)  # node 0: a formula gives its number
    found = []
    for index in sorted(dictionary.indices):
        one = dictionary.indices[index]
        found += [one] if isinstance(one, ODVariable) else [one.subindices[sub] for sub in sorted(one.subindices)]
    if any(isinstance(one, (ODRecord, ODArray)) for one in found):
        raise Refused("a record inside a record")
    return {"objects": [described(one) for one in found]}


def described(one: ODVariable) -> dict[str, Any]:
    """Return an object of an EDS as the vectors write it."""
    row: dict[str, Any] = {"object": f"{one.index:04X}:{one.subindex:02X}", "name": one.name}
    row["type"] = NAMES.get(one.data_type) or UNITS_OF_TIME.get(one.data_type or 0)
    row |= {"access": one.access_type, "mapped": one.pdo_mappable}
    row |= {"low": written(one, one.min), "high": written(one, one.max)}
    row["default"] = written(one, one.default, "$NODEID" in getattr(one, "default_raw", ""))
    row["value"] = written(one, one.value, "$NODEID" in getattr(one, "value_raw", ""))
    return row


def written(one: ODVariable, value: Any, formula: bool = False) -> str | None:
    """Return a value of an object as text; None if there is none, or if the library cannot send it."""
    if value is None or isinstance(value, bytes):
        return None if value is None else hexed(value)
    try:
        one.encode_raw(value)
    except (ValueError, ObjectDictionaryError):
        return None
    return f"$NODEID+{value}" if formula else str(value)


# Drives ------------------------------------------------------------------------------------------------------------


class SeenAll(Exception):
    """There is no further status word."""


class Drive(BaseNode402):
    """A drive of the library that shows one status word after the other, and keeps the control words."""

    def __init__(self, seen: list[str]) -> None:
        super().__init__(1, canopen.ObjectDictionary())
        self.seen, self.at = [int(word, 16) for word in seen], 0
        self.words: list[str | None] = [None] * len(seen)

    @property
    def statusword(self) -> int:
        return self.seen[self.at]

    @property
    def controlword(self) -> int:
        raise RuntimeError("is only written")

    @controlword.setter
    def controlword(self, value: int) -> None:
        self.words[self.at] = f"{value:04X}"

    def check_statusword(self) -> int:
        """Let the next status word come, where the library waits for one."""
        if self.at + 1 == len(self.seen):
            raise SeenAll
        self.at += 1
        return self.statusword


def drive_words(question: dict[str, Any]) -> dict[str, Any]:
    if question.get("stays"):
        raise NotOffered("the library does not know what quick stop does in the end")
    drive = Drive(question["seen"])
    with suppress(SeenAll):
        drive.state = question["goal"].upper()
    return {"words": drive.words}


def drive_states(question: dict[str, Any]) -> dict[str, Any]:
    state, before, states = question["state"].upper(), int(question["before"], 16), []
    for text in question["words"]:
        word = int(text, 16)
        rows = [
            after
            for (first, after), control in State402.TRANSITIONTABLE.items()
            if (first, control) == (state, word) and first not in ("START", "NOT READY TO SWITCH ON")
        ]
        if len(rows) != 1 or word == before or state == "FAULT REACTION ACTIVE":
            raise NotOffered("the table of the library has no transition from this state by this word")
        ((state,), before) = (rows, word)
        states.append(state.lower())
    return {"states": states}


def drive_state(question: dict[str, Any]) -> dict[str, Any]:
    node = BaseNode402(1, canopen.ObjectDictionary())
    node.tpdo_values[0x6041] = int(question["word"], 16)
    if node.state == "UNKNOWN":
        raise Refused("no state")
    return {"state": node.state.lower()}


def state_table(question: dict[str, Any]) -> dict[str, Any]:
    mask, masked = State402.SW_MASK[question["state"].upper()]
    return {"mask": f"{mask:04X}", "masked": f"{masked:04X}"}


# Values ------------------------------------------------------------------------------------------------------------


def scaled(question: dict[str, Any]) -> ODVariable:
    """Return the object of a parameter: the library multiplies its number by the factor."""
    parameter = question["parameter"]
    if "object" not in parameter or "bit" in parameter["object"] or parameter["type"] == "text":
        raise NotOffered("numbers of an object dictionary")
    found = variable(parameter["type"])
    found.factor = Fraction(parameter.get("scale", "1"))  # type: ignore[assignment]
    return found


def decode_parameter(question: dict[str, Any]) -> dict[str, Any]:
    place, data = scaled(question), octets(question["bytes"])
    return {"value": decimal(place.decode_phys(place.decode_raw(data)))}


def encode_parameter(question: dict[str, Any]) -> dict[str, Any]:
    place = scaled(question)
    if "modbus" in question["parameter"]:
        raise NotOffered("the value is in a register, too")
    return {"bytes": hexed(place.encode_raw(place.encode_phys(Fraction(question["value"]))))}


def decimal(value: Any) -> str:
    """Return a fraction as a decimal number."""
    if not isinstance(value, Fraction) or value.denominator == 1:
        return str(int(value) if isinstance(value, Fraction) else value)
    places = next(places for places in range(1, 20) if (value * 10**places).denominator == 1)
    return f"{'-' if value < 0 else ''}{abs(value.numerator) * 10**places // value.denominator}e-{places}"


EDS_ANSWERS: Answers = {"eds": {"read": read_eds}}
DRIVE_ANSWERS: Answers = {
    "drive-path": {"encode": drive_words, "decode": drive_states},
    "drive-state": {"decode": drive_state, "table": state_table},
}
OBJECT_ANSWERS: Answers = {"parameter": {"encode": encode_parameter, "decode": decode_parameter}}
