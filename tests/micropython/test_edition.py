"""Editions: what is in them, and that they run.

They are a subset of Python, so CPython runs them too; `make micropython` runs the vectors on MicroPython.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tools.micropython.build import PARTS, Edition
from tools.micropython.patches import PATCHES
from tools.micropython.sources import Unknown


def test_an_edition_has_only_the_families_that_were_chosen() -> None:
    files = Edition(("rtu", "client", "registers")).files
    messages = {path for path in files if path.startswith("barewire/modbus/messages/")}
    assert "barewire/modbus/messages/registers.py" in messages
    # 08/00 is the probe; the others are those of every edition
    assert {Path(path).stem for path in messages} == {
        *("__init__", "base", "registry", "exception_response"),
        *("diagnostics", "registers"),
    }
    assert not any(path.startswith(("barewire/ascii", "barewire/tcp", "barewire/canopen")) for path in files)


def test_an_edition_reads_registers_and_tells_late_answers_apart(tmp_path: Path) -> None:
    Edition(("rtu", "client", "coils", "registers")).write(tmp_path)
    program = '''
from barewire.conversation import Heard, Listen
from barewire.modbus.client.bus import Bus
from barewire.modbus.messages.registers import ReadHoldingRegisters
from barewire.rtu.line import RtuLine
from barewire.rtu.frame import Timing, encode

bus, now = Bus(RtuLine(Timing.of(19200))), 2592000000000

def play(conversation, replies):
    """Answer each frame with the next of `replies`, a list of PDUs."""
    global now
    said, step, coming = [], next(conversation), []
    try:
        while True:
            heard = None
            if not isinstance(step, Listen):
                said += [item.hex() for item in step.items]
                now += 5000
                coming += [encode(1, bytes.fromhex(pdu)) for pdu in replies.pop(0)]
            elif coming and step.until > now:
                now, heard = now + 2000, coming.pop(0)
            else:
                now = max(now, step.until)
            step = conversation.send(Heard(heard, now))
    except StopIteration as end:
        return said, end.value.registers
    except Exception as error:
        return said, str(error)

print(play(bus.ask(1, ReadHoldingRegisters(107, 1), timeout=500000), [[]]))
print(play(bus.ask(1, ReadHoldingRegisters(107, 1)), [["0302022b", "0800009e37"], ["03020064"]]))
print(bus.counters.late, now)
'''
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env={}, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    first, second, third = done.stdout.splitlines()
    assert "did not answer Read Holding Registers within 500000 us" in first
    assert second == "(['010800009e37c9bd', '0103006b0001f5d6'], (100,))"  # a probe, and then the request
    assert third.startswith("1 ")


def test_an_unknown_part_is_an_error_that_lists_the_parts() -> None:
    with pytest.raises(Unknown, match=r"part rtx: expected some of rtu, ascii, tcp, client"):
        Edition(("rtx",))


def test_fewer_than_five_subjects_are_patched() -> None:
    subjects = {place.partition(":")[0] for place in PATCHES}
    assert len(subjects) < 5, subjects


def test_every_part_can_be_built_alone() -> None:
    for part in PARTS:
        assert Edition((part,)).files
