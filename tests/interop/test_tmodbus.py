"""tmodbus, the asyncio library for Python 3.12: its clients against our servers, our clients against its servers, with
every public function but 2B/0D in both directions. No other library supports all of them.

It has no ASCII over TCP: there its serial ASCII side is behind a serial server. It is imported inside the tests, so
that their marks can be read where it is not installed.
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

from barewire.modbus.server.authorization import role_of
from tests.helpers import until
from tests.interop.exchanges import exchange_all
from tests.interop.our_side import LONG, RecordingClient, client_url, our_server, port_of, with_both
from tests.interop.relay import in_its_own_loop, relayed, serial_at, serial_server
from tests.interop.services import CARRIERS, EVERY, TCP_LIKE, proves, without
from tests.interop.tmodbus_unit import ANSWERS, their_unit

pytestmark = pytest.mark.needs("openssl", "socat")


def their_context(side: Any, certificates: Path, name: str) -> ssl.SSLContext:
    context = ssl.SSLContext(side)
    context.load_cert_chain(certificates / f"{name}.crt", certificates / f"{name}.key")
    context.load_verify_locations(certificates / "ca.crt")
    context.verify_mode = ssl.CERT_REQUIRED
    return context


def their_client(carrier: str, place: str, certificates: Path, **options: Any) -> Any:
    import tmodbus

    options = {"unit_id": 1, "timeout": 2.0, **options}
    if carrier == "rtu":
        return tmodbus.create_async_rtu_client(place, **options, baudrate=115200)
    if carrier in ("ascii", "ascii+tcp"):
        return tmodbus.create_async_ascii_client(place, **options, baudrate=115200)
    host, port = "127.0.0.1", port_of(place)
    if carrier == "udp":
        return tmodbus.create_async_udp_client(host, port, **options)
    if carrier == "rtu+tcp":
        return tmodbus.create_async_rtu_over_tcp_client(host, port, **options)
    if carrier == "tls":
        options["ssl"] = their_context(ssl.PROTOCOL_TLS_CLIENT, certificates, "operator")
    return tmodbus.create_async_tcp_client(host, port, **options)


THEIRS = {carrier: without("08/04") if carrier in TCP_LIKE else EVERY for carrier in CARRIERS}


@pytest.mark.parametrize("carrier", [proves("tmodbus", "server", *pair[:1], *pair[1]) for pair in THEIRS.items()])
def test_their_client_uses_our_server(carrier: str, certificates: Path, exchanged: set[str]) -> None:
    async def main() -> None:
        async with their_client(carrier, place, certificates) as client:
            await bits_and_registers(client)
            await files_and_queue(client)
            await server_information(client, is_serial=carrier not in TCP_LIKE)
        async with their_client(carrier, place, certificates, timeout=1, auto_reconnect=False) as client:
            await listening_only(client, exchanged, is_serial=carrier not in TCP_LIKE)

    with ExitStack() as stack:
        place, unit = stack.enter_context(our_server(carrier, certificates, exchanged))
        if carrier == "ascii+tcp":
            place = stack.enter_context(serial_at(port_of(place)))
        asyncio.run(main())
    assert unit.coils[20] == 1
    assert list(unit.holding_registers[:6]) == [0, 0xBEEF, 2, 3, 0x05, 1]
    assert list(unit.files[4]) == [100, 101, 102, 0x1234, 104, 0x5678, 0x9ABC, 107, 108, 109]


async def bits_and_registers(client: Any) -> None:
    from tmodbus.exceptions import IllegalDataAddressError

    pattern = [place % 3 == 0 for place in range(1968)]
    assert await client.write_multiple_coils(100, pattern) == 1968
    assert await client.write_single_coil(20, True) is True
    assert await client.read_coils(100, 2000) == pattern + [False] * 32
    assert await client.read_coils(19, 3) == [False, True, False]
    assert await client.read_discrete_inputs(5, 3) == [False, True, False]
    assert await client.write_multiple_registers(0, list(range(123))) == 123
    assert await client.write_single_register(1, 0xBEEF) == 0xBEEF
    assert await client.read_holding_registers(0, 125) == [0, 0xBEEF, *range(2, 123), 0, 0]
    assert await client.read_input_registers(3, 2) == [0, 1234]
    with pytest.raises(IllegalDataAddressError):
        await client.read_holding_registers(9999, 2)
    assert await client.mask_write_register(4, 0xF2, 0x25) == (0xF2, 0x25)
    written = await client.read_write_multiple_registers(3, 3, 5, list(range(1, 122)))
    assert written == [3, (4 & 0xF2) | (0x25 & ~0xF2), 1]  # writes first, then reads


async def files_and_queue(client: Any) -> None:
    from tmodbus.exceptions import IllegalDataAddressError
    from tmodbus.pdu import FileRecord, FileRecordRequest

    asked = [FileRecordRequest(4, 0, 2), FileRecordRequest(4, 8, 2)]
    assert await client.read_file_records(asked) == [bytes([0, 100, 0, 101]), bytes([0, 108, 0, 109])]
    records = [FileRecord(4, 3, b"\x12\x34"), FileRecord(4, 5, b"\x56\x78\x9a\xbc")]
    assert list(await client.write_file_records(records)) == records
    assert await client.read_file_record(4, 3, 4) == bytes.fromhex("1234 0068 5678 9ABC")
    with pytest.raises(IllegalDataAddressError):
        await client.read_file_record(4, 9, 2)
    assert await client.read_fifo_queue(30) == [7, 8, 0xFFFF]


async def server_information(client: Any, *, is_serial: bool) -> None:
    from tmodbus.exceptions import IllegalDataAddressError

    assert await client.read_exception_status() == 0x5A
    server_id = await client.read_server_id()
    assert (server_id.server_id, server_id.run_indicator_status) == (b"\x01", True)
    assert server_id.additional_data == b"table"
    basic = await client.read_device_identification(1, 0)
    assert basic == {0: b"barewire", 1: b"table", 2: b"1"}
    assert await client.read_device_identification(2, 0) == {**basic, 3: b"http://barewire.example"}
    extended = await client.read_device_identification(3, 0)  # in two answers
    assert extended == {**basic, 3: b"http://barewire.example", 0x80: b"serial 42", 0x81: LONG.encode()}
    assert await client.read_device_identification(4, 0x80) == {0x80: b"serial 42"}
    with pytest.raises(IllegalDataAddressError):
        await client.read_device_identification(4, 0x70)

    assert await client.diag_read_query_data(b"\xa5\x37") == b"\xa5\x37"
    await client.diag_clear_counters_and_register()
    assert await client.diag_read_bus_message_count() == 1
    assert await client.diag_read_server_message_count() == 2
    assert await client.diag_read_bus_communication_error_count() == 0
    assert await client.diag_read_bus_exception_error_count() == 0
    if is_serial:
        with pytest.raises(IllegalDataAddressError):
            await client.read_coils(9999, 2)
        assert await client.diag_read_bus_exception_error_count() == 1
    assert await client.diag_read_server_no_response_count() == 0
    assert await client.diag_read_server_nak_count() == 0
    assert await client.diag_read_server_busy_count() == 0
    assert await client.diag_read_bus_character_overrun_count() == 0
    await client.diag_clear_overrun_counter_and_flag()
    assert await client.diag_read_diagnostic_register() == 0
    assert await client.diag_change_ascii_input_delimiter(0x0A) == 0x0A
    counter = await client.get_comm_event_counter()
    assert counter.status == 0
    log = await client.get_comm_event_log()
    assert (log.status, log.event_count) == (0, counter.event_count)
    assert log.message_count == await client.diag_read_bus_message_count() - 1
    assert len(log.events) > 10
    assert log.events[0] & 0x80  # the newest event: this request was received


async def listening_only(client: Any, seen: set[str], *, is_serial: bool) -> None:
    from tmodbus.exceptions import InvalidRequestError

    assert await client.diag_restart_communications_option(clear_event_log=True) is True
    assert (await client.get_comm_event_counter()).event_count == 0
    if not is_serial:  # tmodbus raises: the function is for serial lines
        with pytest.raises(InvalidRequestError):
            await client.diag_force_listen_only_mode()
        return
    await client.diag_force_listen_only_mode()
    # There is no answer; a request sent at once could overtake it.
    await asyncio.to_thread(until, lambda: "08/04" in seen)
    with pytest.raises(TimeoutError):
        await client.read_coils(0, 1)
    with pytest.raises(TimeoutError):  # ends listen only mode, without an answer
        await client.diag_restart_communications_option()
    assert await client.read_coils(20, 1) == [True]


# Their servers --------------------------------------------------------------------------------------------------------


def sockets(server: Any) -> Any:
    return server.sockets if hasattr(server, "sockets") else server._server.sockets


@contextlib.contextmanager
def their_server(carrier: str, certificates: Path) -> Iterator[str]:
    """Run tmodbus's server on a carrier; yield PATH or HOST:PORT for our client."""
    from tmodbus import server as their

    @contextlib.asynccontextmanager
    async def serve() -> AsyncIterator[Any]:
        kinds = {"tcp": their.AsyncTcpServer, "udp": their.AsyncUdpServer, "rtu+tcp": their.AsyncRtuOverTcpServer}
        if carrier in ("rtu", "ascii", "ascii+tcp"):
            kind = their.AsyncRtuServer if carrier == "rtu" else their.AsyncAsciiServer
            server = kind(theirs, their_unit(), baudrate=115200)
        else:
            options = {}
            if carrier == "tls":
                options["ssl_context"] = their_context(ssl.PROTOCOL_TLS_SERVER, certificates, "server")
            server = kinds.get(carrier, their.AsyncTcpServer)("127.0.0.1", their_unit(), port=0, **options)
        await server.start()
        yield server
        await server.stop()

    with ExitStack() as stack:
        if carrier == "ascii+tcp":
            theirs, port = stack.enter_context(serial_server())
        elif carrier in ("rtu", "ascii"):
            theirs, ours = stack.enter_context(relayed())
        server = stack.enter_context(in_its_own_loop(serve))
        if carrier in ("rtu", "ascii"):
            yield ours
        else:
            yield f"127.0.0.1:{port if carrier == 'ascii+tcp' else sockets(server)[0].getsockname()[1]}"


@pytest.mark.parametrize("carrier", [proves("tmodbus", "client", carrier, *EVERY) for carrier in CARRIERS])
def test_our_clients_use_their_server(carrier: str, certificates: Path, exchanged: set[str]) -> None:
    async def talk(client: RecordingClient) -> None:
        await exchange_all(client, ANSWERS, EVERY)

    with their_server(carrier, certificates) as place:
        # After 08/04 a client waits for a late exception, by default three times the time-out.
        with_both(f"{client_url(carrier, place, certificates)}&late_window=1", exchanged, talk)


def test_tmodbus_and_barewire_read_the_same_role_from_a_certificate(certificates: Path) -> None:
    from cryptography import x509
    from tmodbus.server.security import extract_modbus_role

    for name, role in (("operator", "Operator"), ("server", None)):
        text = (certificates / f"{name}.crt").read_text()
        assert extract_modbus_role(x509.load_pem_x509_certificate(text.encode())) == role
        assert role_of(ssl.PEM_cert_to_DER_cert(text)) == role
