"""`barewire send`: the bytes go out as they were typed, and the answer is explained."""

from __future__ import annotations

import json

import pytest

from barewire import CanopenServer, ModbusServer, Table
from barewire.devices.sim import simulator
from tests.helpers import PATIENCE
from tests.workbench.cli.helpers import run_here, with_option


def test_a_request_in_rtu_with_and_without_its_crc() -> None:
    with ModbusServer("rtu://pty", {1: simulator("adxl").modbus}) as server:
        typed = run_here("send", with_option(server.url, "timeout=30"), "01 04 0F B1 00 02 22 F8")
        added = run_here("send", with_option(server.url, "timeout=30"), "0x01,04,0fb1,00 02", "--crc")
    assert typed.returncode == added.returncode == 0
    assert typed.stdout == added.stdout
    sent, _, received = typed.stdout.partition("received\n")
    assert "valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok" in sent
    assert "5  00 F5  register 1     00F5h (245)" in received


def test_a_broken_frame_goes_out_as_it_is_and_the_error_says_that_it_is_broken() -> None:
    with ModbusServer("rtu://pty", {1: Table()}) as server:
        run = run_here("send", f"{server.url}?timeout=0.05", "01 03 00 00 00 01 84 0B")
    assert run.returncode == 1
    assert "not valid: CRC is 84 0B, should be 84 0A" in run.stdout
    assert "no answer within 0.05 s: what was sent is not a valid frame" in run.stderr


@pytest.mark.parametrize("frame", [":010300000001FB", "3A 30 31 30 33 30 30 30 30 30 30 30 31 46 42 0D 0A"])
def test_ascii_as_characters_and_as_their_codes(frame: str) -> None:
    with ModbusServer("ascii://pty", {1: Table()}) as server:
        run = run_here("send", with_option(server.url, "timeout=30"), frame)
    assert "valid: a response from unit 1, Read Holding Registers, 1 register; LRC ok" in run.stdout


def test_the_check_of_an_ascii_frame_is_added_on_request() -> None:
    with ModbusServer("ascii://pty", {1: Table()}) as server:
        run = run_here("send", with_option(server.url, "timeout=30"), ":010300000001", "--crc")
    assert "FB     LRC" in run.stdout
    assert run.returncode == 0


def test_tcp_as_json() -> None:
    with ModbusServer("tcp://127.0.0.1:0", {1: Table()}) as server:
        run = run_here("send", with_option(server.url, "timeout=30"), "000700000006010300000001", "--json")
    sent, received = map(json.loads, run.stdout.splitlines())
    assert (sent["direction"], sent["role"]) == ("sent", "request")
    assert (received["direction"], received["role"], received["valid"]) == ("received", "response", True)
    assert received["fields"][0]["value"] == 7


def test_an_answer_that_is_not_one_to_the_request_is_named() -> None:
    with ModbusServer("tcp://127.0.0.1:0", {1: Table()}, faults="wrong-unit:1") as server:
        run = run_here("send", with_option(server.url, "timeout=30"), "000700000006010300000001")
    assert "diagnosis: unit 2 answers, and unit 1 was asked" in run.stdout


def test_a_broadcast_has_no_answer() -> None:
    with ModbusServer("rtu://pty", {1: Table()}) as server:
        run = run_here("send", f"{server.url}?timeout=0.05", "00 06 00 00 00 01", "--crc")
    assert run.returncode == 1
    assert "unit 0 is a broadcast, which no device answers" in run.stderr


def test_on_can_the_answer_to_an_sdo_request_is_explained_and_other_frames_are_shown() -> None:
    with CanopenServer("can://memory/send?node=5", device="az3"):
        run = run_here("send", "can://memory/send?timeout=30", "605#4041600000000000")
        for patience in (0.5, PATIENCE):  # the command listens so long in any case, and a busy machine needs longer
            reset = run_here("send", f"can://memory/send?timeout={patience}", "000#8105")
            if "received" in reset.stdout:
                break
        nobody = run_here("send", "can://memory/send?timeout=0.05", "606#4041600000000000")
    assert "valid: SDO answer from node 5: initiate upload, 6041h:00, 2 bytes" in run.stdout
    assert reset.returncode == 0
    assert "received  705#00  valid: error control from node 5: boot-up" in reset.stdout
    assert nobody.returncode == 1
    assert nobody.stderr.strip().endswith("no frame 586 within 0.05 s")
