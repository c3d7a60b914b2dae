"""crcmod as an adapter: the CRC of Modbus as its catalogue of checksums has it.

barewire vectors check --adapter "python vectors/peers crcmod"
"""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

from adapter import crc_fields, octets, serve
from crcmod.predefined import PredefinedCrc


def crc(question: dict[str, Any]) -> dict[str, Any]:
    sum16 = PredefinedCrc("modbus")
    sum16.update(octets(question["bytes"]))
    return crc_fields(sum16.crcValue.to_bytes(2, "little"))


serve("crcmod", version("crcmod"), {"crc16": {"encode": crc}})
