"""The faulty line of lab 10: recordings of it, and a server on it.

A master asks a soft starter for three values, again and again. What is wrong is made by the fault injection of the
simulators, with a seed, so a recording is the same whenever it is written.

    line-1.log  line-2.log  line-3.log     bytes with times, as `sniff` and `explain` read them
    the live line                          another unit, answers that are late or lost
"""

from __future__ import annotations

from random import Random
from typing import NamedTuple

from barewire.io.fault_injection.faults import Faults, ModbusWire
from barewire.modbus import ReadInputRegisters
from barewire.rtu import encode
from barewire.rtu.timing import Timing
from barewire_workbench.cli.teach.labs.played import rtu_answer
from barewire_workbench.wire import CharacterFormat, ReceiverFault, UartLine

POLLED_ADDRESSES = (4017, 5, 7)
"""The registers that the master reads: a temperature, a voltage, a current; each value has two."""

_EXCHANGES = 12
_PERIOD = 0.25
_TURNAROUND = 0.012
_TIMING = Timing.of(19200)


class Recording(NamedTuple):
    """A recording of the line: the fault in it, as `--fault` of `simulate` has it, or a wrong baud rate."""

    name: str
    fault: str
    seed: int = 0
    rate: int = 19200
    """The baud rate of the line. The recorder was set to 19200."""


RECORDINGS = (
    Recording("line-1.log", "flip:0.4", seed=3),
    Recording("line-2.log", "late=0.26@every=3"),
    Recording("line-3.log", "", rate=9600),
)

LIVE_UNIT = 17
LIVE_FAULTS = "late=1.4@every=2,drop@every=3"
LIVE_SEED = 10


def recording_text(recording: Recording) -> str:
    """Return a recording as text, a line for each piece of bytes with its time.

    >>> print("\\n".join(recording_text(RECORDINGS[0]).splitlines()[1:3]))
    0.000000 01 04 0F B1 00 02 22 F8
    0.016583 01 04 04 00 00 00 F5 3B C3
    """
    faults = Faults(ModbusWire("rtu"), recording.fault, Random(recording.seed)) if recording.fault else None
    heard = UartLine(CharacterFormat(8, "E", 1), ReceiverFault(faster=19200 // recording.rate))
    pieces: list[tuple[float, bytes]] = []
    for number in range(_EXCHANGES):
        at = number * _PERIOD
        request = encode(1, ReadInputRegisters(POLLED_ADDRESSES[number % len(POLLED_ADDRESSES)], 2).encode())
        answer, answered_at = rtu_answer(request), at + _TIMING.duration(len(request)) + _TURNAROUND
        pieces.append((at, request))
        pieces += [(answered_at, answer)] if faults is None else faults.pass_on(answer, answered_at, request[1:-2])
    lines = [f"{at:.6f} {heard.read(data).hex(' ').upper()}" for at, data in sorted(pieces)]
    return "\n".join([f"# {recording.name}: seconds and bytes, recorded at 19200 8E1", *lines]) + "\n"
