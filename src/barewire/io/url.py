"""Splits URLs into scheme, place and options, without `urllib.parse`, which takes 20 ms to load; checks host names.

        rtu:///dev/tty%23USB0?baudrate=9600&unit=7     ->     rtu     /dev/tty#USB0     (baudrate, 9600), (unit, 7)
        |-|   |--------------||-------------------|           %23 is a byte in hexadecimal, in options + is a blank

`tests/io/test_url.py` compares it with `urllib`.
"""

from __future__ import annotations

_HEXADECIMAL = frozenset("0123456789abcdefABCDEF")


def split(url: str) -> tuple[str, str, str]:
    """Return the scheme in lower case ("" without "://"), the part before the first "?", and the part after it.

    >>> split("TCP://10.0.0.5:502?unit=1")
    ('tcp', '10.0.0.5:502', 'unit=1')
    """
    scheme, mark, rest = url.strip().partition("://")
    place, _, query = rest.partition("?")
    return scheme.lower() if mark else "", place, query


def pairs(query: str) -> list[tuple[str, str]]:
    """Return the options in their order. An option without "=" has the value "".

    >>> pairs("unit=1&server_name=a+b%26c&lazy")
    [('unit', '1'), ('server_name', 'a b&c'), ('lazy', '')]
    """
    found = []
    for option in query.replace("+", " ").split("&"):
        if option:
            key, _, value = option.partition("=")
            found.append((unquote(key), unquote(value)))
    return found


def unquote(text: str) -> str:
    """Replace %XX by bytes. A "%" without two digits remains; bytes that are not UTF-8 become U+FFFD.

    >>> unquote("/dev/tty%23%C3%A9"), unquote("100%")
    ('/dev/tty#é', '100%')
    """
    first, *parts = text.split("%")
    data = first.encode("utf-8", "surrogatepass")
    for part in parts:
        code, rest = part[:2], part[2:]
        if len(code) == 2 and _HEXADECIMAL.issuperset(code):
            data += bytes.fromhex(code) + rest.encode("utf-8", "surrogatepass")
        else:
            data += b"%" + part.encode("utf-8", "surrogatepass")
    return data.decode("utf-8", "replace") if parts else text


def can_be_host(name: str) -> bool:
    """Return whether a text can be the name or address of a host: its labels have up to 63 letters, all together 253.

    The empty text can: it is any address of this machine.

    >>> can_be_host("gateway.local"), can_be_host("a..b"), can_be_host(64 * "a"), can_be_host("zähler")
    (True, False, False, True)
    """
    if not name.isprintable() or len(name) > 253:
        return False
    if name.isascii():
        *labels, last = name.split(".")
        return all(0 < len(label) < 64 for label in labels) and len(last) < 64
    try:
        return bool(name.encode("idna"))  # loads a codec, and `re` with it
    except UnicodeError:
        return False
