"""Many exchanges on faulty wires (`soak`): each ends in its own answer or an error."""

from __future__ import annotations

import pytest

from tests.modbus.client.soak import CARRIERS, SERIAL, TCP, soak

pytestmark = pytest.mark.long


@pytest.mark.parametrize("carrier", CARRIERS)
def test_no_answer_is_delivered_to_another_request(carrier: str) -> None:
    ends = soak(carrier, 34_000)
    assert ends["its own answer"] > 25_000
    faults = TCP if carrier == "tcp" else SERIAL
    assert all(ends[f"fault: {fault}"] > 100 for fault in faults)
    assert (ends["late answers recognised"] > 0) is (carrier != "tcp")
    assert (ends["damages that no CRC shows"] > 0) is (carrier == "rtu")
