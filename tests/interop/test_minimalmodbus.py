"""minimalmodbus as a stranger: its client, RTU and ASCII, against our server on a pseudo-terminal."""

from __future__ import annotations

import minimalmodbus
import pytest

from barewire.codecs import codec, to_registers
from barewire.modbus import Table
from barewire.shells import open_host


@pytest.mark.parametrize("mode", ["rtu", "ascii"])
def test_their_client_uses_our_server(mode: str) -> None:
    table = Table()
    table.holding_registers[20], table.holding_registers[21] = to_registers(codec("f32").encode(1.5))
    with open_host(f"{mode}://pty?baudrate=115200&parity=N", units={7: table}) as host:
        path = host.url.partition("://")[2].partition("?")[0]
        client = minimalmodbus.Instrument(path, 7, mode=mode)
        client.serial.baudrate = 115200
        client.serial.timeout = 2
        try:
            client.write_register(1, 4711)
            assert client.read_register(1) == 4711
            client.write_registers(2, [1, 2, 3])
            assert client.read_registers(2, 3) == [1, 2, 3]
            client.write_bit(9, 1)
            assert client.read_bit(9, functioncode=1) == 1
            assert client.read_float(20) == 1.5
            client.write_long(30, -5, signed=True)
            assert client.read_long(30, signed=True) == -5
            with pytest.raises(minimalmodbus.IllegalRequestError):
                client.read_registers(65535, 2)
        finally:
            client.serial.close()
