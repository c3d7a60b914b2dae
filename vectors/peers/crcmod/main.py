"""crcmod as an adapter: the CRC of Modbus as its catalogue of checksums has it."""

from __future__ import annotations

from adapter import checksums, serve
from crcmod.predefined import PredefinedCrc


def crc(data: bytes) -> bytes:
    sum16 = PredefinedCrc("modbus")
    sum16.update(data)
    return sum16.crcValue.to_bytes(2, "little")


serve("crcmod", checksums(crc))
