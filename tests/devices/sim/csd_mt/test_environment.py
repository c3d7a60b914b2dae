"""The environment of the stepper drive: set by text; and random ones, in which reading the drive changes nothing."""

from __future__ import annotations

from math import inf

import pytest
from hypothesis import given, settings, strategies as st

from barewire.devices.sim.csd_mt.environment import Environment, Span
from barewire.errors import EncodeError
from barewire.modbus.messages.registers import WriteMultipleRegisters, WriteSingleRegister
from tests.devices.sim.csd_mt.csd_mt_bench import CsdBench


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


# Random environments with random writes

PLACES = st.sampled_from([-inf, -40_000.0, -3.0, 0.0, 8.0, 500.0, 12_800.0, 30_000.0, inf])
WALLS = st.builds(Span, st.sampled_from([-inf, -40_000.0, -3.0]), st.sampled_from([inf, 30_000.0, 8.0]))
WIRES = st.booleans() | st.builds(Span, PLACES, PLACES)
CONTROLS = [0x00, 0x02, 0x06, 0x07, 0x0F, 0x1F, 0x2F, 0x3F, 0x5F, 0x80, 0x10F]
WORDS = st.one_of(
    st.tuples(st.just(1040), st.sampled_from(CONTROLS)),
    st.tuples(st.just(1041), st.sampled_from([1, 3, 6])),
    st.tuples(st.just(1050), st.sampled_from([3, 4, 5, 6, 19, 20, 21, 22, 35, 0xFFFE, 0xFFFF])),
    st.tuples(st.just(1066), st.sampled_from([0, 0x11, 0x15, 0x21, 0x25])),
    st.tuples(st.just(1067), st.sampled_from([0, 1, 2, 0x31, 7])),
    st.tuples(st.just(1085), st.sampled_from([0, 1, 2, 17])),
    st.tuples(st.just(1086), st.sampled_from([0, 1, 2])),
    st.tuples(st.just(1088), st.integers(0, 31)),
    st.tuples(st.just(1089), st.sampled_from([0x1B, 0x27])),
    st.tuples(st.sampled_from([1092, 1108, 1114]), st.integers(0, 1)),
    st.tuples(st.just(1097), st.sampled_from([0, 0, 0, 5000])),
)
PAIRS = st.one_of(
    st.tuples(st.just(1042), st.sampled_from([0, 5, 30_000, 200_000, 0xFFFF_0000])),
    st.tuples(st.just(1044), st.sampled_from([0, 3000, 24_000, 300_000])),
    st.tuples(st.just(1048), st.sampled_from([0, 3000, 100_000, 0xFFFF_0000])),
    st.tuples(st.just(1054), st.sampled_from([0, 1600])),
)
SLIPS = st.tuples(st.just(0), st.sampled_from([-5000, -100, 70, 300]))
STEPS = st.lists(st.tuples(WORDS | PAIRS | SLIPS, st.sampled_from([0.0, 0.01, 0.3, 2.0, 1000.0])), max_size=15)


def enabled(inputs: list[Span | bool], walls: Span, pull_out: float, encoder: int) -> CsdBench:
    bench = CsdBench()
    environment = bench.drive.environment
    environment.inputs, environment.walls = list(inputs), walls
    environment.pull_out, environment.encoder = pull_out, encoder
    bench.write("Homing Speed During Search for Zero", 3200)
    bench.enable()
    return bench


def carry_out(bench: CsdBench, steps: list[tuple[tuple[int, int], float]], ticks: int) -> list[object]:
    """Return the observable registers after every step, with `ticks` more ticks in every pause."""
    seen: list[object] = []
    for (address, value), pause in steps:
        if address == 0:
            bench.drive.slip(value, bench.now)
        elif address in (1042, 1044, 1048, 1054):
            bench.refused(WriteMultipleRegisters(address, (value & 0xFFFF, value >> 16)))
        else:
            bench.refused(WriteSingleRegister(address, value))
        began = bench.now
        for tick in range(ticks):
            bench.drive.tick(began + pause * tick / ticks)
        bench.now = began + pause
        bench.drive.tick(bench.now)
        seen.append((bench.words(1001)[0], bench.words(1007), bench.words(1014, 4), bench.words(1008, 2)))
        seen.append(round(bench.drive.shaft.position(bench.now) / 4))
    return seen


@settings(max_examples=40)
@given(
    st.lists(WIRES, min_size=5, max_size=5),
    WALLS,
    st.sampled_from([inf, inf, 20_000.0]),
    st.sampled_from([400, 400, 4000, 0]),
    STEPS,
)
def test_reading_often_changes_nothing(
    inputs: list[Span | bool],
    walls: Span,
    pull_out: float,
    encoder: int,
    steps: list[tuple[tuple[int, int], float]],
) -> None:
    rare = carry_out(enabled(inputs, walls, pull_out, encoder), steps, 0)
    often = carry_out(enabled(inputs, walls, pull_out, encoder), steps, 3)
    assert rare == often
