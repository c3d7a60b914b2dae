"""The levels of characters on a wire, and receivers with the right and with other settings."""

from __future__ import annotations

import pytest
from hypothesis import given, settings, strategies as st

from barewire.errors import EncodeError
from barewire_workbench.wire.uart import FORMATS, CharacterFormat, ReceiverFault, UartLine, character_levels

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
