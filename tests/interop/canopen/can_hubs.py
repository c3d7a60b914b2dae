"""CAN buses between processes. A hub runs in a process of its own and ends when its standard input ends.

    python -m tests.interop.canopen.can_hubs slcan 4       prints four pseudo-terminals (LAWICEL), one a line
    python -m tests.interop.canopen.can_hubs socketcand    prints HOST:PORT of our own hub

Each frame goes to all other participants.
"""

from __future__ import annotations

import os
import select
import socket
import subprocess
import sys
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[3]


@contextmanager
def hub(*arguments: str, lines: int = 1) -> Iterator[list[str]]:
    """Run a hub in another process; yield the places that it prints."""
    command = [sys.executable, "-m", "tests.interop.canopen.can_hubs", *arguments]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            yield [process.stdout.readline().strip() for _ in range(lines)]
        finally:
            process.stdin.close()
            process.wait(60)


class Adapter:
    """One LAWICEL adapter on a pseudo-terminal: it answers commands, and sends the frames of other adapters."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()  # the slave stays open, so that a program may open and close it
        tty.setraw(self.slave)
        self.name = os.ttyname(self.slave)
        self.open = False
        self._text = b""

    def read(self, others: list[Adapter]) -> None:
        self._text += os.read(self.master, 4096)
        *commands, self._text = self._text.split(b"\r")
        for command in commands:
            os.write(self.master, self._carry_out(command, others))

    def _carry_out(self, command: bytes, others: list[Adapter]) -> bytes:
        kind = command[:1]
        if kind in (b"t", b"T", b"r", b"R"):
            if not self.open:
                return b"\x07"
            for other in others:
                if other is not self and other.open:
                    os.write(other.master, command + b"\r")
            return b"z\r" if kind in (b"t", b"r") else b"Z\r"
        if kind in (b"O", b"L", b"C"):
            self.open = kind != b"C"
            return b"\r"
        answers = {b"V": b"V1013\r", b"N": b"NA123\r", b"F": b"F00\r"}
        return answers.get(kind, b"\r" if kind in b"SsZMmWXQ" and kind else b"\x07")


def run_slcan(count: int) -> None:
    """Run adapters that share one bus until the standard input ends."""
    adapters = [Adapter() for _ in range(count)]
    for adapter in adapters:
        print(adapter.name, flush=True)
    while True:
        ready, _, _ = select.select([0, *(adapter.master for adapter in adapters)], [], [])
        if 0 in ready and not os.read(0, 1):
            return
        for adapter in adapters:
            if adapter.master in ready:
                adapter.read(adapters)


def run_socketcand() -> None:
    """Run our socketcand hub until the standard input ends."""
    from barewire.io.server.can import SocketcandHub

    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = SocketcandHub("127.0.0.1", port)
    print(f"127.0.0.1:{port}", flush=True)
    sys.stdin.read()
    server.close()


if __name__ == "__main__":
    if sys.argv[1] == "slcan":
        run_slcan(int(sys.argv[2]))
    else:
        run_socketcand()
