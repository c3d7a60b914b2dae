"""Scan a bus: find its nodes, each with the evidence for it.   [CiA 301, predefined connection set]

        600h+n | 40 00 10 00 ...   ->             read 1000h, which every device has
                               <-  580h+n         the device type, or an abort: the node exists either way

        received meanwhile    700h+n heartbeat, boot-up      080h+n emergency      580h+n response to another client

127 requests in one burst would overrun the buffers of adapters and devices. So at most `outstanding` requests wait for
a response at a time, and two requests are at least `gap` seconds apart. A node that cannot use SDO now (STOPPED) is
found by its heartbeat, if the scan listens for one heartbeat period.

Another protocol on the same cable cannot appear as a node: extended frames, remote frames, and frames on 580h+n that
are not SDO responses are never evidence.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from barewire.canopen.cob_ids import NODE_MAX, NODE_MIN, check_node, classify, cob_id
from barewire.canopen.emcy import Emergency
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NodeState
from barewire.canopen.sdo import Abort, ExpeditedUpload, InitiateUpload, decode_sdo_response
from barewire.canopen.sdo.channel import Channel
from barewire.conversation import Conversation, Heard, Listen, Send, check_request_timeout
from barewire.errors import DecodeError, EncodeError

_DEVICE_TYPE = 0x1000
_OBJECT = (_DEVICE_TYPE, 0)


@dataclass(slots=True)
class ScannedNode:
    """A node that was found, and the evidence for it.

    device_type      the value of 1000h
    abort            the abort code, if the device refused to send its device type
    answered_after   the response time in seconds
    state            the last state that the node reported
    emergency        the last emergency of the node
    evidence         the number of frames for each kind of evidence
    """

    node: int
    device_type: int | None = None
    abort: int | None = None
    answered_after: float | None = None
    state: NodeState | None = None
    emergency: Emergency | None = None
    evidence: dict[str, int] = field(default_factory=dict)

    def add_evidence(self, name: str) -> None:
        """Count one more frame of this kind of evidence."""
        self.evidence[name] = self.evidence.get(name, 0) + 1

    @property
    def why(self) -> str:
        """The evidence in words.

        >>> ScannedNode(5, evidence={"answered": 1, "heartbeat": 3}).why
        'answered, heartbeat (3 times)'
        """
        return ", ".join(name + (f" ({count} times)" if count > 1 else "") for name, count in self.evidence.items())


@dataclass(slots=True)
class ScanResult:
    """The result: the nodes by node-ID, and the number of frames received."""

    nodes: dict[int, ScannedNode] = field(default_factory=dict)
    frames: int = 0
    extended: int = 0  # frames of another protocol
    unknown: int = 0  # base frames that are not evidence of a node

    def __repr__(self) -> str:
        nodes = f"node{'s' if len(self.nodes) > 1 else ''} {', '.join(map(str, sorted(self.nodes)))}"
        return f"<ScanResult: {nodes if self.nodes else 'no nodes'}, {self.frames} frames>"


def scan(
    nodes: Iterable[int] = range(NODE_MIN, NODE_MAX + 1),
    *,
    outstanding: int = 4,
    gap: float = 0.002,
    timeout: float = 0.1,
    listen: float = 0.0,
    ask: bool = True,
    progress: Callable[[int, ScanResult], None] | None = None,
    channels: Callable[[int], Channel] | None = None,
) -> Conversation[CanFrame, ScanResult]:
    """Read the device type of `nodes`, and collect evidence of all nodes meanwhile.

        nodes         the node-IDs to request
        outstanding   how many requests may wait for a response at a time
        gap           shortest time between two requests, in seconds
        timeout       seconds to wait for one response
        listen        seconds to listen before the first request; with a little more than the longest heartbeat time,
                      stopped nodes are found too
        ask           False: send nothing, listen only
        progress      called with the node and the result so far, before each request
        channels      returns the SDO channel to a node. However the scan ends, the channels to nodes without an answer
                      then expect a late response, so that no later upload of 1000h takes it for its own

    >>> from barewire.conversation import play
    >>> def bus(frame, now):
    ...     return [(now + 0.001, CanFrame.parse("585#4300100092010200"))] if frame.id == 0x605 else []
    >>> result, seconds = play(scan(range(1, 11)), bus)
    >>> [(node.node, f"{node.device_type:08X}h", node.why) for node in result.nodes.values()]
    [(5, '00020192h', 'answered')]
    """
    for name, seconds in (("gap", gap), ("listen", listen)):
        if not seconds >= 0:
            raise EncodeError(f"{name} {seconds} s: expected 0 or more", name)
    check_request_timeout(timeout)
    result = ScanResult()
    pending: dict[int, float] = {}  # node -> time of the request
    requested: dict[int, float] = {}  # the same of all requests
    remaining = deque(check_node(node) for node in nodes) if ask else deque[int]()
    heard: Heard[CanFrame] = yield Listen(float("-inf"))
    quiet_until = heard.now + listen
    ready = quiet_until  # when the next request may be sent
    try:
        while True:
            if heard.item is not None:
                abort = _evaluate(result, heard.item, pending, heard.now)
                if abort is not None:
                    yield Send(abort)
            pending = {node: sent_at for node, sent_at in pending.items() if heard.now < sent_at + timeout}
            if remaining and heard.now >= ready and len(pending) < outstanding:
                node = remaining.popleft()
                if progress is not None:
                    progress(node, result)
                requested[node] = heard.now  # before it is sent: the scan may be abandoned then
                sent: Heard[CanFrame] = yield Send(CanFrame(cob_id("SDO request", node), _REQUEST))
                pending[node] = requested[node] = sent.now
                ready = sent.now + gap
            if not remaining and not pending and heard.now >= quiet_until:
                break
            first_timeout = min((sent_at + timeout for sent_at in pending.values()), default=quiet_until)
            heard = yield Listen(ready if remaining and len(pending) < outstanding else max(first_timeout, heard.now))
    finally:
        silent = [node for node in requested if node not in result.nodes or result.nodes[node].answered_after is None]
        if channels is not None:
            for node in silent:
                channel, sent_at = channels(node), requested[node]
                channel.be_quiet(sent_at + 2 * max(timeout, channel.timeout), (_OBJECT,), _OBJECT, sent_at)
    result.nodes = dict(sorted(result.nodes.items()))
    return result


_REQUEST = InitiateUpload(_DEVICE_TYPE, 0).encode()


def _evaluate(result: ScanResult, frame: CanFrame, pending: dict[int, float], now: float) -> CanFrame | None:
    """Add the evidence of a frame. Return the abort to send if the frame begins a transfer that is not wanted."""
    result.frames += 1
    result.extended += frame.extended
    owner = classify(frame)
    if owner is None or frame.remote:
        result.unknown += not frame.extended
        return None
    service, node = owner
    try:
        if service.name == "error control":
            state = NodeState.decode(frame)
            scanned = _entry(result, node)
            scanned.state = state
            scanned.add_evidence("boot-up" if state.is_boot_up else "heartbeat")
        elif service.name == "EMCY":
            emergency = Emergency.decode(frame)
            scanned = _entry(result, node)
            scanned.emergency = emergency
            scanned.add_evidence("emergency")
        elif service.name == "SDO answer":
            return _evaluate_response(result, node, frame, pending, now)
        else:
            result.unknown += 1
    except DecodeError:
        result.unknown += 1
    return None


def _evaluate_response(
    result: ScanResult, node: int, frame: CanFrame, pending: dict[int, float], now: float
) -> CanFrame | None:
    response = decode_sdo_response(frame.data)
    scanned = _entry(result, node)
    address = (getattr(response, "index", None), getattr(response, "sub", None))
    if node not in pending or address != _OBJECT:
        scanned.add_evidence("SDO response to another client")
        return None
    scanned.answered_after = now - pending.pop(node)
    scanned.add_evidence("answered")
    if isinstance(response, Abort):
        scanned.abort = response.code
    elif isinstance(response, ExpeditedUpload):
        scanned.device_type = int.from_bytes(response.data, "little")
    else:  # no device type is longer than 4 bytes: the transfer that this response begins is not carried out
        return CanFrame(cob_id("SDO request", node), Abort(_DEVICE_TYPE, 0, 0x0800_0000).encode())
    return None


def _entry(result: ScanResult, node: int) -> ScannedNode:
    return result.nodes.setdefault(node, ScannedNode(node))
