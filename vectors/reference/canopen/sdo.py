"""sdo: the frames that begin a transfer, expedited ones, and aborts."""

from can_frames import frame_of
from services import node_of, sent
from texts import Refused, hexed, number, octets, within

ABORTS = (
    *(0x05030000, 0x05040000, 0x05040001, 0x05040002, 0x05040003, 0x05040004, 0x05040005),
    *(0x06010000, 0x06010001, 0x06010002, 0x06020000, 0x06040041, 0x06040042, 0x06040043, 0x06040047),
    *(0x06060000, 0x06070010, 0x06070012, 0x06070013, 0x06090011, 0x06090030, 0x06090031, 0x06090032),
    *(0x06090036, 0x060A0023, 0x08000000, 0x08000020, 0x08000021, 0x08000022, 0x08000023, 0x08000024),
)
BASES = {"request": 0x600, "answer": 0x580}
SPECIFIERS = {
    "request": {1: "initiate-download", 2: "initiate-upload", 4: "abort"},
    "answer": {2: "upload-initiated", 3: "download-initiated", 4: "abort"},
}
"""By side and the bits 7..5 of the command."""
EXPEDITED = {"initiate-download": "expedited-download", "upload-initiated": "expedited-upload"}
COMMANDS = {
    "initiate-upload": 0x40,
    "download-initiated": 0x60,
    "abort": 0x80,
    "initiate-download": 0x20,
    "expedited-download": 0x20,
    "upload-initiated": 0x40,
    "expedited-upload": 0x40,
}


def encode(given):
    """side, node, message -> cob_id, data"""
    message, command, data = given["message"], COMMANDS[given["message"]["name"]], b""
    if "code" in message:
        data = number(int(message["code"], 16), 4, "little")
    if message.get("size") is not None:
        command |= 1
        data = number(message["size"], 4, "little")
    if "data" in message:
        data = octets(message["data"])
        within(len(data), 1 if message["indicated"] else 4, 4)
        command |= 2 | ((4 - len(data)) << 2 | 1 if message["indicated"] else 0)
    place = number(int(message["index"], 16), 2, "little") + number(int(message["sub"], 16), 1)
    within(given["node"], 1, 127)
    return sent(BASES[given["side"]] + given["node"], (bytes([command]) + place + data).ljust(8, b"\0"))


def decode(given):
    """side, cob_id, data -> node, message, known"""
    identifier, data = frame_of(given)
    node = node_of(identifier, BASES[given["side"]])
    if len(data) < 4:
        raise Refused("short")
    command, rest = data[0], data[4:]
    name = SPECIFIERS[given["side"]].get(command >> 5)
    if name is None:
        raise Refused("function")
    place = {"index": f"{data[1] | data[2] << 8:04X}", "sub": f"{data[3]:02X}"}
    if name == "abort":
        code = number_in(rest)
        return {"node": node, "message": {"name": name, **place, "code": f"{code:08X}"}, "known": code in ABORTS}
    if name in EXPEDITED and command & 2:
        indicated = command & 1 == 1
        size = 4 - (command >> 2 & 3) if indicated else 4  # without s, n says nothing
        if len(rest) < size:
            raise Refused("short")
        value = {"data": hexed(rest[:size]), "indicated": indicated}
        return {"node": node, "message": {"name": EXPEDITED[name], **place, **value}}
    if name in EXPEDITED:
        return {"node": node, "message": {"name": name, **place, "size": number_in(rest) if command & 1 else None}}
    return {"node": node, "message": {"name": name, **place}}


def number_in(rest):
    """Return the number in the last four bytes."""
    if len(rest) < 4:
        raise Refused("short")
    return int.from_bytes(rest, "little")


KINDS = {"sdo": {"encode": encode, "decode": decode}}
