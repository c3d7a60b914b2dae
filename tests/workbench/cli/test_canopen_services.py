"""`barewire canopen nmt`, `lss`, `emcy` and `pdo`: with nodes in this process, on a bus in memory."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from barewire import CanopenClient, CanopenServer
from barewire.canopen import (
    CanFrame,
    Emergency,
    Entry,
    LocalNode,
    LssAddress,
    LssSlave,
    ObjectDictionary,
    PdoConfig,
    eds,
)
from barewire.canopen.communication_objects import standard_objects
from barewire.devices import load
from barewire_workbench.cli.canopen_services import _events
from barewire_workbench.eds.export import export
from tests.helpers import free_port
from tests.workbench.cli.helpers import error_of, output_of, run_here

ADDRESS = LssAddress(0x360, 1, 0x10002, 77)


@pytest.fixture
def bus(tmp_path: Path) -> Iterator[CanopenClient]:
    with CanopenClient(f"can://memory/{tmp_path.name}") as client:
        yield client


def url(bus: CanopenClient, node: int | None = None) -> str:
    return f"can://memory/{bus.bus.name.rpartition('/')[2]}" + ("" if node is None else f"?node={node}")


def fan(node: int = 5, heartbeat: int = 50) -> LocalNode:
    entries = [
        *standard_objects(ADDRESS, heartbeat=heartbeat),
        Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637),
        Entry(0x60FF, 0, "speed", "i32", "rw", -2),
    ]
    pdos = [PdoConfig("TPDO", 1, (0x60410010, 0x60FF0020), type=1), PdoConfig("RPDO", 1, (0x60FF0020,))]
    return LocalNode(node, ObjectDictionary(entries), pdos)


@contextmanager
def sent_again_and_again(send: Callable[[], object]) -> Iterator[None]:
    """Send in a thread until the block ends, so that a command that listens hears it whenever it begins."""
    ended = threading.Event()

    def run() -> None:
        while not ended.wait(0.02):
            send()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def test_nmt_shows_the_state_that_the_heartbeat_reports(bus: CanopenClient) -> None:
    with bus.host(fan()):
        assert output_of("canopen", "nmt", url(bus, 5), "start", "--wait", "30") == "node 5: operational\n"
        assert output_of("canopen", "nmt", url(bus), "stop", "5", "--wait", "30") == "node 5: stopped\n"
        row = json.loads(output_of("canopen", "nmt", url(bus), "preop", "5", "--wait", "30", "--json"))
        assert row == {"node": 5, "state": 127, "text": "pre-operational"}
        assert output_of("canopen", "nmt", url(bus), "reset-comm", "5", "--wait", "30") == "node 5: booted\n"
        assert output_of("canopen", "nmt", url(bus), "start", "all", "--wait", "0.5") == "node 5: operational\n"


def test_nmt_of_a_node_that_is_silent_or_stays(bus: CanopenClient) -> None:
    done = run_here("canopen", "nmt", url(bus), "start", "7", "--wait", "0.05")
    assert (done.returncode, done.stdout) == (0, "")
    sent = "start was sent to node 7, which no node confirms; no heartbeat came within 0.05 s"
    assert f"{sent}, so the state is not known" in done.stderr
    done = run_here("canopen", "nmt", url(bus), "start", "7", "--wait", "0.05", "--verify")
    assert (done.returncode, f"{sent}, and it did not answer, so" in done.stderr) == (1, True)
    done = run_here("canopen", "nmt", url(bus), "start", "all", "--wait", "0.05", "--verify")
    assert (done.returncode, "start was sent to the nodes, which" in done.stderr) == (1, True)
    with bus.host(fan(7, heartbeat=0)):  # it answers node guarding
        text = output_of("canopen", "nmt", url(bus), "start", "7", "--wait", "0.5", "--verify")
        assert text == "node 7: operational\n"
    with sent_again_and_again(lambda: bus.send(CanFrame(0x707, b"\x7f"))):
        done = run_here("canopen", "nmt", url(bus), "start", "7", "--wait", "0.5")
    assert (done.returncode, done.stdout) == (1, "node 7: pre-operational\n")
    refusal = error_of("canopen", "nmt", url(bus), "start", status=2)
    assert "expected NODE or all behind the command, or here the node, such as ?node=5" in refusal
    assert "expected a number in 1..127, or all" in error_of("canopen", "nmt", url(bus), "start", "128", status=2)
    assert "did you mean 'start'" in error_of("canopen", "nmt", url(bus), "strat", "5", status=2)
    assert "expected can://" in error_of("canopen", "nmt", "tcp://127.0.0.1", "start", "5", status=2)


def test_nmt_of_a_silent_node_on_a_bus_without_remote_frames() -> None:
    with CanopenServer(f"can://socketcand/127.0.0.1:{free_port()}/can0?node=5", device="az3") as server:
        place = server.url.partition("?")[0]
        error = error_of("canopen", "nmt", place, "stop", "9", "--wait", "0.05", "--verify")
    sent = "stop was sent to node 9, which no node confirms; no heartbeat came within 0.05 s"
    assert f"{sent}, and it cannot be asked: {place}: socketcand carries no remote frames, so" in error


def test_heartbeats_are_listed_with_each_change(bus: CanopenClient) -> None:
    with sent_again_and_again(lambda: bus.send(CanFrame(0x707, b"\x7f"))):
        assert output_of("canopen", "heartbeat", url(bus), "--count", "1") == "node 7: pre-operational\n"
        row = json.loads(output_of("canopen", "heartbeat", url(bus), "--count", "1", "--json"))
        assert row == {"node": 7, "state": 127, "text": "pre-operational"}
    with sent_again_and_again(lambda: bus.send(CanFrame(0x707, b"\x00"))):
        assert output_of("canopen", "heartbeat", url(bus), "--count", "1") == "node 7: booted\n"
    assert "no heartbeat came" in run_here("canopen", "heartbeat", url(bus), "--for", "0.02").stderr
    with sent_again_and_again(lambda: bus.send(CanFrame(0x707, b"\x05"))):
        done = run_here("canopen", "heartbeat", url(bus, 8), "--for", "0.05")
        assert (done.stdout, "no heartbeat came" in done.stderr) == ("", True)
        assert output_of("canopen", "heartbeat", url(bus, 7), "--count", "1") == "node 7: operational\n"


def test_sync_once_and_again(bus: CanopenClient) -> None:
    with bus.frames((0x80, False)) as frames:
        assert run_here("canopen", "sync", url(bus)).stderr == "barewire: 1 SYNC sent\n"
        assert run_here("canopen", "sync", url(bus), "--every", "0.01", "--count", "3").returncode == 0
        assert len([frames.get(0.0) for _ in range(4)]) == 4
        assert frames.get(0.0) is None


def test_lss_finds_and_assigns(bus: CanopenClient) -> None:
    with bus.host(LocalNode(None, ObjectDictionary(standard_objects(ADDRESS)), lss=LssSlave(ADDRESS))):
        assert output_of("canopen", "lss", "find", url(bus)) == f"{ADDRESS}\n"
        done = run_here("canopen", "lss", "assign", url(bus), "12", "13")
        assert done.returncode == 1
        assert done.stdout.startswith(f"node 12: {ADDRESS}, booted")
        assert "1 of 2 were not given" in done.stderr
        assert run_here("canopen", "lss", "find", url(bus)).returncode == 1
        address = "360-1-10002-4D"
        text = output_of("canopen", "lss", "assign", url(bus), "14", "--address", address, "--no-store")
        assert text == f"node 14: {ADDRESS}; it has it after reset-comm\n"
        assert output_of("canopen", "nmt", url(bus), "reset-comm", "12", "--wait", "0.2") == ""
        assert output_of("read", url(bus, 14), "raw", "object:1018h.4:u32") == "object:1018h.4:u32 = 77\n"


def test_lss_bit_rate_and_store(bus: CanopenClient) -> None:
    stored: list[tuple[int | None, int | None]] = []

    def store(node: int | None, rate: int | None) -> bool:
        stored.append((node, rate))
        return True

    slave = LssSlave(ADDRESS, store=store)
    with bus.host(LocalNode(5, ObjectDictionary(standard_objects(ADDRESS)), lss=slave)):
        address = ("--address", str(ADDRESS))
        text = output_of("canopen", "lss", "bitrate", url(bus), "500000", *address)
        assert text == "500000 bit/s, stored; from the next power-on\n"
        assert output_of("canopen", "lss", "store", url(bus), "--only-device", "--json") == '{"stored": true}\n'
        assert len(stored) == 2
        assert "expected one of 1000000, 800000" in error_of(
            "canopen", "lss", "bitrate", url(bus), "9600", *address, status=2
        )
        other = "1-2-3-4"
        text = error_of("canopen", "lss", "store", url(bus), "--address", other)
        assert "no device with the LSS address 00000001-00000002-00000003-00000004 answered" in text
        assert "expected --address" in error_of("canopen", "lss", "store", url(bus), status=2)
        text = error_of("canopen", "lss", "store", url(bus), "--address", "1-2", status=2)
        assert "expected VENDOR-PRODUCT-REVISION-SERIAL" in text


def test_emcy_explains_what_nodes_report(bus: CanopenClient) -> None:
    frame = Emergency(5, 0x8130, 0x11, b"\x02").encode()
    with sent_again_and_again(lambda: bus.send(frame)):
        text = output_of("canopen", "emcy", url(bus), "--count", "1")
        assert text == (
            "node 5: 8130h life guarding or heartbeat error; register 11h (generic, communication); 02 00 00 00 00\n"
        )
        row = json.loads(output_of("canopen", "emcy", url(bus, 5), "--count", "1", "--json"))
        assert (row["node"], row["code"], row["active"]) == (5, 0x8130, [0x8130])
    with sent_again_and_again(lambda: bus.send(Emergency(5, 0).encode())):
        text = output_of("canopen", "emcy", url(bus), "--count", "1")
        assert text == "node 5: error gone: nothing that was heard; no error left\n"
    assert output_of("canopen", "emcy", url(bus), "--for", "0.05") == ""


def test_emcy_history_reads_1003h(bus: CanopenClient) -> None:
    node = fan()
    with bus.host(node) as running:
        assert output_of("canopen", "emcy", url(bus, 5), "--history") == "register 00h (no error)\n"
        running.do(lambda now: node.error(0x3210, now))
        lines = output_of("canopen", "emcy", url(bus, 5), "--history").splitlines()
        assert lines == ["register 05h (generic, voltage)", "1: 3210h voltage inside the device; 0000h"]
    assert "expected the node" in error_of("canopen", "emcy", url(bus), "--history", status=2)


def test_pdo_shows_values_by_the_mapping_of_the_node(bus: CanopenClient) -> None:
    with bus.host(fan()), bus.sync.start(0.02):
        bus.node(5).nmt.start()
        lines = output_of("canopen", "pdo", url(bus, 5), "--count", "1").splitlines()
        assert lines == [
            "TPDO1 185h: 6041h:00, 60FFh:00; at every SYNC",
            "RPDO1 205h: 60FFh:00",
            "TPDO1: 6041h:00 = 1591; 60FFh:00 = 4294967294",
        ]
        lines = output_of("canopen", "pdo", url(bus, 5), "az3", "--count", "1").splitlines()
        assert lines[-1] == "TPDO1: STATUS WORD = 1591; TARGET VELOCITY = -2"
        row = json.loads(output_of("canopen", "pdo", url(bus, 5), "az3", "--count", "1", "--json"))
        assert row["values"] == {"STATUS WORD": 1591, "TARGET VELOCITY": -2}


def test_pdo_leaves_out_an_rpdo_that_cannot_be_sent(bus: CanopenClient) -> None:
    node = fan()
    node.objects.set(0x1400, 1, 0)
    with bus.host(node):
        done = run_here("canopen", "pdo", url(bus, 5), "--for", "0.02")
    assert done.stdout.splitlines() == ["TPDO1 185h: 6041h:00, 60FFh:00; at every SYNC"]
    assert "left out: RPDO1 of node 5 cannot be sent: its COB-ID 000h is restricted" in done.stderr


def test_pdo_without_sync_says_what_is_missing(bus: CanopenClient) -> None:
    with bus.host(fan()):
        bus.node(5).nmt.start()
        text = run_here("canopen", "pdo", url(bus, 5), "--for", "0.02").stderr
    assert "no PDO came" in text
    assert "for a SYNC wait TPDO1: barewire canopen sync" in text


def test_pdo_of_a_file_sends_nothing(bus: CanopenClient, tmp_path: Path) -> None:
    file = tmp_path / "az3.dcf"
    document = eds.to_dcf(export(load("az3")), 5, {(0x1A00, 0): 1, (0x1A00, 1): 0x60410010})
    file.write_bytes(document.encode())
    with sent_again_and_again(lambda: bus.send(CanFrame(0x185, b"\x37\x06"))):
        lines = output_of("canopen", "pdo", url(bus), str(file), "--count", "1").splitlines()
        assert "TPDO1 185h: STATUS WORD; at every SYNC" in lines
        assert lines[-1] == "TPDO1: STATUS WORD = 1591"
    with sent_again_and_again(lambda: bus.send(CanFrame(0x185, b"\x37"))):
        assert ": 37: " in output_of("canopen", "pdo", url(bus), str(file), "--count", "1").splitlines()[-1]
    with bus.frames() as frames:
        run_here("canopen", "pdo", url(bus), str(file), "--for", "0.01")
        assert frames.get(0.0) is None
    empty = tmp_path / "empty.eds"
    empty.write_bytes(eds.compose([]).encode())
    assert "has no PDO that is switched on" in error_of("canopen", "pdo", url(bus, 5), str(empty), status=2)
    assert "an EDS has no node-ID" in error_of("canopen", "pdo", url(bus), str(empty), status=2)


def test_pdos_of_a_node_that_does_not_tell(bus: CanopenClient) -> None:
    """It refuses every upload, for a reason that does not say that there is no such object."""
    with bus.frames((0x605, False)) as requests:

        def refuse() -> None:
            if isinstance(frame := requests.get(0.05), CanFrame):
                bus.send(CanFrame(0x585, b"\x80" + frame.data[1:4] + bytes.fromhex("00 00 00 08")))

        with sent_again_and_again(refuse):
            assert "node 5, 1800h:01: 0800 0000h general error" in error_of("canopen", "pdo", url(bus, 5))


def test_ctrl_c_is_how_listening_ends_and_an_interruption_of_a_count() -> None:
    class Interrupted:
        def get(self, timeout: float | None) -> None:
            raise KeyboardInterrupt

    stream: Any = Interrupted()
    assert list(_events(stream, None, None)) == []
    with pytest.raises(KeyboardInterrupt):
        list(_events(stream, None, 3))
