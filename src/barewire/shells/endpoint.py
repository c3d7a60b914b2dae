"""Where something is, written as a URL: one way to name a port for every command and every client.

tcp://127.0.0.1:1502?unit=1
rtu:///dev/ttyUSB0?baudrate=19200&parity=E&stopbits=1&unit=1
ascii:///dev/ttyUSB0?baudrate=9600&bytesize=7&parity=E
rtu://pty                                 a new pseudo-terminal (where a simulator is to be started)
can://INTERFACE/CHANNEL?node=1&bitrate=125000          INTERFACE as python-can names it: socketcan, slcan, ...
can://socketcand/127.0.0.1:29536/can0     a bus between processes, HOST:PORT/BUS

scheme   options, and what they are without being said
tcp      unit (the device's own, or 1), timeout (1)
rtu      unit, timeout (1), baudrate (19200), parity (E), stopbits (1), bytesize (8), patience (0.03, or "strict"), pace
ascii    unit, timeout (1), baudrate (19200), parity (E), stopbits (1), bytesize (8), patience (1), pace
can      node (the device's own, or 1), timeout (1), bitrate (125000), and whatever the python-can interface takes
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple
from urllib.parse import parse_qsl, unquote, urlsplit

from barewire.errors import EncodeError

SCHEMES = ("tcp", "rtu", "ascii", "can")
PSEUDO_TERMINAL = "pty"

_SERIAL = frozenset({"unit", "timeout", "baudrate", "parity", "stopbits", "bytesize", "patience", "pace"})
_KNOWN = {"tcp": frozenset({"unit", "timeout"}), "rtu": _SERIAL, "ascii": _SERIAL}


SOCKETCAND_PORT = 29536


def socketcand_address(channel: str) -> tuple[str, int]:
    """HOST and PORT of the channel of a socketcand endpoint, HOST:PORT/BUS.

    >>> socketcand_address("127.0.0.1:29536/can0")
    ('127.0.0.1', 29536)
    """
    host, _, port = channel.partition("/")[0].partition(":")
    return host, int(port) if port.isdecimal() else SOCKETCAND_PORT


class Endpoint(NamedTuple):
    """A URL, taken apart. `place` is HOST:PORT, the path of a serial device, or INTERFACE/CHANNEL.

    >>> endpoint = Endpoint.parse("rtu:///dev/ttyUSB0?baudrate=9600&unit=7")
    >>> endpoint.scheme, endpoint.place, endpoint.integer("unit", 1), endpoint.integer("baudrate", 19200)
    ('rtu', '/dev/ttyUSB0', 7, 9600)
    """

    scheme: str
    place: str
    options: Mapping[str, str]

    @classmethod
    def parse(cls, url: str) -> Endpoint:
        """The URL taken apart; EncodeError says what is wrong with it and what was expected."""
        parts = urlsplit(url)
        if parts.scheme not in SCHEMES or "://" not in url:
            forms = "tcp://HOST:PORT, rtu:///dev/..., ascii:///dev/... or can://INTERFACE/CHANNEL"
            raise EncodeError(f"endpoint {url!r}: expected {forms}")
        options = dict(parse_qsl(parts.query, keep_blank_values=True))
        known = _KNOWN.get(parts.scheme)
        for key in options:
            if known is not None and key not in known:
                raise EncodeError(f"endpoint {url!r}: unknown option {key!r}, expected {', '.join(sorted(known))}")
        place = unquote(parts.netloc + parts.path)
        if parts.scheme == "can":
            interface, _, channel = place.partition("/")
            if not interface or not channel:
                raise EncodeError(f"endpoint {url!r}: expected can://INTERFACE/CHANNEL, as python-can names them")
        if parts.scheme in ("rtu", "ascii") and place.lower() in (PSEUDO_TERMINAL, f"/{PSEUDO_TERMINAL}"):
            place = PSEUDO_TERMINAL
        if not place:
            raise EncodeError(f"endpoint {url!r}: it names no port")
        return cls(parts.scheme, place, options)

    def __str__(self) -> str:
        query = "&".join(f"{key}={value}" for key, value in self.options.items())
        return f"{self.scheme}://{self.place}" + (f"?{query}" if query else "")

    @property
    def host_and_port(self) -> tuple[str, int]:
        """For tcp: 502 is the port that nobody has to say. An IPv6 address stands in brackets."""
        host, colon, port = self.place.rpartition(":")
        if not colon or port.endswith("]"):
            host, port = self.place, "502"
        if not port.isdecimal() or int(port) > 0xFFFF:
            raise EncodeError(f"endpoint {str(self)!r}: port {port!r} is not a number in 0..65535")
        return host.strip("[]"), int(port)

    def integer(self, key: str, default: int) -> int:
        """An option that is a whole number."""
        text = self.options.get(key)
        if text is None:
            return default
        try:
            return int(text, 0)
        except ValueError:
            raise EncodeError(f"endpoint {str(self)!r}: {key}={text!r} is not a whole number") from None

    def seconds(self, key: str, default: float) -> float:
        """An option that is a time in seconds, not negative."""
        text = self.options.get(key)
        try:
            number = default if text is None else float(text)
        except ValueError:
            number = -1.0
        if not 0 <= number < float("inf"):
            raise EncodeError(f"endpoint {str(self)!r}: {key}={text!r} is not a number of seconds")
        return number

    def choice(self, key: str, default: str, choices: tuple[str, ...]) -> str:
        """An option that is one of a few words."""
        text = self.options.get(key, default).upper()
        if text not in choices:
            raise EncodeError(f"endpoint {str(self)!r}: {key}={text!r}, expected one of {', '.join(choices)}")
        return text
