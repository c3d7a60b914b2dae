"""The status page, its data, the metrics: over HTTP as a browser asks, and in headless Chromium."""

from __future__ import annotations

import json
import re
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page

from barewire import ModbusClient, ModbusServer
from barewire.gateway.__main__ import run_program
from barewire.gateway.gateway import Gateway
from barewire.modbus import ModbusException, Table
from tests.gateway.in_thread import running
from tests.helpers import free_port
from tools.website.browser import chromium

WAIT = 30.0


@pytest.fixture
def gateway() -> Iterator[Gateway]:
    """A gateway with a line of one unit that answers, and one that does not."""
    with ModbusServer("rtu://pty", {1: Table(10)}) as line:
        text = f"""
[[listen]]
url = "tcp://127.0.0.1:0"
[[backend]]
name = "hall <b>1</b>"
url = "{line.url}"
units = "1-2"
timeout = 10
[backend.unit.2]
timeout = 0.1
dead_after = 1
[status]
url = "http://127.0.0.1:0"
[policy]
read_only = true
"""
        with running(text) as gateway, ModbusClient(gateway.urls[0], timeout=WAIT) as client:
            client.at(unit=1).read_holding_registers(0, 2)
            for refused in (
                lambda: client.at(unit=1).read_holding_registers(9, 2),
                lambda: client.at(unit=2).read_holding_registers(0, 1),
                lambda: client.at(unit=1).write_single_register(0, 1),
            ):
                with pytest.raises(ModbusException):
                    refused()
            yield gateway


def get(gateway: Gateway, path: str) -> tuple[int, str, Any]:
    assert gateway.page is not None
    try:
        with urllib.request.urlopen(f"{gateway.page.url}{path}", timeout=WAIT) as answer:
            return answer.status, answer.read().decode(), answer.headers
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode(), error.headers


def test_the_state_has_lines_units_counters_and_errors_in_words(gateway: Gateway) -> None:
    code, text, _ = get(gateway, "/status.json")
    state = json.loads(text)
    (backend,) = state["backends"]
    units = {unit["unit"]: unit for unit in backend["units"]}
    assert (code, state["refused_by_policy"], backend["connected"]) == (200, 1, True)
    assert (units[1]["state"], units[1]["requests"], units[1]["exceptions"]) == ("answers", 2, 1)
    assert (units[2]["state"], units[2]["no_responses"]) == ("dead", 1)
    assert "unit 2 did not answer Read Holding Registers within 0.1 s" in backend["errors"][0]["text"]
    assert state["listeners"][0]["connections"] == 1
    assert state["history"]["samples"]


def test_the_metrics_are_prometheus_text(gateway: Gateway) -> None:
    code, text, headers = get(gateway, "/metrics")
    assert (code, headers["Content-Type"]) == (200, "text/plain; version=0.0.4; charset=utf-8")
    assert 'barewire_gateway_unit_exchanges_total{backend="hall <b>1</b>",unit="1"} 2.0' in text
    assert 'barewire_gateway_unit_dead{backend="hall <b>1</b>",unit="2"} 1.0' in text
    assert "barewire_gateway_refused_total 1.0" in text


def test_frames_are_kept_while_somebody_asks_for_them(gateway: Gateway) -> None:
    path = "/frames.json?backend=hall%20%3Cb%3E1%3C%2Fb%3E&unit=1"
    assert json.loads(get(gateway, path)[1]) == []
    with ModbusClient(gateway.urls[0], unit=1, timeout=WAIT) as client:
        client.read_holding_registers(3, 1)
    (seen,) = json.loads(get(gateway, path)[1])
    assert (seen["request"], seen["response"]) == ("03 00 03 00 01", "03 02 00 00")
    assert get(gateway, "/frames.json?backend=none&unit=1")[0] == 404


def test_the_state_in_words(gateway: Gateway, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "gateway.toml"
    assert gateway.page is not None
    text = '[[listen]]\nurl = "tcp://127.0.0.1:1"\n[[backend]]\nname = "b"\nurl = "tcp://127.0.0.1:2"\nunits = 1\n'
    file.write_text(f'{text}[status]\nurl = "{gateway.page.url}"\n')
    assert run_program(["--status", str(file)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "the policy refused 1 requests" in lines[0]
    assert any(line.startswith("  unit 1: answers, 2 exchanges, 1 exceptions, 0 unanswered, ") for line in lines)
    assert any(re.match("  unit 2: dead, asked again in [0-9]+ s, 1 exchanges", line) for line in lines)
    file.write_text(f'{text}[status]\nurl = "http://127.0.0.1:{free_port()}"\n')
    assert run_program(["--status", str(file)]) == 1
    file.write_text(text)
    assert run_program(["--status", str(file)]) == 2


@pytest.mark.parametrize("junk", [b"\x00\x01\x00\x00\x00\x06\x01\x03\x00\x00\x00\x01", b"GET\r\n\r\n", b"\xff" * 9000])
def test_what_is_no_http_is_closed_in_silence(gateway: Gateway, junk: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    assert gateway.page is not None
    host, port = gateway.page.url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), timeout=WAIT) as connection:
        connection.sendall(junk)
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(4096):
            pass
    assert get(gateway, "/status.json")[0] == 200
    assert capfd.readouterr() == ("", "")


def test_the_page_asks_for_nothing_elsewhere(gateway: Gateway) -> None:
    code, text, headers = get(gateway, "/")
    assert code == 200
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.fixture(params=["light", "dark"])
def page(browser: Browser, request: pytest.FixtureRequest) -> Page:
    """A page of a browser as wide as a telephone, or as a screen."""
    width = 390 if request.param == "dark" else 1280
    return browser.new_page(viewport={"width": width, "height": 900}, color_scheme=request.param)


@pytest.mark.needs("chromium")
def test_a_browser_shows_it(gateway: Gateway, page: Page) -> None:
    requests: list[str] = []
    problems: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
    assert gateway.page is not None
    page.goto(gateway.page.url)
    page.get_by_text("hall <b>1</b>: rtu").wait_for()
    page.get_by_text("dead, asked again").wait_for()
    page.get_by_text("did not answer Read Holding Registers").first.wait_for()
    page.get_by_role("button", name="frames").first.click()
    with ModbusClient(gateway.urls[0], unit=1, timeout=WAIT) as client:
        for _ in range(100):
            client.read_holding_registers(4, 1)
            if page.get_by_text("03 00 04 00 01").count():
                break
            page.wait_for_timeout(100)
    assert page.get_by_text("03 00 04 00 01").count()
    assert all(url.startswith(gateway.page.url) or url.startswith("data:") for url in requests)
    assert not problems
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
