"""Runs the tests of modbus-connection with barewire in the place of one of its backends: a plugin of pytest.

    pytest -p in_their_suite --in-place-of=tmodbus --results=results.json

Their tests take a backend by the name of its module. With the option, `modbus_connection.tmodbus` is this backend for
all of them, before the first is imported; without it they test their own. `tools/modbus_connection.py` fetches the
tests and runs them in all three ways.

A test of EXEMPT is about the inside of the other backend, such as a function of its library that the test replaces, or
about what that backend alone can do. It is run all the same, and must fail, and each name must be that of a test: so
the list has none too many.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import barewire_modbus_connection as barewire_backend
import modbus_connection
import pytest
from modbus_connection import ModbusConnection, ModbusSerialParams, ModbusTcpParams, ModbusTlsParams, ModbusUdpParams

CREATE = "replaces a function of tmodbus by which that backend makes its client"
RETRY = "sets how often tmodbus repeats a request to a busy device; here the caller repeats it"
PYMODBUS = "replaces a method of a client of pymodbus"
UDP = "RTU and ASCII over UDP, which pymodbus alone carries"

EXEMPT: dict[str, dict[str, str]] = {
    "tmodbus": {
        "test_backend_retry_policy.py::test_tmodbus_transport_propagates_response_without_retry": CREATE,
        "test_backend_retry_policy.py::test_tmodbus_retransmits_a_busy_response_until_the_device_answers": RETRY,
        "test_backend_retry_policy.py::test_tmodbus_busy_retransmission_is_bounded": RETRY,
        "test_backend_retry_policy.py::test_pymodbus_raises_a_busy_response_without_retransmitting": RETRY,
        "test_connect_errors.py::test_tmodbus_connect_maps_raising_connect": CREATE,
        "test_connect_errors.py::test_tmodbus_connect_timeout_maps_to_timeout_error": CREATE,
        "test_connect_errors.py::test_tmodbus_close_maps_backend_error": "closes a stand-in for a client of tmodbus",
        "test_serial.py::test_serial_reads[rtu-tmodbus]": "looks up the time-out inside the transport of tmodbus",
        "test_serial.py::test_serial_reads[ascii-tmodbus]": "looks up the time-out inside the transport of tmodbus",
        "test_tmodbus.py::test_scoped_host_reaches_client[tcp]": CREATE,
        "test_tmodbus.py::test_scoped_host_reaches_client[rtu-over-socket]": CREATE,
        "test_tmodbus.py::test_scoped_host_reaches_client[ascii-over-socket]": CREATE,
        "test_tmodbus.py::test_a_serial_framing_over_tcp_keeps_the_smallest_inter_frame_gap": CREATE,
        "test_tmodbus.py::test_read_file_record_decodes_to_words": CREATE,
        "test_tmodbus.py::test_write_file_record_encodes_words_to_payload": CREATE,
        "test_tmodbus.py::test_invalid_response_maps_to_protocol_error": CREATE,
        "test_tmodbus.py::test_mismatched_replies_raise_desync[function-code]": CREATE,
        "test_tmodbus.py::test_mismatched_replies_raise_desync[header-mismatch]": CREATE,
        "test_tmodbus.py::test_desync_survives_a_failing_disconnect": CREATE,
        "test_tmodbus.py::test_exception_response_maps_to_the_typed_subclass": CREATE,
        "test_tmodbus.py::test_request_failure_maps_but_does_not_fire_on_connection_lost": CREATE,
        "test_tmodbus.py::test_transport_hook_fires_registered_callbacks": CREATE,
        "test_tmodbus.py::test_close_suppresses_on_connection_lost_hook": CREATE,
        "test_tmodbus.py::test_transport_hook_clears_the_client_and_unit_cache": CREATE,
    },
    "pymodbus": {
        "test_backend_retry_policy.py::test_pymodbus_transport_sends_timed_out_request_once": PYMODBUS,
        "test_connect_errors.py::test_pymodbus_connect_maps_raising_connect": PYMODBUS,
        "test_connect_errors.py::test_pymodbus_connect_maps_raising_constructor": PYMODBUS,
        "test_connect_errors.py::test_pymodbus_connect_maps_parameter_error_to_value_error": PYMODBUS,
        "test_connect_errors.py::test_pymodbus_connect_timeout_maps_to_timeout_error": PYMODBUS,
        "test_connect_errors.py::test_pymodbus_close_maps_backend_error": "closes a stand-in for a client of pymodbus",
        "test_cli_helper.py::test_connect_from_args_dispatches_by_transport": UDP,
        "test_cli_helper.py::test_load_backend_routes_unsupported_tmodbus_requests": UDP,
        "test_cli_helper.py::test_the_backends_state_their_framings": UDP,
        "test_framer_guard.py::test_pymodbus_accepts_the_full_matrix[udp-rtu]": UDP,
    },
}
"""The backend that barewire replaces -> test -> why it cannot hold for another backend."""


class Results:
    """What each test connected, with which backend and over what, and how it ended."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.connections: dict[str, set[tuple[str, str]]] = {}
        self.outcomes: dict[str, str] = {}
        self.running = ""

    def connected(self, connection: ModbusConnection) -> None:
        """Record a connection that the running test constructs."""
        backend = type(connection).__module__.removeprefix("modbus_connection.").removesuffix("_modbus_connection")
        if backend in ("barewire", "pymodbus", "tmodbus"):
            self.connections.setdefault(self.running, set()).add((backend, carrier(connection._params)))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Note which test runs."""
        self.running = item.nodeid.rpartition("/")[2]
        return (yield)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Record the outcome: that of the test itself, or the first failure around it."""
        outcome: str = "exempt" if hasattr(report, "wasxfail") else report.outcome
        if outcome == "rerun":
            self.outcomes.pop(self.running, None)
        elif (report.when == "call" or outcome != "passed") and self.outcomes.get(self.running) != "failed":
            self.outcomes[self.running] = outcome

    def pytest_sessionfinish(self) -> None:
        """Write the counts: of all tests, and of those that connect, by backend and carrier."""
        used = Counter(
            f"{backend} {what} {self.outcomes[test]}"
            for test, connections in self.connections.items()
            for backend, what in {*connections, *((backend, "any") for backend, _ in connections)}
        )
        results = {"all": Counter(self.outcomes.values()), "used": used}
        Path(self.file).write_text(json.dumps(results), encoding="utf-8")


def carrier(params: Any) -> str:
    """Return what carries a connection: tcp, udp, tls, serial; rtu+tcp or ascii+tcp behind a serial server."""
    if isinstance(params, ModbusSerialParams):
        return f"{params.framer}+tcp" if params.device.startswith("socket:") else "serial"
    if isinstance(params, ModbusTcpParams) and params.framer != "socket":
        return f"{params.framer}+tcp"
    return {ModbusTcpParams: "tcp", ModbusUdpParams: "udp", ModbusTlsParams: "tls"}[type(params)]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of this file."""
    parser.addoption("--in-place-of", choices=tuple(EXEMPT), help="the backend that barewire replaces")
    parser.addoption("--results", help="the file for the counts")


def pytest_configure(config: pytest.Config) -> None:
    """Replace the backend, and begin to record."""
    if name := config.getoption("--in-place-of"):
        replaced = ModuleType(f"modbus_connection.{name}")
        vars(replaced).update({key: value for key, value in vars(barewire_backend).items() if key != "__name__"})
        # The names by which tests reach the class of this backend, and the hook by which its library reports a loss.
        setattr(replaced, f"{name.capitalize()}Connection", barewire_backend.ModbusConnection)
        barewire_backend.ModbusConnection._on_trace_connect = _lost  # type: ignore[attr-defined]
        sys.modules[replaced.__name__] = replaced
        setattr(modbus_connection, name, replaced)
    if file := config.getoption("--results"):
        results = Results(file)
        config.pluginmanager.register(results)
        construct = ModbusConnection.__init__

        def recorded(self: ModbusConnection, *args: Any, **kwargs: Any) -> None:
            construct(self, *args, **kwargs)
            results.connected(self)

        ModbusConnection.__init__ = recorded  # type: ignore[method-assign]


def _lost(connection: barewire_backend.ModbusConnection, connecting: bool) -> None:
    if not connecting:
        connection._on_connection_lost(None)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the exempt tests."""
    exempt = dict(EXEMPT.get(config.getoption("--in-place-of"), {}))
    for item in items:
        if reason := exempt.pop(item.nodeid.rpartition("/")[2], None):
            item.add_marker(pytest.mark.xfail(reason=reason, strict=True))
    if exempt:
        raise pytest.UsageError(f"EXEMPT names tests that do not exist: {', '.join(exempt)}")
