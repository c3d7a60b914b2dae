"""Raises an exception at one executed line of barewire, as a signal handler or Ctrl-C may.

count = interrupt(work, None, "src/barewire")        how many lines `work` executes in files below that path
interrupt(work, 17, "src/barewire")                  raises before the eighteenth of them

A tracer can raise where no signal handler runs: CPython runs them at the end of calls, at the start of functions and in
loops, so never between the last call inside `with lock:` and the release of that lock. `leaves_lock` tells these lines.
"""

from __future__ import annotations

import dis
import inspect
import linecache
import re
import sys
import threading
from collections.abc import Callable, Coroutine, Iterator, Sequence
from functools import cache
from types import CodeType, FrameType
from typing import Any
from zlib import crc32

import barewire

BAREWIRE = str(barewire.__file__).removesuffix("__init__.py")


class Interrupt(BaseException):
    """An exception that nothing in barewire expects."""


_RELEASE = re.compile(r"\s*\w+\._?reading\.release\(\)")
_WITH_LOCK = re.compile(r"\s*with \w+\.(_locking|_changing|_sending|_lock|reading)\b")


@cache
def leaves_lock(code: CodeType, instruction: int, line_number: int) -> bool:
    """Return whether the line is the end of a `with` on a lock of `threading`, the release of one in `finally`, or a
    `try`, which does nothing."""
    operation = dis.opname[code.co_code[instruction]]
    line = linecache.getline(code.co_filename, line_number)
    at_end = operation != "LOAD_FAST"  # which the beginning has
    return operation == "NOP" or bool(_RELEASE.match(line)) or (at_end and bool(_WITH_LOCK.match(line)))


def interrupt(
    work: Callable[[], object],
    at: int | None,
    below: str = BAREWIRE,
    error: Callable[[], BaseException] = Interrupt,
    *,
    skips: Callable[[FrameType], bool] = lambda frame: False,
) -> int:
    """Run `work`, and raise `error` before its executed line with the number `at`. Return the number of lines.
    Lines that `skips` are not counted."""
    lines = 0
    not_awaited: list[Coroutine[Any, Any, Any]] = []

    def on_line(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal lines
        if event == "line" and not skips(frame):
            lines += 1
            if at is not None and lines == at + 1:
                sys.settrace(None)
                not_awaited.extend(value for value in frame.f_locals.values() if is_not_started(value))
                raise error()
        return on_line

    def on_call(frame: FrameType, event: str, _: Any) -> Any:
        return on_line if frame.f_code.co_filename.startswith(below) else None

    def apart() -> Iterator[None]:
        # An exception that is raised where an `except` block ends keeps CPython from forgetting the one handled
        # there: each exception of later tests would have it as its context. A generator has that state for itself.
        work()
        yield

    before = sys.gettrace()
    sys.settrace(on_call)
    try:
        next(apart())
    finally:
        sys.settrace(before)
        # The exception may come between the call of a coroutine and its `await`. CPython 3.12 and later free such a
        # coroutine at some later time, and its warning would be the failure of another test.
        for coroutine in not_awaited:
            if is_not_started(coroutine):
                coroutine.close()
    return lines


def check_lines(run: Callable[[int | None], int], chosen: Sequence[int], step: int, name: str) -> None:
    """Call `run` with every `step`th of the chosen lines, and report all lines at which it fails.

    The first line depends on the name of the test, so that tests that execute the same lines divide them.
    """
    failures: dict[int, str] = {}
    for at in chosen[crc32(name.encode()) % step :: step]:
        try:
            run(at)
        except Exception as failure:
            failures[at] = repr(failure)[:200]
    assert not failures, (len(failures), len(chosen), failures)


def is_not_started(value: object) -> bool:
    """Return whether this is a coroutine of which nothing has run."""
    return inspect.iscoroutine(value) and inspect.getcoroutinestate(value) == inspect.CORO_CREATED


def in_a_thread(work: Callable[[], object], seconds: float, kept: str) -> None:
    """Run `work` in another thread, and raise its error. It fails after so many seconds: `kept` is not given back."""
    errors: list[BaseException] = []

    def run() -> None:
        try:
            work()
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(seconds)
    assert not thread.is_alive(), f"{kept} is not given back"
    if errors:
        raise errors[0]
