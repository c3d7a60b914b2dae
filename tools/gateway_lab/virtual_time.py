"""An event loop of asyncio in virtual time: where it would wait for a timer, the time jumps to it.

    ready sockets?   yes: they are served, and no time passes
                     no:  the time is that of the next timer

Both ends of a connection on loopback are in the same loop, and the kernel delivers at once what is sent there. So a
week takes as long as the work in it. What waits in a thread or on a pseudo-terminal is outside this time; a function
that would run in a thread, as aiomqtt's `connect`, is called at once.
"""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


class _JumpingSelector(selectors.DefaultSelector):
    """A selector that never waits."""

    jump: Callable[[float], None]

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return what is ready; if nothing is, let `timeout` seconds pass."""
        ready = super().select(0)
        if not ready and timeout != 0:
            ready = super().select(0)  # the kernel may deliver a little later, on a busy machine
            if not ready:
                if timeout is None:
                    raise RuntimeError("nothing is left that could happen")
                self.jump(timeout)
        return ready


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """The loop. Its time begins at 0."""

    def __init__(self) -> None:
        self.now = 0.0
        selector = _JumpingSelector()
        selector.jump = self._jump
        super().__init__(selector)

    def _jump(self, seconds: float) -> None:
        self.now += seconds

    def time(self) -> float:
        """Return the virtual time."""
        return self.now

    def run_in_executor(self, executor: Any, func: Callable[..., T], *args: Any) -> asyncio.Future[T]:  # type: ignore[override]
        """Call the function at once."""
        result: asyncio.Future[T] = self.create_future()
        try:
            result.set_result(func(*args))
        except Exception as error:
            result.set_exception(error)
        return result


def run_in_virtual_time(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine until it is done."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main)
