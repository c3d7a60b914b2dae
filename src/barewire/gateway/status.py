"""What a gateway is doing: its state as plain values for JSON, samples over time, and metrics for Prometheus.

of_listener, of_backend    connections, units, counters, the latest errors in words
History                    a sample every five seconds, of the last hour
metrics(state)             the counters as Prometheus text, by the client library of Prometheus
"""

from __future__ import annotations

import time
from collections import Counter, deque
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from barewire.gateway.backend import Backend
    from barewire.gateway.dispatch import UnitRecord
    from barewire.io.server.units import UnitsServer

SAMPLE_INTERVAL = 5.0
"""Seconds between two samples."""
_SAMPLES = 720

_CONNECTIONS = ("opened", "left", "refused", "idle", "broken")
_REQUESTS = ("requests", "replies", "exceptions", "denied", "busy", "for_others", "noise_bytes", "not_requests")


def of_listener(server: UnitsServer) -> dict[str, Any]:
    """Return the state of a server in front, as values that JSON has."""
    counters = {name: getattr(server.statistics, name) for name in (*_CONNECTIONS, *_REQUESTS)}
    return {"url": server.url.partition("?")[0], "connections": len(server.connections), **counters}


def of_backend(backend: Backend, units: Mapping[int, int], now: float) -> dict[str, Any]:
    """Return the state of a backend and of its units. `units` are the addresses on the line by those that clients use.

    `now` is the time of the event loop.
    """
    names = {address: unit for unit, address in sorted(units.items(), reverse=True)}
    counters = getattr(getattr(backend, "bus", None), "counters", None)
    return {
        "name": backend.name,
        "line": f"{backend.endpoint.scheme}://{backend.endpoint.place}",
        "connected": backend.is_connected and not backend.cannot_open,
        "waiting": backend.dispatcher.size,
        "under_way": len(backend.under_way),
        # Only a Modbus line has these. No client gets a late response.
        "late": getattr(counters, "late", 0),
        "strays": getattr(counters, "strays", 0),
        "probes": getattr(counters, "probes", 0),
        "units": [
            {
                "unit": names.get(address, address),
                "address": address,
                "state": _state_of(backend, state),
                "tried_again_in": max(0.0, state.dead_until - now) if state.is_dead else 0.0,
                **asdict(state.counters),
            }
            for address, state in sorted(backend.dispatcher.units.items())
        ],
        "errors": [
            {**error._asdict(), "unit": names.get(error.unit, error.unit) if error.unit is not None else None}
            for error in backend.errors
        ],
    }


def _state_of(backend: Backend, unit: UnitRecord) -> str:
    if backend.cannot_open:
        return "not known: the line is not open"
    if unit.is_dead or unit.counters.responses:
        return "dead" if unit.is_dead else "answers"
    if unit.counters.no_responses:
        return "has not answered"
    return "asked" if unit.counters.requests else "not asked yet"


def in_words(state: dict[str, Any]) -> list[str]:
    """Return the state of a gateway as lines of text."""
    lines = [f"running for {state['running_for']:.0f} s; the policy refused {state['refused_by_policy']} requests"]
    for row in state["listeners"]:
        lines.append(f"{row['url']}: {row['connections']} clients, {row['requests']} requests")
    for backend in state["backends"]:
        is_open = "connected" if backend["connected"] else "not connected"
        counts = f"{backend['waiting']} requests wait, {backend['late']} late responses"
        lines.append(f"{backend['name']}, {backend['line']}: {is_open}, {counts}")
        for unit in backend["units"]:
            answered = unit["responses"]
            mean = f", {1000 * unit['total'] / answered:.1f} ms on average" if answered else ""
            counts = f"{unit['requests']} exchanges, {unit['exceptions']} exceptions, {unit['no_responses']} unanswered"
            place = f"unit {unit['unit']}" + (f" ({unit['address']})" if unit["address"] != unit["unit"] else "")
            again = f", asked again in {unit['tried_again_in']:.0f} s" if unit["state"] == "dead" else ""
            lines.append(f"  {place}: {unit['state']}{again}, {counts}{mean}")
        latest = {error["text"]: error["at"] for error in backend["errors"]}
        counts_of = Counter(error["text"] for error in backend["errors"])
        for text, at in sorted(latest.items(), key=lambda row: row[1])[-3:]:
            times = counts_of[text]
            when = f"{time.strftime('%H:%M:%S', time.localtime(at))}, {state['now'] - at:.0f} s ago"
            lines.append(f"  {when}{f', {times} times' if times > 1 else ''}: {text}")
    if (publisher := state["publisher"]) is not None:
        is_open = "connected" if publisher["connected"] else "not connected"
        counts = f"{publisher['buffered']} readings wait, {publisher['dropped']} were dropped"
        lines.append(f"broker {publisher['broker']}: {is_open}, {counts}")
        for machine in publisher["machines"]:
            says = {True: "responds", False: "does not respond", None: "not asked yet"}[machine["responds"]]
            why = f": {machine['error']}; asked again in {machine['tried_again_in']:.0f} s" if machine["error"] else ""
            lines.append(f"  {machine['name']}: {says}{why}")
            lines += [f"    {name} is left out: {text}" for name, text in machine["refused"].items()]
    return lines


class History:
    """Samples of the totals of each backend: exchanges, exceptions, exchanges without a response."""

    def __init__(self) -> None:
        self.samples: deque[dict[str, Any]] = deque(maxlen=_SAMPLES)

    def sample(self, backends: Iterable[Backend]) -> None:
        """Add the present totals."""
        totals = {}
        for backend in backends:
            rows = [state.counters for state in backend.dispatcher.units.values()]
            totals[backend.name] = [
                sum(row.requests for row in rows),
                sum(row.exceptions for row in rows),
                sum(row.no_responses for row in rows),
            ]
        self.samples.append({"at": time.time(), "totals": totals})


_OF_UNITS = {
    "requests": ("exchanges", "Exchanges with a unit"),
    "responses": ("responses", "Exchanges with a response of the unit"),
    "exceptions": ("exceptions", "Exchanges that a unit declined"),
    "no_responses": ("no_responses", "Exchanges without a response"),
    "answered": ("answered", "Requests of clients with a response of the unit"),
    "cached": ("cached", "Requests of clients answered with a response that was kept"),
    "joined": ("joined", "Requests of clients that shared an exchange"),
    "unanswered": ("unanswered", "Requests of clients that got exception 0B"),
    "without_path": ("without_path", "Requests of clients that got exception 0A"),
    "busy": ("busy", "Requests of clients that got exception 06"),
    "failed": ("failed", "Requests of clients that got exception 04"),
    "total": ("response_seconds", "Time that the responses of a unit took"),
}


def metrics(state: dict[str, Any]) -> bytes:
    """Return the state of a gateway as Prometheus text. Raises ModuleNotFoundError without `prometheus_client`."""
    from prometheus_client import generate_latest
    from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

    clients = GaugeMetricFamily("barewire_gateway_connections", "Connections of clients", labels=["listener"])
    requests = CounterMetricFamily("barewire_gateway_requests", "Requests of clients", labels=["listener"])
    for row in state["listeners"]:
        clients.add_metric([row["url"]], row["connections"])
        requests.add_metric([row["url"]], row["requests"])
    refused = CounterMetricFamily("barewire_gateway_refused", "Requests that the policy refused")
    refused.add_metric([], state["refused_by_policy"])
    is_open = GaugeMetricFamily("barewire_gateway_connected", "Whether the line is open", labels=["backend"])
    waiting = GaugeMetricFamily("barewire_gateway_waiting", "Requests that wait", labels=["backend"])
    late = CounterMetricFamily("barewire_gateway_late", "Late responses, given to no client", labels=["backend"])
    dead = GaugeMetricFamily("barewire_gateway_unit_dead", "Whether a unit is dead", labels=["backend", "unit"])
    of_units = {
        field: CounterMetricFamily(f"barewire_gateway_unit_{name}", text, labels=["backend", "unit"])
        for field, (name, text) in _OF_UNITS.items()
    }
    for backend in state["backends"]:
        name = backend["name"]
        is_open.add_metric([name], float(backend["connected"]))
        waiting.add_metric([name], backend["waiting"])
        late.add_metric([name], backend["late"])
        for unit in backend["units"]:
            labels = [name, str(unit["unit"])]
            dead.add_metric(labels, float(unit["state"] == "dead"))
            for field, family in of_units.items():
                family.add_metric(labels, unit[field])

    class _Families:
        @staticmethod
        def collect() -> list[Any]:
            return [clients, requests, refused, is_open, waiting, late, dead, *of_units.values()]

    text: bytes = generate_latest(_Families)
    return text
