"""The reasons in errors of a drive that does not reach its goal, and requests that are refused at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Any

import pytest

from barewire.conversation import Conversation
from barewire.devices import Reading
from barewire.devices.drive import Drive, DriveProgress
from barewire.devices.sim.csd_mt.environment import Span
from barewire.errors import EncodeError
from barewire.modbus import ModbusException
from tests.devices.drive.test_drive import WIRES, Bench, stepper
from tests.helpers import refused


@pytest.fixture
def csd() -> Bench:
    return Bench(WIRES[0])


def test_homing_with_an_unknown_method_is_refused(csd: Bench) -> None:
    """As delivered, register 1050 is 0: the motor would not move, and the time-out would not show the reason."""
    with refused(
        EncodeError, "home: Homing Method 0 is not a homing method: expected one of -2, -1, 3, 4, 5, 6, 19, 20"
    ):
        csd.do(csd.drive.home(enable=True))
    assert csd.states == []  # the drive was not enabled
    with refused(EncodeError, "home: Homing Method 7 is not a homing method"):
        csd.drive.home(7)
    csd.machine.store["Homing Method"] = 35
    assert csd.do(csd.drive.home(enable=True)).position == 0


def test_the_error_of_homing_at_standstill_names_the_speed_that_is_0(csd: Bench) -> None:
    csd.machine.store["Input Config"] = 0b11110  # I0 is the proximity input
    message = csd.stuck(csd.drive.home(19, within=20.0, enable=True))
    assert (
        "waiting for homing attained (bits 12 and 10): the motor stands; Homing Speed During Search for Zero is 0;"
        in message
    )


def test_the_error_of_homing_without_a_switch_has_the_velocity(csd: Bench) -> None:
    message = csd.stuck(csd.drive.home(19, within=2.0, enable=True))  # no input is the proximity input
    assert "waiting for homing attained (bits 12 and 10): the motor still turns, velocity " in message


@pytest.mark.parametrize("wire", WIRES)
def test_the_error_of_a_move_at_speed_0_names_the_speed(wire: str) -> None:
    bench = Bench(wire)
    message = bench.stuck(bench.drive.move(1000, velocity=0, within=1.0, enable=True))
    name = bench.machine.device.find("Profile Velocity").name
    assert f"waiting for target reached: the motor stands; {name} is 0;" in message
    assert bench.do(bench.drive.move(1000, velocity=600, enable=True)).position == 1000
    assert bench.do(bench.drive.move(1000, velocity=0)).position == 1000  # it is at this position already


def test_the_error_of_a_move_that_needs_longer_has_the_velocity(csd: Bench) -> None:
    csd.do(csd.drive.enable())
    assert "the motor still turns, velocity 24000;" in csd.stuck(csd.drive.move(10_000_000, within=1.0))


@pytest.mark.parametrize("within", [0.0, -1.0, float("nan")])
def test_a_time_that_is_not_positive_is_refused(csd: Bench, within: float) -> None:
    """With not-a-number, "is the time over" is never true."""
    for act in (csd.drive.move, csd.drive.velocity):
        with refused(EncodeError, f"within = {within:g}: expected seconds, above 0"):
            act(5, within=within)
    with refused(EncodeError, "timeout = nan: expected seconds, above 0"):
        Drive(csd.drive.access, csd.machine.device, timeout=float("nan"))
    assert not csd.progress


@pytest.mark.parametrize("target", [float("nan"), float("inf")])
def test_a_target_that_is_not_finite_is_refused(csd: Bench, target: float) -> None:
    """An f32 without a range could carry it."""
    known, parts = csd.machine.device, csd.drive.roles
    goal = replace(known.find(parts.target_position), type="f32", minimum=None, maximum=None)
    rows = tuple(goal if row.name == goal.name else row for row in known.parameters)
    drive = Drive(csd.drive.access, replace(known, parameters=rows), progress=csd.progress.append)
    with refused(EncodeError, f"Target Position = {target}: expected a finite number"):
        drive.move(target)
    assert not csd.progress


def test_a_step_that_the_drive_does_not_have_is_refused_before_anything_is_sent(csd: Bench) -> None:
    with refused(EncodeError, "Target Position = 1.5: 1.5 is not a whole number for i32"):
        csd.drive.move(1.5)
    assert not csd.progress
    assert stepper(csd).axis.state.value == "switch on disabled"


@pytest.mark.parametrize("wire", WIRES)
@pytest.mark.parametrize(
    ("written", "reported"),
    [
        ({"MODES": 3, "CONTROL WORD": 0x10F}, "MODES 3; another master wrote CONTROL WORD 010Fh"),
        ({"TARGET POSITION": 5}, "TARGET POSITION 5"),
    ],
)
def test_reaching_the_target_of_another_master_is_an_error(wire: str, written: dict[str, int], reported: str) -> None:
    """A drive that another master has halted reports "target reached" too."""
    bench = Bench(wire)
    parts = bench.drive.roles
    names = {"MODES": parts.mode, "CONTROL WORD": parts.control_word, "TARGET POSITION": parts.target_position}
    done: list[bool] = []

    def writes_too(progress: DriveProgress) -> None:
        if progress.waiting_for == "target reached" and progress.status.velocity and not done:
            done.append(True)
            for name, value in written.items():
                bench.machine.store.cell(names[name]).put(value)

    bench.drive.progress = writes_too
    message = bench.stuck(bench.drive.move(2000, velocity=600, enable=True))
    for name, real in names.items():
        reported = reported.replace(name, real)
    assert f"waiting for target reached: the motor stands; another master wrote {reported};" in message


def test_reaching_the_velocity_of_another_master_is_an_error() -> None:
    bench = Bench(WIRES[2])
    bench.drive.progress = lambda progress: bench.machine.store.cell("TARGET VELOCITY").put(-900)
    assert "another master wrote TARGET VELOCITY -900;" in bench.stuck(bench.drive.velocity(900, enable=True))


def test_a_move_that_ends_at_a_limit_switch_is_an_error(csd: Bench) -> None:
    """The drive stops there as after a halt, and reports "target reached"."""
    drive = stepper(csd)
    drive.store["Input Config"] = 0b11011  # I2 is the positive limit switch, OFF above 10000
    drive.environment.inputs[2] = Span(-inf, 10_000)
    message = csd.stuck(csd.drive.move(50_000, enable=True))
    assert "waiting for target reached: a limit of the drive is active, bit 11; the motor stands;" in message
    assert "; position " in message
    where = csd.do(csd.drive.status()).position
    assert isinstance(where, int)
    assert csd.do(csd.drive.move(where - 100)).position == where - 100  # away from it


@pytest.mark.parametrize("wire", WIRES[1:])
@pytest.mark.parametrize("relative", [False, True])
def test_a_move_that_ends_at_a_software_limit_is_an_error(wire: str, relative: bool) -> None:
    bench = Bench(wire)
    bench.machine.store["SOFT MIN POSITION LIMIT"] = -100
    bench.machine.store["SOFT MAX POSITION LIMIT"] = 100
    message = bench.stuck(bench.drive.move(5000, relative=relative, enable=True))
    assert "a limit of the drive is active, bit 11" in message
    assert bench.do(bench.drive.move(-50)).position == -50


def test_a_move_with_a_following_error_is_an_error(csd: Bench) -> None:
    """Reaction code 0 stops the motor and leaves it enabled: bit 13 and "target reached" at once."""

    def slips(progress: DriveProgress) -> None:
        if progress.waiting_for == "target reached" and progress.status.velocity and not stepper(csd).shaft.error:
            stepper(csd).slip(-3000, progress.status.now)

    csd.drive.progress = slips
    message = csd.stuck(csd.drive.move(100_000, enable=True))
    assert "a following error, bit 13" in message


def test_a_velocity_against_a_limit_switch_is_an_error(csd: Bench) -> None:
    drive = stepper(csd)
    drive.store["Input Config"] = 0b11011
    drive.environment.inputs[2] = Span(-inf, -1)  # OFF where the shaft stands
    message = csd.stuck(csd.drive.velocity(30_000, within=2.0, enable=True))
    assert "after 2 s, waiting for target reached: a limit of the drive is active, bit 11; the motor stands;" in message
    assert csd.do(csd.drive.velocity(-30_000, enable=True)).velocity == -30_000


def test_a_drive_whose_commands_cannot_be_read_back_is_not_checked(csd: Bench) -> None:
    access, control = csd.drive.access, csd.drive.roles.control_word
    reads = access.read

    def refusing(names: Sequence[str]) -> Conversation[Any, list[Reading]]:
        if control in names:
            raise ModbusException(2)
        return reads(names)

    access.read = refusing  # type: ignore[method-assign]
    assert csd.do(csd.drive.move(700, enable=True)).position == 700
