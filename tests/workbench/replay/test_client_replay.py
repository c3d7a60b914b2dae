"""A recording played against our SDO client: its own recording has no difference, and every change of it is found."""

from __future__ import annotations

import random
import tracemalloc

import pytest

from barewire.canopen import BlockSettings, CanFrame, Channel, download, upload
from barewire.canopen.abort_codes import SdoAbort
from barewire_workbench.recordings.model import Dropped, Recorded, RecordedItem
from barewire_workbench.replay.client_replay import ClientReplay
from barewire_workbench.replay.played import Played
from tests.canopen.virtual_bus import VirtualBus
from tests.workbench.monitor.recorded_run import DRIVE, LONG, PLAIN, plain, recorded


def items_of(*texts: str) -> list[RecordedItem]:
    """Return frames that are 10 ms apart."""
    return [Recorded(n / 100, "can0", CanFrame.parse(text), n) for n, text in enumerate(texts, start=1)]


def played(items: list[RecordedItem], node: int = 5, *, timed: bool = True) -> list[Played]:
    return list(ClientReplay(node, timed=timed).play(items))


def outcomes(*texts: str) -> list[tuple[str, str, str]]:
    return [
        (one.outcome, str(one.recorded), str(one.sent)) for one in played(items_of(*texts)) if one.outcome != "same"
    ]


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("node", [DRIVE, PLAIN])
def test_a_recording_of_our_own_client_has_no_difference(node: int, timed: bool) -> None:
    items: list[RecordedItem] = [Recorded(at, "can0", frame) for at, frame in recorded()]
    replay = ClientReplay(node, timed=timed)
    found = list(replay.play(items))
    assert [one.text for one in found if one.outcome != "same"] == []
    assert replay.transfers >= 3
    assert replay.left_out == 0
    assert len(found) >= replay.transfers
    assert replay.received >= 3


@pytest.mark.parametrize("start", [0.0, 1.0, 1e9, 1e15])
def test_frames_of_one_time_are_told_apart_by_their_order(start: float) -> None:
    """A recorder may give a whole burst one time; after years a nanosecond is less than a float resolves."""
    texts = (*READ, *LAST, "605#4000100000000000", "585#4300100091010F00")
    burst = [Recorded(start, "can0", CanFrame.parse(text)) for text in texts]
    replay = ClientReplay(5)
    found = replay.play([Recorded(0.0, "can0", CanFrame.parse("705#05")), *burst])
    assert [frame.outcome for frame in found] == ["same"] * 4
    assert (replay.transfers, replay.left_out) == (2, 0)


def test_every_kind_of_transfer_is_asked_for_again() -> None:
    bus, node = VirtualBus(), plain()
    bus.add(node, sent=node.start(0.0))
    channel = Channel(PLAIN)
    for conversation in (
        upload(channel, 0x1008, 0),
        upload(channel, 0x1008, 0, block=BlockSettings(7, crc=False, switch=100)),
        download(channel, 0x2100, 0, [b"four"]),
        download(channel, 0x2100, 0, [b"of no size"], indicated=False),
        download(channel, 0x2100, 0, LONG, block=BlockSettings(crc=False)),
        upload(channel, 0x2100, 0, block=BlockSettings(3)),
        download(channel, 0x6001, 0, b"\1\0", indicated=True),
        download(channel, 0x2100, 0, [b"of no size"], indicated=False, block=True),
    ):
        bus.run(conversation)
    with pytest.raises(SdoAbort):
        bus.run(download(channel, 0x1008, 0, b"a text that is refused", block=BlockSettings(falls_back=False)))
    items: list[RecordedItem] = [Recorded(at, "can0", CanFrame.parse(text)) for at, text in bus.log]
    replay = ClientReplay(PLAIN)
    assert [one.text for one in replay.play(items) if one.outcome != "same"] == []
    assert (replay.transfers, replay.left_out) == (9, 0)


READ = ("605#4008100000000000", "585#4108100009000000", "605#6000000000000000", "585#0074686572736D6F")
LAST = ("605#7000000000000000", "585#1B6574000000000000"[:20])


def test_a_wrong_toggle_bit_of_the_recorded_client() -> None:
    assert outcomes(*READ, *LAST) == []
    (found,) = outcomes(*READ, "605#6000000000000000", LAST[1])
    assert found == ("different", "605#6000000000000000", "605#7000000000000000")


def test_a_wrong_toggle_bit_of_the_recorded_device() -> None:
    """Our client takes it for a response that came twice, waits for another, and aborts; the recorded one went on."""
    found = outcomes(*READ, LAST[0], "585#0B65740000000000", "605#4000100000000000", "585#4300100091010F00")
    assert [(outcome, sent) for outcome, _, sent in found] == [("extra", "605#8008100000000405")]


def test_an_acknowledgement_of_a_block_that_differs() -> None:
    begin = ("605#A408100014000000", "585#C608100009000000", "605#A300000000000000")
    segments = ("585#0174686572736D6F", "585#8265740000000000")
    assert outcomes(*begin, *segments, "605#A202140000000000") == []
    (found,) = outcomes(*begin, *segments, "605#A201140000000000")
    assert found == ("different", "605#A201140000000000", "605#A202140000000000")


def test_a_recorded_client_that_aborts_goes_on_here() -> None:
    first, *rest = played(items_of(*READ, "605#8008100000000008"))[2:]
    assert (first.outcome, str(first.sent), first.repeated) == ("different", "605#7000000000000000", False)
    assert first.text.startswith("recorded 605#8008100000000008 (")
    assert "; the client sends 605#7000000000000000 (" in first.text
    assert "; after 585#0074686572736D6F (" in first.text
    assert [(one.outcome, one.repeated) for one in rest] == [("extra", True)]  # its abort, since nothing answers


def test_an_unanswered_request_is_aborted_as_recorded_or_in_addition() -> None:
    after = ("605#4000100000000000", "585#4300100091010F00")
    quiet: list[RecordedItem] = [Recorded(0.0, "can0", CanFrame.parse("605#4018100100000000"))]
    later: list[RecordedItem] = [Recorded(9.0 + n / 10, "can0", CanFrame.parse(text)) for n, text in enumerate(after)]
    aborts: list[RecordedItem] = [Recorded(1.0, "can0", CanFrame.parse("605#8018100100000405"))]
    assert [one.outcome for one in played(quiet + later)] == ["same", "extra", "same"]
    assert [one.outcome for one in played(quiet + aborts + later)] == ["same", "same", "same"]
    assert [one.outcome for one in played(quiet)] == ["same"]  # the recording ends here


def test_a_size_that_is_not_what_was_sent_is_not_sent_here() -> None:
    """The recorded client announced two bytes and sent four."""
    texts = ("605#2117100002000000", "585#6017100000000000", "605#0710270000000000", "585#8017100012000706")
    found = outcomes(*texts)
    assert found[0][:2] == ("different", "605#0710270000000000")
    assert found[0][2].startswith("605#80171000")


def test_transfers_that_are_not_whole_are_left_out() -> None:
    replay = ClientReplay(5)
    lost: list[RecordedItem] = [*items_of(*READ[:3]), Dropped(0.035, "can0", 2), *items_of(*LAST)[1:]]
    middle = items_of(*READ[2:], *LAST)
    assert list(replay.play(lost)) == []
    assert list(replay.play(middle)) == []
    assert (replay.transfers, replay.left_out) == (0, 2)
    assert list(replay.play([])) == []


def test_a_request_that_our_client_never_sends_is_left_out() -> None:
    """Blocks of 0 segments."""
    replay = ClientReplay(5)
    assert list(replay.play(items_of("605#A408100000000000", "585#8008100002000405"))) == []
    assert replay.left_out == 1


def test_any_frames_are_played() -> None:
    """No sequence of frames raises, and each request is compared once or left out."""
    dice = random.Random(5)
    for _ in range(30):
        frames = [
            CanFrame(dice.choice((0x605, 0x585)), bytes([dice.choice((0x40, 0x41, 0x60, 0x21, 0xA4, 0xC6, 0x80, 0x2B))])
                     + b"\x08\x10\x00" + dice.randbytes(dice.choice((4, 4, 4, 2))))
            for _ in range(60)
        ]  # fmt: skip
        items: list[RecordedItem] = [Recorded(n / 100, "can0", frame) for n, frame in enumerate(frames)]
        requests = sum(frame.id == 0x605 for frame in frames)
        assert sum(one.recorded is not None for one in played(items)) <= requests


def test_an_announced_size_of_4_gib_takes_no_memory() -> None:
    """The recorded client announced FFFFFFFFh bytes and gave up after one segment."""
    tracemalloc.start()
    try:
        found = outcomes(
            "605#21002100FFFFFFFF",
            "585#6000210000000000",
            "605#0000000000000000",
            "585#2000000000000000",
            "605#8000210000000008",
        )
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()
    assert [sent for _, _, sent in found][:1] in ([], ["605#1000000000000000"])
