"""tshark as an adapter: it reads frames, as the dissectors of Wireshark understand them.

It has no answers for encoding. A field that tshark does not show is left out, and then the case is not offered.
"""

from __future__ import annotations

import struct
import subprocess
from typing import Any

from adapter import NotOffered, Refused, hexed, octets, serve

CAN = 227
"""The link type of a capture with frames of SocketCAN."""
SDO = {
    (2, "request"): "initiate-upload",
    (1, "request"): "download",
    (2, "answer"): "upload",
    (3, "answer"): "download-initiated",
}
STATES = {0: "boot-up", 4: "stopped", 5: "operational", 127: "pre-operational"}
COMMANDS = {1: "start", 2: "stop", 128: "enter pre-operational", 129: "reset node", 130: "reset communication"}


class Tshark:
    """A tshark that reads a capture from a pipe and prints the fields of each packet."""

    def __init__(self, link: int, fields: list[str], *options: str) -> None:
        names = [word for field in fields for word in ("-e", field)]
        words = ["tshark", "-n", "-l", "-r", "-", "-T", "fields", "-E", "separator=/t", *options, *names]
        self.fields = fields
        self.process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self._write(struct.pack(">IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, link))

    def _write(self, data: bytes) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(data)
        self.process.stdin.flush()

    def ask(self, packet: bytes) -> dict[str, str]:
        """Return the fields of one packet that tshark shows."""
        self._write(struct.pack(">IIII", 1, 0, len(packet), len(packet)) + packet)
        assert self.process.stdout is not None
        values = self.process.stdout.readline().decode().rstrip("\n").split("\t")
        return {name: value for name, value in zip(self.fields, values) if value}


CANOPEN = [f"canopen.{name}" for name in ("node_id", "nmt_ctrl.cd", "nmt_ctrl.node_id", "nmt_guard.state")]
CANOPEN += [f"canopen.{name}" for name in ("nmt_guard.toggle", "sync.counter", "time_stamp_ms", "time_stamp_days")]
CANOPEN += [f"canopen.em.{name}" for name in ("err_code", "err_reg", "err_field")]
CANOPEN += [f"canopen.sdo.{name}" for name in ("ccs", "scs", "main_idx", "sub_idx", "e", "s", "n")]
CANOPEN += ["canopen.sdo.data.bytes", "canopen.lss.cs", "_ws.malformed", "_ws.expert", "canopen.cob_id", "_ws.col.Info"]
LSS = {  # the fields of a LSS message in their order, and the bytes of each
    **{f"lss.{name}": 1 for name in ("switch.mode", "nid", "bt.tbl_selector", "bt.tbl_index")},
    **{f"lss.{name}": 4 for name in ("addr.vendor", "addr.product", "addr.revision", "addr.revision_low")},
    **{f"lss.{name}": 4 for name in ("addr.revision_high", "addr.serial", "addr.serial_low", "addr.serial_high")},
    **{"lss.fastscan.id": 4, "lss.fastscan.check": 1, "lss.fastscan.sub": 1, "lss.fastscan.next": 1},
    **{f"lss.{name}.err_code": 1 for name in ("conf_id", "conf_bt", "store_conf")},
    **{"lss.spec_err": 1, "lss.abt_delay": 2},
}
CANOPEN += [f"canopen.{name}" for name in LSS]
SERVICES = {
    **{name: name for name in ("NMT", "SYNC", "EMCY")},
    **{f"PDO{number} ({way}x)": f"{way.upper()}PDO{number}" for number in range(1, 5) for way in "tr"},
    **{"TIME STAMP": "TIME", "Default-SDO (tx)": "SDO answer", "Default-SDO (rx)": "SDO request"},
    **{"NMT Error Control": "error control", "LSS (Master)": "LSS request", "LSS (Slave)": "LSS answer"},
}
bus: list[Tshark] = []


def on_can(question: dict[str, Any]) -> dict[str, str]:
    """Return the fields of a CAN frame without their prefix."""
    if not bus:
        bus.append(Tshark(CAN, CANOPEN, "-d", "can.subdissector,canopen"))
    data, extended = octets(question["data"]), len(question["cob_id"]) > 3
    found = bus[0].ask(struct.pack(">IB3x", int(question["cob_id"], 16) | extended << 31, len(data)) + data)
    if "_ws.malformed" in found:
        raise Refused("malformed packet")
    return {name.removeprefix("canopen."): value for name, value in found.items()}


def whole(text: str) -> int:
    return int(text, 0)


def need(found: dict[str, str], *names: str) -> None:
    """Raise NotOffered if tshark does not show a field: it takes the frame for something else."""
    for name in names:
        if name not in found:
            raise NotOffered(f"tshark shows no {name} here")


def nmt(question: dict[str, Any]) -> dict[str, Any]:
    found = on_can(question)
    need(found, "nmt_ctrl.cd", "nmt_ctrl.node_id")
    command = COMMANDS.get(whole(found["nmt_ctrl.cd"]))
    if command is None or len(octets(question["data"])) != 2:
        raise NotOffered("tshark shows a frame of any command and length")
    return {"command": command, "node": whole(found["nmt_ctrl.node_id"])}


def node_state(question: dict[str, Any]) -> dict[str, Any]:
    found = on_can(question)
    need(found, "nmt_guard.state", "nmt_guard.toggle", "node_id")
    state = whole(found["nmt_guard.state"])
    if state not in STATES or len(octets(question["data"])) != 1:
        raise NotOffered("tshark shows a frame of any state and length")
    toggle = whole(found["nmt_guard.toggle"]) != 0
    return {"node": whole(found["node_id"]), "state": f"{state:02X}", "toggle": toggle, "name": STATES[state]}


def sync(question: dict[str, Any]) -> dict[str, Any]:
    found = on_can(question)
    if question["data"]:
        need(found, "sync.counter")
    if len(octets(question["data"])) > 1 or whole(found.get("sync.counter", "1")) not in range(1, 241):
        raise NotOffered("tshark shows a frame of any counter and length")
    return {"counter": whole(found["sync.counter"]) if question["data"] else None}


def time_of_day(question: dict[str, Any]) -> dict[str, Any]:
    found = on_can(question)
    need(found, "time_stamp_ms", "time_stamp_days")
    if len(octets(question["data"])) != 6:
        raise NotOffered("tshark shows a frame of any length")
    return {"days": whole(found["time_stamp_days"]), "milliseconds": whole(found["time_stamp_ms"])}


def emcy(question: dict[str, Any]) -> dict[str, Any]:
    found = on_can(question)
    need(found, "em.err_code", "em.err_reg", "em.err_field", "node_id")
    code, register = whole(found["em.err_code"]), whole(found["em.err_reg"])
    field = bytes.fromhex(found["em.err_field"].replace(":", ""))
    row = {"node": whole(found["node_id"]), "code": f"{code:04X}", "register": f"{register:02X}"}
    return {**row, "info": hexed(field)}


def sdo(question: dict[str, Any]) -> dict[str, Any]:
    found = on_can(question)
    specifier = whole(found.get("sdo.ccs", found.get("sdo.scs", "9")))
    need(found, "sdo.main_idx", "sdo.sub_idx", "node_id")
    index, sub = whole(found["sdo.main_idx"]), whole(found["sdo.sub_idx"])
    message: dict[str, Any] = {"index": f"{index:04X}", "sub": f"{sub:02X}"}
    if specifier == 4:
        raise NotOffered("which abort code is known, tshark says only as text")
    name = SDO.get((specifier, question["side"]))
    if name is None:
        raise NotOffered("tshark shows it as another message")
    if name in ("upload", "download"):
        need(found, "sdo.e", "sdo.s")
        expedited, indicated = (found[field] in ("1", "True") for field in ("sdo.e", "sdo.s"))
        data = bytes.fromhex(found.get("sdo.data.bytes", "").replace(":", ""))
        if expedited:
            unused = whole(found.get("sdo.n", "0")) if indicated else 0
            message |= {"data": hexed(data[: len(data) - unused]), "indicated": indicated}
        elif indicated:
            raise NotOffered("tshark shows a size as bytes")
        else:
            message["size"] = None  # it shows that none is indicated
        names = {"upload": ("upload-initiated", "expedited-upload")}
        name = names.get(name, ("initiate-download", "expedited-download"))[expedited]
    return {"node": whole(found["node_id"]), "message": {"name": name, **message}}


def cob_id(question: dict[str, Any]) -> dict[str, Any]:
    found = on_can({"cob_id": question["cob_id"], "data": "00 " * 8})
    service = SERVICES.get(found["_ws.col.Info"].partition(":")[0].partition(" [")[0])
    if service is None:
        raise Refused(found["_ws.col.Info"])
    return {"service": service, "node": 0 if service.startswith("LSS") else whole(found["node_id"])}


def lss(question: dict[str, Any]) -> dict[str, Any]:
    found = on_can(question)
    side = {"LSS request": "request", "LSS answer": "answer"}.get(
        SERVICES.get(found["_ws.col.Info"].partition(":")[0], "")
    )
    if side is None:
        raise Refused("no LSS")
    if "Unknown" in found["_ws.col.Info"]:
        raise Refused("no command")
    body = b"".join(whole(found[name]).to_bytes(size, "little") for name, size in LSS.items() if name in found)
    return {"side": side, "service": f"{whole(found['lss.cs']):02X}", "body": hexed(body.ljust(7, bytes(1)))}


version = subprocess.run(["tshark", "--version"], capture_output=True, text=True, check=True).stdout.split()[2]
CAN_ANSWERS = {"nmt": nmt, "node-state": node_state, "sync": sync, "time": time_of_day, "emcy": emcy, "sdo": sdo}
CAN_ANSWERS |= {"cob-id": cob_id, "lss": lss}
serve("tshark", {kind: {"decode": function} for kind, function in CAN_ANSWERS.items()}, version.rstrip("."))
