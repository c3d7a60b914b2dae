"""can-text, cob-id, cob-restricted, cob-entry: CAN frames and their identifiers."""

from texts import Refused, hexed, octets, within

HEX = "0123456789ABCDEFabcdef"
SINGLE = {"NMT": 0x000, "SYNC": 0x080, "TIME": 0x100, "LSS answer": 0x7E4, "LSS request": 0x7E5}
BASES = {"EMCY": 0x080, "SDO answer": 0x580, "SDO request": 0x600, "error control": 0x700}
BASES |= {f"TPDO{n}": 0x080 + 0x100 * n for n in (1, 2, 3, 4)} | {f"RPDO{n}": 0x100 + 0x100 * n for n in (1, 2, 3, 4)}


def identified(identifier, extended):
    """Return an identifier as text: eight digits if it is extended."""
    return f"{identifier:0{8 if extended else 3}X}"


def frame_of(given):
    """Return the identifier and the data of a question; an extended identifier is none of CANopen."""
    if len(given["cob_id"]) != 3:
        raise Refused("mismatch")
    data = octets(given["data"])
    if len(data) > 8:
        raise Refused("long")
    return int(given["cob_id"], 16), data


def write_text(given):
    """frame -> text"""
    frame = given["frame"]
    if frame["remote"]:
        return {"text": f"{frame['id']}#R{frame['requested'] or ''}"}
    return {"text": f"{frame['id']}#{frame['data'].replace(' ', '')}"}


def read_text(given):
    """text -> frame"""
    head, mark, rest = given["text"].partition("#")
    if not mark:
        raise Refused("delimiter")
    if any(digit not in HEX for digit in head):
        raise Refused("character")
    if len(head) not in (3, 8):
        raise Refused("length")
    extended = len(head) == 8
    identifier = int(head, 16)
    if identifier > (0x1FFFFFFF if extended else 0x7FF):
        raise Refused("value")
    frame = {"id": identified(identifier, extended), "extended": extended, "remote": rest[:1] == "R"}
    if frame["remote"]:
        if rest[1:] and rest[1:] not in list("012345678"):
            raise Refused("value")
        return {"frame": frame | {"requested": int(rest[1:] or 0), "data": ""}}
    if rest[:1] == "#":
        raise Refused("value")  # CAN FD
    digits = rest.replace(".", "")  # dots between bytes are read and never written
    if any(digit not in HEX for digit in digits):
        raise Refused("character")
    if len(digits) % 2:
        raise Refused("length")
    data = octets(digits)
    if len(data) > 8:
        raise Refused("long")
    return {"frame": frame | {"requested": 0, "data": hexed(data)}}


def encode_cob_id(given):
    """service, node -> cob_id"""
    service, node = given["service"], given["node"]
    if service in SINGLE:
        within(node, 0, 0)
        return {"cob_id": identified(SINGLE[service], False)}
    within(node, 1, 127)
    return {"cob_id": identified(BASES[service] + node, False)}


def decode_cob_id(given):
    """cob_id -> service, node"""
    identifier, _ = frame_of(given | {"data": ""})
    for service, only in SINGLE.items():
        if identifier == only:
            return {"service": service, "node": 0}
    for service, base in BASES.items():
        if 1 <= identifier - base <= 127:
            return {"service": service, "node": identifier - base}
    raise Refused("mismatch")


RESTRICTED = ((0x000, 0x07F), (0x101, 0x180), (0x581, 0x5FF), (0x601, 0x67F), (0x6E0, 0x6FF), (0x701, 0x7FF))


def restricted(given):
    """cob_id -> restricted"""
    identifier = int(given["cob_id"], 16)
    return {"restricted": any(first <= identifier <= last for first, last in RESTRICTED)}


def encode_entry(given):
    """identifier, extended, bit30, bit31 -> value"""
    identifier = int(given["identifier"], 16)
    within(identifier, 0, 0x1FFFFFFF if given["extended"] else 0x7FF)
    flags = given["bit31"] << 31 | given["bit30"] << 30 | given["extended"] << 29
    return {"value": f"{flags | identifier:08X}"}


def decode_entry(given):
    """value -> identifier, extended, bit30, bit31"""
    value = int(given["value"], 16)
    extended = value >> 29 & 1 == 1
    identifier = value & (0x1FFFFFFF if extended else 0x7FF)
    return {
        "identifier": identified(identifier, extended),
        "extended": extended,
        "bit30": value >> 30 & 1 == 1,
        "bit31": value >> 31 == 1,
    }


KINDS = {
    "can-text": {"encode": write_text, "decode": read_text},
    "cob-id": {"encode": encode_cob_id, "decode": decode_cob_id},
    "cob-restricted": {"decode": restricted},
    "cob-entry": {"encode": encode_entry, "decode": decode_entry},
}
