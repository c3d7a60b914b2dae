"""Clients of peer libraries on the same line as `one_line`, in the same virtual time.

The libraries are not changed: they get a serial port, or a queue of received frames, whose time is the checker's, and
the `time` module that they import is replaced by one that reads this time. Each asks for the same register again and
again; a value is wrong if it is the number of another question.

    minimalmodbus    its Instrument, over a serial port
    pymodbus         its blocking serial client, over a serial port
    modbus-tk        its RtuMaster, over a serial port
    uModbus          its function for RTU, over a serial port

Libraries that need sockets, threads or an event loop of their own cannot be driven like this.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from contextlib import ExitStack
from importlib import import_module
from importlib.metadata import version
from typing import TypeAlias
from unittest.mock import patch

from tests.model.choices import Choices
from tests.model.one_line import Setup, Tally, UnitsOnLine

Ask: TypeAlias = Callable[[], int | None]
"""Asks for register 7 of unit 1 and returns its value; None or any exception: no answer."""


class VirtualTime:
    """The `time` module of a library, with the time of the line."""

    def __init__(self, line: UnitsOnLine) -> None:
        self._line = line

    def time(self) -> float:
        """Return the time of the line, in seconds."""
        return self._line.now

    monotonic = perf_counter = time

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self._line.now += max(0.0, seconds)


class VirtualSerial:
    """A serial port as pySerial has it, on the line of the checker."""

    port = "virtual"
    name = "virtual"
    baudrate = 19200
    bytesize, stopbits, parity = 8, 1, "N"
    is_open = True

    def __init__(self, line: UnitsOnLine, timeout: float) -> None:
        self._line = line
        self._received = bytearray()
        self.timeout = timeout

    def write(self, data: bytes) -> int:
        """Send a request."""
        self._line.transmit(bytes(data))
        return len(data)

    @property
    def in_waiting(self) -> int:
        """The number of bytes that have arrived."""
        self._take(self._line.now)
        return len(self._received)

    def _take(self, until: float) -> bool:
        coming = self._line.coming
        arrived = bool(coming) and coming[0].at <= until
        while coming and coming[0].at <= self._line.now:
            self._received += coming.pop(0).data
        return arrived

    def read(self, size: int = 1) -> bytes:
        """Return so many bytes, or those that arrive within the time-out."""
        line = self._line
        end = line.now + (self.timeout or 0.0)
        self._take(line.now)
        while len(self._received) < size and line.coming and line.coming[0].at <= end:
            line.now = max(line.now, line.coming[0].at)
            self._take(line.now)
        if len(self._received) < size:
            line.now = max(line.now, end)
        data = bytes(self._received[:size])
        del self._received[:size]
        return data

    def inWaiting(self) -> int:  # the name in older versions of pySerial
        """Return the number of bytes that have arrived."""
        return self.in_waiting

    def reset_input_buffer(self) -> None:
        """Discard the bytes that have arrived."""
        self._take(self._line.now)
        self._received.clear()

    flushInput = reset_input_buffer

    def reset_output_buffer(self) -> None:
        """Do nothing: requests are sent at once."""

    flush = flushOutput = open = close = reset_output_buffer

    def isOpen(self) -> bool:
        """Return True."""
        return True


def minimalmodbus(line: UnitsOnLine, timeout: float, patches: ExitStack) -> Ask:
    """An Instrument of minimalmodbus."""
    module = import_module("minimalmodbus")
    patches.enter_context(patch.object(module, "time", VirtualTime(line)))
    patches.enter_context(patch.dict(module._latest_read_times, clear=True))
    instrument = module.Instrument(VirtualSerial(line, timeout), 1)
    instrument.serial.timeout = timeout
    return lambda: int(instrument.read_register(7))


def pymodbus(line: UnitsOnLine, timeout: float, patches: ExitStack) -> Ask:
    """The blocking serial client of pymodbus."""
    serial = import_module("pymodbus.client.serial")
    transaction = import_module("pymodbus.transaction.transaction")
    time = VirtualTime(line)
    patches.enter_context(patch.object(serial, "time", time))
    patches.enter_context(patch.object(transaction, "monotonic", time.monotonic))
    client = serial.ModbusSerialClient("virtual", timeout=timeout, retries=0)
    client.socket = VirtualSerial(line, timeout)
    return lambda: int(client.read_holding_registers(7, count=1, device_id=1).registers[0])


def modbus_tk(line: UnitsOnLine, timeout: float, patches: ExitStack) -> Ask:
    """The RtuMaster of modbus-tk."""
    rtu = import_module("modbus_tk.modbus_rtu")
    patches.enter_context(patch.object(rtu, "time", VirtualTime(line)))
    master = rtu.RtuMaster(VirtualSerial(line, timeout))
    master.set_timeout(timeout)
    return lambda: int(master.execute(1, 3, 7, 1)[0])


def umodbus(line: UnitsOnLine, timeout: float, patches: ExitStack) -> Ask:
    """The RTU functions of uModbus."""
    rtu = import_module("umodbus.client.serial.rtu")
    port = VirtualSerial(line, timeout)
    return lambda: int(rtu.send_message(rtu.read_holding_registers(1, 7, 1), port)[0])


PEERS: dict[str, tuple[str, Callable[[UnitsOnLine, float, ExitStack], Ask]]] = {
    "minimalmodbus": ("minimalmodbus", minimalmodbus),
    "pymodbus": ("pymodbus", pymodbus),
    "modbus-tk": ("modbus_tk", modbus_tk),
    "uModbus": ("uModbus", umodbus),
}


def peer_version(distribution: str) -> str | None:
    """Return the version of an installed library, None if it is not installed."""
    try:
        return version(distribution)
    except ModuleNotFoundError:
        return None


def peer_scenario(
    connect: Callable[[UnitsOnLine, float, ExitStack], Ask], setup: Setup, tally: Tally
) -> Callable[[Choices], None]:
    """The scenario of `one_line` for the client of a peer: `setup.length` reads."""
    logging.disable(logging.CRITICAL)

    def play(choices: Choices) -> None:
        line = UnitsOnLine(choices, setup)
        line.now = 1000.0  # some libraries compare with a time 0
        with ExitStack() as patches:
            ask = connect(line, setup.timeout, patches)
            for number in range(1, setup.length + 1):
                line.number = number
                line.now += choices.take(setup.pauses)
                tally.questions += 1
                try:
                    value = ask()
                except Exception:
                    tally.no_answer += 1
                    continue
                if value == number:
                    tally.right += 1
                else:
                    tally.wrong.append(f"question {number} of {choices.script}: {value}")

    return play


if __name__ == "__main__":
    from tests.model.choices import run_random

    for name, (distribution, connect) in PEERS.items():
        if peer_version(distribution) is None:
            print(name, "is not installed")
            continue
        tally = Tally()
        setup = Setup(length=12, delays=(0.002, 0.002, 0.35, 0.8), probing=("declines",), recovery=("probe",))
        run_random(peer_scenario(connect, setup, tally), int(sys.argv[1]) // 12)
        print(name, peer_version(distribution), tally.questions, tally.right, tally.no_answer, len(tally.wrong))
