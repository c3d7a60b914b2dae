"""number, bits, register-part, text, object-value: values and their bytes."""

import struct

from texts import Refused, bits_of, bitted, exactly, hexed, number, octets, packed, unpacked

DAY = 86_400_000


def ordered(data, order):
    """Put big-endian bytes in another order, or back: each of the four orders undoes itself."""
    if order in ("DCBA", "CDAB"):
        data = data[::-1]
    if order in ("BADC", "CDAB"):
        data = b"".join(data[at : at + 2][::-1] for at in range(0, len(data), 2))
    return data


def checked(given):
    """Return the type of a number. Refuse an order of pairs for 24, 40 and 56 bits, which have none."""
    if given["type"][1:] in ("24", "40", "56") and given["order"] in ("BADC", "CDAB"):
        raise Refused("value")
    return given["type"]


def number_bytes(kind, text):
    """Return a number of type u, i or f and its bits as big-endian bytes."""
    size = int(kind[1:]) // 8
    try:
        if kind[0] == "f":
            return struct.pack(">f" if size == 4 else ">d", float(text))
        return int(text).to_bytes(size, "big", signed=kind[0] == "i")
    except (ValueError, OverflowError):
        raise Refused("value") from None


def number_text(kind, data):
    """Return the number in big-endian bytes as text."""
    exactly(data, int(kind[1:]) // 8)
    if kind[0] == "f":
        return repr(struct.unpack(">f" if len(data) == 4 else ">d", data)[0])
    return str(int.from_bytes(data, "big", signed=kind[0] == "i"))


def encode_number(given):
    """type, order, value -> bytes"""
    return {"bytes": hexed(ordered(number_bytes(checked(given), given["value"]), given["order"]))}


def decode_number(given):
    """type, order, bytes -> value"""
    return {"value": number_text(checked(given), ordered(octets(given["bytes"]), given["order"]))}


def encode_bits(given):
    """bits -> bytes"""
    return {"bytes": hexed(packed(bits_of(given["bits"])))}


def decode_bits(given):
    """bytes, count -> bits"""
    data, count = octets(given["bytes"]), given["count"]
    exactly(data, (count + 7) // 8)
    return {"bits": bitted(unpacked(data, count))}


def part_of(part):
    """Return the lowest bit and the number of bits of a part of a register: "L", "H", "bit 3"."""
    if part in ("L", "H"):
        return (8 if part == "H" else 0), 8
    bit = int(part.removeprefix("bit "))
    if bit > 15:
        raise Refused("value")
    return bit, 1


def read_part(given):
    """register, part -> value"""
    low, width = part_of(given["part"])
    return {"value": int(given["register"], 16) >> low & (1 << width) - 1}


def write_part(given):
    """register, part, write -> then: the part is replaced, all else kept"""
    low, width = part_of(given["part"])
    if not 0 <= given["write"] < 1 << width:
        raise Refused("value")
    kept = int(given["register"], 16) & ~((1 << width) - 1 << low)
    return {"then": f"{kept | given['write'] << low:04X}"}


def encode_text(given):
    """size, charset, pad, text -> bytes"""
    try:
        data = given["text"].encode(given["charset"])
    except UnicodeEncodeError:
        raise Refused("value") from None
    if len(data) > given["size"]:
        raise Refused("value")
    return {"bytes": hexed(data + octets(given["pad"]) * (given["size"] - len(data)))}


def decode_text(given):
    """size, charset, pad, bytes -> text, without padding and zero bytes at the end"""
    data = octets(given["bytes"])
    exactly(data, given["size"])
    try:
        return {"text": data.rstrip(b"\0" + octets(given["pad"])).decode(given["charset"])}
    except UnicodeDecodeError:
        raise Refused("character") from None


CHARSETS = {"VISIBLE_STRING": "latin-1", "UNICODE_STRING": "utf-16-le"}


def time_bytes(days, milliseconds):
    """Return a time: milliseconds of the day in 4 bytes, days in 2, low byte first."""
    if not 0 <= milliseconds < DAY:
        raise Refused("value")
    return number(milliseconds, 4, "little") + number(days, 2, "little")


def time_of(data):
    """Return days and milliseconds of the day; the upper four bits of the milliseconds are void."""
    exactly(data, 6)
    both = int.from_bytes(data, "little")
    milliseconds = both & 0x0FFFFFFF
    if milliseconds >= DAY:
        raise Refused("value")
    return {"days": both >> 32, "milliseconds": milliseconds}


def encode_object(given):
    """type, value -> bytes"""
    kind, value = given["type"], given["value"]
    if kind == "BOOLEAN":
        return {"bytes": "01" if value else "00"}
    if kind in CHARSETS:
        try:
            return {"bytes": hexed(value.encode(CHARSETS[kind]))}
        except UnicodeEncodeError:
            raise Refused("value") from None
    if kind in ("TIME_OF_DAY", "TIME_DIFFERENCE"):
        return {"bytes": hexed(time_bytes(value["days"], value["milliseconds"]))}
    return {"bytes": value}  # OCTET_STRING, DOMAIN: as they are


def decode_object(given):
    """type, bytes -> value"""
    kind, data = given["type"], octets(given["bytes"])
    if kind == "BOOLEAN":
        exactly(data, 1)
        if data[0] > 1:
            raise Refused("value")
        return {"value": data[0] == 1}
    if kind == "UNICODE_STRING" and len(data) % 2:
        raise Refused("short")
    if kind in CHARSETS:
        return {"value": data.decode(CHARSETS[kind])}
    if kind in ("TIME_OF_DAY", "TIME_DIFFERENCE"):
        return {"value": time_of(data)}
    return {"value": hexed(data)}


KINDS = {
    "number": {"encode": encode_number, "decode": decode_number},
    "bits": {"encode": encode_bits, "decode": decode_bits},
    "register-part": {"encode": write_part, "decode": read_part},
    "text": {"encode": encode_text, "decode": decode_text},
    "object-value": {"encode": encode_object, "decode": decode_object},
}
