"""Many exchanges on faulty wires (`soak`): each ends in its own answer or an error."""

from __future__ import annotations

import pytest

from tests.modbus.client.soak import CARRIERS, SERIAL, TCP, soak


@pytest.mark.parametrize("carrier", CARRIERS)
def test_no_answer_is_delivered_to_another_request(carrier: str) -> None:
    ends = soak(carrier, 34_000)
    assert ends["its own answer"] > 25_000
    faults = TCP if carrier == "tcp" else SERIAL
    assert all(ends[f"fault: {kind}"] > 100 for kind in faults)
    assert ends["late answers recognised"] > (0 if carrier != "tcp" else -1)
    assert ends["damages that no CRC shows"] > (0 if carrier == "rtu" else -1)
