"""Unit 1 of a tmodbus server: its codecs and router, with a handler for every public function but 2B/0D."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from barewire.modbus import RecordPlace
from tests.interop.exchanges import Answers


def their_unit() -> Any:
    """Return a router of tmodbus with the values of a table; each function has a handler."""
    from tmodbus import pdu
    from tmodbus.exceptions import IllegalDataAddressError
    from tmodbus.pdu.device import ConformityLevel
    from tmodbus.server import ModbusRequestRouter

    router = ModbusRequestRouter()
    coils, inputs, registers = [False] * 2000, [place == 6 for place in range(10)], [0] * 200

    def on(kind: Any, answer: Callable[[Any], Any]) -> None:
        async def handler(unit_id: int, request: Any) -> Any:
            return answer(request)

        router.register(kind, unit_id=1)(handler)

    def read(row: list[Any], at: int, quantity: int) -> list[Any]:
        if at + quantity > len(row):
            raise IllegalDataAddressError(3)
        return row[at : at + quantity]

    def write(row: list[Any], at: int, values: list[Any], answer: Any) -> Any:
        row[at : at + len(values)] = values
        return answer

    def mask_write(request: Any) -> tuple[int, int]:
        old, both = registers[request.address], (request.and_mask, request.or_mask)
        return write(registers, request.address, [old & both[0] | both[1] & ~both[0]], both)  # type: ignore[no-any-return]

    def read_write_multiple(request: Any) -> list[Any]:
        write(registers, request.write_start_address, list(request.write_values), None)
        return read(registers, request.read_start_address, request.read_quantity)

    def read_identification(request: Any) -> Any:
        code, first = request.read_device_id_code, request.object_id
        if code == 4:
            found, more, following = {first: OBJECTS[first]}, False, 0
        else:  # one object in each answer, so that more follow
            found, more = {first: OBJECTS[first]}, first < 3
            following = first + 1 if more else 0
        level = ConformityLevel.REGULAR_PLUS
        return pdu.ReadDeviceIdentificationResponse(code, level, more, following, 1, found)

    on(pdu.ReadCoilsPDU, lambda asked: read(coils, asked.start_address, asked.quantity))
    on(pdu.ReadDiscreteInputsPDU, lambda asked: read(inputs, asked.start_address, asked.quantity))
    on(pdu.ReadHoldingRegistersPDU, lambda asked: read(registers, asked.start_address, asked.quantity))
    on(pdu.ReadInputRegistersPDU, lambda asked: read([0, 0, 0, 0, 1234], asked.start_address, asked.quantity))
    on(pdu.WriteSingleCoilPDU, lambda asked: write(coils, asked.address, [asked.value], asked.value))
    on(pdu.WriteSingleRegisterPDU, lambda asked: write(registers, asked.address, [asked.value], asked.value))
    on(pdu.WriteMultipleCoilsPDU, lambda asked: write(coils, asked.start_address, asked.values, len(asked.values)))
    on(
        pdu.WriteMultipleRegistersPDU,
        lambda asked: write(registers, asked.start_address, asked.values, len(asked.values)),
    )
    on(pdu.MaskWriteRegisterPDU, mask_write)
    on(pdu.ReadWriteMultipleRegistersPDU, read_write_multiple)
    on(pdu.ReadExceptionStatusPDU, lambda asked: 0x6D)
    on(pdu.ReportServerIdPDU, lambda asked: pdu.ServerIdResponse(b"tm", True, b"bench"))
    on(pdu.GetCommEventCounterPDU, lambda asked: pdu.CommEventCounterResponse(0, 3))
    on(pdu.GetCommEventLogPDU, lambda asked: pdu.CommEventLogResponse(0, 3, 9, b"\x20\x00\x40"))
    on(pdu.ReadFileRecordPDU, lambda asked: [bytes(range(2 * part.record_length)) for part in asked.requests])
    on(pdu.WriteFileRecordPDU, lambda asked: list(asked.file_records))
    on(pdu.ReadFifoQueuePDU, lambda asked: [7, 8, 0xFFFF])
    on(pdu.ReadDeviceIdentificationPDU, read_identification)
    on(pdu.DiagnosticsQueryDataPDU, lambda asked: asked.data)
    on(pdu.DiagnosticsRestartCommunicationsOptionPDU, lambda asked: asked.clear_event_log)
    on(pdu.DiagnosticsChangeAsciiInputDelimiterPDU, lambda asked: asked.delimiter)
    for sub, kind in vars(pdu).items():
        number = getattr(kind, "sub_function_code", None) if sub.startswith("Diagnostics") else None
        if number in COUNTS:
            on(kind, lambda asked: COUNTS[asked.sub_function_code])
        elif number in (0x04, 0x0A, 0x14):
            on(kind, lambda asked: None)
    return router


OBJECTS = {0: b"wlcrs", 1: b"bench", 2: b"1.1", 3: b"http://tmodbus.example"}
COUNTS = {0x02: 0xABCD, **{sub: 0x0100 + sub for sub in range(0x0B, 0x13)}}
ANSWERS = Answers(
    status=0x6D,
    server_id=b"tm\xffbench",
    events=b"\x20\x00\x40",
    counts=COUNTS,
    places=(RecordPlace(4, 0, 2), RecordPlace(3, 9, 3)),
    rows=((0x0001, 0x0203), (0x0001, 0x0203, 0x0405)),
    queue=(7, 8, 0xFFFF),
    objects=OBJECTS,
)
