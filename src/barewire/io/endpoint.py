"""Endpoints: URLs that name a port or bus and its options. Clients, servers and all commands take them.

tcp://127.0.0.1:1502?unit=1               Modbus TCP
tls://10.0.0.5?cert=me.crt&key=me.key&ca=ca.crt        the same inside TLS; port 802
udp://10.0.0.5:502                        the same frames, each in a datagram
rtu:///dev/ttyUSB0?baudrate=19200&parity=E&stopbits=1&unit=1
ascii:///dev/ttyUSB0?baudrate=9600&bytesize=7&parity=E
rtu+tcp://10.0.0.5:4001                   a serial line behind a transparent serial server; ascii+tcp:// too
rtu://pty                                 a new pseudo-terminal (for a server)
can://socketcan/can0?node=1               a CAN interface of Linux; others as python-can names them, such as slcan
can://socketcand/127.0.0.1:29536/can0     a bus between processes, HOST:PORT/BUS

scheme          option           default           meaning
all Modbus      unit             device's own, 1   address of the unit, 0..255
                timeout          1                 seconds that a request waits for its response
                gap              0                 seconds between two exchanges with a unit
                dead_after       0: never          unanswered requests after which a unit is not asked for a while,
                longest_pause    30                which doubles up to so many seconds
                gap.7, ...       as gap, ...       one of these four for unit 7 alone
                late_window      3 time-outs       seconds in which a late answer is expected
                recovery         probe             after an unanswered request: probe the unit, or wait late_window
                retries          0                 how often a read without a response is repeated; a write never is
all             reconnect_first, 0.125, 30         seconds of the pause after the first failed attempt to connect, and
                reconnect_longest                  of the longest one: it doubles each time
tcp, tls, udp   any_unit         0                 1: accept answers of another unit
                any_transaction  0                 1: accept answers with any transaction number
tcp, tls,       connections      1024              server: connections at a time
  tunnels       idle             0                 server: seconds without a request until it closes; 0: no limit
tls             cert, key, ca                      files; a client may leave out cert and key
                server_name      the host          name in the certificate of the server
                roles                              server: a file, or "any"
                client_cert      required          server: none: it asks clients for no certificate
rtu, ascii      baudrate         19200             bit/s; of a machine by name its description has the defaults
                parity           E                 N, E or O
                stopbits         1                 1, 1.5 or 2
                bytesize         8                 8, for ascii also 7
                rs485            off               what sets the direction of the line: off, kernel or rts
                pace             0, server 1       1: send on a pseudo-terminal as slowly as on a real line
rtu, ascii,     patience         as latency        seconds of the longest pause in a frame, or "strict"; ascii: 1
  tunnels       echo             0                 1: what is sent comes back first; auto: find out
rtu, rtu+tcp    latency          usb, tunnel       uart, usb or tunnel: see LATENCIES
can             node             device's own, 1   node-ID, 1..127
                timeout          1                 seconds
                retries          0                 how often a lost SDO upload is repeated
                dialect          standard          how SDO requests are written
                bitrate          125000            bit/s
                ...                                options of the interface, as python-can names them

The tunnels are rtu+tcp and ascii+tcp. The table `CARRIERS` has the framing and the transport of each scheme.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from os import PathLike, fspath
from typing import TYPE_CHECKING, NamedTuple

from barewire.conversation import DEFAULT_TIMEOUT, check_request_timeout
from barewire.errors import EncodeError, shown, suggest

if TYPE_CHECKING:
    from ssl import SSLContext

    from barewire.io.adapter import Adapter

PSEUDO_TERMINAL = "pty"
DEFAULT_BAUDRATE = 19200
"""Of a serial line, in bit/s [MB-SERIAL 2.5.1]."""
DEFAULT_BITRATE = 125_000
"""Of a CAN bus, in bit/s."""
DEFAULT_ASCII_PATIENCE = 1.0
"""The longest pause, in seconds, that is tolerated inside an ASCII frame [MB-SERIAL 2.5.2.1]."""
PAUSES = 0.125, 30.0
"""The pause after the first failed attempt to connect, and the longest one, in seconds."""
_SHORTEST_PAUSE = 0.001
LATENCIES = {"uart": 0.005, "usb": 0.030, "tunnel": 0.200}
"""The longest pause, in seconds, that is tolerated inside an RTU frame, by the hardware that carries the bytes. The
FIFO of a UART and the scheduler delay bytes for milliseconds, USB adapters for twice 16 ms, a network without limit."""

UNIT_OPTIONS = ("timeout", "gap", "dead_after", "longest_pause")
"""The options that a single unit may have for itself, such as gap.7; see `UnitOptions` of `barewire.modbus`."""
_PAUSES = frozenset({"reconnect_first", "reconnect_longest"})
_ALL = _PAUSES | {*UNIT_OPTIONS, "unit", "late_window", "recovery", "retries"}
_TCP = _ALL | {"any_unit", "any_transaction", "connections", "idle"}
_TLS = _TCP | {"cert", "key", "ca", "server_name", "roles", "client_cert"}
_UDP = _ALL | {"any_unit", "any_transaction"}
_SERIAL = _ALL | {"baudrate", "parity", "stopbits", "bytesize", "patience", "pace", "echo", "rs485"}
_TUNNEL = _ALL | {"patience", "echo", "connections", "idle"}

CAN_OPTIONS = _PAUSES | {"node", "timeout", "retries", "bitrate", "dialect"}
"""The options of a can endpoint, besides those of its interface."""
_OF_SERVERS = frozenset({"connections", "idle", "roles", "client_cert"})
_KEYWORDS = (
    "units",
    "in_flight",
    "lazy",
    "set_direction",
    "ssl_context",
    "watch",
    "on_lost",
    "faults",
    "on_fault",
    "device",
    "eds",
)
"""Keyword arguments of clients and servers that a URL cannot hold; suggested in place of a misspelt one."""
_OTHER_NAMES = {"unit": "node", "node": "unit", "baudrate": "bitrate", "bitrate": "baudrate"}
"""Options with another name in the other protocol."""


class Carrier(NamedTuple):
    """The meaning of a scheme: the framing of Modbus messages (rtu, ascii or tcp), and the transport of the frames.

    `dialer` of `barewire.io.modbus.carriers` has the port of each transport for blocking clients, `connect` of
    `barewire.io.ports.async_links` for asyncio clients.
    """

    framing: str
    transport: str
    options: frozenset[str]
    default_port: int = 502


CARRIERS = {
    "tcp": Carrier("tcp", "tcp", _TCP),
    "tls": Carrier("tcp", "tls", _TLS, default_port=802),
    "udp": Carrier("tcp", "udp", _UDP),
    "rtu": Carrier("rtu", "serial", _SERIAL | {"latency"}),
    "ascii": Carrier("ascii", "serial", _SERIAL),
    "rtu+tcp": Carrier("rtu", "tcp", _TUNNEL | {"latency"}),
    "ascii+tcp": Carrier("ascii", "tcp", _TUNNEL),
}
"""All carriers of Modbus, by scheme."""

_INTEGERS = {
    "unit": (0, 255),
    "node": (1, 127),
    "dead_after": (0, 1_000_000),
    "retries": (0, 1000),
    "connections": (1, 1_000_000),
    "baudrate": (1, 100_000_000),
    "bitrate": (1000, 1_000_000),
    "receive_buffer": (1, 1 << 30),
}
"""Options that are whole numbers: the smallest and the largest."""
_SECONDS = {"timeout", "gap", "longest_pause", "late_window", "idle", "patience"} | _PAUSES
_CHOICES = {
    "parity": ("N", "E", "O"),
    "stopbits": ("1", "1.5", "2"),
    "bytesize": ("7", "8"),
    "latency": tuple(LATENCIES),
    "echo": ("0", "1", "auto"),
    "rs485": ("off", "kernel", "rts"),
    "recovery": ("probe", "wait"),
    "any_unit": ("0", "1"),
    "any_transaction": ("0", "1"),
    "pace": ("0", "1"),
    "client_cert": ("required", "none"),
}
"""Options that are one of a few words."""

_SOCKETCAND_PORT = 29536


def _error(url: str, text: str, key: str | None = None) -> EncodeError:
    return EncodeError(f"endpoint {shown(url, 200)}: {text}", key)


def socketcand_address(channel: str) -> tuple[str, int]:
    """Return HOST and PORT of the channel of a socketcand endpoint, HOST:PORT/BUS.

    >>> socketcand_address("127.0.0.1:29536/can0")
    ('127.0.0.1', 29536)
    """
    host, _, port = channel.partition("/")[0].partition(":")
    number = int(port[:9]) if port.isascii() and port.isdecimal() else _SOCKETCAND_PORT
    if number > 0xFFFF:
        raise EncodeError(f"{shown(channel)}: port {number} is not a number in 0..65535")
    return host, number


def check_timeout(timeout: object) -> None:
    """Raise EncodeError for the time-out of a request that never ends (inf, nan), is negative, or is not a number."""
    check_wait(timeout)
    if isinstance(timeout, (int, float)):
        check_request_timeout(timeout)


def check_wait(timeout: object) -> None:
    """Raise EncodeError for a time-out that is negative, is not a number, or is nan. A wait for what comes by itself
    leaves nothing behind, so it may be endless (inf)."""
    if timeout is not None and not (isinstance(timeout, (int, float)) and timeout >= 0):
        raise EncodeError(f"time-out {shown(timeout)}: expected 0 or more seconds", "timeout")


SetDirection = Callable[[bool], None]
"""Sets the direction of a two-wire line: called with True before the first bit is sent, with False after the last."""


def _text(url: str, key: str, value: object) -> str:
    """Return a keyword argument as a URL has it: True is 1, 0.5 is 0.5, a path is its text."""
    if isinstance(value, (str, PathLike)):
        return str(fspath(value))
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() else str(value)
    if isinstance(value, int) and value.bit_length() <= 256:
        return str(int(value))
    raise _error(url, f"{key}={shown(value)}: expected a text, a number, a boolean or a path", key)


def unknown_option(
    url: str, key: str, known: Collection[str], keywords: Collection[str] = (), further: str = ""
) -> EncodeError:
    """Return the error of an option that is not in `known`, with the nearest name of those or of `keywords`. `further`
    follows the list of the known ones."""
    of_servers = ", ".join(sorted(_OF_SERVERS.intersection(known)))
    expected = ", ".join(sorted(set(known) - _OF_SERVERS)) + (f", of servers also {of_servers}" if of_servers else "")
    other = _OTHER_NAMES.get(key)
    if other in known:
        hint = f"; did you mean {other!r}?"
    else:
        hint = "" if key in keywords else suggest(key, dict.fromkeys((*sorted(known), *keywords)))
    return _error(url, f"unknown option {shown(key)}, expected {expected}{further}{hint}", key)


def split_name(key: str) -> tuple[str, str | None]:
    """Return the name of an option and the unit that has it for itself, None for all units.

    >>> split_name("gap.7"), split_name("gap")
    (('gap', '7'), ('gap', None))
    """
    name, dot, unit = key.partition(".")
    return name, unit if dot else None


def _check_name(url: str, key: str, known: Collection[str], keywords: Collection[str]) -> None:
    """Raise EncodeError for an option that the scheme does not have, or that a unit does not have for itself."""
    name, unit = split_name(key)
    if unit is None and name not in known:
        raise unknown_option(url, key, known, keywords)
    if unit is not None and name not in UNIT_OPTIONS:
        forms = [f"{option}.{unit}" for option in sorted(UNIT_OPTIONS)]
        raise unknown_option(url, key, forms)
    if unit is not None and not (unit.isdecimal() and str(int(unit[:9])) == unit and int(unit) <= 255):
        raise _error(url, f"{shown(key)}: expected {name}.UNIT, a unit address in 0..255, such as {name}.7", key)


def _merged(url: str, scheme: str, in_url: list[tuple[str, str]], options: Mapping[str, object]) -> dict[str, str]:
    """Return the options of a URL, overridden by `options`. Raise EncodeError for one that the scheme does not have."""
    merged = dict(in_url)
    if len(merged) < len(in_url):
        raise _error(url, "an option is given twice")
    given = {key: value for key, value in options.items() if value is not None}
    if scheme in CARRIERS:
        known = CARRIERS[scheme].options
        for key in (*merged, *given):
            _check_name(url, key, known, _KEYWORDS if key in given else ())
    for key in merged:
        if scheme == "can" and split_name(key)[1] is not None:
            raise unknown_option(url, key, CAN_OPTIONS, (), ", and those of the interface")
    for key, value in given.items():
        if scheme == "can" and key not in CAN_OPTIONS and not isinstance(value, (str, PathLike, int, float)):
            raise unknown_option(url, key, CAN_OPTIONS, _KEYWORDS, ", and those of the interface")
    return merged | {key: _text(url, key, value) for key, value in given.items()}


def _checked_place(url: str, scheme: str, place: str) -> str:
    """Return the place of a URL. Raise EncodeError if it is empty, or not INTERFACE/CHANNEL of a CAN bus."""
    if scheme in ("rtu", "ascii") and place.lower() in (PSEUDO_TERMINAL, f"/{PSEUDO_TERMINAL}"):
        return PSEUDO_TERMINAL
    interface, _, channel = place.partition("/")
    if scheme == "can":
        if not interface or not channel:
            hint = f"; did you mean 'can://socketcan/{interface}'?" if interface.startswith(("can", "vcan")) else ""
            raise _error(url, f"expected can://INTERFACE/CHANNEL, as python-can names them{hint}")
        socketcand_address(channel)
    if scheme in ("rtu", "ascii") and place.startswith("dev/"):
        raise _error(url, f"did you mean '{scheme}:///{place}', with three slashes?")
    if not place.strip("/") or "\0" in place:
        raise _error(url, "it names no port")
    return place


class Endpoint(NamedTuple):
    """The parts of a URL. `place` is HOST:PORT, the path of a serial device, or INTERFACE/CHANNEL.

    `set_direction`, `ssl_context` and `adapter` are what a URL cannot hold: see `with_direction`, `with_context`, and
    `barewire.io.adapter`.

    >>> endpoint = Endpoint.parse("rtu:///dev/ttyUSB0?baudrate=9600&unit=7")
    >>> endpoint.scheme, endpoint.place, endpoint.integer("unit", 1), endpoint.integer("baudrate", 19200)
    ('rtu', '/dev/ttyUSB0', 7, 9600)
    """

    scheme: str
    place: str
    options: Mapping[str, str]
    set_direction: SetDirection | None = None
    ssl_context: SSLContext | None = None
    adapter: Adapter | None = None

    @classmethod
    def parse(cls, url: str, options: Mapping[str, object] | None = None) -> Endpoint:
        """Return the parts of a URL. `options` are added to those of the URL and override them; None leaves one out.

        Raises EncodeError with the fault and the expected values.

        >>> Endpoint.parse("tcp://10.0.0.5?unit=1", {"unit": 7, "any_unit": True}).options
        {'unit': '7', 'any_unit': '1'}
        """
        if not isinstance(url, str):
            raise EncodeError(f"endpoint {shown(url)}: expected a URL as a string, such as 'tcp://10.0.0.5:502'")
        scheme, place, query = split(url)
        if scheme not in CARRIERS and scheme != "can":
            forms = "tcp://HOST:PORT (also tls, udp, rtu+tcp, ascii+tcp), rtu:///dev/..., ascii:///dev/..., can://..."
            raise _error(url, f"expected {forms}{suggest(scheme, (*CARRIERS, 'can'))}")
        if "#" in url:
            raise _error(url, "'#' has no meaning in an endpoint; in a name it is %23")
        if "?" in query:
            raise _error(url, "a second '?': options are joined with '&'; in a name it is %3F")
        merged = _merged(url, scheme, pairs(query), options or {})
        endpoint = cls(scheme, _checked_place(url, scheme, unquote(place)), merged)
        if scheme != "can" and not endpoint.is_serial_port:
            _ = endpoint.host_and_port  # raises for a wrong one before anything is opened
        for key in merged:
            endpoint._check(key)
        _ = endpoint.pauses
        if scheme == "rtu" and merged.get("bytesize") == "7":
            raise _error(url, "bytesize=7: RTU needs 8 data bits, ascii:// may have 7")
        return endpoint

    def _check(self, key: str) -> None:
        """Raise EncodeError for a wrong value, before the option is used."""
        name, _ = split_name(key)
        if name in _INTEGERS:
            self.integer(key, 1)
        elif key in _CHOICES:
            self.choice(key, "")
        elif name in _SECONDS and not (key == "patience" and self.framing == "rtu" and self.options[key] == "strict"):
            self.seconds(key, 0.0)
        elif key == "server_name" and not (self.options[key] and can_be_host(self.options[key])):
            raise _error(str(self), f"{key}={shown(self.options[key])}: expected a name or address", key)

    def __str__(self) -> str:
        query = "&".join(f"{key}={value}" for key, value in self.options.items())
        return f"{self.scheme}://{self.place}" + (f"?{query}" if query else "")

    def with_direction(self, set_direction: SetDirection | None) -> Endpoint:
        """Return the same endpoint with a function that sets the direction of its two-wire line, for example by a GPIO
        pin. Raises EncodeError if the endpoint is not a serial port, or has `rs485=` already."""
        if set_direction is None:
            return self
        if not self.is_serial_port:
            raise _error(str(self), "set_direction= is for rtu:// and ascii://", "set_direction")
        if self.options.get("rs485", "off") != "off":
            raise _error(str(self), "rs485= and set_direction= set the direction, give one of them", "set_direction")
        return self._replace(set_direction=set_direction)

    def with_context(self, context: SSLContext | None) -> Endpoint:
        """Return the same endpoint with TLS settings of the program, in place of those of its files. Raises EncodeError
        if the endpoint is not TLS, or names files too."""
        if context is None:
            return self
        if self.transport != "tls":
            raise _error(str(self), "ssl_context= is for tls://", "ssl_context")
        given = sorted(self.options.keys() & {"cert", "key", "ca"})
        if given:
            raise _error(
                str(self), f"{', '.join(given)} and ssl_context= set the certificates, give one", "ssl_context"
            )
        return self._replace(ssl_context=context)

    @property
    def timeout(self) -> float:
        """Seconds that a request waits for its response."""
        return self.seconds("timeout", DEFAULT_TIMEOUT)

    @property
    def own_units(self) -> list[int]:
        """The units that have options for themselves."""
        return sorted({int(unit) for _, unit in map(split_name, self.options) if unit is not None})

    @property
    def pauses(self) -> tuple[float, float]:
        """Seconds of the pause after the first failed attempt to connect, and of the longest one."""
        for key in _PAUSES & self.options.keys():
            if self.seconds(key, 0.0) < _SHORTEST_PAUSE:
                raise _error(str(self), f"{key}={shown(self.options[key])}: expected {_SHORTEST_PAUSE} s or more", key)
        first, longest = (self.seconds(key, pause) for key, pause in zip(sorted(_PAUSES), PAUSES))
        if first <= longest:
            return first, longest
        if self.options.keys() >= _PAUSES:
            key, expected = "reconnect_longest", f"expected reconnect_first={first:g} or more"
            raise _error(str(self), f"{key}={shown(self.options[key])}: {expected}", key)
        return (first, first) if "reconnect_first" in self.options else (longest, longest)

    @property
    def framing(self) -> str:
        """The framing of messages: rtu, ascii or tcp; "can" for a CAN bus."""
        return CARRIERS[self.scheme].framing if self.scheme in CARRIERS else self.scheme

    @property
    def transport(self) -> str:
        """The transport: tcp, tls, udp or serial; "can" for a CAN bus."""
        return CARRIERS[self.scheme].transport if self.scheme in CARRIERS else self.scheme

    @property
    def is_serial_port(self) -> bool:
        """Whether `place` is a serial device, not a host."""
        return self.transport == "serial"

    @property
    def is_datagram(self) -> bool:
        """Whether each frame is a datagram."""
        return self.transport == "udp"

    @property
    def host_and_port(self) -> tuple[str, int]:
        """Host and port number, by default 502, for TLS 802. In the URL an IPv6 address is in brackets."""
        host, colon, port = self.place.rpartition(":")
        if not colon or port.endswith("]"):
            host, port = self.place, str(CARRIERS[self.scheme].default_port)
        bracketed = host.startswith("[") and host.endswith("]")
        if bracketed != (":" in host) or "[" in host.strip("[]"):
            raise _error(str(self), "an IPv6 address stands in brackets, as [::1]:502")
        if not (port.isascii() and port.isdecimal()) or len(port) > 9 or int(port) > 0xFFFF:
            raise _error(str(self), f"port {shown(port)} is not a number in 0..65535")
        if not can_be_host(host):
            raise _error(str(self), f"{shown(host)} cannot be the name of a host")
        return host.strip("[]"), int(port)

    def integer(self, key: str, default: int) -> int:
        """Return an option that is a whole number."""
        if (text := self.options.get(key)) is None:
            return default
        smallest, largest = _INTEGERS[split_name(key)[0]]
        try:
            number = int(text if text.isascii() else "", 0)  # digits of other scripts are none
        except ValueError:
            raise _error(str(self), f"{key}={shown(text)} is not a whole number") from None
        if not smallest <= number <= largest:
            raise _error(str(self), f"{key} {shown(number)}: expected {smallest}..{largest}")
        return number

    def flag(self, key: str) -> bool:
        """Return an option that is 0 or 1, by default 0."""
        return self.choice(key, "0") == "1"

    def seconds(self, key: str, default: float) -> float:
        """Return an option that is a time in seconds, 0 or more."""
        text = self.options.get(key)
        try:
            number = default if text is None else float(text if text.isascii() else "")
        except ValueError:
            number = -1.0
        if not 0 <= number < float("inf"):
            raise _error(str(self), f"{key}={shown(text)} is not a number of seconds")
        return number

    def choice(self, key: str, default: str) -> str:
        """Return an option that is one of a few words."""
        text, words = self.options.get(key, default), _CHOICES[key]
        for word in words:
            if text.lower() == word.lower():
                return word
        expected = f"expected one of {', '.join(words)}{suggest(text, words)}"
        raise _error(str(self), f"{key}={shown(text)}, {expected}")


# URLs, without `urllib.parse`, which takes 20 ms to load --------------------------------------------------------------
#
#     rtu:///dev/tty%23USB0?baudrate=9600&unit=7     ->     rtu     /dev/tty#USB0     (baudrate, 9600), (unit, 7)
#     |-|   |--------------||-------------------|           %23 is a byte in hexadecimal, in options + is a blank

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
    options = []
    for option in query.replace("+", " ").split("&"):
        if option:
            key, _, value = option.partition("=")
            options.append((unquote(key), unquote(value)))
    return options


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
