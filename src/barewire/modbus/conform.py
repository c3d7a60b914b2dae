"""What every server must do, as data: a battery of cases to be held against ours, and against anybody's.

    Case    a name, the clause, what is said turn by turn, and the ways in which it may go
    Turn    after a pause, some frames at once: PDUs to the unit under test or to another one, or raw bytes
    way     for each turn one answer as text: "83 03", with .. for a byte that may be anything, "; " between several
            answers, SILENCE, or CLOSED

Whoever runs a case puts the PDUs into the envelope, says them, and collects what comes back before it is silent; where
the peer hung up it opens the next connection for the next turn. `wrong` compares. The unit under test has registers and
coils 0 to 9 that can be read and written, and no diagnostics is expected of it on TCP.

I know: what is said and what may be answered.  I never know: envelopes, ports, clocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from barewire.modbus.adu import BROADCAST, Adu

SILENCE, CLOSED = "", "closed"


class Say(NamedTuple):
    """One frame: a PDU to a unit (None: the one under test), only its first bytes where `first` says so; or raw bytes
    that are no frame."""

    pdu: bytes = b""
    unit: int | None = None
    first: int | None = None
    raw: bytes = b""


class Turn(NamedTuple):
    """What is said at once, after so many seconds of silence."""

    says: tuple[Say, ...]
    after: float = 0.0


class Case(NamedTuple):
    """One case: `ways` are the accepted ones, each with an answer for each turn."""

    name: str
    clause: str
    turns: tuple[Turn, ...]
    ways: tuple[tuple[str, ...], ...]


Heard = Sequence[Adu] | None
"""What came back in one turn; None if the peer hung up."""


def wrong(case: Case, heard: Sequence[Heard], unit: int) -> str | None:
    """None if the peer did as the standard says, the difference as a sentence otherwise.

    >>> case = CASES_TCP[0]
    >>> wrong(case, [[Adu(1, bytes.fromhex("8303"), 1)]], unit=1)
    >>> wrong(case, [[Adu(1, bytes.fromhex("8001"), 1)]], unit=1)
    '03 with quantity 0: 80 01, expected 83 03'
    """
    told = [shown(one) for one in heard]
    if any(len(way) == len(told) and all(map(_fits, way, told)) for way in case.ways):
        strangers = {adu.unit for answers in heard for adu in answers or ()} - _asked(case, unit)
        return f"{case.name}: an answer from unit {min(strangers)}" if strangers else None
    expected = " or ".join(dict.fromkeys(", then ".join(one or "silence" for one in way) for way in case.ways))
    return f"{case.name}: {', then '.join(one or 'silence' for one in told)}, expected {expected}"


def shown(heard: Heard) -> str:
    """What was heard in the words of a way."""
    return CLOSED if heard is None else "; ".join(adu.pdu.hex(" ").upper() for adu in heard)


def _fits(expected: str, told: str) -> bool:
    wanted, found = expected.split(), told.split()
    if wanted[-1:] == ["..."]:
        wanted, found = wanted[:-1], found[: len(wanted) - 1]
    return len(wanted) == len(found) and all(
        one == other or one.rstrip(";") == ".." for one, other in zip(wanted, found)
    )


def _asked(case: Case, unit: int) -> set[int]:
    says = [say for turn in case.turns for say in turn.says]
    return {unit if say.unit is None else say.unit for say in says if say.pdu}


def _pdu(text: str, unit: int | None = None) -> Say:
    return Say(bytes.fromhex(text), unit)


def _raw(text: str) -> Say:
    return Say(raw=bytes.fromhex(text))


def _one(name: str, clause: str, request: str, *answers: str) -> Case:
    """One request, and what may be answered."""
    return Case(name, clause, (Turn((_pdu(request),)),), tuple((answer,) for answer in answers))


READ, VALUE = "03 0000 0001", "03 02 .. .."
_READ = Turn((_pdu(READ),))
_TIDY = "06 0000 1234"
_ECHO = "06 00 00 12 34"
_DISCARDED = ((SILENCE, VALUE), (CLOSED, VALUE))

CASES_TCP: tuple[Case, ...] = (
    _one("03 with quantity 0", "MB-APP 6.3", "03 0000 0000", "83 03"),
    _one("03 with quantity 126", "MB-APP 6.3", "03 0000 007E", "83 03"),
    _one("01 with quantity 0", "MB-APP 6.1", "01 0000 0000", "81 03"),
    _one("01 with quantity 2001", "MB-APP 6.1", "01 0000 07D1", "81 03"),
    _one("03 over the end of all addresses is 02", "MB-APP figure 13", "03 FFFF 0002", "83 02"),
    _one("03 with a bad address and quantity 0 is 03", "MB-APP figure 13", "03 FFFF 0000", "83 03"),
    _one("05 with 1234h, neither on nor off", "MB-APP 6.5", "05 0000 1234", "85 03"),
    _one("0F with 1969 coils", "MB-APP 6.11", "0F 0000 07B1 F7" + "00" * 247, "8F 03"),
    _one("0F with a byte count that does not fit", "MB-APP figure 21", "0F 0000 0009 01 FF", "8F 03"),
    _one("10 with a byte count that does not fit", "MB-APP figure 22", "10 0000 0001 04 0001 0002", "90 03"),
    _one("10 cut short", "MB-APP figure 22", "10 0000 0002 04 0001", "90 03", CLOSED),
    _one("03 cut short", "MB-APP figure 13", "03 0000", "83 03", CLOSED),
    _one("08 with sub-function 99h", "MB-APP figure 18", "08 0099 0000", "88 01"),
    _one("08/0B bus message count, if it has diagnostics", "MB-APP 6.8", "08 000B 0000", "88 01", "08 00 0B .. .."),
    Case(
        "08/04 listen only: silence from then on, until 08/01",
        "MB-APP 6.8",
        (Turn((_pdu("08 0004 0000"),)), _READ, Turn((_pdu("08 0001 0000"),)), _READ),
        (("88 01", VALUE, "88 01", VALUE), (SILENCE, SILENCE, SILENCE, VALUE)),
    ),
    Case(
        "16 keeps the bits that the AND mask keeps",
        "MB-APP 6.16",
        (Turn((_pdu(_TIDY),)), Turn((_pdu("16 0000 00F2 0025"),)), _READ),
        ((_ECHO, "16 00 00 00 F2 00 25", "03 02 00 35"), (_ECHO, "96 01", "03 02 12 34")),
    ),
    Case(
        "17 writes before it reads",
        "MB-APP 6.17",
        (Turn((_pdu(_TIDY),)), Turn((_pdu("17 0000 0001 0000 0001 02 ABCD"),))),
        ((_ECHO, "17 02 AB CD"), (_ECHO, "97 01")),
    ),
    _one("17 with 126 to read", "MB-APP 6.17", "17 0000 007E 0000 0001 02 0001", "97 03", "97 01"),
    _one("2B/0E with read code 05", "MB-APP 6.21", "2B 0E 05 00", "AB 03", "AB 01"),
    _one("2B/0E with read code 00", "MB-APP 6.21", "2B 0E 00 00", "AB 03", "AB 01"),
    _one("2B/0D, which hardly anybody has", "MB-APP 6.19", "2B 0D 00 1F 1005 00 0000 0008", "AB 01", "AB FF ..."),
    _one("40h, which nobody has", "MB-APP figure 9", "40 00", "C0 01"),
    _one("80h is no function", "MB-APP 4.1", "80 00", SILENCE, CLOSED, "80 01"),
    Case(
        "five requests in one segment",
        "MB-TCP 4.4.2",
        (Turn((_pdu(READ),) * 5),),
        (("; ".join([VALUE] * 5),),),
    ),
    Case(
        "another protocol identifier is discarded",
        "MB-TCP 4.4.2",
        (Turn((_raw("0009 0001 0006 01 03 0000 0001"),)), _READ),
        _DISCARDED,
    ),
    Case("length 0", "MB-TCP 3.1.3", (Turn((_raw("0009 0000 0000"),)), _READ), (*_DISCARDED, (SILENCE, CLOSED))),
    Case("length 1", "MB-TCP 3.1.3", (Turn((_raw("0009 0000 0001 01"),)), _READ), (*_DISCARDED, (SILENCE, CLOSED))),
    *(
        Case(
            f"unit {unit}, if it is nobody",
            "MB-TCP 4.4.2",
            (Turn((_pdu(READ, unit),)),),
            ((VALUE,), ("83 0A",), ("83 0B",), (SILENCE,)),
        )
        for unit in (0, 255)
    ),
)
"""For a TCP server."""

_OTHER, _NOBODY = 2, 77

CASES_RTU: tuple[Case, ...] = (
    Case(
        "a broadcast is carried out and not answered",
        "MB-SERIAL 2.1",
        (Turn((_pdu(_TIDY),)), Turn((_pdu("06 0000 0055", BROADCAST),)), Turn(_READ.says, 0.3)),
        ((_ECHO, SILENCE, "03 02 00 55"),),
    ),
    Case(
        "a request to nobody is not answered",
        "MB-SERIAL 2.2",
        (Turn((_pdu(READ, _NOBODY),)), _READ),
        ((SILENCE, VALUE),),
    ),
    Case(
        "somebody else's request and its answer, then ours",
        "MB-SERIAL 2.4.1",
        (Turn((_pdu(READ, _OTHER),)), Turn((_pdu("03 02 1234", _OTHER),), 0.02), Turn(_READ.says, 0.02)),
        ((SILENCE, SILENCE, VALUE),),
    ),
    Case(
        "somebody else's function 10 and its answer, then ours",
        "MB-SERIAL 2.4.1",
        (
            Turn((_pdu("10 0000 0002 04 0001 0002", _OTHER),)),
            Turn((_pdu("10 0000 0002", _OTHER),), 0.02),
            Turn(_READ.says, 0.02),
        ),
        ((SILENCE, SILENCE, VALUE),),
    ),
    Case(
        "half a frame, 300 ms, a good one",
        "MB-SERIAL 2.5.1.1",
        (Turn((Say(bytes.fromhex(READ), first=4),)), Turn(_READ.says, 0.3)),
        ((SILENCE, VALUE),),
    ),
    Case(
        "three bytes of noise, 300 ms, a good one",
        "MB-SERIAL 2.5.1.1",
        (Turn((_raw("FF 00 55"),)), Turn(_READ.says, 0.3)),
        ((SILENCE, VALUE),),
    ),
    Case(
        "noise right before a frame spoils no more than that one",
        "MB-SERIAL 2.5.1.1",
        (Turn((_raw("FF 00 55"), _pdu(READ))), Turn(_READ.says, 0.3)),
        ((VALUE, VALUE), (SILENCE, VALUE)),
    ),
    _one("41h, which nobody has", "MB-APP figure 9", "41 00", "C1 01"),
)
"""For an RTU server on a line with others."""
