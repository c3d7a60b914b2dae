"""What is wrong with characters that are not a good ASCII frame.

Its checksum has 8 bits and does not locate a fault: each change of a character by some amount is repaired by the same
change of any other. So a wrong digit is only found where a character is no digit at all, or where one is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from barewire.ascii.frame import DIGITS, END, START, lrc
from barewire.rtu.crc import crc16
from barewire_workbench.diagnosis.good import digits, good_ascii, good_rtu, good_tcp, missing, proof_of
from barewire_workbench.diagnosis.rtu import Trial, digits_as_text, first_findings, seven_bit
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.modbus import explain_ascii
from barewire_workbench.frames.result import Explanation, FrameRole, counted

_SHOWN = 20
"""So many characters of noise are in the text of a finding."""

_MOST = 1200
"""Characters: longer input is a recording."""


def diagnose_ascii(data: bytes, role: FrameRole | None = None) -> list[Finding]:
    """Return what is wrong with characters that should be one ASCII frame, the likeliest first.

    >>> for finding in diagnose_ascii(b":01040FB1000290\\r\\n"):
    ...     print(finding.code, finding.text, finding.proof.partition(";")[0], sep="\\n")
    lrc-over-characters
    the LRC was computed over the characters; it belongs over the bytes that they encode
    90 is the LRC of the characters '01040FB10002'
    """
    if not data or len(data) > _MOST or explain_ascii(data, role).valid:
        return []
    return first_findings(_TRIALS, data, role)


def _digits_alone(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    yield from digits_as_text(data, role) if b":" not in data else ()


def _other_role(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    if role is not None and (good := good_ascii(data)) is not None:
        yield Finding("role", f"this is a {good.role}, not a {role}", proof_of(data, good))


def _other_framing(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    if (good := good_rtu(data, role)) is not None:
        yield Finding("rtu-on-ascii", "an RTU frame: the device is set to Modbus RTU", proof_of(data, good))
    if (good := good_tcp(data, role)) is not None:
        yield Finding("mbap-on-serial", "a Modbus TCP frame, with its header and without an LRC", proof_of(data, good))


def _frames_inside(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Find good frames, each from ':' to CR LF or to the next ':', with other characters around them."""
    found: list[tuple[int, bytes, Explanation]] = []
    at = data.find(START)
    while at >= 0:
        following = data.find(START, at + 1)
        end = data.find(END, at, following if following >= 0 else None)
        frame = data[at : end + 2 if end >= 0 else following if following >= 0 else len(data)].rstrip(b"\r\n")
        frame += data[at + len(frame) : at + len(frame) + 2].replace(b"\r\n", b"\r\n")[: 2 if end >= 0 else 0]
        if (good := good_ascii(frame, role)) is not None:
            found.append((at, frame, good))
        at = following
    if not found or found[0][1].rstrip(END) == data.rstrip(END):
        return
    first, last = found[0][0], found[-1][0] + len(found[-1][1])
    proof = "; ".join(proof_of(frame, good) for _, frame, good in found)
    if len(found) > 1:
        yield Finding("two-frames", f"{counted(len(found), 'frame')} one behind the other", proof)
    if first:
        yield Finding(
            "noise-before", f"{counted(first, 'character')} before the frame: {_clipped(data[:first])}", proof
        )
    if data[last:].strip(b"\r\n"):
        text = f"{counted(len(data) - last, 'character')} behind the frame: {_clipped(data[last:])}"
        yield Finding("noise-after", text, proof)


def _clipped(noise: bytes) -> str:
    return repr(noise if len(noise) <= _SHOWN else noise[:_SHOWN] + b"...")


def _digits_of(data: bytes) -> bytes:
    """Return the characters between ':' and CR LF; one of them may be missing."""
    return data.removesuffix(END).removeprefix(START)


def _good_body(body: bytes, role: FrameRole | None) -> tuple[str, str] | None:
    """Return the LRC and the summary of unit and PDU if they are a message."""
    right = f"{lrc(body):02X}"
    good = good_ascii(START + body.hex().upper().encode() + right.encode() + END, role)
    return None if good is None else (right, good.summary.replace("; LRC ok", ""))


def _bytes_of(text: bytes) -> bytes | None:
    is_hex = len(text) % 2 == 0 and not text.translate(None, DIGITS)
    return bytes.fromhex(text.decode("ascii")) if is_hex else None


def _checksum(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    text = _digits_of(data)
    encoded = _bytes_of(text)
    if encoded is None or len(encoded) < 3:
        return
    if (fits := _good_body(encoded[:-1], role)) is not None:
        right, summary = fits
        characters = text[:-2]
        for over in (characters, START + characters):
            for value, is_sum in ((lrc(over), False), (sum(over) & 0xFF, True)):
                if encoded[-1] == value:
                    what = "sum" if is_sum else "LRC"
                    proof = (
                        f"{value:02X} is the {what} of the characters {over.decode()!r}; with {right} it is {summary}"
                    )
                    said = "the LRC was computed over the characters; it belongs over the bytes that they encode"
                    yield Finding("lrc-over-characters", said, proof)
        for name, compute in _KINDS.items():
            if encoded[-1] == compute(encoded[:-1]):
                proof = f"{encoded[-1]:02X} is the {name} of {digits(encoded[:-1])}; with {right} it is {summary}"
                yield Finding("lrc-kind", f"the checksum is the {name} of the bytes, not the LRC", proof)
    if (fits := _good_body(encoded[:-2], role)) is not None and crc16(encoded) == 0:
        proof = f"{digits(encoded[-2:])} is the CRC of {digits(encoded[:-2])}; with the LRC {fits[0]} it is {fits[1]}"
        yield Finding("lrc-kind", "the checksum is the CRC of Modbus RTU, not an LRC", proof)


_KINDS: dict[str, Callable[[bytes], int]] = {
    "plain sum": lambda data: sum(data) & 0xFF,
    "one's complement of the sum": lambda data: ~sum(data) & 0xFF,
    "exclusive or": lambda data: _exclusive_or(data),
}


def _exclusive_or(data: bytes) -> int:
    result = 0
    for byte in data:
        result ^= byte
    return result


def _delimiter(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """A frame without its first character, without its end, or with half of it."""
    if data[-1:] not in (b"\r", b"\n") and (good := good_ascii(data, role)) is not None:
        yield Finding("cut-frame", f"the end of a {good.role} is missing: CR LF is to come", proof_of(data, good))
    if data[:1] != START and (good := good_ascii(START + data, role)) is not None:
        yield Finding("byte-lost", "the ':' at the start is missing", proof_of(START + data, good))
    if data[-1:] in (b"\r", b"\n") and data[-2:] != END:
        frame = data[:-1] + END
        if (good := good_ascii(frame, role)) is not None:
            lost = "LF" if data[-1:] == b"\r" else "CR"
            yield Finding("byte-lost", f"the {lost} at the end is missing", proof_of(frame, good))
    size = next((at for at, character in enumerate(data) if at and character not in DIGITS), len(data))
    frame, tail = data[:size] + END, data[size:]
    if (good := good_ascii(frame, role)) is not None:
        shown = repr(tail.decode("latin-1"))
        if len(tail) == 2 and sum((is_ ^ was).bit_count() for is_, was in zip(tail, END)) == 1:
            yield Finding("bit-flip", f"one bit of the end is wrong: {shown} instead of CR LF", proof_of(frame, good))
        elif len(tail) == 3 and tail[:1] + tail[2:] == END:
            text = f"character {size + 1}, {chr(tail[1])!r}, is too many, between CR and LF"
            yield Finding("byte-extra", text, proof_of(frame, good))


def _wrong_character(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """One character that is not a digit: another one takes its place, or none."""
    text = _digits_of(data)
    wrong = [place for place, character in enumerate(text) if character not in DIGITS]
    if len(wrong) != 1:
        return
    at, shift = wrong[0], int(data[:1] == START)
    shown = repr(chr(text[at]))
    without = START + text[:at] + text[at + 1 :] + END
    if (good := good_ascii(without, role)) is not None:
        yield Finding("byte-extra", f"character {at + shift}, {shown}, is too many", proof_of(without, good))
    for digit in b"0123456789ABCDEF":
        change = digit ^ text[at]
        frame = START + text[:at] + bytes((digit,)) + text[at + 1 :] + END
        if change.bit_count() == 1 and (good := good_ascii(frame, role)) is not None:
            bit = f"bit {change.bit_length() - 1} of character {at + shift}"
            yield Finding("bit-flip", f"{bit} is wrong: {shown} instead of {chr(digit)!r}", proof_of(frame, good))


def _odd_digits(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """An odd number of digits: one is missing or too many. Mostly several places fit."""
    text = _digits_of(data)
    if not len(text) % 2 or text.translate(None, DIGITS):
        return
    shorter = {START + text[:at] + text[at + 1 :] + END for at in range(len(text))}
    longer = {
        START + text[:at] + bytes((digit,)) + text[at:] + END
        for at in range(len(text) + 1)
        for digit in b"0123456789ABCDEF"
    }
    for code, frames, said in (
        ("byte-extra", shorter, "a character is too many"),
        ("byte-lost", longer, "a character is missing"),
    ):
        fits = [(frame, good) for frame in sorted(frames) if (good := good_ascii(frame, role)) is not None]
        if fits:
            many = f"for example, of {len(fits)} frames that fit: " if len(fits) > 1 else ""
            text_of = f"{said}: there are {len(text)} digits, an odd number"
            yield Finding(code, text_of, many + proof_of(*fits[0]))  # type: ignore[arg-type]


def _length(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    text = _digits_of(data)
    encoded = _bytes_of(text[: len(text) - len(text) % 2])
    if data[:1] != START or encoded is None:
        return
    if len(text) % 2 == 0 and (fits := _good_body(encoded, role)) is not None:
        yield Finding("crc-missing", "the LRC is missing", f"with {fits[0]} it is {fits[1]}")
        return
    for rest in missing(encoded, 1, role) if not data.endswith(END) else ():
        shown = data.decode("latin-1").replace("\r", "\\r").replace("\n", "\\n")
        yield Finding("cut-frame", rest.text("digit", per_byte=2, less=len(text) % 2), f"{shown} ...")


_TRIALS: tuple[tuple[Trial, ...], ...] = (
    (_other_role, seven_bit, _other_framing),
    (_frames_inside,),
    (_checksum, _delimiter),
    (_wrong_character,),
    (_odd_digits,),
    (_length,),
    (_digits_alone,),
)
