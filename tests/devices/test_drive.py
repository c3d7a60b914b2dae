"""The drive code on three buses in virtual time: the CSD MT over TCP, the AZ3 over RTU and over CANopen.

The reasons in errors of a drive that does not reach its goal, and requests that are refused at once.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from math import inf
from typing import Any

import pytest

from barewire.canopen import CanFrame, Channel
from barewire.conversation import Conversation, play
from barewire.devices import CanopenAccess, Device, ModbusAccess, Reading, load
from barewire.devices.cia402 import State
from barewire.devices.drive import Drive, DriveProgress, DriveStatus, DriveStuck
from barewire.devices.sim import Az3, CsdMt, Simulator, simulator
from barewire.devices.sim.csd_mt.environment import Span
from barewire.errors import EncodeError
from barewire.modbus import Bus, ModbusException, Server
from barewire.rtu import RtuLine, Timing
from barewire.tcp import TcpLine
from tests.helpers import refused, serving

WIRES = ("csd-mt over TCP", "az3 over RTU", "az3 over CANopen")
TIMING = Timing.of(19200)


class Bench:
    """A simulated drive, a bus, and the drive code. Time stands still between two actions."""

    def __init__(self, wire: str, **options: Any) -> None:
        device, _, self.protocol = wire.partition(" over ")
        self.machine: Simulator = simulator(device)
        if isinstance(self.machine, CsdMt):
            self.machine.store["Velocity Window"] = 10  # as delivered, 21300 step/s off still counts as reached
            self.machine.store["Velocity Total Sample"] = 1  # as delivered, the displayed value is the mean of 100 ms
        self.progress: list[DriveProgress] = []
        self.now = 1.0
        self.drive: Drive[Any] = Drive(self._access(), self.machine.device, progress=self.progress.append, **options)

    def _access(self) -> ModbusAccess | CanopenAccess:
        device = self.machine.device
        if self.protocol == "CANopen":
            self.peer: Callable[..., Iterable[Any]] = self._bus
            return CanopenAccess(Channel(1), device)
        assert self.machine.modbus is not None
        units = {1: self.machine.modbus}
        if self.protocol == "TCP":
            self.peer = serving(Server(TcpLine(), units, serial=False))
            return ModbusAccess(Bus(TcpLine()), 1, device)
        self.peer = serving(Server(RtuLine(TIMING, role="server"), units, serial=True), TIMING)
        return ModbusAccess(Bus(RtuLine(TIMING)), 1, device)

    def _bus(self, frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        assert self.machine.canopen is not None
        return [(now + 0.0005, answer) for answer in self.machine.canopen.feed(frame, now)]

    def sending_takes(self, item: Any) -> float:
        return TIMING.duration(len(item)) if self.protocol == "RTU" else 0.0005

    def do(self, conversation: Conversation[Any, DriveStatus]) -> DriveStatus:
        look, self.now = play(conversation, self.peer, start=self.now, sending_takes=self.sending_takes)
        return look

    def stuck(self, conversation: Conversation[Any, DriveStatus]) -> str:
        with pytest.raises(DriveStuck) as caught:
            self.do(conversation)
        self.now += 100.0
        return str(caught.value)

    @property
    def states(self) -> list[str]:
        """The states passed through, each once in a row."""
        names = [progress.status.state_name for progress in self.progress]
        return [name for place, name in enumerate(names) if place == 0 or names[place - 1] != name]


@pytest.fixture(params=WIRES)
def bench(request: pytest.FixtureRequest) -> Bench:
    return Bench(request.param)


@pytest.fixture
def csd() -> Bench:
    return Bench(WIRES[0])


def stepper(bench: Bench) -> CsdMt:
    assert isinstance(bench.machine, CsdMt)
    return bench.machine


# States, the same on every bus


def test_enabling_passes_every_state_and_disabling_switches_off(bench: Bench) -> None:
    assert bench.do(bench.drive.enable()).state is State.OPERATION_ENABLED
    up = ["switch on disabled", "ready to switch on", "switched on", "operation enabled"]
    assert bench.states == up
    assert bench.now < 1.5
    assert bench.do(bench.drive.disable()).state is State.SWITCH_ON_DISABLED
    assert bench.states == [*up, "switch on disabled"]


def test_status_reads_the_drive_once(bench: Bench) -> None:
    look = bench.do(bench.drive.status())
    assert (look.state_name, look.position, look.velocity) == ("switch on disabled", 0, 0)
    (progress,) = bench.progress
    assert json.loads(json.dumps(progress.as_dict()))["bits"][0] == "voltage enabled"


def test_status_words_are_the_same_on_all_buses() -> None:
    words = []
    for wire in WIRES:
        bench = Bench(wire)
        bench.do(bench.drive.move(0, relative=True, enable=True))
        words.append(bench.do(bench.drive.status()).status_word)
    assert words == [0x0637] * 3


# Motion


def test_a_trapezoidal_move_takes_the_computed_time(bench: Bench) -> None:
    bench.do(bench.drive.enable())
    # In the drive's units; `unit` converts a velocity to distance per second.
    distance, speed, rate, unit = (240_000, 90_000, 140_000, 1.0)
    if bench.machine.device.name == "az3":
        distance, speed, rate, unit = (81_920, 600, 1200, 8192 / 60)
    began, before = bench.now, len(bench.progress)
    status = bench.do(bench.drive.move(distance, velocity=speed, acceleration=rate, deceleration=rate, enable=True))
    assert status.position == distance
    assert status.velocity == 0
    moving = [progress.status for progress in bench.progress[before:] if progress.status.velocity]
    formula = distance / (speed * unit) + speed / rate
    assert moving[-1].now - moving[0].now == pytest.approx(formula, abs=0.2)
    assert bench.now - began == pytest.approx(formula, abs=0.6)
    assert max(status.velocity for status in moving if isinstance(status.velocity, (int, float))) == speed


def test_absolute_and_relative(bench: Bench) -> None:
    bench.do(bench.drive.move(4000, enable=True))
    assert bench.do(bench.drive.move(1000, relative=True)).position == 5000
    assert bench.do(bench.drive.move(1000)).position == 1000
    assert bench.do(bench.drive.move(-500, relative=True)).position == 500


def test_a_velocity_is_reached_and_the_motor_goes_on_turning(bench: Bench) -> None:
    target = -20_000 if bench.machine.device.name == "csd-mt" else -1500
    look = bench.do(bench.drive.velocity(target, acceleration=40_000, deceleration=40_000, enable=True))
    assert look.velocity == target
    bench.now += 10
    assert bench.do(bench.drive.status()).velocity == target
    assert bench.do(bench.drive.velocity(0)).velocity == 0


def test_a_change_of_mode_halts_the_shaft_first(bench: Bench) -> None:
    bench.do(bench.drive.velocity(1200, acceleration=4000, deceleration=4000, enable=True))
    assert bench.do(bench.drive.move(7000)).position == 7000
    assert any(progress.waiting_for == "standstill (halt)" for progress in bench.progress)
    assert bench.do(bench.drive.velocity(1200)).velocity == 1200


def test_a_quick_stop_brakes_and_returns_the_final_state(bench: Bench) -> None:
    bench.do(bench.drive.velocity(3000, acceleration=4000, deceleration=4000, enable=True))
    look = bench.do(bench.drive.quick_stop())
    assert look.velocity == 0
    stays = bench.machine.device.name == "csd-mt"
    assert look.state is (State.QUICK_STOP_ACTIVE if stays else State.SWITCH_ON_DISABLED)
    assert bench.do(bench.drive.enable()).state is State.OPERATION_ENABLED


def test_the_position_after_homing_is_the_offset(csd: Bench) -> None:
    csd.do(csd.drive.move(5000, enable=True))
    stepper(csd).store["Homing Offset"] = 123
    look = csd.do(csd.drive.home(35))
    assert (look.position, look.state) == (123, State.OPERATION_ENABLED)


def test_homing_searches_for_the_switch(csd: Bench) -> None:
    stepper(csd).store["Input Config"] = 0b11110  # I0 is the proximity input
    stepper(csd).store["Homing Speed During Search for Zero"] = 3200
    look = csd.do(csd.drive.home(19, enable=True))
    assert look.position == 0
    assert csd.now > 2.0


def test_a_motor_without_current_is_not_switched_on_by_a_movement(bench: Bench) -> None:
    drive = bench.drive
    bench.do(drive.enable())
    bench.do(drive.disable())
    before = {cell.name: cell.held for cell in bench.machine.store}
    for action in (drive.move(100), drive.velocity(100)):
        message = bench.stuck(action)
        assert "stuck in 'switch on disabled', waiting for 'operation enabled': the drive is not enabled:" in message
        assert "(--enable, enable=True)" in message
    assert {cell.name: cell.held for cell in bench.machine.store} == before  # nothing was written
    assert bench.do(drive.move(100, enable=True)).state is State.OPERATION_ENABLED


def test_a_velocity_above_the_limit_of_the_drive_ends_at_its_limit() -> None:
    bench = Bench(WIRES[1])
    bench.machine.store["MAX MOTOR SPEED"] = 500
    bench.do(bench.drive.enable())
    status = bench.do(bench.drive.velocity(900, acceleration=4000))
    assert (status.velocity, status.is_limited) == (500, True)
    assert not bench.do(bench.drive.velocity(400)).is_limited


# Faults


def test_a_fault_and_its_reset(bench: Bench) -> None:
    bench.do(bench.drive.velocity(1000, acceleration=4000, deceleration=4000, enable=True))
    machine = bench.machine
    assert isinstance(machine, (CsdMt, Az3))
    machine.fault(0x2130, bench.now)
    bench.now += 10
    name = machine.device.find(bench.drive.roles.error_code).name
    message = bench.stuck(bench.drive.enable())
    assert message.startswith("enable: stuck in 'fault', waiting for 'operation enabled': the drive has a fault, ")
    assert f"{name} 2130h" in message
    assert bench.do(bench.drive.disable()).state is State.FAULT
    message = bench.stuck(bench.drive.reset())
    assert message.startswith("reset: stuck in 'fault' after 3 s, waiting for 'switch on disabled'")
    assert "its cause is still there, or the reset was not taken" in message
    machine.solve(bench.now)
    assert bench.do(bench.drive.reset()).state is State.SWITCH_ON_DISABLED
    assert bench.do(bench.drive.reset()).state is State.SWITCH_ON_DISABLED  # without a fault it does nothing
    assert bench.do(bench.drive.enable()).state is State.OPERATION_ENABLED


def test_a_fault_on_the_way_ends_the_move_at_once(csd: Bench) -> None:
    def breaks(progress: DriveProgress) -> None:
        if progress.status.position and stepper(csd).axis.cause == 0:
            stepper(csd).fault(0x8611, progress.status.now)

    csd.drive.progress = breaks
    began = csd.now
    message = csd.stuck(csd.drive.move(1_000_000, enable=True))
    assert message.startswith(
        "move: stuck in 'fault', waiting for target reached: the drive has a fault, Error Code 8611h"
    )
    assert "(motor following error)" in message
    assert csd.now - 100 - began < 1


# Stuck, and why


def test_no_high_voltage(csd: Bench) -> None:
    stepper(csd).supply(False, 0.0)
    message = csd.stuck(csd.drive.enable())
    assert message == (
        "enable: stuck in 'ready to switch on' after 3 s, waiting for 'operation enabled': no high voltage, bit 4 "
        "(voltage enabled) is off; status word 0221h: ready to switch on, quick stop, remote; last control word 0007h"
    )
    stepper(csd).supply(True, csd.now)
    assert csd.do(csd.drive.enable()).state is State.OPERATION_ENABLED  # after the half second that the power needs


def test_a_set_point_that_is_not_acknowledged(csd: Bench) -> None:
    csd.do(csd.drive.enable())
    with pytest.raises(DriveStuck, match=r"after 0\.1 s, waiting for target reached"):
        csd.do(csd.drive.move(200_000, within=0.1))
    csd.now += 0.2  # the movement is still under way: without `immediately` it has to end first
    began = csd.now
    with pytest.raises(DriveStuck, match="waiting for bit 12 to rise"):
        csd.do(Drive(csd.drive.access, csd.machine.device, timeout=0.5).move(100))
    csd.now = began + 0.6
    assert csd.do(csd.drive.move(100, immediately=True)).position == 100


def test_the_drive_is_disabled_by_another_master(csd: Bench) -> None:
    def disables(progress: DriveProgress) -> None:
        if progress.status.position:
            stepper(csd).axis.control(0, progress.status.now)

    csd.drive.progress = disables
    message = csd.stuck(csd.drive.move(1_000_000, enable=True))
    assert message.startswith("move: stuck in 'switch on disabled', waiting for target reached; status word")


# Refused before anything is sent


def test_actions_that_the_description_does_not_support(csd: Bench) -> None:
    with refused(EncodeError, "adxl is not a drive: its description has no table [drive]"):
        Drive(csd.drive.access, load("adxl"))
    az3 = Bench(WIRES[2])
    with refused(
        EncodeError, "home: az3 cannot be homed by this command: its description has no 'homing' in modes of [drive]"
    ):
        az3.drive.home()


def test_values_are_checked_before_anything_is_sent(csd: Bench) -> None:
    with refused(EncodeError, "Profile Velocity = 900000: expected 0..800000 step/s"):
        csd.drive.move(0, velocity=900_000)
    assert not csd.progress


def test_a_drive_with_only_the_two_words() -> None:
    """Without mode display, position, velocity and error code the states still work, and motion is refused."""
    bench = Bench(WIRES[0])
    parts = bench.drive.roles._replace(mode_display="", position="", velocity="", error_code="", target_position="")
    known = bench.machine.device
    bare = Device(known.name, known.title, known.parameters, modbus=known.modbus, drive=parts)
    drive = Drive(ModbusAccess(Bus(TcpLine()), 1, bare), bare)
    look = bench.do(drive.enable())
    assert (look.state, look.position, look.mode) == (State.OPERATION_ENABLED, None, None)
    with refused(EncodeError, "move: the description of csd-mt names no target_position in [drive]"):
        drive.move(100)
    stepper(bench).fault(0x2130, bench.now)
    assert "the drive has a fault, no error code" in bench.stuck(drive.enable())


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
