"""One SDO channel of a client: two identifiers, one transfer at a time, and counters of received frames.

        client  -- 600h+n -->  server of node n        [CiA 301, default SDO]
                <-- 580h+n --

A device may have further servers, each with its own channel (`client.find_channel`).

Frames that are not the response to the present request are normal, and counted in `ChannelCounters`. A bus that passes
a channel only its own frames gives it a `node_monitor`, which explains a time-out by what the node sent before.

After a transfer that ended without its response the channel waits until `quiet_until`, two time-outs after the last
request was sent, so that a late response is not mistaken for the response to the next request. A late response that
opens a transfer on the server is answered by an abort, because no client continues that transfer.

A transfer that was abandoned (a cancelled task, Ctrl-C) in good order is different: the server answers, in the order of
the requests, so the frames still to come are known (`quiet_for`), and the next transfer waits only if one of them could
be its response:

        abandoned                                   the next transfer waits
        before the first response                   if it is for the same object: until that response has come
        in segments, or in a block download         never: segments and confirmations do not name an object
        in a block upload                           until the server answers a probe: a segment is any 8 bytes, also
                                                    43 00 21 00 ..., and the server may have sent up to 127 of them

The probe is the upload of object 0000h:00, which no server has. Its answer is an abort, 80h, and no segment begins with
80h. A server that does not answer it costs the wait until `quiet_until`.

A channel has one client. If a second one sends on it, both receive its responses, and the server takes the frames of
both for one transfer. A frame on the request identifier that this client did not send reveals the other one: during a
transfer `receive` raises OtherClient; before a transfer `settle` waits for the response to it. Some adapters return the
frames that they send. Whether this one does shows at the first response, which a returned request precedes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

from barewire.canopen.abort_codes import AbortCode
from barewire.canopen.cob_ids import CobEntry, classify, default_sdo_channel
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtState, NodeState
from barewire.canopen.nmt.node_monitor import NodeMonitor, TrafficMark
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.canopen.sdo.messages import (
    ABORT,
    Abort,
    ExpeditedUpload,
    InitiateUpload,
    M,
    SdoResponse,
    decode_one_of,
    decode_sdo_response,
    is_any_response,
)
from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import DecodeError, EncodeError, NoAnswer

SERVER_1 = 0x1200
"""The record of the first SDO server of a device, which is the default one; those of the others follow."""
SERVERS_MAX = 128
NOT_IN_USE = "has bit 31 set or a restricted COB-ID"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


@dataclass(slots=True)
class ChannelCounters:
    """Counts of the frames that a client received while it waited for a response. They explain a time-out."""

    responses: int = 0  # frames on the response identifier of this channel
    others: int = 0  # frames on other identifiers
    rivals: int = 0  # of `others`: requests of another client on this channel
    signs: int = 0  # of `others`: sent by the node of this channel
    late: int = 0  # of `responses`: responses to an earlier request
    garbled: int = 0  # of `responses`: cannot be decoded
    short: int = 0  # of `responses`: decoded, with fewer than 8 bytes
    unsized: int = 0  # of `responses`: 42h, a value without its size
    extended: int = 0  # extended frames with the number of the response identifier
    state: NodeState | None = None  # the last heartbeat of the node

    @property
    def frames(self) -> int:
        """All frames received."""
        return self.responses + self.others

    @property
    def from_node(self) -> int:
        """Frames from the node, on any of its identifiers."""
        return self.responses + self.signs

    def explain(self, node: int, response_id: int) -> str:
        """Return the counters as one sentence."""
        if not self.frames:
            return "no frame was received on the bus"
        parts = [f"received {_count(self.frames, 'frame')}", f"{self.from_node or 'none'} from node {node}"]
        if self.state is not None:
            stopped = ", and a stopped node does not answer SDO" if self.state.state == NmtState.STOPPED else ""
            parts.append(f"its heartbeat reports {self.state.name}{stopped}")
        parts.append(f"{self.responses or 'none'} on {response_id:03X}h")
        parts += self.oddities()
        if self.extended:
            parts.append(f"{_count(self.extended, 'extended frame')} {response_id:08X}h, which is another identifier")
        return ", ".join(parts)

    def oddities(self) -> list[str]:
        """Return the irregular frames on the channel itself, in words."""
        parts = []
        if self.late:
            parts.append(f"{_count(self.late, 'response')} to another request")
        if self.garbled:
            parts.append(f"{self.garbled} unreadable")
        if self.rivals:
            parts.append(f"{_count(self.rivals, 'request')} of another client on the same channel")
        return parts

    def add(self, other: ChannelCounters) -> None:
        """Add the counters of `other`, and adopt its state, which is the later one."""
        for name in _COUNTERS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.state = other.state


_COUNTERS = tuple(field.name for field in fields(ChannelCounters) if field.name != "state")


_PAST = float("-inf")
_PROBE = InitiateUpload(0, 0).encode()
_LAST_FRAMES = b"\x80\xa1"  # the commands of a client that no response follows: an abort, the end of a block upload
_ENDING = (Abort, ExpeditedUpload)
"""The responses to a first request after which the server has no transfer."""
OUT_OF_STEP = frozenset({AbortCode.COMMAND, AbortCode.TOGGLE, AbortCode.SEQUENCE_NUMBER, AbortCode.TIMED_OUT})
"""A server that aborts with one of these was not in the state that the client assumed."""


class OtherClient(NoAnswer):
    """Another client sent a request on the channel, so a response may be the one to its request."""


class Channel:
    """The client's end of one SDO channel.

    Keep one for each node and pass it to every transfer, because it records whether the last transfer timed out.

        cob_ids        the identifiers, client to server first, of a further server; default: 600h + node, 580h + node
        own_frames     whether the port also delivers the frames that it sends: then another client cannot be noticed;
                       None: it is found out at the first response

    `counters` counts during the present transfer, `total` is the sum of the transfers before.

    >>> channel = Channel(5)
    >>> f"{channel.request_id:X}h {channel.response_id:X}h"
    '605h 585h'
    """

    __slots__ = ("_mark", "_plain", "abandoned", "abandoned_at", "blocks", "busy", "counters", "dialect", "node",
                 "node_monitor", "own_frames", "probes", "quiet_for", "quiet_until", "request_extended", "request_id",
                 "response_extended", "response_id", "retries", "sent", "timeout", "total")  # fmt: skip

    def __init__(
        self,
        node: int,
        dialect: SdoDialect = STANDARD,
        *,
        cob_ids: tuple[CobEntry, CobEntry] | None = None,
        node_monitor: NodeMonitor | None = None,
        own_frames: bool | None = None,
    ) -> None:
        self.node = node
        self.dialect = dialect
        request, response = cob_ids or default_sdo_channel(node)
        self.request_id, self.request_extended = request[:2]
        self.response_id, self.response_extended = response[:2]
        self.node_monitor = node_monitor
        self.own_frames = own_frames
        self.sent: list[bytes] = []  # while `own_frames` is None: the frames sent, but not returned
        self._mark: TrafficMark | None = None
        self.blocks = True  # False after the server has refused blocks: `block="auto"` does not request them again
        self.timeout = 0.0
        """The longest time-out that clients give the node. A call with a shorter one makes no response come sooner."""
        self.retries = 0
        """How often an upload that was lost is repeated, and a write of a setting (`client.write_setting`)."""
        self.probes = False
        """Whether the next transfer sends a probe, because segments of a block may still come."""
        self.quiet_until: float | None = None
        self.quiet_for: frozenset[tuple[int, int]] | None = None
        """The objects whose transfers wait until `quiet_until`; None: all transfers."""
        self.abandoned: tuple[int, int] | None = None
        """The object of the transfer that ended without its response, if no other client is on the channel."""
        self.abandoned_at = 0.0
        """When the last frame of that transfer was sent or received."""
        self.busy = False
        self.counters = ChannelCounters()
        self.total = ChannelCounters()
        self._plain: ChannelCounters | None = None  # the counters of exchanges without a conversation: one response

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: node {self.node}>"

    def receive(self, frame: CanFrame) -> bytes | None:
        """Count a frame, and return its data if it is on the response identifier.

        Raise OtherClient for a request that this client did not send.
        """
        if frame.id != self.response_id or frame.extended != self.response_extended or frame.remote:
            self._count_other(frame)
            return None
        self.counters.responses += 1
        return frame.data

    def decode(self, data: bytes, wanted: tuple[type[M], ...]) -> M | None:
        """Return the message if it is of a wanted kind. Otherwise count it as late or garbled, and return None."""
        counters = self.counters
        try:
            message = decode_one_of(data, wanted)
        except DecodeError:
            if is_any_response(data):
                counters.late += 1
            else:
                counters.garbled += 1
            return None
        counters.short += len(data) < 8
        counters.unsized += isinstance(message, ExpeditedUpload) and not message.indicated
        return message

    def learn_own_frames(self, request: bytes) -> None:
        """Record that the port does not return what it sends, if the response came and the request did not."""
        if request in self.sent:
            self.own_frames = False
            self.sent.clear()

    def _count_other(self, frame: CanFrame) -> None:
        self.counters.others += 1
        if frame.id == self.request_id and frame.extended == self.request_extended and len(frame.data) == 8:
            self._check_rival(frame.data)
        self.counters.extended += frame.extended and not self.response_extended and frame.id == self.response_id
        service_and_node = classify(frame)
        if service_and_node is None or frame.remote:
            return
        service, node = service_and_node
        if node == self.node and service.from_device:
            self.counters.signs += 1
            if service.name == "error control" and frame.data:
                self.counters.state = NodeState.decode(frame)

    def _check_rival(self, request: bytes) -> None:
        """Raise OtherClient for a request on this channel, unless it is one of this client that the port returns."""
        if self.own_frames is None and request in self.sent:
            self.sent.remove(request)
        elif not self.own_frames:
            self.counters.rivals += 1
            data = request.hex(" ").upper()
            raise OtherClient(f"another client sent {data} on {self.request_id:03X}h, the channel to node {self.node}")

    def check_free(self, place: object) -> None:
        """Raise EncodeError while another transfer runs than that of the object `place`."""
        if self.busy:
            raise EncodeError(f"{place} must wait: the SDO channel to node {self.node} carries one transfer at a time")

    def begin(self) -> None:
        """Begin a transfer: restart the counters; the last heartbeat remains."""
        self.restart_counters()
        self._mark = None if self.node_monitor is None else self.node_monitor.mark(self.response_id)
        self.busy = True

    def restart_counters(self) -> None:
        """Add the counters of the transfer before to `total`."""
        self.total.add(self.counters)
        self.counters = ChannelCounters(state=self.counters.state)
        del self.sent[:-1]

    def begin_plain(self) -> bool:
        """Begin an exchange without a conversation, if it is certain that none is needed before the request: no late
        response is expected, and no other client waits for its own. Return whether it began."""
        if self.busy or self.quiet_until is not None or self.own_frames is None:
            return False
        monitor = self.node_monitor
        if monitor is not None:
            if not self.own_frames and monitor.unanswered(self.request_id, self.response_id) is not None:
                return False
            self._mark = monitor.mark(self.response_id)
        self.busy = True
        return True

    def end_plain(self) -> None:
        """End an exchange without a conversation, which got its response."""
        counters = self.counters
        if counters is self._plain:
            self.total.responses += 1
        else:
            self.total.add(counters)
            self.counters = self._plain = ChannelCounters(1, state=counters.state)
        self.busy = False

    @property
    def late_responses(self) -> int:
        """How many responses to another request were discarded, in all transfers."""
        return self.total.late + self.counters.late

    def explain(self, now: float) -> str:
        """Return a sentence on the received frames, which explains why there was no response."""
        if self.node_monitor is None or self._mark is None:
            return self.counters.explain(self.node, self.response_id)
        monitor, count = self.node_monitor, self.counters.responses
        text = monitor.explain_silence(self.node, self.response_id, self._mark, now, responses=count)
        return ", ".join([text, *self.counters.oddities()])

    def latest(self, timeout: float) -> float:
        """Return by how many seconds a frame may be late in a call with this time-out."""
        return max(timeout, self.timeout)

    def be_quiet(
        self,
        until: float,
        places: Iterable[tuple[int, int]] | None,
        abandoned: tuple[int, int] | None,
        now: float = 0.0,
    ) -> None:
        """Make transfers of the objects `places`, or of all with None, wait until then."""
        if places is None or (self.quiet_until is not None and self.quiet_for is None):
            self.quiet_for = None
        else:
            self.quiet_for = (self.quiet_for or frozenset()).union(places)
        # An earlier transfer may have had a longer time-out: its wait is not shortened.
        self.quiet_until = until if self.quiet_until is None else max(until, self.quiet_until)
        self.abandoned, self.abandoned_at = abandoned, now

    def be_interrupted(self, now: float, timeout: float, place: tuple[int, int]) -> None:
        """End an exchange without a conversation that an exception ended where nothing could record its state."""
        self.restart_counters()
        self.be_quiet(now + 2 * self.latest(timeout), None, place, now)
        self.busy = False

    def be_settled(self) -> None:
        """Record that the server answers the present transfer: no response from before can follow."""
        self.quiet_until = self.quiet_for = self.abandoned = None
        self.probes = False

    def note_answer(self, place: tuple[int, int]) -> None:
        """Record the response to the abandoned transfer of `place`. Those of other objects may still follow."""
        self.quiet_for = (self.quiet_for or frozenset()) - {place}
        if not self.quiet_for:
            self.be_settled()

    def settle(self, timeout: float, index: int, sub: int) -> Conversation[CanFrame, float]:
        """Discard the frames that wait; if the transfer of `index`:`sub` must wait, also those until `quiet_until`.
        Return the time of the end.

        If another client has sent a request, wait for its response, at most `timeout` seconds. Raise OtherClient if it
        sends one request after the other.
        """
        waits = _Waits(self, (index, sub), timeout)
        # The probe is sent as soon as the time is known, which is that of the first frame or of its absence.
        heard: Heard[CanFrame] = yield Listen(_PAST if self.probes else waits.until)
        waits.begin(heard.now)
        while True:
            opened = None if heard.item is None else waits.hear(heard.item, heard.now)
            if opened is not None:
                yield self.send(Abort(*opened, AbortCode.TIMED_OUT).encode())
            if self.probes:
                yield from self._send_probe(waits, heard.now)
            elif waits.are_over(heard):
                break
            heard = yield Listen(waits.until)
        if self.quiet_until is not None and heard.now >= self.quiet_until:
            self.be_settled()
        return heard.now

    def _send_probe(self, waits: _Waits, now: float) -> Conversation[CanFrame, None]:
        window = 2 * self.latest(waits.timeout)
        self.quiet_until = max(waits.late, now + window)  # before it is sent: an exception may come between
        self.probes = False
        sent: Heard[CanFrame] = yield self.send(_PROBE)
        waits.probed = True
        waits.late = self.quiet_until = max(waits.late, sent.now + window)
        waits.backlog = max(waits.backlog, waits.late)

    def _late_until(self, place: tuple[int, int]) -> float:
        """Return until when a transfer of this object waits for the response to an earlier request."""
        if self.quiet_until is None or not (self.quiet_for is None or place in self.quiet_for):
            return _PAST
        if self.quiet_for is not None and self._was_answered(place):
            self.note_answer(place)
            return _PAST
        return self.quiet_until

    def _rival_until(self, timeout: float) -> float:
        """Return until when another client, which sent a request before this transfer, may get its response."""
        if self.node_monitor is None or self.own_frames:
            return _PAST
        requested_at = self.node_monitor.unanswered(self.request_id, self.response_id)
        if requested_at is None:
            return _PAST
        self.abandoned = None
        return requested_at + timeout

    def _was_answered(self, place: tuple[int, int]) -> bool:
        """Return whether the response to the abandoned request came between two transfers, when no client listened."""
        monitor = self.node_monitor
        frame = None if monitor is None else monitor.last_frame(self.response_id, self.abandoned_at)
        named = None if frame is None or self.response_extended else _named_response(frame.data)
        return named is not None and (named.index, named.sub) == place

    def send(self, data: bytes) -> Send[CanFrame]:
        """Send eight bytes to the server."""
        if self.own_frames is None:
            self.sent.append(data)
        return Send(CanFrame(self.request_id, data, self.request_extended))


class _Waits:
    """What a transfer waits for before its first request. Each wait ends at a time, or with the response.

    late       for the response to a request of an earlier transfer, or to the probe
    rival      for the response to the request of another client
    backlog    when reading ends even if frames still wait, because a busy bus is never silent
    give_up    when a client that sends one request after the other is not waited for any more
    """

    __slots__ = ("backlog", "channel", "give_up", "late", "place", "probed", "rival", "timeout")

    def __init__(self, channel: Channel, place: tuple[int, int], timeout: float) -> None:
        self.channel = channel
        self.place = place
        self.timeout = timeout
        self.late = channel._late_until(place)
        self.rival = channel._rival_until(timeout)
        self.probed = False

    def begin(self, now: float) -> None:
        """Set the limits that count from the beginning, of which the first frame tells the time."""
        # A slow computer needs long for what waits, and would take a frame left unread for a response.
        self.backlog = max(self.late, now + self.timeout)
        self.give_up = max(self.backlog, now + 2 * self.timeout)

    @property
    def until(self) -> float:
        """The end of the longer wait."""
        return max(self.late, self.rival)

    def are_over(self, heard: Heard[CanFrame]) -> bool:
        """Return whether the request may be sent: both waits are over, and no frame waits."""
        is_silent = heard.item is None and heard.now >= self.late
        return heard.now >= self.rival and (is_silent or heard.now >= self.backlog)

    def hear(self, frame: CanFrame, now: float) -> tuple[int, int] | None:
        """End the waits that a frame ends. Return the object of the transfer that it opened on the server, if no client
        continues that transfer."""
        channel = self.channel
        try:
            response = channel.receive(frame)
        except OtherClient:
            self.rival = _PAST if frame.data[:1] in _LAST_FRAMES else now + self.timeout
            channel.abandoned = None  # a response may be the one to the other client
            if now >= self.give_up:
                raise
            return None
        if response is None:
            return None
        channel.counters.late += 1
        if not response or response[0] != ABORT:  # an abort may also respond to an earlier frame of the other client
            self.rival = _PAST
        named = _named_response(response)
        if named is None:
            return None
        place = (named.index, named.sub)
        is_open = place == channel.abandoned and not isinstance(named, _ENDING)
        if place == self.place and channel.quiet_for is not None:
            self._end_late(now)
            channel.note_answer(place)
        elif self.probed and isinstance(named, Abort) and place == (0, 0) and named.code not in OUT_OF_STEP:
            self._end_late(now)
            channel.be_settled()
        return place if is_open else None

    def _end_late(self, now: float) -> None:
        self.late, self.backlog = _PAST, min(self.backlog, now + self.timeout)


def _named_response(data: bytes) -> SdoResponse | None:
    """Return the response to a first request, which names its object; None for any other response."""
    try:
        return decode_sdo_response(data)
    except DecodeError:
        return None


def channel_to(node: int | Channel, dialect: SdoDialect | None) -> Channel:
    """Return the given channel, or one to the default server of a node. Raise EncodeError if the dialects differ."""
    if isinstance(node, int):
        return Channel(node, STANDARD if dialect is None else dialect)
    if dialect is not None and dialect != node.dialect:
        raise EncodeError(
            f"the channel to node {node.node} has the SDO dialect {node.dialect.name}, not {dialect.name}"
        )
    return node
