"""A hostile master configures devices in every way their objects allow; afterwards they answer and beat.

    exhaustive   each device, every letter of its whole alphabet (120 to 367 letters); the device of the EDS, every
                 sequence of two letters of its small alphabet (70 letters, 4,900 sequences; in `make proof`)
    random       sequences of three to nine letters and single writes, always the same ones

`make hostile` does more (`tools/hostile_master.py`): every sequence of two letters of the whole alphabets, and more
random ones; with `ARGS=--three` also every sequence of three letters of the small
alphabets, 750,000 of all devices: run on 2026-11-22 without a failure.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable

import pytest
from hypothesis import given, strategies as st

from barewire.canopen import CanFrame
from barewire.canopen.communication_objects import integer_value
from barewire.canopen.device.services import ErrorControl
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.pdo.engine import ActivePdo, PdoEngine
from barewire.canopen.sync import SyncProducer
from barewire.devices import load, names
from tests.helpers import part_or_whole, some_of
from tests.model.choices import run_all
from tests.model.hostile_devices import SIMULATED, masters
from tests.model.hostile_master import Letter

MASTERS = masters()


def test_every_simulated_device_with_canopen_is_tried() -> None:
    assert tuple(name for name in names() if load(name).canopen is not None) == SIMULATED


@pytest.mark.long
@pytest.mark.parametrize("name", some_of(["EDS", "az3", "EDS, all mappable"], 2))
def test_the_letters_change_the_device(name: str) -> None:
    master = MASTERS[name]()
    letters = master.letters()
    assert len(letters) >= 110
    assert run_all(master.scenario(letters, 1)) == len(letters)
    assert master.changed > 0.9 * len(letters)
    assert master.sent > 20 * len(letters)


@pytest.mark.proof
def test_every_sequence_of_two_letters() -> None:
    master = MASTERS["EDS"]()
    letters = master.letters(small=True)
    assert run_all(master.scenario(letters, 2)) == len(letters) ** 2 == 4900


@pytest.mark.long
@pytest.mark.parametrize("share", part_or_whole(5, 1))
@pytest.mark.parametrize(("name", "runs"), [("EDS", 200), ("EDS, all mappable", 400), ("az3", 60)])
def test_random_sequences(name: str, runs: int, share: int) -> None:
    master, dice = MASTERS[name](), random.Random(13)
    letters = master.letters(singles=True)
    for _ in range(runs // share):
        master.play([dice.choice(letters) for _ in range(dice.randint(3, 9))])


@pytest.mark.long
def test_sequences_that_hypothesis_shortens() -> None:
    master = MASTERS["EDS, all mappable"]()

    @given(st.lists(st.sampled_from(master.letters(singles=True)), max_size=12))
    def play(sequence: list[Letter]) -> None:
        master.play(sequence)

    play()


def iterates_over_what_changes(patch: pytest.MonkeyPatch) -> None:
    def active(engine: PdoEngine) -> Iterable[ActivePdo]:
        if engine._pdos_changed:
            engine._active = {
                config: engine._active.get(config) or ActivePdo(config, engine.objects, engine.node)
                for config in engine.pdos
            }
            engine._pdos_changed = False
        return engine._active.values()

    patch.setattr(PdoEngine, "active", property(active))


def sends_every_sync_that_was_missed(patch: pytest.MonkeyPatch) -> None:
    def feed(producer: SyncProducer, item: None, now: float) -> list[CanFrame]:
        frames: list[CanFrame] = []
        while producer._next is not None and now >= producer._next and len(frames) < 1000:
            frames.append(producer.next_frame())
            producer._next += producer.period
        return frames

    patch.setattr(SyncProducer, "feed", feed)


def keeps_a_deadline_in_the_past(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(SyncProducer, "feed", lambda producer, item, now: [])


def allows_restricted_identifiers(patch: pytest.MonkeyPatch) -> None:
    patch.setattr("barewire.canopen.cob_ids.CobEntry.is_restricted", False)


def keeps_emergencies_for_ever(patch: pytest.MonkeyPatch) -> None:
    patch.setattr("barewire.canopen.emcy.WAITING_MAX", 1000)


def confirms_and_forgets(patch: pytest.MonkeyPatch) -> None:
    write = ObjectDictionary.write

    def writes_all_but_one(objects: ObjectDictionary, index: int, sub: int, data: bytes) -> None:
        if index != 0x1029:
            write(objects, index, sub, data)

    patch.setattr(ObjectDictionary, "write", writes_all_but_one)


def keeps_a_value_over_a_reset(patch: pytest.MonkeyPatch) -> None:
    restore = ObjectDictionary.restore
    patch.setattr(ObjectDictionary, "restore", lambda objects, first, last: restore(objects, first + 0x10, last))


def does_not_beat(patch: pytest.MonkeyPatch) -> None:
    follow = ErrorControl.follow

    def follow_except_the_heartbeat(control: ErrorControl, now: float) -> None:
        follow(control, now)
        if integer_value(control.objects, 0x1017) == 1:
            control.heartbeat.set_period(0.0, now)

    patch.setattr(ErrorControl, "follow", follow_except_the_heartbeat)


PLANTED = (
    iterates_over_what_changes,
    sends_every_sync_that_was_missed,
    keeps_a_deadline_in_the_past,
    allows_restricted_identifiers,
    confirms_and_forgets,
    keeps_a_value_over_a_reset,
    does_not_beat,
)


@pytest.mark.parametrize("plant", PLANTED, ids=lambda plant: plant.__name__)
def test_the_master_finds_a_planted_defect(
    plant: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    plant(monkeypatch)
    master = MASTERS["EDS, all mappable"]()
    with pytest.raises(AssertionError, match=r"^after "):
        run_all(master.scenario(master.letters(), 1))
