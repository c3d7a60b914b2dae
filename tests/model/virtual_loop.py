"""An asyncio event loop in the time of the checker: it never waits, and receives the bytes that arrive on the line."""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable
from typing import Any

from tests.model.units import UnitsOnLine


class VirtualSelector(selectors.SelectSelector):
    """The selector of an event loop: to wait is to let the time of the line pass."""

    def __init__(self, line: UnitsOnLine) -> None:
        super().__init__()
        self.line = line
        self.received: Callable[[bytes], object] = len

    def select(self, timeout: float | None = None) -> list[Any]:
        """Wait until the time-out, or until bytes arrive: `received` is called with them. No file is ever ready."""
        line = self.line
        until = line.now + (float("inf") if timeout is None else max(timeout, 0.0))
        if line.coming and line.coming[0].at <= until:
            self.received(line.deliver())
        else:
            assert until < float("inf"), "every task waits, and nothing will wake it"
            line.now = until
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop in the time of the line."""

    def __init__(self, selector: VirtualSelector) -> None:
        self._line = selector.line
        super().__init__(selector)

    def time(self) -> float:
        """Return the time of the line, in seconds."""
        return self._line.now
