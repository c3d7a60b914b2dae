"""Devices: their objects are made those of CANopenNode, their steps are played to it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from adapter import NotOffered, octets
from adapter_canopen import ALWAYS, guarded, place_of, register_bits, variables
from bus import LIBRARY, NEEDED, build, feed, run, said, start, stored

CONTROL = {0: 0x1000, 1: 0, 2: 0x5000}
"""The NMT control flags for the error behaviours of 1029h."""


def first_server(node: int) -> list[dict[str, Any]]:
    """Return the object of the default SDO server, which CANopenNode needs if there is a second one."""
    return variables(0x1200, (0x600 + node, 0x580 + node), access="ro")


def requests(talk: Iterable[dict[str, Any]], node: int | None) -> set[bytes]:
    """Return the SDO requests to a node."""
    frames = [line.partition("#") for step in talk for line in step.get("hear", ())]
    mine = (octets(text) for ident, _, text in frames if ident == f"{0x600 + (node or 0):03X}" and "R" not in text)
    return {data for data in mine if len(data) == 8}


COB_IDS = {0x1005, 0x1012, 0x1014, *range(0x1200, 0x1300), *range(0x1400, 0x1600), *range(0x1800, 0x1A00)}
IDENTIFIES = ("7E5#46", "7E5#4C")


def check_offered(setup: dict[str, Any], talk: list[dict[str, Any]]) -> None:
    """Raise NotOffered for services that CANopenNode does not have."""
    objects = {place_of(row): row for row in setup["objects"]}
    heard = [line for step in talk for line in step.get("hear", ())]
    tpdos = [row for (index, sub), row in objects.items() if 0x1800 <= index < 0x1A00 and sub == 2]
    written = [data for data in requests(talk, setup["id"]) if data[0] >> 5 == 1]
    identifiers = [data[4:] for data in written if int.from_bytes(data[1:3], "little") in COB_IDS]
    identifiers += [stored(row)[0] for (index, _), row in objects.items() if index in COB_IDS]
    if any(len(data) == 4 and data[3] & 0x20 for data in identifiers):
        raise NotOffered("no identifiers of 29 bits")
    asked = any(line.startswith(("185#R", "285#R")) for line in heard)
    if asked or any(row["value"] in ("252", "253") for row in tpdos):
        raise NotOffered("no TPDO on request")
    if any(line.startswith(IDENTIFIES) for line in heard):
        raise NotOffered("an LSS slave without the identify services")
    if any("low" in row or "high" in row for row in objects.values()):
        raise NotOffered("its application checks limits")


def report(act: dict[str, Any], active: dict[int, int]) -> None:
    """Report an error, or its end. CANopenNode calls byte 3 the number of the error."""
    if "error" in act:
        code, info = int(act["error"], 16), octets(act.get("info", "")).ljust(5, b"\0")
        if info[0] in active.values() and code not in active:
            raise NotOffered("errors of CANopenNode differ in byte 3")
        active[code] = info[0]
        LIBRARY.error(1, info[0], code, int.from_bytes(info[1:], "little"), register_bits(code))
    elif int(act["clear"], 16) in active:
        LIBRARY.error(0, active.pop(int(act["clear"], 16)), 0, 0, 0)


def device(question: dict[str, Any]) -> dict[str, Any]:
    """Play the steps to a device."""
    setup, talk = question["device"], question["talk"]
    here = {place_of(row)[0] for row in setup["objects"]}
    check_offered(setup, talk)
    missing = [row for row in NEEDED if place_of(row)[0] not in here]
    if 0x1201 in here:
        missing += [row for row in first_server(setup["id"]) if 0x1200 not in here]
    asked = {int.from_bytes(data[1:3], "little") for data in requests(talk, setup["id"])}
    if asked & {place_of(row)[0] for row in missing}:
        raise NotOffered("CANopenNode has to have this object, the device of the case has not")
    build([*ALWAYS, *missing, *setup["objects"]])
    behaviour = next((int(row["value"]) for row in setup["objects"] if row["object"] == "1029:01"), 0)
    if wrong := start(setup["id"], lss=bool(setup.get("lss")), control=CONTROL[behaviour]):
        raise NotOffered(f"does not start with these objects: {wrong} {said()}")
    active: dict[int, int] = {}
    now, answer = 0, []
    for step in talk:
        run(step["at"] - now)
        now = step["at"]
        for line in step.get("hear", ()):
            feed(line)
        for act in step.get("act", ()):
            if "set" in act:
                index, sub = place_of({"object": act["set"]})
                row = next(row for row in setup["objects"] if place_of(row) == (index, sub))
                data = stored({**row, "value": act["value"]})[0]
                LIBRARY.set(index, sub, data, len(data))
            else:
                report(act, active)
            run(0)
        answer.append({"say": said()})
    return {"talk": answer}


def node_talk(question: dict[str, Any]) -> dict[str, Any]:
    """Play frames to a node: guarded, or an LSS slave."""
    setup, talk = question["node"], question["talk"]
    if any((step["hear"] or "").startswith(IDENTIFIES) for step in talk):
        raise NotOffered("an LSS slave without the identify services")
    build(guarded(setup, NEEDED))
    start(setup["id"], lss=2 if setup["machine"] == "lss-slave" else 0)
    said()
    now, answer = 0, []
    for step in talk:
        run(step["at"] - now)
        now = step["at"]
        if step["hear"]:
            feed(step["hear"])
        lines = [MEANS.get(line[:3] + line[4:8], line) for line in said()]
        lines = [line for line in lines if line[:3] == "7E4" or setup["machine"] != "lss-slave"]
        answer.append({"said": sorted(lines, key=lambda line: "#" in line)})
    return {"talk": answer}


MEANS = {"0853081": "lost", "0850000": "resolved"}
"""Its emergency messages in the words of the vectors."""
