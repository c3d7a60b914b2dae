"""The framing state of an endpoint, for clients and servers, and its port, for clients.

    scheme      framing         port                            a late answer
    tcp, tls    TcpLine         TCP, TLS inside it              is recognized by its transaction number
    udp         DatagramLine    UDP                             is recognized by its transaction number
    rtu, ascii  RtuLine ...     serial                          is recognized by the bus
    rtu+tcp     RtuLine ...     TCP, to a serial server         is recognized by the bus

The table of schemes is `endpoint.CARRIERS`. A framing, and a port with its library, is loaded when a URL needs it.

The types of the keyword options of Modbus clients and servers. `endpoint` describes each option.

A keyword is an option of the URL and overrides it: `ModbusClient("tcp://10.0.0.7", gap=0.1)` is the same as
`ModbusClient("tcp://10.0.0.7?gap=0.1")`. The scheme of a URL determines which options it may have. How a single unit is
asked is written `gap.7=0.1` in a URL, and `units={7: {"gap": 0.1}}` as a keyword.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, TypedDict

from barewire.errors import EncodeError, shown
from barewire.io.endpoint import CARRIERS, DEFAULT_ASCII_PATIENCE, LATENCIES, Endpoint
from barewire.modbus.client.line_state import UnitOptions
from barewire.tcp import DatagramLine, TcpLine

if TYPE_CHECKING:
    from barewire.io.ports.base import Port
    from barewire.modbus.framing import Line
    from barewire.rtu.frame import Timing


class _Pauses(TypedDict, total=False):
    gap: float
    dead_after: int
    longest_pause: float


class UnitKeywords(_Pauses, total=False):
    """The options that a unit may have for itself: see `UnitOptions`."""

    timeout: float


class ModbusOptions(_Pauses, total=False):
    """All options but `unit`, `timeout` and those of single units. Times are in seconds."""

    late_window: float
    recovery: Literal["probe", "wait"]
    retries: int
    reconnect_first: float
    reconnect_longest: float
    any_unit: bool
    any_transaction: bool
    baudrate: int
    parity: Literal["N", "E", "O"]
    stopbits: float
    bytesize: Literal[7, 8]
    latency: Literal["uart", "usb", "tunnel"]
    patience: float | Literal["strict"]
    echo: bool | Literal["auto"]
    rs485: Literal["off", "kernel", "rts"]
    pace: bool
    cert: str | PathLike[str]
    key: str | PathLike[str]
    ca: str | PathLike[str]
    server_name: str
    roles: str | PathLike[str]
    client_cert: Literal["required", "none"]
    connections: int
    idle: float


_Role = Literal["client", "server", "listener"]


def modbus_endpoint(url: str, options: Mapping[str, object] | None = None) -> Endpoint:
    """Return the endpoint of a URL and `options`, as `Endpoint.parse` does. Raises EncodeError if the scheme does not
    carry Modbus."""
    endpoint = Endpoint.parse(url, options)
    if endpoint.scheme not in CARRIERS:
        raise EncodeError(f"endpoint {url!r}: Modbus goes over {', '.join(f'{name}://' for name in CARRIERS)}")
    return endpoint


def modbus_line(endpoint: Endpoint, role: _Role, units: Container[int] = ()) -> Line:
    """Return the framing state of a new connection."""
    line: Line
    if endpoint.framing == "tcp":
        kind = DatagramLine if endpoint.is_datagram else TcpLine
        return kind(any_unit=endpoint.flag("any_unit"), any_transaction=endpoint.flag("any_transaction"))
    if endpoint.framing == "ascii":
        from barewire.ascii import AsciiLine

        bits = 7 if endpoint.options.get("bytesize") == "7" else 8
        line = AsciiLine(character_timeout=endpoint.seconds("patience", DEFAULT_ASCII_PATIENCE), data_bits=bits)
    else:
        from barewire.rtu.line import RtuLine  # loads all messages, to compute their lengths

        line = RtuLine(_timing(endpoint), role=role, units=units, patience=patience(endpoint))
    echo = endpoint.choice("echo", "0")
    if echo == "0":
        return line
    from barewire.modbus.echo import EchoLine

    if echo == "auto":
        # A server needs no such line: the echo of a response of registers is no request, see `Server`.
        return EchoLine(line, echoes=None) if role == "client" else line
    return EchoLine(line)


def patience(endpoint: Endpoint) -> float | None:
    """Return the longest pause tolerated inside an RTU frame, in seconds; None for the standard's 1.5 characters."""
    if endpoint.options.get("patience") == "strict":
        return None
    latency = endpoint.choice("latency", "usb" if endpoint.is_serial_port else "tunnel")
    return endpoint.seconds("patience", LATENCIES[latency])


def timing_in_words(endpoint: Endpoint) -> str:
    """Describe the times of a line in one sentence.

    >>> timing_in_words(Endpoint.parse("rtu:///dev/ttyUSB0?latency=uart"))
    'sends after 2.01 ms of silence (t3.5), accepts pauses up to 5 ms inside a frame'
    >>> timing_in_words(Endpoint.parse("ascii:///dev/ttyUSB0"))
    'waits for no silence, accepts pauses up to 1000 ms between two characters of a frame'
    >>> timing_in_words(Endpoint.parse("tcp://10.0.0.5"))
    'waits for no silence: length fields delimit frames, transaction numbers match responses'
    """
    if endpoint.framing == "tcp":
        return "waits for no silence: length fields delimit frames, transaction numbers match responses"
    if endpoint.framing == "ascii":
        between = 1e3 * endpoint.seconds("patience", DEFAULT_ASCII_PATIENCE)
        return f"waits for no silence, accepts pauses up to {between:g} ms between two characters of a frame"
    timing, pause = _timing(endpoint), patience(endpoint)
    sends = f"sends after {1e3 * timing.t35:.2f} ms of silence (t3.5)" if timing.t35 else "waits for no silence"
    if pause is None:
        return f"{sends}, accepts pauses up to {1e3 * timing.t15:.2f} ms (t1.5) inside a frame"
    return f"{sends}, accepts pauses up to {1e3 * pause:g} ms inside a frame"


def _timing(endpoint: Endpoint) -> Timing:
    if not endpoint.is_serial_port:
        from barewire.rtu.frame import Timing

        return Timing(0.0, 0.0, 0.0)  # the line behind a serial server is unknown; the serial server times its silences
    from barewire.io.ports.serial import SerialSettings

    return SerialSettings.of(endpoint).timing


def dialer(endpoint: Endpoint) -> Callable[[], Port[bytes]]:
    """Return the function that opens the port of a blocking client."""
    if endpoint.transport == "serial":
        from barewire.io.ports.serial import SerialPort  # needs pyserial

        return lambda: SerialPort.of(endpoint)
    if endpoint.transport == "tls":
        from barewire.io.ports.tls import dialer as tls_dialer

        return tls_dialer(endpoint)
    from barewire.io.ports.network import dialer as network_dialer

    return network_dialer(endpoint)


def of_units(units: Mapping[int, UnitKeywords] | None) -> dict[str, object]:
    """Return the options of single units as a URL has them.

    >>> of_units({7: {"gap": 0.1, "timeout": 3}})
    {'gap.7': 0.1, 'timeout.7': 3}
    """
    try:
        return {f"{name}.{unit}": value for unit, given in (units or {}).items() for name, value in given.items()}
    except AttributeError:
        text = "expected the options of units by their addresses, such as {7: {'gap': 0.1}}"
        raise EncodeError(f"units={shown(units)}: {text}", "units") from None


def unit_options(
    endpoint: Endpoint,
    unit: int | None = None,
    default: UnitOptions = UnitOptions(),  # noqa: B008  # cannot be changed
) -> UnitOptions:
    """Return how a unit is asked: by its own options, else by those of all units. With None, by the latter alone.

    >>> unit_options(Endpoint.parse("tcp://10.0.0.5?gap=0.1&timeout.7=3"), 7)
    UnitOptions(timeout=3.0, gap=0.1, dead_after=0, longest_pause=30.0)
    """

    def name(option: str) -> str:
        own = f"{option}.{unit}"
        return own if own in endpoint.options else option

    return UnitOptions(
        endpoint.seconds(name("timeout"), default.timeout),
        endpoint.seconds(name("gap"), default.gap),
        endpoint.integer(name("dead_after"), default.dead_after),
        endpoint.seconds(name("longest_pause"), default.longest_pause),
    )


def bus_options(endpoint: Endpoint) -> dict[str, Any]:
    """Return the arguments of `Bus` that an endpoint has."""
    return {
        "recovery": endpoint.choice("recovery", "probe"),
        "late_window": endpoint.seconds("late_window", 0.0) if "late_window" in endpoint.options else None,
        "retries": endpoint.integer("retries", 0),
        "options": unit_options(endpoint),
        "units": {unit: unit_options(endpoint, unit) for unit in endpoint.own_units},
    }
