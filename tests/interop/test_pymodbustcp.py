"""pyModbusTCP: its client against our server, our clients against its server; through socat over TLS. It supports the
functions of bits and registers, 17, and 2B/0E."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest
from pyModbusTCP.client import ModbusClient
from pyModbusTCP.server import DataBank, DeviceIdentification, ModbusServer

from barewire.modbus import ReadDeviceIdentification
from tests.helpers import free_port
from tests.interop.exchanges import Answers, exchange_all
from tests.interop.our_side import LONG, RecordingClient, client_url, our_server, port_of, with_both
from tests.interop.relay import tls_before, tls_from
from tests.interop.services import BITS_AND_REGISTERS, proves

pytestmark = pytest.mark.needs("openssl", "socat")
SUPPORTED = (*BITS_AND_REGISTERS, "17", "2B/0E")


@pytest.mark.parametrize(
    "carrier", [proves("pyModbusTCP", "server", carrier, *SUPPORTED) for carrier in ("tcp", "tls")]
)
def test_their_client_uses_our_server(carrier: str, certificates: Path, exchanged: set[str]) -> None:
    with ExitStack() as stack:
        place, unit = stack.enter_context(our_server(carrier, certificates, exchanged))
        port = port_of(place)
        if carrier == "tls":
            port = stack.enter_context(tls_from(port, certificates))
        client = ModbusClient("127.0.0.1", port, unit_id=1, timeout=2)
        stack.callback(client.close)
        pattern = [place % 3 == 0 for place in range(1968)]
        assert client.write_multiple_coils(100, pattern)
        assert client.write_single_coil(20, True)
        assert client.read_coils(100, 2000) == pattern + [False] * 32
        assert client.read_discrete_inputs(5, 3) == [False, True, False]
        assert client.write_multiple_registers(0, list(range(123)))
        assert client.write_single_register(1, 0xBEEF)
        assert client.read_holding_registers(0, 125) == [0, 0xBEEF, *range(2, 123), 0, 0]
        assert client.read_input_registers(3, 2) == [0, 1234]
        assert client.write_read_multiple_registers(5, list(range(1, 122)), 4, 3) == [4, 1, 2]
        basic = client.read_device_identification()
        assert (basic.vendor_name, basic.product_code, basic.major_minor_revision) == (b"barewire", b"table", b"1")
        first = client.read_device_identification(read_code=3)
        assert (first.more_follows, first.next_object_id) == (0xFF, 0x81)
        assert first.objects_by_id[0x80] == b"serial 42"
        assert client.read_device_identification(read_code=3, object_id=0x81).objects_by_id == {0x81: LONG.encode()}
        assert client.read_holding_registers(9999, 2) is None
        assert client.last_except == 2
    assert unit.coils[20] == 1
    assert list(unit.holding_registers[:6]) == [0, 0xBEEF, 2, 3, 4, 1]


OBJECTS = {0: b"pyModbusTCP", 1: b"bench", 2: b"0.3", 3: b"http://bench.example", 0x80: b"serial 7"}


@pytest.mark.parametrize(
    "carrier", [proves("pyModbusTCP", "client", carrier, *SUPPORTED) for carrier in ("tcp", "tls")]
)
def test_our_clients_use_their_server(carrier: str, certificates: Path, exchanged: set[str]) -> None:
    async def talk(client: RecordingClient) -> None:
        # At the higher levels it leaves out the objects of the lower ones.
        basic = {number: value for number, value in OBJECTS.items() if number < 3}
        await exchange_all(client, Answers(objects=basic, level=1), SUPPORTED)
        extended = await client.ask(ReadDeviceIdentification(3, 0))
        assert extended.objects == ((0x80, b"serial 7"),)

    port = free_port()
    bank = DataBank(coils_size=2000, d_inputs_size=10, h_regs_size=200, i_regs_size=5)
    bank.set_discrete_inputs(6, [True])
    bank.set_input_registers(4, [1234])
    about = DeviceIdentification(*list(OBJECTS.values())[:4], objects_id={0x80: OBJECTS[0x80]})
    server = ModbusServer("127.0.0.1", port, no_block=True, data_bank=bank, device_id=about)
    with ExitStack() as stack:
        server.start()
        stack.callback(server.stop)
        if carrier == "tls":
            port = stack.enter_context(tls_before(port, certificates))
        with_both(client_url(carrier, f"127.0.0.1:{port}", certificates), exchanged, talk)
