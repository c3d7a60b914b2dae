"""Every fault on every carrier that has it, on real ports: and the result of a client."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import pytest

from barewire import ModbusServer, connect
from barewire.devices import load
from barewire.devices.sim import MachineUnits, simulator
from barewire.errors import BarewireError, EncodeError, NoAnswer
from barewire.io.fault_injection.faults import Faults, ModbusWire
from barewire.modbus import ModbusException
from tests.certificates import tls_url
from tests.helpers import refused
from tests.io.schemes import EVERY_SCHEME, NUMBERED, SERIAL

ADXL = load("adxl")

# What a client must raise for each fault, on every carrier.

EXPECTED: dict[str, type[BaseException] | None] = {
    "exception": ModbusException,
    "wrong-unit": NoAnswer,
    "drop": NoAnswer,
    "late": NoAnswer,
    "split": None,
    "paced": None,
}


@contextmanager
def faulty_server(scheme: str, files: Path, timeout: float = 0.15, **settings: Any) -> Iterator[str]:
    """Serve a soft starter with faults in its answers; yield the URL for clients."""
    machine = simulator("adxl")
    url = f"{scheme}://127.0.0.1:0"
    if scheme == "tls":
        url = tls_url(files, "server", roles="any")
    elif scheme in SERIAL:
        url = f"{scheme}://pty"
    further = () if scheme.startswith(("rtu", "ascii")) else (255, 0)
    with ModbusServer(url, MachineUnits(machine, *further), **settings) as host:
        address = host.url.partition("?")[0]
        query = tls_url(files, "operator").partition("?")[2] + "&" if scheme == "tls" else ""
        yield f"{address}?{query}timeout={timeout:g}"


@pytest.mark.parametrize("kind", EXPECTED)
@EVERY_SCHEME
def test_a_fault_on_every_carrier(scheme: str, kind: str, request: pytest.FixtureRequest) -> None:
    files = request.getfixturevalue("certificates") if scheme == "tls" else Path()
    reported: list[str] = []
    if scheme == "udp" and kind in ("split", "paced"):
        with (
            refused(EncodeError, f"fault {kind!r} is not possible on this wire"),
            faulty_server(scheme, files, faults={kind: 1.0}),
        ):
            pass
        return
    expected = EXPECTED[kind]
    # Short where no answer is expected; otherwise long enough for a busy one, where the parts of an RTU frame can
    # be further apart than the 30 ms that end it, so the request is repeated.
    timeout = 0.15 if expected is NoAnswer else 5.0
    retries = 5 if expected is None else 0
    # A client that stood still takes a response that came meanwhile: a late one has to come much later.
    delay = 2.0 if kind == "late" else 0.3
    how: dict[str, Any] = {"fault_seed": 1, "fault_delay": delay, "on_fault": reported.append}
    server = faulty_server(scheme, files, timeout, faults={kind: 1.0}, **how)
    with server as url, connect(ADXL, f"{url}&retries={retries}") as adxl:
        if expected is None:
            assert adxl["Frequency"].value == 50
        else:
            with pytest.raises(expected):
                adxl.read("Frequency")
            give_up = time.monotonic() + 30
            while not reported and time.monotonic() < give_up:
                time.sleep(0.005)  # a server that stood still has not received the request yet
    assert set(reported) == {kind}


@EVERY_SCHEME
def test_noise_and_flipped_bits_do_not_become_values(scheme: str, request: pytest.FixtureRequest) -> None:
    files = request.getfixturevalue("certificates") if scheme == "tls" else Path()
    reported: list[str] = []
    values, errors = set(), 0
    how: dict[str, Any] = {"faults": {"noise": 0.3, "flip": 0.3}, "fault_seed": 3, "on_fault": reported.append}
    with faulty_server(scheme, files, **how) as url, connect(ADXL, url) as adxl:
        for _ in range(12):
            try:
                readings = adxl.read("Frequency", "Start counter")
                values.add(tuple(reading.value for reading in readings))
            except BarewireError:
                errors += 1
    assert errors
    assert {"noise", "flip"} <= set(reported)
    # Without CRC or LRC a flipped bit is not detected: such a value is delivered.
    assert values <= {(50, 0)} or scheme in NUMBERED


def test_a_late_answer_is_not_taken_for_that_to_another_request() -> None:
    answered: list[float] = []
    # Several late answers in a row delay each other, so the window is long.
    faulty = faulty_server("rtu+tcp", Path(), faults={"late": 0.4}, fault_seed=2, fault_delay=0.2)
    with faulty as url, connect(ADXL, f"{url}&late_window=5") as adxl:
        for name, value in [("Frequency", 50), ("Start counter", 0)] * 5:
            with contextlib.suppress(NoAnswer):
                assert adxl[name].value == value
                answered.append(value)
    assert set(answered) == {50, 0}


def test_a_datagram_is_not_split() -> None:
    faults: Faults[bytes] = Faults(ModbusWire("tcp", datagrams=True), {"noise": 1.0}, Random(1))
    assert faults.pass_on(b"x", 0.0)[1] == (0.0, b"x")
    assert "split" not in ModbusWire("tcp", datagrams=True).kinds
