"""The environment of the stepper drive, set by text."""

from __future__ import annotations

from math import inf

import pytest

from barewire.devices.sim.csd_mt.environment import Environment, Span
from barewire.errors import EncodeError
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
