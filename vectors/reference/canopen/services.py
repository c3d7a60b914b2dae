"""nmt, node-state, heartbeat-consumer, emcy, sync, time, lss: the short messages of CANopen."""

from can_frames import frame_of, identified
from texts import Refused, exactly, hexed, number, octets, within
from values import time_bytes, time_of

COMMANDS = {
    "start": 0x01,
    "stop": 0x02,
    "enter pre-operational": 0x80,
    "reset node": 0x81,
    "reset communication": 0x82,
}
STATES = {0x00: "boot-up", 0x04: "stopped", 0x05: "operational", 0x7F: "pre-operational"}


def sent(identifier, data):
    """Return a frame as the fields of an answer."""
    return {"cob_id": identified(identifier, False), "data": hexed(data)}


def node_of(identifier, base):
    """Return the node of an identifier; 1 to 127 can be in it."""
    if not 1 <= identifier - base <= 127:
        raise Refused("mismatch")
    return identifier - base


def data_of(given, identifier):
    """Return the data of a frame that has this identifier."""
    found, data = frame_of(given)
    if found != identifier:
        raise Refused("mismatch")
    return data


def encode_nmt(given):
    """command, node -> cob_id, data"""
    within(given["node"], 0, 127)
    return sent(0x000, [COMMANDS[given["command"]], given["node"]])


def decode_nmt(given):
    """cob_id, data -> command, node"""
    data = data_of(given, 0x000)
    exactly(data, 2)
    for command, byte in COMMANDS.items():
        if byte == data[0]:
            within(data[1], 0, 127)
            return {"command": command, "node": data[1]}
    raise Refused("function")


def encode_state(given):
    """node, state, toggle -> cob_id, data"""
    within(given["node"], 1, 127)
    state = int(given["state"], 16)
    within(state, 0, 127)
    return sent(0x700 + given["node"], [given["toggle"] << 7 | state])


def decode_state(given):
    """cob_id, data -> node, state, toggle, name"""
    identifier, data = frame_of(given)
    node = node_of(identifier, 0x700)
    if not data:
        raise Refused("short")
    state = data[0] & 0x7F
    name = STATES.get(state, f"state {state:02X}h")
    return {"node": node, "state": f"{state:02X}", "toggle": data[0] >> 7 == 1, "name": name}


def encode_consumer(given):
    """node, milliseconds -> value, bytes"""
    if given["node"] > 127 or given["milliseconds"] > 65535:
        raise Refused("value")
    value = given["node"] << 16 | given["milliseconds"]
    return {"value": str(value), "bytes": hexed(value.to_bytes(4, "little"))}


def decode_consumer(given):
    """bytes -> node, milliseconds"""
    low, high, node, _ = octets(given["bytes"])
    milliseconds = low | high << 8
    used = 1 <= node <= 127 and milliseconds > 0
    return {"node": node if used else None, "milliseconds": milliseconds if used else None}


def encode_emcy(given):
    """node, code, register, info -> cob_id, data"""
    within(given["node"], 1, 127)
    info = octets(given["info"])
    if len(info) != 5:
        raise Refused("value")
    data = number(int(given["code"], 16), 2, "little") + number(int(given["register"], 16), 1) + info
    return sent(0x080 + given["node"], data)


def decode_emcy(given):
    """cob_id, data -> node, code, register, info; some devices send fewer than eight bytes"""
    identifier, data = frame_of(given)
    node = node_of(identifier, 0x080)
    if len(data) < 2:
        raise Refused("short")
    data = data.ljust(8, b"\0")
    code = data[0] | data[1] << 8
    return {"node": node, "code": f"{code:04X}", "register": f"{data[2]:02X}", "info": hexed(data[3:])}


def encode_sync(given):
    """counter -> cob_id, data"""
    if given["counter"] is None:
        return sent(0x080, b"")
    within(given["counter"], 1, 240)
    return sent(0x080, [given["counter"]])


def decode_sync(given):
    """cob_id, data -> counter"""
    data = data_of(given, 0x080)
    if not data:
        return {"counter": None}
    exactly(data, 1)
    within(data[0], 1, 240)
    return {"counter": data[0]}


def encode_time(given):
    """days, milliseconds -> cob_id, data"""
    return sent(0x100, time_bytes(given["days"], given["milliseconds"]))


def decode_time(given):
    """cob_id, data -> days, milliseconds"""
    return time_of(data_of(given, 0x100))


LSS = {"request": 0x7E5, "answer": 0x7E4}
LSS_SERVICES = {
    "request": (0x04, 0x11, 0x13, 0x15, 0x17, *range(0x40, 0x44), *range(0x46, 0x4D), 0x51, *range(0x5A, 0x5F)),
    "answer": (0x11, 0x13, 0x17, 0x44, 0x4F, 0x50, *range(0x5A, 0x5F)),
}


def encode_lss(given):
    """side, service, body -> cob_id, data"""
    return sent(LSS[given["side"]], octets(given["service"] + given["body"]))


def decode_lss(given):
    """cob_id, data -> side, service, body"""
    identifier, data = frame_of(given)
    for side, its_own in LSS.items():
        if identifier == its_own:
            exactly(data, 8)
            if data[0] not in LSS_SERVICES[side]:
                raise Refused("function")
            return {"side": side, "service": f"{data[0]:02X}", "body": hexed(data[1:])}
    raise Refused("mismatch")


KINDS = {
    "nmt": {"encode": encode_nmt, "decode": decode_nmt},
    "node-state": {"encode": encode_state, "decode": decode_state},
    "heartbeat-consumer": {"encode": encode_consumer, "decode": decode_consumer},
    "emcy": {"encode": encode_emcy, "decode": decode_emcy},
    "sync": {"encode": encode_sync, "decode": decode_sync},
    "time": {"encode": encode_time, "decode": decode_time},
    "lss": {"encode": encode_lss, "decode": decode_lss},
}
