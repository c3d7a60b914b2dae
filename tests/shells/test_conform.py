"""The battery on real ports: ours pass, one that is wrong is found, one that hangs up or is not there is told."""

from __future__ import annotations

import json
import socket

import pytest

from barewire.errors import EncodeError, PortError
from barewire.modbus import Table
from barewire.modbus.conform import CASES_RTU, CASES_TCP
from barewire.shells import open_host
from barewire.shells.conform import conform
from barewire.shells.endpoint import Endpoint
from tests.cli.test_command import barewire
from tests.helpers import refused
from tests.shells.peers import honest, peer


@pytest.mark.parametrize("url", ["tcp://127.0.0.1:0", "rtu://pty?baudrate=115200&parity=N", "rtu+tcp://127.0.0.1:0"])
def test_our_servers_pass(url: str) -> None:
    with open_host(url, units={1: Table(100)}) as host:
        endpoint = Endpoint.parse(host.url)
        results = list(conform(endpoint._replace(options={**endpoint.options, "timeout": "0.3"})))
    assert [result.failure for result in results if result.failure] == []
    assert [result.case for result in results] == list(CASES_TCP if url.startswith("tcp") else CASES_RTU)


def test_a_server_that_answers_whatever_it_is_asked_fails() -> None:
    with peer(honest) as port:
        results = list(conform(Endpoint.parse(f"tcp://127.0.0.1:{port}?timeout=0.05")))
    said = {result.case.name: result.failure for result in results}
    assert said["03 with quantity 0"] == "03 with quantity 0: 03 02 00 00, expected 83 03"
    assert said["five requests in one segment"] is None


def test_a_server_that_hangs_up_is_told_as_that() -> None:
    with peer(socket.socket.close) as port:
        result = next(conform(Endpoint.parse(f"tcp://127.0.0.1:{port}?timeout=0.2")))
    assert result.heard == (None,)
    assert result.failure == "03 with quantity 0: closed, expected 83 03"


def test_where_nobody_is_and_what_has_no_cases() -> None:
    with refused(PortError, "connection refused"):
        list(conform(Endpoint.parse("tcp://127.0.0.1:1")))
    for url in ("ascii:///dev/null", "udp://127.0.0.1:1", "can://socketcan/can0"):
        with refused(EncodeError, "there are cases for tcp://"):
            list(conform(Endpoint.parse(url)))


def test_the_command() -> None:
    with open_host("tcp://127.0.0.1:0", units={1: Table(100)}) as host:
        done = barewire("conform", host.url)
    assert done.returncode == 0
    assert done.stdout.splitlines()[0] == "ok      MB-APP 6.3          03 with quantity 0"
    assert done.stdout.splitlines()[-1] == f"{len(CASES_TCP)} of {len(CASES_TCP)} as the standard says"
    with peer(honest) as port:
        done = barewire("conform", f"tcp://127.0.0.1:{port}?timeout=0.05", "--json")
    assert done.returncode == 1
    first = json.loads(done.stdout.splitlines()[0])
    assert (first["ok"], first["clause"], first["heard"]) == (False, "MB-APP 6.3", ["03 02 00 00"])
