"""A wait of an asyncio task that ends in one round of the event loop; that of a future takes two.

        frame --> future.set_result     round 1: the future is done      round 2: the task goes on
        frame --> wait.wake             round 1: the task goes on

asyncio lets a task wait for any object that has `_asyncio_future_blocking`, as for a future (`asyncio.isfuture`). It
passes the function that continues the task to `add_done_callback`; a future calls that in a round of its own. Here the
one who delivers the frame passes it to the loop, and `LoopReader`, which is a callback of the loop, calls it directly.

Depends on: asyncio.  Used by: subscribers of asyncio, `LoopReader`.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Generator
from contextlib import suppress
from contextvars import Context
from typing import Any

Resume = Callable[[Any], object]


class TaskWait:
    """One wait of one task, until `wake` is called, in any thread. A task that is cancelled is woken too."""

    __slots__ = ("_asyncio_future_blocking", "_is_woken", "_loop", "_resumes", "_thread")

    def __init__(self, loop: asyncio.AbstractEventLoop, thread: int) -> None:
        """`thread`: the identifier of the thread that runs the loop."""
        self._loop = loop
        self._thread = thread
        self._is_woken = False
        self._resumes: list[tuple[Resume, Context]] = []  # at most one; whoever takes it out continues the task
        self._asyncio_future_blocking = False

    def __repr__(self) -> str:
        return f"<{type(self).__name__}{', woken' if self._is_woken else ''}>"

    def __await__(self) -> Generator[Any, None, None]:
        if not self._is_woken:
            self._asyncio_future_blocking = True
            yield self

    def wake(self) -> None:
        """Continue the task in the next round of its loop."""
        self._is_woken = True  # before the look at `_resumes`: `add_done_callback` does both in the other order
        try:
            resume, context = self._resumes.pop()
        except IndexError:
            return
        if threading.get_ident() == self._thread:
            self._loop.call_soon(resume, self, context=context)
            return
        with suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(resume, self, context=context)

    def wake_now(self) -> None:
        """Continue the task before this returns. Only for a callback of its loop: no other task may run."""
        self._is_woken = True
        try:
            resume, context = self._resumes.pop()
        except IndexError:
            return
        context.run(resume, self)

    # What asyncio calls

    def get_loop(self) -> asyncio.AbstractEventLoop:
        """Return the loop of the task."""
        return self._loop

    def add_done_callback(self, resume: Resume, *, context: Context) -> None:
        """Keep the function that continues the task."""
        self._resumes.append((resume, context))
        if self._is_woken:
            self.wake()

    def result(self) -> None:
        """Return None: the task looks for its frames itself."""

    def cancel(self, msg: object = None) -> bool:
        """Wake the task, and return False, so that asyncio raises CancelledError in it."""
        self.wake()
        return False
