"""crc16, lrc, rtu-timing; the frames of the three envelopes, each delivered in every way.

A valid frame is fed to its line whole, byte by byte, cut at every place, twice without a gap, and after noise. Every
byte that is fed is reported in exactly one frame or noise event, or is still held.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import barewire.ascii
import barewire.rtu
import barewire.tcp
from barewire.ascii import AsciiLine, lrc
from barewire.modbus.adu import Adu, Noise
from barewire.modbus.framing import Line
from barewire.modbus.messages.registry import measure_request, measure_response
from barewire.rtu import Timing, crc16
from barewire.rtu.crc import crc16_bit_by_bit
from barewire.rtu.line import RtuLine
from barewire.tcp import TcpLine
from tests.vectors_runner.common import Case, check, octets, refuse

LATER = 1e6
"""A time long after every time-out of a line."""

CHARACTER = 11 / 19200


def text(characters: str) -> bytes:
    """The bytes of a text of an ASCII line, one for each character."""
    return characters.encode("latin-1")


# Checksums -------------------------------------------------------------------------------------------------------


def walk(data: bytes) -> list[dict[str, Any]]:
    """The CRC step by step, as the vectors write it."""
    register, steps = 0xFFFF, []
    for byte in data:
        register ^= byte
        step: dict[str, Any] = {"byte": f"{byte:02X}", "xor": f"{register:04X}", "shifts": []}
        for _ in range(8):
            shifted_out = register & 1
            register >>= 1
            shown = f"{register:04X} {shifted_out}"
            if shifted_out:
                register ^= 0xA001
                shown += f" {register:04X}"
            step["shifts"].append(shown)
        steps.append(step)
    return steps


def wrong_places(given: Any, right: Any) -> int:
    """The number of places in which a walk differs from the right one; its structure must be the same."""
    if isinstance(right, dict):
        assert given.keys() == right.keys()
        return sum(wrong_places(given[key], value) for key, value in right.items())
    if isinstance(right, list):
        return sum(wrong_places(*pair) for pair in zip(given, right, strict=True))
    return int(given != right)


def crc(case: Case) -> None:
    """The CRC as a number and on the wire; with a walk, every step of it.

    An invalid case has exactly one error: in the number or, if it has a walk, in one step of the walk.
    """
    data = octets(case["bytes"])
    given, right, steps = int(case["crc"], 16), crc16(data), walk(data)
    assert right == crc16_bit_by_bit(data)
    assert octets(case["wire"]) == given.to_bytes(2, "little"), "`crc` and `wire` agree, also in a wrong case"
    wrong = wrong_places(case.get("walk", steps), steps)
    if case["result"] == "valid":
        assert (given, wrong) == (right, 0)
        return
    assert (case["fails"], case["reason"]) == ("compare", "checksum")
    assert (given != right, wrong) == ("walk" not in case, int("walk" in case))


def lrc8(case: Case) -> None:
    """The LRC: one byte, right or wrong."""
    given = octets(case["lrc"])
    assert len(given) == 1
    if case["result"] == "valid":
        assert lrc(octets(case["bytes"])) == given[0]
        return
    assert (case["fails"], case["reason"]) == ("compare", "checksum")
    assert lrc(octets(case["bytes"])) != given[0]


def timing(case: Case) -> None:
    """Character, t1.5 and t3.5 in nanoseconds."""

    def nanoseconds() -> list[int]:
        return [round(1e9 * time) for time in Timing.of(case["baud"], case["bits"])]

    given = [case.get(name) for name in ("character_ns", "t15_ns", "t35_ns")]
    if case["result"] == "invalid":
        refuse(case, encode=nanoseconds, wire=given, decode=nanoseconds, value=given)
    else:
        assert nanoseconds() == given


# Frames ----------------------------------------------------------------------------------------------------------


def feed_pieces(line: Line, pieces: Iterable[bytes], pack: Callable[[Adu], bytes]) -> list[Adu | Noise]:
    """Feed the pieces at 19200 bit/s, then let time pass; return the events. No byte may be lost."""
    events: list[Adu | Noise] = []
    now, fed = 1.0, 0
    for piece in pieces:
        now += len(piece) * CHARACTER
        fed += len(piece)
        events += line.feed(piece, now)
    events += line.feed(None, LATER)
    out = sum(len(pack(event)) if isinstance(event, Adu) else len(event.data) for event in events)
    assert out + len(line.held) == fed
    return events


def frames(events: Iterable[Adu | Noise]) -> list[Adu]:
    """The frames among the events."""
    return [event for event in events if isinstance(event, Adu)]


def deliver(
    frame: bytes, adu: Adu, line: Callable[[], Line], pack: Callable[[Adu], bytes], *, glued: bool, noise: bytes
) -> None:
    """Assert that a frame is received in every way in which it can be delivered."""
    assert feed_pieces(line(), [frame], pack) == [adu], "whole"
    assert feed_pieces(line(), [frame[at : at + 1] for at in range(len(frame))], pack) == [adu], "byte by byte"
    for at in range(1, len(frame)):
        assert feed_pieces(line(), [frame[:at], frame[at:]], pack) == [adu], f"cut at {at}"
    if glued:
        assert feed_pieces(line(), [frame + frame], pack) == [adu, adu], "two glued together"
        if noise:
            events = feed_pieces(line(), [noise + frame], pack)
            assert frames(events) == [adu], "after noise"
            assert b"".join(event.data for event in events if isinstance(event, Noise)) == noise


def rtu_frame(case: Case) -> None:
    """unit, PDU, CRC."""
    frame = octets(case.get("frame", ""))
    adu = Adu(case["unit"], octets(case["pdu"])) if "pdu" in case else None

    def encode() -> bytes:
        return barewire.rtu.encode(case["unit"], octets(case["pdu"]))

    check(case, encode=encode, wire=frame, decode=lambda: barewire.rtu.decode(frame), value=adu)
    timing = Timing.of(19200)

    def pack(one: Adu) -> bytes:
        return barewire.rtu.encode(one.unit, one.pdu)

    if case["result"] == "valid":
        assert adu is not None
        role, measure = ("client", measure_response) if case["side"] == "response" else ("server", measure_request)

        def line(patience: float | None = 0.03) -> Line:
            return RtuLine(timing, role=role, units={adu.unit}, patience=patience)  # type: ignore[arg-type]

        countable = measure(adu.pdu) is not None
        assert countable != ("uncountable" in case.get("flags", ())) or adu.pdu[0] < 0x64
        deliver(frame, adu, line, pack, glued=countable, noise=b"\xff\x00\x07")
        assert feed_pieces(line(None), [frame], pack) == [adu]
    elif case["fails"] == "decode":
        events = feed_pieces(RtuLine(timing, patience=None), [frame], pack)
        assert not frames(events)
        assert [event.reason for event in events if isinstance(event, Noise)][:1] in ([], [case["reason"]])


def ascii_frame(case: Case) -> None:
    """Colon, digits, CR LF."""
    frame = text(case.get("text", ""))
    adu = Adu(case["unit"], octets(case["pdu"])) if "pdu" in case else None

    def encode() -> bytes:
        return barewire.ascii.encode(case["unit"], octets(case["pdu"]))

    def pack(one: Adu) -> bytes:
        return barewire.ascii.encode(one.unit, one.pdu)

    check(case, encode=encode, wire=frame, decode=lambda: barewire.ascii.decode(frame), value=adu)
    if case["result"] != "invalid":
        assert adu is not None
        deliver(frame, adu, AsciiLine, pack, glued=True, noise=b"\x00\xffzz")


def tcp_frame(case: Case) -> None:
    """MBAP header and PDU."""
    frame = octets(case.get("frame", ""))
    adu = Adu(case["unit"], octets(case["pdu"]), case["transaction"]) if "pdu" in case else None

    def encode() -> bytes:
        return barewire.tcp.encode(case["unit"], octets(case["pdu"]), case["transaction"])

    def pack(one: Adu) -> bytes:
        return barewire.tcp.encode(one.unit, one.pdu, one.transaction or 0)

    check(case, encode=encode, wire=frame, decode=lambda: barewire.tcp.decode(frame), value=adu)
    if case["result"] == "valid":
        assert adu is not None
        deliver(frame, adu, TcpLine, pack, glued=True, noise=b"")
    elif case["fails"] == "decode" and case["reason"] in ("protocol", "length"):
        events = feed_pieces(TcpLine(), [frame], pack)
        assert [event.reason for event in events if isinstance(event, Noise)] == [case["reason"]]
        assert not frames(events)
