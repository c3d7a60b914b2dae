"""Simulated machines in virtual time, read and written by parameter names through real messages and frames."""

from __future__ import annotations

from barewire.canopen import CanFrame
from barewire.codecs import Value
from barewire.devices.cia402 import State, state_of
from barewire.devices.parameter import ModbusAt, Parameter
from barewire.devices.sim import Az3, CsdMt, Simulator, simulator
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.messages import coils as bits, registers
from barewire.modbus.messages.base import Response
from barewire.modbus.messages.registers import WriteSingleRegister


class Bench:
    """One machine and its time."""

    def __init__(self, machine: Simulator, now: float = 0.0) -> None:
        self.machine = machine
        self.now = now

    def parameter(self, name: str) -> Parameter:
        return self.machine.device.find(name)

    # Modbus

    def ask(self, request: object) -> Response | None:
        assert self.machine.modbus is not None
        return self.machine.modbus.handle(request, self.now)

    def refused(self, request: object) -> int:
        """Return the exception code of the answer, 0 for a normal response."""
        try:
            self.ask(request)
        except ModbusException as declined:
            return declined.code
        return 0

    def words(self, address: int, quantity: int = 1, table: str = "holding") -> tuple[int, ...]:
        settings = self.machine.device.modbus
        assert settings is not None
        code = settings.read_functions["input" if table == "input" else "holding"]
        request = {3: registers.ReadHoldingRegisters, 4: registers.ReadInputRegisters}[code]
        answer = self.ask(request(address, quantity))
        assert isinstance(answer, registers.ReadHoldingRegistersResponse)
        return answer.registers

    def place(self, name: str) -> ModbusAt:
        place = self.parameter(name).modbus
        assert place is not None
        return place

    def read(self, name: str) -> Value:
        parameter, place = self.parameter(name), self.place(name)
        if place.table == "coil":
            answer = self.ask(bits.ReadCoils(place.address, 1))
            assert isinstance(answer, bits.ReadCoilsResponse)
            return answer.bits[0]
        return parameter.from_registers(self.words(place.address, place.words, place.table))

    def writes(self, name: str, value: Value) -> object:
        """Return the request that writes a parameter."""
        parameter, place = self.parameter(name), self.place(name)
        if place.table == "coil":
            return bits.WriteSingleCoil(place.address, bool(value))
        old = self.words(place.address, 1, place.table) if place.partial else ()
        words = parameter.to_registers(value, old)
        if len(words) == 1:
            return registers.WriteSingleRegister(place.address, words[0])
        return registers.WriteMultipleRegisters(place.address, words)

    def write(self, name: str, value: Value) -> None:
        self.ask(self.writes(name, value))

    # CANopen

    def frames(self, text: str | None = None) -> list[str]:
        """Return the frames that the node sends after a frame, or after time has passed, as text."""
        assert self.machine.canopen is not None
        frame = None if text is None else CanFrame.parse(text)
        return [str(sent) for sent in self.machine.canopen.feed(frame, self.now)]

    def _sdo(self, command: int, index: int, sub: int, data: bytes = b"", node: int = 1) -> bytes | int:
        """Do an expedited transfer, composed byte by byte; return the bytes of the answer, or the abort code."""
        assert self.machine.canopen is not None
        request = bytes([command]) + index.to_bytes(2, "little") + bytes([sub]) + data.ljust(4, b"\0")
        sent = self.machine.canopen.feed(CanFrame(0x600 + node, request), self.now)
        (answer,) = [frame.data for frame in sent if frame.id == 0x580 + node]
        if answer[0] == 0x80:
            return int.from_bytes(answer[4:], "little")
        return answer[4 : 8 - (answer[0] >> 2 & 3)]

    def upload(self, index: int, sub: int = 0) -> bytes | int:
        """Return the bytes of an object, or the abort code."""
        return self._sdo(0x40, index, sub)

    def upload_at(self, node: int, index: int, sub: int = 0) -> bytes | int:
        """Return the same from a node with another node-ID."""
        return self._sdo(0x40, index, sub, node=node)

    def download(self, index: int, sub: int, data: bytes) -> int:
        """Write an object; return 0, or the abort code."""
        answer = self._sdo(0x23 | (4 - len(data)) << 2, index, sub, data)
        return answer if isinstance(answer, int) else 0


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
