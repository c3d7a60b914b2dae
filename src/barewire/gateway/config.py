"""The configuration of a gateway, in TOML: read, checked with line and column, described by a schema and an example.

`OPTIONS` lists every option once: its name, its kind, its default and what it does. The check, the JSON schema for
editors and the commented example are made from this list.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import urlsplit

from barewire.devices.description.load import load
from barewire.devices.device import Device
from barewire.errors import BarewireError, EncodeError, PortError, shown, suggest
from barewire.gateway.backend import BackendOptions
from barewire.gateway.dispatch import ASKING, UnitConfig
from barewire.gateway.policy import AccessRule, Policy
from barewire.io.endpoint import PSEUDO_TERMINAL, UNIT_OPTIONS, Endpoint, split_name
from barewire.io.modbus.carriers import modbus_endpoint, modbus_line, unit_options
from barewire.modbus.server.authorization import Permission

if TYPE_CHECKING:
    from barewire.gateway.publish.publisher import PolledMachine, PublishConfig


class Option(NamedTuple):
    """One option of a table. `kind` is a name in `_KINDS`. A default of None: without the option there is none."""

    name: str
    kind: str
    default: Any
    text: str
    is_required: bool = False


_OF_UNITS = (
    Option("timeout", "time", ASKING.timeout, "how long a response may take"),
    Option("gap", "seconds", ASKING.gap, "the pause between two requests to the same unit"),
    Option(
        "dead_after", "number", ASKING.dead_after, "requests in a row without a response that make it dead; 0: never"
    ),
    Option("longest_pause", "seconds", ASKING.longest_pause, "the longest time for which a dead unit is not asked"),
    Option("cache", "seconds", 0.0, "how long a response also answers identical reads"),
    Option("merge", "number", None, "join adjacent reads; a joined one may read this many values that none asked for"),
)

OPTIONS: dict[str, tuple[Option, ...]] = {
    "": (Option("drain", "seconds", 5.0, "at the end, how long the gateway waits for responses, also for late ones"),),
    "listen": (
        Option("url", "text", None, "where clients connect: tcp, tls, udp, rtu+tcp, ascii+tcp", is_required=True),
    ),
    "backend": (
        Option("name", "text", None, "how the log calls it", is_required=True),
        Option("url", "text", None, "the line: rtu, ascii, tcp, tls, udp, rtu+tcp, ascii+tcp, can", is_required=True),
        Option("units", "units", None, "the units behind it, such as 1-10,20", is_required=True),
        Option("in_flight", "number", 1, "requests under way at once, 1 to 16; on tcp, tls and udp only"),
        Option("settle", "seconds", 0.0, "the pause after connecting, before the first request"),
        Option("idle", "seconds", 0.0, "close a connection that is not used for this long; 0: never"),
        Option("lifetime", "seconds", 0.0, "close a connection that is this old, between two requests; 0: never"),
        Option("broadcast", "switch", False, "send requests to unit 0 as broadcasts on this serial line"),
        Option("turnaround", "seconds", 0.1, "the pause after a broadcast"),
        Option("queue", "count", 1024, "requests that may wait; the others get exception 06"),
        Option("patience", "time", 10.0, "how long a request may wait; then it gets exception 06"),
        *_OF_UNITS,
    ),
    "backend.unit": (
        Option("as", "number", None, "the unit's address on the line, or its node-ID, if it is another"),
        *_OF_UNITS,
        Option("device", "text", None, "CAN: the description whose parameters are registers, such as az3, or its path"),
        Option("eds", "text", None, "CAN: an EDS file; registers says which objects are registers"),
        Option("registers", "registers", None, 'CAN, with eds: first register = "index:sub-index"'),
    ),
    "status": (
        Option(
            "url", "http", None, "the status page, with /status.json and /metrics: http://HOST:PORT", is_required=True
        ),
    ),
    "publish": (
        Option("broker", "broker", None, "mqtt://HOST, or mqtts://USER:PASSWORD@HOST:8883?ca=FILE", is_required=True),
        Option("site", "text", None, "the first part of all topics: barewire/SITE", is_required=True),
        Option("buffer", "text", None, "the file of readings that the broker does not have yet; default: in memory"),
        Option("limit", "count", 100_000, "readings in the buffer; beyond it the oldest are dropped"),
        Option("retain", "switch", False, "let the broker keep each latest value for clients that subscribe later"),
        Option("home_assistant", "text", None, "the prefix of discovery in Home Assistant, usually homeassistant"),
    ),
    "publish.machine": (
        Option("name", "text", None, "how topics and people call it", is_required=True),
        Option("url", "text", None, "where it is: any URL of a client, also through this gateway", is_required=True),
        Option("device", "text", None, "its description: a name of the catalogue, or a path", is_required=True),
        Option("parameters", "names", None, "what is read", is_required=True),
        Option("every", "seconds", 1.0, "how often"),
        Option("commands", "names", (), "what may be written by a command"),
        Option("on_change", "switch", True, "publish a value only if it has changed"),
        Option("dead_band", "amount", 0.0, "by more than this"),
        Option("at_least", "seconds", 60.0, "or if it was not published for so long"),
    ),
    "policy": (Option("read_only", "switch", False, "pass on only what changes nothing"),),
    "policy.allow": (
        Option("clients", "networks", None, "addresses of clients, such as 10.0.0.0/8; default: all"),
        Option("roles", "texts", None, "roles in TLS certificates; default: all, also without a certificate"),
        Option("units", "units", None, "units, such as 1-10,20; default: all"),
        Option("functions", "functions", None, "function codes, such as [3, 4]; default: all"),
        Option("addresses", "spans", None, "addresses of coils or registers, such as 0-99; default: all"),
    ),
}
"""The options of each table, by its name in the file."""

_OF_CLIENTS = {*UNIT_OPTIONS, "unit", "late_window", "recovery", "retries", "reconnect_first", "reconnect_longest"}
"""Options of URLs that mean nothing to a listener."""

_OF_NO_BACKEND = {
    **dict.fromkeys(("connections", "idle", "roles", "client_cert"), "only servers have it"),
    "retries": "the gateway sends a request once, and its client repeats it",
}
"""Options of URLs that mean nothing to a Modbus backend, and why."""

_ANY = ("0.0.0.0", "::")
"""The hosts that stand for all addresses of this machine. A socket of the second has those of IPv6 only."""

_ARRAYS = {"listen", "backend", "policy.allow", "publish.machine"}
"""The tables of which a file may have several: [[backend]]."""


class ConfigFault(NamedTuple):
    """Something wrong in a file, and where. Lines and columns count from 1."""

    line: int
    column: int
    text: str

    def __str__(self) -> str:
        return f"{self.line}:{self.column}: {self.text}"


class ConfigError(EncodeError):
    """A configuration cannot be used. `faults` are all that were found."""

    def __init__(self, faults: list[ConfigFault]) -> None:
        super().__init__("; ".join(map(str, faults)))
        self.faults = faults


@dataclass(frozen=True)
class BackendConfig:
    """One [[backend]]. `units` maps the address that clients use to the address on the line."""

    name: str
    endpoint: Endpoint
    units: Mapping[int, int]
    options: BackendOptions
    default: UnitConfig
    of_units: Mapping[int, UnitConfig]
    """By the address on the line."""
    broadcast: bool
    queue: int
    patience: float
    devices: Mapping[int, Device] = field(default_factory=dict)
    """On CAN: what the nodes are, by the address that clients use."""

    @property
    def without_registers(self) -> list[int]:
        """The units on CAN without a description, which only function 2B/0D reaches."""
        return [unit for unit in self.units if self.endpoint.scheme == "can" and unit not in self.devices]


@dataclass(frozen=True)
class GatewayConfig:
    """A whole configuration."""

    listeners: tuple[str, ...]
    backends: tuple[BackendConfig, ...]
    policy: Policy = field(default_factory=Policy)
    drain: float = 5.0
    status: str | None = None
    """The URL of the status page."""
    publish: PublishConfig | None = None


def read_config(text: str) -> GatewayConfig:
    """Read a configuration. Raises ConfigError with every fault, its line and its column."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place = re.search(r" \(at (?:line (\d+), column (\d+)|end of document)\)$", str(error))
        line, column = (int(place[1]), int(place[2])) if place and place[1] else (text.count("\n") + 1, 1)
        raise ConfigError([ConfigFault(line, column, str(error)[: place.start() if place else None])]) from None
    reader = _Reader(places(text))
    config = reader.gateway(table)
    if reader.faults:
        raise ConfigError(sorted(reader.faults))
    return config


Path = tuple[str | int, ...]

_HEADER = re.compile(r"\s*(\[{1,2})\s*([^\]]+?)\s*\]{1,2}")
_KEY = re.compile(r"\s*([A-Za-z0-9_.\"'-]+)\s*=")


def places(text: str) -> dict[Path, tuple[int, int]]:
    """Return the line and column of each table and key: `tomllib` does not give them.

    >>> places('[[backend]]\\nname = "hall"\\n  [backend.unit.5]\\n  gap = 0.1')[("backend", 0, "unit", "5", "gap")]
    (4, 3)
    """
    positions: dict[Path, tuple[int, int]] = {}
    arrays: dict[Path, int] = {}
    table: Path = ()
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            table = ()
            names = [name.strip().strip("\"'") for name in header[2].split(".")]
            for depth, name in enumerate(names, 1):
                table = (*table, name)
                if depth == len(names) and header[1] == "[[":
                    arrays[table] = arrays.get(table, -1) + 1
                if table in arrays:
                    table = (*table, arrays[table])
            positions.setdefault(table, (number, header.start(1) + 1))
        elif key := _KEY.match(line):
            names = [name.strip("\"'") for name in key[1].split(".")]
            positions.setdefault((*table, *names), (number, key.start(1) + 1))
    return positions


class _Reader:
    """Makes a configuration of the tables of a file, and notes what is wrong instead of raising it."""

    def __init__(self, positions: Mapping[Path, tuple[int, int]]) -> None:
        self._places = positions
        self.faults: list[ConfigFault] = []

    def _fault(self, path: Path, text: str) -> None:
        """Note a fault, at the place of the key or, if the key is missing, of its table."""
        while path and path not in self._places:
            path = path[:-1]
        self.faults.append(ConfigFault(*self._places.get(path, (1, 1)), text))

    def _tables(self, table: Mapping[str, Any], path: Path) -> Iterator[tuple[Path, Mapping[str, Any]]]:
        """Yield the tables of an array of tables, each with its path."""
        name = str(path[-1])
        rows = table.get(name, [])
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            full = ".".join(map(str, path))
            self._fault(path, f"{name}: expected [[{full}]], a table for each")
            return
        for number, row in enumerate(rows):
            yield (*path, number), row

    def _values(self, kind: str, table: Mapping[str, Any], path: Path, inner: tuple[str, ...] = ()) -> dict[str, Any]:
        """Return the values of the options of a table, checked, with their defaults."""
        options = OPTIONS[kind]
        names = [option.name for option in options]
        for key in table:
            if key not in names and key not in inner:
                expected = f"expected {', '.join((*names, *inner))}{suggest(key, dict.fromkeys((*names, *inner)))}"
                self._fault((*path, key), f"unknown {shown(key)}, {expected}")
        values = {}
        for option in options:
            values[option.name] = option.default
            if option.name in table:
                check, expected, _ = _KINDS[option.kind]
                value = table[option.name]
                try:
                    values[option.name] = check(value)
                except _HasHostBits as error:
                    self._fault((*path, option.name), f"{option.name}: {error}")
                except (AttributeError, TypeError, ValueError, EncodeError):
                    may_have_password = option.kind == "broker" or {"/", "@"} <= {*shown(value, 10_000)}
                    given = option.name if may_have_password else f"{option.name} = {shown(value)}"
                    self._fault((*path, option.name), f"{given}: expected {expected}")
                except PortError as error:  # a file that the value names
                    self._fault((*path, option.name), f"{option.name}: {error}")
            elif option.is_required:
                brackets = f"[[{kind}]]" if kind in _ARRAYS else f"[{kind}]"
                self._fault(path, f"{brackets} has no {option.name}: {option.text}")
        return values

    def gateway(self, table: Mapping[str, Any]) -> GatewayConfig:
        values = self._values("", table, (), ("listen", "backend", "status", "publish", "policy"))
        listeners = [self._listener(path, row) for path, row in self._tables(table, ("listen",))]
        backends = [self._backend(path, row) for path, row in self._tables(table, ("backend",))]
        for name, rows in (("listen", listeners), ("backend", backends)):
            if not rows and "publish" not in table and name not in table:
                self._fault((), f"no [[{name}]]: a gateway needs at least one, a publisher needs [publish]")
        self._check_routes([backend for backend in backends if backend is not None])
        config = GatewayConfig(
            tuple(url for url in listeners if url is not None),
            tuple(backend for backend in backends if backend is not None),
            self._policy(table.get("policy", {})),
            values["drain"],
            self._status(table.get("status")),
            self._publish(table.get("publish")),
        )
        if not self.faults:
            self._check_lines(config)
        return config

    def _check_lines(self, config: GatewayConfig) -> None:
        """Note a port that two would listen at, a line that goes to a listener of this gateway, and a serial port that
        two would open."""
        listening = [occupied_by(listener_endpoint(url)) for url in config.listeners]
        for number, place in enumerate(listening):
            if any(share_port(place, other) for other in listening[:number]):
                self._fault(("listen", number, "url"), f"port {place[2]} is that of another listener")
        if config.status is not None:
            host, port = host_and_port(config.status)
            if any(share_port(_at_host("tcp", host, port), place) for place in listening):
                self._fault(("status", "url"), f"port {port} is that of a listener")
        owners: dict[tuple[str, str, int], tuple[str, str]] = {}  # with the URL by which machines share it
        for number, backend in enumerate(config.backends):
            endpoint, place = backend.endpoint, occupied_by(backend.endpoint)
            is_here = place[1].startswith("127.") or place[1] == "::1"
            if place in listening or (is_here and any(share_port(place, other) for other in listening)):
                text = f"{endpoint.place} is a listener of this gateway: its requests would go round"
                self._fault(("backend", number, "url"), text)
            if endpoint.is_serial_port:
                owner, _ = owners.setdefault(place, (f"the backend {backend.name!r}", ""))
                if owner != f"the backend {backend.name!r}":
                    text = f"{endpoint.place} is the line of {owner}: one backend has all units of a line"
                    self._fault(("backend", number, "url"), text)
        for number, machine in enumerate(config.publish.machines if config.publish is not None else ()):
            endpoint = _backend_endpoint(machine.url)
            if endpoint.is_serial_port:
                own = f"{endpoint.scheme}://{endpoint.place}"
                owner, shared = owners.setdefault(occupied_by(endpoint), (f"the machine {machine.name!r}", own))
                if shared != own:
                    what = f"which has {shared}: write it alike" if shared else "poll through a listener"
                    mark = ", " if shared else ": "
                    text = f"{endpoint.place} is the line of {owner}{mark}{what}"
                    self._fault(("publish", "machine", number, "url"), text)

    def _publish(self, table: Any) -> PublishConfig | None:
        if table is None:
            return None
        if not isinstance(table, dict):
            self._fault(("publish",), "publish: expected a table, [publish]")
            return None
        from barewire.gateway.publish.publisher import PublishConfig, topics_that_collide

        path: Path = ("publish",)
        values = self._values("publish", table, path, ("machine",))
        prefix = values["home_assistant"]
        if prefix is not None and ({"#", "+"} & {*prefix} or prefix.strip("/") != prefix):
            text = "expected the beginning of a topic, without #, without +, and without / at its ends"
            self._fault((*path, "home_assistant"), f"home_assistant = {shown(prefix)}: {text}")
        folder = os.path.dirname(values["buffer"] or "") or "."
        if not os.path.isdir(folder):
            self._fault((*path, "buffer"), f"buffer = {shown(values['buffer'])}: {folder} is no directory")
        self._check_module(path, "aiomqtt", "publish")
        machines = [self._polled(place, row) for place, row in self._tables(table, ("publish", "machine"))]
        if not machines:
            self._fault(path, "no [[publish.machine]]: there is nothing to publish")
        known = [machine for machine in machines if machine is not None]
        if values["broker"] is None or values["site"] is None:
            return None
        for topic in topics_that_collide(values["site"], known):
            text = (
                f"the topic {topic} would be that of two: give the machines names that differ, also without their signs"
            )
            self._fault(path, text)
        return PublishConfig(
            values["broker"],
            values["site"],
            tuple(known),
            values["buffer"] or ":memory:",
            values["limit"],
            values["retain"],
            values["home_assistant"],
        )

    def _check_module(self, path: Path, module: str, extra: str) -> None:
        """Note that a package is not installed."""
        if find_spec(module) is None:
            self._fault(path, f"it needs {module}, which is not installed: pip install 'barewire[{extra}]'")

    def _polled(self, path: Path, row: Mapping[str, Any]) -> PolledMachine | None:
        from barewire.gateway.publish.publisher import PolledMachine

        values = self._values("publish.machine", row, path)
        endpoint = self._endpoint(path, values["url"], _backend_endpoint, _check_backend)
        try:
            device = load(values["device"]) if values["device"] is not None else None
        except BarewireError as error:
            self._fault((*path, "device"), str(error))
            return None
        if endpoint is None or device is None or values["name"] is None or values["parameters"] is None:
            return None
        is_can = endpoint.scheme == "can"
        found: dict[str, list[str]] = {"parameters": [], "commands": []}  # as the description writes them
        for key, own_names in found.items():
            for name in values[key]:
                try:
                    parameter = device.find(name)
                except BarewireError as error:
                    self._fault((*path, key), str(error))
                    continue
                own_names.append(parameter.name)
                if (parameter.object if is_can else parameter.modbus) is None:
                    self._fault((*path, key), f"{name} has no address on {'CANopen' if is_can else 'Modbus'}")
                elif not (parameter.readable if key == "parameters" else parameter.writable):
                    self._fault((*path, key), f"{name} cannot be {'read' if key == 'parameters' else 'written'}")
        if any(not endpoint.seconds(key, 0.0) for key in endpoint.options if split_name(key)[0] == "timeout"):
            self._fault((*path, "url"), "timeout=0: expected more than 0")
        if values["every"] < 0.001:
            self._fault((*path, "every"), f"every = {values['every']:g}: expected 0.001 seconds or more")
        if not values["parameters"]:
            self._fault((*path, "parameters"), "parameters = []: expected at least one")
        names = ("name", "url", "every", "on_change", "dead_band", "at_least")
        return PolledMachine(
            device=device,
            parameters=tuple(found["parameters"]),
            commands=tuple(found["commands"]),
            **{name: values[name] for name in names},
        )

    def _status(self, table: Any) -> str | None:
        if table is None:
            return None
        if not isinstance(table, dict):
            self._fault(("status",), "status: expected a table, [status]")
            return None
        url = self._values("status", table, ("status",))["url"]
        self._check_module(("status",), "microdot", "gateway")
        return url if isinstance(url, str) else None

    def _endpoint(
        self, path: Path, url: Any, parse: Callable[[str], Endpoint], check: Callable[[Endpoint], object]
    ) -> Endpoint | None:
        if not isinstance(url, str):
            return None
        try:
            endpoint = parse(url)
            check(endpoint)
        except BarewireError as error:
            self._fault((*path, "url"), str(error))
            return None
        return endpoint

    def _listener(self, path: Path, row: Mapping[str, Any]) -> str | None:
        url = self._values("listen", row, path)["url"]
        endpoint = self._endpoint(path, url, listener_endpoint, _check_listener)
        if endpoint is not None and endpoint.is_serial_port:
            self._fault((*path, "url"), "clients connect over a network: tcp, tls, udp, rtu+tcp or ascii+tcp")
        return url if endpoint is not None else None

    def _backend(self, path: Path, row: Mapping[str, Any]) -> BackendConfig | None:
        values = self._values("backend", row, path, ("unit",))
        endpoint = self._endpoint(path, values["url"], _backend_endpoint, _check_backend)
        of_units = row.get("unit", {})
        if not isinstance(of_units, dict) or not all(isinstance(unit, dict) for unit in of_units.values()):
            self._fault((*path, "unit"), "unit: expected [backend.unit.5], a table for each unit")
            of_units = {}
        units = {number: number for span in values["units"] or () for number in span}
        # The tables say what the URL may say too: gap of a backend is gap there, that of its unit 5 is gap.5.
        asking = {name: str(values[name]) for name in UNIT_OPTIONS if name in row}
        reading: dict[int, tuple[float, int | None]] = {}
        devices: dict[int, Device] = {}
        for key, table in of_units.items():
            place = (*path, "unit", key)
            if not (key.isascii() and key.isdecimal() and len(key) <= 3 and int(key) in units):
                name = key if key.isascii() and len(key) <= 9 else shown(key)
                self._fault(place, f"unit {name}: expected a unit that is in units")
                continue
            of_unit = self._values("backend.unit", table, place)
            address = int(key) if of_unit["as"] is None else of_unit["as"]
            if not 0 <= address <= 255:
                self._fault((*place, "as"), f"as = {address}: expected a unit address, 0..255")
            units[int(key)] = address
            asking |= {f"{name}.{address}": str(of_unit[name]) for name in UNIT_OPTIONS if name in table}
            cache, merge = (of_unit[name] if name in table else values[name] for name in ("cache", "merge"))
            reading[address] = cache, merge
            device = self._device(endpoint, of_unit, table, place)
            if device is not None:
                devices[int(key)] = device
        if endpoint is None or not isinstance(values["name"], str):
            return None
        self._check_line(path, endpoint, values, units)
        asked = endpoint._replace(options={**endpoint.options, **asking})

        def unit_config(unit: int | None) -> UnitConfig:
            cache, merge = reading[unit] if unit in reading else (values["cache"], values["merge"])
            return UnitConfig(unit_options(asked, unit, ASKING), cache, merge)

        names = ("in_flight", "settle", "idle", "lifetime", "turnaround")
        return BackendConfig(
            name=values["name"],
            endpoint=endpoint,
            units=units,
            options=BackendOptions(**{name: values[name] for name in names}),
            default=unit_config(None),
            of_units={unit: unit_config(unit) for unit in {*reading, *asked.own_units}},
            broadcast=values["broadcast"],
            queue=values["queue"],
            patience=values["patience"],
            devices=devices,
        )

    def _check_line(self, path: Path, endpoint: Endpoint, values: Mapping[str, Any], units: Mapping[int, int]) -> None:
        """Note values that do not suit the line of a backend."""
        if endpoint.scheme == "can" and any(not 1 <= node <= 127 for node in units.values()):
            self._fault((*path, "units"), "a node-ID is 1 to 127: give the units others with [backend.unit.N] as = ...")
        if any(unit not in units.values() for unit in endpoint.own_units):
            self._fault((*path, "url"), "the URL has an option of a unit that is not in units")
        for name in _OF_NO_BACKEND.keys() & endpoint.options.keys() if endpoint.scheme != "can" else ():
            self._fault((*path, "url"), f"{name}={endpoint.options[name]}: {_OF_NO_BACKEND[name]}")
        for name in {"unit", "node"} & endpoint.options.keys():
            self._fault((*path, "url"), f"{name}={endpoint.options[name]}: units says what is behind the line")
        if any(not endpoint.seconds(key, 0.0) for key in endpoint.options if split_name(key)[0] == "timeout"):
            self._fault((*path, "url"), "timeout=0: expected more than 0")
        if not 1 <= values["in_flight"] <= (16 if endpoint.framing == "tcp" else 1):
            expected = "1 to 16 requests" if endpoint.framing == "tcp" else "1: a serial line has one at a time"
            self._fault((*path, "in_flight"), f"in_flight = {values['in_flight']}: expected {expected}")
        if values["broadcast"] and endpoint.framing not in ("rtu", "ascii"):
            self._fault((*path, "broadcast"), "broadcast: only a serial line has broadcasts")

    def _device(
        self, endpoint: Endpoint | None, values: Mapping[str, Any], table: Mapping[str, Any], path: Path
    ) -> Device | None:
        """Return the description of a node, or None."""
        given = [name for name in ("device", "eds", "registers") if name in table]
        if given and endpoint is not None and endpoint.scheme != "can":
            self._fault((*path, given[0]), f"{given[0]}: only for units on CAN, where objects become registers")
        elif given == ["device"]:
            try:
                device = load(values["device"])
            except BarewireError as error:
                self._fault((*path, "device"), str(error))
                return None
            if device.canopen is not None:
                return device
            self._fault((*path, "device"), f"device = {shown(values['device'])}: it has no CANopen")
        elif given == ["eds", "registers"]:
            if values["registers"] is not None and values["eds"] is not None:
                from barewire.gateway.canopen_backend import device_of_eds  # loads CANopen

                try:
                    return device_of_eds(values["eds"], values["registers"])
                except BarewireError as error:
                    self._fault((*path, "registers"), str(error))
        elif given:
            self._fault((*path, given[0]), f"{' and '.join(given)}: expected device, or eds and registers")
        return None

    def _check_routes(self, backends: list[BackendConfig]) -> None:
        """Note units and names that two backends have, and a second backend for broadcasts."""
        owners: dict[int, str] = {}
        for number, backend in enumerate(backends):
            path: Path = ("backend", number)
            twice = [unit for unit in backend.units if unit in owners]
            if twice:
                self._fault((*path, "units"), f"unit {twice[0]} is behind {owners[twice[0]]!r} already")
            if any(backend.name == other.name for other in backends[:number]):
                self._fault((*path, "name"), f"name = {backend.name!r}: another backend has this name")
            on_line = Counter(backend.units.values())
            for unit, address in backend.units.items():
                has_own = backend.of_units.get(address, backend.default) != backend.default
                if on_line[address] > 1 and unit != address and (has_own or backend.endpoint.scheme == "can"):
                    text = f"as = {address}: another unit has this address too, and one of the two has options"
                    self._fault((*path, "unit", str(unit), "as"), text)
            if 0 in on_line and backend.endpoint.framing in ("rtu", "ascii"):
                self._fault((*path, "units"), "a serial line has no unit 0: broadcast = true sends broadcasts")
            owners |= dict.fromkeys(backend.units, backend.name)
        if sum(backend.broadcast for backend in backends) > 1:
            self._fault((), "broadcast = true in two backends: a request to unit 0 goes to one of them")

    def _policy(self, table: Any) -> Policy:
        if not isinstance(table, dict):
            self._fault(("policy",), "policy: expected a table, [policy]")
            return Policy()
        values = self._values("policy", table, ("policy",), ("allow",))
        rules: list[AccessRule] | None = None if "allow" not in table else []
        for path, row in self._tables(table, ("policy", "allow")):
            rule = self._values("policy.allow", row, path)
            permission = Permission(rule["functions"], rule["units"], rule["addresses"])
            assert rules is not None, "there is such a table"
            rules.append(AccessRule(rule["clients"], rule["roles"], permission))
        return Policy(rules, read_only=values["read_only"])


def listener_endpoint(url: str) -> Endpoint:
    """Return the endpoint of a listener. With TLS the policy decides what a role may do, unless the URL has `roles`."""
    endpoint = modbus_endpoint(url)
    if endpoint.transport == "tls" and "roles" not in endpoint.options:
        endpoint = endpoint._replace(options={**endpoint.options, "roles": "any"})
    return endpoint


def occupied_by(endpoint: Endpoint) -> tuple[str, str, int]:
    """Return what an endpoint occupies, however its URL is written: a bus, a serial device, or a port of a host.

    >>> occupied_by(modbus_endpoint("rtu+tcp://LOCALHOST")) == occupied_by(modbus_endpoint("tcp://127.0.0.1:502?unit=7"))
    True
    """
    if endpoint.scheme == "can":
        return "can", endpoint.place, 0
    if endpoint.is_serial_port:
        return "serial", os.path.normcase(os.path.realpath(endpoint.place)), 0
    return _at_host("udp" if endpoint.is_datagram else "tcp", *endpoint.host_and_port)


def _at_host(kind: str, host: str, port: int) -> tuple[str, str, int]:
    host = host.lower()
    with suppress(ValueError):
        host = str(ip_address("127.0.0.1" if host == "localhost" else host))
    return kind, host, port


def share_port(place: tuple[str, str, int], other: tuple[str, str, int]) -> bool:
    """Return whether only one of two listeners can be open at these places.

    >>> share_port(("tcp", "127.0.0.1", 502), ("tcp", "0.0.0.0", 502))
    True
    """
    hosts = place[1], other[1]
    is_any = "" in hosts or any(row in hosts and all((":" in host) == (":" in row) for host in hosts) for row in _ANY)
    return (place[0], place[2]) == (other[0], other[2]) and place[2] != 0 and (hosts[0] == hosts[1] or is_any)


def _check_listener(endpoint: Endpoint) -> None:
    """Raise the error of a listener that cannot be opened as it is written, also of its certificates."""
    for key, value in endpoint.options.items():
        if split_name(key)[0] in _OF_CLIENTS:
            raise EncodeError(f"{key}={value}: only clients have it, and each backend")
    modbus_line(endpoint, "server")
    if endpoint.transport == "tls":
        from barewire.io.ports.tls import roles_of, server_context

        server_context(endpoint)
        roles_of(endpoint)


def _backend_endpoint(url: str) -> Endpoint:
    if not url.lower().startswith("can:"):
        return modbus_endpoint(url)
    try:
        from barewire.io.ports.can.interfaces import can_endpoint
    except ModuleNotFoundError:  # OpenWrt and Yocto have it as a package of its own
        raise PortError("CAN needs the package of barewire with CANopen, which is not installed") from None
    return can_endpoint(url)


def _check_backend(endpoint: Endpoint) -> None:
    """Raise the error of a line that could never be opened as it is written, also of its certificates."""
    if endpoint.scheme == "can":
        from barewire.io.ports.can.interfaces import check_interface

        check_interface(endpoint)
        return
    modbus_line(endpoint, "client")
    if endpoint.transport == "tls":
        from barewire.io.ports.tls import client_context, server_name

        client_context(endpoint)
        server_name(endpoint)
    elif endpoint.place == PSEUDO_TERMINAL:
        from barewire.io.ports.serial import SerialPort

        SerialPort.of(endpoint)  # raises the error


def _seconds(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < float("inf"):
        raise ValueError
    return float(value)


def _number(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError
    return value


def _not_zero(value: float) -> float:
    if not value:
        raise ValueError
    return value


def _switch(value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise TypeError
    return value


def host_and_port(url: str) -> tuple[str, int]:
    """Return host and port of the URL of a status page. Raises EncodeError unless it is http://HOST:PORT."""
    try:
        parts = urlsplit(url)
        port = parts.port
        is_whole = parts.scheme == "http" and parts.path in ("", "/") and not parts.query and "@" not in parts.netloc
    except ValueError:
        is_whole = False
    if not is_whole or not parts.hostname or port is None:
        raise EncodeError("status page: expected http://HOST:PORT, such as http://127.0.0.1:8502")  # no password
    return parts.hostname, port


def _broker(value: Any) -> str:
    from barewire.gateway.publish.publisher import broker_options

    broker_options(_text(value))
    return _text(value)


def _http(value: Any) -> str:
    host_and_port(_text(value))
    return _text(value)


def _list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise TypeError
    return value


def _functions(value: Any) -> frozenset[int]:
    codes = _list(value)
    if not all(type(code) is int and 1 <= code <= 0x7F for code in codes):
        raise ValueError
    return frozenset(codes)


def _registers(value: Any) -> dict[int, tuple[int, int]]:
    """Return a table of registers: {"100": "6041:00"} -> {100: (6041h, 0)}."""
    table = {}
    for address, place in value.items():
        index, _, sub = _text(place).partition(":")
        if not address.isdecimal() or not 0 <= int(address) <= 0xFFFF:
            raise ValueError
        table[int(address)] = (int(index, 16), int(sub or "0", 16))
    return table


def _units(value: Any) -> tuple[range, ...]:
    spans = _spans(value)
    if any(span.stop > 256 for span in spans):
        raise ValueError
    return spans


def _spans(value: Any) -> tuple[range, ...]:
    """Return ranges of numbers: "1-10,20" -> (range(1, 11), range(20, 21)). A number is a range of one."""
    if type(value) is int:
        value = str(value)
    spans = []
    for part in _text(value).split(","):
        low, dash, high = (number.strip() for number in part.partition("-"))
        first, last = int(low), int(high) if dash else int(low)
        if not (low.isdecimal() and 0 <= first <= last <= 0xFFFF):
            raise ValueError
        spans.append(range(first, last + 1))
    return tuple(spans)


class _HasHostBits(ValueError):
    """A network whose address is one in it."""


def _network(value: Any) -> IPv4Network | IPv6Network:
    text = _text(value)
    network = ip_network(text, strict=False)
    if ip_address(text.partition("/")[0]) != network.network_address:
        raise _HasHostBits(f"{shown(text)} has host bits: expected {network}, or the address alone")
    return network


_KINDS: dict[str, tuple[Callable[[Any], Any], str, dict[str, Any]]] = {
    "text": (_text, "a text", {"type": "string", "minLength": 1}),
    "names": (lambda value: tuple(map(_text, _list(value))), "a list of names",
              {"type": "array", "items": {"type": "string"}}),
    "amount": (_seconds, "a number, 0 or more", {"type": "number", "minimum": 0}),
    "broker": (_broker, "mqtt://[USER:PASSWORD@]HOST[:PORT] or mqtts://, with %23 for # in a password, %2F for /",
               {"type": "string", "pattern": "^mqtts?://"}),
    "http": (_http, "http://HOST:PORT, such as http://127.0.0.1:8502", {"type": "string", "pattern": "^http://"}),
    "texts": (lambda value: frozenset(map(_text, _list(value))), "a list of texts",
              {"type": "array", "items": {"type": "string"}}),
    "seconds": (_seconds, "0 or more seconds", {"type": "number", "minimum": 0}),
    "time": (lambda value: _not_zero(_seconds(value)), "more than 0 seconds",
             {"type": "number", "exclusiveMinimum": 0}),
    "number": (_number, "a whole number", {"type": "integer", "minimum": 0}),
    "count": (lambda value: _not_zero(_number(value)), "a whole number, 1 or more", {"type": "integer", "minimum": 1}),
    "switch": (_switch, "true or false", {"type": "boolean"}),
    "units": (_units, 'unit addresses and ranges, 0 to 255, such as "1-10,20"', {"type": ["string", "integer"]}),
    "spans": (_spans, 'numbers and ranges, such as "1-10,20"', {"type": ["string", "integer"]}),
    "registers": (_registers, 'a table such as { 0 = "6041:00", 1 = "6064:00" }',
                  {"type": "object", "additionalProperties": {"type": "string"}}),
    "functions": (_functions, "a list of function codes, 1 to 127",
                  {"type": "array", "items": {"type": "integer", "minimum": 1, "maximum": 127}}),
    "networks": (lambda value: tuple(map(_network, _list(value))),
                 'a list of addresses and networks, such as ["10.0.0.7", "192.168.0.0/16"]',
                 {"type": "array", "items": {"type": "string"}}),
}  # fmt: skip
"""By kind: the function that checks a value and returns it, what is expected, and its JSON schema."""


def config_schema() -> dict[str, Any]:
    """Return the JSON schema of a configuration, for editors."""

    def table(kind: str, **inner: Any) -> dict[str, Any]:
        options = {option.name: _KINDS[option.kind][2] | {"description": option.text} for option in OPTIONS[kind]}
        required = [option.name for option in OPTIONS[kind] if option.is_required]
        form: dict[str, Any] = {"type": "object", "properties": options | inner, "additionalProperties": False}
        return form | ({"required": required} if required else {})

    def array(items: dict[str, Any], least: int = 0) -> dict[str, Any]:
        return {"type": "array", "items": items, "minItems": least}

    units = {"type": "object", "patternProperties": {"^[0-9]+$": table("backend.unit")}, "additionalProperties": False}
    gateway = table(
        "",
        listen=array(table("listen"), 1),
        backend=array(table("backend", unit=units), 1),
        status=table("status"),
        publish=table("publish", machine=array(table("publish.machine"), 1)),
        policy=table("policy", allow=array(table("policy.allow"))),
    )
    gateway["anyOf"] = [{"required": ["listen", "backend"]}, {"required": ["publish"]}]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "barewire gateway", **gateway}


_EXAMPLE = {
    "listen": {"url": '"tcp://127.0.0.1:1502?connections=64&idle=300"'},
    "backend": {"name": '"hall"', "url": '"rtu:///dev/ttyUSB0?baudrate=19200"', "units": '"1-10"'},
    "backend.unit": {
        **{"as": "5", "device": '"az3"', "eds": '"node.eds"'},
        "registers": '{ 0 = "6041:00", 1 = "6064:00" }',
    },
    "status": {"url": '"http://127.0.0.1:8502"'},
    "publish": {
        **{"broker": '"mqtt://127.0.0.1"', "site": '"hall"', "buffer": '"/var/lib/barewire/buffer.sqlite"'},
        "home_assistant": '"homeassistant"',
    },
    "publish.machine": {
        **{"name": '"press"', "url": '"tcp://127.0.0.1:1502?unit=5"', "device": '"csd-mt"'},
        **{"parameters": '["Status Word", "Position Actual Value"]', "commands": '["Target Position"]'},
    },
    "policy.allow": {
        **{"clients": '["127.0.0.1"]', "roles": '["Operator"]', "units": '"1-10"'},
        **{"functions": "[1, 2, 3, 4]", "addresses": '"0-99"'},
    },
}
"""The values of the example that are not defaults."""


def example() -> str:
    """Return a commented configuration that can be used as it is, with every option."""
    lines = ["# A gateway of barewire. What is commented out shows the default, or how it is written."]
    for kind in OPTIONS:
        is_shown = kind in ("", "listen", "backend")
        mark = "" if is_shown else "# "
        if kind:
            name = f"{kind}.5" if kind == "backend.unit" else kind
            lines += ["", f"{mark}[[{name}]]" if kind in _ARRAYS else f"{mark}[{name}]"]
        for option in OPTIONS[kind]:
            given = _EXAMPLE.get(kind, {}).get(option.name)
            value = given or ("8" if option.default is None else str(option.default).lower())
            line = f"{'' if is_shown and option.is_required else '# '}{option.name} = {value}"
            lines.append(f"{line:<58} # {option.text}" if len(line) < 58 else f"{line}  # {option.text}")
    return "\n".join(lines) + "\n"
