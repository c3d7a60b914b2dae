"""Masters of Lely CANopen: booting a slave (CiA 302-2), LSS, node guarding and heartbeats of others."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable
from typing import Any

from adapter import NotOffered, octets
from adapter_canopen import ALWAYS, RATES, Row, listed, one_each, variables, watched
from bus import LELY, Node

OWN = 126
SECOND = 1_000_000


def array(index: int, node: int, kind: str, value: int) -> list[Row]:
    """Return the objects of an array with a value at the sub-index of a node."""
    return variables(index, [value if sub == node else 0 for sub in range(1, 128)], kind)


def master(rows: Iterable[Row] = (), *, lss: bool = False) -> Node:
    """Return an NMT master that is operational and starts nobody."""
    node = Node([*ALWAYS, *listed("UNSIGNED32", "rw", "1F80:00=13"), *rows], OWN, lss=lss)
    node.start()
    node.run_to(SECOND)
    node.said()
    return node


def dialogue(node: Node, rows: list[Row], ended: Callable[[], bool]) -> list[str]:
    """Let time pass until the end. After each frame that is said feed those that the case has for it."""
    frames: list[str] = []
    while not ended():
        new = node.said()
        for line in new:
            frames.append(line)
            for heard in rows[len(frames) - 1]["hear"] if len(frames) <= len(rows) else ():
                node.feed(heard)
        if not new:
            if node.next is None or node.now > 1000 * SECOND:
                break
            node.run_to(node.next)
    return frames + node.said()


BOOTED = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint8, ctypes.c_uint8, ctypes.c_char, ctypes.c_void_p)
EXPECTED = (("device_type", 0x1F84), ("vendor", 0x1F85), ("product", 0x1F86), ("revision", 0x1F87), ("serial", 0x1F88))


def boot_slave(question: dict[str, Any]) -> dict[str, Any]:
    """Boot a node as CiA 302-2 says."""
    slave, rows = question["slave"], question["talk"]
    number = slave["node"]
    how = 1 if slave.get("listed", True) else 0
    how |= 4 if slave.get("boot", True) else 0
    how |= 0x10 if slave.get("keep_alive") else 0
    if "guard_time" in slave:
        how |= slave["guard_time"] << 16 | 1 << 8
    objects = array(0x1F81, number, "UNSIGNED32", 0)
    for name, index in EXPECTED:
        if name in slave:
            objects += array(index, number, "UNSIGNED32", int(slave[name], 16))
    for index, value in zip((0x1F26, 0x1F27), slave.get("date", ())):
        objects += array(index, number, "UNSIGNED32", value)
    if "heartbeat" in slave:
        objects += watched({number: slave["heartbeat"]})
    if "writes" in slave:
        objects += [{**row, "type": "DOMAIN", "value": ""} for row in array(0x1F22, number, "DOMAIN", 0)]
    node = master(objects)
    LELY.co_dev_set_val(node.dev, 0x1F81, number, how.to_bytes(4, "little"), 4)
    if "writes" in slave:
        data = len(slave["writes"]).to_bytes(4, "little")
        for row in slave["writes"]:
            index, sub = row["object"].split(":")
            value = octets(row["bytes"])
            data += (
                int(index, 16).to_bytes(2, "little") + bytes([int(sub, 16)]) + len(value).to_bytes(4, "little") + value
            )
        LELY.co_dev_set_val(node.dev, 0x1F22, number, data, len(data))
    ends: list[str] = []
    booted = BOOTED(lambda _nmt, _id, _state, error, _data: ends.append(error.decode() if error != b"\0" else "ok"))
    LELY.co_nmt_set_boot_ind(node.nmt, booted, None)
    if LELY.co_nmt_boot_req(node.nmt, number, 1000):
        raise NotOffered("it boots no such node")
    frames = dialogue(node, rows, lambda: bool(ends))
    if "guard_time" in slave and ends == ["ok"] and len(frames) < len(rows):
        node.run_to(node.now + slave["guard_time"] * 1000)  # guarding begins with its first guard time
        frames += node.said()
    return {"talk": one_each(frames, rows), "ends": ends[0] if ends else "running"}


# LSS ---------------------------------------------------------------------------------------------------------------


class Address(ctypes.Structure):
    """The four numbers of 1018h."""

    _fields_ = [("count", ctypes.c_uint8), ("numbers", ctypes.c_uint32 * 4)]

    @classmethod
    def of(cls, texts: Iterable[str | None]) -> Address:
        return cls(4, (ctypes.c_uint32 * 4)(*(int(text or "0", 16) for text in texts)))


ANSWERED = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint8, ctypes.c_void_p)
DONE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint8, ctypes.c_uint8, ctypes.c_uint8, ctypes.c_void_p)
NUMBER = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint8, ctypes.c_uint32, ctypes.c_void_p)
NODE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint8, ctypes.c_uint8, ctypes.c_void_p)
FOUND = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint8, ctypes.POINTER(Address), ctypes.c_void_p)
IDENTITY = [f"co_lss_get_{name}_req" for name in ("vendor_id", "product_code", "revision", "serial_nr")]


def lss_talk(question: dict[str, Any]) -> dict[str, Any]:
    """Run a service of the LSS master."""
    ask, rows = question["ask"], question["talk"]
    node = master(lss=True)
    lss = ctypes.c_void_p(LELY.co_nmt_get_lss(node.nmt))
    LELY.co_lss_set_inhibit(lss, 1)
    if ask["do"] == "inquire address":
        return inquire_address(node, lss, rows)
    ends: list[dict[str, Any]] = []
    kept = ask_service(lss, ask, rows, ends.append)
    frames = dialogue(node, rows, lambda: bool(ends) or (kept is None and bool(LELY.co_lss_is_idle(lss))))
    return {"talk": one_each(frames, rows), "ends": ends[0] if ends else {"done": True}}


def refused(service: int, error: int, detail: int) -> dict[str, Any]:
    """Return how a service ended: 0 is no answer."""
    if not service:
        return {"no_answer": True}
    return {"error": error, "detail": detail} if error else {"done": True}


def ask_service(lss: Any, ask: dict[str, Any], rows: list[Row], end: Callable[[dict[str, Any]], None]) -> Any:
    """Begin a service and return its callback, None if it has none."""
    done = DONE(lambda _lss, service, error, detail, _data: end(refused(service, error, detail)))
    match ask["do"]:
        case "switch global":
            LELY.co_lss_switch_req(lss, ask["mode"])
            return None
        case "activate bit rate":
            LELY.co_lss_switch_rate_req(lss, ask["delay"])
            return None
        case "switch selective":
            kept: Any = ANSWERED(lambda _lss, service, _data: end({"found": bool(service)}))
            LELY.co_lss_switch_sel_req(lss, ctypes.byref(Address.of(ask["address"])), kept, None)
            return kept
        case "identify" | "identify unconfigured":
            if sum(len(row["hear"]) for row in rows) > 1:
                raise NotOffered("it does not say how many have answered")
            kept = ANSWERED(lambda _lss, service, _data: end({"count": int(bool(service))}))
            if ask["do"] == "identify":
                low, high = (Address.of(texts) for texts in limits(ask["limits"]))
                LELY.co_lss_id_slave_req(lss, ctypes.byref(low), ctypes.byref(high), kept, None)
            else:
                LELY.co_lss_id_non_cfg_slave_req(lss, kept, None)
            return kept
        case "inquire node":
            kept = NODE(
                lambda _lss, service, number, _data: end(
                    {"node": None if number == 255 else number} if service else {"no_answer": True}
                )
            )
            LELY.co_lss_get_id_req(lss, kept, None)
            return kept
        case "configure node":
            LELY.co_lss_set_id_req(lss, 255 if ask["node"] is None else ask["node"], done, None)
        case "configure bit rate":
            if ask["table"] or RATES[ask["entry"]] is None:
                raise NotOffered("bit rates of the table of CiA 305 only")
            LELY.co_lss_set_rate_req(lss, RATES[ask["entry"]], done, None)
        case "store":
            LELY.co_lss_store_req(lss, done, None)
        case _:
            return fastscan(lss, ask, end)
    return done


def limits(texts: list[str]) -> tuple[list[str], list[str]]:
    """Return the lowest and the highest address: vendor and product are the same in both."""
    vendor, product, low, high, first, last = texts
    return [vendor, product, low, first], [vendor, product, high, last]


def fastscan(lss: Any, ask: dict[str, Any], end: Callable[[dict[str, Any]], None]) -> Any:
    def found(_lss: Any, service: int, address: Any, _data: Any) -> None:
        numbers = [f"{number:08X}" for number in address.contents.numbers] if service else None
        end({"address": numbers})

    kept = FOUND(found)
    mask = Address.of(["0" if text is None else "FFFFFFFF" for text in ask["known"]])
    LELY.co_lss_fastscan_req(lss, ctypes.byref(Address.of(ask["known"])), ctypes.byref(mask), kept, None)
    return kept


def inquire_address(node: Node, lss: Any, rows: list[Row]) -> dict[str, Any]:
    """Ask for the four numbers, one after the other."""
    numbers: list[str | None] = []
    frames: list[str] = []
    for at, name in enumerate(IDENTITY):
        kept = NUMBER(lambda _lss, service, number, _data: numbers.append(f"{number:08X}" if service else None))
        getattr(LELY, name)(lss, kept, None)
        frames += dialogue(node, rows[at:], lambda count=at + 1: len(numbers) == count)  # type: ignore[misc]
        if numbers[-1:] in ([], [None]):
            return {"talk": one_each(frames, rows), "ends": {"no_answer": True}}
    return {"talk": one_each(frames, rows), "ends": {"address": numbers}}


# Watching ----------------------------------------------------------------------------------------------------------

EVENT = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint8, ctypes.c_int, ctypes.c_int, ctypes.c_void_p)
STATE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint8, ctypes.c_uint8, ctypes.c_void_p)


def heartbeat_watch(question: dict[str, Any]) -> dict[str, Any]:
    """Watch nodes: what it indicates, in the words of the vectors."""
    if "guard" in question["watch"]:
        raise NotOffered("it guards nodes that it has booted")
    node = master(watched(question["watch"]["heartbeat"]))
    events: list[str] = []
    active: set[int] = set()

    def missed(_nmt: Any, number: int, state: int, reason: int, _data: Any) -> None:
        if state == 0 and reason == 0 and number in active:
            events.append(f"{number} lost")
            active.discard(number)

    def changed(_nmt: Any, number: int, state: int, _data: Any) -> None:
        if state == 0:
            events.append(f"{number} booted")
            active.discard(number)
        else:
            events.append(f"{number} {'state' if number in active else 'active'} {state:02X}")
            active.add(number)

    kept = [EVENT(missed), STATE(changed)]
    LELY.co_nmt_set_hb_ind(node.nmt, kept[0], None)
    LELY.co_nmt_set_st_ind(node.nmt, kept[1], None)
    answer, begin = [], node.now
    for step in question["talk"]:
        node.run_to(begin + step["at"])
        for line in step["hear"]:
            node.feed(line)
        answer.append({"say": node.said(), "events": events[:]})
        events.clear()
    return {"talk": answer}


ANSWERS = {
    "boot-slave": {"run": boot_slave},
    "lss-talk": {"run": lss_talk},
    "heartbeat-watch": {"run": heartbeat_watch},
}
