"""The SDO channels of a device, as its objects 1200h to 12FFh configure them."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, Channel, Entry, LocalNode, ObjectDictionary, SdoAbort, download, upload
from barewire.canopen.communication_objects import standard_objects
from barewire.canopen.device.services import client_channel
from barewire.canopen.sdo.client import find_channel
from barewire.errors import EncodeError
from tests.canopen.virtual_bus import VirtualBus
from tests.helpers import every_case

OFF = 1 << 31


def device(*channels: tuple[int, int, int, int]) -> LocalNode:
    """Return node 5 with records (index, COB-ID, COB-ID, node)."""
    words = [
        Entry(index, sub, f"{index:04X}h:{sub}", "u8" if sub == 3 else "u32", "rw", word)
        for index, *rest in channels
        for sub, word in enumerate(rest, start=1)
    ]
    return LocalNode(
        5,
        ObjectDictionary(
            [
                *standard_objects(),
                Entry(0x1200, 1, "COB-ID client -> server", "u32", "ro", 0x600),
                Entry(0x1200, 2, "COB-ID server -> client", "u32", "ro", 0x580),
                Entry(0x2100, 0, "anything", "domain", "rw", bytes(range(200))),
                *words,
            ]
        ),
    )


def on_bus(node: LocalNode) -> VirtualBus:
    bus = VirtualBus()
    bus.add(node, sent=node.start(0.0))
    return bus


def feed(node: LocalNode, text: str, now: float = 0.0) -> list[str]:
    return [str(frame) for frame in node.feed(CanFrame.parse(text), now)]


def test_every_server_of_the_dictionary_answers_on_its_channel() -> None:
    node = device((0x1201, 0x6A0, 0x6A1, 7), (0x1207, 0x20000685, 0x20000585, 8))
    bus = on_bus(node)
    default = Channel(5)
    value = bytes(range(200))
    for number in (2, 8):
        channel = bus.run(find_channel(default, number))
        for block in (False, True):
            assert bus.run(upload(channel, 0x2100, block=block)) == value
            bus.run(download(channel, 0x2100, 0, value, block=block))
    assert sorted(node.channels.servers) == [2, 8]
    assert node.channels.servers[8].response_extended
    assert any(text.startswith("00000585#") for _, text in bus.log)
    assert bus.run(upload(default, 0x1200, 1)) == (0x605).to_bytes(4, "little")


def test_two_transfers_at_once_on_two_channels() -> None:
    node = device((0x1201, 0x6A0, 0x6A1, 7))
    node.start(0.0)
    assert feed(node, "605#4000210000000000") == ["585#41002100C8000000"]
    assert feed(node, "6A0#4000210000000000") == ["6A1#41002100C8000000"]
    assert feed(node, "605#6000000000000000") == ["585#0000010203040506"]
    assert feed(node, "6A0#6000000000000000") == ["6A1#0000010203040506"]
    assert feed(node, "6A0#8000210000000000") == []
    assert feed(node, "605#7000000000000000") == ["585#100708090A0B0C0D"]
    assert node.deadline == 1.0
    assert [str(frame) for frame in node.feed(None, 1.0)] == ["585#8000210000000405"]


def test_a_transfer_of_an_additional_server_times_out() -> None:
    node = device((0x1201, 0x6A0, 0x6A1, 7))
    node.start(0.0)
    feed(node, "6A0#4000210000000000", 0.5)
    assert node.deadline == 1.5
    assert [str(frame) for frame in node.feed(None, 1.5)] == ["6A1#8000210000000405"]
    assert node.deadline is None


def test_a_channel_is_switched_on_off_and_changed_by_sdo() -> None:
    node = device((0x1201, OFF, OFF, 0))
    bus = on_bus(node)
    default = Channel(5)

    def write(sub: int, word: int) -> None:
        bus.run(download(default, 0x1201, sub, word.to_bytes(1 if sub == 3 else 4, "little")))

    with pytest.raises(EncodeError, match="not in use"):
        bus.run(find_channel(default, 2))
    for word in (0, 0x601, 0x581, 0x701, 0x7F):  # zero is NMT's
        with pytest.raises(SdoAbort, match="0609 0030h"):
            write(1, word)
    write(1, 0x6A0)
    assert node.channels.servers == {}
    write(2, 0x6A1)
    write(3, 9)
    with pytest.raises(SdoAbort, match="1201h:03: 0609 0030h"):
        write(3, 128)
    channel = bus.run(find_channel(default, 2))
    assert bus.run(upload(channel, 0x1201, 3)) == b"\x09"
    with pytest.raises(SdoAbort, match="1201h:01: 0609 0030h"):
        write(1, 0x6A2)
    # A channel may switch itself off; the confirmation is its last frame.
    bus.run(download(channel, 0x1201, 1, (OFF | 0x6A0).to_bytes(4, "little")))
    assert node.channels.servers == {}
    assert feed(node, "6A0#4000210000000000", bus.now) == []
    write(1, 0x6A4)
    assert feed(node, "6A4#4001120300000000", bus.now) == ["6A1#4F01120309000000"]


def test_states_and_resets_affect_all_servers() -> None:
    node = device((0x1201, 0x6A0, 0x6A1, 7))
    assert feed(node, "6A0#4000210000000000") == []
    node.start(0.0)
    assert feed(node, "6A0#4000210000000000") == ["6A1#41002100C8000000"]
    assert feed(node, "000#0205") == []
    assert feed(node, "6A0#6000000000000000") == []
    feed(node, "000#8005")
    assert feed(node, "6A0#6000000000000000") == ["6A1#8000000001000405"]  # the transfer is gone
    feed(node, "605#2301120100000080")
    assert feed(node, "6A0#4000210000000000") == []
    assert feed(node, "000#8205") == ["705#00"]
    assert feed(node, "6A0#4000210000000000") == ["6A1#41002100C8000000"]


def test_the_channel_of_an_sdo_client() -> None:
    node = device((0x1201, 0x6A0, 0x6A1, 7))
    ours = ObjectDictionary(
        [Entry(0x1283, sub, "client", "u32", "rw", word) for sub, word in ((1, 0x6A0), (2, 0x6A1), (3, 5))]
    )
    channel = client_channel(ours, 4)
    assert on_bus(node).run(upload(channel, 0x2100)) == bytes(range(200))
    ours.set(0x1283, 2, OFF | 0x6A1)
    for client in (1, 4):
        with pytest.raises(EncodeError, match=f"SDO client {client} is not in use"):
            client_channel(ours, client)
    with pytest.raises(EncodeError, match=r"SDO client 129: expected 1\.\.128"):
        client_channel(ours, 129)


@every_case("words", [(0, 0), (0x6A0, 0x07F), (0x101, 0x6A1), (0x705, 0x6A1), (0x6A0, 0x7E5)])
def test_a_channel_with_a_restricted_cob_id_is_not_in_use(words: tuple[int, int]) -> None:
    """A description without a DefaultValue has COB-ID 0: the server would answer NMT commands, and on 000h."""
    node = device((0x1201, *words, 7))
    bus = on_bus(node)
    assert node.channels.servers == {}
    assert feed(node, f"{words[0]:03X}#4000210000000000", bus.now) == []
    with pytest.raises(
        EncodeError, match="SDO server 2 of node 5 is not in use: 1201h has bit 31 set or a restricted COB"
    ):
        bus.run(find_channel(Channel(5), 2))
    ours = ObjectDictionary(
        [Entry(0x1280, sub, "client", "u32", "rw", word) for sub, word in enumerate(words, start=1)]
    )
    with pytest.raises(
        EncodeError, match="SDO client 1 is not in use: 1280h is missing, or has bit 31 set or a restricted"
    ):
        client_channel(ours)


def test_a_channel_may_have_restricted_identifiers_from_581h_to_6ffh() -> None:
    """A master has the default channel of a node in 1280h, and some devices have 640h + node, 5C0h + node in 1201h."""
    node = device((0x1201, 0x645, 0x5C5, 7))
    bus = on_bus(node)
    assert bus.run(upload(bus.run(find_channel(Channel(5), 2)), 0x2100)) == bytes(range(200))
    ours = ObjectDictionary([Entry(0x1280, sub, "client", "u32", "rw", word) for sub, word in ((1, 0x605), (2, 0x585))])
    assert client_channel(ours).request_id == 0x605


def test_standard_objects_with_three_servers() -> None:
    node = LocalNode(5, ObjectDictionary(standard_objects(servers=3)))
    bus = on_bus(node)
    default = Channel(5)
    for sub, word in ((1, 0x6A0), (2, 0x6A1)):
        bus.run(download(default, 0x1202, sub, word.to_bytes(4, "little")))
    channel = bus.run(find_channel(default, 3))
    assert bus.run(upload(channel, 0x1200, 2)) == (0x585).to_bytes(4, "little")
    with pytest.raises(EncodeError, match="SDO server 2 of node 5 is not in use"):
        bus.run(find_channel(default, 2))
    with pytest.raises(SdoAbort, match="0602 0000h"):
        bus.run(find_channel(default, 4))


def test_a_restricted_identifier_is_accepted_only_for_a_service_that_is_off() -> None:
    node = device()
    node.start(0.0)
    assert feed(node, "605#2314100000000080") == ["585#6014100000000000"]
    assert feed(node, "605#2314100000000000") == ["585#8014100030000906"]
    assert feed(node, "605#2314100085000000") == ["585#6014100000000000"]
    assert feed(node, "605#2305100000000000") == ["585#8005100030000906"]  # the device receives SYNC in any case
    assert feed(node, "605#2305100081000000") == ["585#6005100000000000"]
