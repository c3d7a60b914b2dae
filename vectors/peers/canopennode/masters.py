"""Masters of CANopenNode, and both sides of an SDO transfer: LSS, consumer of heartbeats, gateway of CiA 309-3."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from typing import Any

from adapter import NotOffered, octets
from adapter_canopen import ALWAYS, RATES, one_each, place_of, watched
from bus import LIBRARY, NEEDED, SPACE, build, feed, run, said, settled, start, start_master


def lss_values(*numbers: int) -> Any:
    return (ctypes.c_uint32 * 8)(*numbers)


def address(texts: list[str]) -> list[int]:
    return [int(text, 16) for text in texts]


def lss_service(ask: dict[str, Any]) -> tuple[str, Any]:
    """Return the letter of a service and its values."""
    match ask["do"]:
        case "switch global":
            return "WG"[ask["mode"]], lss_values()
        case "activate bit rate":
            return "A", lss_values(ask["delay"])
        case "switch selective":
            return "S", lss_values(*address(ask["address"]))
        case "inquire address":
            return "I", lss_values()
        case "inquire node":
            return "N", lss_values()
        case "configure node":
            return "C", lss_values(255 if ask["node"] is None else ask["node"])
        case "configure bit rate":
            if ask["table"] or RATES[ask["entry"]] is None:
                raise NotOffered("bit rates of the table of CiA 305 only")
            return "B", lss_values(RATES[ask["entry"]])
        case "store":
            return "T", lss_values()
        case "fastscan":
            known = [int(text or "0", 16) for text in ask["known"]]
            return "F", lss_values(*known, *(0 if text is None else 2 for text in ask["known"]))
    raise NotOffered("its LSS master has no identify services")


def lss_end(ask: dict[str, Any], text: str) -> dict[str, Any]:
    """Return how a service ended, from its line: result, value, address."""
    result, value, *found = text.split()[1:]
    if int(result) in (-101, -102):
        raise NotOffered("it does not say which error it was")
    if int(result) == -1:
        return {"found": False} if ask["do"] == "switch selective" else {"no_answer": True}
    match ask["do"]:
        case "switch selective":
            return {"found": int(result) == 0}
        case "inquire address":
            return {"address": found}
        case "inquire node":
            return {"node": None if int(value) == 255 else int(value)}
        case "fastscan":
            return {"address": found if int(result) == 2 else None}
    return {"done": True} if int(result) == 0 else {"result": int(result)}


def lss_talk(question: dict[str, Any]) -> dict[str, Any]:
    """Run a service of the LSS master: each frame that it says is followed by those that it hears."""
    ask = question["ask"]
    letter, values = lss_service(ask)
    start_master()
    if letter in "WACBTIN":  # CANopenNode does these only after a switch to configuration
        LIBRARY.lss_start(ord("G" if letter in "WA" else "S"), lss_values())
        run(1000)
        feed("7E4#4400000000000000")
        said()
    LIBRARY.lss_start(ord(letter), values)
    rows, frames, end = question["talk"], [], ""
    for _ in range(40_000):
        run(0)
        lines = said()
        for line in lines:
            if line.startswith("lss "):
                end = line
            elif line.startswith("7E5"):
                frames.append(line)
                for heard in rows[len(frames) - 1]["hear"] if len(frames) <= len(rows) else ():
                    feed(heard)
        if end:
            break
        if not lines:
            run(10_000)
    return {"talk": one_each(frames, rows), "ends": lss_end(ask, end)}


def heartbeat_watch(question: dict[str, Any]) -> dict[str, Any]:
    """Watch nodes: the events of its consumer are said in its words."""
    if "guard" in question["watch"]:
        raise NotOffered("its master of node guarding reports no events, and knows no life time factor")
    nodes = question["watch"]["heartbeat"]
    heard = {int(line[1:3], 16) for step in question["talk"] for line in step["hear"] if line[0] == "7"}
    if heard - {int(node) for node in nodes}:
        raise NotOffered("it watches the nodes of 1016h only")
    start_master(*watched(nodes))
    LIBRARY.watch()
    now, answer = 0, []
    for step in question["talk"]:
        run(step["at"] - now)
        now = step["at"]
        for line in step["hear"]:
            feed(line)
        answer.append({"say": [], "events": list(events(said()))})
    return {"talk": answer}


def events(lines: list[str]) -> Iterable[str]:
    """Yield events in the words of the vectors."""
    started = ""
    for line in lines:
        kind, *words = line.split()
        if kind != "event":
            continue
        if words[1] == "started":
            started = words[0]
        elif words[1] != "state":
            yield " ".join(words)
        elif int(words[2]) > 0:  # neither unknown nor booted: those have events of their own
            yield f"{words[0]} {'active' if started == words[0] else 'state'} {int(words[2]):02X}"
            started = ""


def sdo_client(question: dict[str, Any]) -> dict[str, Any]:
    """Transfer a value as the client."""
    block, uploads = question.get("block"), question["direction"] == "upload"
    if block and ((block["size"] != 127 and uploads) or not block.get("crc", True) or block.get("switch")):
        raise NotOffered("blocks of 127 segments with a CRC, and the protocol is never switched")
    value, indicated = octets(question.get("value", "")), question.get("indicated", True)
    start_master()
    node, place = question["node"], (int(question["index"], 16), int(question["sub"], 16))
    how = (bool(block), value, len(value), indicated)
    LIBRARY.transfer_start(ord("U" if uploads else "D"), node, *place, *how)
    talk, ends, arrived = [], "", ""
    for step in question["talk"]:
        for line in step["hear"]:
            feed(f"{0x580 + node:03X}#{line.replace(' ', '')}")
        lines = settled(bool(step["hear"]))
        for line in lines:
            if line.startswith("sdo "):
                _, result, ends, *data = line.split()
                ends, arrived = ("" if int(result) == 0 else ends) or "done", "".join(data)
        talk.append({"say": [line[4:] for line in lines if line[3:4] == "#"]})
    answer = {"talk": talk, "ends": "running" if not ends else "done" if ends == "done" else {"abort": ends}}
    return {**answer, "arrived": arrived} if uploads and ends == "done" else answer


def sdo_server(question: dict[str, Any]) -> dict[str, Any]:
    """Serve a transfer."""
    if question.get("blksize", 127) != 127:
        raise NotOffered("it asks for blocks of 127 segments")
    node = question["node"]
    row = {"object": "2100:00", "type": "DOMAIN", "access": "rw", "value": question.get("value", "")}
    build([*ALWAYS, *NEEDED, row])  # no question is about another object that exists
    start(node)
    said()
    talk = []
    for step in question["talk"]:
        for line in step["hear"]:
            feed(f"{0x600 + node:03X}#{line.replace(' ', '')}")
        talk.append({"say": [line[4:] for line in settled(bool(step["hear"]))]})
    if question["direction"] == "upload":
        return {"talk": talk}
    data = ctypes.create_string_buffer(SPACE * 8)
    length = LIBRARY.get(*place_of(row), data)
    return {"talk": talk, "arrived": data.raw[:length].hex().upper()}


def gateway(question: dict[str, Any]) -> dict[str, Any]:
    """Give lines to the gateway of CiA 309-3."""
    if question.get("net", 1) != 1:
        raise NotOffered("it has one net")
    start_master()
    answer = []
    for row in question["lines"]:
        LIBRARY.gateway(f"{row['line']}\r\n".encode())
        answers = iter(row.get("hear", ()))
        says: list[str] = []
        texts: list[str] = []
        for _ in range(300):
            run(0)
            lines = said()
            for line in lines:
                if line.startswith("text "):
                    texts.append(line[5:].partition(" #")[0])
                else:
                    says.append(line)
                    for heard in next(answers, ()):
                        feed(heard)
            if not lines:
                run(10_000)
        answer.append({"say": says, "text": texts})
    return {"lines": answer}
