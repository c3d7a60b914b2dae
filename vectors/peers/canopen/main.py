"""The `canopen` library as an adapter: its nodes on a network that only records what they send."""

from __future__ import annotations

import logging
import queue
from datetime import UTC, datetime, timedelta
from typing import Any

import canopen
from adapter import NotOffered, hexed, number, octets, serve
from adapter_canopen import ALWAYS
from canopen import objectdictionary
from canopen.lss import LssMaster
from canopen.objectdictionary import ODVariable
from canopen.pdo.base import PdoMap
from canopen.sdo import SdoAbortedError, SdoCommunicationError
from canopen_device import DEVICE_ANSWERS
from canopen_objects import DRIVE_ANSWERS, EDS_ANSWERS, OBJECT_ANSWERS, objects, variable

logging.disable()
COMMANDS = {"start": "OPERATIONAL", "stop": "STOPPED", "enter pre-operational": "PRE-OPERATIONAL"}
COMMANDS |= {"reset node": "RESET", "reset communication": "RESET COMMUNICATION"}


class Recorder(canopen.Network):
    """A network without a bus: keeps the frames that are sent."""

    def __init__(self) -> None:
        super().__init__()
        self.sent: list[tuple[int, bytes]] = []

    def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
        self.sent.append((can_id, bytes(data)))

    def frame(self) -> dict[str, Any]:
        """Return the first frame that was sent, as the vectors write it."""
        cob_id, data = self.sent[0]
        return {"cob_id": f"{cob_id:03X}", "data": hexed(data)}


def local_node(node: int, *objects: ODVariable) -> tuple[Recorder, Any]:
    """Return a device with these objects."""
    network, od = Recorder(), canopen.ObjectDictionary()
    for one in objects:
        od.add_object(one)
    return network, network.create_node(node, od)


def remote_node(node: int) -> tuple[Recorder, Any]:
    """Return a node as its master sees it."""
    network = Recorder()
    return network, network.add_node(node, canopen.ObjectDictionary())


def encode_nmt(question: dict[str, Any]) -> dict[str, Any]:
    # the network itself commands all nodes
    network, node = remote_node(question["node"]) if question["node"] else ((alone := Recorder()), alone)
    node.nmt.state = COMMANDS[question["command"]]
    return network.frame()


def encode_sync(question: dict[str, Any]) -> dict[str, Any]:
    network = Recorder()
    network.sync.transmit(question["counter"])
    return network.frame()


def encode_time(question: dict[str, Any]) -> dict[str, Any]:
    network = Recorder()
    when = datetime(1984, 1, 1, tzinfo=UTC) + timedelta(days=question["days"], milliseconds=question["milliseconds"])
    network.time.transmit(when.timestamp())
    return network.frame()


def encode_emcy(question: dict[str, Any]) -> dict[str, Any]:
    network, node = local_node(question["node"])
    node.emcy.send(int(question["code"], 16), int(question["register"], 16), octets(question["info"]))
    return network.frame()


EVERYBODY = Recorder()
for each in range(1, 128):
    EVERYBODY.add_node(each, canopen.ObjectDictionary())


def decode_emcy(question: dict[str, Any]) -> dict[str, Any]:
    for node in EVERYBODY.values():
        node.emcy.reset()
    EVERYBODY.notify(int(question["cob_id"], 16), bytearray(octets(question["data"])), 0.0)
    for node in EVERYBODY.values():
        for one in node.emcy.log:
            found = {"node": node.id, "code": f"{one.code:04X}", "register": f"{one.register:02X}"}
            return {**found, "info": hexed(one.data)}
    raise ValueError("nobody took it for an emergency")


def cob_id(question: dict[str, Any]) -> dict[str, Any]:
    network, remote = remote_node(question["node"] or 1)
    _, local = local_node(question["node"] or 1)
    services = {
        "SDO request": remote.sdo.rx_cobid,
        "SDO answer": remote.sdo.tx_cobid,
        "EMCY": local.emcy.cob_id,
        "SYNC": network.sync.cob_id,
        "TIME": network.time.cob_id,
        "LSS request": LssMaster.LSS_TX_COBID,
        "LSS answer": LssMaster.LSS_RX_COBID,
    }
    if question["service"] not in services:
        raise NotOffered("no attribute of canopen says this identifier")
    return {"cob_id": f"{services[question['service']]:03X}"}


def encode_lss(question: dict[str, Any]) -> dict[str, Any]:
    network, master, service = Recorder(), LssMaster(), int(question["service"], 16)
    master.network, master.RESPONSE_TIMEOUT = network, 0.001
    body = octets(question["body"])
    calls = {
        0x04: lambda: master.send_switch_state_global(body[0]),
        0x11: lambda: master.configure_node_id(body[0]),
        0x13: lambda: master.configure_bit_timing(body[1]),
        0x15: lambda: master.activate_bit_timing(int.from_bytes(body[:2], "little")),
        0x17: master.store_configuration,
        0x4C: master.send_identify_non_configured_remote_slave,
        0x5E: master.inquire_node_id,
    }
    if 0x5A <= service <= 0x5D:
        calls[service] = lambda: master.inquire_lss_address(service)
    if question["side"] != "request" or service not in calls:
        raise NotOffered("canopen has no function that sends only this")
    try:
        calls[service]()
    except canopen.lss.LssError:
        if not network.sent:
            raise
    return network.frame()


def pdo_map(question: dict[str, Any]) -> PdoMap:
    """Return a PDO with these entries."""
    rows = [(int(row["entry"][:4], 16), int(row["entry"][4:6], 16), row["type"]) for row in question["entries"]]
    od = canopen.ObjectDictionary()
    for index, sub, kind in rows:
        if sub:
            record = od.get(index) or objectdictionary.ODRecord(f"{index:04X}", index)
            record.add_member(variable(kind, index, sub))
            od.add_object(record)
        else:
            od.add_object(variable(kind, index))
    node = canopen.LocalNode(1, od)
    found = PdoMap(node.tpdo, None, None)
    found.cob_id = 0x181
    for (index, sub, _), row in zip(rows, question["entries"]):
        found.add_variable(index, sub, int(row["entry"][6:], 16))
    return found


def encode_pdo(question: dict[str, Any]) -> dict[str, Any]:
    found = pdo_map(question)
    for one, row in zip(found, question["entries"]):
        one.raw = number(row["value"])
    return {"data": hexed(found.data)}


def decode_pdo(question: dict[str, Any]) -> dict[str, Any]:
    found = pdo_map(question)
    found.on_message(found.cob_id, bytearray(octets(question["data"])), 0.0)
    return {"entries": [{"value": str(int(one.raw) if isinstance(one.raw, bool) else one.raw)} for one in found]}


def encode_object(question: dict[str, Any]) -> dict[str, Any]:
    value = question["value"]
    if question["type"] in ("OCTET_STRING", "DOMAIN"):
        value = octets(value)
    return {"bytes": hexed(variable(question["type"]).encode_raw(value))}


def decode_object(question: dict[str, Any]) -> dict[str, Any]:
    value = variable(question["type"]).decode_raw(octets(question["bytes"]))
    return {"value": hexed(value) if isinstance(value, bytes) else value}


def number_object(question: dict[str, Any]) -> ODVariable:
    """Return an object of the type of a number."""
    if question["order"] != "DCBA":
        raise NotOffered("CANopen has one order of bytes")
    return variable(question["type"])


def encode_number(question: dict[str, Any]) -> dict[str, Any]:
    return {"bytes": hexed(number_object(question).encode_raw(number(question["value"])))}


def decode_number(question: dict[str, Any]) -> dict[str, Any]:
    return {"value": str(number_object(question).decode_raw(octets(question["bytes"])))}


def encode_sdo(question: dict[str, Any]) -> dict[str, Any]:
    message, node = question["message"], question["node"]
    place = int(message["index"], 16), int(message["sub"], 16)
    data, name, size = octets(message.get("data", "")), message["name"], message.get("size")
    if question["side"] == "answer":
        return sdo_answer(node, place, name, data, size, message)
    network, remote = remote_node(node)
    remote.sdo.RESPONSE_TIMEOUT = 0.001
    try:
        if name == "initiate-upload":
            remote.sdo.upload(*place)
        elif name == "expedited-download" and message.get("indicated", True):
            remote.sdo.download(*place, data)
        elif name == "initiate-download":
            remote.sdo.open(*place, "wb", size=size, force_segment=True, buffering=0)
        elif name == "abort":
            remote.sdo.abort(int(message["code"], 16))
        else:
            raise NotOffered("the client of canopen does not send this")
    except SdoCommunicationError:
        pass  # nobody answers
    return network.frame()


def sdo_answer(node: int, place: tuple[int, int], name: str, data: bytes, size: Any, message: Any) -> dict[str, Any]:
    """Return the first answer of the server to a request that leads to this message."""
    network, local = local_node(node, variable("DOMAIN", *place))
    if place[1] or (name == "upload-initiated" and (size is None or not 4 < size < 1 << 20)):
        raise NotOffered("the server always says the size, and is asked here for simple variables")
    request = {"download-initiated": "22", "abort": "40"}.get(name, "40")
    local.data_store = {place[0]: {place[1]: bytes(size or 1) if name != "expedited-upload" else data}}
    network.notify(local.sdo.rx_cobid, bytearray(octets(request) + place[0].to_bytes(2, "little") + bytes(5)), 0.0)
    if name == "abort":
        network.sent.clear()
        local.sdo.abort(int(message["code"], 16))
    elif name == "expedited-upload" and not message.get("indicated", True):
        raise NotOffered("the server always says the size")
    return network.frame()


class Talk(queue.Queue):
    """The answers that a client waits for: those of the steps, one step after the other."""

    def __init__(self, steps: list[dict[str, Any]]) -> None:
        super().__init__()
        self.steps, self.said, self.waiting = steps, [[]], [*steps[0]["hear"]]

    def empty(self) -> bool:
        return True

    def get(self, block: bool = True, timeout: float | None = None) -> bytes:
        if not self.waiting:
            if len(self.said) == len(self.steps):
                raise queue.Empty
            self.waiting = [*self.steps[len(self.said)]["hear"]]
            self.said.append([])
            if not self.waiting:
                raise queue.Empty
        return octets(self.waiting.pop(0))


def client(question: dict[str, Any]) -> dict[str, Any]:
    network, remote = remote_node(question["node"])
    place, block = (int(question["index"], 16), int(question["sub"], 16)), question.get("block")
    if block and ((question["direction"] == "upload" and block["size"] != 127) or block.get("switch")):
        raise NotOffered("canopen has no such setting: blocks have 127 segments, and the protocol is never switched")
    talk = remote.sdo.responses = Talk(question["talk"])
    network.send_message = lambda _id, data, remote=False: talk.said[-1].append(hexed(data))  # type: ignore[method-assign]
    how = {"block_transfer": bool(block), "request_crc_support": bool(block) and block.get("crc", True)}
    answer: dict[str, Any] = {"ends": "done"}
    try:
        if question["direction"] == "upload":
            with remote.sdo.open(*place, "rb", **how) as file:
                answer["arrived"] = hexed(file.read())
        else:
            value = octets(question["value"])
            size = len(value) if question.get("indicated", True) else None
            with remote.sdo.open(*place, "wb", size=size, **how) as file:
                file.write(value)
    except SdoAbortedError as abort:
        answer = {"ends": {"abort": f"{abort.code:08X}"}}
    except SdoCommunicationError:
        last = [line for step in talk.said for line in step][-1]
        answer = {"ends": {"abort": octets(last)[:3:-1].hex().upper()} if last.startswith("80") else "running"}
    said = talk.said + [[] for _ in talk.steps[len(talk.said) :]]
    return {"talk": [{"say": lines} for lines in said], **answer}


def server(question: dict[str, Any]) -> dict[str, Any]:
    index, sub = int(question["index"], 16), int(question["sub"], 16)
    if question["talk"][0]["hear"][:1] and octets(question["talk"][0]["hear"][0])[0] >> 5 > 4:
        raise NotOffered("the server of canopen has no block transfer")
    network, node = local_node(question["node"], variable("DOMAIN", 0x2100))  # the only object of the server
    if "value" in question:
        node.data_store = {index: {sub: octets(question["value"])}}
    steps = []
    for step in question["talk"]:
        network.sent.clear()
        for line in step["hear"]:
            network.notify(node.sdo.rx_cobid, bytearray(octets(line)), 0.0)
        steps.append({"say": [hexed(data) for _, data in network.sent]})
    written = question["direction"] == "download"
    return (
        {"talk": steps, "arrived": hexed(node.data_store.get(index, {}).get(sub, b""))} if written else {"talk": steps}
    )


def device(question: dict[str, Any]) -> dict[str, Any]:
    """Ask the SDO server of a device with objects from 2000h on."""
    setup = question["device"]
    lines = [line for step in question["talk"] for line in step.get("hear", ())]
    mine = f"{0x600 + (setup['id'] or 0):03X}#"
    timers = any(row["object"] < "2000" for row in setup["objects"]) or setup.get("lss")
    if timers or not all(line.startswith(mine) for line in lines) or any(step.get("act") for step in question["talk"]):
        raise NotOffered("a local node of canopen answers SDO, and does nothing over time by itself")
    if any(line[4:5] in ("A", "C", "R") for line in lines):
        raise NotOffered("its server has no block transfer, and its network passes no remote frame on")
    network, node = local_node(setup["id"], *objects([*ALWAYS, *setup["objects"]]))
    node.nmt.state = "INITIALISING"  # its application sends the boot-up message
    talk = []
    for step in question["talk"]:
        for line in step.get("hear", ()):
            network.notify(node.sdo.rx_cobid, bytearray(octets(line.partition("#")[2])), 0.0)
        talk.append({"say": [f"{cob_id:03X}#{data.hex().upper()}" for cob_id, data in network.sent]})
        network.sent.clear()
    return {"talk": talk}


serve(
    "canopen",
    {
        "nmt": {"encode": encode_nmt},
        "sync": {"encode": encode_sync},
        "time": {"encode": encode_time},
        "emcy": {"encode": encode_emcy, "decode": decode_emcy},
        "cob-id": {"encode": cob_id},
        "lss": {"encode": encode_lss},
        "pdo": {"encode": encode_pdo, "decode": decode_pdo},
        "object-value": {"encode": encode_object, "decode": decode_object},
        "number": {"encode": encode_number, "decode": decode_number},
        "sdo": {"encode": encode_sdo},
        "device": {"run": device},
        "sdo-talk": {"client": client, "server": server},
        **EDS_ANSWERS,
        **DRIVE_ANSWERS,
        **OBJECT_ANSWERS,
        **DEVICE_ANSWERS,
    },
)
