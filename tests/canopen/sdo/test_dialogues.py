"""Long SDO transfers byte for byte: between client and server, and of each with a script."""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Callable

import pytest

from barewire.canopen import BlockSettings, CanFrame, Channel, SdoAbort, SdoServer, download, upload
from barewire.conversation import Conversation, play
from tests.canopen.sdo.sdo_bus import NAME, Bus, objects
from tests.canopen.sdo.test_client import Script


def lines(text: str) -> list[str]:
    """Return one frame a line, without trailing zeros."""
    frames = []
    for line in text.strip().splitlines():
        who, _, data = line.strip().partition(" ")
        frames.append(f"{who} {bytes.fromhex(data).ljust(8, bytes(1)).hex(' ').upper()}")
    return frames


# From the logs of a conformance test tool, or derived from the rules of the standard.
DIALOGUES: dict[str, tuple[Callable[[], Conversation[CanFrame, object]], object, str]] = {
    "write in segments": (
        lambda: download(5, 0x1017, 0, [b"\0\0"], size=2),
        None,
        """C 21 17 10 00 02
           S 60 17 10 00
           C 0B 00 00
           S 20""",
    ),
    "read in segments": (
        lambda: upload(5, 0x1008),
        NAME.encode(),
        """C 40 08 10 00
           S 41 08 10 00 10
           C 60
           S 00 43 41 4E 6F 70 65 6E
           C 70
           S 10 44 65 6D 6F 50 49 43
           C 60
           S 0B 33 32""",
    ),
    "read in blocks without CRC": (
        lambda: upload(5, 0x1000, block=BlockSettings(20, crc=False)),
        bytes.fromhex("91010F00"),
        """C A0 00 10 00 14
           S C6 00 10 00 04
           C A3
           S 81 91 01 0F 00
           C A2 01 14
           S CD
           C A1""",
    ),
    "read in blocks": (
        lambda: upload(5, 0x1008, block=BlockSettings(20)),
        NAME.encode(),
        """C A4 08 10 00 14
           S C6 08 10 00 10
           C A3
           S 01 43 41 4E 6F 70 65 6E
           S 02 44 65 6D 6F 50 49 43
           S 83 33 32
           C A2 03 14
           S D5 F3 43
           C A1""",
    ),
    "write 2 bytes in a block": (
        lambda: download(5, 0x1017, 0, b"\0\0", block=True),
        None,
        """C C6 17 10 00 02
           S A4 17 10 00 7F
           C 81
           S A2 01 7F
           C D5
           S A1""",
    ),
    "write 10 bytes in a block": (
        lambda: download(5, 0x2100, 0, b"0123456789", block=True),
        None,
        """C C6 00 21 00 0A
           S A4 00 21 00 7F
           C 01 30 31 32 33 34 35 36
           C 82 37 38 39
           S A2 02 7F
           C D1 58 9C
           S A1""",
    ),
    "write 10 bytes in a block, size not told": (
        lambda: download(5, 0x2100, 0, b"0123456789", indicated=False, block=BlockSettings(crc=False)),
        None,
        """C C0 00 21 00
           S A4 00 21 00 7F
           C 01 30 31 32 33 34 35 36
           C 82 37 38 39
           S A2 02 7F
           C D1
           S A1""",
    ),
    "write nothing in segments": (
        lambda: download(5, 0x2100, 0, b""),
        None,
        """C 21 00 21 00
           S 60 00 21 00
           C 0F
           S 20""",
    ),
    "write nothing in a block": (
        lambda: download(5, 0x2100, 0, b"", block=True),
        None,
        """C C6 00 21 00
           S A4 00 21 00 7F
           C 81
           S A2 01 7F
           C DD
           S A1""",
    ),
    "read nothing in segments": (
        lambda: upload(5, 0x2100),
        b"",
        """C 40 00 21 00
           S 41 00 21 00
           C 60
           S 0F""",
    ),
    "write 3 bytes of a size not told": (
        lambda: download(5, 0x2100, 0, b"abc", indicated=False),
        None,
        """C 20 00 21 00
           S 60 00 21 00
           C 09 61 62 63
           S 20""",
    ),
    "a short value comes in one frame, if that is allowed": (
        lambda: upload(5, 0x1000, block=BlockSettings(20, switch=4, falls_back=False)),
        bytes.fromhex("91010F00"),
        """C A4 00 10 00 14 04
           S 43 00 10 00 91 01 0F""",
    ),
    "a longer one in segments": (
        lambda: upload(5, 0x1008, block=BlockSettings(20, switch=16, falls_back=False)),
        NAME.encode(),
        """C A4 08 10 00 14 10
           S 41 08 10 00 10
           C 60
           S 00 43 41 4E 6F 70 65 6E
           C 70
           S 10 44 65 6D 6F 50 49 43
           C 60
           S 0B 33 32""",
    ),
}


@pytest.mark.parametrize("name", DIALOGUES)
def test_our_client_and_our_server(name: str) -> None:
    begin, result, text = DIALOGUES[name]
    server = SdoServer(5, objects())
    bus = Bus(server)
    assert bus.run(begin()) == result
    bus.rest(5.0)
    assert bus.log == lines(text)
    assert (server.deadline, server.counters.aborts_sent) == (None, 0)


# Servers of others --------------------------------------------------------------------------------------------------


def scripted(conversation: Conversation[CanFrame, object], *turns: tuple[str, ...]) -> tuple[object, list[str]]:
    """Return a conversation with a server that responds to each frame with the next of these."""
    script = Script()
    for request, *answers in turns:
        data = bytes.fromhex(request).ljust(8, b"\0")
        script.lines.append((str(CanFrame(0x605, data)), *map(answer, answers)))
    result, _ = play(conversation, script)
    assert not script.lines
    return result, script.sent


def answer(text: str) -> str:
    return f"585#{bytes.fromhex(text).ljust(8, bytes(1)).hex()}"


def test_a_server_that_responds_with_segments_to_a_block_request() -> None:
    turns = (("A4 08 10 00 7F", "41 08 10 00 02"), ("60", "0B 33 32"))
    assert scripted(upload(5, 0x1008, block=True), *turns)[0] == b"32"
    with pytest.raises(SdoAbort, match=r"0504 0001h .*an ordinary upload came") as caught:
        scripted(upload(5, 0x1008, block=BlockSettings(falls_back=False)), turns[0], ("80 08 10 00 01 00 04 05",))
    assert caught.value.why


@pytest.mark.parametrize(
    ("turns", "code", "why"),
    [
        ([("60", "10 01")], "00 00 03 05", "the response has toggle bit 1, the request has 0"),
        ([("60", "01 01 02 03 04 05 06 07")], "12 00 07 06", "4 bytes announced, more came"),
        ([("60", "0D 01")], "13 00 07 06", "4 bytes announced, 1 came"),
    ],
)
def test_the_client_aborts_at_protocol_violations(turns: list[tuple[str, ...]], code: str, why: str) -> None:
    channel = Channel(5)
    with pytest.raises(SdoAbort) as caught:
        scripted(upload(channel, 0x1008), ("40 08 10", "41 08 10 00 04"), *turns, (f"80 08 10 00 {code}",))
    assert caught.value.why == why
    assert str(caught.value).endswith(f", so the client ended it: {why}")
    assert channel.quiet_until is not None


def test_segments_of_unknown_size_and_doubled_responses() -> None:
    channel = Channel(5)
    turns = (
        ("40 08 10", "40 08 10"),
        ("60", "00 01 02 03 04 05 06 07", "00 01 02 03 04 05 06 07"),
        ("70", "1D 08"),
    )
    assert scripted(upload(channel, 0x1008), *turns)[0] == bytes(range(1, 9))
    assert channel.counters.late == 1


def test_a_server_that_omits_trailing_zeros() -> None:
    channel, data = Channel(5), bytes(range(1, 10))
    script = Script(
        ("605#A400210014000000", "585#C600210009000000"),
        ("605#A300000000000000", "585#0101020304050607", "585#", "585#820809"),
        ("605#A202140000000000", f"585#D5{crc_hqx(data, 0).to_bytes(2, 'little').hex()}"),
        ("605#A100000000000000",),
    )
    assert play(upload(channel, 0x2100, block=BlockSettings(20)), script)[0] == data
    assert (channel.counters.short, channel.counters.garbled) == (2, 1)


def test_a_server_that_acknowledges_at_the_first_gap() -> None:
    """If a server acknowledges before the end of the block, the sender continues after that segment, renumbered."""
    data = bytes(range(1, 29))
    turns = (
        ("C6 00 21 00 1C", "A4 00 21 00 7F"),
        ("01 01 02 03 04 05 06 07",),
        ("02 08 09 0A 0B 0C 0D 0E",),  # lost
        ("03 0F 10 11 12 13 14 15", "A2 01 02"),
        ("84 16 17 18 19 1A 1B 1C",),
        ("01 08 09 0A 0B 0C 0D 0E",),
        ("02 0F 10 11 12 13 14 15", "A2 02 7F"),
        ("81 16 17 18 19 1A 1B 1C", "A2 01 7F"),
        (f"C1 {crc_hqx(data, 0).to_bytes(2, 'little').hex()}", "A1"),
    )
    scripted(download(5, 0x2100, 0, data, block=True), *turns)
