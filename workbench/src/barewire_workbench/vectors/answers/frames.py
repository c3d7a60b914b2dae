"""Answers for the checksums, the timing of RTU, and the frames of the three envelopes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import barewire.ascii
import barewire.rtu
import barewire.tcp
from barewire.ascii import AsciiLine, lrc
from barewire.modbus.adu import Adu, Noise
from barewire.modbus.framing import Line
from barewire.modbus.server.authorization import role_in
from barewire.rtu import Timing, crc16
from barewire.rtu.line import RtuLine
from barewire.tcp import TcpLine
from barewire_workbench.vectors.answers.texts import hexed, latin, octets
from barewire_workbench.vectors.questions import Fields

_LATER = 1e6
"""A time long after every time-out of a line."""
_CHARACTER = 11 / 19200


def role(given: Fields) -> Fields:
    """Return the role in the extensions of a certificate."""
    return {"role": role_in(octets(given["extensions"]))}


def crc(given: Fields) -> Fields:
    """Return the CRC as a number and on the wire."""
    value = crc16(octets(given["bytes"]))
    return {"crc": f"{value:04X}", "wire": hexed(value.to_bytes(2, "little"))}


def walk(given: Fields) -> Fields:
    """Return the CRC step by step: for each byte the register after the XOR, then each of the eight shifts."""
    register, steps = 0xFFFF, []
    for byte in octets(given["bytes"]):
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
    return {"walk": steps}


def lrc8(given: Fields) -> Fields:
    """Return the LRC."""
    return {"lrc": f"{lrc(octets(given['bytes'])):02X}"}


def timing(given: Fields) -> Fields:
    """Return the times of a character, t1.5 and t3.5 in nanoseconds."""
    times = Timing.of(given["baud"], given["bits"])
    return dict(zip(("character_ns", "t15_ns", "t35_ns"), (round(1e9 * time) for time in times)))


def encode_rtu(given: Fields) -> Fields:
    """Encode an RTU frame."""
    return {"frame": hexed(barewire.rtu.encode(given["unit"], octets(given["pdu"])))}


def encode_ascii(given: Fields) -> Fields:
    """Encode an ASCII frame."""
    return {"text": barewire.ascii.encode(given["unit"], octets(given["pdu"])).decode("latin-1")}


def encode_tcp(given: Fields) -> Fields:
    """Encode a TCP frame."""
    return {"frame": hexed(barewire.tcp.encode(given["unit"], octets(given["pdu"]), given["transaction"]))}


def decode_rtu(given: Fields) -> Fields:
    """Decode an RTU frame."""
    return adu_fields(barewire.rtu.decode(octets(given["frame"])))


def decode_ascii(given: Fields) -> Fields:
    """Decode an ASCII frame."""
    return adu_fields(barewire.ascii.decode(latin(given["text"])))


def decode_tcp(given: Fields) -> Fields:
    """Decode a TCP frame."""
    return adu_fields(barewire.tcp.decode(octets(given["frame"])))


def adu_fields(adu: Adu) -> Fields:
    """Return a frame as the vectors write it."""
    fields = {"unit": adu.unit, "pdu": hexed(adu.pdu)}
    return fields if adu.transaction is None else {"transaction": adu.transaction, **fields}


def receive_rtu(given: Fields) -> Fields:
    """Receive the pieces of a delivery with a patient receiver."""
    role: Any = "client" if given["side"] == "response" else "server"
    line = RtuLine(Timing.of(19200), role=role, units={given["unit"]}, patience=0.03)
    return _received(line, given["pieces"], octets, barewire.rtu.encode)


def receive_ascii(given: Fields) -> Fields:
    """Receive the pieces of a delivery."""
    return _received(AsciiLine(), given["pieces"], latin, barewire.ascii.encode)


def receive_tcp(given: Fields) -> Fields:
    """Receive the pieces of a delivery."""
    return _received(TcpLine(), given["pieces"], octets, lambda unit, pdu: barewire.tcp.encode(unit, pdu, 0))


def _received(
    line: Line, pieces: Iterable[str], read: Callable[[str], bytes], pack: Callable[[int, bytes], bytes]
) -> Fields:
    """Feed the pieces at 19200 bit/s, then let time pass; return the frames. No byte may be lost."""
    events: list[Adu | Noise] = []
    now, fed = 1.0, 0
    for piece in map(read, pieces):
        now += len(piece) * _CHARACTER
        fed += len(piece)
        events += line.feed(piece, now)
    events += line.feed(None, _LATER)
    frames = [event for event in events if isinstance(event, Adu)]
    noise = sum(len(event.data) for event in events if isinstance(event, Noise))
    out = noise + len(line.held) + sum(len(pack(adu.unit, adu.pdu)) for adu in frames)
    return {"frames": [adu_fields(adu) for adu in frames], "bytes_lost": fed - out}
