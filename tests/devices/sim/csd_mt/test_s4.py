"""The CSD MT S4: two inputs with the meanings of table 21, three outputs, Safe Torque Off; the environment as text."""

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
def test_the_two_inputs_have_the_meanings_of_table_21(bench: CsdBench, config: int, first: str, second: str) -> None:
    bench.drive.environment.inputs = [True, True, True, True, True]
    bench.put(Input_Config=config, Touch_Probe_Function=0x11)
    bits = {"negative limit": 1, "positive limit": 2, "proximity": 4}
    word = bits.get(first, 0) | bits.get(second, 0)
    assert bench.read("Digital Input") == 0b11 << 16 | word
    assert bool(int(bench.read("Touch Probe Status")) & 0x80) is (second == "touch probe")
    bench.drive.environment.inputs = [False, False, False, False, False]
    limited = "limit" in first + second
    assert bench.status() == ("0A70" if limited else "0270")


def test_an_s4_has_three_outputs(bench: CsdBench) -> None:
    bench.put(Output_Config=0x1F, Set_Output=0b11111)
    assert bench.read("Digital Output") == 0b111 << 16


def test_safe_torque_off_takes_the_current_without_an_error(bench: CsdBench) -> None:
    bench.put(Input_Config=0x8F, Target_Position=100_000)
    bench.enable()
    bench.now = 1.0
    bench.control(0x1F)
    bench.status(2.0)
    bench.drive.environment.sto = (False, True)  # one input without voltage is enough
    assert bench.status(2.5) == "0270"
    assert bench.read("Digital Input") == 1 << 24
    assert not bench.drive.shaft.has_current
    bench.control(0x06, 0x0F)
    assert bench.status(4.0) == "0233"  # no current is allowed
    bench.drive.environment.sto = (False, False)
    bench.drive.environment.sto = (True, True)
    bench.control(0x07, 0x0F)
    assert bench.status(5.0) == "0637"
    assert bench.read("Digital Input") == 0


def test_only_the_s4_has_safe_torque_off() -> None:
    bench = CsdBench()
    bench.drive.environment.sto = (False, False)
    bench.enable()
    assert bench.drive.shaft.has_current


def test_the_environment_is_set_by_text() -> None:
    environment = Environment()
    for text in ("I1=-5000:", "i2=:9000", "I4=ON", "walls = -100:100", "encoder=4000", "friction=5", "index=1.5"):
        environment.put(text)
    assert environment.inputs[1:] == [Span(-5000.0, inf), Span(-inf, 9000.0), False, True]
    assert (environment.walls, environment.encoder, environment.friction, environment.index) == (
        Span(-100.0, 100.0),
        4000,
        5.0,
        1.5,
    )


@pytest.mark.parametrize(
    ("text", "message"),
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
def test_an_environment_setting_with_an_error_is_refused(text: str, message: str) -> None:
    with pytest.raises(EncodeError, match=message):
        Environment().put(text)


def test_the_environment_can_switch_the_power_section_off() -> None:
    bench = CsdBench()
    bench.drive.environment.put("volts=0")
    assert bench.control(0x06, 0x07) == "0221"
