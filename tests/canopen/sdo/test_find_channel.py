"""Further SDO servers of a node on their own channels, and `block="auto"`."""

from __future__ import annotations

import pytest

from barewire.canopen import Channel, SdoAbort, SdoServer, download, upload
from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.sdo.client import find_channel
from barewire.conversation import play
from barewire.errors import EncodeError
from tests.canopen.sdo.sdo_bus import Bus, Store

CHANNEL = CobEntry(0x1234565, extended=True), CobEntry(0x6E5)


def test_a_second_server_has_its_own_channel() -> None:
    first, second = Store(), Store()
    words = [entry.pack().to_bytes(4, "little") for entry in CHANNEL]
    first.objects |= {(0x1201, 1): words[0], (0x1201, 2): words[1]}
    bus = Bus(SdoServer(5, first), SdoServer(5, second, cob_ids=CHANNEL))
    default = Channel(5)
    channel = bus.run(find_channel(default, 2))
    assert (channel.request_id, channel.request_extended, channel.response_id) == (0x1234565, True, 0x6E5)
    value = bytes(range(200))
    bus.run_all(download(default, 0x2100, 0, b"first"), download(channel, 0x2100, 0, value, block=True))
    assert (first.objects[0x2100, 0], second.objects[0x2100, 0]) == (b"first", value)
    assert bus.run_all(upload(channel, 0x2100, block="auto"), upload(default, 0x2100)) == [value, b"first"]
    assert play(find_channel(default, 1), lambda frame, now: [])[0] is default


def test_a_server_that_is_missing_or_not_in_use() -> None:
    store = Store()
    bus = Bus(SdoServer(5, store))
    with pytest.raises(SdoAbort, match="1201h:01: 0602 0000h"):
        bus.run(find_channel(Channel(5), 2))
    store.objects |= {(0x1201, 1): bytes.fromhex("00000080"), (0x1201, 2): bytes.fromhex("00000080")}
    with pytest.raises(EncodeError, match="SDO server 2 of node 5 is not in use"):
        bus.run(find_channel(Channel(5), 2))
    with pytest.raises(EncodeError, match=r"expected 1\.\.128"):
        find_channel(Channel(5), 129)


# block="auto"


def test_auto_requests_blocks_for_long_values() -> None:
    store, channel = Store(), Channel(5)
    bus = Bus(SdoServer(5, store))
    for length, first in ((4, "C 23"), (28, "C 21"), (29, "C C6")):
        bus.log.clear()
        bus.run(download(channel, 0x2100, 0, bytes(length), block="auto"))
        assert bus.log[0].startswith(first)
        bus.log.clear()
        assert bus.run(upload(channel, 0x2100, block="auto")) == bytes(length)
        assert bus.log[0] == "C A4 00 21 00 7F 1C 00 00"
        assert bus.log[1].startswith("S C6" if length > 28 else "S 4")
    bus.log.clear()
    bus.run(download(channel, 0x2100, 0, iter([b"some", b"thing"]), block="auto"))
    assert bus.log[0].startswith("C C4")


@pytest.mark.parametrize("downloads", [False, True])
def test_auto_requests_blocks_once_of_a_server_without_them(downloads: bool) -> None:
    store, channel = Store(), Channel(5)
    store.objects[0x2100, 0] = bytes(100)
    bus = Bus(SdoServer(5, store, blksize=0))
    for asked in (True, False):
        bus.log.clear()
        if downloads:
            bus.run(download(channel, 0x2100, 0, bytes(100), block="auto"))
        else:
            assert bus.run(upload(channel, 0x2100, block="auto")) == bytes(100)
        assert (bus.log[1][:4] == "S 80") is asked
