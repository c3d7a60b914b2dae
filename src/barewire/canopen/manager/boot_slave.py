"""The boot slave process: a CANopen manager checks one node, and makes it ready to be started.   [CiA 302-2]

        1000h, 1018h     device type, vendor, product, revision, serial number are the expected ones         B C D M N O
        700h+n           keep alive: an operational node goes on as it is, any other one is reset             E F L
        1F52h, 1F56h     the program is the expected one; otherwise a new one is downloaded                   G H I
        1020h            the configuration has the expected date; otherwise it is written                     J
        700h+n           error control starts: the first heartbeat, or the first guarding request             K

The process ends with a `BootResult`. Each failure has a letter of the standard, `BootError`, and a sentence on what was
read and what was expected. L is not a failure: the node was operational, and the network may go on with it.

A node that was just reset may not answer yet: its first object of a step is read again after a time-out, three times.
A node that reboots meanwhile has lost what was written: its boot-up message ends the process with the letter of a step.

The download of a program, if that is allowed:   [CiA 302-3]

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
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import NamedTuple, TypeAlias

from barewire.canopen.configuration.configure import ConciseValue, compare_device, configure_device
from barewire.canopen.configuration.settings import DATE, DEVICE_TYPE, IDENTITY, DeviceConfiguration
from barewire.canopen.frame import CanFrame
from barewire.canopen.manager.network_list import BootSlave
from barewire.canopen.nmt.master import request_state, wait_for_boot_up, wait_for_heartbeat
from barewire.canopen.nmt.messages import NmtCommand, NmtMessage, NmtState, NodeState, guarding_request
from barewire.canopen.sdo import Channel, download, upload
from barewire.canopen.sdo.channel import channel_to
from barewire.canopen.sdo.client import repeated, write_setting
from barewire.conversation import DEFAULT_TIMEOUT, Conversation, Heard, Listen, Send
from barewire.errors import BarewireError, DecodeError, NoAnswer

RETRIES = 3
"""How often an object is read again after a time-out, where the node may just have been reset."""

RESET_TIME = 1.0
"""Seconds from a reset of communication to the boot-up message."""

GUARDING_TIME = 0.1
"""Seconds that a node has to respond to the guarding request of the keep-alive check."""

BootProgress = Callable[[int, str], object]
"""Called as progress(node, step) before each step, in words."""


class BootError(Enum):
    """Why the boot slave process of a node ended, with the letter of the standard and its meaning."""

    A = "the node is not in the network list (1F81h)"
    B = "no response to the request of the device type (1000h)"
    C = "another device type (1000h) than expected (1F84h)"
    D = "another vendor-ID (1018h:01) than expected (1F85h)"
    E = "keep-alive check: no heartbeat of the node was received"
    F = "keep-alive check: the node did not respond to node guarding"
    G = "the expected program is not configured (1F53h to 1F55h)"
    H = "another program (1F52h, 1F56h), and an update is not allowed (1F81h)"
    I = "another program (1F52h, 1F56h), and its download failed"  # noqa: E741 - the letter of the standard
    J = "the download of the configuration failed"
    K = "no heartbeat of the node was received when its error control started"
    L = "the node was operational already"
    M = "another product code (1018h:02) than expected (1F86h)"
    N = "another revision number (1018h:03) than expected (1F87h)"
    O = "another serial number (1018h:04) than expected (1F88h)"  # noqa: E741 - the letter of the standard

    def __str__(self) -> str:
        return f"{self.name}: {self.value}"


class BootResult(NamedTuple):
    """How the boot slave process of a node ended.

    node        the node-ID
    error       None, or why it ended
    reason      what was read, and what was expected
    state       the NMT state that the node has reported last, None if it reported none
    configured  whether its configuration was written
    planned     after a dry run, what would be written; otherwise None
    """

    node: int
    error: BootError | None
    reason: str = ""
    state: int | None = None
    configured: bool = False
    planned: tuple[str, ...] | None = None

    @property
    def ok(self) -> bool:
        """Whether the network may go on with the node."""
        return self.error in (None, BootError.L)

    def __str__(self) -> str:
        if self.error is None and self.planned is not None:
            return f"node {self.node}: {'; '.join(self.planned) or 'nothing would be written'}"
        if self.error is None:
            return f"node {self.node}: booted{', configured' if self.configured else ''}"
        return f"node {self.node}: {self.error}{self.reason and f': {self.reason}'}"

    def __repr__(self) -> str:
        return f"<BootResult {self}>"


class BootFailed(BarewireError):
    """The end of a boot slave process by an error. It does not leave this room."""

    def __init__(self, error: BootError, reason: str = "") -> None:
        super().__init__(f"{error}{reason and f': {reason}'}")
        self.error = error
        self.reason = reason


def boot_slave(
    slave: BootSlave,
    channel: Channel | None = None,
    *,
    timeout: float = DEFAULT_TIMEOUT,
    progress: BootProgress | None = None,
    after_boot_up: bool = False,
    end: float = float("inf"),
    dry_run: bool = False,
) -> Conversation[CanFrame, BootResult]:
    """Carry out the boot slave process of a node. It does not start the node: `BootManager` does that.

        slave           the expected values
        channel         the SDO channel to the node, by default that of the predefined connection set
        timeout         seconds for each SDO response
        progress        called before each step
        after_boot_up   the node has just sent its boot-up message: if it is to be kept alive, it is not reset again
        end             the time at which the process fails; a program or configuration that it writes is completed
        dry_run         only read: identity, program, and what differs from the configuration

    The process raises nothing: each failure is the `error` and the `reason` of the result.
    """
    sdo = channel_to(slave.node if channel is None else channel, None)
    return _Boot(slave, sdo, timeout, progress, after_boot_up, end, [] if dry_run else None).run()


@dataclass(slots=True)
class _Boot:
    slave: BootSlave
    channel: Channel
    timeout: float
    progress: BootProgress | None
    after_boot_up: bool
    end: float
    planned: list[str] | None  # what would be written, in a dry run
    state: int | None = None
    configured: bool = False
    step: str = ""
    error: BootError = BootError.B  # of the present step
    must_not_boot: bool = False  # from its first response on, except where a reset is expected

    def run(self) -> Conversation[CanFrame, BootResult]:
        node = self.slave.node
        try:
            yield from self._watched(self._steps())
        except BootFailed as failed:
            return BootResult(node, failed.error, failed.reason, self.state, self.configured)
        if self.planned is not None:
            return BootResult(node, None, planned=tuple(self.planned))
        operational = self.state == NmtState.OPERATIONAL
        return BootResult(node, BootError.L if operational else None, "", self.state, self.configured)

    # The flow chart of CiA 302-2, boot slave

    def _steps(self) -> Conversation[CanFrame, None]:
        slave = self.slave
        if not slave.listed:
            raise BootFailed(BootError.A)
        if slave.boot:
            yield from self._check_identity()
            may_run = slave.keep_alive and not self.after_boot_up and self.planned is None
            runs = (yield from self._check_keep_alive()) if may_run else False
            if not runs:
                if slave.check_program:
                    yield from self._check_program()
                yield from self._check_configuration()
        if self.planned is None:
            yield from self._start_error_control()

    def _watched(self, steps: Conversation[CanFrame, None]) -> Conversation[CanFrame, None]:
        """Carry out the steps until the node reboots, or the time is over. Raise BootFailed then."""
        try:
            step = next(steps)
            while True:
                heard = yield Listen(min(step.until, self.end)) if isinstance(step, Listen) else step
                reason = ""
                if self.must_not_boot and heard.item is not None and self._is_boot_up(heard.item):
                    reason = "the node rebooted meanwhile, its boot-up message came"
                elif heard.now >= self.end:
                    reason = "the boot time is over"
                if reason:
                    steps.close()
                    self.configured = False
                    raise BootFailed(self.error, f"{reason} (step: {self.step})")
                step = steps.send(heard)
        except StopIteration:
            return

    def _is_boot_up(self, frame: CanFrame) -> bool:
        try:
            received = NodeState.decode(frame)
        except DecodeError:
            return False
        return received.node == self.slave.node and received.is_boot_up

    def _tell(self, step: str) -> None:
        self.step = step
        if self.progress is not None:
            self.progress(self.slave.node, step)

    # Identity

    def _check_identity(self) -> Conversation[CanFrame, None]:
        slave = self.slave
        retries = RETRIES if self.planned is None else 0
        device_type = yield from self._read(DEVICE_TYPE, 0, BootError.B, "device type", retries=retries)
        _compare(BootError.C, device_type, slave.device_type)
        checks = (
            (1, slave.vendor, BootError.D, "vendor-ID"),
            (2, slave.product, BootError.M, "product code"),
            (3, slave.revision, BootError.N, "revision number"),
            (4, slave.serial, BootError.O, "serial number"),
        )
        for sub, expected, error, name in checks:
            if expected:
                number = yield from self._read(IDENTITY, sub, error, name)
                _compare(error, number, expected)

    def _read(
        self, index: int, sub: int, error: BootError, name: str, *, retries: int = 0
    ) -> Conversation[CanFrame, int]:
        """Read a number. Raise BootFailed with `error` if the node refuses it, or does not respond."""
        self.error = error
        self._tell(f"read {index:04X}h:{sub:02X} {name}")
        reading = partial(upload, self.channel, index, sub, size=4, limit=4, timeout=self.timeout)
        try:
            data = yield from repeated(reading, retries)
        except BarewireError as failure:
            raise BootFailed(error, str(failure)) from None
        self.must_not_boot = True
        return int.from_bytes(data[:4], "little")

    # Keep alive

    def _check_keep_alive(self) -> Conversation[CanFrame, bool]:
        """Return whether the node is operational, so that it goes on; otherwise reset its communication."""
        slave = self.slave
        self.error = error = BootError.E if slave.heartbeat else BootError.F
        self._tell("wait for its heartbeat" if slave.heartbeat else "request its state by node guarding")
        try:
            if slave.heartbeat:
                received = yield from wait_for_heartbeat(slave.node, timeout=slave.heartbeat)
            else:
                received = yield from request_state(slave.node, timeout=GUARDING_TIME)
            if received.state == NmtState.OPERATIONAL:
                self.state = received.state
                return True
            yield from self._reset()
        except NoAnswer as silence:
            raise BootFailed(error, str(silence)) from None
        return False

    def _reset(self) -> Conversation[CanFrame, None]:
        self._tell("reset its communication")
        self.must_not_boot = False
        yield Send(NmtMessage(NmtCommand.RESET_COMMUNICATION, self.slave.node).encode())
        yield from wait_for_boot_up(self.slave.node, timeout=RESET_TIME)
        self.must_not_boot = True

    # Program and configuration

    def _check_program(self) -> Conversation[CanFrame, None]:
        slave = self.slave
        objects = program_objects(slave.software, slave.software_date)
        if not objects:
            raise BootFailed(BootError.G)
        for index, sub, name, expected in objects:
            present = yield from self._read(index, sub, BootError.G, name, retries=RETRIES)
            if present != expected:
                break
        else:
            return  # it is the expected program
        other = f"{name}: {present}, expected {expected}"
        if index == _IDENTIFICATION:
            other = f"read {present:08X}h, expected {expected:08X}h"
        if not slave.update_program or slave.keep_alive:
            raise BootFailed(BootError.H, other)
        if not slave.program:
            raise BootFailed(BootError.I, f"{other}; there is no program to download (1F58h)")
        if self.planned is not None:
            self.planned.append(f"its program would be replaced, {len(slave.program)} bytes: {other}")
            return
        self.error, self.end = BootError.I, float("inf")  # half a program would be worse than a late one
        self.must_not_boot = False  # it may restart when its program stops or starts
        try:
            yield from download_program(self.channel, slave.program, objects, self.timeout, self._tell)
        except BarewireError as failure:
            raise BootFailed(BootError.I, f"{other}; {failure}") from None
        yield from self._check_identity()

    def _check_configuration(self) -> Conversation[CanFrame, None]:
        slave = self.slave
        if not slave.configuration and not slave.concise:
            return
        if any(slave.date) and (yield from self._has_expected_date()):
            return
        if self.planned is not None:
            yield from self._plan_configuration(self.planned)
            return
        self.error, self.end = BootError.J, float("inf")  # a configuration that has begun is completed
        try:
            yield from self._write_configuration()
        except BarewireError as failure:
            raise BootFailed(BootError.J, str(failure)) from None
        self.configured = True

    def _has_expected_date(self) -> Conversation[CanFrame, bool]:
        try:
            day = yield from self._read(DATE, 1, BootError.J, "configuration date", retries=RETRIES)
            time = yield from self._read(DATE, 2, BootError.J, "configuration time", retries=RETRIES)
        except BootFailed:
            return False  # a device without 1020h is always configured
        return (day, time) == self.slave.date

    def _write_configuration(self) -> Conversation[CanFrame, None]:
        configuration, values = self.slave.configuration, _concise_values(self.slave)
        if isinstance(configuration, DeviceConfiguration):
            if values:  # 1020h must not say that the node is configured before these are written too
                values += tuple(ConciseValue(*date.place, date.data) for date in configuration.date)
                configuration = replace(configuration, date=())
            yield from configure_device(
                self.channel, configuration, timeout=self.timeout, progress=lambda done, total, step: self._tell(step)
            )
        for value in values:
            self._tell(f"write {value.index:04X}h:{value.sub:02X}")
            yield from write_setting(self.channel, value.index, value.sub, value.data, timeout=self.timeout)

    def _plan_configuration(self, planned: list[str]) -> Conversation[CanFrame, None]:
        """Add what would be written. A concise DCF is written without a comparison."""
        configuration, values = self.slave.configuration, _concise_values(self.slave)
        if isinstance(configuration, DeviceConfiguration):
            self.error = BootError.J
            self._tell("compare its configuration")
            try:
                differences = yield from compare_device(self.channel, configuration, timeout=self.timeout)
            except BarewireError as failure:
                raise BootFailed(BootError.J, str(failure)) from None
            planned += map(str, differences)
        if values:
            planned.append(f"{len(values)} value{'s' if len(values) > 1 else ''} of the concise DCF")

    # Error control

    def _start_error_control(self) -> Conversation[CanFrame, None]:
        slave = self.slave
        self.error = BootError.K
        if slave.heartbeat:
            self._tell("wait for its heartbeat")
            try:
                received = yield from wait_for_heartbeat(slave.node, timeout=slave.heartbeat)
            except NoAnswer as silence:
                raise BootFailed(BootError.K, str(silence)) from None
            self.state = received.state
        elif slave.guard_time:
            self._tell("start node guarding")
            yield Send(guarding_request(slave.node))


def _concise_values(slave: BootSlave) -> tuple[ConciseValue, ...]:
    """Return the values of the concise DCF of a slave, alone or beside a DCF."""
    if isinstance(slave.configuration, DeviceConfiguration):
        return slave.concise
    return *slave.configuration, *slave.concise


def _compare(error: BootError, present: int, expected: int) -> None:
    if expected and present != expected:
        raise BootFailed(error, f"read {present:08X}h, expected {expected:08X}h")


# Program --------------------------------------------------------------------------------------------------------------

FLASH_INTERVAL = 0.1
"""Seconds between two requests of the flash status, and of the program control."""

FLASH_TIME = 60.0
"""Seconds that a node has to write its flash, and to start its program."""

_DATA, _CONTROL, _VERIFY, _IDENTIFICATION, _FLASH = 0x1F50, 0x1F51, 0x1F52, 0x1F56, 0x1F57
_STOP, _START, _CLEAR = 0, 1, 3
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
    identified = (_IDENTIFICATION, 1, "program identification", identification)
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
    yield from _command(channel, _CLEAR, timeout, retries=RETRIES)
    tell(f"write its program, {len(program)} bytes")
    yield from repeated(partial(download, channel, _DATA, 1, program, block="auto", timeout=timeout), RETRIES)
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
        yield from repeated(partial(download, channel, _CONTROL, 1, bytes([command]), timeout=timeout), retries)
    except NoAnswer:
        if not may_be_silent:
            raise


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
