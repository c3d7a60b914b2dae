"""The sender and the receiver of a block transfer, each alone, and both together with values of every length."""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Callable, Iterator

import pytest

from barewire.canopen import (
    AbortCode,
    BlockSettings,
    CanFrame,
    Channel,
    CobEntry,
    SdoAbort,
    SdoServer,
    download,
    upload,
    upload_to,
)
from barewire.conversation import Conversation, Heard, Listen, abort_frames, play
from barewire.errors import EncodeError, NoAnswer
from tests.canopen.sdo.sdo_bus import Bus, Store
from tests.helpers import every_case


def counting(length: int) -> bytes:
    return bytes(place % 256 for place in range(length))


@pytest.mark.parametrize(
    ("data", "crc"),
    [
        (b"123456789", 0x31C3),
        (b"", 0x0000),
        (bytes(40), 0x0000),
        (b"A", 0x58E5),
        (counting(7), 0xD90C),
        (b"0123456789", 0x9C58),
        (b"CANopenDemoPIC32", 0x43F3),
        (counting(256), 0x7E55),
        (counting(889), 0x0232),
        (counting(890), 0xFDFC),
        (counting(4000), 0x9438),
    ],
)
def test_the_crc_at_the_end(data: bytes, crc: int) -> None:
    bus = Bus(SdoServer(5, Store()))
    bus.run(download(5, 0x2100, 0, data, block=True))
    unused = -len(data) % 7 if data else 7
    assert bus.log[-2] == f"C {0xC1 + 4 * unused:02X} {crc & 0xFF:02X} {crc >> 8:02X} 00 00 00 00 00"
    assert crc_hqx(data, 0) == crc


@pytest.mark.parametrize("offered", [True, False])
def test_an_upload_has_a_crc_if_the_client_offers_one(offered: bool) -> None:
    store = Store()
    store.objects[0x2100, 0] = b"123456789"
    bus = Bus(SdoServer(5, store))
    assert bus.run(upload(5, 0x2100, block=BlockSettings(crc=offered))) == b"123456789"
    assert [text[:7] for text in bus.log[:2]] == ["C A4 00" if offered else "C A0 00", "S C6 00"]
    assert bus.log[-2] == f"S D5 {'C3 31' if offered else '00 00'} 00 00 00 00 00"


@every_case("block", [False, True, BlockSettings(size=3), BlockSettings(crc=False)])
@every_case("length", [*range(21), 21, 22, 889, 890, 4000])
def test_every_length_there_and_back(length: int, block: bool | BlockSettings) -> None:
    value, store, channel = counting(length), Store(), Channel(5)
    bus = Bus(SdoServer(5, store, blksize=127 if block is True else 5))
    pieces = [value[start : start + 5] for start in range(0, length, 5)]
    for data, size in ((value, None), (pieces, length), (pieces, None), (iter([b"", value, b""]), None)):
        store.objects[0x2100, 0] = b"before"
        bus.run(download(channel, 0x2100, 0, data, size=size, block=block))
        assert store.objects[0x2100, 0] == value
    parts: list[bytes] = []
    assert bus.run(upload(channel, 0x2100, block=block)) == value
    assert bus.run(upload_to(channel, 0x2100, 0, parts.append, block=block)) == length
    assert b"".join(parts) == value
    assert (channel.total.late, channel.total.garbled) == (0, 0)


def test_progress_is_reported() -> None:
    told: list[tuple[int, int | None]] = []
    store = Store()
    bus = Bus(SdoServer(5, store))
    bus.run(download(5, 0x2100, 0, counting(2000), block=True, progress=lambda *done: told.append(done)))
    assert told == [(889, 2000), (1778, 2000), (2000, 2000)]
    told.clear()
    bus.run(upload(5, 0x2100, block=True, progress=lambda *done: told.append(done)))
    assert told == [(889, 2000), (1778, 2000), (2000, 2000)]
    told.clear()
    bus.run(download(5, 0x2100, 0, [counting(10)], progress=lambda *done: told.append(done)))
    assert told == [(7, None), (10, None)]


def test_pieces_are_taken_as_they_are_sent() -> None:
    """At most one block of a long value is in memory."""
    taken = 0

    def pieces() -> Iterator[bytes]:
        nonlocal taken
        for _ in range(1000):
            taken += 100
            assert taken - confirmed() <= 889 + 200
            yield bytes(100)

    def confirmed() -> int:
        return sum(7 * int(line[5:7], 16) for line in bus.log if line.startswith("S A2"))

    bus = Bus(SdoServer(5, Store()))
    bus.run(download(5, 0x2100, 0, pieces(), block=True))
    assert taken == 100_000


@pytest.mark.parametrize("block", [False, True])
@pytest.mark.parametrize("size", [19, 21])
def test_pieces_of_another_total_than_announced_end_the_transfer(size: int, block: bool) -> None:
    store = Store()
    bus = Bus(SdoServer(5, store))
    with pytest.raises(EncodeError, match=f"{size} bytes were announced, the data"):
        bus.run(download(5, 0x2100, 0, [bytes(20)], size=size, block=block))
    assert bus.log[-1] == "C 80 00 21 00 00 00 00 08"
    assert store.writes == 0


@pytest.mark.parametrize("block", [False, True])
def test_the_client_refuses_a_value_above_its_limit(block: bool) -> None:
    store = Store()
    store.objects[0x2100, 0] = bytes(100)
    bus = Bus(SdoServer(5, store))
    with pytest.raises(SdoAbort, match="100 bytes announced, the limit is 99") as caught:
        bus.run(upload(5, 0x2100, limit=99, block=block))
    assert caught.value.code == AbortCode.OUT_OF_MEMORY
    assert bus.run(upload(5, 0x2100, limit=100, block=block)) == bytes(100)


@pytest.mark.parametrize("block", [False, True])
def test_a_sink_that_fails_ends_the_transfer(block: bool) -> None:
    def full(part: bytes) -> None:
        raise OSError("disk full")

    store, channel = Store(), Channel(5)
    store.objects[0x2100, 0] = bytes(100)
    bus = Bus(server := SdoServer(5, store))
    with pytest.raises(OSError, match="disk full"):
        bus.run(upload_to(channel, 0x2100, 0, full, block=block))
    bus.rest(0.001)
    assert (server.deadline, server.counters.aborts_received) == (None, 1)
    assert bus.run(upload(channel, 0x2101)) == b"other"


# Aborts at any step.


def turns_of(block: bool, downloads: bool) -> int:
    """Return the number of frames in a transfer of 50 bytes."""
    bus = Bus(server(Store(), downloads))
    bus.run(moving(Channel(5), block, downloads))
    return len(bus.log)


def server(store: Store, downloads: bool) -> SdoServer:
    store.objects[0x2100, 0] = b"" if downloads else bytes(50)
    return SdoServer(5, store, blksize=3)


def moving(channel: Channel, block: bool, downloads: bool) -> Conversation[CanFrame, object]:
    how = BlockSettings(size=3) if block else False
    return download(channel, 0x2100, 0, bytes(50), block=how) if downloads else upload(channel, 0x2100, block=how)


@pytest.mark.parametrize("downloads", [False, True])
@pytest.mark.parametrize("block", [False, True])
def test_an_abort_of_the_server_at_any_step(block: bool, downloads: bool) -> None:
    abort = CanFrame.parse("585#8000210000000008")
    # After the end of a block upload the client has the value, and receives no more.
    deaf = 2 if block and not downloads else 1
    for moment in range(turns_of(block, downloads) - deaf):
        store, channel = Store(), Channel(5)
        bus = Bus(server(store, downloads))

        def fault(number: int, frame: CanFrame, moment: int = moment) -> list[tuple[float, CanFrame]]:
            return [(0.0, frame), (0.0, abort)] if number == moment else [(0.0, frame)]

        bus.fault = fault
        with pytest.raises(SdoAbort) as caught:
            bus.run(moving(channel, block, downloads))
        assert (caught.value.code, caught.value.why) == (AbortCode.GENERAL, "")
        bus.rest(5.0)
        assert bus.run(upload(channel, 0x2101)) == b"other"


@pytest.mark.parametrize("downloads", [False, True])
@pytest.mark.parametrize("block", [False, True])
def test_a_client_that_is_closed_at_any_step_aborts_the_transfer(block: bool, downloads: bool) -> None:
    for moment in range(turns_of(block, downloads)):
        store, channel = Store(), Channel(5)
        bus = Bus(node := server(store, downloads))
        conversation, steps = moving(channel, block, downloads), moment
        step, now = next(conversation), 0.0
        waiting: list[CanFrame] = []
        while steps:
            heard = None
            if not isinstance(step, Listen):
                for frame in step.items[:steps]:
                    waiting += node.feed(frame, now)
                    steps -= 1
            elif waiting:
                heard = waiting.pop(0)
            else:
                now = max(now, step.until)
                waiting += node.feed(None, now)
            if steps:
                try:
                    step = conversation.send(Heard(heard, now))
                except StopIteration:
                    break
        for frame in abort_frames(conversation):
            assert frame.data.hex() == "8000210000000008"
            node.feed(frame, now)
        assert node.deadline is None or node.deadline > now
        bus.now = now + 5.0
        bus.rest(5.0)
        assert bus.run(upload(channel, 0x2101)) == b"other"


# Several channels, and a server that disappears.


def test_two_channels_transfer_at_the_same_time() -> None:
    stores = [Store(), Store()]
    bus = Bus(SdoServer(5, stores[0]), SdoServer(6, stores[1]))
    values = counting(3000), counting(2000)[::-1]
    bus.run_all(*(download(node, 0x2100, 0, value, block=True) for node, value in zip((5, 6), values)))
    assert [store.objects[0x2100, 0] for store in stores] == list(values)
    assert bus.run_all(upload(5, 0x2100, block=True), upload(6, 0x2100)) == list(values)


@pytest.mark.parametrize("block", [False, True])
def test_a_server_that_disappears_during_a_transfer(block: bool) -> None:
    store = Store()
    store.objects[0x2100, 0] = bytes(1000)
    bus = Bus(SdoServer(5, store))
    bus.fault = lambda number, frame: [(0.0, frame)] * (number < 20)
    with pytest.raises(NoAnswer, match="node 5 did not answer the upload of 2100h:00 within 1 s: received"):
        bus.run(upload(5, 0x2100, block=block))
    with pytest.raises(NoAnswer, match="no frame was received"):
        play(download(5, 0x2100, 0, bytes(10), block=block), lambda frame, now: [])


# Ports that return the frames which they send.


def returning(server: SdoServer, sent: list[CanFrame]) -> Callable[[CanFrame, float], list[tuple[float, CanFrame]]]:
    """Return a peer that delivers each frame back, then the response of the server. `sent` records the frames."""

    def peer(frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        sent.append(frame)
        return [(now, frame), *((now, response) for response in server.feed(frame, now))]

    return peer


def test_the_own_segments_that_a_port_returns_are_not_those_of_another_client() -> None:
    for own_frames in (None, True):
        store, channel, sent = Store(), Channel(5, own_frames=own_frames), list[CanFrame]()
        play(download(channel, 0x2100, 0, counting(3000), block=True), returning(SdoServer(5, store), sent))
        assert store.objects[0x2100, 0] == counting(3000)
        assert (channel.own_frames, channel.counters.rivals) == (own_frames, 0)
        assert len(channel.sent) == 0


def test_every_frame_of_a_block_download_has_the_identifier_of_its_channel() -> None:
    request, response = CobEntry(0x10605, True), CobEntry(0x10585, True)
    store, sent = Store(), list[CanFrame]()
    server = SdoServer(5, store)

    def peer(frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        sent.append(frame)
        answers = server.feed(CanFrame(0x605, frame.data), now)
        return [(now, CanFrame(0x10585, answer.data, True)) for answer in answers]

    play(download(Channel(5, cob_ids=(request, response)), 0x2100, 0, counting(300), block=True), peer)
    assert store.objects[0x2100, 0] == counting(300)
    assert {(frame.id, frame.extended) for frame in sent} == {(0x10605, True)}
