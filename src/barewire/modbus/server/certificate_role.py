"""The role of a client, an extension of its certificate.                                    [MB-TLS R-21, R-22, R-65]

    Certificate > TBSCertificate > [3] > Extensions > Extension { OID, critical?, OCTET STRING > UTF8String }

    30 19  06 0B 2B 06 01 04 01 83 89 0C 86 22 01  04 0A  0C 08 4F 70 65 72 61 74 6F 72
           OID 1.3.6.1.4.1.50316.802.1             octets UTF8String "Operator"

There is at most one role, and the whole text is its name. A certificate without a role is valid: its role is None.
"""

from __future__ import annotations

from collections.abc import Iterator

from barewire.errors import DecodeError

ROLE = bytes.fromhex("2B0601040183890C862201")
"""1.3.6.1.4.1.50316.802.1 in DER."""

_EXTENSIONS, _OID, _UTF8 = 0xA3, 0x06, 0x0C


def role_of(certificate: bytes) -> str | None:
    """Return the role in a certificate (DER), or None. Raises DecodeError for several roles, or one that is no text."""
    _, certificate_body = next(_parts(certificate))
    _, signed = next(_parts(certificate_body))
    for tag, extensions in _parts(signed):
        if tag == _EXTENSIONS:
            return role_in(extensions)
    return None


def role_in(extensions: bytes) -> str | None:
    """Return the role in the extensions of a certificate, a SEQUENCE in DER, or None. Raises as `role_of`."""
    roles = []
    _, rows = next(_parts(extensions))
    for _, extension in _parts(rows):
        fields = list(_parts(extension))
        if fields[0] == (_OID, ROLE):
            roles.append(_text(extensions, fields[-1][1]))
    if len(roles) > 1:
        raise DecodeError("value", extensions, 0, f"{len(roles)} roles in one certificate, there may be one")
    return roles[0] if roles else None


def _text(certificate: bytes, inside: bytes) -> str:
    values = list(_parts(inside))
    if len(values) != 1 or values[0][0] != _UTF8:
        raise DecodeError("value", certificate, 0, "the role in the certificate is not one UTF8String")
    try:
        return values[0][1].decode()
    except UnicodeDecodeError:
        raise DecodeError("value", certificate, 0, "the role in the certificate is not UTF-8") from None


def _parts(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the values in a row of DER: tag and content."""
    place = 0
    while place < len(data) or not data:
        if place + 2 > len(data):
            raise DecodeError("short", data, len(data), "DER ends within a value")
        tag, size, start = data[place], data[place + 1], place + 2
        if size == 0x80:
            raise DecodeError("value", data, place + 1, "a length that is not given: DER has only known lengths")
        if size & 0x80:
            start += size & 0x7F
            size = int.from_bytes(data[place + 2 : start], "big")
        if start + size > len(data):
            raise DecodeError("short", data, len(data), "DER ends within a value")
        yield tag, data[start : start + size]
        place = start + size
