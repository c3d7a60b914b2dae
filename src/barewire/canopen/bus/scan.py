"""Who is on the bus? Every node with the reason why we believe in it.   [CiA 301, predefined connection set]

        600h+n | 40 00 10 00 ...   ->             1000h exists in every device, so everybody has an answer
                               <-  580h+n         the device type, or an abort: somebody is there either way

        heard on the way      700h+n heartbeat, boot-up      080h+n emergency      580h+n an answer to somebody else

Not 127 questions in one burst, which overruns the buffers of adapters and devices: at most `outstanding` unanswered
at a time, and `gap` seconds between two. Nodes that do not speak SDO now (STOPPED) are found by what they say of
themselves, if one listens for as long as their heartbeat takes.

A foreign protocol on the same cable cannot make nodes: an extended frame is never evidence, whatever its number, nor
is a remote frame, nor an answer that is no SDO.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from barewire.canopen.cob_ids import NODE_MAX, NODE_MIN, check_node, classify, cob_id
from barewire.canopen.emcy.message import Emergency
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.heartbeat import NodeState
from barewire.canopen.sdo import Abort, ExpeditedUpload, InitiateUpload, decode_sdo_response
from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import DecodeError

DEVICE_TYPE = 0x1000


@dataclass(slots=True)
class ScannedNode:
    """A node, and why.

    `device_type` is 1000h if it was told, `abort` the code of a node that refused to tell, `answered_after` how many
    seconds its answer took. `state` is what it said of itself last. `evidence` counts each kind of sign.
    """

    node: int
    device_type: int | None = None
    abort: int | None = None
    answered_after: float | None = None
    state: NodeState | None = None
    emergency: Emergency | None = None
    evidence: dict[str, int] = field(default_factory=dict)

    def note(self, why: str) -> None:
        """One more sign of that kind."""
        self.evidence[why] = self.evidence.get(why, 0) + 1

    @property
    def why(self) -> str:
        """The evidence in words.

        >>> ScannedNode(5, evidence={"answered": 1, "heartbeat": 3}).why
        'answered, heartbeat (3 times)'
        """
        return ", ".join(what + (f" ({times} times)" if times > 1 else "") for what, times in self.evidence.items())


@dataclass(slots=True)
class ScanResult:
    """The result: the nodes by number, and what was heard beside them."""

    nodes: dict[int, ScannedNode] = field(default_factory=dict)
    frames: int = 0
    extended: int = 0  # of another protocol
    unknown: int = 0  # base frames that are nobody's sign of life


def scan(
    nodes: Iterable[int] = range(NODE_MIN, NODE_MAX + 1),
    *,
    outstanding: int = 4,
    gap: float = 0.002,
    timeout: float = 0.1,
    listen: float = 0.0,
    ask: bool = True,
    progress: Callable[[int, ScanResult], None] | None = None,
) -> Conversation[CanFrame, ScanResult]:
    """Ask the nodes for their device type and listen to everybody meanwhile.

    `listen` so many seconds before the first question: with a little more than the longest heartbeat time, stopped
    nodes are found as well. Without `ask` nothing is sent. `progress(node, survey)` is called for each node asked.

    >>> from barewire.conversation import play
    >>> def bus(frame, now):
    ...     return [(now + 0.001, CanFrame.parse("585#4300100092010200"))] if frame.id == 0x605 else []
    >>> survey, seconds = play(scan(range(1, 11)), bus)
    >>> [(found.node, f"{found.device_type:08X}h", found.why) for found in survey.nodes.values()]
    [(5, '00020192h', 'answered')]
    """
    survey = ScanResult()
    asked: dict[int, float] = {}  # node -> when
    left = [check_node(node) for node in nodes] if ask else []
    left.reverse()
    heard: Heard[CanFrame] = yield Listen(float("-inf"))
    quiet_until = heard.now + listen
    ready = quiet_until  # when the next question may go out
    while True:
        if heard.item is not None:
            refused = _note(survey, heard.item, asked, heard.now)
            if refused is not None:
                yield Send(refused)
        asked = {node: when for node, when in asked.items() if heard.now < when + timeout}
        if left and heard.now >= ready and len(asked) < outstanding:
            node = left.pop()
            if progress is not None:
                progress(node, survey)
            sent: Heard[CanFrame] = yield Send(CanFrame(cob_id("SDO request", node), _QUESTION))
            asked[node] = sent.now
            ready = sent.now + gap
        if not left and not asked and heard.now >= quiet_until:
            break
        first_over = min((when + timeout for when in asked.values()), default=quiet_until)
        heard = yield Listen(ready if left and len(asked) < outstanding else max(first_over, heard.now))
    survey.nodes = dict(sorted(survey.nodes.items()))
    return survey


_QUESTION = InitiateUpload(DEVICE_TYPE, 0).encode()


def _note(survey: ScanResult, frame: CanFrame, asked: dict[int, float], now: float) -> CanFrame | None:
    """What the frame is evidence of. Returned is what must be said to it: the end of a transfer that nobody wants."""
    survey.frames += 1
    survey.extended += frame.extended
    owner = classify(frame)
    if owner is None or frame.remote:
        survey.unknown += not frame.extended
        return None
    service, node = owner
    try:
        if service.name == "error control":
            told = NodeState.decode(frame)
            _at(survey, node).state = told
            _at(survey, node).note("boot-up" if told.is_boot_up else "heartbeat")
        elif service.name == "EMCY":
            emergency = Emergency.decode(frame)
            _at(survey, node).emergency = emergency
            _at(survey, node).note("emergency")
        elif service.name == "SDO answer":
            return _note_answer(survey, node, frame, asked, now)
        else:
            survey.unknown += 1
    except DecodeError:
        survey.unknown += 1
    return None


def _note_answer(
    survey: ScanResult, node: int, frame: CanFrame, asked: dict[int, float], now: float
) -> CanFrame | None:
    answer = decode_sdo_response(frame.data)
    found = _at(survey, node)
    ours = node in asked and (getattr(answer, "index", None), getattr(answer, "sub", None)) == (DEVICE_TYPE, 0)
    if not ours:
        found.note("an SDO answer to somebody else")
        return None
    found.answered_after = now - asked.pop(node)
    found.note("answered")
    if isinstance(answer, Abort):
        found.abort = answer.code
    elif isinstance(answer, ExpeditedUpload):
        found.device_type = int.from_bytes(answer.data, "little")
    else:
        return CanFrame(cob_id("SDO request", node), Abort(DEVICE_TYPE, 0, 0x0800_0000).encode())
    return None


def _at(survey: ScanResult, node: int) -> ScannedNode:
    return survey.nodes.setdefault(node, ScannedNode(node))
