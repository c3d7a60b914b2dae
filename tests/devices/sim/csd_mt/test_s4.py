"""The CSD MT S4: two inputs with the meanings of table 21, three outputs, Safe Torque Off; lamps; the world as text."""

from __future__ import annotations

from math import inf

import pytest

from barewire.devices.sim.csd_mt.environment import Environment, Span
from barewire.errors import EncodeError
from tests.devices.sim.csd_mt.csd_mt_bench import CsdBench


@pytest.fixture
def bench() -> CsdBench:
    bench = CsdBench()
    bench.drive.environment.model = "S4"
    return bench


@pytest.mark.parametrize(
    ("config", "first", "second"),
    [
        (0x05, "negative limit", "touch probe"),
        (0x06, "proximity", "touch probe"),
        (0x07, "", "touch probe"),
        (0x09, "negative limit", "positive limit"),
        (0x0A, "proximity", "positive limit"),
        (0x0B, "", "positive limit"),
        (0x0D, "negative limit", ""),
        (0x0E, "proximity", ""),
        (0x0F, "", ""),
    ],
)
def test_table_21(bench: CsdBench, config: int, first: str, second: str) -> None:
    bench.drive.environment.inputs = [True, True, True, True, True]
    bench.put(Input_Config=config, Touch_Probe_Function=0x11)
    bits = {"negative limit": 1, "positive limit": 2, "proximity": 4}
    word = bits.get(first, 0) | bits.get(second, 0)
    assert bench.read("Digital Input") == 0b11 << 16 | word
    assert bool(int(bench.read("Touch Probe Status")) & 0x80) is (second == "touch probe")
    bench.drive.environment.inputs = [False, False, False, False, False]
    limited = "limit" in first + second
    assert bench.status() == ("0A70" if limited else "0270")


def test_outputs(bench: CsdBench) -> None:
    bench.put(Output_Config=0x1F, Set_Output=0b11111)
    assert bench.read("Digital Output") == 0b111 << 16


def test_safe_torque_off(bench: CsdBench) -> None:
    bench.put(Input_Config=0x8F, Target_Position=100_000)
    bench.enable()
    bench.now = 1.0
    bench.control(0x1F)
    bench.status(2.0)
    bench.drive.environment.sto = (False, True)  # one is enough, the other lamp stays dark
    assert not bench.drive.edm
    assert bench.status(2.5) == "0270"
    assert bench.read("Digital Input") == 1 << 24
    assert not bench.drive.shaft.has_current
    bench.control(0x06, 0x0F)
    assert bench.status(4.0) == "0233"  # no current is allowed
    bench.drive.environment.sto = (False, False)
    assert bench.drive.edm
    bench.drive.environment.sto = (True, True)
    bench.control(0x07, 0x0F)
    assert bench.status(5.0) == "0637"
    assert bench.read("Digital Input") == 0


def test_safe_torque_off_is_for_the_s4() -> None:
    bench = CsdBench()
    bench.drive.environment.sto = (False, False)
    bench.enable()
    assert not bench.drive.edm


def test_lamps() -> None:
    bench = CsdBench()
    bench.enable()
    assert bench.drive.service.lamps == {"HV"}
    bench.drive.supply(False, 1.0)
    assert bench.drive.service.lamps == {"FAU"}
    bench.drive.supply(True, 2.0)
    bench.control(0x80)
    bench.drive.environment.ambient = 150.0
    bench.status(1000.0)
    assert bench.drive.service.lamps == {"HV", "FAU", "TER"}
    bench.drive.environment.ambient = 20.0
    bench.status(5000.0)
    bench.control(0, 0x80)
    assert bench.drive.service.lamps == {"HV"}
    bench.drive.fault(0x8611, 5001.0)
    assert bench.drive.service.lamps == {"HV"}  # as ch. 14 prints it


def test_the_world_as_text() -> None:
    world = Environment()
    for text in ("I1=-5000:", "i2=:9000", "I4=ON", "walls = -100:100", "encoder=4000", "friction=5", "index=1.5"):
        world.put(text)
    assert world.inputs[1:] == [Span(-5000.0, inf), Span(-inf, 9000.0), False, True]
    assert (world.walls, world.encoder, world.friction, world.index) == (Span(-100.0, 100.0), 4000, 5.0, 1.5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("I5=on", "expected NAME=VALUE with a name of I0 to I4, walls, model, pull-out"),
        ("walls", "expected LOW:HIGH behind =, found ''"),
        ("I0=maybe", "expected on, off, or LOW:HIGH for a switch, found 'maybe'"),
        ("I0=5:1", "expected LOW below HIGH"),
        ("I0=a:1", "expected a number behind =, found 'a'"),
        ("volts=nan", "expected a number"),
        ("encoder=inf", "expected a whole number"),
        ("model=95", "expected one of 94, S4"),
    ],
)
def test_a_world_that_cannot_be_read(text: str, said: str) -> None:
    with pytest.raises(EncodeError, match=said):
        Environment().put(text)


def test_no_high_voltage_by_the_world() -> None:
    bench = CsdBench()
    bench.drive.environment.put("volts=0")
    assert bench.control(0x06, 0x07) == "0221"
