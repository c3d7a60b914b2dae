"""The conformance cases of Modbus servers, as data: three batteries, for TCP, RTU and ASCII, for any server.

    ANYWHERE      for every framing: the rules and figures of the application protocol
    CASES_TCP     ANYWHERE, and MBAP headers (for TLS and UDP too)
    CASES_RTU     ANYWHERE, and a line with other units, noise and damaged frames
    CASES_ASCII   as CASES_RTU, but with colons, digits and line ends

The unit under test needs registers and coils 0 to 9 that can be read and written. Nothing else is required:
exception 01 is an accepted answer to every optional function.

Depends on: model. Used by: io.modbus.conformance, `barewire conform`, docs/conform.md.
"""

from __future__ import annotations

from barewire.modbus.adu import BROADCAST
from barewire.modbus.conformance.model import CLOSED, SILENCE, ServerCase, ServerStep, Stimulus


def _pdu(text: str, unit: int | None = None) -> Stimulus:
    return Stimulus(bytes.fromhex(text), unit)


def _raw(text: str) -> Stimulus:
    return Stimulus(raw=bytes.fromhex(text))


def _single(name: str, clause: str, request: str, *answers: str) -> ServerCase:
    """Return a case of one request, with each response that is accepted."""
    return ServerCase(name, clause, (ServerStep((_pdu(request),)),), tuple((answer,) for answer in answers))


_READ_PDU, _VALUE = "03 0000 0001", "03 02 .. .."
_READ = ServerStep((_pdu(_READ_PDU),))
_SET = "06 0000 1234"
_ECHO = "06 00 00 12 34"
_DISCARDED = ((SILENCE, _VALUE), (CLOSED, _VALUE))

ANYWHERE: tuple[ServerCase, ...] = (
    _single("03 with quantity 0", "MB-APP 6.3", "03 0000 0000", "83 03"),
    _single("03 with quantity 126", "MB-APP 6.3", "03 0000 007E", "83 03"),
    _single("01 with quantity 0", "MB-APP 6.1", "01 0000 0000", "81 03"),
    _single("01 with quantity 2001", "MB-APP 6.1", "01 0000 07D1", "81 03"),
    _single("03 over the end of all addresses is 02", "MB-APP figure 13", "03 FFFF 0002", "83 02"),
    _single("03 with a bad address and quantity 0 is 03", "MB-APP figure 13", "03 FFFF 0000", "83 03"),
    _single("05 with 1234h, neither on nor off", "MB-APP 6.5", "05 0000 1234", "85 03"),
    _single("0F with 1969 coils", "MB-APP 6.11", "0F 0000 07B1 F7" + "00" * 247, "8F 03"),
    _single("0F with a byte count that does not fit", "MB-APP figure 21", "0F 0000 0009 01 FF", "8F 03"),
    _single("10 with a byte count that does not fit", "MB-APP figure 22", "10 0000 0001 04 0001 0002", "90 03"),
    _single("08 with sub-function 99h", "MB-APP figure 18", "08 0099 0000", "88 01"),
    _single("08/0B bus message count, if it has diagnostics", "MB-APP 6.8", "08 000B 0000", "88 01", "08 00 0B .. .."),
    ServerCase(
        "08/04 listen only: silence from then on, until 08/01",
        "MB-APP 6.8",
        (ServerStep((_pdu("08 0004 0000"),)), _READ, ServerStep((_pdu("08 0001 0000"),)), _READ),
        (("88 01", _VALUE, "88 01", _VALUE), (SILENCE, SILENCE, SILENCE, _VALUE)),
    ),
    ServerCase(
        "16 keeps the bits that the AND mask keeps",
        "MB-APP 6.16",
        (ServerStep((_pdu(_SET),)), ServerStep((_pdu("16 0000 00F2 0025"),)), _READ),
        ((_ECHO, "16 00 00 00 F2 00 25", "03 02 00 35"), (_ECHO, "96 01", "03 02 12 34")),
    ),
    ServerCase(
        "17 writes before it reads",
        "MB-APP 6.17",
        (ServerStep((_pdu(_SET),)), ServerStep((_pdu("17 0000 0001 0000 0001 02 ABCD"),))),
        ((_ECHO, "17 02 AB CD"), (_ECHO, "97 01")),
    ),
    _single("17 with 126 to read", "MB-APP 6.17", "17 0000 007E 0000 0001 02 0001", "97 03", "97 01"),
    _single("2B/0E with read code 05", "MB-APP 6.21", "2B 0E 05 00", "AB 03", "AB 01"),
    _single("2B/0E with read code 00", "MB-APP 6.21", "2B 0E 00 00", "AB 03", "AB 01"),
    _single("2B/0D, which is rarely implemented", "MB-APP 6.19", "2B 0D 00 1F 1005 00 0000 0008", "AB 01", "AB FF ..."),
    _single("40h, an undefined function", "MB-APP figure 9", "40 00", "C0 01"),
)
"""For every server."""


def _cut_short(otherwise: str) -> tuple[ServerCase, ...]:
    """Return cases of requests that end too early, in a valid frame. Accepted are exception 03 and `otherwise`."""
    return (
        _single("10 cut short", "MB-APP figure 22", "10 0000 0002 04 0001", "90 03", otherwise),
        _single("03 cut short", "MB-APP figure 13", "03 0000", "83 03", otherwise),
    )


CASES_TCP: tuple[ServerCase, ...] = (
    *ANYWHERE,
    *_cut_short(CLOSED),
    _single("80h is not a function", "MB-APP 4.1", "80 00", SILENCE, CLOSED, "80 01"),
    ServerCase(
        "five requests in one segment",
        "MB-TCP 4.4.2",
        (ServerStep((_pdu(_READ_PDU),) * 5),),
        (("; ".join([_VALUE] * 5),),),
    ),
    ServerCase(
        "another protocol identifier is discarded",
        "MB-TCP 4.4.2",
        (ServerStep((_raw("0009 0001 0006 01 03 0000 0001"),)), _READ),
        _DISCARDED,
    ),
    ServerCase(
        "length 0", "MB-TCP 3.1.3", (ServerStep((_raw("0009 0000 0000"),)), _READ), (*_DISCARDED, (SILENCE, CLOSED))
    ),
    ServerCase(
        "length 1", "MB-TCP 3.1.3", (ServerStep((_raw("0009 0000 0001 01"),)), _READ), (*_DISCARDED, (SILENCE, CLOSED))
    ),
    *(
        ServerCase(
            f"unit {unit}, if it is unknown",
            "MB-TCP 4.4.2",
            (ServerStep((_pdu(_READ_PDU, unit),)),),
            ((_VALUE,), ("83 0A",), ("83 0B",), (SILENCE,)),
        )
        for unit in (0, 255)
    ),
)
"""For a server on TCP, TLS or UDP."""

_OTHER, _UNKNOWN = 2, 77


def _first_four(frame: bytes) -> bytes:
    return frame[:4]


def _wrong_crc(frame: bytes) -> bytes:
    return frame[:-1] + bytes((frame[-1] ^ 0x10,))


_LINE: tuple[ServerCase, ...] = (
    ServerCase(
        "a broadcast is carried out and not answered",
        "MB-SERIAL 2.1",
        (ServerStep((_pdu(_SET),)), ServerStep((_pdu("06 0000 0055", BROADCAST),)), ServerStep(_READ.stimuli, 0.3)),
        ((_ECHO, SILENCE, "03 02 00 55"),),
    ),
    ServerCase(
        "a request to an unknown unit is not answered",
        "MB-SERIAL 2.2",
        (ServerStep((_pdu(_READ_PDU, _UNKNOWN),)), _READ),
        ((SILENCE, _VALUE),),
    ),
    ServerCase(
        "another unit's request and its answer, then a read",
        "MB-SERIAL 2.4.1",
        (
            ServerStep((_pdu(_READ_PDU, _OTHER),)),
            ServerStep((_pdu("03 02 1234", _OTHER),), 0.02),
            ServerStep(_READ.stimuli, 0.02),
        ),
        ((SILENCE, SILENCE, _VALUE),),
    ),
    ServerCase(
        "another unit's function 10 and its answer, then a read",
        "MB-SERIAL 2.4.1",
        (
            ServerStep((_pdu("10 0000 0002 04 0001 0002", _OTHER),)),
            ServerStep((_pdu("10 0000 0002", _OTHER),), 0.02),
            ServerStep(_READ.stimuli, 0.02),
        ),
        ((SILENCE, SILENCE, _VALUE),),
    ),
    ServerCase(
        "half a frame, 300 ms, a good one",
        "MB-SERIAL 2.5.1.1",
        (ServerStep((Stimulus(bytes.fromhex(_READ_PDU), change=_first_four),)), ServerStep(_READ.stimuli, 0.3)),
        ((SILENCE, _VALUE),),
    ),
    ServerCase(
        "three bytes of noise, 300 ms, a good one",
        "MB-SERIAL 2.5.1.1",
        (ServerStep((_raw("FF 00 55"),)), ServerStep(_READ.stimuli, 0.3)),
        ((SILENCE, _VALUE),),
    ),
    ServerCase(
        "noise right before a frame damages at most that frame",
        "MB-SERIAL 2.5.1.1",
        (ServerStep((_raw("FF 00 55"), _pdu(_READ_PDU))), ServerStep(_READ.stimuli, 0.3)),
        ((_VALUE, _VALUE), (SILENCE, _VALUE)),
    ),
    _single("41h, an undefined function", "MB-APP figure 9", "41 00", "C1 01"),
)
"""For a server on a serial line with other units."""

CASES_RTU: tuple[ServerCase, ...] = (
    *_LINE,
    ServerCase(
        "a wrong CRC is not answered",
        "MB-SERIAL 2.5.1.2",
        (ServerStep((Stimulus(bytes.fromhex(_READ_PDU), change=_wrong_crc),)), ServerStep(_READ.stimuli, 0.3)),
        ((SILENCE, _VALUE),),
    ),
    ServerCase(
        "300 bytes without a pause are not a frame",
        "MB-SERIAL 2.5.1.1",
        (ServerStep((Stimulus(raw=b"\x41" * 300),)), ServerStep(_READ.stimuli, 0.3)),
        ((SILENCE, _VALUE),),
    ),
    *ANYWHERE,
    *_cut_short(SILENCE),
)
"""For an RTU server."""


def _changed(name: str, change: str, *first: str) -> ServerCase:
    """Return a case of a read with changed characters, then a valid read. `first` are the answers to the former."""
    steps = (ServerStep((Stimulus(bytes.fromhex(_READ_PDU), change=_CHANGES[change]),)), ServerStep(_READ.stimuli, 0.1))
    return ServerCase(name, "MB-SERIAL 2.5.2.1", steps, tuple((answer, _VALUE) for answer in first or (SILENCE,)))


_CHANGES = {
    "wrong LRC": lambda frame: frame[:-3] + (b"0" if frame[-3:-2] != b"0" else b"1") + frame[-2:],
    "lower case": lambda frame: frame.lower(),
    "no colon": lambda frame: frame[1:],
    "no CR": lambda frame: frame[:-2] + b"\n",
    "not a digit": lambda frame: frame[:4] + b"G" + frame[5:],
    "a digit less": lambda frame: frame[:4] + frame[5:],
    "twice": lambda frame: frame[:9] + frame,
    "semicolon": lambda frame: frame[:-1] + b";",
}
_SEMICOLON = _CHANGES["semicolon"]

CASES_ASCII: tuple[ServerCase, ...] = (
    *_LINE,
    _changed("a wrong LRC is not answered", "wrong LRC"),
    _changed("lower-case digits: answered or not, and the next one is", "lower case", _VALUE, SILENCE),
    _changed("no colon, no frame", "no colon"),
    _changed("LF without CR does not end a frame", "no CR"),
    _changed("a G is not a digit", "not a digit"),
    _changed("a byte with one digit", "a digit less"),
    _changed("a colon inside a frame begins it anew", "twice", _VALUE),
    ServerCase(
        "a frame of more than 513 characters is ignored",
        "MB-SERIAL 2.5.2.1",
        (ServerStep((Stimulus(raw=b":" + b"01" * 300 + b"\r\n"),)), ServerStep(_READ.stimuli, 0.1)),
        ((SILENCE, _VALUE),),
    ),
    *ANYWHERE,
    *_cut_short(SILENCE),
    ServerCase(
        "08/03 another delimiter, if it can be changed, until 08/01",
        "MB-APP 6.8",
        (
            ServerStep((_pdu("08 0003 3B00"),)),
            ServerStep((Stimulus(bytes.fromhex(_READ_PDU), change=_SEMICOLON),)),
            ServerStep((Stimulus(bytes.fromhex("08 0001 0000"), change=_SEMICOLON),)),
            _READ,
        ),
        (("08 00 03 3B 00", _VALUE, "08 00 01 00 00", _VALUE), ("88 01", SILENCE, SILENCE, _VALUE)),
    ),
)
"""For an ASCII server."""
