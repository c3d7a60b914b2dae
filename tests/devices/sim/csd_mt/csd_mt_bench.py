"""A bench for the CSD MT: status words as text, the enable sequence, registers by name."""

from __future__ import annotations

from barewire.codecs import Value
from barewire.devices.sim import CsdMt, simulator
from barewire.modbus.messages.registers import WriteSingleRegister
from tests.devices.sim.bench import Bench

STATUS, CONTROL = 1001, 1040
POSITION, VELOCITY, HOMING = 1, 3, 6


class CsdBench(Bench):
    """One CSD MT and its time."""

    def __init__(self, now: float = 0.0) -> None:
        super().__init__(simulator("csd-mt", now), now)

    @property
    def drive(self) -> CsdMt:
        assert isinstance(self.machine, CsdMt)
        return self.machine

    def status(self, now: float | None = None) -> str:
        """Return the status word as the manual prints it."""
        self.now = self.now if now is None else now
        return f"{self.words(STATUS)[0]:04X}"

    def control(self, *words: int) -> str:
        """Write control words; returns the status word after the last."""
        for word in words:
            self.ask(WriteSingleRegister(CONTROL, word))
        return self.status()

    def put(self, **values: Value) -> None:
        """Write registers by name, with _ for a space."""
        for name, value in values.items():
            self.write(name.replace("_", " "), value)

    def enable(self, mode: int = POSITION) -> None:
        """Enable the operation, and wait the delay of register 1096."""
        self.write("Mode of Operation", mode)
        self.control(0x06, 0x07, 0x0F)
        self.now += 0.23
        assert self.status()[2:] == "37"

    def position(self, now: float | None = None) -> Value:
        self.now = self.now if now is None else now
        return self.read("Position Actual Value")

    def velocity(self, now: float | None = None) -> Value:
        self.now = self.now if now is None else now
        return self.read("Velocity Actual Value")

    def settle(self) -> float:
        """Let the present movement end; returns when it did."""
        self.drive.tick(self.now)
        ends_at = self.drive.axis.trajectory.ends_at
        self.now = max(self.now, ends_at + 1e-6)
        return ends_at


def moving(bench: CsdBench, target: int = 100_000, **registers: int) -> None:
    """Start a trapezoid of 20000 step/s at 1 s."""
    bench.put(Target_Position=target, Profile_Velocity=20_000, Profile_Acceleration=100_000, **registers)
    bench.enable(POSITION)
    bench.now = 1.0
    bench.control(0x1F)
