"""pymodbus over all seven carriers: its clients against our servers, our clients against its servers.

Its deviations from the standard are asserted as they are, so that a test fails when one is corrected:

    18, client, RTU              it expects two bytes less than the answer has, and never reads one
    08/04, server                it answers, without the two bytes of data, and goes on answering
    07 08 0B 0C 14 18, server    the numbers are zero; the records and the queue do not depend on the request
"""

from __future__ import annotations

import asyncio
import contextlib
import ssl
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from pymodbus import FramerType, ModbusDeviceIdentification
from pymodbus.client import AsyncModbusTcpClient, ModbusSerialClient, ModbusTcpClient, ModbusTlsClient, ModbusUdpClient
from pymodbus.exceptions import ModbusIOException
from pymodbus.pdu.file_message import FileRecord
from pymodbus.server import ModbusSerialServer, ModbusTcpServer, ModbusTlsServer, ModbusUdpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from barewire import ModbusClient
from barewire.modbus import Diagnostics, RecordPlace
from barewire.modbus.messages.diagnostics import Unanswered
from tests.helpers import until
from tests.interop.exchanges import Answers, exchange_all
from tests.interop.our_side import LONG, RecordingClient, client_url, our_server, port_of, with_both
from tests.interop.relay import in_its_own_loop, relayed
from tests.interop.services import CARRIERS, EVERY, proves, without

pytestmark = pytest.mark.needs("openssl")

FRAMERS = {"rtu": FramerType.RTU, "ascii": FramerType.ASCII, "tls": FramerType.TLS}


def framer(carrier: str) -> Any:
    return FRAMERS.get(carrier.partition("+")[0], FramerType.SOCKET)


def their_context(side: Any, certificates: Path, name: str) -> ssl.SSLContext:
    context = ssl.SSLContext(side)
    context.check_hostname = False  # its blocking client passes no server name to TLS
    context.load_cert_chain(certificates / f"{name}.crt", certificates / f"{name}.key")
    context.load_verify_locations(certificates / "ca.crt")
    context.verify_mode = ssl.CERT_REQUIRED
    return context


def their_client(carrier: str, place: str, certificates: Path) -> Any:
    if carrier in ("rtu", "ascii"):
        return ModbusSerialClient(place, framer=framer(carrier), baudrate=115200, parity="N", timeout=2)
    where: dict[str, Any] = {"port": port_of(place), "timeout": 2, "framer": framer(carrier)}
    if carrier == "udp":
        return ModbusUdpClient("127.0.0.1", **where)
    if carrier == "tls":
        where["sslctx"] = their_context(ssl.PROTOCOL_TLS_CLIENT, certificates, "operator")
        return ModbusTlsClient("127.0.0.1", **where)
    return ModbusTcpClient("127.0.0.1", **where)


THEIRS = {carrier: without("18") if "rtu" in carrier else EVERY for carrier in CARRIERS}


@pytest.mark.parametrize("carrier", [proves("pymodbus", "server", *pair[:1], *pair[1]) for pair in THEIRS.items()])
def test_their_client_uses_our_server(carrier: str, certificates: Path, exchanged: set[str]) -> None:
    with our_server(carrier, certificates, exchanged) as (place, unit):
        client = their_client(carrier, place, certificates)
        assert client.connect()
        try:
            bits_and_registers(client)
            server_information(client)
            files(client)
            diagnostics(client, exchanged)
            if "rtu" not in carrier:
                assert client.read_fifo_queue(address=30).values == [7, 8, 0xFFFF]
        finally:
            client.close()
    assert list(unit.holding_registers[:4]) == [0, 0xBEEF, 2, 3]
    assert list(unit.files[4]) == [100, 101, 102, 0x1234, 0x5678, *range(105, 110)]


def bits_and_registers(client: Any) -> None:
    pattern = [place % 3 == 0 for place in range(1968)]
    assert client.write_coils(100, pattern).count == 1968
    assert not client.write_coil(20, True).isError()
    assert client.read_coils(100, count=2000).bits == pattern + [False] * 32
    assert client.read_coils(19, count=3).bits[:3] == [False, True, False]
    assert client.read_discrete_inputs(5, count=3).bits[:3] == [False, True, False]
    assert client.write_registers(0, list(range(123))).count == 123
    assert client.write_register(1, 0xBEEF).registers == [0xBEEF]
    assert client.read_holding_registers(0, count=125).registers == [0, 0xBEEF, *range(2, 123), 0, 0]
    assert client.read_input_registers(3, count=2).registers == [0, 1234]
    assert client.read_holding_registers(9999, count=2).exception_code == 2
    assert client.mask_write_register(address=4, and_mask=0xF2, or_mask=0x25).or_mask == 0x25
    both = client.readwrite_registers(read_address=3, read_count=3, write_address=5, values=list(range(1, 122)))
    assert both.registers == [3, (4 & 0xF2) | (0x25 & ~0xF2), 1]


def server_information(client: Any) -> None:
    assert client.read_exception_status().status == 0x5A
    answer = client.report_device_id()
    assert answer.identifier == b"\x01\xfftabl"  # it takes the last byte as the run indicator
    basic = {0: b"barewire", 1: b"table", 2: b"1"}
    assert client.read_device_information(read_code=1).information == basic
    first = client.read_device_information(read_code=3)
    assert (first.more_follows, first.next_object_id) == (0xFF, 0x81)
    assert first.information == {**basic, 3: b"http://barewire.example", 0x80: b"serial 42"}
    rest = client.read_device_information(read_code=3, object_id=0x81)
    assert (rest.more_follows, rest.information) == (0, {0x81: LONG.encode()})


def files(client: Any) -> None:
    """pymodbus gives the lengths of records in bytes, in read requests too."""
    read = client.read_file_record([FileRecord(4, 0, record_length=4), FileRecord(4, 8, record_length=4)])
    assert [record.record_data for record in read.records] == [bytes([0, 100, 0, 101]), bytes([0, 108, 0, 109])]
    written = client.write_file_record([FileRecord(4, 3, b"\x12\x34\x56\x78")])
    assert written.records == [FileRecord(4, 3, b"\x12\x34\x56\x78")]


def diagnostics(client: Any, seen: set[str]) -> None:
    assert client.diag_query_data(b"\xa5\x37").message == b"\xa5\x37"
    assert not client.diag_clear_counters().isError()
    assert client.diag_read_bus_message_count().message == 1
    assert client.diag_read_device_message_count().message == 2
    assert client.diag_read_bus_comm_error_count().message == 0
    assert client.diag_read_bus_exception_error_count().message == 0
    assert client.diag_read_device_no_response_count().message == 0
    assert client.diag_read_device_nak_count().message == 0
    assert client.diag_read_device_busy_count().message == 0
    assert client.diag_read_bus_char_overrun_count().message == 0
    assert not client.diag_clear_overrun_counter().isError()
    assert client.diag_read_diagnostic_register().message == 0
    # Its delimiter argument is the delimiter and the zero byte behind it.
    assert client.diag_change_ascii_input_delimeter(delimiter=0x0A00).message == 0x0A00
    counter = client.diag_get_comm_event_counter()
    assert counter.count == 11
    log = client.diag_get_comm_event_log()
    assert (log.event_count, log.message_count) == (11, 13)
    assert log.events[0] & 0x80  # the newest event: this request was received
    # Neither is answered, so wait until the server has carried it out.
    client.diag_force_listen_only(no_response_expected=True)
    until(lambda: "08/04" in seen)
    client.diag_restart_communication(toggle=True, no_response_expected=True)
    until(lambda: "08/01" in seen)
    assert client.diag_get_comm_event_counter().count == 0


def test_their_asyncio_client_uses_our_server(certificates: Path) -> None:
    async def main() -> None:
        client = AsyncModbusTcpClient("127.0.0.1", port=port_of(place), timeout=2)
        assert await client.connect()
        try:
            await asyncio.gather(*(client.write_register(at, at) for at in range(20)))
            answers = await asyncio.gather(*(client.read_holding_registers(at, count=1) for at in range(20)))
            assert [answer.registers for answer in answers] == [[at] for at in range(20)]
        finally:
            client.close()

    with our_server("tcp", certificates, set()) as (place, _):
        asyncio.run(main())


def test_their_client_cannot_read_a_queue_over_rtu(certificates: Path) -> None:
    with our_server("rtu", certificates, set()) as (place, _):
        client = ModbusSerialClient(place, baudrate=115200, parity="N", timeout=0.2, retries=0)
        assert client.connect()
        try:
            with pytest.raises(ModbusIOException):
                client.read_fifo_queue(address=30)
        finally:
            client.close()


# Their servers --------------------------------------------------------------------------------------------------------

DUMMY = b"SERVER DUMMY RECORD."
OBJECTS = {0: b"Pymodbus", 1: b"PM", 2: b"3.16", 3: b"url", 4: b"name", 5: b"model", 6: b"application"}
ANSWERS = Answers(
    registers=200,
    server_id=b"Pymodbus-PM-3.16\xff",
    counts=dict.fromkeys((2, *range(11, 19)), 0),
    places=(RecordPlace(4, 0, 10),),  # the length of the record that it always sends
    rows=(tuple(int.from_bytes(DUMMY[at : at + 2], "big") for at in range(0, 20, 2)),),
    queue=(0, 1, 2, 3),  # it always sends this queue
    objects=OBJECTS,
)


@contextlib.contextmanager
def their_server(carrier: str, certificates: Path) -> Iterator[str]:
    """Run pymodbus's server on a carrier; yield PATH or HOST:PORT."""
    coils = [SimData(0, values=[False] * 2000, datatype=DataType.BITS)]
    inputs = [SimData(0, values=[place == 6 for place in range(16)], datatype=DataType.BITS)]
    holding = [SimData(0, values=[0] * 200, datatype=DataType.REGISTERS)]
    input_registers = [SimData(0, values=[0, 0, 0, 0, 1234], datatype=DataType.REGISTERS)]
    device = SimDevice(id=1, simdata=(coils, inputs, holding, input_registers))
    identity = ModbusDeviceIdentification(info={number: value.decode() for number, value in OBJECTS.items()})
    with ExitStack() as stack:
        options: dict[str, Any] = {"framer": framer(carrier), "identity": identity}
        ours = ""
        if carrier in ("rtu", "ascii"):
            options["port"], ours = stack.enter_context(relayed())
            options["baudrate"] = 115200
        else:
            options["address"] = ("127.0.0.1", 0)
        if carrier == "tls":
            options["sslctx"] = their_context(ssl.PROTOCOL_TLS_SERVER, certificates, "server")
        kinds = {"udp": ModbusUdpServer, "tls": ModbusTlsServer, "rtu": ModbusSerialServer, "ascii": ModbusSerialServer}

        @contextlib.asynccontextmanager
        async def serve() -> AsyncIterator[Any]:
            server = kinds.get(carrier, ModbusTcpServer)(device, **options)
            await server.serve_forever(background=True)
            yield server.transport
            await server.shutdown()

        transport = stack.enter_context(in_its_own_loop(serve))
        if ours:
            yield ours
        elif carrier == "udp":
            yield f"127.0.0.1:{transport.get_extra_info('sockname')[1]}"
        else:
            yield f"127.0.0.1:{transport.sockets[0].getsockname()[1]}"


OURS = without("08/04")


@pytest.mark.parametrize("carrier", [proves("pymodbus", "client", carrier, *OURS) for carrier in CARRIERS])
def test_our_clients_use_their_server(carrier: str, certificates: Path, exchanged: set[str]) -> None:
    async def talk(client: RecordingClient) -> None:
        await exchange_all(client, ANSWERS, OURS)

    with their_server(carrier, certificates) as place:
        with_both(client_url(carrier, place, certificates), exchanged, talk)


def test_their_server_answers_force_listen_only_with_an_incomplete_response(certificates: Path) -> None:
    """08/04: the response lacks two bytes, so our client ignores it; and the server goes on answering."""
    with (
        their_server("tcp", certificates) as place,
        ModbusClient(f"tcp://{place}?unit=1&timeout=1") as client,
    ):
        assert isinstance(client.ask(Diagnostics(0x04)), Unanswered)
        assert client.bus.counters.strays == 1
        assert client.read_input_registers(4, 1) == (1234,)
