"""The levels of characters and of CAN frames, and receivers that read them with other settings."""

from __future__ import annotations

import crcmod
import pytest
from hypothesis import given, settings, strategies as st

from barewire.canopen import CanFrame
from barewire.errors import EncodeError
from barewire_workbench.wire import (
    FORMATS,
    Arbitration,
    CharacterFormat,
    ReceiverFault,
    UartLine,
    arbitrate,
    can_bits,
    can_crc15,
    character_levels,
    longest_can_frame,
)

quick = settings(max_examples=60, deadline=None, derandomize=True, database=None)
FORMS = st.builds(CharacterFormat, st.sampled_from([7, 8]), st.sampled_from("NEO"), st.sampled_from([1, 2]))


@pytest.mark.parametrize(
    ("text", "byte", "levels"),
    [
        ("8N1", 0x55, "0 10101010 1"),
        ("8E1", 0x07, "0 11100000 1 1"),
        ("8O1", 0x07, "0 11100000 0 1"),
        ("8N2", 0x80, "0 00000001 11"),
        ("7E1", 0x3A, "0 0101110 0 1"),
    ],
)
def test_a_character_is_start_data_parity_and_stop(text: str, byte: int, levels: str) -> None:
    form = CharacterFormat.parse(text)
    assert character_levels(byte, form) == tuple(int(level) for level in levels.replace(" ", ""))
    assert form.bits == len(levels.replace(" ", ""))
    assert str(form) == text


@pytest.mark.parametrize("text", ["", "8X1", "9N1", "8N3", "8N", "8N1 8N1"])
def test_other_formats_are_refused(text: str) -> None:
    with pytest.raises(EncodeError, match="expected data bits, parity and stop bits"):
        CharacterFormat.parse(text)


@quick
@given(FORMS, st.binary(max_size=12))
def test_a_receiver_with_the_same_settings_reads_what_was_sent(form: CharacterFormat, sent: bytes) -> None:
    sent = bytes(byte & (1 << form.data_bits) - 1 for byte in sent)
    assert UartLine(form, ReceiverFault()).read(sent) == sent


@pytest.mark.parametrize(
    ("fault", "heard"),
    [
        (ReceiverFault(faster=2), "06 1E 00 00 00 98 80 66 E6 F8"),
        (ReceiverFault(inverted=True), "7F 7E FF FF EB 75 19"),
    ],
)
def test_a_wrong_setting_makes_other_bytes_of_a_frame(fault: ReceiverFault, heard: str) -> None:
    assert UartLine(FORMATS[0], fault).read(bytes.fromhex("01 03 00 00 00 0A C5 CD")) == bytes.fromhex(heard)


@quick
@given(st.sampled_from(FORMATS), st.sampled_from([(2, 1), (3, 2), (1, 2)]), st.binary(min_size=1, max_size=4))
def test_what_was_sent_is_among_what_can_have_been_sent(
    form: CharacterFormat, ratio: tuple[int, int], sent: bytes
) -> None:
    line = UartLine(form, ReceiverFault(*ratio))
    heard, receiver, count = line.read(sent), line.idle, 0
    for byte in sent:
        ways = line.characters(receiver, heard[count:])
        assert byte in ways
        receiver, more = ways[byte]
        count += more
    assert heard[count:] == line.silence(receiver)


thorough = settings(max_examples=200, deadline=None, derandomize=True, database=None)

# crcmod has no CRC of 15 bits. The remainder by x P(x) of a message is x times the remainder by P(x).
times_x = crcmod.mkCrcFun(0xC599 << 1, initCrc=0, rev=False)

CONTENT = st.one_of(
    st.tuples(st.binary(max_size=8), st.just(False), st.just(0)),
    st.tuples(st.sampled_from([bytes(8), b"\xff" * 8, bytes.fromhex("3C" * 8)]), st.just(False), st.just(0)),
    st.tuples(st.just(b""), st.just(True), st.integers(0, 8)),
)
BASE = st.builds(lambda id, content: CanFrame(id, content[0], False, *content[1:]), st.integers(0, 0x7FF), CONTENT)
EXTENDED = st.builds(
    lambda id, content: CanFrame(id, content[0], True, *content[1:]), st.integers(0, 0x1FFF_FFFF), CONTENT
)
FRAMES = st.one_of(BASE, EXTENDED)


def frame(text: str) -> CanFrame:
    return CanFrame.parse(text)


def raw(of: CanFrame) -> str:
    """SOF to the end of the data, written down field by field."""
    remote = "1" if of.remote else "0"
    data = "".join(f"{byte:08b}" for byte in of.data)
    if of.extended:
        identifier = f"{of.id:029b}"
        return f"0{identifier[:11]}11{identifier[11:]}{remote}00{of.dlc:04b}{data}"
    return f"0{of.id:011b}{remote}00{of.dlc:04b}{data}"


def without_stuff_bits(levels: str) -> str:
    """What a receiver does: after five equal bits it drops the next one, which has to differ."""
    kept, run, place = "", "", 0
    while place < len(levels):
        bit = levels[place]
        run = run + bit if run[-1:] == bit else bit
        kept += bit
        place += 1
        if len(run) == 5:
            assert place == len(levels) or levels[place] != bit, "six equal bits"
            run = levels[place : place + 1]
            place += 1
    return kept


@given(FRAMES)
@thorough
def test_the_crc_is_that_of_crcmod(of: CanFrame) -> None:
    bits = raw(of)
    in_bytes = int(bits, 2).to_bytes((len(bits) + 7) // 8, "big")  # zeros in front do not change a CRC from 0
    assert can_bits(of).crc == times_x(in_bytes) >> 1


def test_the_crc_has_the_check_value_of_the_catalogue() -> None:
    assert can_crc15(int(bit) for byte in b"123456789" for bit in f"{byte:08b}") == 0x059E


@given(FRAMES)
@thorough
def test_a_receiver_reads_the_fields_from_the_bits(of: CanFrame) -> None:
    sent = can_bits(of)
    expected = f"{raw(of)}{sent.crc:015b}"
    assert without_stuff_bits(sent.levels[:-10]) == expected
    assert sent.levels[-10:] == "1" + "0" + "1" + "1111111"
    assert "".join(str(bit.level) for bit in sent.bits if not bit.is_stuff) == expected + sent.levels[-10:]
    assert "".join(field.levels for field in sent.fields) == expected + sent.levels[-10:]
    names = [bit.field for bit in sent.bits if not bit.is_stuff]
    assert names == [field.name for field in sent.fields for _ in range(field.width)]
    assert sent.stuff_count == len(sent.bits) - len(expected) - 10


@given(FRAMES)
@thorough
def test_no_frame_is_longer_than_the_limit(of: CanFrame) -> None:
    assert len(can_bits(of).bits) <= longest_can_frame(len(of.data), extended=of.extended)


def test_the_limit_is_the_one_of_the_literature() -> None:
    """Davis, Burns, Bril and Lukkien 2007: 135 bits for 8 bytes, 160 with the long identifier, 3 of them silence."""
    assert longest_can_frame(8) + 3 == 135
    assert longest_can_frame(8, extended=True) + 3 == 160
    assert longest_can_frame(0) == 44 + 8


@pytest.mark.parametrize(
    ("text", "first"),
    [
        ("078#01E1E1E1E1E1E1E1", "00000" + "1" + "1111" + "0" + "000" + "0" + "1" + "00" + "1000"),
        ("000#", "00000" + "1" + "00000" + "1" + "00"),
        ("7FF#", "0" + "11111" + "0" + "11111" + "0" + "1"),
        ("41F#00", "0" + "1" + "00000" + "1" + "1111" + "0" + "1" + "00000" + "1" + "01"),
        ("7EF#R2", "0" + "11111" + "0" + "10" + "1111" + "1" + "0" + "0"),
    ],
)
def test_stuff_bits_by_hand(text: str, first: str) -> None:
    """Identifiers of the conformance test ISO 16845, 8.1.6, stuffed by hand."""
    assert can_bits(frame(text)).levels.startswith(first)


def test_a_stuff_bit_counts_for_the_next_five() -> None:
    levels = can_bits(frame("078#01E1E1E1E1E1E1E1")).bits
    stuffed = [place for place, bit in enumerate(levels) if bit.is_stuff]
    assert stuffed[:2] == [5, 10], "00000 [1] 1111 [0]: the inserted 1 is the first of five"


def test_a_stuff_bit_may_follow_the_last_bit_of_the_crc() -> None:
    bits = next(
        sent.bits
        for number in range(0x800)
        if (sent := can_bits(CanFrame(number))).levels[:-10].endswith("000001") and sent.crc & 0x1F == 0
    )
    assert bits[-11].is_stuff
    assert bits[-11].field == "CRC"
    assert bits[-10].field == "CRC delimiter"


def test_the_ack_slot_is_recessive_without_a_receiver() -> None:
    alone, heard = can_bits(frame("605#40"), acknowledged=False), can_bits(frame("605#40"))
    differing = [place for place, pair in enumerate(zip(alone.bits, heard.bits)) if pair[0] != pair[1]]
    assert [alone.bits[place].field for place in differing] == ["ACK slot"]
    assert alone.bits[differing[0]].level == 1


def test_the_duration_is_bits_over_rate() -> None:
    sent = can_bits(frame("000#"))
    assert sent.duration(125_000) == 50 / 125_000
    for rate in (0, -1, float("nan"), 1_000_001):
        with pytest.raises(EncodeError, match=r"expected 1\.\.1000000 bit/s"):
            sent.duration(rate)


def test_a_frame_that_can_cannot_carry_is_refused() -> None:
    for wrong in (CanFrame(0x800), CanFrame(1, bytes(9)), CanFrame(1, b"1", remote=True), CanFrame(1, requested=1)):
        with pytest.raises(EncodeError):
            can_bits(wrong)


# Arbitration ------------------------------------------------------------------------------------------------------


@given(st.lists(st.integers(0, 0x7FF), min_size=1, max_size=6, unique=True))
@thorough
def test_the_lowest_identifier_wins(identifiers: list[int]) -> None:
    outcome = arbitrate([can_bits(CanFrame(identifier, b"1")) for identifier in identifiers])
    assert outcome.winner == identifiers.index(min(identifiers))
    assert outcome.collision is None
    assert [place for place, at in enumerate(outcome.lost_at) if at is None] == [outcome.winner]


@given(FRAMES, FRAMES)
@thorough
def test_the_loser_sent_recessive_and_read_dominant(one: CanFrame, two: CanFrame) -> None:
    both = [can_bits(one), can_bits(two)]
    outcome = arbitrate(both)
    if outcome.winner is None:
        assert (one.key, one.remote) == (two.key, two.remote)
        assert outcome.collision is not None
        assert both[0].levels[: outcome.collision] == both[1].levels[: outcome.collision]
        return
    lost = outcome.lost_at[1 - outcome.winner]
    if lost is None:
        assert one == two
        return
    loser, winner = both[1 - outcome.winner], both[outcome.winner]
    assert loser.levels[:lost] == winner.levels[:lost]
    assert (loser.levels[lost], winner.levels[lost]) == ("1", "0")
    assert loser.bits[lost].part == "arbitration"


@pytest.mark.parametrize(
    ("first", "second", "outcome"),
    [
        ("705#05", "605#40", Arbitration(1, (3, None))),
        ("123#", "123#R", Arbitration(0, (None, 12))),  # data before remote, at RTR
        ("123#R", "048C0000#", Arbitration(0, (None, 13))),  # base before extended, at IDE
        ("123#00", "123#01", Arbitration(None, (None, None), 28)),  # a bit error in the last data bit
        ("123#R1", "123#R2", Arbitration(None, (None, None), 17)),
        ("123#00", "123#00", Arbitration(0, (None, None))),
    ],
)
def test_who_loses_where(first: str, second: str, outcome: Arbitration) -> None:
    assert arbitrate([can_bits(frame(first)), can_bits(frame(second))]) == outcome


def test_arbitration_needs_a_frame() -> None:
    with pytest.raises(EncodeError, match="expected one or more"):
        arbitrate([])
