"""The `cryptography` package as an adapter: the role in the extensions of a certificate, read by its decoder of DER."""

from typing import Annotated, Any

from adapter import Refused, octets, serve
from cryptography.hazmat import asn1
from cryptography.x509 import ObjectIdentifier

ROLE = ObjectIdentifier("1.3.6.1.4.1.50316.802.1")


@asn1.sequence
class Extension:
    """An extension of a certificate (RFC 5280, 4.1)."""

    name: ObjectIdentifier
    critical: Annotated[bool, asn1.Default(False)]
    value: bytes


@asn1.sequence
class Extensions:
    """The decoder takes a list inside a sequence."""

    rows: list[Extension]


def enclosed(data: bytes) -> bytes:
    """Return the DER of a sequence of one value."""
    if len(data) < 128:
        return bytes([0x30, len(data)]) + data
    size = len(data).to_bytes((len(data).bit_length() + 7) // 8, "big")
    return bytes([0x30, 0x80 | len(size)]) + size + data


def role(question: dict[str, Any]) -> dict[str, Any]:
    found = asn1.decode_der(Extensions, enclosed(octets(question["extensions"])))
    roles = [row.value for row in found.rows if row.name == ROLE]
    if len(roles) > 1:
        raise Refused("an extension twice, which RFC 5280, 4.2 forbids")
    return {"role": asn1.decode_der(str, roles[0]) if roles else None}


serve("cryptography", {"tls-role": {"decode": role}})
