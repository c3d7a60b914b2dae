"""The CSD MT S4: two inputs with the meanings of table 21, three outputs, Safe Torque Off."""

from __future__ import annotations

import pytest

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
