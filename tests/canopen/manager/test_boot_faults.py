"""A manager whose nodes, or whose application, fail at a bad moment: frame by frame, in virtual time."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    BootError,
    BootManager,
    BootSlave,
    CanFrame,
    ConciseValue,
    LocalNode,
    NetworkList,
    boot_network,
    boot_slave,
)
from tests.canopen.configuration.plant import bus_with
from tests.canopen.virtual_bus import VirtualBus

DEVICE_TYPE = "585#4300100001000000"


def fed(manager: BootManager, text: str | None, now: float) -> list[str]:
    return [str(item) for item in manager.feed(CanFrame.parse(text) if text else None, now)]


def booted(network: NetworkList) -> BootManager:
    """Return a manager whose node 5 has booted at 0.12 s, and must send heartbeats every 0.2 s."""
    manager = BootManager(network)
    fed(manager, None, 0.0)
    fed(manager, "705#00", 0.1)
    fed(manager, DEVICE_TYPE, 0.11)
    assert "node 5: booted" in fed(manager, "705#7F", 0.12)
    return manager


def test_a_stopped_network_needs_nothing_before_its_boot_time_is_over() -> None:
    slaves = [BootSlave(5, mandatory=True, heartbeat=0.2), BootSlave(6, mandatory=True)]
    manager = booted(NetworkList(slaves, stop_all=True, boot_time=1.5))
    assert fed(manager, None, 0.5)[-1] == "network: stopped"
    assert (manager.deadline, manager.busy) == (None, False)


def test_no_node_boots_in_the_feed_that_stops_the_network() -> None:
    manager = booted(NetworkList([BootSlave(5, mandatory=True, heartbeat=0.2), BootSlave(6)], stop_all=True))
    assert fed(manager, "706#00", 0.6)[1:] == ["000#0200", "network: stopped"]
    assert (manager.deadline, manager.busy) == (None, False)


@pytest.mark.parametrize("step", [1, 2])
def test_an_error_of_progress_ends_the_process_of_the_node(step: int) -> None:
    steps = []

    def progress(node: int, text: str) -> None:
        steps.append(text)
        if len(steps) == step:
            raise ZeroDivisionError

    manager = BootManager(NetworkList([BootSlave(5, mandatory=True, vendor=1)]), progress=progress)
    fed(manager, None, 0.0)
    if step == 2:
        fed(manager, "705#00", 0.1)
    with pytest.raises(ZeroDivisionError):
        fed(manager, "705#00" if step == 1 else DEVICE_TYPE, 0.1)
    assert (manager.deadline, manager.busy) == (None, False)
    assert fed(manager, "705#00", 0.2) == ["605#4000100000000000"]  # its boot-up message starts it again


def rebooting(after: int, times: int = 1) -> tuple[VirtualBus, LocalNode]:
    """Return a bus with node 5, which reboots after the given number of responses, again and again `times` times."""
    bus, device = bus_with()
    responses = 0

    def lose(number: int, frame: CanFrame) -> bool:
        nonlocal responses, times
        responses += frame.id == 0x585
        if times and responses == after:
            responses, times = 0, times - 1
            bus.inject("000#8105", bus.now)
        return False

    bus.lose = lose
    return bus, device


CONFIGURATION = (ConciseValue(0x6040, 0, b"\7\0"), ConciseValue(0x1017, 0, b"\x32\0"))


@pytest.mark.parametrize(
    ("after", "letter", "step"),
    [(1, "D", "read 1018h:01 vendor-ID"), (2, "J", "write 6040h:00"), (3, "J", "write 1017h:00")],
)
def test_a_node_that_reboots_while_it_boots(after: int, letter: str, step: str) -> None:
    bus, _ = rebooting(after)
    result = bus.run(boot_slave(BootSlave(5, vendor=0x360, configuration=CONFIGURATION), timeout=0.1))
    assert not result.configured
    assert str(result).startswith(f"node 5: {letter}: ")
    assert str(result).endswith(f": the node rebooted meanwhile, its boot-up message came (step: {step})")


@pytest.mark.parametrize("after", [1, 2, 3])
def test_a_node_that_rebooted_while_it_booted_is_configured_completely(after: int) -> None:
    bus, device = rebooting(after)
    events: list[str] = []
    slave = BootSlave(5, mandatory=True, vendor=0x360, configuration=CONFIGURATION, heartbeat=0.3)
    result = bus.run(boot_network(NetworkList([slave]), timeout=0.1, on_event=lambda event: events.append(event.kind)))
    assert events == ["rebooted", "booted", "started", "ready"]
    assert (str(result.results[0]), device.objects.get(0x6040), device.objects.get(0x1017)) == (
        "node 5: booted, configured",
        7,
        50,
    )


def test_a_node_that_reboots_before_its_first_heartbeat_boots_again() -> None:
    manager = BootManager(NetworkList([BootSlave(5, mandatory=True, heartbeat=0.2)]))
    fed(manager, "705#00", 0.1)
    assert fed(manager, DEVICE_TYPE, 0.11) == []
    assert fed(manager, "705#00", 0.12) == ["node 5: rebooted", "605#4000100000000000"]


def test_a_node_that_reboots_again_and_again_fails() -> None:
    bus, _ = rebooting(3, times=1000)
    events: list[str] = []
    slave = BootSlave(5, mandatory=True, vendor=0x360, configuration=CONFIGURATION)
    result = bus.run(boot_network(NetworkList([slave]), timeout=0.1, on_event=lambda event: events.append(event.kind)))
    assert (events, result.ready) == (["rebooted", "rebooted", "rebooted", "failed"], False)
    assert bus.now < 2


def test_a_late_boot_up_message_before_the_first_response_is_no_reboot() -> None:
    manager = BootManager(NetworkList([BootSlave(5, mandatory=True)]))
    fed(manager, None, 0.0)
    assert fed(manager, None, 1.0) == ["605#4000100000000000"]
    assert fed(manager, "705#00", 1.1) == []
    assert fed(manager, DEVICE_TYPE, 1.2)[0] == "node 5: booted"


def test_a_node_that_is_kept_alive_and_boots_late_is_reset_once() -> None:
    manager = BootManager(NetworkList([BootSlave(5, mandatory=True, keep_alive=True)]))
    fed(manager, None, 0.0)
    fed(manager, DEVICE_TYPE, 0.01)
    assert fed(manager, "705#7F", 0.02) == ["000#8205"]
    assert fed(manager, None, 1.1)[0].startswith("node 5: F: ")
    assert fed(manager, "705#00", 1.5) == ["605#4000100000000000"]
    assert fed(manager, DEVICE_TYPE, 1.6)[:2] == ["node 5: booted", "000#0105"]


def endless(manager: BootManager, unused: int, until: float) -> tuple[list[str], list[CanFrame], float]:
    """Answer each upload with segments without end, 0.9 s after each request: events, frames sent, and the time.

    `unused` is the number of bytes of a segment that contain no data, 7 in an empty one.
    """
    now = 0.0
    events: list[str] = []
    requests: list[CanFrame] = []
    arrivals = [(0.1, CanFrame.parse("705#00"))]
    while now < until:
        frame = arrivals.pop(0)[1] if arrivals and arrivals[0][0] <= now else None
        for item in manager.feed(frame, now):
            if isinstance(item, CanFrame):
                requests.append(item)
                if item.id == 0x605 and item.data[0] != 0x80:
                    segment = f"585#{item.data[0] & 0x10 | unused << 1:02X}41414141414141"
                    text = "585#4000100000000000" if item.data[0] == 0x40 else segment
                    arrivals.append((now + 0.9, CanFrame.parse(text)))
            else:
                events.append(item.kind)
        due = [at for at in (manager.deadline, arrivals[0][0] if arrivals else None) if at is not None]
        if not due:
            break
        now = max(now, min(due))
    return events, requests, now


@pytest.mark.parametrize(("mandatory", "kind"), [(True, "waiting"), (False, "failed")])
def test_a_number_that_has_too_many_bytes_is_refused(mandatory: bool, kind: str) -> None:
    manager = BootManager(NetworkList([BootSlave(5, mandatory=mandatory)]))
    events, requests, _ = endless(manager, 0, 20.0)
    assert (kind in events, manager.results[0].error) == (True, BootError.B)
    assert "605#8000100005000405" in [str(frame) for frame in requests]  # out of memory: more than 4 bytes
    assert "more than 4 bytes came" in str(manager.results[0])


def test_the_boot_time_ends_the_process_of_a_mandatory_node() -> None:
    manager = BootManager(NetworkList([BootSlave(5, mandatory=True)], boot_time=3.0))
    events, _, now = endless(manager, 7, 100.0)
    assert (events, manager.busy, now < 4.0) == (["failed", "missing"], False, True)
    assert str(manager.results[0]).endswith(": the boot time is over (step: read 1000h:00 device type)")


def test_a_configuration_that_is_being_written_is_completed_after_the_boot_time() -> None:
    manager = BootManager(NetworkList([BootSlave(5, mandatory=True, configuration=CONFIGURATION)], boot_time=1.5))
    fed(manager, None, 0.0)
    fed(manager, None, 1.0)
    assert fed(manager, DEVICE_TYPE, 1.1) == ["605#2B40600007000000"]
    assert fed(manager, None, 1.5) == ["node 5: mandatory, and has not booted in time"]
    assert fed(manager, "585#6040600000000000", 1.6) == ["605#2B17100032000000"]
    assert fed(manager, "585#6017100000000000", 1.7)[0] == "node 5: booted, configured"


def test_a_node_that_never_ends_an_upload_fails() -> None:
    class Endless:
        """It answers the upload of 1000h with segments without data, and never with the last one."""

        deadline = None

        def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
            if frame is None or frame.id != 0x605:
                return []
            if frame.data[0] == 0x40:
                return [CanFrame(0x585, b"\x41" + frame.data[1:4] + b"\x04\0\0\0")]
            return (
                [CanFrame(0x585, bytes([frame.data[0] & 0x10 | 0x0E]) + bytes(7))]
                if frame.data[0] & 0xE0 == 0x60
                else []
            )

    bus = VirtualBus()
    bus.add(Endless(), sent=[CanFrame.parse("705#00")])
    result = bus.run(boot_network(NetworkList([BootSlave(5)])))
    assert result.ready
    assert bus.now < 10
    assert "16 segments in a row have no data" in str(result)
