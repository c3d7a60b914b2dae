"""crc16, lrc, rtu-timing; the frames of the three envelopes, each delivered every way.

A valid frame is fed to its room's line whole, byte by byte, cut at every place, twice glued together, and after
noise. Every byte that is fed comes out in exactly one frame or one noise, or is still held.
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
"""Long after every silence."""

CHARACTER = 11 / 19200


def text(characters: str) -> bytes:
    """A text of an ASCII line: one character for one byte."""
    return characters.encode("latin-1")


# Checksums -------------------------------------------------------------------------------------------------------


def walk(data: bytes) -> list[dict[str, Any]]:
    """The CRC step by step, as the vectors write it."""
    register, steps = 0xFFFF, []
    for byte in data:
        register ^= byte
        step: dict[str, Any] = {"byte": f"{byte:02X}", "xor": f"{register:04X}", "shifts": []}
        for _ in range(8):
            fell_out = register & 1
            register >>= 1
            shown = f"{register:04X} {fell_out}"
            if fell_out:
                register ^= 0xA001
                shown += f" {register:04X}"
            step["shifts"].append(shown)
        steps.append(step)
    return steps


def wrong_places(told: Any, right: Any) -> int:
    """In how many places a walk differs from the right one. It has the shape of a walk in any case."""
    if isinstance(right, dict):
        assert told.keys() == right.keys()
        return sum(wrong_places(told[key], value) for key, value in right.items())
    if isinstance(right, list):
        return sum(wrong_places(*pair) for pair in zip(told, right, strict=True))
    return int(told != right)


def crc(case: Case) -> None:
    """The CRC as a number and on the wire; with a walk, every step of it.

    An invalid case is wrong in one thing: the number, or, where a walk is told, one step of that.
    """
    data = octets(case["bytes"])
    told, right, steps = int(case["crc"], 16), crc16(data), walk(data)
    assert right == crc16_bit_by_bit(data)
    assert octets(case["wire"]) == told.to_bytes(2, "little"), "both say the same, right or wrong"
    wrong = wrong_places(case.get("walk", steps), steps)
    if case["result"] == "valid":
        assert (told, wrong) == (right, 0)
        return
    assert (case["fails"], case["reason"]) == ("compare", "checksum")
    assert (told != right, wrong) == ("walk" not in case, int("walk" in case))


def lrc8(case: Case) -> None:
    """The LRC: one byte, that of these bytes or another."""
    told = octets(case["lrc"])
    assert len(told) == 1
    if case["result"] == "valid":
        assert lrc(octets(case["bytes"])) == told[0]
        return
    assert (case["fails"], case["reason"]) == ("compare", "checksum")
    assert lrc(octets(case["bytes"])) != told[0]


def timing(case: Case) -> None:
    """Character, t1.5 and t3.5 in nanoseconds."""

    def nanoseconds() -> list[int]:
        return [round(1e9 * time) for time in Timing.of(case["baud"], case["bits"])]

    told = [case.get(name) for name in ("character_ns", "t15_ns", "t35_ns")]
    if case["result"] == "invalid":
        refuse(case, encode=nanoseconds, wire=told, decode=nanoseconds, value=told)
    else:
        assert nanoseconds() == told


# Frames ----------------------------------------------------------------------------------------------------------


def listen(line: Line, pieces: Iterable[bytes], pack: Callable[[Adu], bytes]) -> list[Adu | Noise]:
    """Feed the pieces at the speed of 19200 bit/s, then let time pass; no byte may vanish."""
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
    """Only what is a frame."""
    return [event for event in events if isinstance(event, Adu)]


def deliver(
    frame: bytes, adu: Adu, line: Callable[[], Line], pack: Callable[[Adu], bytes], *, glued: bool, noise: bytes
) -> None:
    """Every way in which a frame can come."""
    assert listen(line(), [frame], pack) == [adu], "whole"
    assert listen(line(), [frame[at : at + 1] for at in range(len(frame))], pack) == [adu], "byte by byte"
    for at in range(1, len(frame)):
        assert listen(line(), [frame[:at], frame[at:]], pack) == [adu], f"cut at {at}"
    if glued:
        assert listen(line(), [frame + frame], pack) == [adu, adu], "two glued together"
        if noise:
            events = listen(line(), [noise + frame], pack)
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
        assert listen(line(None), [frame], pack) == [adu]
    elif case["fails"] == "decode":
        events = listen(RtuLine(timing, patience=None), [frame], pack)
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
        events = listen(TcpLine(), [frame], pack)
        assert [event.reason for event in events if isinstance(event, Noise)] == [case["reason"]]
        assert not frames(events)
