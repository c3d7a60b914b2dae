"""Good frames with one damage, made from a seed: the first finding is that damage, and its proof is the good frame."""

from __future__ import annotations

import random
import re
import sys
from collections import Counter
from collections.abc import Callable

import pytest

from barewire.rtu.crc import crc16
from barewire_workbench import explain
from barewire_workbench.wire import FORMATS, ReceiverFault, UartLine
from tests.helpers import every_case
from tests.workbench.diagnosis.made_frames import made_frames

DICE = random.Random(0)
Damage = Callable[[bytes], bytes]
FRAMES = 60


def flip(frame: bytes) -> bytes:
    at, bit = DICE.randrange(len(frame)), DICE.randrange(8)
    return frame[:at] + bytes((frame[at] ^ 1 << bit,)) + frame[at + 1 :]


def lose(frame: bytes) -> bytes:
    at = DICE.randrange(len(frame) - 1)
    return frame[:at] + frame[at + 1 :]


def insert(frame: bytes) -> bytes:
    at = DICE.randrange(1, len(frame))
    return frame[:at] + DICE.randbytes(1) + frame[at:]


def noise() -> bytes:
    return bytes(DICE.choice((0x00, 0xFF, DICE.randrange(256))) for _ in range(DICE.randint(1, 3)))


def crc(data: bytes) -> bytes:
    return crc16(data).to_bytes(2, "little")


def heard(**fault: int) -> Damage:
    return lambda frame: UartLine(DICE.choice(FORMATS[:2]), ReceiverFault(**fault)).read(frame)  # type: ignore[arg-type]


def decoded(frame: bytes) -> bytes:
    return bytes.fromhex(frame[1:-4].decode())


DAMAGES: list[tuple[str, str, float, Damage]] = [
    # framing, code, the least part of the frames that must have it first, damage
    ("rtu", "bit-flip", 0.9, flip),
    ("rtu", "byte-lost", 0.9, lose),
    ("rtu", "byte-extra", 0.9, insert),
    ("rtu", "noise-before", 0.95, lambda frame: noise() + frame),
    ("rtu", "noise-after", 0.95, lambda frame: frame + noise()),
    ("rtu", "crc-swapped", 0.95, lambda frame: frame[:-2] + frame[:-3:-1]),
    ("rtu", "crc-span", 0.95, lambda frame: frame[:-2] + crc(frame[1:-2])),
    ("rtu", "crc-kind", 0.95, lambda frame: frame[:-2] + (crc16(frame[:-2]) ^ 0xFFFF).to_bytes(2, "little")),
    ("rtu", "crc-missing", 0.95, lambda frame: frame[:-2]),
    ("rtu", "two-frames", 0.95, lambda frame: frame + frame),
    ("rtu", "mbap-on-serial", 0.95, lambda frame: b"\0\x07\0\0" + (len(frame) - 2).to_bytes(2, "big") + frame[:-2]),
    ("rtu", "inverted", 0.9, lambda frame: bytes(byte ^ 0xFF for byte in frame)),
    ("tcp", "crc-inside-mbap", 0.95, lambda frame: frame + crc(frame[6:])),
    ("tcp", "rtu-on-tcp", 0.95, lambda frame: frame[6:] + crc(frame[6:])),
    ("tcp", "header-byte-order", 0.95, lambda frame: frame[:4] + frame[5:3:-1] + frame[6:]),
    ("tcp", "mbap-header", 0.9, lambda frame: frame[:5] + bytes((frame[5] - 1,)) + frame[6:]),
    ("tcp", "mbap-missing", 0.9, lambda frame: frame[6:]),
    ("tcp", "two-frames", 0.95, lambda frame: frame + frame),
    ("tcp", "noise-before", 0.95, lambda frame: noise() + frame),
    ("tcp", "noise-after", 0.95, lambda frame: frame + noise()),
    ("ascii", "lrc-over-characters", 0.95, lambda frame: frame[:-4] + b"%02X\r\n" % (-sum(frame[1:-4]) & 0xFF)),
    ("ascii", "lrc-kind", 0.9, lambda frame: frame[:-4] + b"%02X\r\n" % (sum(decoded(frame)) & 0xFF)),
    ("ascii", "seven-bit", 0.95, lambda frame: bytes(byte | byte.bit_count() % 2 << 7 for byte in frame)),
    ("ascii", "rtu-on-ascii", 0.95, lambda frame: decoded(frame) + crc(decoded(frame))),
    ("ascii", "byte-lost", 0.8, lose),
    ("ascii", "byte-extra", 0.9, insert),
    ("ascii", "noise-before", 0.95, lambda frame: noise() + frame),
    ("ascii", "two-frames", 0.95, lambda frame: frame + frame),
]


@every_case(("framing", "code", "least", "damage"), DAMAGES)
def test_one_damage_is_the_first_finding(framing: str, code: str, least: float, damage: Damage) -> None:
    DICE.seed(f"{framing} {code}")
    found, proved = Counter[str](), 0
    for frame, _ in made_frames(framing, FRAMES // 4 if code == "crc-missing" else FRAMES, seed=11):
        explanation = explain(framing, damage(frame))
        if explanation.valid:  # the damage has made another good frame
            continue
        first = explanation.diagnosis[0] if explanation.diagnosis else None
        found[first.code if first else "none"] += 1
        shown = frame.hex(" ").upper() if framing != "ascii" else frame.decode().removesuffix("\r\n")
        proved += first is not None and shown in first.proof
    assert found[code] >= least * found.total(), found
    if framing == "rtu" and code in (
        "bit-flip",
        "byte-lost",
        "byte-extra",
        "noise-before",
        "noise-after",
        "crc-swapped",
    ):
        assert proved >= least * found.total(), (proved, found)


@pytest.mark.parametrize(("framing", "shortest"), [("rtu", 3), ("tcp", 6), ("ascii", 5)])
def test_a_cut_frame_is_one_or_lacks_its_checksum(framing: str, shortest: int) -> None:
    DICE.seed(f"{framing} cut")
    found, total = Counter[str](), 0
    for frame, _ in made_frames(framing, 20, seed=12):
        diagnosis = explain(framing, frame[: DICE.randrange(shortest, len(frame))]).diagnosis
        first = [finding.code for finding in diagnosis[:1]]
        found.update("cut-frame" if first in (["crc-missing"], ["byte-lost"]) else code for code in first)
        total += 1
    assert found["cut-frame"] >= 0.9 * total, found


REQUESTS = ["01 03 00 00 00 0A C5 CD", "01 04 0F B1 00 02 22 F8", "05 06 00 00 00 09 48 48", "01 83 02 C0 F1"]


@pytest.mark.parametrize("frame", REQUESTS)
@pytest.mark.parametrize(
    ("code", "text", "damage"),
    [
        ("baud-rate", "twice", heard(faster=2)),
        ("baud-rate", "one and a half times", heard(faster=3, slower=2)),
        ("inverted", "exchanged", heard(inverted=True)),
    ],
)
def test_a_short_frame_is_found_behind_what_a_wrong_receiver_has_read(
    frame: str, code: str, text: str, damage: Damage
) -> None:
    DICE.seed(frame)
    first = explain("rtu", damage(bytes.fromhex(frame))).diagnosis[0]
    assert (first.code, text in first.text) == (code, True), first
    assert frame in first.proof


@pytest.mark.parametrize(
    ("heard_bytes", "sent", "code"),
    [
        ("06 1E 60 00 7E E6 80 00 66 18 60 FE", "01 03 04 00 E7 0B C0 4D 64", "baud-rate"),
        ("03 3F FC E3 00 C4 C3 24 C4", "01 0F FE D9 00 52 34 25", "baud-rate"),
        ("7D DF F7 CB 8D 0A", "05 04 02 04 9A CA 5B", "inverted"),
        ("BF DF 75 FD 99 3F 19 00", "02 04 56 4C 00 33 60 73", "inverted"),
        ("CB 97 5A 84 C5 FF F9 17 4D 00", "A4 16 6B CA 2F 1D 00 03 74 59", "inverted"),
    ],
)
def test_a_frame_of_large_numbers_is_found_behind_what_a_wrong_receiver_has_read(
    heard_bytes: str, sent: str, code: str
) -> None:
    first = explain("rtu", bytes.fromhex(heard_bytes)).diagnosis[0]
    assert (first.code, sent in first.proof) == (code, True), first


WITHOUT_CRC = re.split(
    r"\s{2,}|\n",
    """
01 01 00 13 00 25           01 01 05 CD 6B B2 0E 1B     01 02 00 C4 00 16           01 02 03 AC DB 35
01 03 00 00 00 0A           01 03 04 00 00 41 C8        01 03 06 02 2B 00 00 00 64  01 04 0F B1 00 02
01 04 02 00 0A              01 05 00 AC FF 00           01 06 00 01 00 03           01 07
01 08 00 00 A5 37           01 0F 00 13 00 0A           01 0F 00 13 00 0A 02 CD 01  01 10 00 01 00 02
01 10 00 01 00 02 04 00 0A 01 02  01 16 00 04 00 F2 00 25  01 83 02
01 17 00 03 00 06 00 0E 00 03 06 00 FF 00 FF 00 FF
""".strip(),
)


def calls_of_explain(data: bytes) -> int:
    """Return how many Python functions are called to explain the bytes."""
    explain("rtu", data)  # a function is loaded when its code comes for the first time
    calls, former = Counter[str](), sys.getprofile()
    sys.setprofile(lambda frame, event, argument: calls.update((event,)))
    try:
        explain("rtu", data)
    finally:
        sys.setprofile(former)
    return calls["call"]


@every_case("frame", [*WITHOUT_CRC, "5D 01 D9 C9 04 CB"])
def test_a_frame_without_its_crc_is_explained_in_few_calls(frame: str) -> None:
    assert explain("rtu", bytes.fromhex(frame)).diagnosis[0].code == "crc-missing"
    assert calls_of_explain(bytes.fromhex(frame)) < 8000


@every_case("frame", WITHOUT_CRC)
def test_a_frame_with_a_wrong_crc_or_cut_is_explained_in_few_calls(frame: str) -> None:
    body = bytes.fromhex(frame)
    assert calls_of_explain(body + bytes(byte ^ 0x55 for byte in crc(body))) < 10_000
    assert calls_of_explain(body[:-1]) < 10_000
