"""What our client says to a stranger's server, function by function, and what must come back.

    input register 4 is 1234, discrete input 6 is on, all coils and holding registers may be written

A server that has only some of the functions is asked for those; what one answers of its own is in `Answers`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import pytest

from barewire.modbus import (
    Diagnostics,
    FileRecord,
    ModbusException,
    ReadDeviceIdentification,
    RecordPlace,
    read_device_identification,
)
from barewire.modbus.messages.diagnostics import (
    CHANGE_ASCII_DELIMITER,
    CLEAR_COUNTERS,
    CLEAR_OVERRUN,
    RESTART_AND_CLEAR_LOG,
    RESTART_COMMUNICATIONS,
)
from tests.interop.ours import Asker


@dataclass(frozen=True)
class Answers:
    """What one server has, and says about itself."""

    registers: int = 200
    coils: int = 2000
    status: int = 0
    server_id: bytes = b""
    events: bytes = b""
    counts: dict[int, int] = field(default_factory=dict)
    """By sub-function of 08."""
    places: tuple[RecordPlace, ...] = ()
    rows: tuple[tuple[int, ...], ...] = ()
    """What is asked of its files, and what comes."""
    queue: tuple[int, ...] = ()
    objects: dict[int, bytes] = field(default_factory=dict)
    level: int = 3
    """The objects of 2B/0E, and the level at which it gives all of them."""


async def everything(asker: Asker, answers: Answers, services: Collection[str]) -> None:
    """All of the services that the server has."""
    await bits_and_registers(asker, answers)
    if "16" in services:
        await masked(asker)
    if "17" in services:
        await read_and_written(asker)
    await files_and_queues(asker, answers, services)
    await about_itself(asker, answers, services)
    if "08/00" in services:
        await diagnosed(asker, answers, services)


async def bits_and_registers(asker: Asker, answers: Answers) -> None:
    """01 02 03 04 05 06 0F 10, with as many as fit, and an address too far."""
    pattern = tuple(place % 3 == 0 for place in range(min(1968, answers.coils)))
    await asker.write_multiple_coils(0, pattern)
    await asker.write_single_coil(1, True)
    await asker.write_single_coil(0, False)
    whole = (False, True, *pattern[2:], *(False,) * 32)[: answers.coils]
    assert await asker.read_coils(0, answers.coils) == whole
    assert await asker.read_discrete_inputs(5, 3) == (False, True, False)
    values = tuple(range(1000, 1000 + min(123, answers.registers)))
    await asker.write_multiple_registers(0, values)
    await asker.write_single_register(1, 0xBEEF)
    held = (1000, 0xBEEF, *values[2:], 0, 0)[: min(125, answers.registers)]
    assert await asker.read_holding_registers(0, len(held)) == held
    assert await asker.read_input_registers(3, 2) == (0, 1234)
    with pytest.raises(ModbusException) as caught:
        await asker.read_holding_registers(5000, 2)
    assert caught.value.code == 2


async def masked(asker: Asker) -> None:
    """16, the example of the standard."""
    await asker.write_single_register(12, 0x12)
    await asker.mask_write_register(12, 0xF2, 0x25)
    assert await asker.read_holding_registers(12, 1) == (0x17,)


async def read_and_written(asker: Asker) -> None:
    """17: what is read is what was just written."""
    await asker.write_multiple_registers(10, (1, 2, 3, 4))
    assert await asker.read_write_multiple_registers(10, 4, 12, (9, 10)) == (1, 2, 9, 10)


async def files_and_queues(asker: Asker, answers: Answers, services: Collection[str]) -> None:
    """14 15 18."""
    if "14" in services:
        assert await asker.read_file_record(answers.places) == answers.rows
    if "15" in services:
        await asker.write_file_record((FileRecord(5, 7, (0x06AF, 0x04BE)), FileRecord(5, 9, (0x100D,))))
    if "18" in services:
        assert await asker.read_fifo_queue(30) == answers.queue


async def about_itself(asker: Asker, answers: Answers, services: Collection[str]) -> None:
    """07 0B 0C 11 2B/0E."""
    if "07" in services:
        assert await asker.read_exception_status() == answers.status
    if "11" in services:
        assert await asker.report_server_id() == answers.server_id
    if "0B" in services:
        counter = await asker.get_comm_event_counter()
        assert (counter.status, counter.event_count) == (0, len(answers.events))
        log = await asker.get_comm_event_log()
        assert (log.status, log.event_count, log.events) == (0, len(answers.events), answers.events)
    if "2B/0E" in services:
        one = await asker.ask(ReadDeviceIdentification(4, 1))
        assert one.objects == ((1, answers.objects[1]),)
        whole = await asker.talk(lambda bus: read_device_identification(bus, 1, answers.level, timeout=2.0))
        assert whole.objects == answers.objects


async def diagnosed(asker: Asker, answers: Answers, services: Collection[str]) -> None:
    """08, every public sub-function that the server has."""
    assert await asker.diagnostics(0, b"\xa5\x37") == b"\xa5\x37"
    for sub in (CLEAR_COUNTERS, CLEAR_OVERRUN):
        assert await asker.diagnostics(sub) == b"\0\0"
    assert await asker.diagnostics(CHANGE_ASCII_DELIMITER, b"\n\0") == b"\n\0"
    for sub, count in answers.counts.items():
        assert (await asker.ask(Diagnostics(sub))).count == count
    if "08/04" in services:
        await asker.silenced()
    assert await asker.diagnostics(RESTART_COMMUNICATIONS, RESTART_AND_CLEAR_LOG) == RESTART_AND_CLEAR_LOG
