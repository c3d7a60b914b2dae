"""Clients of peer libraries on the same line as `one_line`, in the same virtual time.

The libraries are not changed: they get a serial port, or a queue of received frames, whose time is the checker's, and
the `time` module that they import is replaced by one that reads this time. Each asks for the same register again and
again; a value is wrong if it is the number of another question.

    minimalmodbus    its Instrument, over a serial port
    pymodbus         its blocking serial client, over a serial port
    modbus-tk        its RtuMaster, over a serial port
    uModbus          its function for RTU, over a serial port
    tmodbus          its asyncio client for RTU, in an event loop whose time is the checker's
    libmodbus        its client for RTU; an adapter in C takes the place of the serial port (`libmodbus_adapter.c`)

Libraries that need sockets or threads of their own cannot be driven like this.
"""

from __future__ import annotations

import asyncio
import ctypes
import logging
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import cache, partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, TypeAlias
from unittest.mock import patch

from tests.model.choices import Choices
from tests.model.one_line import Tally
from tests.model.units import Setup, UnitsOnLine
from tests.model.virtual_loop import VirtualLoop, VirtualSelector

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


class VirtualTransport(asyncio.WriteTransport):
    """The transport of a serial port, on the line of the checker."""

    def __init__(self, line: UnitsOnLine) -> None:
        super().__init__()
        self._line = line

    def write(self, data: Any) -> None:
        """Send a request."""
        self._line.transmit(bytes(data))

    def is_closing(self) -> bool:
        """Return False: it is open."""
        return False


def tmodbus(line: UnitsOnLine, timeout: float, patches: ExitStack) -> Ask:
    """The asyncio client of tmodbus, with its transport for RTU."""
    rtu = import_module("tmodbus.transport.async_rtu")
    patches.enter_context(patch.object(rtu, "time", VirtualTime(line)))
    selector = VirtualSelector(line)
    loop = VirtualLoop(selector)
    patches.callback(loop.close)
    transport = rtu.AsyncRtuTransport("virtual", timeout=timeout, baudrate=19200)
    transport._transport = VirtualTransport(line)
    transport._protocol = rtu.ModbusRtuProtocol(
        on_connection_lost=transport._on_connection_lost, timeout=timeout, interframe_delay=transport._interframe_delay
    )
    transport._protocol.connection_made(transport._transport)
    selector.received = lambda data: loop.call_soon(transport._protocol.data_received, data)
    client = import_module("tmodbus.client").AsyncModbusClient(transport, unit_id=1)

    async def read() -> int:
        return int((await client.read_holding_registers(7, 1))[0])

    return lambda: loop.run_until_complete(read())


_ON_TRANSMIT = ctypes.CFUNCTYPE(None, ctypes.POINTER(ctypes.c_uint8), ctypes.c_int)
_ON_WAIT = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double)
_ON_RECEIVE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_uint8), ctypes.c_int)


@cache
def libmodbus_adapter() -> ctypes.CDLL | None:
    """Compile and load the adapter; None without libmodbus or a C compiler."""
    source = Path(__file__).with_name("libmodbus_adapter.c")
    with TemporaryDirectory() as folder:
        library = Path(folder) / "adapter.so"
        command = ["cc", "-shared", "-fPIC", "-O1", "-o", str(library), str(source), "-lmodbus"]
        try:
            subprocess.run(command, check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError):
            return None
        return ctypes.CDLL(str(library), mode=os.RTLD_LOCAL | os.RTLD_DEEPBIND)


def libmodbus(line: UnitsOnLine, timeout: float, patches: ExitStack) -> Ask:
    """The client of libmodbus for RTU."""
    adapter = libmodbus_adapter()
    assert adapter is not None
    serial = VirtualSerial(line, timeout)

    def wait(seconds: float) -> int:
        if not serial.in_waiting:
            until = line.now + seconds
            line.now = max(line.now, min(until, line.coming[0].at)) if line.coming else until
        return int(serial.in_waiting > 0)

    def receive(target: Any, count: int) -> int:
        data = serial.read(min(count, serial.in_waiting))
        ctypes.memmove(target, data, len(data))
        return len(data)

    on_transmit = _ON_TRANSMIT(lambda data, count: line.transmit(ctypes.string_at(data, count)))
    functions = on_transmit, _ON_WAIT(wait), _ON_RECEIVE(receive)
    assert adapter.adapter_open(*functions, round(timeout * 1_000_000))

    def ask(alive: object = functions) -> int | None:  # the functions must live as long as the adapter calls them
        value = int(adapter.adapter_ask())
        return None if value < 0 else value

    return ask


def libmodbus_version() -> str | None:
    """Return the version of the installed libmodbus."""
    adapter = libmodbus_adapter()
    return None if adapter is None else ".".join(map(str, adapter.adapter_version().to_bytes(3, "big")))


def package_version(distribution: str) -> str | None:
    """Return the version of an installed package, None if it is not installed."""
    try:
        return version(distribution)
    except ModuleNotFoundError:
        return None


class Peer(NamedTuple):
    """A library: how it is driven, its version (None if it is not installed), and what it needs."""

    connect: Callable[[UnitsOnLine, float, ExitStack], Ask]
    version: Callable[[], str | None]
    needs: str


PEERS = {
    "minimalmodbus": Peer(minimalmodbus, partial(package_version, "minimalmodbus"), "pip install minimalmodbus"),
    "pymodbus": Peer(pymodbus, partial(package_version, "pymodbus"), "pip install pymodbus"),
    "modbus-tk": Peer(modbus_tk, partial(package_version, "modbus_tk"), "pip install modbus-tk"),
    "uModbus": Peer(umodbus, partial(package_version, "uModbus"), "pip install uModbus"),
    "tmodbus": Peer(tmodbus, partial(package_version, "tmodbus"), "pip install tmodbus, with Python 3.12 or later"),
    "libmodbus": Peer(libmodbus, libmodbus_version, "the Debian package libmodbus-dev and a C compiler"),
}


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
                if value is None:
                    tally.no_answer += 1
                elif value == number:
                    tally.right += 1
                else:
                    tally.wrong.append(f"question {number} of {choices.script}: {value}")

    return play


if __name__ == "__main__":
    from tests.model.choices import run_random
    from tests.model.setups import FEW_FAULTS

    for name, peer in PEERS.items():
        if peer.version() is None:
            print(f"{name} is not installed: {peer.needs}")
            continue
        tally = Tally()
        run_random(peer_scenario(peer.connect, FEW_FAULTS, tally), int(sys.argv[1]) // FEW_FAULTS.length)
        print(name, peer.version(), tally.questions, tally.right, tally.no_answer, len(tally.wrong))
