"""Helpers of the servo drive's tests."""

from __future__ import annotations

from barewire.devices.cia402 import State, state_of
from barewire.devices.sim import Az3, simulator
from tests.devices.sim.bench import Bench


def az3_bench() -> Bench:
    """Return a drive that was just switched on and sent its boot-up message."""
    bench = Bench(simulator("az3"))
    assert bench.frames() == ["701#00"]
    return bench


def drive(bench: Bench) -> Az3:
    assert isinstance(bench.machine, Az3)
    return bench.machine


def enable(bench: Bench, mode: int | None = 3) -> None:
    """Enable the operation, in `mode` or, if it is None, in the mode that is set."""
    if mode is not None:
        bench.write("MODES OF OPERATION", mode)
    for word in (0x06, 0x07, 0x0F):
        bench.write("CONTROL WORD", word)


def state(bench: Bench) -> State:
    return state_of(int(bench.read("STATUS WORD")))
