"""Download of a new program to a node.   [CiA 302-3]

        1F51h:01   program control       read 0 stopped, 1 started; write 0 stop, 1 start, 2 reset, 3 clear
        1F50h:01   program data          a domain, written in blocks if the node has them
        1F57h:01   flash status          | vendor-specific 16 | reserved 8 | error 7 | 1 while it is busy |
        1F56h:01   program identification
        1F52h:01   its date, in days since 1984      1F52h:02   its time, in ms after midnight

        stop -> clear -> write -> wait until the flash is ready -> check it is the program -> start -> wait

A node may restart when its program stops or starts, so these two writes may stay without response. After a clear, and
after a start, the node may not answer for a while: the next request is repeated after a time-out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeAlias

from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo import Channel, download, upload
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import BarewireError, NoAnswer

FLASH_INTERVAL = 0.1
"""Seconds between two requests of the flash status, and of the program control."""

FLASH_TIME = 60.0
"""Seconds that a node has to write its flash, and to start its program."""

_DATA, _CONTROL, _VERIFY, IDENTIFICATION, _FLASH = 0x1F50, 0x1F51, 0x1F52, 0x1F56, 0x1F57
_STOP, _START, _CLEAR = 0, 1, 3
_RETRIES = 3
_FLASH_ERRORS = {
    1: "no valid program",
    2: "unknown data format",
    3: "error in the data format, or CRC error",
    4: "the flash was not cleared before the write",
    5: "flash write error",
    6: "address error",
    7: "the flash is write-protected",
    63: "unspecified error",
}


ProgramObject: TypeAlias = tuple[int, int, str, int]
"""An object that identifies the program of a node: index, sub-index, name, expected value."""


class ProgramFailed(BarewireError):
    """A node does not have the program after its download."""


def program_objects(identification: int, date: tuple[int, int]) -> list[ProgramObject]:
    """Return the objects by which the program of a node is checked; empty if neither of both is expected.

    >>> [f"{index:04X}h:{sub:02X} = {expected}" for index, sub, _, expected in program_objects(7, (15519, 1000))]
    ['1F52h:01 = 15519', '1F52h:02 = 1000', '1F56h:01 = 7']
    """
    dates = [(_VERIFY, 1, "program date", date[0]), (_VERIFY, 2, "program time", date[1])]
    identified = (IDENTIFICATION, 1, "program identification", identification)
    return [*(dates if any(date) else ()), *([identified] if identification else ())]


def download_program(
    channel: Channel,
    program: bytes,
    objects: Iterable[ProgramObject],
    timeout: float,
    tell: Callable[[str], object],
) -> Conversation[CanFrame, None]:
    """Replace the program of a node, check it by `objects`, and start it. `tell` is called with each step in words.

    Raise ProgramFailed, and SdoAbort or NoAnswer for a request that the node refuses or leaves without response.
    """
    tell("stop its program")
    if (yield from _control(channel, timeout)) != _STOP:
        yield from _command(channel, _STOP, timeout, may_be_silent=True)
    tell("clear its program")
    yield from _command(channel, _CLEAR, timeout, retries=_RETRIES)
    tell(f"write its program, {len(program)} bytes")
    yield from _repeated(lambda: download(channel, _DATA, 1, program, block="auto", timeout=timeout))
    tell("wait for its flash")
    yield from _wait_for_flash(channel, timeout)
    for index, sub, _, expected in objects:
        data = yield from upload(channel, index, sub, size=4, limit=4, timeout=timeout)
        present = int.from_bytes(data[:4], "little")
        if present != expected:
            text = f"{index:04X}h:{sub:02X} is {present:08X}h, expected {expected:08X}h"
            raise ProgramFailed(f"after the download {text}")
    tell("start its program")
    yield from _command(channel, _START, timeout, may_be_silent=True)
    yield from _wait_until_started(channel, timeout)


def _control(channel: Channel, timeout: float) -> Conversation[CanFrame, int]:
    data = yield from upload(channel, _CONTROL, 1, size=1, limit=4, timeout=timeout)
    return data[0] if data else 0


def _command(
    channel: Channel, command: int, timeout: float, *, retries: int = 0, may_be_silent: bool = False
) -> Conversation[CanFrame, None]:
    try:
        yield from _repeated(lambda: download(channel, _CONTROL, 1, bytes([command]), timeout=timeout), retries)
    except NoAnswer:
        if not may_be_silent:
            raise


def _repeated(
    transfer: Callable[[], Conversation[CanFrame, None]], retries: int = _RETRIES
) -> Conversation[CanFrame, None]:
    while True:
        try:
            yield from transfer()
            return
        except NoAnswer:
            if not retries:
                raise
            retries -= 1


def _pause(seconds: float) -> Conversation[CanFrame, float]:
    """Wait, and return the time at the end."""
    heard: Heard[CanFrame] = yield Listen(float("-inf"))
    until = heard.now + seconds
    while heard.now < until:
        heard = yield Listen(until)
    return heard.now


def _wait_for_flash(channel: Channel, timeout: float) -> Conversation[CanFrame, None]:
    end: float | None = None
    while True:
        now = yield from _pause(FLASH_INTERVAL)
        end = now + FLASH_TIME if end is None else end
        try:
            data = yield from upload(channel, _FLASH, 1, size=4, limit=4, timeout=timeout)
        except NoAnswer:
            data = b"\1"  # busy
        status = int.from_bytes(data[:4], "little")
        if not status & 1:
            break
        if now >= end:
            raise ProgramFailed(f"the flash is still busy after {FLASH_TIME:g} s (1F57h:01)")
    error = status >> 1 & 0x7F
    if error:
        text = _FLASH_ERRORS.get(
            error, f"manufacturer-specific error {status >> 16:04X}h" if error > 63 else "reserved"
        )
        raise ProgramFailed(f"flash status 1F57h:01 = {status:08X}h: {text}")


def _wait_until_started(channel: Channel, timeout: float) -> Conversation[CanFrame, None]:
    end: float | None = None
    while True:
        now = yield from _pause(FLASH_INTERVAL)
        end = now + FLASH_TIME if end is None else end
        try:
            if (yield from _control(channel, timeout)) == _START:
                return
        except NoAnswer:
            pass
        if now >= end:
            raise ProgramFailed(f"the program has not started after {FLASH_TIME:g} s (1F51h:01)")
