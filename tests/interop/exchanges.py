"""The requests of our client to the server of another library, function by function, with the expected answers.

    input register 4 is 1234, discrete input 6 is on, all coils and holding registers may be written

Only the functions that the server supports are requested. `Answers` holds the answers that differ between servers.
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
from tests.interop.our_side import RecordingClient


@dataclass(frozen=True)
class Answers:
    """The size of a server's tables, and the answers that are its own."""

    registers: int = 200
    coils: int = 2000
    status: int = 0
    server_id: bytes = b""
    events: bytes = b""
    counts: dict[int, int] = field(default_factory=dict)
    """By sub-function of 08."""
    places: tuple[RecordPlace, ...] = ()
    rows: tuple[tuple[int, ...], ...] = ()
    """The records that are read from its files, and the expected registers."""
    queue: tuple[int, ...] = ()
    objects: dict[int, bytes] = field(default_factory=dict)
    level: int = 3
    """The objects of 2B/0E, and the lowest read code for which the server returns all of them."""


async def exchange_all(client: RecordingClient, answers: Answers, services: Collection[str]) -> None:
    """Exchange all services that the server supports."""
    await bits_and_registers(client, answers)
    if "16" in services:
        await mask_write(client)
    if "17" in services:
        await read_write_multiple(client)
    await files_and_queues(client, answers, services)
    await server_information(client, answers, services)
    if "08/00" in services:
        await diagnostics(client, answers, services)


async def bits_and_registers(client: RecordingClient, answers: Answers) -> None:
    """Exchange 01 02 03 04 05 06 0F 10, with the largest quantities, and an address behind the last one."""
    pattern = tuple(place % 3 == 0 for place in range(min(1968, answers.coils)))
    await client.write_multiple_coils(0, pattern)
    await client.write_single_coil(1, True)
    await client.write_single_coil(0, False)
    whole = (False, True, *pattern[2:], *(False,) * 32)[: answers.coils]
    assert await client.read_coils(0, answers.coils) == whole
    assert await client.read_discrete_inputs(5, 3) == (False, True, False)
    values = tuple(range(1000, 1000 + min(123, answers.registers)))
    await client.write_multiple_registers(0, values)
    await client.write_single_register(1, 0xBEEF)
    held = (1000, 0xBEEF, *values[2:], 0, 0)[: min(125, answers.registers)]
    assert await client.read_holding_registers(0, len(held)) == held
    assert await client.read_input_registers(3, 2) == (0, 1234)
    with pytest.raises(ModbusException) as caught:
        await client.read_holding_registers(5000, 2)
    assert caught.value.code == 2


async def mask_write(client: RecordingClient) -> None:
    """Exchange 16, the example of the standard."""
    await client.write_single_register(12, 0x12)
    await client.mask_write_register(12, 0xF2, 0x25)
    assert await client.read_holding_registers(12, 1) == (0x17,)


async def read_write_multiple(client: RecordingClient) -> None:
    """Exchange 17: the registers are written first, then read."""
    await client.write_multiple_registers(10, (1, 2, 3, 4))
    assert await client.read_write_multiple_registers(10, 4, 12, (9, 10)) == (1, 2, 9, 10)


async def files_and_queues(client: RecordingClient, answers: Answers, services: Collection[str]) -> None:
    """Exchange 14 15 18."""
    if "14" in services:
        assert await client.read_file_record(answers.places) == answers.rows
    if "15" in services:
        await client.write_file_record((FileRecord(5, 7, (0x06AF, 0x04BE)), FileRecord(5, 9, (0x100D,))))
    if "18" in services:
        assert await client.read_fifo_queue(30) == answers.queue


async def server_information(client: RecordingClient, answers: Answers, services: Collection[str]) -> None:
    """Exchange 07 0B 0C 11 2B/0E."""
    if "07" in services:
        assert await client.read_exception_status() == answers.status
    if "11" in services:
        assert await client.report_server_id() == answers.server_id
    if "0B" in services:
        counter = await client.get_comm_event_counter()
        assert (counter.status, counter.event_count) == (0, len(answers.events))
        log = await client.get_comm_event_log()
        assert (log.status, log.event_count, log.events) == (0, len(answers.events), answers.events)
    if "2B/0E" in services:
        single = await client.ask(ReadDeviceIdentification(4, 1))
        assert single.objects == ((1, answers.objects[1]),)
        whole = await client.run(lambda bus: read_device_identification(bus, 1, answers.level, timeout=2.0))
        assert whole.objects == answers.objects


async def diagnostics(client: RecordingClient, answers: Answers, services: Collection[str]) -> None:
    """Exchange 08, every public sub-function that the server supports."""
    assert await client.diagnostics(0, b"\xa5\x37") == b"\xa5\x37"
    for sub in (CLEAR_COUNTERS, CLEAR_OVERRUN):
        assert await client.diagnostics(sub) == b"\0\0"
    assert await client.diagnostics(CHANGE_ASCII_DELIMITER, b"\n\0") == b"\n\0"
    for sub, count in answers.counts.items():
        assert (await client.ask(Diagnostics(sub))).count == count
    if "08/04" in services:
        await client.force_listen_only()
    assert await client.diagnostics(RESTART_COMMUNICATIONS, RESTART_AND_CLEAR_LOG) == RESTART_AND_CLEAR_LOG
