"""crc16, lrc, rtu-timing: the two checksums of serial lines, and the silences of RTU."""

from fractions import Fraction

from texts import Refused, hexed, octets


def crc16(data):
    """Return the CRC of RTU. Over a frame with its CRC (low byte first) it is zero."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return register


def lrc(data):
    """Return the LRC of ASCII: the byte that makes the sum of all bytes zero."""
    return -sum(data) & 0xFF


def times(baud, bits):
    """Return the microseconds of a character, t1.5 and t3.5, as exact fractions."""
    if not baud or bits > 12:
        raise Refused("value")
    character = Fraction(bits * 1_000_000, baud)
    if baud > 19200:
        return character, Fraction(750), Fraction(1750)
    return character, character * 3 / 2, character * 7 / 2


def encode_crc(given):
    """bytes -> crc as a number, and as it is sent: low byte first"""
    crc = crc16(octets(given["bytes"]))
    return {"crc": f"{crc:04X}", "wire": hexed([crc & 0xFF, crc >> 8])}


def walk(given):
    """bytes -> every step of the shift register"""
    register, steps = 0xFFFF, []
    for byte in octets(given["bytes"]):
        register ^= byte
        step = {"byte": f"{byte:02X}", "xor": f"{register:04X}", "shifts": []}
        for _ in range(8):
            low = register & 1
            register >>= 1
            shift = f"{register:04X} {low}"
            if low:
                register ^= 0xA001
                shift += f" {register:04X}"
            step["shifts"].append(shift)
        steps.append(step)
    return {"walk": steps}


def encode_lrc(given):
    """bytes -> lrc"""
    return {"lrc": f"{lrc(octets(given['bytes'])):02X}"}


def timing(given):
    """baud, bits of a character -> nanoseconds, rounded"""
    found = [round(1000 * time) for time in times(given["baud"], given["bits"])]
    return {"character_ns": found[0], "t15_ns": found[1], "t35_ns": found[2]}


KINDS = {
    "crc16": {"encode": encode_crc, "walk": walk},
    "lrc": {"encode": encode_lrc},
    "rtu-timing": {"encode": timing},
}
