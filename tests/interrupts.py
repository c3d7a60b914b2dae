"""Raises an exception at one executed line of barewire, as a signal handler or Ctrl-C may.

count = interrupt(work, None, "src/barewire")        how many lines `work` executes in files below that path
interrupt(work, 17, "src/barewire")                  raises before the eighteenth of them
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import barewire

BAREWIRE = str(barewire.__file__).removesuffix("__init__.py")


class Interrupt(BaseException):
    """An exception that nothing in barewire expects."""


def interrupt(
    work: Callable[[], object],
    at: int | None,
    below: str = BAREWIRE,
    error: Callable[[], BaseException] = Interrupt,
) -> int:
    """Run `work`, and raise `error` before its executed line with the number `at`. Return the number of lines."""
    lines = 0

    def on_line(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal lines
        if event == "line":
            lines += 1
            if at is not None and lines == at + 1:
                sys.settrace(None)
                raise error()
        return on_line

    def on_call(frame: FrameType, event: str, _: Any) -> Any:
        return on_line if frame.f_code.co_filename.startswith(below) else None

    before = sys.gettrace()
    sys.settrace(on_call)
    try:
        work()
    finally:
        sys.settrace(before)
    return lines
