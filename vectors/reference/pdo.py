"""pdo: objects packed bit by bit."""

from texts import Refused, exactly, hexed, octets
from values import number_bytes, number_text


def widths(entries):
    """Return the bits of each entry; refuse more than eight bytes, and a type that the bits do not fit."""
    found = []
    for entry in entries:
        bits, kind = int(entry["entry"][6:], 16), entry["type"]
        most = 1 if kind == "bool" else int(kind[1:]) if kind else 64
        if bits > most or (kind and kind[0] == "f" and bits != most):
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
                if not lowest <= raw < lowest + (1 << bits):
                    raise Refused("value")
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


KINDS = {"pdo": {"encode": encode, "decode": decode}}
