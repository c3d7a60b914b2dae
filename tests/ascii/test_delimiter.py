"""The delimiter of each unit, derived from the messages that are sent and received."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.ascii import AsciiLine, encode
from barewire.ascii.line import LF, Delimiters
from barewire.modbus import Adu, Noise
from tests.helpers import every_case, modest, unhex

CHANGE, RESTART, READ = unhex("08 0003 3B00"), unhex("08 0001 0000"), unhex("03 0000 0001")
SEMICOLON = ord(";")


def after(*passed: tuple[bytes, bool], unit: int = 1) -> Delimiters:
    """Return the delimiters after these messages of a unit, each with whether this side sent it."""
    endings = Delimiters()
    for pdu, sent in passed:
        endings.passed(unit, pdu, sent=sent)
    return endings


@pytest.mark.parametrize("directions", [(True, False), (False, True), (False, False)])
def test_a_request_and_its_response_change_the_delimiter(directions: tuple[bool, bool]) -> None:
    endings = after(*((CHANGE, sent) for sent in directions))
    assert (endings.of(1), endings.of(2), endings.accepted) == (SEMICOLON, LF, {LF, SEMICOLON})


def test_a_repeated_request_is_not_a_response() -> None:
    endings = after((CHANGE, True), (CHANGE, True))
    assert endings.of(1) == LF
    assert SEMICOLON in endings.accepted, "the unit may have changed it, and its response was lost"
    endings.passed(1, CHANGE, sent=False)
    assert endings.of(1) == SEMICOLON


def test_a_declined_request_changes_nothing() -> None:
    assert after((CHANGE, True), (unhex("88 01"), False)).accepted == {LF}
    assert after((CHANGE, True), (CHANGE, False), (RESTART, True), (unhex("88 03"), False)).of(1) == SEMICOLON


def test_another_message_in_between_is_not_the_response() -> None:
    assert after((CHANGE, True), (READ, True), (CHANGE, False)).of(1) == LF


@pytest.mark.parametrize("following", [(RESTART, False), (READ, True), (RESTART, True)])
def test_a_restart_restores_lf_with_or_without_response(following: tuple[bytes, bool]) -> None:
    endings = after((CHANGE, True), (CHANGE, False), (RESTART, True))
    assert endings.of(1) == SEMICOLON, "its response still has the old delimiter"
    endings.passed(1, following[0], sent=following[1])
    assert (endings.of(1), endings.accepted) == (LF, {LF})


def test_a_broadcast_changes_the_delimiter_of_all_units_without_response() -> None:
    endings = after((CHANGE, False), unit=0)
    assert {endings.of(unit) for unit in range(248)} == {SEMICOLON}
    endings.passed(0, RESTART, sent=False)
    assert {endings.of(unit) for unit in range(248)} == {LF}


def test_a_colon_cannot_become_the_delimiter() -> None:
    colon = unhex("08 0003 3A00")
    assert after((colon, True), (colon, False)).accepted == {LF}


@every_case("character", [c for c in range(256) if c != 0x3A])
def test_every_other_character_can_become_the_delimiter(character: int) -> None:
    line, change = AsciiLine(), bytes((8, 0, 3, character, 0))
    frame = encode(1, change)
    assert line.feed(frame * 2, 1.0) == [Adu(1, change)] * 2
    ended = encode(1, READ)[:-1] + bytes((character,))
    assert line.feed(ended, 1.1) == [Adu(1, READ)]
    assert line.request(1, READ) == ended
    assert line.request(2, READ) == encode(2, READ)


@modest
@given(st.lists(st.one_of(st.binary(max_size=12), st.sampled_from([encode(1, CHANGE), encode(1, RESTART), b":01\r;"]))))
def test_every_byte_is_accounted_for_with_any_delimiter(parts: list[bytes]) -> None:
    line, fed, reported = AsciiLine(), 0, 0
    for part in parts:
        fed += len(part)
        for event in line.feed(part, 1.0):
            reported += len(event.data) if isinstance(event, Noise) else len(encode(event.unit, event.pdu))
        assert reported + len(line.held) == fed
