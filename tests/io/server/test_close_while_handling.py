"""A server that is closed while it cannot end: `close` waits 5 s in all, and the server ends later."""

from __future__ import annotations

import pytest

from barewire import ModbusServer
from barewire.io.server import base
from barewire.modbus import Table


class VirtualTime:
    """A clock, and an event that is not set and a thread that does not end within any time-out."""

    now = 100.0

    def monotonic(self) -> float:
        return self.now

    def wait(self, timeout: float) -> bool:
        self.now += timeout
        return False

    def join(self, timeout: float) -> None:
        self.now += timeout


def test_close_waits_five_seconds_in_all(monkeypatch: pytest.MonkeyPatch) -> None:
    server = ModbusServer("tcp://127.0.0.1:0", {1: Table(1)})
    server.start()
    virtual = VirtualTime()
    with monkeypatch.context() as patched:
        patched.setattr(base, "time", virtual)
        patched.setattr(server, "_released", virtual)
        patched.setattr(server, "_thread", virtual)
        server.close()
    assert virtual.now == 105.0
    assert server._released.wait(30)
