"""tls-role: the role in a certificate of Modbus/TCP Security, an extension in DER.

30 len  30 len  06 len OID  [01 01 FF]  04 len  0C len text
list    item    identifier  critical    octets  UTF8String
"""

from texts import Refused, octets

OID, UTF8 = 0x06, 0x0C
ROLE = octets("2B 06 01 04 01 83 89 0C 86 22 01")
"""1.3.6.1.4.1.50316.802.1: the first two numbers in one byte, then base 128, bit 7 set if the number goes on."""


def taken(data):
    """Return type and content of the first value, and the bytes behind it."""
    if len(data) < 2:
        raise Refused("short")
    size, at = data[1], 2
    if size == 0x80:
        raise Refused("value")  # a length that is not given: BER, and not DER
    if size > 0x80:
        at = 2 + size - 0x80
        size = int.from_bytes(data[2:at], "big")
        if size < 0x80:
            raise Refused("value")  # one byte would do
    if len(data) < at + size:
        raise Refused("short")
    return data[0], data[at : at + size], data[at + size :]


def values(data):
    """Return type and content of each value."""
    found = []
    while data:
        kind, content, data = taken(data)
        found.append((kind, content))
    return found


def role(given):
    """extensions -> role"""
    _, extensions, _ = taken(octets(given["extensions"]))
    found = []
    for _, extension in values(extensions):
        parts = values(extension)
        if parts[0] == (OID, ROLE):
            found.append(parts[-1][1])  # a BOOLEAN between the two says whether it is critical
    if not found:
        return {"role": None}
    kind, text, rest = taken(found[0])
    if len(found) > 1 or kind != UTF8 or rest:
        raise Refused("value")
    try:
        return {"role": text.decode("utf-8")}
    except UnicodeDecodeError:
        raise Refused("value") from None


KINDS = {"tls-role": {"decode": role}}
