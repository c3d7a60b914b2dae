"""Samples at their times, in virtual time: failed polls, refused names, machines on one port and on several."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from barewire import CanopenServer, ModbusServer, load
from barewire.devices import Device, Reading
from barewire.devices.sim import simulator
from barewire.errors import DecodeError, EncodeError, NoAnswer, PortError
from barewire.modbus import ModbusException
from barewire_workbench.cli.raw_address import device_with
from barewire_workbench.live.check_device import WrongDevice, check_device
from barewire_workbench.live.polling import Clock, PolledLine, Poller, by_port, next_sample, samples
from barewire_workbench.value_log.csv_file import CsvFile
from barewire_workbench.value_log.rotating_log import RotatingLog, Rotation
from barewire_workbench.value_log.sample import Sample, Watched, columns_of, headings, row_of
from tests.helpers import every_case, part_or_whole, refused
from tests.workbench.value_log.memory_disk import MemoryDisk, Stopped

RAW = device_with("raw", [f"holding:{address}" for address in range(3)])


class VirtualClock(Clock):
    """A clock that is moved by those who wait, and by polls that take time."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def now(self) -> float:
        return self.seconds

    def wait_until(self, now: float) -> None:
        self.seconds = max(self.seconds, now)

    def date(self) -> datetime:
        return datetime(2026, 11, 27, 22, tzinfo=UTC) + timedelta(seconds=self.seconds)


class FakeMachine:
    """A machine that refuses some names, alone or with others, and raises the given errors first."""

    def __init__(self, errors: Sequence[Exception | None] = (), takes: Callable[[], object] = lambda: None) -> None:
        self.errors = list(errors)
        self.takes = takes
        self.refuses: set[str] = set()
        self.refusal: Exception = ModbusException(2, 3)
        self.requests: list[tuple[str, ...]] = []
        self.connected = 0

    def connect(self, device: Device, endpoint: str) -> FakeMachine:
        self.connected += 1
        return self

    def close(self) -> None:
        pass

    def read_all(self, names: Sequence[str]) -> list[Reading]:
        self.takes()
        self.requests.append(tuple(names))
        if self.errors and (error := self.errors.pop(0)) is not None:
            raise error
        if self.refuses & set(names):
            raise self.refusal
        return [Reading(RAW.find(name), len(self.requests)) for name in names]

    def read(self, name: str) -> Reading:
        return self.read_all([name])[0]


def watched(*names: str, endpoint: str = "tcp://127.0.0.1") -> Watched:
    return Watched(endpoint, device_with("raw", names), names)


def line(machine: FakeMachine, *names: str, check: Callable[[Any], bool] = lambda machine: True) -> PolledLine:
    return PolledLine([watched(*(names or ("holding:0",)))], check, machine.connect)


def polled(machine: FakeMachine, count: int, **options: Any) -> list[Sample]:
    return list(samples([line(machine)], 10.0, clock=VirtualClock(), count=count, **options))


# Times


def test_deadlines_do_not_drift_and_missed_ones_are_left_out() -> None:
    number, passed, times = 0, 0.0, []
    for takes in (0.1, 0.1, 1.2, 0.1, 0.5):
        passed = max(passed, number * 0.5)
        times.append(passed)
        passed += takes
        number = next_sample(number, 0.5, passed)
    assert times == [0.0, 0.5, 1.0, 2.5, 3.0]
    assert number == 7


def test_a_period_may_be_as_short_as_a_number_can_be() -> None:
    assert next_sample(0, 5e-324, 1.0) > 0


def test_a_day_of_slow_polls_ends_at_its_second() -> None:
    clock = VirtualClock()

    def take_a_while() -> None:
        clock.seconds += 0.7

    made = list(samples([line(FakeMachine(takes=take_a_while))], 10.0, clock=clock, until=86400.0))
    assert len(made) == 8640
    assert [sample.seconds for sample in made] == [10.0 * number for number in range(8640)]
    assert made[-1].at == datetime(2026, 11, 28, 21, 59, 50, tzinfo=UTC)


# One machine


def test_polling_continues_after_a_failed_poll() -> None:
    machine = FakeMachine([None, NoAnswer("silence"), PortError("unplugged"), None])
    assert [sample.polls[0].error for sample in polled(machine, 4)] == ["", "silence", "unplugged", ""]
    assert machine.connected == 2  # again after the port failed


def test_a_request_that_cannot_be_encoded_ends_polling() -> None:
    with refused(EncodeError, "no such type"):
        polled(FakeMachine([EncodeError("no such type")]), 1)


def test_a_machine_is_checked_after_each_connection_and_another_one_is_not_read() -> None:
    machine = FakeMachine([None, PortError("unplugged")])
    answers: list[bool | Exception] = [True, WrongDevice("another one"), True]

    def check(_: Any) -> bool:
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    made = list(samples([line(machine, check=check)], 10.0, clock=VirtualClock(), count=5))
    assert [sample.polls[0].error for sample in made] == ["", "unplugged", "another one", "", ""]
    assert answers == []


def test_a_machine_that_is_silent_at_first_is_checked_when_it_answers() -> None:
    machine, checks = FakeMachine([NoAnswer("silence")] * 3), [False, True]
    port = line(machine, check=lambda machine: checks.pop(0))
    port.check()
    made = list(samples([port], 10.0, clock=VirtualClock(), count=5))
    assert [sample.polls[0].error for sample in made] == ["silence"] * 3 + ["", ""]
    assert checks == []
    assert len(machine.requests) == 5


@every_case("refusal", [ModbusException(2, 3), DecodeError("value", b"\1\2\3\4", 0, "4 bytes: expected 2")])
def test_a_name_that_cannot_be_read_is_read_alone_as_long_as_that_is_so(refusal: Exception) -> None:
    names = ("holding:0", "holding:1", "holding:2")
    machine, poller = FakeMachine(), Poller(names)
    machine.refusal = refusal
    machine.refuses = {"holding:1"}
    poll = poller.poll(machine)
    assert ([reading.name for reading in poll.readings], list(poll.refused)) == (
        ["holding:0", "holding:2"],
        ["holding:1"],
    )
    assert machine.requests == [names, *((name,) for name in names)]
    machine.requests.clear()
    assert poller.poll(machine).refused == poll.refused
    assert machine.requests == [("holding:0", "holding:2"), ("holding:1",)]
    machine.refuses = set()
    assert poller.poll(machine).refused == {}
    machine.requests.clear()
    assert [reading.name for reading in poller.poll(machine).readings] == list(names)
    assert machine.requests == [names]
    machine.refuses = set(names)
    with refused(type(refusal), str(refusal)):
        poller.poll(machine)


# Several


def test_machines_on_one_port_share_it() -> None:
    units = {1: simulator("adxl").modbus, 2: simulator("az3").modbus}
    with ModbusServer("rtu://pty", units) as server:
        url = server.url
        machines = [
            Watched(f"{url}?unit=1", load("adxl"), ("Status",)),
            Watched(f"{url}?unit=2&timeout=3", load("az3"), ("STATUS WORD",)),
        ]
        (group,) = by_port(machines)
        port = PolledLine(group, check_device)
        port.check()
        polls = next(samples([port], 1.0, count=1)).polls
        assert [str(poll.readings[0])[:15] for poll in polls] == ["Status = 2 (Sta", "STATUS WORD = 4"]
        port.close()


def test_nodes_on_one_bus_share_it() -> None:
    with (
        CanopenServer("can://memory/polling?node=1", device="az3"),
        CanopenServer("can://memory/polling?node=2", device="az3"),
    ):
        machines = [Watched(f"can://memory/polling?node={node}", load("az3"), ("STATUS WORD",)) for node in (1, 2)]
        (group,) = by_port(machines)
        port = PolledLine(group, check_device)
        assert [len(poll.readings) for poll in port.poll()] == [1, 1]
        port.close()


def test_a_port_that_does_not_answer_delays_no_other() -> None:
    silent, quick = threading.Event(), FakeMachine()
    slow = FakeMachine(takes=lambda: silent.wait(30))
    ports = [line(slow), line(quick)]
    made = []
    for sample in samples(ports, 1.0, count=4):  # in which also a busy machine answers
        made.append(sample)
        if len(made) == 2:
            silent.set()
    assert [sample.polls[0].error for sample in made[:2]] == ["no answer within the period"] * 2
    assert all(sample.polls[1].readings for sample in made)
    assert any(sample.polls[0].readings for sample in made[2:])


def test_an_error_of_the_program_in_a_port_of_several_ends_polling() -> None:
    with pytest.raises(EncodeError, match="no such type"):
        list(samples([line(FakeMachine()), line(FakeMachine([EncodeError("no such type")]))], 0.05, count=3))


# All of it


@pytest.mark.long
@pytest.mark.parametrize("days", part_or_whole(2, 7))
def test_a_week_of_watching_in_virtual_time(days: int) -> None:
    """A sample every ten seconds for a week, in a part for two days, files of a day; the power is cut about every
    two hours, and the machine is silent about every hour: no sample is missing but those that were under way."""
    clock, disk = VirtualClock(), MemoryDisk(5)
    machine = FakeMachine()
    chosen = [watched("holding:0")]
    columns = columns_of(chosen)
    shown: list[str] = []
    end, kills = days * 86400.0, 0
    while clock.seconds < end:
        disk.stop_in = disk.random.randrange(1, 3000)
        machine.errors = [None] * disk.random.randrange(600) + [NoAnswer("silence"), PortError("unplugged")]
        try:
            log = RotatingLog(
                disk, "night.csv", lambda: CsvFile(disk, "night.csv", headings(columns)), Rotation(day=True)
            )
            port = PolledLine(chosen, lambda machine: True, machine.connect)
            for sample in samples([port], 10.0, clock=clock, until=end - clock.seconds):
                row = row_of(sample, columns, chosen)
                log.add(row, clock.now())
                shown.append(str(row[0]))
            log.close(clock.now())
            break
        except Stopped:
            kills += 1
            disk.cut_power()
            clock.seconds += 10.0
    assert kills > 30 / 7 * days
    lines = [text for path in [*disk.names("night-", ".csv"), "night.csv"] for text in _rows(disk.contents[path])]
    times = [text.partition(",")[0] for text in lines]
    assert times == sorted(set(times))
    assert set(shown) <= set(times)
    assert len(shown) > 8640 * days - 2 * kills
    assert len(disk.names("night-", ".csv")) == days
    assert sum("silence" in text for text in lines) > 20 / 7 * days


def _rows(content: bytes) -> list[str]:
    assert content.endswith(b"\n") or not content
    return content.decode().splitlines()[1:]
