"""Many exchanges on faulty wires (`soak`): each ends in its own answer or an error."""

from __future__ import annotations

import pytest

from tests.helpers import part_or_whole
from tests.modbus.client.soak import CARRIERS, SERIAL, TCP, soak

pytestmark = pytest.mark.long


@pytest.mark.parametrize("exchanges", part_or_whole(3_400, 34_000))
@pytest.mark.parametrize("carrier", CARRIERS)
def test_no_answer_is_delivered_to_another_request(carrier: str, exchanges: int) -> None:
    ends = soak(carrier, exchanges)
    assert ends["its own answer"] > 0.7 * exchanges
    faults = TCP if carrier == "tcp" else SERIAL
    assert all(ends[f"fault: {fault}"] > exchanges // 340 for fault in faults)
    assert (ends["late answers recognised"] > 0) is (carrier != "tcp")
    assert (ends["damages that no CRC shows"] > 0) is (carrier == "rtu")
