"""The programs of docs/how-to/micropython.md run, with a UART and a socket of this test in the place of real ones."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from barewire import rtu
from tools.micropython.build import Edition
from tools.micropython.sizes import PAGE

BOARD = '''
import asyncio, select, socket, sys, time, types

NOW = 2**30 - 50_000  # the ticks are about to begin again
time.ticks_us = lambda: NOW % 2**30
time.ticks_ms = lambda: NOW // 1000 % 2**30
time.ticks_diff = lambda a, b: (a - b + 2**29) % 2**30 - 2**29
def sleep_us(microseconds):
    global NOW
    NOW += int(microseconds)
    if NOW > 2**30 + 2**24:
        raise SystemExit  # of a server, which runs for ever
time.sleep_us = sleep_us
async def sleep_ms(milliseconds):
    sleep_us(1000 * milliseconds)
    await _sleep(0)
_sleep = asyncio.sleep
asyncio.sleep_ms, asyncio.sleep = sleep_ms, lambda seconds: sleep_ms(1000 * seconds)

class Wire:
    """What is behind the port: it answers each request with the next of `answers`."""
    answers, arriving, said = [], [], []
    def write(self, data):
        self.said.append(bytes(data).hex())
        self.arriving += [bytes.fromhex(self.answers.pop(0))] if self.answers else []
    def any(self):
        return len(self.arriving)
    def read(self):
        return self.arriving.pop(0)
    def flush(self):
        sleep_us(1000)
    # as a socket
    def send(self, data):
        self.write(data)
        return len(data)
    recv = lambda self, size: self.read()
    setblocking = connect = register = lambda self, *_: None
    poll = lambda self, _: self.any()
class Pin:
    OUT, levels = 1, []
    def __init__(self, *_): pass
    def value(self, level): self.levels.append(level)
sys.modules["machine"] = types.SimpleNamespace(UART=lambda *_, **__: Wire(), Pin=Pin)
'''
BLOCKS = dict(
    re.findall(r"^## ([^\n]+)\n(?:(?!^## ).)*?```python\n(.*?)```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
)


def frame(unit: int, pdu: str) -> str:
    """Return a frame of RTU, as hexadecimal digits."""
    return rtu.encode(unit, bytes.fromhex(pdu)).hex()


def answering(*answers: tuple[int, str]) -> str:
    """Return a program after which these units answer, one after the other."""
    return f"Wire.answers = {[frame(unit, pdu) for unit, pdu in answers]}\n"


def run(folder: Path, *programs: str) -> str:
    """Run programs on such a board, and return what they print."""
    Edition(("rtu", "tcp", "client", "server", "ports", "coils", "registers")).write(folder)
    command = [sys.executable, "-c", "\n".join((BOARD, *programs))]
    done = subprocess.run(command, cwd=folder, env={}, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    return done.stdout


def test_a_value_is_read_and_the_transmitter_is_on_while_it_is_asked(tmp_path: Path) -> None:
    printed = run(tmp_path, answering((1, "040400E5002A")), BLOCKS["A value"], "print(Wire.said, Pin.levels)")
    assert printed == f"(229, 42)\n{[frame(1, '0400080002')]} [1, 0]\n"


def test_a_register_is_written_over_tcp(tmp_path: Path) -> None:
    answers = "Wire.answers = ['0001000000060106006b002a']\nselect.poll, select.POLLIN = Wire, 1\n"
    answers += "socket.socket, socket.getaddrinfo = Wire, lambda *where: [(where,)]\n"
    assert run(tmp_path, answers, BLOCKS["Over TCP"], "print(Wire.said)") == "['0001000000060106006b002a']\n"


def test_two_tasks_read_in_turn(tmp_path: Path) -> None:
    value = answering((1, "040400E5002A")) + BLOCKS["A value"].split("print(")[0]
    loop = BLOCKS["With asyncio"].replace("while True:", "for _ in range(1):")
    printed = run(tmp_path, value, answering((1, "040400E5002A"), (2, "040400010002")), loop)
    assert printed == "1 (229, 42)\n2 (1, 2)\n"


def test_a_server_answers_and_tells_what_was_written(tmp_path: Path) -> None:
    arriving = f"Wire.arriving += [bytes.fromhex('{frame(1, '060005002A')}')]\n"
    end = "import atexit\natexit.register(lambda: print(Wire.said))\n"
    printed = run(tmp_path, BLOCKS["A value"].split("answer =")[0], arriving, end, BLOCKS["A server"])
    assert printed == f"holding_registers 5 (42,)\n{[frame(1, '060005002A')]}\n"


@pytest.mark.parametrize("name", ["A value", "Over TCP", "With asyncio", "A server"])
def test_every_program_is_found(name: str) -> None:
    assert "barewire" in BLOCKS[name]
