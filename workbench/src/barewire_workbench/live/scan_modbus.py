"""Scan a Modbus endpoint: its units, their settings, what they are, and which addresses they have.

    for unit in scan_modbus("rtu:///dev/ttyUSB0"):
        print(unit.url, unit.why, unit.device)

Settings that the URL names are kept. The others of a serial line are tried, the likely ones first (`serial_settings`):
the units 1 to 10 and 247 with each of them, then the others; the first settings with which a unit answers are taken for
all the rest. A pseudo-terminal has no settings, so its units are asked once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from barewire import ModbusClient, NoAnswer
from barewire.conversation import Conversation
from barewire.devices import Device
from barewire.errors import DecodeError, EncodeError, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.modbus.carriers import modbus_endpoint
from barewire.io.ports.pty import is_pseudo_terminal
from barewire.modbus.client.bus import Bus
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.messages.identification import ReportServerId
from barewire_workbench.scan.addresses import TABLES, AddressRange, ConnectionClosed, find_addresses
from barewire_workbench.scan.identity import DeviceIdentity, device_of, known_devices
from barewire_workbench.scan.serial_settings import LineSettings, combinations
from barewire_workbench.scan.units import ScannedUnit, UnitScanner, likely_first

_IDENTIFY_TIMEOUT = 0.5
"""Seconds that a unit which has answered has for each question about what it is; three times its first answer, if that
is longer."""

_FORMAT = frozenset({"parity", "stopbits", "bytesize"})
_SETTINGS = _FORMAT | {"baudrate"}

_FAILURES = 3
"""Connections in a row that fail before the scan ends."""


@dataclass(slots=True)
class FoundUnit:
    """A unit that gave a sign of life: the URL to use it, the evidence, and what it is, as far as it says so."""

    url: str
    scanned: ScannedUnit
    settings: LineSettings | None = None
    identity: DeviceIdentity = field(default_factory=DeviceIdentity)
    device: Device | None = None

    @property
    def unit(self) -> int:
        """Its address."""
        return self.scanned.unit

    def as_dict(self) -> dict[str, object]:
        """The unit, for JSON."""
        after = self.scanned.answered_after
        return {
            "unit": self.unit,
            "url": self.url,
            "why": self.scanned.why,
            "exception": self.scanned.exception,
            "answered_after": None if after is None else round(after, 4),
            "two_devices": self.scanned.is_doubled,
            "damaged": self.scanned.damaged,
            "device": self.device.name if self.device else None,
            "identity": self.identity.as_dict(),
        }


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a scan is: what is asked now, and at most how many seconds it still takes."""

    unit: int
    settings: LineSettings | None
    seconds_left: float


@dataclass(slots=True)
class ModbusScan:
    """A scan of an endpoint. `run` yields the units as they are found; the attributes are the result afterwards.

    unreachable   how many units a gateway reported as not answering
    stray         frames and noise that no request explains
    protocol      what the other side of a TCP connection speaks in place of Modbus: HTTP, SSH or TLS
    closed        how many requests the server answered by closing the connection
    tried         the settings of the line that were tried
    """

    endpoint: Endpoint
    units: Sequence[int]
    settings: Sequence[LineSettings] = ()
    every: bool = False
    devices: Sequence[Device] = ()
    connect: Callable[..., ModbusClient] = ModbusClient
    progress: Callable[[Progress], None] | None = None
    unreachable: int = 0
    stray: int = 0
    protocol: str = ""
    closed: int = 0
    tried: list[LineSettings] = field(default_factory=list)

    def run(self) -> Iterator[FoundUnit]:
        """Scan, and yield each unit when it is known what it is. Raises PortError if the endpoint cannot be used."""
        rounds = self._rounds()
        left = sum(len(units) * self._seconds(settings) for settings, units in rounds)
        chosen: LineSettings | None = None
        for settings, units in rounds:
            duration = self._seconds(settings)
            left -= len(units) * duration
            if chosen is not None and settings != chosen and not self.every:
                continue
            if settings is not None and settings not in self.tried:
                self.tried.append(settings)
            for found in self._pass(settings, units, 0.0 if chosen and not self.every else left):
                if found.scanned.answers:
                    chosen = chosen or settings
                yield found

    def _rounds(self) -> list[tuple[LineSettings | None, list[int]]]:
        """Return what is tried, in its order: settings with the units that are asked."""
        if len(self.settings) < 2:
            return [(self.settings[0] if self.settings else None, list(self.units))]
        likely, others = likely_first(self.units)
        return [(settings, units) for units in (likely, others) if units for settings in self.settings]

    def _timeout(self, settings: LineSettings | None) -> float:
        if settings is None and self.endpoint.is_serial_port:  # a pseudo-terminal
            from barewire.io.ports.serial import SerialSettings  # needs pyserial

            settings = LineSettings(*SerialSettings.of(self.endpoint))
        if "timeout" in self.endpoint.options or settings is None:
            return self.endpoint.timeout
        return settings.timeout(self.endpoint.framing)

    def _seconds(self, settings: LineSettings | None) -> float:
        """Return how long one silent unit takes: the time-out, and a tenth for the request and the silences."""
        return 1.1 * self._timeout(settings)

    def _url(self, settings: LineSettings | None, unit: int | None = None) -> str:
        options: dict[str, Any] = dict(settings.options) if settings else {}
        if unit is not None:
            options["unit"] = unit
        return str(Endpoint.parse(str(self.endpoint), options))

    def _pass(self, settings: LineSettings | None, units: Sequence[int], later: float) -> Iterator[FoundUnit]:
        """Ask all `units` with these settings. `later` is the time of the passes after it, in seconds."""
        timeout, duration = self._timeout(settings), len(units) * self._seconds(settings)
        scanner = UnitScanner(timeout)
        result = scanner.result
        known: set[int] = set()
        failures = 0
        until = time.monotonic() + duration
        with self.connect(self._url(settings), retries=0) as client:
            # What the line delivers while a unit is asked what it is.
            client.bus.state.on_stray = lambda event, late: scanner.add(event, time.monotonic())
            for unit in [*units, None]:  # None: late answers of the last units
                if self.progress is not None and unit is not None:
                    self.progress(Progress(unit, settings, max(0.0, until - time.monotonic()) + later))
                try:
                    if unit is not None:
                        client.run_with_bus(partial(_ask, scanner, unit))
                    elif not client.bus.line.numbered:
                        client.run_with_bus(lambda bus: scanner.listen(bus.line, timeout))
                    failures = 0
                except PortError:
                    if self.endpoint.is_serial_port:
                        raise
                    if unit in result.asked:  # some servers close the connection when they do not know the unit
                        self.closed += 1
                        continue
                    failures += 1
                    if failures == _FAILURES:
                        raise
                for number in [number for number in result.units if number not in known]:
                    known.add(number)
                    found = FoundUnit(self._url(settings, number), result.units[number], settings)
                    try:
                        self._identify(client, found)
                    except PortError:
                        yield found
                        raise
                    yield found
        self.unreachable += len(result.unreachable - known)
        self.stray += result.stray
        self.protocol = self.protocol or result.protocol

    def _identify(self, client: ModbusClient, found: FoundUnit) -> None:
        """Ask a unit what it is, unless it gave damaged answers only. Raises PortError if a serial port fails."""
        scanned = found.scanned
        if not (scanned.answers and scanned.unit):
            return
        timeout = max(_IDENTIFY_TIMEOUT, 3 * (scanned.answered_after or 0.0))
        unit = client.at(scanned.unit, timeout=timeout)
        found.identity = identify(unit, may_close=not self.endpoint.is_serial_port)
        found.device = device_of(found.identity, self.devices)


def _ask(scanner: UnitScanner, unit: int, bus: Bus) -> Conversation[bytes, None]:
    return scanner.ask(bus.line, unit)


def identify(client: ModbusClient, *, may_close: bool = False) -> DeviceIdentity:
    """Ask a unit what it is: 11h, and the basic objects of 2B/0Eh. What it does not answer stays empty; with
    `may_close` also if it closes the connection."""
    identity = DeviceIdentity()
    for question in QUESTIONS.values():
        with suppress(ModbusException, NoAnswer, DecodeError, *((PortError,) if may_close else ())):
            question(client, identity)
    return identity


def _ask_server_id(client: ModbusClient, identity: DeviceIdentity) -> None:
    identity.server_id = client.ask(ReportServerId()).data


def _ask_texts(client: ModbusClient, identity: DeviceIdentity) -> None:
    identity.texts = client.read_device_identification().texts()


QUESTIONS: dict[str, Callable[[ModbusClient, DeviceIdentity], None]] = {
    "server_id": _ask_server_id,
    "texts": _ask_texts,
}
"""How a unit is asked for the keys of a table [identity]; raise the errors of a request."""


def scan_modbus(
    url: str,
    units: Iterable[int] = range(1, 248),
    *,
    baudrates: Sequence[int] | None = None,
    formats: Sequence[str] | None = None,
    every: bool = False,
    descriptions: Iterable[str] = (),
    connect: Callable[..., ModbusClient] = ModbusClient,
    progress: Callable[[Progress], None] | None = None,
) -> ModbusScan:
    """Return the scan of a Modbus endpoint; `run` carries it out.

    units          the addresses that are asked, in this order
    baudrates      of a serial line, those that are tried; by default that of the URL, or all usual ones
    formats        the same for data bits, parity and stop bits, such as "8E1"
    every          go on with other settings after a unit has answered
    descriptions   directories of device descriptions beside the catalogue, to name what is found
    connect        opens the client of a URL
    progress       called before each unit

    Raises EncodeError for wrong arguments.
    """
    endpoint = modbus_endpoint(url)
    has_settings = endpoint.is_serial_port and not is_pseudo_terminal(endpoint.place)
    if not has_settings and (baudrates or formats):
        text = "it has no baud rate and no format: they are for serial ports, of which a pseudo-terminal is none"
        raise EncodeError(f"endpoint {str(endpoint)!r}: {text}")
    settings: list[LineSettings] = []
    if has_settings:
        settings = _settings(endpoint, baudrates, formats)
        endpoint = _without(endpoint, _SETTINGS)
    endpoint = _without(endpoint, frozenset(["unit"]))
    numbers = list(units)
    if endpoint.framing != "tcp" and 0 in numbers:
        raise EncodeError("unit 0 is the broadcast of a serial line, which no device answers: expected 1..247")
    return ModbusScan(endpoint, numbers, settings, every, known_devices(descriptions), connect, progress)


def _settings(endpoint: Endpoint, baudrates: Sequence[int] | None, formats: Sequence[str] | None) -> list[LineSettings]:
    """Return the settings to try: what is given, then what the URL names, then all usual ones."""
    if baudrates is None and "baudrate" in endpoint.options:
        baudrates = [endpoint.integer("baudrate", 0)]
    if formats is None and _FORMAT & endpoint.options.keys():
        parts = (endpoint.choice("bytesize", "8"), endpoint.choice("parity", "E"), endpoint.choice("stopbits", "1"))
        formats = ["".join(parts)]
    try:
        return combinations(endpoint.framing, baudrates, formats)
    except ValueError as error:
        raise EncodeError(f"formats: {error}") from None


def _without(endpoint: Endpoint, keys: frozenset[str]) -> Endpoint:
    return endpoint._replace(options={key: text for key, text in endpoint.options.items() if key not in keys})


def scan_addresses(
    client: ModbusClient, table: str, first: int, last: int, *, progress: Callable[[int], None] | None = None
) -> Iterator[AddressRange]:
    """Yield the addresses of a table of the client's unit that can be read, in their order. It only reads.

    `progress` is called with the first address of each block.

    Raises NoAnswer if the unit does not answer, PortError if the port fails or the server is gone, EncodeError for an
    unknown table or wrong addresses.
    """
    if table not in TABLES:
        raise EncodeError(f"table {table!r}: expected one of {', '.join(TABLES)}")
    if not 0 <= first <= last <= 0xFFFF:
        raise EncodeError(f"addresses {first}-{last}: expected 0..65535, the smaller one first")
    request, limit = TABLES[table]
    is_connection = client.connection.endpoint.transport in ("tcp", "tls")

    def read(address: int, count: int) -> object:
        if progress is not None:
            progress(address)
        if not is_connection:
            return client.ask(request(address, count))
        for _ in range(2):  # the first connection may have been closed before the request
            client.open()
            with suppress(PortError):
                return client.ask(request(address, count))
        raise ConnectionClosed("the connection was closed")

    return find_addresses(read, first, last, limit=limit)
