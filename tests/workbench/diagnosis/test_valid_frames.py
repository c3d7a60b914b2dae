"""No false alarm: good frames have no findings, and what proves nothing has none either."""

from __future__ import annotations

import random
import time
from collections import Counter

import pytest

from barewire_workbench import explain
from tests.workbench.diagnosis.made_frames import made_frames


@pytest.mark.parametrize(("framing", "count"), [("rtu", 2000), ("ascii", 1500), ("tcp", 1500)])
def test_good_frames_have_no_findings(framing: str, count: int) -> None:
    functions = set()
    for frame, role in made_frames(framing, count, seed=20261123):
        for given in (None, role):
            explanation = explain(framing, frame, given)
            assert explanation.valid, explanation.lines()
            assert explanation.diagnosis == ()
        functions.add((explanation.fields[1 if framing == "rtu" else 2 if framing == "ascii" else 4].value, role))
    assert len(functions) > 30


@pytest.mark.parametrize("framing", ["rtu", "ascii", "tcp"])
def test_random_bytes_have_hardly_any_findings(framing: str) -> None:
    """A function code and a length fit by chance now and then, and then the bytes can be a cut frame."""
    dice, found = random.Random(1), Counter[str]()
    for _ in range(8 if framing == "rtu" else 100):
        data = dice.randbytes(dice.randint(4, 20))
        found.update(finding.code for finding in explain(framing, data).diagnosis[:1])
    assert sum(found.values()) <= 1, found


@pytest.mark.parametrize(
    ("framing", "data"),
    [
        ("rtu", b"\x01\x03" * 128),
        ("rtu", bytes(256)),
        ("rtu", b"\xaa" * 48),
        ("rtu", bytes.fromhex("01 03 00 00 00 0A C5 CE") * 32),
        ("rtu", b"\x01\x10\x00\x00\x00\x7b\xf6" + bytes(range(247)) + b"\x12\x34"),
        ("ascii", b":" + b"0" * 511 + b"\r\n"),
        ("ascii", b":01" * 171),
        ("tcp", bytes(260)),
        ("tcp", bytes.fromhex("00 00 00 00 00 02") * 43),
    ],
)
def test_the_longest_frames_are_diagnosed_in_a_moment(framing: str, data: bytes) -> None:
    begun = time.process_time()
    explain(framing, data)
    assert time.process_time() - begun < 1
