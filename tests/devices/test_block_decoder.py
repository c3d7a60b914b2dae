"""A block read by one struct call gives what reading its parameters one by one gives, for every machine."""

from __future__ import annotations

import random

import pytest

from barewire.devices import load
from barewire.devices.block_decoder import block_decoder
from barewire.devices.plan import PlannedRead, plan_reads


def one_by_one(block: PlannedRead, content: list[int]) -> dict[str, object]:
    found: dict[str, object] = {}
    for parameter, offset in block.members:
        if block.table in ("coil", "discrete"):
            found[parameter.name] = bool(content[offset])
        else:
            assert parameter.modbus is not None
            found[parameter.name] = parameter.from_registers(content[offset : offset + parameter.modbus.words])
    return found


@pytest.mark.parametrize("name", ["az3", "adxl", "csd-mt"])
def test_all_at_once_is_one_by_one(name: str) -> None:
    device = load(name)
    readable = [parameter for parameter in device.parameters if parameter.readable and parameter.modbus]
    blocks = plan_reads(device, readable)
    assert blocks
    dice = random.Random(1)
    for block in blocks:
        for _ in range(5):
            top = 1 if block.table in ("coil", "discrete") else 0xFFFF
            content = [dice.randint(0, top) for _ in range(block.quantity)]
            found, expected = block_decoder(block)(content), one_by_one(block, content)
            assert found.keys() == expected.keys()
            for key, value in expected.items():
                same = found[key] == value or (value != value and found[key] != found[key])  # not-a-number
                assert same, key
                assert type(found[key]) is type(value), key
