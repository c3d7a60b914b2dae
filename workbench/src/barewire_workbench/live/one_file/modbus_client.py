"""Blocking clients: the requests by the names of the standard, over a port that is opened when it is needed.

    client.read_holding_registers(107, 3)              ->  (555, 0, 100)
    client.ask(ReadHoldingRegisters(107, 3))           ->  ReadHoldingRegistersResponse(registers=(555, 0, 100))

Errors are exceptions: ModbusException if the unit declines, NoAnswer after the time-out (WriteOutcomeUnknown for a
write), PortError if the port fails; all of them are BarewireErrors. After a port has failed, the next request opens it
again. What the client remembers of late answers stays, across connections too: see `Bus`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Self, TypeVar

from barewire.conversation import DEFAULT_TIMEOUT, Conversation
from barewire.errors import BarewireError, PortError
from barewire.io.ports.base import Port
from barewire.modbus.client.bus import Bus, Recovery
from barewire.modbus.client.line_state import UnitOptions
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.framing import Line
from barewire.modbus.messages.base import Request, Response
from barewire.modbus.messages.coils import ReadCoils, ReadDiscreteInputs, WriteMultipleCoils, WriteSingleCoil
from barewire.modbus.messages.registers import (
    ReadHoldingRegisters,
    ReadInputRegisters,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from barewire_workbench.live.one_file.carry_out import carry_out

R = TypeVar("R", bound="Response")
Result = TypeVar("Result")


class ModbusClient:
    """What all clients have in common. Several threads may use one; there is one exchange at a time.

    open_port      opens the port
    new_line       makes the framing state of a new connection
    unit           the unit that the methods ask (default 1)
    timeout        seconds that a request waits for its response (default 1)
    retries        how often a read without a response is repeated (default 0); writes are not
    gap            seconds of pause between two exchanges with a unit (default 0)
    recovery       how a late answer is excluded, "probe" (default) or "wait", see `Bus`
    late_window    seconds in which a late answer may come (default: three times the time-out)

    `bus.counters` has the numbers of requests, answers, late answers and noise.
    """

    def __init__(
        self,
        open_port: Callable[[], Port[bytes]],
        new_line: Callable[[], Line],
        *,
        unit: int = 1,
        timeout: float = DEFAULT_TIMEOUT,
        retries: int = 0,
        gap: float = 0.0,
        recovery: Recovery = "probe",
        late_window: float | None = None,
    ) -> None:
        self.unit = unit
        self.timeout = timeout
        self._open_port = open_port
        self._new_line = new_line
        self._port: Port[bytes] | None = None
        self._lock = threading.RLock()
        options = UnitOptions(timeout=timeout, gap=gap)
        self.bus = Bus(new_line(), recovery=recovery, late_window=late_window, retries=retries, options=options)

    def __enter__(self) -> Self:
        """Open the port now, and not with the first request."""
        with self._lock:
            self._opened()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the port. The next request opens it again."""
        with self._lock:
            if self._port is not None:
                self._port.close()
                self._port = None

    def _opened(self) -> Port[bytes]:
        """Return the port, opened if there is none or if it has failed. What it received meanwhile goes to the bus."""
        if self._port is not None:
            try:
                data = self._port.receive(0.0)
                if data is not None:
                    self.bus.overhear(data, time.monotonic())
            except PortError:
                self.close()
            if self.bus.line.broken is not None:
                self.close()
        if self._port is None:
            port = self._open_port()
            line = self._new_line()
            line.sent(time.monotonic())  # a client waits for a silence of the line before its first request
            self.bus.continue_on(line)
            self._port = port
        return self._port

    def _run(self, conversation: Conversation[bytes, Result]) -> Result:
        with self._lock:
            try:
                return carry_out(conversation, self._opened())
            except BaseException as error:
                has_failed = isinstance(error, PortError) or isinstance(error.__cause__, PortError)
                # After Ctrl-C, bytes may be lost between the port and the line.
                if has_failed or self.bus.line.broken is not None or not isinstance(error, BarewireError):
                    self.close()
                raise

    def ask(self, request: Request[R], *, unit: int | None = None, timeout: float | None = None) -> R:
        """Send any request message and return its response message."""
        address = self.unit if unit is None else unit
        limit = self.timeout if timeout is None else timeout
        try:
            return self._run(self.bus.ask(address, request, timeout=limit))
        except ModbusException as error:
            error.add_place(address, getattr(request, "address", None))
            raise

    def broadcast(self, request: Request[Any], *, turnaround: float = 0.1) -> None:
        """Send a write to all units of a serial line, which do not answer; then wait until they have acted."""
        self._run(self.bus.broadcast(request, turnaround=turnaround))

    def read_coils(self, address: int, quantity: int) -> tuple[bool, ...]:
        """Read 1 to 2000 coils (function 01)."""
        return tuple(map(bool, self.ask(ReadCoils(address, quantity)).bits))

    def read_discrete_inputs(self, address: int, quantity: int) -> tuple[bool, ...]:
        """Read 1 to 2000 discrete inputs (function 02)."""
        return tuple(map(bool, self.ask(ReadDiscreteInputs(address, quantity)).bits))

    def read_holding_registers(self, address: int, quantity: int) -> tuple[int, ...]:
        """Read 1 to 125 holding registers (function 03)."""
        return self.ask(ReadHoldingRegisters(address, quantity)).registers

    def read_input_registers(self, address: int, quantity: int) -> tuple[int, ...]:
        """Read 1 to 125 input registers (function 04)."""
        return self.ask(ReadInputRegisters(address, quantity)).registers

    def write_single_coil(self, address: int, value: bool) -> None:
        """Write one coil (function 05)."""
        self.ask(WriteSingleCoil(address, value))

    def write_single_register(self, address: int, value: int) -> None:
        """Write one holding register, 0..65535 (function 06)."""
        self.ask(WriteSingleRegister(address, value))

    def write_multiple_coils(self, address: int, bits: Sequence[bool]) -> None:
        """Write 1 to 1968 coils (function 0F)."""
        self.ask(WriteMultipleCoils(address, bits))

    def write_multiple_registers(self, address: int, registers: Sequence[int]) -> None:
        """Write 1 to 123 holding registers (function 10h)."""
        self.ask(WriteMultipleRegisters(address, registers))
