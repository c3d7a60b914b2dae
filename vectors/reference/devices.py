"""parameter, drive-state, drive-command: a value of a device in its places, and the words of CiA 402."""

from decimal import Decimal
from fractions import Fraction

from texts import Refused, exactly, hexed, number, octets, worded, words
from values import number_bytes, number_text, ordered, part_of


def raw_text(parameter, text):
    """Return the raw number of a value as text: value / scale, which must be a whole step."""
    if "scale" not in parameter:
        return text
    raw = Fraction(text) / Fraction(parameter["scale"])
    if raw.denominator != 1:
        raise Refused("value")
    return str(raw.numerator)


def value_text(parameter, text):
    """Return the value of a raw number, as text."""
    if "scale" not in parameter:
        return text
    value = Fraction(text) * Fraction(parameter["scale"])
    return str(Decimal(value.numerator) / Decimal(value.denominator))


def part(place):
    """Return the lowest bit and the number of bits of a value that is part of its register; None for others."""
    if "bit" in place:
        return part_of(f"bit {place['bit']}")
    return part_of(place["half"]) if "half" in place else None


def put(old, place, kind, raw):
    """Return a 16-bit number with a part of it replaced."""
    low, width = part(place)
    if kind == "bool":
        value = int(raw)
    else:
        value = number_bytes(kind, raw)[0]
    return old & ~((1 << width) - 1 << low) | value << low


def get(old, place, kind):
    """Return the part of a 16-bit number, as text."""
    low, width = part(place)
    value = old >> low & (1 << width) - 1
    return str(value) if kind == "bool" else number_text(kind, bytes([value]))


def encode_parameter(given):
    """parameter, value, old -> registers, bytes"""
    parameter, kind, answer = given["parameter"], given["parameter"]["type"], {}
    place, entry = parameter.get("modbus"), parameter.get("object")
    if kind == "text":
        data = given["value"].encode("latin-1")
        return {"registers": worded(pairs(data.ljust(2 * place["words"], b"\0")))}
    raw = raw_text(parameter, given["value"])
    if place and part(place):
        answer["registers"] = worded([put(words(given["old"])[0], place, kind, raw)])
    elif place:
        answer["registers"] = worded(pairs(ordered(number_bytes(kind, raw), place.get("order", "ABCD"))))
    if entry and "bit" in entry:
        old = int.from_bytes(octets(given["old"]), "little")
        answer["bytes"] = hexed(put(old, entry, kind, raw).to_bytes(2, "little"))
    elif entry:
        answer["bytes"] = hexed(number_bytes(kind, raw)[::-1])
    return answer


def pairs(data):
    """Return bytes as registers."""
    return [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]


def decode_parameter(given):
    """parameter, registers, bytes -> value, which must be the same in each place"""
    parameter, kind, found = given["parameter"], given["parameter"]["type"], []
    place, entry = parameter.get("modbus"), parameter.get("object")
    if "registers" in given:
        registers = words(given["registers"])
        exactly(registers, place["words"])
        data = b"".join(number(register, 2) for register in registers)
        if kind == "text":
            return {"value": data.rstrip(b"\0").decode("latin-1")}
        if part(place):
            found.append(get(registers[0], place, kind))
        else:
            found.append(number_text(kind, ordered(data, place.get("order", "ABCD"))))
    if "bytes" in given:
        data = octets(given["bytes"])
        if "bit" in entry:
            found.append(get(int.from_bytes(data, "little"), entry, kind))
        else:
            found.append(number_text(kind, data[::-1]))
    if len(set(found)) > 1:
        raise Refused("mismatch")
    return {"value": value_text(parameter, found[0])}


STATES = {
    "not ready to switch on": (0x4F, 0x00),
    "switch on disabled": (0x4F, 0x40),
    "ready to switch on": (0x6F, 0x21),
    "switched on": (0x6F, 0x23),
    "operation enabled": (0x6F, 0x27),
    "quick stop active": (0x6F, 0x07),
    "fault reaction active": (0x4F, 0x0F),
    "fault": (0x4F, 0x08),
}
COMMANDS = {
    "shutdown": (0x87, 0x06, [2, 6, 8]),
    "switch on": (0x8F, 0x07, [3]),
    "enable operation": (0x8F, 0x0F, [4, 16]),
    "disable operation": (0x8F, 0x07, [5]),
    "disable voltage": (0x82, 0x00, [7, 9, 10, 12]),
    "quick stop": (0x86, 0x02, [7, 10, 11]),
    "fault reset": (0x80, 0x80, [15]),
}


def bits_of_word(given):
    """word -> bits"""
    return {"bits": [bit for bit in range(16) if int(given["word"], 16) >> bit & 1]}


def state_of(word):
    """Return the state that a status word tells, None if it tells none."""
    return next((name for name, (mask, masked) in STATES.items() if word & mask == masked), None)


def state(given):
    """word -> state"""
    found = state_of(int(given["word"], 16))
    if found is None:
        raise Refused("value")
    return {"state": found}


def state_row(given):
    """state -> mask, masked"""
    mask, masked = STATES[given["state"]]
    return {"mask": f"{mask:04X}", "masked": f"{masked:04X}"}


def command(given):
    """word, command -> matches"""
    mask, masked, _ = COMMANDS[given["command"]]
    return {"matches": int(given["word"], 16) & mask == masked}


def command_row(given):
    """command -> mask, masked, transitions"""
    mask, masked, transitions = COMMANDS[given["command"]]
    return {"mask": f"{mask:04X}", "masked": f"{masked:04X}", "transitions": transitions}


KINDS = {
    "parameter": {"encode": encode_parameter, "decode": decode_parameter},
    "drive-state": {"bits": bits_of_word, "decode": state, "table": state_row},
    "drive-command": {"decode": command, "table": command_row},
}
