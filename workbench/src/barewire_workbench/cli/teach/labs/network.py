"""Lab 8: NMT commands, heartbeats, and process data in PDOs."""

from __future__ import annotations

from barewire.canopen.cob_ids import cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtCommand, NmtMessage, NmtState
from barewire.canopen.sdo.messages import ExpeditedDownload, decode_sdo_request
from barewire.codecs import codec
from barewire.devices import load
from barewire.errors import DecodeError
from barewire_workbench.cli.teach.labs.model import AnswerCheck, Lab, LabExercise, right, wrong
from barewire_workbench.cli.teach.labs.played import LAB_NODE
from barewire_workbench.cli.teach.labs.reading import checked_length, in_hex, typed_number
from barewire_workbench.cli.teach.labs.sdo import answered_text, can_frame, played_request
from barewire_workbench.frames.can import explain_can

_HEARTBEAT = CanFrame(cob_id("error control", LAB_NODE), bytes([NmtState.STOPPED]))
_HEARTBEAT_TIME, _MILLISECONDS = 0x1017, 500
_POSITION = -2500
_STATUS_WORD = 0x0637
_ENABLE, _VELOCITY = 0x000F, 1500


def _little(name: str, value: int) -> bytes:
    return codec(name).encode(value)[::-1]


def _tpdo2() -> CanFrame:
    """Return a TPDO2 of the drive: status word, position, error register."""
    return CanFrame(cob_id("TPDO2", LAB_NODE), _little("u16", _STATUS_WORD) + _little("i32", _POSITION) + bytes(2))


def _stop(answer: str) -> AnswerCheck:
    frame = can_frame(answer)
    try:
        message = NmtMessage.decode(frame)
    except DecodeError as error:
        return wrong(f"{error.text}; an NMT command has two bytes: the command, and the node")
    if message.command != NmtCommand.STOP:
        return wrong(f"command {message.command:02X}h is {explain_can(frame).summary}")
    if message.node not in (LAB_NODE, 0):
        return wrong(f"this stops node {message.node}")
    return right(explain_can(frame).summary + (": every node on the bus" if not message.node else ""))


def _state(answer: str) -> AnswerCheck:
    typed = checked_length(answer).lower().replace("-", " ").replace("_", " ")
    names = {state.name.lower().replace("_", " "): state for state in NmtState}
    if typed not in names:
        return wrong(f"expected one of {', '.join(names).replace('pre op', 'pre-op')}")
    if names[typed] == _HEARTBEAT.data[0]:
        return right(explain_can(_HEARTBEAT).summary)
    return wrong(f"a node that is {typed} sends {cob_id('error control', LAB_NODE):03X}#{names[typed]:02X}")


def _heartbeat_time(answer: str) -> AnswerCheck:
    frame, hint = played_request(answer)
    if hint is not None:
        return hint
    request = decode_sdo_request(frame.data)
    if not isinstance(request, ExpeditedDownload) or (request.index, request.sub) != (_HEARTBEAT_TIME, 0):
        return wrong(f"this is {explain_can(frame).summary}; the task asks to write {_HEARTBEAT_TIME:04X}h:00")
    if len(request.data) != 2:
        return wrong(f"this writes {len(request.data)} bytes; a u16 has 2; {answered_text(frame)}")
    value = int.from_bytes(request.data, "little")
    return right(answered_text(frame)) if value == _MILLISECONDS else wrong(f"this writes {value} ms")


def _position(answer: str) -> AnswerCheck:
    given, data = typed_number(answer), _tpdo2().data[2:6]
    if given == _POSITION:
        return right(f"{in_hex(data)}, the low byte first, is {_POSITION & 0xFFFFFFFF:08X}h, as i32 {_POSITION}")
    if given == _POSITION & 0xFFFFFFFF:
        return wrong("that is the number without a sign; the position is an i32")
    if given == int.from_bytes(data, "big", signed=True):
        return wrong("that reads the high byte first; CANopen sends the low one first")
    return wrong(f"the first two bytes are the status word, the next four, {in_hex(data)}, the position")


def _rpdo(answer: str) -> AnswerCheck:
    frame = can_frame(answer)
    pdo = next(pdo for pdo in load("az3").canopen.pdos if pdo.name == "RPDO1")  # type: ignore[union-attr]
    size = sum(bits for _, _, bits in pdo.map) // 8
    if frame.id != cob_id("RPDO1", LAB_NODE):
        return wrong(f"{explain_can(frame).summary}; RPDO1 of node {LAB_NODE} has the identifier 200h + {LAB_NODE}")
    if len(frame.data) != size:
        return wrong(f"{len(frame.data)} bytes; 16 bits and 32 bits are {size}")
    control, velocity = int.from_bytes(frame.data[:2], "little"), int.from_bytes(frame.data[2:], "little", signed=True)
    if (control, velocity) == (_ENABLE, _VELOCITY):
        return right("one frame and no answer: that is what PDOs are for. The drive uses it after the next SYNC")
    return wrong(f"this is control word {control:04X}h and target velocity {velocity}")


NMT_LAB = Lab(
    8,
    "NMT, heartbeat and PDO",
    "Start a node, watch its heartbeat, and exchange process data with it.",
    25,
    "08-nmt-heartbeat-pdo.md",
    ("barewire simulate az3 'can://socketcand/127.0.0.1:29536/can0?node=5'",),
    (
        LabExercise("8.1", f"Which frame stops node {LAB_NODE}?", "a CAN frame", _stop),
        LabExercise("8.2", f"Node {LAB_NODE} sends {_HEARTBEAT}. In which state is it?", "the name of a state", _state),
        LabExercise(
            "8.3",
            f"Which frame makes node {LAB_NODE} send a heartbeat every {_MILLISECONDS} ms? "
            f"(object {_HEARTBEAT_TIME:04X}h:00, u16, in ms)",
            "a CAN frame",
            _heartbeat_time,
        ),
        LabExercise(
            "8.4",
            "TPDO2 of the drive has the status word, u16, the position, i32, and the error "
            f"register, u16. It sends {_tpdo2()}. Where is the motor?",
            "a position, in steps",
            _position,
        ),
        LabExercise(
            "8.5",
            "RPDO1 has the control word, u16, and the target velocity, i32. Which frame gives node "
            f"{LAB_NODE} control word {_ENABLE:04X}h and {_VELOCITY}?",
            "a CAN frame",
            _rpdo,
        ),
    ),
)
