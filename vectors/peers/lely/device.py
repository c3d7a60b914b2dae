"""Devices: their objects are those of a DCF, their steps are played to them."""

from __future__ import annotations

import ctypes
from typing import Any

from adapter import NotOffered, hexed, octets
from adapter_canopen import ALWAYS, guarded, listed, place_of, register_bits, value_bytes, variables
from bus import LELY, Node

START = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint8, ctypes.c_void_p)
STORES = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_uint8, ctypes.c_uint16, ctypes.c_void_p)(lambda *_: 0)
TAKES_RATE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint16, ctypes.c_int, ctypes.c_void_p)(lambda *_: None)
NEEDED = listed("UNSIGNED16", "rw", "100C:00=65535") + listed("UNSIGNED8", "rw", "100D:00=255")
NEEDED += listed("UNSIGNED32", "rw", "1014:00=$NODEID+0x80 1F80:00=4")
"""Objects without which it has no guarding and no emergencies, and starts by itself (1F80h, CiA 302-2)."""
KEPT = {3: 4, 5: 8, 6: 8, 7: 8}
"""The bytes in which it keeps numbers of odd widths."""


def requested(question: dict[str, Any]) -> set[int]:
    """Return the indices that SDO requests name."""
    mine = f"{0x600 + (question['device']['id'] or 0):03X}#"
    lines = [line for step in question["talk"] for line in step.get("hear", ()) if line.startswith(mine)]
    return {int(line[8:10] + line[6:8], 16) for line in lines if len(line) > 10}


def device(question: dict[str, Any]) -> dict[str, Any]:
    """Play the steps to a device."""
    setup = question["device"]
    here = {place_of(row)[0] for row in setup["objects"]}
    missing = [row for row in NEEDED if place_of(row)[0] not in here]
    if requested(question) & {place_of(row)[0] for row in missing}:
        raise NotOffered("it has to have this object, the device of the case has not")
    if here & {0x1010, 0x1011}:
        raise NotOffered("its application stores the parameters")
    rows = [*ALWAYS, *missing, *setup["objects"]]
    node = Node(rows, setup["id"], lss=bool(setup.get("lss")))
    domains = [row for row in rows if row["type"] == "DOMAIN" and row.get("value")]
    for row in domains:
        data = octets(row["value"])
        LELY.co_dev_set_val(node.dev, *place_of(row), data, len(data))
    started = START(
        lambda nmt, command, _data: LELY.co_nmt_on_tpdo_event(ctypes.c_void_p(nmt), 0) if command == 1 else None
    )
    LELY.co_nmt_set_cs_ind(node.nmt, started, None)  # each start of operational is an event of its TPDOs
    node.start()
    lss = ctypes.c_void_p(LELY.co_nmt_get_lss(node.nmt))
    if setup.get("lss") and lss.value:
        LELY.co_lss_set_store_ind(lss, STORES, None)
        LELY.co_lss_set_rate_ind(lss, TAKES_RATE, None)
    active: dict[int, int] = {}
    answer = []
    for step in question["talk"]:
        node.run_to(step["at"])
        for line in step.get("hear", ()):
            node.feed(line)
        for act in step.get("act", ()):
            do(node, rows, act, active)
        answer.append({"say": node.said()})
    node.close()
    return {"talk": answer}


def do(node: Node, rows: list[dict[str, Any]], act: dict[str, Any], active: dict[int, int]) -> None:
    """Do what the application does."""
    emcy = ctypes.c_void_p(LELY.co_nmt_get_emcy(node.nmt))
    if "set" in act:
        index, sub = place_of({"object": act["set"]})
        kind = next(row["type"] for row in rows if place_of(row) == (index, sub))
        data = value_bytes(kind, act["value"], KEPT)
        before = ctypes.string_at(LELY.co_dev_get_val(node.dev, index, sub), len(data))
        LELY.co_dev_set_val(node.dev, index, sub, data, len(data))
        if data != before:
            LELY.co_dev_tpdo_event(node.dev, index, sub)
    elif not emcy.value:
        raise NotOffered("it has no EMCY producer with these objects")
    elif "error" in act:
        code = int(act["error"], 16)
        bits = register_bits(code)
        LELY.co_emcy_push(emcy, code, bits, octets(act.get("info", "")).ljust(5, b"\0"))
        active[code] = bits
    else:
        LELY.co_emcy_pop(emcy, None, None)


LIFE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p)


def node_talk(question: dict[str, Any]) -> dict[str, Any]:
    """Play frames to a node: guarded, or an LSS slave without storage."""
    setup, is_lss = question["node"], question["node"]["machine"] == "lss-slave"
    rows = guarded({"life_time": 65_535_000, **setup}, NEEDED)
    node = Node(rows, setup["id"], lss=is_lss)
    kept = LIFE(lambda _nmt, state, _data: node.sent.append("resolved" if state else "lost"))
    LELY.co_nmt_set_lg_ind(node.nmt, kept, None)
    node.start()
    node.said()
    answer = []
    for step in question["talk"]:
        node.run_to(step["at"])
        if step["hear"]:
            node.feed(step["hear"])
        lines = [line for line in node.said() if line[:3] == "7E4" or not is_lss]
        answer.append({"said": sorted(lines, key=lambda line: "#" in line)})
    return {"talk": answer}


def mpdo(question: dict[str, Any]) -> dict[str, Any]:
    """Send an MPDO of a device."""
    is_sam, node_id = question["addressing"] == "SAM", question["node"]
    if not (1 if is_sam else 0) <= node_id <= 127:
        raise NotOffered("the range of node-IDs is that of its caller")
    if len(octets(question["data"])) > 4:
        raise NotOffered("its caller gives it four bytes")
    own = node_id if is_sam else 126
    place, data = (int(question["index"], 16), int(question["sub"], 16)), octets(question["data"])
    rows = listed("UNSIGNED8", "rw", f"1800:02=255 1A00:00={254 if is_sam else 255}")
    rows += listed("UNSIGNED32", "rw", f"1800:01={0x180 + own}") + variables(0x1A00, [0] * 8)
    if is_sam:
        object_of = f"{place[0]:04X}:{place[1]:02X}"
        number = str(int.from_bytes(data, "little"))
        rows.append({"object": object_of, "type": "UNSIGNED32", "access": "rw", "value": number, "mapped": "TPDO"})
        rows += listed("UNSIGNED32", "rw", f"1FA0:01={1 << 24 | place[0] << 8 | place[1]}")
    node = Node([*ALWAYS, *NEEDED, *rows], own)
    node.start()
    node.feed("000#0100")
    node.run_to(1_000_000)
    node.said()
    tpdo = ctypes.c_void_p(LELY.co_nmt_get_tpdo(node.nmt, 1))
    if is_sam:
        LELY.co_sam_mpdo_event(tpdo, *place)
    else:
        LELY.co_dam_mpdo_event(tpdo, node_id, *place, data.ljust(4, b"\0"))
    frames = [line for line in node.said() if line.startswith(f"{0x180 + own:03X}#")]
    if not frames:
        raise NotOffered("it sends nothing for this object")
    return {"bytes": hexed(octets(frames[0][4:]))}


ANSWERS = {"device": {"run": device}, "node-talk": {"run": node_talk}, "mpdo": {"encode": mpdo}}
