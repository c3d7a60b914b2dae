"""minimalmodbus: its client, RTU and ASCII, against our servers on a pseudo-terminal, and through socat on TCP. It
supports the eight functions of bits and registers."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import minimalmodbus
import pytest

from barewire.codecs import codec, to_registers
from tests.helpers import PATIENCE
from tests.interop.our_side import FullUnit, our_asyncio_server, our_server, port_of
from tests.interop.relay import serial_at
from tests.interop.services import BITS_AND_REGISTERS, proves

pytestmark = pytest.mark.needs("openssl", "socat")
CARRIERS = ("rtu", "ascii", "rtu+tcp", "ascii+tcp")
ASKED = [proves("minimalmodbus", "server", carrier, *BITS_AND_REGISTERS) for carrier in CARRIERS]


@pytest.mark.parametrize("carrier", ASKED)
def test_their_client_uses_our_server(carrier: str, certificates: Path, exchanged: set[str]) -> None:
    with ExitStack() as stack:
        place, unit = stack.enter_context(our_server(carrier, certificates, exchanged))
        path = stack.enter_context(serial_at(port_of(place))) if "tcp" in carrier else place
        read_and_write(path, carrier.partition("+")[0], unit)


@pytest.mark.parametrize("carrier", ASKED[:2])
def test_their_client_uses_our_asyncio_server(carrier: str, exchanged: set[str]) -> None:
    with our_asyncio_server(carrier, exchanged) as (path, unit):
        read_and_write(path, carrier, unit)


def read_and_write(path: str, mode: str, unit: FullUnit) -> None:
    client = minimalmodbus.Instrument(path, 1, mode=mode)
    try:
        client.serial.baudrate = 115200
        client.serial.timeout = PATIENCE
        client.write_register(1, 4711)
        client.write_register(2, 0xBEEF, functioncode=6)
        assert client.read_register(1) == 4711
        assert client.read_register(2) == 0xBEEF
        client.write_registers(3, list(range(123)))
        assert client.read_registers(2, 125) == [0xBEEF, *range(123), 0]
        assert client.read_register(4, functioncode=4) == 1234
        client.write_bit(9, 1)
        client.write_bits(10, [1, 0, 1] * 7)
        assert client.read_bit(9, functioncode=1) == 1
        assert client.read_bits(9, 22, functioncode=1) == [1, *[1, 0, 1] * 7]
        assert client.read_bit(6) == 1
        unit.holding_registers[20], unit.holding_registers[21] = to_registers(codec("f32").encode(1.5))
        assert client.read_float(20) == 1.5
        client.write_long(200, -5, signed=True)
        assert client.read_long(200, signed=True) == -5
        client.write_string(210, "barewire", 4)
        assert client.read_string(210, 4) == "barewire"
        client.serial.timeout = 2  # an exception is shorter than what it waits for, so it waits until the time is over
        with pytest.raises(minimalmodbus.IllegalRequestError):
            client.read_registers(9999, 2)
    finally:
        client.serial.close()
    assert list(unit.holding_registers[1:6]) == [4711, 0xBEEF, 0, 1, 2]
