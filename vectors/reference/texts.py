"""How the vectors write bytes, registers and bits; numbers as bytes; and the refusal of a question."""


class Refused(Exception):
    """What is given cannot be encoded or decoded: Refused("short"). The reasons are in the README."""


def octets(text):
    """Return bytes: "01 0F" -> b"\\x01\\x0f"."""
    return bytes.fromhex(text)


def hexed(data):
    """Return bytes as text: b"\\x01\\x0f" -> "01 0F"."""
    return " ".join(f"{byte:02X}" for byte in data)


def words(text):
    """Return registers: "022B 0000" -> [555, 0]."""
    return [int(word, 16) for word in text.split()]


def worded(registers):
    """Return registers as text: [555, 0] -> "022B 0000"."""
    return " ".join(f"{register:04X}" for register in registers)


def bits_of(text):
    """Return a row of bits: "101" -> [1, 0, 1]."""
    return [int(bit) for bit in text.replace(" ", "")]


def bitted(row):
    """Return bits as text, in groups of eight."""
    return " ".join("".join(str(bit) for bit in row[at : at + 8]) for at in range(0, len(row), 8))


def packed(row):
    """Return bits as bytes: the first one is bit 0 of the first byte, the rest of the last byte is zero."""
    data = bytearray((len(row) + 7) // 8)
    for place, bit in enumerate(row):
        data[place // 8] |= bit << place % 8
    return bytes(data)


def unpacked(data, count):
    """Return the first `count` bits of bytes."""
    return [data[place // 8] >> place % 8 & 1 for place in range(count)]


def number(value, size, order="big"):
    """Return an unsigned number as bytes. Refuse a value that has no room there."""
    if not 0 <= value < 1 << 8 * size:
        raise Refused("value")
    return value.to_bytes(size, order)


def exactly(data, size):
    """Refuse fewer or more bytes than `size`."""
    if len(data) < size:
        raise Refused("short")
    if len(data) > size:
        raise Refused("long")


def within(value, lowest, highest):
    """Refuse a value outside its limits."""
    if not lowest <= value <= highest:
        raise Refused("value")
