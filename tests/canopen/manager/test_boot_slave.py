"""The boot slave process of one node, each step and each error, in virtual time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from barewire.canopen import (
    BootError,
    BootResult,
    BootSlave,
    CanFrame,
    ConciseValue,
    NmtState,
    boot_slave,
    device_configuration,
    slave_of,
)
from tests.canopen.configuration.plant import DATE, bus_with, dcf, writes
from tests.canopen.virtual_bus import VirtualBus

IDENTITY: dict[str, Any] = {"device_type": 0x191, "vendor": 0x360, "product": 7, "revision": 0x10002, "serial": 99}
STAMP = (DATE["Configuration.Date"], DATE["Configuration.Time"])


def boot(bus: VirtualBus, slave: BootSlave, timeout: float = 0.1) -> BootResult:
    return bus.run(boot_slave(slave, timeout=timeout))


def test_a_node_of_the_expected_identity_boots() -> None:
    bus, _ = bus_with()
    result = boot(bus, BootSlave(5, **IDENTITY))
    assert (result.error, result.ok, str(result)) == (None, True, "node 5: booted")
    requests = [text[4:14] for _, text in bus.log if text.startswith("605#")]
    assert requests == ["4000100000", "4018100100", "4018100200", "4018100300", "4018100400"]


def test_what_is_not_expected_is_not_read() -> None:
    bus, _ = bus_with()
    assert boot(bus, BootSlave(5)).ok
    assert sum(text.startswith("605#") for _, text in bus.log) == 1  # 1000h: whether there is a node


@pytest.mark.parametrize(
    ("field", "error", "text"),
    [
        ("device_type", BootError.C, "read 00000191h, expected 00000192h"),
        ("vendor", BootError.D, "read 00000360h, expected 00000361h"),
        ("product", BootError.M, "read 00000007h, expected 00000008h"),
        ("revision", BootError.N, "read 00010002h, expected 00010003h"),
        ("serial", BootError.O, "read 00000063h, expected 00000064h"),
    ],
)
def test_another_identity(field: str, error: BootError, text: str) -> None:
    bus, _ = bus_with()
    result = boot(bus, BootSlave(5, **(IDENTITY | {field: IDENTITY[field] + 1})))
    assert (result.error, result.reason, result.ok) == (error, text, False)
    assert str(result) == f"node 5: {error.name}: {error.value}: {text}"
    assert writes(bus) == []


def test_a_node_that_is_not_listed_is_not_asked() -> None:
    bus, _ = bus_with()
    assert boot(bus, BootSlave(5, listed=False)).error is BootError.A
    assert bus.log == []


def test_no_node_is_asked_four_times() -> None:
    bus, _ = bus_with(6)
    result = boot(bus, BootSlave(5))
    assert result.error is BootError.B
    assert result.reason.startswith("node 5 did not answer the upload of 1000h:00 within 0.1 s")
    assert sum(text.startswith("605#40") for _, text in bus.log) == 4


def test_a_node_that_was_just_reset_may_answer_late() -> None:
    bus, _ = bus_with()
    requests = 0

    def lose(number: int, frame: CanFrame) -> bool:
        nonlocal requests
        requests += frame.id == 0x605 and frame.data[0] == 0x40
        return frame.id == 0x585 and requests < 3

    bus.lose = lose
    assert boot(bus, BootSlave(5)).error is None


def test_an_operational_node_that_is_kept_alive_is_not_configured() -> None:
    slave = replace(slave_of(device_configuration(dcf({"Heartbeat": 20})), heartbeat=0.1), keep_alive=True)
    bus, device = bus_with(x1017_00=30)
    bus.inject("000#0105", bus.now)
    bus.pass_time(0.1)
    bus.log.clear()
    result = boot(bus, slave)
    assert (result.error, result.ok, result.state, writes(bus)) == (BootError.L, True, NmtState.OPERATIONAL, [])
    assert device.state is NmtState.OPERATIONAL


@pytest.mark.parametrize("heartbeat", [0.1, 0.0])
def test_a_node_that_is_kept_alive_but_not_operational_is_reset(heartbeat: float) -> None:
    bus, device = bus_with(x1017_00=30)
    device.objects.set(0x6040, 0, 7)
    device.stored.values[0x1017, 0] = 30  # or its reset ends the heartbeat
    result = boot(bus, BootSlave(5, keep_alive=True, heartbeat=heartbeat))
    assert (result.error, result.state) == (None, NmtState.PRE_OPERATIONAL if heartbeat else None)
    assert "000#8205" in [text for _, text in bus.log]
    assert "705#00" in [text for _, text in bus.log]


@pytest.mark.parametrize(("heartbeat", "error"), [(0.1, BootError.E), (0.0, BootError.F)])
def test_a_node_that_is_kept_alive_but_silent(heartbeat: float, error: BootError) -> None:
    bus, _ = bus_with()
    bus.lose = lambda number, frame: frame.id == 0x705
    assert boot(bus, BootSlave(5, keep_alive=True, heartbeat=heartbeat)).error is error


def test_the_configuration_is_written_if_its_date_differs() -> None:
    bus, device = bus_with()
    slave = slave_of(device_configuration(dcf({"Heartbeat": 500})))
    result = boot(bus, slave)
    assert (result.error, result.configured, str(result)) == (None, True, "node 5: booted, configured")
    assert (device.objects["Heartbeat"], writes(bus)[0]) == (500, "1017:0=1F4")
    bus.log.clear()
    device.objects.set(0x1017, 0, 1)  # the date is compared, not the values
    assert boot(bus, slave).configured is False
    assert writes(bus) == []


def test_a_concise_dcf_is_written_in_its_order() -> None:
    bus, _ = bus_with(x1020_01=STAMP[0], x1020_02=STAMP[1] - 1)
    values = tuple(
        ConciseValue(index, sub, number.to_bytes(size, "little"))
        for index, sub, number, size in ((0x1017, 0, 1, 2), (0x1020, 1, STAMP[0], 4), (0x1020, 2, STAMP[1], 4))
    )
    slave = BootSlave(5, date=STAMP, configuration=values)
    assert boot(bus, slave).configured
    assert writes(bus) == ["1017:0=1", "1020:1=3C9F", "1020:2=3059EE0"]
    assert not boot(bus, slave).configured
    assert boot(bus, replace(slave, date=(0, 0))).configured  # without a date it is always written


def test_a_configuration_that_the_node_refuses() -> None:
    bus, _ = bus_with()
    result = boot(bus, BootSlave(5, configuration=(ConciseValue(0x5000, 0, b"\0"),)))
    assert result.error is BootError.J
    assert "5000h:00: 0602 0000h object does not exist" in result.reason


def test_error_control_waits_for_the_first_heartbeat() -> None:
    bus, _ = bus_with(x1017_00=50)
    result = boot(bus, BootSlave(5, heartbeat=0.2))
    assert (result.error, result.state) == (None, NmtState.PRE_OPERATIONAL)
    bus, _ = bus_with()
    result = boot(bus, BootSlave(5, heartbeat=0.2))
    assert (result.error, result.ok) == (BootError.K, False)
    assert "no heartbeat from node 5 within 0.2 s" in result.reason


def test_error_control_starts_node_guarding() -> None:
    bus, _ = bus_with()
    assert boot(bus, BootSlave(5, guard_time=0.1, retry_factor=3)).ok
    assert bus.log[-1][1] == "705#R1"


def test_a_node_that_the_manager_does_not_boot_is_only_monitored() -> None:
    bus, _ = bus_with(x1017_00=50)
    assert boot(bus, BootSlave(5, boot=False, vendor=1, heartbeat=0.2)).ok
    assert not any(text.startswith("605#") for _, text in bus.log)


def test_progress_is_told_in_words() -> None:
    bus, _ = bus_with(x1017_00=50)
    steps: list[tuple[int, str]] = []
    slave = BootSlave(5, vendor=0x360, heartbeat=0.2)
    bus.run(boot_slave(slave, progress=lambda node, step: steps.append((node, step))))
    assert steps == [(5, "read 1000h:00 device type"), (5, "read 1018h:01 vendor-ID"), (5, "wait for its heartbeat")]


def test_every_letter_has_its_meaning() -> None:
    assert "".join(error.name for error in BootError) == "ABCDEFGHIJKLMNO"
    assert str(BootError.A) == "A: the node is not in the network list (1F81h)"


def test_a_concise_dcf_beside_a_dcf_is_written_after_it_and_before_the_date() -> None:
    bus, device = bus_with()
    configuration = device_configuration(dcf({(0x1017, 0): 500}))
    slave = BootSlave(5, configuration=configuration, concise=(ConciseValue(0x1006, 0, b"\x10\x27\0\0"),), date=STAMP)
    assert boot(bus, slave).configured
    assert writes(bus) == ["1017:0=1F4", "1006:0=2710", f"1020:1={STAMP[0]:X}", f"1020:2={STAMP[1]:X}"]
    assert device.objects.get(0x1006) == 10000
    bus.log.clear()
    assert not boot(bus, slave).configured
    assert writes(bus) == []
