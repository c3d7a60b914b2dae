"""A slow unit on a serial line, and one command after the other: no answer ends in the wrong command."""

from __future__ import annotations

import subprocess
import threading
import time

from barewire.io.ports.pty import PseudoTerminal
from barewire.rtu import crc16
from tests.cli.test_command import COMMAND, ENVIRONMENT


def _unit(terminal: PseudoTerminal, stop: threading.Event) -> None:
    """Answers in order; the first answer comes after 1.5 s. Every register holds its own address."""
    delay = 1.5
    while not stop.is_set():
        request = terminal.receive(0.1)
        if not request:
            continue
        address, quantity = int.from_bytes(request[2:4], "big"), int.from_bytes(request[4:6], "big")
        if request[1] == 4:
            data = b"".join((address + place).to_bytes(2, "big") for place in range(quantity))
            body = request[:2] + bytes([len(data)]) + data
        else:
            body = bytes([request[0], request[1] | 0x80, 1])
        time.sleep(delay)
        delay = 0.0
        terminal.send(body + crc16(body).to_bytes(2, "little"))


def test_the_next_command_does_not_get_the_answer_to_the_last() -> None:
    terminal, stop = PseudoTerminal(), threading.Event()
    unit = threading.Thread(target=_unit, args=(terminal, stop))
    unit.start()

    def read(name: str, timeout: float) -> subprocess.CompletedProcess[str]:
        command = [*COMMAND, "read", f"rtu://{terminal.path}?timeout={timeout}", "adxl", name]
        return subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=30, check=False)

    try:
        first = read("L1 current", 0.7)
        assert "did not answer" in first.stderr
        second = read("L2 current", 20.0)
        assert second.stdout == f"L2 current = {(9 * 65536 + 10) / 10000} A\n"
    finally:
        stop.set()
        unit.join()
        terminal.close()
