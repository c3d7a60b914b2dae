"""Decoding a block with one struct call gives the values that its parameters decode one by one, for every machine."""

from __future__ import annotations

import random

import pytest

from barewire.devices import load, names
from barewire.devices.modbus_access import PlannedRead, block_decoder, plan_reads


def one_by_one(block: PlannedRead, content: list[int]) -> dict[str, object]:
    found: dict[str, object] = {}
    for parameter, offset in block.members:
        if block.table in ("coil", "discrete"):
            found[parameter.name] = bool(content[offset])
        else:
            assert parameter.modbus is not None
            found[parameter.name] = parameter.from_registers(content[offset : offset + parameter.modbus.words])
    return found


@pytest.mark.parametrize("device_name", names())
def test_a_block_is_decoded_like_its_parameters_one_by_one(device_name: str) -> None:
    device = load(device_name)
    readable = [parameter for parameter in device.parameters if parameter.readable and parameter.modbus]
    blocks = plan_reads(device, readable)
    assert blocks
    random_numbers = random.Random(1)
    for block in blocks:
        for _ in range(5):
            top = 1 if block.table in ("coil", "discrete") else 0xFFFF
            content = [random_numbers.randint(0, top) for _ in range(block.quantity)]
            expected = one_by_one(block, content)
            found = dict(zip(expected, block_decoder(block)(content), strict=True))
            for name, value in expected.items():
                same = found[name] == value or (value != value and found[name] != found[name])  # not-a-number
                assert same, name
                assert type(found[name]) is type(value), name
