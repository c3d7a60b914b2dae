"""Motion of the servo drive: brake, phasing, references, supply, limits, units."""

from __future__ import annotations

import pytest

from barewire.devices.cia402 import State
from tests.devices.sim.bench import Bench, az3_bench, drive, enable, state

SETTLE = 10.0


@pytest.fixture
def bench() -> Bench:
    return az3_bench()


# Brake, phasing, references


def test_the_shaft_moves_after_the_brake_has_opened(bench: Bench) -> None:
    for name, value in (("BRAKE DISENGAGE TIME", 200), ("BRAKE ENGAGE TIME", 300), ("BRAKE ACTIVATION", True)):
        bench.write(name, value)
    assert bench.read("BRAKE VALUE") is False
    bench.write("TARGET VELOCITY", 500)
    enable(bench)
    bench.now = 0.199
    assert (bench.read("VELOCITY ACTUAL VALUE"), bench.read("BRAKE VALUE")) == (0, False)
    bench.now = 0.45  # 1000 rpm/s from 0.2 s on
    assert (bench.read("VELOCITY ACTUAL VALUE"), bench.read("BRAKE VALUE")) == (250, True)
    bench.now = 2.0
    bench.write("CONTROL WORD", 0)
    bench.now = 2.79  # 0.5 s of ramp, then 0.3 s
    assert bench.read("BRAKE VALUE") is True
    bench.now = 2.81
    assert bench.read("BRAKE VALUE") is False


def test_a_set_point_received_while_the_brake_opens_is_kept(bench: Bench) -> None:
    bench.write("BRAKE ACTIVATION", True)
    bench.write("BRAKE DISENGAGE TIME", 500)
    bench.write("TARGET POSITION", 1000)
    enable(bench, mode=1)
    bench.write("CONTROL WORD", 0x1F)
    bench.now = 0.49
    assert bench.read("POSITION ACTUAL VALUE") == 0
    bench.now = 5.0
    assert bench.read("POSITION ACTUAL VALUE") == 1000


def test_without_brake_activation_the_brake_is_an_output(bench: Bench) -> None:
    bench.write("BRAKE VALUE", True)
    assert bench.read("BRAKE VALUE") is True
    enable(bench)
    bench.write("BRAKE VALUE", False)
    assert bench.read("BRAKE VALUE") is False


def test_phasing_takes_t_align_and_leaves_captures(bench: Bench) -> None:
    bench.write("START PHASING", True)
    assert (bench.read("START PHASING"), bench.read("PHASING IN PROGRESS")) == (False, True)
    assert bench.read("RMS CURRENT") == 1.0  # ALIGNMENT CURRENT
    bench.now = 1.99
    assert bench.read("PHASING IN PROGRESS") is True
    bench.now = 2.0  # 20000 tenths of a millisecond
    assert bench.read("PHASING IN PROGRESS") is False
    assert (bench.read("AUTO-PHASED MOTOR"), bench.read("RMS CURRENT")) == (True, 0)
    captures = [bench.read(f"PHASE DATA INCREMENTAL CAPTURES {place}") for place in range(7)]
    assert captures == [0, 341, 683, 1024, 1365, 1707, 2048]  # 8192 increments over four pole pairs
    bench.write("EEPROM AUTOPHASING DATA CLEANING", True)
    assert (bench.read("AUTO-PHASED MOTOR"), bench.read("PHASE DATA INCREMENTAL CAPTURES 6")) == (False, 0)
    enable(bench)
    bench.write("START PHASING", True)  # not while a master moves the shaft
    assert bench.read("PHASING IN PROGRESS") is False


def test_the_voltage_reference_has_two_ramps(bench: Bench) -> None:
    bench.write("CHANNEL_SEL_1", 8)
    bench.write("V REF NEGATIVE RAMP", -8.0)
    assert bench.frames("000#0101") == []
    for word in ("0600", "0700", "0F00"):
        bench.frames(f"401#{word}00004041")  # RPDO3: control word and 12.0 V
        bench.frames("080#")
    assert bench.read("V REF SETPOINT") == 12.0
    bench.now = 1.0
    assert bench.read("MONITOR VAR 1") == 4.0  # 4 V/s
    bench.now = 4.0
    assert bench.read("MONITOR VAR 1") == 12.0
    bench.write("CONTROL WORD", 7)
    bench.now = 5.0
    assert bench.read("MONITOR VAR 1") == 4.0  # 8 V/s down


# Supply, limits, units


def test_without_high_voltage_it_cannot_be_switched_on(bench: Bench) -> None:
    drive(bench).supply(0.0, 0.0)
    enable(bench)
    assert (state(bench), bench.read("VBUS MEAN")) == (State.READY_TO_SWITCH_ON, 0)
    assert not int(bench.read("STATUS WORD")) & 0x10
    drive(bench).supply(48.0, 1.0)
    bench.now = 1.0
    enable(bench)
    assert state(bench) is State.OPERATION_ENABLED
    drive(bench).supply(0.0, 2.0)
    bench.now = 5.0
    assert (state(bench), bench.read("ERROR CODE 1")) == (State.FAULT, 0x3220)
    bench.write("RESET ERROR", True)
    assert state(bench) is State.FAULT
    drive(bench).supply(48.0, 6.0)
    bench.now = 6.0
    bench.write("RESET ERROR", True)
    assert state(bench) is State.SWITCH_ON_DISABLED


def test_a_supply_above_v_bus_max_is_a_fault(bench: Bench) -> None:
    drive(bench).supply(61.0, 0.0)
    assert (state(bench), bench.read("ERROR CODE 1")) == (State.FAULT, 0x3210)
    drive(bench).supply(59.0, 1.0)
    bench.now = 1.0
    bench.write("RESET ERROR", True)
    assert state(bench) is State.SWITCH_ON_DISABLED
    bench.write("V BUS MAX", 50.0)
    assert state(bench) is State.FAULT


def test_soft_limits_limit_the_target(bench: Bench) -> None:
    bench.write("SOFT MIN POSITION LIMIT", -500)
    bench.write("SOFT MAX POSITION LIMIT", 800)
    enable(bench, mode=1)
    for target, reached, limited in ((1000, 800, True), (-1000, -500, True), (700, 700, False)):
        bench.write("TARGET POSITION", target)
        bench.write("CONTROL WORD", 0x0F)
        bench.write("CONTROL WORD", 0x1F)
        bench.now += SETTLE
        assert bench.read("POSITION ACTUAL VALUE") == reached
        assert bool(int(bench.read("STATUS WORD")) & 0x0800) is limited


def test_polarity_reverses_position_and_velocity(bench: Bench) -> None:
    bench.write("POLARITY", 0xC0)
    enable(bench)
    bench.write("TARGET VELOCITY", 300)
    bench.now = SETTLE
    assert bench.read("VELOCITY ACTUAL VALUE") == 300
    assert drive(bench).axis.trajectory.velocity(bench.now) < 0
    assert int(bench.read("POSITION ACTUAL VALUE")) > 0
    assert int(bench.read("STATUS WORD")) & 0x0400


def test_the_velocity_factor_is_the_unit(bench: Bench) -> None:
    bench.write("VELOCITY FACTOR NUMERATOR", 1)  # revolutions per second
    enable(bench)
    bench.write("TARGET VELOCITY", 10)
    bench.now = SETTLE
    assert bench.read("VELOCITY ACTUAL VALUE") == 10
    assert drive(bench).axis.trajectory.velocity(bench.now) == pytest.approx(10 * 8192)


def test_the_torque_limit_limits_the_torque(bench: Bench) -> None:
    bench.write("TORQUE LIMIT", 0.46)  # Nm; 2.3 Nm is rated
    enable(bench, mode=4)
    bench.write("TARGET TORQUE", 500)
    bench.now = SETTLE
    assert bench.read("TORQUE ACTUAL VALUE") == 500
    bench.write("TORQUE LIMIT ON", True)
    bench.now += SETTLE
    assert bench.read("TORQUE ACTUAL VALUE") == 200
    assert bench.read("TORQUE ACTUAL VALUE NM") == pytest.approx(0.46)


def test_a_target_velocity_above_max_motor_speed_sets_internal_limit(bench: Bench) -> None:
    bench.write("MAX MOTOR SPEED", 600)
    enable(bench)
    bench.write("TARGET VELOCITY", -900)
    bench.now += SETTLE
    assert bench.read("VELOCITY ACTUAL VALUE") == -600
    assert int(bench.read("STATUS WORD")) & 0x0C00 == 0x0C00  # internal limit active, target reached
    bench.write("TARGET VELOCITY", -600)
    bench.now += SETTLE
    assert int(bench.read("STATUS WORD")) & 0x0C00 == 0x0400
