"""pdo, mpdo: objects packed bit by bit, and one object with its address."""

from texts import Refused, exactly, hexed, octets, within
from values import number_bytes, number_text


def widths(entries):
    """Return the bits of each entry; refuse more than eight bytes, and a type that the bits do not fit."""
    found = []
    for entry in entries:
        bits, kind = int(entry["entry"][6:], 16), entry["type"]
        if bits == 0:
            raise Refused("value")
        if kind and kind != "bool":  # a bool has one bit; that some fill whole bytes with it is left open
            most = int(kind[1:])
            if bits > most or (kind[0] == "f" and bits != most):
                raise Refused("value")
        found.append(bits)
    if sum(found) > 64:
        raise Refused("value")
    return found


def encode(given):
    """entries with values -> data"""
    row = at = 0
    for entry, bits in zip(given["entries"], widths(given["entries"])):
        kind, text = entry["type"], entry.get("value")
        if text is not None:
            if kind[0] == "f":
                raw = int.from_bytes(number_bytes(kind, text), "big")
            else:
                raw = int(text)
                lowest = -(1 << bits - 1) if kind[0] == "i" else 0
                within(raw, lowest, 1 if kind == "bool" else lowest + (1 << bits) - 1)
            row |= (raw & (1 << bits) - 1) << at
        at += bits
    return {"data": hexed(row.to_bytes((at + 7) // 8, "little"))}


def decode(given):
    """entries, data -> entries with values; a dummy has none"""
    data, bits_of_all = octets(given["data"]), widths(given["entries"])
    exactly(data, (sum(bits_of_all) + 7) // 8)
    row, found = int.from_bytes(data, "little"), []
    for entry, bits in zip(given["entries"], bits_of_all):
        raw, kind = row & (1 << bits) - 1, entry["type"]
        row >>= bits
        if kind and kind[0] == "f":
            found.append({"value": number_text(kind, raw.to_bytes(bits // 8, "big"))})
        elif kind:
            negative = kind[0] == "i" and raw >> bits - 1
            found.append({"value": str(raw - (1 << bits) if negative else raw)})
        else:
            found.append({"value": None})
    return {"entries": found}


def encode_mpdo(given):
    """addressing, node, index, sub, data -> bytes"""
    data, is_sam = octets(given["data"]), given["addressing"] == "SAM"
    if len(data) != 4:
        raise Refused("value")
    within(given["node"], 1 if is_sam else 0, 127)  # DAM: 0 are all nodes
    head = bytes([(0x00 if is_sam else 0x80) | given["node"]])
    return {"bytes": hexed(head + octets(given["index"])[::-1] + octets(given["sub"]) + data)}


def decode_mpdo(given):
    """bytes -> addressing, node, index, sub, data"""
    data = octets(given["bytes"])
    if len(data) != 8:
        raise Refused("length")
    addressing, node = ("DAM", data[0] & 0x7F) if data[0] & 0x80 else ("SAM", data[0])
    if addressing == "SAM" and node == 0:
        raise Refused("value")
    place = {"index": f"{data[1] | data[2] << 8:04X}", "sub": f"{data[3]:02X}"}
    return {"addressing": addressing, "node": node, **place, "data": hexed(data[4:])}


KINDS = {"mpdo": {"encode": encode_mpdo, "decode": decode_mpdo}, "pdo": {"encode": encode, "decode": decode}}
