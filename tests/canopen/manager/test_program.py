"""The program check and download of the boot slave process, with a node that has a boot loader."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest

from barewire.canopen import BootError, BootSlave, CanFrame, Entry, LocalNode, ObjectDictionary, boot_slave
from barewire.canopen.communication_objects import standard_objects
from barewire.codecs import Value
from tests.canopen.virtual_bus import VirtualBus

OLD, NEW = 0x11, 0x22
PROGRAM = bytes(range(200))
SLAVE = BootSlave(5, check_program=True, update_program=True, software=NEW, program=PROGRAM)


class Loader:
    """The objects 1F50h to 1F57h of a node. `busy` is how often the flash status is busy, `flash` its last value."""

    def __init__(self, *, busy: int = 2, flash: int = 0, written: int = NEW, starts: bool = True,
                 dated: list[int] | None = None) -> None:  # fmt: skip
        self.commands: list[int] = []
        self.busy, self.flash, self.written = busy, flash, written
        self.starts = starts
        self.date, self.dated = [1, 2], dated
        self.identification, self.control, self.data = OLD, 1, b""
        objects = ObjectDictionary(
            [
                *standard_objects(),
                Entry(0x1F50, 1, "data", "domain", default=b"", on_write=self.write),
                Entry(0x1F51, 1, "control", "u8", on_read=lambda: self.control, on_write=self.command),
                *(Entry(0x1F52, sub, "date", "u32", "ro", on_read=partial(self.part, sub)) for sub in (1, 2)),
                Entry(0x1F56, 1, "identification", "u32", "ro", on_read=lambda: self.identification),
                Entry(0x1F57, 1, "flash", "u32", "ro", on_read=self.status),
            ]
        )
        self.bus, device = VirtualBus(), LocalNode(5, objects)
        self.bus.add(device, sent=device.start(0.0))
        self.bus.pass_time(0.01)

    def part(self, sub: int) -> int:
        return self.date[sub - 1]

    def write(self, data: Value) -> None:
        assert isinstance(data, bytes)
        self.data, self.identification, self.date = data, self.written, self.dated or self.date

    def command(self, value: Value) -> None:
        self.commands.append(int(value))
        if value == 0 or (value == 1 and self.starts):
            self.control = int(value)

    def status(self) -> int:
        self.busy -= 1
        return 1 if self.busy >= 0 else self.flash


def test_the_expected_program_stays() -> None:
    loader = Loader()
    loader.identification = NEW
    assert loader.bus.run(boot_slave(SLAVE)).ok
    assert loader.commands == []


def test_the_date_of_the_program_is_compared_too() -> None:
    dated = BootSlave(5, check_program=True, update_program=True, software_date=(15519, 1000), program=PROGRAM)
    loader = Loader()
    loader.date = [15519, 1000]
    assert loader.bus.run(boot_slave(dated)).ok
    assert loader.commands == []
    for date in ([15519, 999], [15518, 1000]):
        loader = Loader(dated=[15519, 1000])
        loader.date = date
        assert loader.bus.run(boot_slave(dated)).error is None
        assert (loader.commands, loader.data) == ([0, 3, 1], PROGRAM)
    result = Loader().bus.run(boot_slave(replace(dated, update_program=False)))
    assert (result.error, result.reason) == (BootError.H, "program date: 1, expected 15519")
    result = Loader(dated=[15519, 7]).bus.run(boot_slave(dated))
    assert result.error is BootError.I
    assert result.reason.endswith("; after the download 1F52h:02 is 00000007h, expected 000003E8h")


def test_date_and_identification_of_the_program_must_both_be_the_expected_ones() -> None:
    both = replace(SLAVE, software_date=(1, 2), update_program=False)
    loader = Loader()
    assert loader.bus.run(boot_slave(both)).reason == "read 00000011h, expected 00000022h"
    loader.identification = NEW
    assert loader.bus.run(boot_slave(both)).ok
    loader.date = [1, 3]
    assert loader.bus.run(boot_slave(both)).reason == "program time: 3, expected 2"


def test_another_program_is_replaced_and_started() -> None:
    loader = Loader()
    steps: list[str] = []
    assert loader.bus.run(boot_slave(SLAVE, progress=lambda node, step: steps.append(step))).error is None
    assert (loader.commands, loader.data) == ([0, 3, 1], PROGRAM)
    assert steps[1:] == [
        *("read 1F56h:01 program identification", "stop its program", "clear its program"),
        *("write its program, 200 bytes", "wait for its flash", "start its program", "read 1000h:00 device type"),
    ]


def test_a_stopped_program_is_not_stopped_again_and_a_restart_may_be_silent() -> None:
    loader = Loader()
    loader.control = 0
    loader.bus.lose = lambda number, frame: (
        frame.id == 0x585 and frame.data[:4] == bytes.fromhex("60511F01") and (loader.commands == [3, 1])
    )
    assert loader.bus.run(boot_slave(SLAVE, timeout=0.1)).ok
    assert loader.commands == [3, 1]


def test_a_clear_that_takes_its_time_is_repeated() -> None:
    loader = Loader()
    lost: list[CanFrame] = []

    def lose(number: int, frame: CanFrame) -> bool:
        if frame.id == 0x605 and frame.data[:5] == bytes.fromhex("2F511F0103") and len(lost) < 2:
            lost.append(frame)
            return True
        return False

    loader.bus.lose = lose
    assert loader.bus.run(boot_slave(SLAVE, timeout=0.1)).ok
    assert (len(lost), loader.commands) == (2, [0, 3, 1])


@pytest.mark.parametrize(
    ("slave", "error", "text"),
    [
        (replace(SLAVE, software=0), BootError.G, ""),
        (replace(SLAVE, update_program=False), BootError.H, "read 00000011h, expected 00000022h"),
        (replace(SLAVE, program=b""), BootError.I, "there is no program to download (1F58h)"),
    ],
)
def test_no_update_is_possible(slave: BootSlave, error: BootError, text: str) -> None:
    loader = Loader()
    result = loader.bus.run(boot_slave(slave))
    assert (result.error, loader.commands) == (error, [])
    assert text in result.reason


@pytest.mark.parametrize(
    ("loader", "text"),
    [
        (Loader(flash=6), "flash status 1F57h:01 = 00000006h: error in the data format, or CRC error"),
        (Loader(flash=0x12340080), "manufacturer-specific error 1234h"),
        (Loader(busy=10_000), "the flash is still busy after 60 s"),
        (Loader(starts=False), "the program has not started after 60 s (1F51h:01)"),
        (Loader(written=0x33), "after the download 1F56h:01 is 00000033h, expected 00000022h"),
    ],
)
def test_a_download_that_fails(loader: Loader, text: str) -> None:
    result = loader.bus.run(boot_slave(SLAVE))
    assert result.error is BootError.I
    assert text in result.reason
    assert (1 in loader.commands) is (not loader.starts)


def test_a_node_without_these_objects() -> None:
    bus, device = VirtualBus(), LocalNode(5, ObjectDictionary(standard_objects()))
    bus.add(device, sent=device.start(0.0))
    result = bus.run(boot_slave(SLAVE))
    assert result.error is BootError.G
    assert "1F56h:01: 0602 0000h object does not exist" in result.reason
