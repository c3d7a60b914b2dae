"""A thread that waits for bytes of a port, which another one closes."""

from __future__ import annotations

import threading

from barewire.errors import PortError
from barewire.io.ports.base import Port
from tests.helpers import PATIENCE


def receiving(port: Port[bytes]) -> tuple[threading.Thread, list[str]]:
    """Wait for bytes in a thread. Return it, and the list that gets the error which ends the wait."""
    errors: list[str] = []

    def wait() -> None:
        try:
            port.receive(2 * PATIENCE)
        except PortError as error:
            errors.append(str(error))

    thread = threading.Thread(target=wait)
    thread.start()
    return thread, errors
