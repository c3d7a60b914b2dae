"""A response that comes after a scan has ended is not taken for the response to the next upload of the same object."""

from __future__ import annotations

import pytest

from barewire import CanopenClient
from tests.io.canopen.virtual_can import NumberedStore, VirtualCan, value_of

DEVICE_TYPE = 0x1000


@pytest.mark.parametrize("end", ["its time is over", "its progress function raises"])
@pytest.mark.parametrize("delay", [0.15, 0.35, 0.5])
def test_a_late_device_type(delay: float, end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    can = VirtualCan(NumberedStore(4))
    can.set_clocks(monkeypatch)

    def progress(node: int, _: object) -> None:
        if node == 6 and end != "its time is over":
            raise KeyboardInterrupt

    with CanopenClient(can, node=5, timeout=0.3) as client:
        can.delay(delay)
        if end == "its time is over":
            assert list(client.scan([5], timeout=0.1, progress=progress).nodes) == []
        else:
            with pytest.raises(KeyboardInterrupt):
                client.scan([5, 6], timeout=0.1, progress=progress)
        assert client.node().sdo.upload(DEVICE_TYPE) == value_of(DEVICE_TYPE, 2, 4)
