"""A group of nodes does what the same nodes do that are each fed every frame."""

from __future__ import annotations

import random
from collections import deque

import pytest

from barewire.canopen import (
    CanFrame,
    Entry,
    LocalNode,
    LssAddress,
    LssSlave,
    NmtState,
    NodeGroup,
    ObjectDictionary,
    eds,
    pdos_of,
)
from barewire.errors import EncodeError
from tests.helpers import some_of
from tests.model.hostile_devices import eds_text

NODES = (5, 6, 7)


def nodes(*, all_mappable: bool = False, lss: bool = False) -> list[LocalNode]:
    described = eds.parse(eds_text(all_mappable=all_mappable))
    group_nodes = []
    for number in NODES:
        objects = described.dictionary(number)
        slave = LssSlave(LssAddress(1, 2, 3, number)) if lss else None
        group_nodes.append(LocalNode(number, objects, pdos_of(objects, number, refused=[]), lss=slave))
    return group_nodes


class EveryNode:
    """The same nodes without a group: every frame goes to each, their own frames to the others at the next feed."""

    def __init__(self, members: list[LocalNode]) -> None:
        self.members = members
        self.own: deque[tuple[CanFrame, LocalNode]] = deque()

    @property
    def deadline(self) -> float | None:
        dues = [due for member in self.members if (due := member.deadline) is not None]
        return -1.0 if self.own else min(dues, default=None)

    def start(self, now: float) -> list[CanFrame]:
        return self._take([(member, member.start(now)) for member in self.members])

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        waiting, self.own = self.own, deque()
        frames = []
        for sent, sender in [*waiting, (frame, None)]:
            frames += self._take([(member, member.feed(sent, now)) for member in self.members if member is not sender])
        return frames

    def _take(self, sent: list[tuple[LocalNode, list[CanFrame]]]) -> list[CanFrame]:
        self.own += [(frame, member) for member, frames in sent for frame in frames]
        return [frame for _, frames in sent for frame in frames]


def random_frame(dice: random.Random) -> CanFrame:
    """Return a frame of a master that configures the nodes, or of a service with one of their identifiers."""
    node = dice.choice(NODES)
    identifiers = [0x80, 0x81, 0x100, 0x181, 0x185, 0x186, 0x205, 0x206, 0x207, 0x301, 0x6A0, 0x7E5]
    identifiers += [0x80 + node, 0x700 + node, 0x600 + node]
    kind = dice.randrange(10)
    if kind < 6:
        objects = [(0x1005, 0), (0x1012, 0), (0x1016, 1), (0x1016, 2), (0x1017, 0), (0x1028, 1), (0x1201, 1)]
        objects += [(0x1201, 2), (0x1400, 1), (0x1400, 2), (0x1600, 0), (0x1600, 1), (0x1800, 1), (0x1800, 2)]
        objects += [(0x1A00, 0), (0x1A00, 1), (0x1014, 0), (0x1019, 0), (0x1007, 0), (0x100C, 0), (0x100D, 0)]
        index, sub = dice.choice(objects)
        values = [0, 1, 2, 254, 255, 1 << 31, 0x2001_0008, 0x2003_0010, 0x1005_0020, 0x1017_0010, 0x1400_0120]
        values += [word | top for word in identifiers for top in (0, 0x8000_0000, 0x4000_0000)]
        values += [number << 16 | 30 for number in (*NODES, 9)]
        value = dice.choice(values)
        size = {0x1017: 2, 0x1019: 1, 0x100C: 2, 0x100D: 1}.get(index, 1 if sub == 0 and index >= 0x1400 else 4)
        size = 1 if (index & 0xF800, sub) == (0x1000, 2) and index in (0x1400, 0x1800) else size
        if index in (0x1400, 0x1800) and sub == 2:
            size = 1
        data = bytes([0x23 | (4 - size) << 2, index & 0xFF, index >> 8, sub]) + (value % (1 << 8 * size)).to_bytes(
            4, "little"
        )
        return CanFrame(dice.choice([0x600 + node, 0x6A0]), data)
    if kind == 6:
        return CanFrame(0, bytes([dice.choice([1, 1, 1, 2, 128, 129, 130]), dice.choice([0, 0, node])]))
    if kind == 7:
        return CanFrame(dice.choice(identifiers), remote=True, requested=1)
    return CanFrame(
        dice.choice([0x80, 0x80, *identifiers]), dice.randbytes(dice.choice([0, 0, 1, 2, 8, 8])), dice.random() < 0.05
    )


def feed_when_due(machine: NodeGroup | EveryNode, frame: CanFrame | None, now: float) -> list[str]:
    """Feed what was due before the frame, the frame, and what is due then."""
    frames = []
    for item in (None, frame):
        frames += machine.feed(item, now)
        for _ in range(20):
            if (due := machine.deadline) is None or due > now:
                break
            frames += machine.feed(None, now)
    return sorted(map(str, frames))


@pytest.mark.long
@pytest.mark.parametrize("all_mappable", [False, True])
@pytest.mark.parametrize("seed", some_of(range(12), 2))
def test_a_group_answers_as_the_nodes_do_that_receive_every_frame(seed: int, all_mappable: bool) -> None:
    dice = random.Random(f"{seed} {all_mappable}")
    lss = seed % 2 == 0
    group, every = (
        NodeGroup(nodes(all_mappable=all_mappable, lss=lss)),
        EveryNode(nodes(all_mappable=all_mappable, lss=lss)),
    )
    assert group.start(0.0) == every.start(0.0)
    now, said = 0.0, 0
    for number in range(1500):
        frame = random_frame(dice) if dice.random() < 0.8 else None
        now += dice.choice([0.0001, 0.0001, 0.001, 0.02])
        ours, theirs = (feed_when_due(machine, frame, now) for machine in (group, every))
        assert ours == theirs, f"frame {number}: {frame}"
        said += len(ours)
    assert said > 100


def test_a_frame_reaches_only_the_nodes_that_receive_its_identifier() -> None:
    members = [Counting(number) for number in (5, 6, 7)]
    group = NodeGroup(members)
    group.start(0.0)
    fed = [member.frames for member in members]
    group.feed(CanFrame.parse("606#4000100000000000"), 0.01)
    group.feed(CanFrame.parse("000#0100"), 0.02)
    group.feed(CanFrame.parse("706#05"), 0.03)
    group.feed(CanFrame.parse("123#05"), 0.04)
    assert [member.frames - before for member, before in zip(members, fed)] == [1, 3, 1]
    assert [member.state for member in members] == [NmtState.OPERATIONAL] * 3


class Counting(LocalNode):
    """A node that counts the frames that it is fed."""

    __slots__ = ("frames",)

    def __init__(self, number: int, *entries: Entry) -> None:
        self.frames = 0
        super().__init__(number, ObjectDictionary([Entry(0x1000, 0, "type", "u32", "ro", number), *entries]))

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        self.frames += frame is not None
        return super().feed(frame, now)


def test_a_node_hears_the_heartbeat_of_another_node_of_the_group() -> None:
    producer = Counting(5, Entry(0x1017, 0, "heartbeat", "u16", "rw", 20))
    consumer = Counting(6, Entry(0x1016, 0, "n", "u8", "ro", 1), Entry(0x1016, 1, "watched", "u32", "rw", 0x50064))
    group = NodeGroup([producer, consumer])
    group.start(0.0)
    for tick in range(1, 20):
        group.feed(None, tick * 0.01)
    assert consumer.control.consumer.liveness(5) == "active"
    producer.node = None  # it is switched off
    group.feed(None, 0.31)
    assert consumer.control.consumer.liveness(5) == "lost"


def test_a_group_is_due_when_one_of_its_nodes_is() -> None:
    group = NodeGroup([Counting(5), Counting(6, Entry(0x1017, 0, "heartbeat", "u16", "rw", 20))])
    group.start(0.0)
    group.feed(None, 0.0)
    assert group.deadline == pytest.approx(0.02)
    assert [str(frame) for frame in group.feed(None, 0.02)] == ["706#7F"]


def test_a_value_that_the_application_changes_takes_effect_within_the_sweep() -> None:
    device = Counting(6, Entry(0x1017, 0, "heartbeat", "u16", "rw", 0))
    group = NodeGroup([Counting(5), device])
    group.start(0.0)
    group.feed(None, 0.0)
    device.objects.set(0x1017, 0, 20)
    assert group.deadline == pytest.approx(0.1)
    assert [str(frame) for frame in group.feed(None, 0.1)] == ["706#7F"]


def test_frames_of_the_application_reach_the_other_nodes() -> None:
    consumer = Counting(6, Entry(0x1028, 0, "n", "u8", "ro", 1), Entry(0x1028, 5, "emergencies", "u32", "rw", 0x85))
    group = NodeGroup([Counting(5), consumer])
    group.start(0.0)
    group.feed(None, 0.0)
    sent = group.sent(5, group.node(5).error(0x4210, 0.1))
    assert [frame.id for frame in sent] == [0x85]
    group.feed(None, 0.1)
    assert consumer.emergencies.active(5) == (0x4210,)


def test_an_error_of_one_node_does_not_reach_the_others() -> None:
    class Broken(Counting):
        def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
            raise RuntimeError("broken")

    reported: list[str] = []
    group = NodeGroup([Broken(5), Counting(6)], on_failure=lambda place, error: reported.append(f"{place}: {error}"))
    group.start(0.0)
    frames = group.feed(CanFrame.parse("000#8100"), 0.01)
    assert [str(frame) for frame in frames] == ["706#00"]
    assert reported[0] == "node 5: Broken.feed: broken"
    with pytest.raises(RuntimeError, match="broken"):
        NodeGroup([Broken(5)]).feed(CanFrame.parse("000#8100"), 0.01)


def test_an_error_in_a_hook_is_reported_with_the_node_and_to_the_node() -> None:
    def fail() -> int:
        raise ZeroDivisionError("no data")

    reported: list[str] = []
    own: list[str] = []
    device = Counting(5, Entry(0x2000, 0, "value", "u16", "ro", on_read=fail))
    device.on_failure = lambda place, error: own.append(place)
    group = NodeGroup([device], on_failure=lambda place, error: reported.append(f"{place}: {error}"))
    group.start(0.0)
    frames = group.feed(CanFrame.parse("605#4000200000000000"), 0.1)
    assert str(frames[0]).startswith("585#80002000")
    assert (reported, own) == (["node 5: 2000h:00: no data"], ["2000h:00"])
    group.on_failure = None
    group.feed(CanFrame.parse("605#4000200000000000"), 0.2)
    assert (len(reported), len(own)) == (1, 2)


def test_a_machine_without_receives_is_fed_every_frame() -> None:
    class Recorder:
        deadline = None

        def __init__(self) -> None:
            self.frames: list[str] = []

        def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
            self.frames += [str(frame)] if frame else []
            return []

    recorder = Recorder()
    group = NodeGroup([Counting(5), recorder])
    group.start(0.0)
    group.feed(CanFrame.parse("123#01"), 0.1)
    assert recorder.frames == ["705#00", "123#01"]


def test_wrong_nodes_are_refused() -> None:
    with pytest.raises(EncodeError, match="node 5 is there twice"):
        NodeGroup([Counting(5), Counting(5)])
    with pytest.raises(EncodeError, match="expected a LocalNode"):
        NodeGroup([5])
    with pytest.raises(EncodeError, match="node 9 is not in the group"):
        NodeGroup([Counting(5)]).node(9)
    assert repr(NodeGroup([Counting(5)])) == "<NodeGroup: 1 nodes>"
