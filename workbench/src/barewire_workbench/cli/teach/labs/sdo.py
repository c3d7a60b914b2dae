"""Lab 7: a CAN frame, who goes first on the bus, and an object read and written by SDO."""

from __future__ import annotations

from barewire.canopen.cob_ids import classify, cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.messages import ExpeditedDownload, InitiateUpload, decode_sdo_request
from barewire_workbench.cli.teach.labs.model import AnswerCheck, Lab, LabExercise, right, wrong
from barewire_workbench.cli.teach.labs.played import LAB_NODE, can_answers
from barewire_workbench.cli.teach.labs.reading import any_number, checked_length, hex_number, in_hex, typed_bits
from barewire_workbench.frames.can import explain_can
from barewire_workbench.recordings.can_text import parse_can
from barewire_workbench.wire import can_bits

_AT_ONCE = (0x585, 0x185, 0x605)
_STUFFED = CanFrame(0x00F)
_OTHER_NODE = 10
_STATUS, _VELOCITY = 0x6041, 0x60FF
_TARGET = 1500


def can_frame(answer: str) -> CanFrame:
    """Return the CAN frame of an answer; the zeros at the end of an SDO may be left out."""
    return parse_can(checked_length(answer))


def _arbitration(answer: str) -> AnswerCheck:
    given, winner = hex_number(answer), min(_AT_ONCE)
    if given == winner:
        return right(f"{winner:011b} has the first 0 where the others send 1: a 0 is dominant, so it overwrites a 1")
    if given not in _AT_ONCE:
        return wrong(f"{given:X}h is none of the three identifiers")
    place = next(place for place in range(11) if (given ^ winner) >> 10 - place & 1)
    return wrong(
        f"{given:03X}h is {given:011b}. At bit {place + 1} of its identifier it sends 1 and another node 0; 0 wins"
    )


def _stuffing(answer: str) -> AnswerCheck:
    given = typed_bits(answer)
    start = [bit for bit in can_bits(_STUFFED).bits if bit.part == "start" or bit.field == "identifier"]
    expected, plain = [bit.level for bit in start], [bit.level for bit in start if not bit.is_stuff]
    if given == expected:
        return right("five equal bits are followed by the opposite one, which every receiver takes out again")
    if given == plain:
        return wrong("these are the start bit and the identifier, without stuff bits")
    if given[:1] != [0]:
        return wrong("a frame begins with the start bit, which is 0")
    same = next(
        (place for place, (one, other) in enumerate(zip(given, expected)) if one != other),
        min(len(given), len(expected)),
    )
    if same == len(expected):
        return wrong(f"the first {same} levels are right, and the identifier ends there; what follows is too much")
    return wrong(f"the first {same} levels are right; count equal bits from the start bit on, a stuff bit counts too")


def _answer_id(answer: str) -> AnswerCheck:
    given, expected = hex_number(answer), cob_id("SDO answer", _OTHER_NODE)
    if given == expected:
        return right(f"580h + {_OTHER_NODE} = 580h + {_OTHER_NODE:X}h = {expected:X}h")
    if given == cob_id("SDO request", _OTHER_NODE):
        return wrong("that is the COB-ID of the request; the answer has another function code")
    if given == 0x580 + 0x10:
        return wrong(f"that is the answer of node 16: node {_OTHER_NODE} is {_OTHER_NODE:X}h")
    found = classify(CanFrame(given)) if given <= 0x7FF else None
    return wrong(f"{given:X}h is {f'{found[0].name} of node {found[1]}' if found and found[1] else 'not of a node'}")


def played_request(answer: str) -> tuple[CanFrame, AnswerCheck | None]:
    """Return the SDO request of an answer; with a hint if the drive of the labs would not get it."""
    frame = can_frame(answer)
    found = classify(frame)
    if found is None or found[0].name != "SDO request":
        what = "no service of CANopen" if found is None else found[0].name
        return frame, wrong(f"identifier {frame.id:03X}h is {what}; an SDO request goes to 600h + node")
    if found[1] != LAB_NODE:
        return frame, wrong(f"identifier {frame.id:03X}h is node {found[1]}; the drive is node {LAB_NODE}")
    if len(frame.data) != 8:
        return frame, wrong(f"{len(frame.data)} bytes of data; an SDO message has always 8, the unused ones are 00")
    return frame, None


def answered_text(frame: CanFrame) -> str:
    """Return what the drive of the labs answers, in words."""
    answers = can_answers(frame)
    return (
        "; ".join(f"the drive answers {answer}: {explain_can(answer).summary}" for answer in answers)
        or "the drive is silent"
    )


def _upload(answer: str) -> AnswerCheck:
    frame, hint = played_request(answer)
    if hint is not None:
        return hint
    request = decode_sdo_request(frame.data)
    if not isinstance(request, InitiateUpload):
        return wrong(
            f"command {frame.data[0]:02X} is {explain_can(frame).summary}; to read, it begins with the bits 010"
        )
    if request.index != _STATUS and int.from_bytes(frame.data[1:3], "big") == _STATUS:
        return wrong(f"this reads {request.index:04X}h: the low byte of the index goes first")
    if (request.index, request.sub) != (_STATUS, 0):
        return wrong(f"this reads {request.index:04X}h:{request.sub:02X}")
    return right(answered_text(frame))


def _uploaded(answer: str) -> AnswerCheck:
    given, frame = any_number(answer), can_answers(CanFrame(0x600 + LAB_NODE, InitiateUpload(_STATUS, 0).encode()))[0]
    data = frame.data[4:6]
    if int.from_bytes(data, "little") in given:
        return right(
            f"{in_hex(data)} is {int.from_bytes(data, 'little'):04X}h: CANopen sends "
            "the low byte first, Modbus the high one"
        )
    if int.from_bytes(data, "big") in given:
        return wrong("that reads the bytes as Modbus would; CANopen sends the low byte first")
    return wrong(f"command {frame.data[0]:02X} says that 2 of the last 4 bytes are the value: {in_hex(data)}")


def _download(answer: str) -> AnswerCheck:
    frame, hint = played_request(answer)
    if hint is not None:
        return hint
    request = decode_sdo_request(frame.data)
    if not isinstance(request, ExpeditedDownload):
        return wrong(
            f"command {frame.data[0]:02X} is {explain_can(frame).summary}; to write up to 4 bytes "
            "it is 001 0 nn 1 1, nn: how many of 4 are unused"
        )
    if (request.index, request.sub) != (_VELOCITY, 0):
        return wrong(f"this writes {request.index:04X}h:{request.sub:02X}; the low byte of the index goes first")
    if len(request.data) != 4:
        return wrong(f"this writes {len(request.data)} bytes; an i32 has 4; {answered_text(frame)}")
    value = int.from_bytes(request.data, "little", signed=True)
    if value != _TARGET:
        return wrong(
            f"this writes {value}"
            + (": the low byte goes first" if int.from_bytes(request.data, "big") == _TARGET else "")
        )
    return right(answered_text(frame))


SDO_LAB = Lab(
    7,
    "CAN, and an object by SDO",
    "Find out which frame goes first on a bus, and read and write an object of a drive byte by byte.",
    30,
    "07-can-and-sdo.md",
    ("barewire simulate az3 'can://socketcand/127.0.0.1:29536/can0?node=5'",),
    (
        LabExercise(
            "7.1",
            "Three nodes begin at the same moment, with the identifiers "
            f"{', '.join(f'{id:03X}' for id in _AT_ONCE)}. Whose frame goes through?",
            "one of the identifiers",
            _arbitration,
        ),
        LabExercise(
            "7.2",
            "Which levels does a bus show for the start bit and the identifier "
            f"{_STUFFED.id:03X}h, stuff bits included?",
            "bits in the order of time",
            _stuffing,
        ),
        LabExercise(
            "7.3", f"Which COB-ID has the SDO answer of node {_OTHER_NODE}?", "three hexadecimal digits", _answer_id
        ),
        LabExercise(
            "7.4",
            f"Which frame reads the status word, object {_STATUS:04X}h:00, of node {LAB_NODE}?",
            "a CAN frame such as 601#0011223344556677",
            _upload,
        ),
        LabExercise("7.5", "Send it. Which number is the status word?", "a number, hexadecimal with h", _uploaded),
        LabExercise(
            "7.6",
            f"Which frame writes {_TARGET} into the target velocity, object "
            f"{_VELOCITY:04X}h:00, type i32, of node {LAB_NODE}?",
            "a CAN frame",
            _download,
        ),
    ),
)
