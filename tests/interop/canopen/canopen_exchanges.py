"""Exchanges between our device and a master of the `canopen` package of PyPI, service by service.

Each exchange is a function of a bench, decorated with the services that it proves. `test_canopen_exchanges` runs them
over every carrier of this machine, `test_canopen_guest` over SocketCAN in a guest kernel.

    canopen_exchanges           the list of exchanges; our device, their master
    canopen_master_exchanges    our master, their device
    can_utils_exchanges         with programs in other processes
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import NamedTuple

import canopen
import pytest

from barewire.canopen import (
    NmtState,
)
from tests.helpers import PATIENCE
from tests.interop.canopen.can_bench import ADDRESS, NODE, Bench

LENGTHS = (5, 7, 8, 100, 889, 1000)
VALUES = (
    (0x2001, "32", "0B"),
    (0x1017, None, "D007"),
    (0x2000, "112233", "AABBCC"),
    (0x60FF, "589EFFFF", "A8610000"),
    (0x206A, "0000C03F", "CDCC8C3F"),
)


class Exchange(NamedTuple):
    """One exchange: our role in it, and what it proves."""

    name: str
    role: str
    services: tuple[str, ...]
    run: Callable[[Bench], None]
    peer: str = "canopen"
    only: tuple[str, ...] = ()

    def goes_over(self, carrier: str) -> bool:
        """Return whether the exchange is possible: python-can's socketcand carries no remote frames, so no node
        guarding."""
        if self.only:
            return carrier in self.only
        return not (carrier == "socketcand" and "node guarding" in self.services)


EXCHANGES: list[Exchange] = []


Run = Callable[[Bench], None]


def exchange(role: str, *services: str, peer: str = "canopen", only: tuple[str, ...] = ()) -> Callable[[Run], Run]:
    """Register a function as an exchange."""

    def register(function: Run) -> Run:
        EXCHANGES.append(Exchange(function.__name__.replace("_", " "), role, services, function, peer, only))
        return function

    return register


def counting(length: int) -> bytes:
    return bytes(place % 256 for place in range(length))


@exchange("device", "SDO expedited upload", "SDO expedited download")
def their_master_reads_and_writes_numbers(bench: Bench) -> None:
    bench.start_device()
    node = bench.remote()
    for index, value, other in VALUES:
        assert value is None or node.sdo.upload(index, 0) == bytes.fromhex(value)
        node.sdo.download(index, 0, bytes.fromhex(other))
        assert node.sdo.upload(index, 0) == bytes.fromhex(other)


def _their_master_moves_long_values(bench: Bench, block: bool) -> None:
    device = bench.start_device().device
    node = bench.remote()
    for length in LENGTHS:
        value = counting(length)
        with node.sdo.open(0x2100, 0, "wb", size=length, block_transfer=block, buffering=7) as stream:
            stream.write(value)
        assert device.objects.read(0x2100, 0) == value
        with node.sdo.open(0x2100, 0, "rb", block_transfer=block) as stream:
            assert stream.read() == value
    assert device.sdo.counters.aborts_sent == 0


@exchange("device", "SDO segmented upload", "SDO segmented download")
def their_master_moves_long_values_in_segments(bench: Bench) -> None:
    _their_master_moves_long_values(bench, block=False)


@exchange("device", "SDO block upload", "SDO block download")
def their_master_moves_long_values_in_blocks(bench: Bench) -> None:
    _their_master_moves_long_values(bench, block=True)


@exchange("device", "SDO abort")
def their_master_gets_our_aborts(bench: Bench) -> None:
    bench.start_device()
    node = bench.remote()
    for index, data, code in (
        (0x3000, None, 0x0602_0000),
        (0x2001, b"\x65", 0x0609_0031),
        (0x2001, b"\1\2", 0x0607_0012),
        (0x2002, b"\1\2\3\4", 0x0601_0002),
    ):
        with pytest.raises(canopen.SdoAbortedError) as caught:
            node.sdo.upload(index, 0) if data is None else node.sdo.download(index, 0, data)
        assert caught.value.code == code


@exchange("device", "NMT command", "heartbeat")
def their_master_commands_our_device(bench: Bench) -> None:
    device = bench.start_device().device
    node = bench.remote()
    for name, state in (("OPERATIONAL", NmtState.OPERATIONAL), ("STOPPED", NmtState.STOPPED),
                        ("PRE-OPERATIONAL", NmtState.PRE_OPERATIONAL)):  # fmt: skip
        node.nmt.state = name
        bench.wait(lambda state=state: device.state is state)  # type: ignore[misc]
        bench.wait(lambda name=name: node.nmt.wait_for_heartbeat(2.0) == name)  # type: ignore[misc]


def boot_ups_of(node: canopen.RemoteNode) -> list[int]:
    """Return a list that gets a 0 for each boot-up that canopen's master hears from now on.

    `node.nmt.wait_for_bootup` looks at the last state only: on a busy computer the first heartbeat, 0.1 s behind the
    boot-up, overwrites it before the waiting thread runs.
    """
    boot_ups: list[int] = []
    node.nmt.add_heartbeat_callback(lambda state: boot_ups.append(state) if state == 0 else None)
    return boot_ups


@exchange("device", "NMT command", "boot-up")
def their_master_resets_our_device(bench: Bench) -> None:
    device = bench.start_device().device
    node = bench.remote()
    for command in (0x81, 0x82):
        node.sdo.download(0x1017, 0, (60_000).to_bytes(2, "little"))
        boot_ups = boot_ups_of(node)
        node.nmt.send_command(command)
        bench.wait(lambda boot_ups=boot_ups: boot_ups)  # type: ignore[misc]
        assert node.sdo.upload(0x1017, 0) == (100).to_bytes(2, "little")
        assert device.state is NmtState.PRE_OPERATIONAL


@exchange("device", "node guarding")
def their_master_guards_our_device(bench: Bench) -> None:
    device = bench.start_device().device
    node = bench.remote()
    node.sdo.download(0x1017, 0, bytes(2))
    answers: list[int] = []
    bench.network.subscribe(0x700 + NODE, lambda identifier, data, timestamp: answers.append(data[0]))
    node.nmt.start_node_guarding(0.03)
    bench.wait(lambda: len(answers) >= 5)
    node.nmt.stop_node_guarding()
    assert device.heartbeat.period == 0
    toggled = answers[answers.index(0x7F) :] if 0x7F in answers else []
    assert toggled[:4] == [0x7F, 0xFF, 0x7F, 0xFF]


@exchange("device", "EMCY")
def their_master_receives_our_emergencies(bench: Bench) -> None:
    running = bench.start_device()
    node = bench.remote()
    received: list[tuple[int, int, bytes]] = []
    node.emcy.add_callback(lambda error: received.append((error.code, error.register, error.data)))
    running.do(lambda now: running.device.error(0x3210, now, info=b"\1\2"))
    bench.wait(lambda: len(received) == 1)
    running.do(lambda now: running.device.error_gone(0x3210, now))
    bench.wait(lambda: len(received) == 2)
    assert received == [(0x3210, 0x05, b"\1\2\0\0\0"), (0, 0, bytes(5))]


@exchange("device", "SYNC", "TPDO", "NMT command")
def their_master_sends_sync_and_receives_our_tpdo(bench: Bench) -> None:
    running = bench.start_device()
    node = bench.remote()
    node.tpdo.read()
    node.nmt.state = "OPERATIONAL"
    bench.wait(lambda: running.device.state is NmtState.OPERATIONAL)
    for velocity in (-25_000, 100_000):
        running.device.objects.set(0x60FF, 0, velocity)
        threading.Timer(0.05, bench.network.sync.transmit).start()
        assert node.tpdo[1].wait_for_reception(2.0) is not None
        assert node.tpdo[1]["target velocity"].raw == velocity
        assert node.tpdo[1]["statusword"].raw == 0x0637


@exchange("device", "RPDO", "NMT command")
def their_master_sends_our_device_an_rpdo(bench: Bench) -> None:
    device = bench.start_device().device
    node = bench.remote()
    node.rpdo.read()
    node.nmt.state = "OPERATIONAL"
    bench.wait(lambda: device.state is NmtState.OPERATIONAL)
    node.rpdo[1]["controlword"].raw = 0x000F
    node.rpdo[1]["target velocity"].raw = -123_456
    node.rpdo[1].transmit()
    bench.wait(lambda: device.objects.get(0x6040) == 0x000F)
    assert device.objects.get(0x60FF) == -123_456


@exchange("device", "PDO mapping")
def their_master_configures_our_pdos(bench: Bench) -> None:
    device = bench.start_device().device
    tpdo = bench.remote().tpdo[1]
    tpdo.read()
    assert (tpdo.cob_id, tpdo.trans_type, [mapped.index for mapped in tpdo]) == (0x185, 1, [0x6041, 0x60FF])
    tpdo.clear()
    tpdo.add_variable(0x60FF)
    tpdo.add_variable(0x2001)
    tpdo.trans_type, tpdo.enabled = 3, True
    tpdo.save()
    mapped = [device.objects.get(0x1A00, sub) for sub in range(3)]
    assert mapped == [2, 0x60FF_0020, 0x2001_0008]
    assert (device.objects.get(0x1800, 1), device.objects.get(0x1800, 2)) == (0x185, 3)


@exchange("device", "TIME")
def their_master_sends_our_device_the_time(bench: Bench) -> None:
    device = bench.start_device().device
    bench.network.time.transmit(1_700_000_000.5)
    bench.wait(lambda: device.time.last is not None)
    assert device.time.last is not None
    assert device.time.last.stamp.unix == pytest.approx(1_700_000_000.5)


@exchange("device", "LSS switch", "LSS inquire", "LSS configure", "boot-up")
def their_master_gives_our_device_a_node_id(bench: Bench) -> None:
    running = bench.start_device(None)
    node = bench.remote()
    lss = bench.network.lss
    lss.RESPONSE_TIMEOUT = PATIENCE
    lss.send_switch_state_global(lss.CONFIGURATION_STATE)
    assert [lss.inquire_lss_address(service) for service in (0x5A, 0x5B, 0x5C, 0x5D)] == list(ADDRESS)
    assert lss.inquire_node_id() == 0xFF
    lss.configure_node_id(NODE)
    lss.configure_bit_timing(4)
    lss.store_configuration()
    with pytest.raises(canopen.lss.LssError):
        lss.configure_node_id(128)
    boot_ups = boot_ups_of(node)
    lss.send_switch_state_global(lss.WAITING_STATE)
    bench.wait(lambda: boot_ups)
    assert running.device.node == NODE


@exchange("device", "LSS switch", "LSS inquire", "LSS identify")
def their_master_selects_and_identifies_our_device(bench: Bench) -> None:
    bench.start_device()
    lss = bench.network.lss
    lss.RESPONSE_TIMEOUT = PATIENCE
    vendor, product, revision, serial = ADDRESS
    lss.send_identify_remote_slave(vendor, product, 0, revision, serial, 0xFFFF_FFFF)
    bench.wait(lambda: any(frame.data[:1] == b"\x4f" for frame in bench.seen))  # the method does not return the answer
    assert lss.send_switch_state_selective(*ADDRESS)
    assert lss.inquire_node_id() == NODE


@exchange("device", "LSS identify", "LSS fastscan")
def their_master_finds_our_device_by_fastscan(bench: Bench) -> None:
    bench.start_device(None)
    lss = bench.network.lss
    lss.RESPONSE_TIMEOUT = PATIENCE
    lss.send_identify_non_configured_remote_slave()
    bench.wait(lambda: not lss.responses.empty())  # else the scan takes that answer for its first one
    found = None
    for lss.RESPONSE_TIMEOUT in (0.2, 1.0, 5.0):  # seconds for each bit that is not answered: a busy machine needs more
        found = lss.fast_scan()
        if found == (True, list(ADDRESS)):
            break
    assert found == (True, list(ADDRESS))
