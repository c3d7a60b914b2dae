"""The search for one change that makes a CRC fit, compared with trying every change."""

from __future__ import annotations

from hypothesis import given, settings, strategies as st

from barewire import rtu
from barewire.rtu.crc import crc16
from barewire_workbench.diagnosis.rtu import changed_bytes, extra_bytes, lost_bytes

quick = settings(max_examples=30, deadline=None, derandomize=True, database=None)
FRAMES = st.builds(rtu.encode, st.integers(0, 255), st.binary(min_size=1, max_size=6))


@quick
@given(st.one_of(FRAMES, st.binary(min_size=1, max_size=9)), st.data())
def test_the_search_finds_what_trying_every_change_finds(frame: bytes, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(frame) - 1))
    damaged = data.draw(st.sampled_from([frame, frame[:at] + frame[at + 1 :], frame[:at] + b"\x55" + frame[at:]]))
    places, values = range(len(damaged)), [bytes((value,)) for value in range(256)]
    without = {damaged[:at] + damaged[at + 1 :] for at in places}
    changed = {damaged[:at] + value + damaged[at + 1 :] for at in places for value in values} - {damaged}
    longer = {damaged[:at] + value + damaged[at:] for at in range(len(damaged) + 1) for value in values}
    assert {fit.frame for fit in extra_bytes(damaged)} == {frame for frame in without if not crc16(frame)}
    assert {fit.frame for fit in changed_bytes(damaged)} == {frame for frame in changed if not crc16(frame)}
    assert {fit.frame for fit in lost_bytes(damaged)} == {frame for frame in longer if not crc16(frame)}


@quick
@given(FRAMES, st.data())
def test_a_damaged_frame_is_found_again(frame: bytes, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(frame) - 1))
    bit = data.draw(st.integers(0, 7))
    flipped = bytearray(frame)
    flipped[at] ^= 1 << bit
    assert (at, frame[at], frame) in list(changed_bytes(bytes(flipped)))
    assert frame in [fit.frame for fit in lost_bytes(frame[:at] + frame[at + 1 :])]
    assert frame in [fit.frame for fit in extra_bytes(frame[:at] + b"\x99" + frame[at:])]
