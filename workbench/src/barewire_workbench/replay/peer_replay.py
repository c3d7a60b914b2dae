"""Plays a recording against a device, in virtual time: the frames that others sent go to it, and the frames that it
sends are compared with those of the recorded node.

        recording          605#4008100000000000     585#4108100014000000         705#05
                           the node received it     the node sent it             the node sent it
                                  |                        |                        |
        device machine    --> feed(frame, at) --> 585#4108100010000000              -
                                                    different: another size         missing

A recorded frame of the device and one that it sends belong together if they have the same identifier and are at most
`window` seconds apart, and on the default SDO channel if they answer the same request. A real device needs time to
boot: a reset, or the power-on that a boot-up without a reset shows, takes effect at the recorded boot-up, and what is
sent before that is lost for the device. Where the recording begins in the middle, the device begins in the NMT state of
its first recorded frame.

Recordings without times (`timed=False`) have an order only: if the device has not yet sent a recorded frame, time
passes, up to 10 s, until it does.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple, Protocol

from barewire.canopen.cob_ids import CobEntry, check_node, classify
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtCommand, NmtState
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.errors import BarewireError
from barewire_workbench.recordings.model import Dropped, Recorded, RecordedItem, Unread
from barewire_workbench.replay.played import Comparer, Played, PlayedOutcome, RecordedValue, played_kind

COUNTERPART_WINDOW = 1.0
"""Seconds between a recorded frame and that of the device."""
_PATIENCE = 10.0
"""Seconds that pass at most for one recorded frame, if the recording has no times."""
_STEP = 0.001
STEPS_MAX = 10_000
"""How often a device is fed at most without time passing: one whose deadline does not move would be fed for ever."""
_LSS_ANSWER = (0x7E4, False)
_RESETS = (NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION)
_COMMAND_TO = {
    NmtState.OPERATIONAL: NmtCommand.START,
    NmtState.STOPPED: NmtCommand.STOP,
    NmtState.PRE_OPERATIONAL: NmtCommand.ENTER_PRE_OPERATIONAL,
}
_SYNC, _TIME, _EMCY, _TPDO, _SDO_SERVER = 0x1005, 0x1012, 0x1014, 0x1800, 0x1201
_PDOS, _CHANNELS = 512, 127


class PlayedDevice(Protocol):
    """A device as a machine: `LocalNode`, the CANopen side of a simulator, or your own."""

    @property
    def deadline(self) -> float | None: ...

    def start(self, now: float) -> list[CanFrame]: ...

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]: ...


class _Waiting(NamedTuple):
    """A frame without its counterpart."""

    at: float
    frame: CanFrame
    request: CanFrame | None
    line: int = 0


class PeerReplay:
    """Compares a device with the node `node` of a recording: give all items to `play`.

    >>> from barewire.canopen.device.device import LocalNode
    >>> from barewire.canopen.object_dictionary import Entry
    >>> objects = ObjectDictionary([Entry(0x1000, 0, "device type", "u32", "const", 7)])
    >>> lines = "705#00", "605#4000100000000000", "585#4300100091010F00"
    >>> items = [Recorded(place / 10, "can0", CanFrame.parse(line)) for place, line in enumerate(lines)]
    >>> [(played.outcome, str(played.sent)) for played in PeerReplay(LocalNode(5, objects), 5).play(items)]
    [('same', '705#00'), ('different', '585#4300100007000000')]
    """

    def __init__(
        self, device: PlayedDevice, node: int, *, window: float = COUNTERPART_WINDOW, timed: bool = True
    ) -> None:
        self.device = device
        self.node = check_node(node)
        self.window = window
        self.timed = timed
        self._comparer = Comparer()
        self.counts = self._comparer.counts
        self.received = 0
        """The frames that the device received."""
        self.not_received = 0
        """The frames of others while the recorded device was off or booting."""
        self.restarts = 0
        """The recorded boot-ups without a reset command."""
        self.cut_short = 0
        """How often the device was due 10,000 times between two frames, the most that is played."""
        self._now = 0.0
        self._is_on = False
        self._reset: CanFrame | None = None  # the command that takes effect at the next recorded boot-up
        self._request: CanFrame | None = None  # the last frame that the device received
        self._asked: CanFrame | None = None  # the last one on the default SDO channel
        self._asked_at = -1.0  # when the last request on the default SDO channel was received
        self._recorded: dict[tuple[int, bool], deque[_Waiting]] = {}
        self._sent: dict[tuple[int, bool], deque[_Waiting]] = {}
        self._waiting: deque[tuple[float, tuple[int, bool]]] = deque()  # since when, and where, in order
        self._played: list[Played] = []
        self._differs = False  # the SDO transfer under way has a difference: the rest of it follows from that
        self._keys: frozenset[tuple[int, bool]] = frozenset()
        self._changes = -1

    def play(
        self, items: Sequence[RecordedItem], values: Mapping[int, RecordedValue] | None = None
    ) -> Iterator[Played]:
        """Play a whole recording, and yield each comparison when it is certain.

        `values` are those of `values_of`: the device gets each before the request that reads it.
        """
        given = values or {}
        last_boot_up = max((place for place, item in enumerate(items) if self._is_boot_up(item)), default=-1)
        self._now = items[0].at if items else 0.0
        self._begin(items)
        for place, item in enumerate(items):
            if isinstance(item, Unread):
                continue
            self._pass_time(item.at if self.timed else self._now + _STEP)
            if isinstance(item, Dropped):
                self._forget()
            elif isinstance(item.frame, CanFrame):
                if self._is_of_device(item, item.frame):
                    self._compare(item, item.frame)
                else:
                    if place in given:
                        self._set(given[place])
                    self._receive(item.frame, place < last_boot_up)
            yield from self._taken()
        self._end()
        yield from self._taken()

    def _set(self, value: RecordedValue) -> None:
        """Give an object of the device the recorded value, if its type can have it."""
        objects = getattr(self.device, "objects", None)
        place = value.index, value.sub
        if isinstance(objects, ObjectDictionary) and place in objects:
            with suppress(BarewireError):
                objects.set(*place, objects.entry(*place).codec.decode(value.data))

    # The sender of a frame

    def _is_boot_up(self, item: RecordedItem) -> bool:
        return isinstance(item, Recorded) and str(item.frame) == f"{0x700 + self.node:03X}#00"

    def _is_of_device(self, item: Recorded, frame: CanFrame) -> bool:
        """Return whether the recorded node sends this frame, by its identifier or by the log."""
        if frame.remote or item.sent:
            return False
        if item.sent is False:
            return True
        found = classify(frame)
        if found is not None and found[0].from_device and (found[1] == self.node or found[0].name == "LSS answer"):
            return True
        return frame.key in self._configured()

    def _configured(self) -> frozenset[tuple[int, bool]]:
        """Return the identifiers that the objects of the device configure for what it sends."""
        objects = getattr(self.device, "objects", None)
        if isinstance(objects, ObjectDictionary) and objects.changes != self._changes:
            self._changes = objects.changes
            places = [(_TPDO + number, 1) for number in range(_PDOS)] + [(_EMCY, 0)]
            places += [(_SDO_SERVER + number, 2) for number in range(_CHANNELS)]
            words = [int(objects.get(*place)) for place in places if place in objects]
            entries = [entry for entry in map(CobEntry.unpack, words) if not entry.bit31]
            produced = [int(objects.get(place)) for place in (_SYNC, _TIME) if (place, 0) in objects]
            entries += [entry for entry in map(CobEntry.unpack, produced) if entry.bit30]
            self._keys = frozenset((entry.identifier, entry.extended) for entry in entries)
        return self._keys

    # The device

    def _begin(self, items: Sequence[RecordedItem]) -> None:
        """Switch the device on, in the state in which the recording finds it; or not, if it begins with a boot-up."""
        state: int | None = None
        is_running, heard_at = False, None
        for item in items:
            if not isinstance(item, Recorded) or not isinstance(item.frame, CanFrame):
                continue
            frame = item.frame
            if frame.id == 0 and not frame.extended and len(frame.data) == 2 and frame.data[1] in (0, self.node):
                is_running = True
                break
            if not self._is_of_device(item, frame):
                continue
            if self._is_boot_up(item):
                break
            found = classify(frame)
            is_running = True
            if found is not None and found[0].name == "error control" and frame.data:
                state, heard_at = frame.data[0] & 0x7F, item.at
                break
            if found is not None and "TPDO" in found[0].name:
                state = NmtState.OPERATIONAL
                break
        if not is_running:
            return
        self._is_on = True
        begin = self._now
        if heard_at is not None and self.timed:  # so that its heartbeats are due when they were recorded
            self._now = min(begin, heard_at - self._heartbeat_time())
        self.device.start(self._now)  # its boot-up was before the recording
        command = _COMMAND_TO.get(NmtState(state)) if state in tuple(NmtState) else None
        if command is not None:
            self.device.feed(CanFrame(0, bytes([command, self.node])), self._now)
        self._pass_time(begin)

    def _heartbeat_time(self) -> float:
        """Return the period of the device's heartbeat in seconds; 0 if it has none."""
        objects = getattr(self.device, "objects", None)
        if not isinstance(objects, ObjectDictionary) or (0x1017, 0) not in objects:
            return 0.0
        return int(objects.get(0x1017)) / 1000

    def _end(self) -> None:
        """Wait for what was recorded last. What the device sent last is not judged: its counterpart may have
        followed."""
        end = self._now
        self._pass_time(end + self.window if self.timed else end)
        for key, entries in self._sent.items():
            if self.timed:
                self._sent[key] = deque(entry for entry in entries if entry.at <= end - self.window)
        self._close(self._now + 1.0)

    def _receive(self, frame: CanFrame, boots_later: bool) -> None:
        """Feed the device with a frame of another node."""
        if not self._is_on or self._reset is not None:
            self.not_received += 1
            return
        self.received += 1
        if frame.key == (0x600 + self.node, False):
            self._answered()
            self._asked = frame
            self._differs = self._differs and not _begins_transfer(frame.data)
        is_reset = frame.id == 0 and not frame.extended and len(frame.data) == 2 and frame.data[0] in _RESETS
        if is_reset and frame.data[1] in (0, self.node) and boots_later:
            self._reset = frame
            return
        self._request = frame
        self._take(self.device.feed(frame, self._now))

    def _pass_time(self, now: float) -> None:
        """Let the device send what is due up to this time, and report what has waited too long."""
        for _ in range(STEPS_MAX):
            due = self.device.deadline if self._is_on and self._reset is None else None
            if due is None or due > now:
                break
            self._now = max(self._now, due)
            self._take(self.device.feed(None, self._now))
        else:
            self.cut_short += 1
        self._now = max(self._now, now)
        self._close(self._now - self.window)

    def _boot(self) -> None:
        """Let a recorded boot-up take effect: the end of a reset, or of a power-on."""
        if not self._is_on:
            self._is_on = True
            self._take(self.device.start(self._now))
            return
        if self._reset is None:
            self.restarts += 1
        reset = self._reset or CanFrame(0, bytes([NmtCommand.RESET_NODE, self.node]))
        self._reset = None
        self._take(self.device.feed(reset, self._now))

    # The comparison

    def _take(self, frames: list[CanFrame]) -> None:
        """Take what the device sends. A recorded frame that waits for exactly this is its counterpart."""
        for frame in frames:
            waiting = self._recorded.get(frame.key, deque())
            same = next((entry for entry in waiting if entry.frame == frame), None)
            if same is not None:
                waiting.remove(same)
                self._report(same, frame, self._cause(frame))
            else:
                self._wait(self._sent, _Waiting(self._now, frame, self._cause(frame)))

    def _compare(self, item: Recorded, frame: CanFrame) -> None:
        """Take a recorded frame of the device: the same one is its counterpart, or else the oldest."""
        if self._is_boot_up(item) and not self._sent.get(frame.key):
            self._boot()
        if not self.timed and not self._sent.get(frame.key) and frame.key != (0x580 + self.node, False):
            self._wait_for(frame.key)
        entry = _Waiting(self._now if not self.timed else item.at, frame, self._cause(frame), item.line)
        sent = self._sent.get(frame.key, deque())
        if not sent:
            self._wait(self._recorded, entry)
            return
        counterpart = next((candidate for candidate in sent if candidate.frame == frame), sent[0])
        sent.remove(counterpart)
        self._report(entry, counterpart.frame, counterpart.request)

    def _wait(self, where: dict[tuple[int, bool], deque[_Waiting]], entry: _Waiting) -> None:
        """Let a frame wait for its counterpart."""
        where.setdefault(entry.frame.key, deque()).append(entry)
        self._waiting.append((entry.at, entry.frame.key))

    def _cause(self, frame: CanFrame) -> CanFrame | None:
        """Return the request of an SDO answer, or else the last frame that the device received."""
        return self._asked if frame.key == (0x580 + self.node, False) else self._request

    def _wait_for(self, key: tuple[int, bool]) -> None:
        """Let time pass until the device sends a frame with this identifier."""
        until = self._now + _PATIENCE
        for _ in range(STEPS_MAX):
            due = self.device.deadline if self._is_on else None
            if due is None or due > until or self._sent.get(key):
                return
            self._now = max(self._now, due)
            self._take(self.device.feed(None, self._now))

    def _answered(self) -> None:
        """Close the last request on the default SDO channel: the client sends the next one.

        A recorded answer may stand before its request, if the recorder mixed them up: it waits for one request more.
        """
        key = (0x580 + self.node, False)
        self._pair(key, self._now, self._asked_at)
        self._asked_at = self._now

    def _close(self, before: float) -> None:
        """Report the frames that have waited since before this time."""
        due: dict[tuple[int, bool], None] = {}
        while self._waiting and self._waiting[0][0] <= before:
            due[self._waiting.popleft()[1]] = None
        for key in due:
            self._pair(key, before, before)
            left = [entries[key][0].at for entries in (self._recorded, self._sent) if entries.get(key)]
            if left and min(left) <= before:  # recorded at this very time: it waits a little longer
                self._waiting.appendleft((min(left), key))

    def _pair(self, key: tuple[int, bool], sent_before: float, recorded_before: float) -> None:
        """Report the frames with this identifier that came before these times: two of them as different."""
        recorded, sent = self._recorded.get(key, deque()), self._sent.get(key, deque())
        while recorded and sent and min(recorded[0].at, sent[0].at) <= max(sent_before, recorded_before):
            if self.timed and abs(recorded[0].at - sent[0].at) > self.window:
                break
            pair = sent.popleft()
            self._report(recorded.popleft(), pair.frame, pair.request)
        while recorded and recorded[0].at < recorded_before:
            entry = recorded.popleft()
            if entry.frame.key != _LSS_ANSWER:  # it may be of another node: all have this identifier
                self._report(entry, None, None)
        while sent and sent[0].at <= sent_before:
            entry = sent.popleft()
            self._note(Played(entry.at, "extra", played_kind(entry.frame), None, entry.frame, entry.request, 0))

    def _report(self, recorded: _Waiting, sent: CanFrame | None, request: CanFrame | None) -> None:
        outcome: PlayedOutcome = "missing" if sent is None else "same" if sent == recorded.frame else "different"
        request = recorded.request if sent is None else request
        kind = played_kind(recorded.frame)
        self._note(Played(recorded.at, outcome, kind, recorded.frame, sent, request, recorded.line))

    def _note(self, played: Played) -> None:
        is_sdo = played.kind == "sdo"
        self._played.append(self._comparer.note(played, follows=is_sdo and self._differs))
        self._differs = self._differs or (is_sdo and played.outcome != "same")

    def _forget(self) -> None:
        """Drop what waits: the recorder lost frames."""
        self._recorded.clear()
        self._sent.clear()
        self._waiting.clear()

    def _taken(self) -> list[Played]:
        played, self._played = self._played, []
        return played


def _begins_transfer(data: bytes) -> bool:
    """Return whether an SDO request begins a transfer. A segment of a block may look so."""
    if not data:
        return False
    return data[0] >> 5 in (1, 2) or (data[0] >> 5 == 5 and not data[0] & 3) or (data[0] >> 5 == 6 and not data[0] & 1)
