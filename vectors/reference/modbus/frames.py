"""rtu-frame, ascii-frame, tcp-frame: a unit and a PDU in their envelope."""

from checks import crc16, lrc
from texts import Refused, hexed, number, octets, within

DIGITS = b"0123456789ABCDEF"


def checked(given):
    """Return the unit as a byte and the PDU; refuse what no frame can hold."""
    pdu = octets(given["pdu"])
    within(len(pdu), 1, 253)
    return number(given["unit"], 1) + pdu


def encode_rtu(given):
    """unit, pdu -> frame"""
    body = checked(given)
    return {"frame": hexed(body + crc16(body).to_bytes(2, "little"))}


def open_rtu(frame):
    """Return the unit and the PDU of an RTU frame."""
    if len(frame) < 4:
        raise Refused("short")
    if len(frame) > 256:
        raise Refused("long")
    if crc16(frame[:-2]) != frame[-2] | frame[-1] << 8:
        raise Refused("checksum")
    return {"unit": frame[0], "pdu": hexed(frame[1:-2])}


def encode_ascii(given):
    """unit, pdu -> text"""
    body = checked(given)
    return {"text": ":" + (body + bytes([lrc(body)])).hex().upper() + "\r\n"}


def open_ascii(text):
    """Return the unit and the PDU of an ASCII frame. Small letters are read and never written."""
    if text[:1] != b":" or text[-2:] != b"\r\n":
        raise Refused("delimiter")
    digits = text[1:-2].upper()
    if any(digit not in DIGITS for digit in digits):
        raise Refused("character")
    if len(text) < 9:
        raise Refused("short")
    if len(text) > 513:
        raise Refused("long")
    if len(digits) % 2:
        raise Refused("short")
    body = bytes.fromhex(digits.decode())
    if lrc(body[:-1]) != body[-1]:
        raise Refused("checksum")
    return {"unit": body[0], "pdu": hexed(body[1:-1])}


def encode_tcp(given):
    """transaction, unit, pdu -> frame"""
    body = checked(given)
    return {"frame": hexed(number(given["transaction"], 2) + b"\0\0" + number(len(body), 2) + body)}


def open_tcp(frame):
    """Return the transaction, the unit and the PDU of a TCP frame."""
    if len(frame) < 6:
        raise Refused("short")
    transaction, protocol, length = (int.from_bytes(frame[at : at + 2], "big") for at in (0, 2, 4))
    if protocol:
        raise Refused("protocol")
    if not 2 <= length <= 254:
        raise Refused("length")
    if len(frame) < 6 + length:
        raise Refused("short")
    if len(frame) > 6 + length:
        raise Refused("long")
    return {"transaction": transaction, "unit": frame[6], "pdu": hexed(frame[7:])}


def latin(text):
    """Return the bytes of a text of an ASCII line, one for each character."""
    return text.encode("latin-1")


KINDS = {
    "rtu-frame": {"encode": encode_rtu, "decode": lambda given: open_rtu(octets(given["frame"]))},
    "ascii-frame": {"encode": encode_ascii, "decode": lambda given: open_ascii(latin(given["text"]))},
    "tcp-frame": {"encode": encode_tcp, "decode": lambda given: open_tcp(octets(given["frame"]))},
}
