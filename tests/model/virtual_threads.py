"""Threads, locks and a clock in the time of the line: one thread runs at a time, until it waits.

    thread 1   ask -- send -- receive ............................ answer -->  the next question
    thread 2                  ask -- waits for the line ......................  send -- receive ...

A thread waits in `Lock.acquire`, `Condition.wait_for`, `sleep` and, for bytes, in `wait`. Then the thread runs whose
time is next, and the time of the line is that time. So a run has no races, takes no real time, and is repeated by its
choices. An interrupt, as by a signal, is an exception that a thread raises where it waits, at a given time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeAlias

from tests.model.units import UnitsOnLine

FOREVER = float("inf")
Interrupt: TypeAlias = "type[BaseException] | None"


class Stuck(AssertionError):
    """Every thread waits for a lock, so none will ever continue."""


class _Ended(BaseException):
    """Raised in the threads that still wait when a run has failed."""


class _Thread:
    """One thread: until when it waits, and for what."""

    def __init__(self) -> None:
        self.turn = threading.Semaphore(0)
        self.until = FOREVER
        self.waits_for_bytes = False
        self.lock: object = None
        self.interrupt_at = FOREVER
        self.interrupt: Interrupt = None


class VirtualThreads:
    """All threads of a run; takes the place of the modules `threading` and `time` in the client."""

    def __init__(self, line: UnitsOnLine) -> None:
        self.line = line
        self.current = _Thread()
        self._threads = [self.current]
        self._failure: BaseException | None = None

    def RLock(self) -> VirtualLock:  # the name in `threading`
        """Return a new lock."""
        return VirtualLock(self)

    def Condition(self, lock: VirtualLock) -> VirtualCondition:
        """Return a new condition of a lock."""
        return VirtualCondition(self, lock)

    def monotonic(self) -> float:
        """Return the time of the line, in seconds."""
        return self.line.now

    def sleep(self, seconds: float) -> None:
        """Let so many seconds pass."""
        if seconds > 0:
            self.wait(self.line.now + seconds)

    def interrupt_at(self, when: float, error: Interrupt) -> None:
        """Raise this error in the current thread if it waits at this time, instead of one that was set before."""
        self.current.interrupt_at, self.current.interrupt = when, error

    def wait(self, until: float, *, for_bytes: bool = False, lock: object = None) -> None:
        """Let the other threads run until a time, until bytes arrive, or until a lock is released."""
        if self._failure is not None:
            raise _Ended
        me = self.current
        me.until, me.waits_for_bytes, me.lock = until, for_bytes, lock
        following = self._next()
        if following is not me:
            following.turn.release()
            me.turn.acquire()
            if self._failure is not None:
                raise _Ended
        me.lock = None
        if me.interrupt is not None and self.line.now >= me.interrupt_at:
            error, me.interrupt, me.interrupt_at = me.interrupt, None, FOREVER
            raise error("interrupted")

    def _next(self) -> _Thread:
        """Return the thread that continues first, at its time, which is the current thread from now on."""
        line = self.line
        arrival = line.coming[0].at if line.coming else FOREVER
        first, when = None, FOREVER
        for thread in self._threads:
            wake = min(thread.until, thread.interrupt_at, arrival if thread.waits_for_bytes else FOREVER)
            if wake < when:
                first, when = thread, wake
        if first is None:
            raise Stuck(f"{len(self._threads)} threads wait for a lock that none of them releases")
        line.now = max(line.now, when)
        self.current = first
        return first

    def released(self, lock: object) -> None:
        """Let the threads that wait for this lock try again."""
        for thread in self._threads:
            if thread.lock is lock:
                thread.until = self.line.now

    def run(self, functions: list[Callable[[], object]]) -> None:
        """Call each function in a thread of its own; return when all of them have returned, or raise their error."""
        if len(functions) == 1:
            functions[0]()
            return
        main = self.current
        self._threads.remove(main)
        real = [self._thread(function, main) for function in functions]
        for thread in self._threads:
            thread.until = self.line.now
        self._next().turn.release()
        main.turn.acquire()
        for other in self._threads:  # none, unless the run has failed
            other.turn.release()
        for running in real:
            running.join()
        self._threads, self.current = [main], main
        if self._failure is not None:
            raise self._failure

    def _thread(self, function: Callable[[], object], main: _Thread) -> threading.Thread:
        me = _Thread()
        self._threads.append(me)

        def call() -> None:
            me.turn.acquire()
            try:
                if self._failure is None:
                    function()
                    self._threads.remove(me)
                    (self._next() if self._threads else main).turn.release()
            except BaseException as error:  # passed on to the caller of `run`
                if self._failure is None:
                    self._failure = error
                    main.turn.release()

        thread = threading.Thread(target=call, daemon=True)
        thread.start()
        return thread


class VirtualLock:
    """A lock of `VirtualThreads`, which the thread that has it may take again."""

    def __init__(self, threads: VirtualThreads) -> None:
        self._threads = threads
        self._owner: object = None
        self._count = 0

    def acquire(self, blocking: bool = True) -> bool:
        """Take the lock, when it is free."""
        while self._owner is not None and not self._is_owned():
            if not blocking:
                return False
            self._threads.wait(FOREVER, lock=self)
        self._owner, self._count = self._threads.current, self._count + 1
        return True

    def release(self) -> None:
        """Give the lock back."""
        assert self._is_owned(), "a lock was released by a thread that does not have it"
        self._count -= 1
        if not self._count:
            self._owner = None
            self._threads.released(self)

    def _is_owned(self) -> bool:  # the name in `threading`
        return self._owner is self._threads.current

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


class VirtualCondition:
    """A condition of `VirtualThreads`."""

    def __init__(self, threads: VirtualThreads, lock: VirtualLock) -> None:
        self._threads = threads
        self._lock = lock

    def wait_for(self, predicate: Callable[[], Any]) -> Any:
        """Wait until the predicate is true. The lock is free meanwhile."""
        while not (result := predicate()):
            self._lock.release()
            try:
                self._threads.wait(FOREVER, lock=self)
            finally:
                self._lock.acquire()
        return result

    def notify_all(self) -> None:
        """Wake all threads that wait."""
        self._threads.released(self)

    def __enter__(self) -> bool:
        return self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()
