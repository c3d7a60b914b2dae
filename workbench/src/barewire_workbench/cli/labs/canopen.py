"""Labs 7 to 9: a CAN frame and SDO, NMT, heartbeat and PDO, and a drive moved by both protocols."""

from __future__ import annotations

from barewire import connect
from barewire.canopen.cob_ids import classify, cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtCommand, NmtMessage, NmtState
from barewire.canopen.sdo.messages import ExpeditedDownload, InitiateUpload, decode_sdo_request
from barewire.codecs import codec
from barewire.devices import load
from barewire.devices.cia402 import STATUS_PATTERNS, State, after, command_of, state_of
from barewire.devices.sim import simulator
from barewire.errors import BarewireError, DecodeError
from barewire.modbus import WriteMultipleRegisters, WriteSingleRegister, decode_request
from barewire_workbench import explain
from barewire_workbench.cli.labs.modbus import typed_request
from barewire_workbench.cli.labs.model import (
    AnswerCheck,
    Lab,
    WrongAnswer,
    any_number,
    check_of_meaning,
    checked_length,
    hex_number,
    in_hex,
    right,
    typed_bits,
    typed_endpoint,
    typed_name,
    typed_number,
    wrong,
)
from barewire_workbench.frames.can import explain_can
from barewire_workbench.recordings.candump import parse_can
from barewire_workbench.wire import can_bits

_NODE = 5
"""The node-ID of the drive."""


def can_answers(frame: CanFrame) -> list[CanFrame]:
    """Return what a simulated AZ3 at node 5 sends after a frame, in virtual time.

    >>> [str(frame) for frame in can_answers(CanFrame(0x605, bytes.fromhex("40 41 60 00 00 00 00 00")))]
    ['585#4B41600070120000']
    """
    drive = simulator("az3", 0.0, node=_NODE).canopen
    assert drive is not None
    drive.feed(None, 1.0)  # its boot-up message
    return drive.feed(frame, 1.0)


def _answered_text(frame: CanFrame) -> str:
    answers = [f"the drive answers {answer}: {explain_can(answer).summary}" for answer in can_answers(frame)]
    return "; ".join(answers) or "the drive is silent"


def _typed_frame(answer: str) -> CanFrame:
    return parse_can(checked_length(answer))


def _typed_sdo_request(answer: str) -> CanFrame:
    """Return the SDO request of an answer. Raises WrongAnswer if the drive would not get it."""
    frame = _typed_frame(answer)
    service, node = classify(frame) or (None, None)
    if service is None or service.name != "SDO request":
        what = "no service of CANopen" if service is None else service.name
        raise WrongAnswer(f"identifier {frame.id:03X}h is {what}; an SDO request goes to 600h + node")
    if node != _NODE:
        raise WrongAnswer(f"identifier {frame.id:03X}h is node {node}; the drive is node {_NODE}")
    if len(frame.data) != 8:
        raise WrongAnswer(f"{len(frame.data)} bytes of data; an SDO message has always 8, the unused ones are 00")
    return frame


def _typed_write(answer: str, type_name: str, size: int, index: int, otherwise: str) -> bytes:
    """Return the bytes that an answer writes into an object of the drive.

    Raises WrongAnswer with the text `otherwise` for another request, in which {answered} and {said} are what the
    drive answers and what the frame is.
    """
    frame = _typed_sdo_request(answer)
    request = decode_sdo_request(frame.data)
    if not isinstance(request, ExpeditedDownload) or (request.index, request.sub) != (index, 0):
        raise WrongAnswer(otherwise.format(answered=_answered_text(frame), said=explain_can(frame).summary))
    if len(request.data) != size:
        article = "an" if type_name.startswith("i") else "a"
        needed = f"{article} {type_name} has {size}"
        raise WrongAnswer(f"this writes {len(request.data)} bytes; {needed}; {_answered_text(frame)}")
    return request.data


# Lab 7

SDO_LAB = Lab(
    *(7, "CAN, and an object by SDO"),
    "Find out which frame goes first on a bus, and read and write an object of a drive byte by byte.",
    *(30, "07-can-and-sdo.md"),
    devices=("barewire simulate az3 'can://socketcand/127.0.0.1:29536/can0?node=5'",),
)
_AT_ONCE = (0x585, 0x185, 0x605)
_STUFFED = CanFrame(0x00F)
_OTHER_NODE = 10
_STATUS_OBJECT, _VELOCITY_OBJECT, _VELOCITY = 0x6041, 0x60FF, 1500


@SDO_LAB.ask(
    f"Three nodes begin at the same moment, with the identifiers {', '.join(f'{id:03X}' for id in _AT_ONCE)}. "
    "Whose frame goes through?",
    "one of the identifiers",
    "185",
)
def _arbitration(answer: str) -> AnswerCheck:
    given, winner = hex_number(answer), min(_AT_ONCE)
    if given == winner:
        return right(f"{winner:011b} has the first 0 where the others send 1: a 0 is dominant, so it overwrites a 1")
    if given not in _AT_ONCE:
        return wrong(f"{given:X}h is none of the three identifiers")
    place = 12 - (given ^ winner).bit_length()  # of the first bit that differs, from 1
    return wrong(
        f"{given:03X}h is {given:011b}. At bit {place} of its identifier it sends 1 and another node 0; 0 wins"
    )


@SDO_LAB.ask(
    f"Which levels does a bus show for the start bit and the identifier {_STUFFED.id:03X}h, stuff bits included?",
    "bits in the order of time",
    "0000010001111",
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
    same = 0
    while same < min(len(given), len(expected)) and given[same] == expected[same]:
        same += 1
    if same == len(expected):
        return wrong(f"the first {same} levels are right, and the identifier ends there; what follows is too much")
    return wrong(f"the first {same} levels are right; count equal bits from the start bit on, a stuff bit counts too")


@SDO_LAB.ask(f"Which COB-ID has the SDO answer of node {_OTHER_NODE}?", "three hexadecimal digits", "58A")
def _answer_id(answer: str) -> AnswerCheck:
    given, expected = hex_number(answer), cob_id("SDO answer", _OTHER_NODE)
    service, node = (classify(CanFrame(given)) if given <= 0x7FF else None) or (None, None)
    name = f"{service.name} of node {node}" if service is not None and node else "not of a node"
    return {
        expected: right(f"580h + {_OTHER_NODE} = 580h + {_OTHER_NODE:X}h = {expected:X}h"),
        cob_id("SDO request", _OTHER_NODE): wrong(
            "that is the COB-ID of the request; the answer has another function code"
        ),
        0x580 + 0x10: wrong(f"that is the answer of node 16: node {_OTHER_NODE} is {_OTHER_NODE:X}h"),
    }.get(given, wrong(f"{given:X}h is {name}"))


@SDO_LAB.ask(
    f"Which frame reads the status word, object {_STATUS_OBJECT:04X}h:00, of node {_NODE}?",
    "a CAN frame such as 601#0011223344556677",
    "605#4041600000000000",
)
def _upload(answer: str) -> AnswerCheck:
    frame = _typed_sdo_request(answer)
    request = decode_sdo_request(frame.data)
    if not isinstance(request, InitiateUpload):
        said = f"command {frame.data[0]:02X} is {explain_can(frame).summary}"
        return wrong(f"{said}; to read, it begins with the bits 010")
    if request.index != _STATUS_OBJECT and int.from_bytes(frame.data[1:3], "big") == _STATUS_OBJECT:
        return wrong(f"this reads {request.index:04X}h: the low byte of the index goes first")
    if (request.index, request.sub) != (_STATUS_OBJECT, 0):
        return wrong(f"this reads {request.index:04X}h:{request.sub:02X}")
    return right(_answered_text(frame))


@SDO_LAB.ask("Send it. Which number is the status word?", "a number, hexadecimal with h", "1270h")
def _uploaded(answer: str) -> AnswerCheck:
    (frame,) = can_answers(CanFrame(0x600 + _NODE, InitiateUpload(_STATUS_OBJECT, 0).encode()))
    data = frame.data[4:6]
    value = int.from_bytes(data, "little")
    as_modbus = "that reads the bytes as Modbus would; CANopen sends the low byte first"
    return check_of_meaning(
        any_number(answer),
        {
            value: right(f"{in_hex(data)} is {value:04X}h: CANopen sends the low byte first, Modbus the high one"),
            int.from_bytes(data, "big"): wrong(as_modbus),
        },
        wrong(f"command {frame.data[0]:02X} says that 2 of the last 4 bytes are the value: {in_hex(data)}"),
    )


@SDO_LAB.ask(
    f"Which frame writes {_VELOCITY} into the target velocity, object {_VELOCITY_OBJECT:04X}h:00, type i32, "
    f"of node {_NODE}?",
    "a CAN frame",
    "605#23FF6000DC050000",
)
def _download(answer: str) -> AnswerCheck:
    frame = _typed_sdo_request(answer)
    request = decode_sdo_request(frame.data)
    if not isinstance(request, ExpeditedDownload):
        said = f"command {frame.data[0]:02X} is {explain_can(frame).summary}"
        return wrong(f"{said}; to write up to 4 bytes it is 001 0 nn 1 1, nn: how many of 4 are unused")
    other = f"this writes {request.index:04X}h:{request.sub:02X}; the low byte of the index goes first"
    data = _typed_write(answer, "i32", 4, _VELOCITY_OBJECT, other)
    value = int.from_bytes(data, "little", signed=True)
    if value == _VELOCITY:
        return right(_answered_text(frame))
    is_reversed = int.from_bytes(data, "big") == _VELOCITY
    return wrong(f"this writes {value}{': the low byte goes first' if is_reversed else ''}")


# Lab 8

NMT_LAB = Lab(
    *(8, "NMT, heartbeat and PDO", "Start a node, watch its heartbeat, and exchange process data with it."),
    *(25, "08-nmt-heartbeat-pdo.md"),
    devices=("barewire simulate az3 'can://socketcand/127.0.0.1:29536/can0?node=5'",),
)
_HEARTBEAT = CanFrame(cob_id("error control", _NODE), bytes([NmtState.STOPPED]))
_HEARTBEAT_TIME, _MILLISECONDS = 0x1017, 500
_POSITION = -2500
_POSITION_BYTES = codec("i32").encode(_POSITION)[::-1]
_TPDO2 = CanFrame(cob_id("TPDO2", _NODE), bytes.fromhex("3706") + _POSITION_BYTES + bytes(2))
_ENABLE = 0x000F


@NMT_LAB.ask(f"Which frame stops node {_NODE}?", "a CAN frame", "000#0205")
def _stop(answer: str) -> AnswerCheck:
    frame = _typed_frame(answer)
    try:
        message = NmtMessage.decode(frame)
    except DecodeError as error:
        return wrong(f"{error.text}; an NMT command has two bytes: the command, and the node")
    if message.command != NmtCommand.STOP:
        return wrong(f"command {message.command:02X}h is {explain_can(frame).summary}")
    if message.node not in (_NODE, 0):
        return wrong(f"this stops node {message.node}")
    return right(explain_can(frame).summary + (": every node on the bus" if not message.node else ""))


@NMT_LAB.ask(f"Node {_NODE} sends {_HEARTBEAT}. In which state is it?", "the name of a state", "stopped")
def _node_state(answer: str) -> AnswerCheck:
    states = {state.name.lower().replace("_", " "): state for state in NmtState}
    typed = typed_name(answer, states)
    if states[typed] == _HEARTBEAT.data[0]:
        return right(explain_can(_HEARTBEAT).summary)
    return wrong(f"a node that is {typed} sends {_HEARTBEAT.id:03X}#{states[typed]:02X}")


@NMT_LAB.ask(
    f"Which frame makes node {_NODE} send a heartbeat every {_MILLISECONDS} ms? "
    f"(object {_HEARTBEAT_TIME:04X}h:00, u16, in ms)",
    "a CAN frame",
    "605#2B171000F4010000",
)
def _heartbeat_time(answer: str) -> AnswerCheck:
    other = f"this is {{said}}; the task asks to write {_HEARTBEAT_TIME:04X}h:00"
    value = int.from_bytes(_typed_write(answer, "u16", 2, _HEARTBEAT_TIME, other), "little")
    return right(_answered_text(_typed_frame(answer))) if value == _MILLISECONDS else wrong(f"this writes {value} ms")


@NMT_LAB.ask(
    "TPDO2 of the drive has the status word, u16, the position, i32, and the error register, u16. "
    f"It sends {_TPDO2}. Where is the motor?",
    "a position, in steps",
    "-2500",
)
def _position(answer: str) -> AnswerCheck:
    unsigned, digits = _POSITION & 0xFFFFFFFF, in_hex(_POSITION_BYTES)
    high_first = "that reads the high byte first; CANopen sends the low one first"
    checks: dict[float, AnswerCheck] = {
        _POSITION: right(f"{digits}, the low byte first, is {unsigned:08X}h, as i32 {_POSITION}"),
        unsigned: wrong("that is the number without a sign; the position is an i32"),
        int.from_bytes(_POSITION_BYTES, "big", signed=True): wrong(high_first),
    }
    otherwise = wrong(f"the first two bytes are the status word, the next four, {digits}, the position")
    return checks.get(typed_number(answer), otherwise)


@NMT_LAB.ask(
    "RPDO1 has the control word, u16, and the target velocity, i32. "
    f"Which frame gives node {_NODE} control word {_ENABLE:04X}h and {_VELOCITY}?",
    "a CAN frame",
    "205#0F00DC050000",
)
def _rpdo(answer: str) -> AnswerCheck:
    frame = _typed_frame(answer)
    pdo = next(pdo for pdo in load("az3").canopen.pdos if pdo.name == "RPDO1")  # type: ignore[union-attr]
    size = sum(bits for _, _, bits in pdo.map) // 8
    if frame.id != cob_id("RPDO1", _NODE):
        return wrong(f"{explain_can(frame).summary}; RPDO1 of node {_NODE} has the identifier 200h + {_NODE}")
    if len(frame.data) != size:
        return wrong(f"{len(frame.data)} bytes; 16 bits and 32 bits are {size}")
    control, velocity = int.from_bytes(frame.data[:2], "little"), int.from_bytes(frame.data[2:], "little", signed=True)
    if (control, velocity) == (_ENABLE, _VELOCITY):
        return right("one frame and no answer: that is what PDOs are for. The drive uses it after the next SYNC")
    return wrong(f"this is control word {control:04X}h and target velocity {velocity}")


# Lab 9

DRIVE_LAB = Lab(
    *(9, "A drive, enabled and moved"),
    "Take a servo drive through its states by hand, over Modbus and over CANopen, and move its motor.",
    *(25, "09-a-drive-moved.md"),
    devices=("barewire simulate az3 rtu:///tmp/az3 'can://socketcand/127.0.0.1:29536/can0?node=5'",),
)
_STATUS = 0x0233
_TARGET = 3000
_TIMEOUT = 3.0
"""Seconds that the check of the motor waits for an answer, if the URL does not say it."""


def _control_address() -> int:
    place = load("az3").find("CONTROL WORD").modbus
    assert place is not None
    return place.address


def _command_name(word: int) -> str:
    command = command_of(word)
    return "no command" if command is None else command.name.lower().replace("_", " ")


@DRIVE_LAB.ask(
    f"The status word of a drive is {_STATUS:04X}h. In which state is it?", "the name of a state", "switched on"
)
def _drive_state(answer: str) -> AnswerCheck:
    states = {state.value: state for state in State}
    typed = typed_name(answer, states)
    mask, value = STATUS_PATTERNS[states[typed]]
    if states[typed] is state_of(_STATUS):
        return right(f"{_STATUS:04X}h and {mask:04X}h is {value:04X}h")
    return wrong(
        f"{typed}: the bits {mask:04X}h of the status word would be {value:04X}h; here they are {_STATUS & mask:04X}h"
    )


@DRIVE_LAB.ask("A drive is switched on. Which control word enables it?", "a word in hexadecimal", "000F")
def _enabling(answer: str) -> AnswerCheck:
    # Words of 16 bits are usually written in hexadecimal; 15 and 31 in decimal give the same state as 0Fh and 1Fh.
    reached: list[str] = []
    for word in sorted(any_number(answer)):
        state = after(State.SWITCHED_ON, word)
        if state is State.OPERATION_ENABLED and 0 <= word <= 0xFFFF:
            return right(f"{word:04X}h is the command enable operation")
        reached.append(f"{word:04X}h is {_command_name(word)}: {state.value}")
    return wrong("after " + "; ".join(reached))


def _shut_down(word: int) -> AnswerCheck:
    state = after(State.SWITCH_ON_DISABLED, word)
    text = f"{word:04X}h is {_command_name(word)}; the drive is {state.value} after it"
    return right(text) if state is State.READY_TO_SWITCH_ON else wrong(text)


@DRIVE_LAB.ask(
    f"Which RTU frame writes the control word, holding register {_control_address()} of unit 1, "
    "so that a drive in switch on disabled becomes ready to switch on?",
    "the bytes of a request; the CRC may be left out",
    "01 06 00 9A 00 06",
)
def _by_modbus(answer: str) -> AnswerCheck:
    frame = typed_request(answer)
    match decode_request(frame[1:-2]):
        case WriteSingleRegister(address, value) | WriteMultipleRegisters(address, (value,)):
            if address == _control_address():
                return _shut_down(value)
            return wrong(f"this writes register {address}; the control word is holding register {_control_address()}")
    return wrong(f"{explain('rtu', frame, 'request').summary}; to write one register there is function 06")


@DRIVE_LAB.ask(
    "Which CAN frame does the same with object 6040h:00, u16, of node 5?", "a CAN frame", "605#2B40600006000000"
)
def _by_canopen(answer: str) -> AnswerCheck:
    other = "{answered}; the task asks to write, and the control word is object 6040h:00"
    return _shut_down(int.from_bytes(_typed_write(answer, "u16", 2, 0x6040, other), "little"))


@DRIVE_LAB.ask(
    f"Move the motor to position {_TARGET} and leave the drive enabled. At which URL is it?",
    "the URL of the drive, rtu:// or can://",
    "rtu:///tmp/az3",
)
def _moved(answer: str) -> AnswerCheck:
    try:
        endpoint = typed_endpoint(answer, "rtu", "can")
        options = {} if "timeout" in endpoint.options else {"timeout": _TIMEOUT}
        with connect("az3", str(endpoint), **options) as drive:
            status, position = int(drive.read("STATUS WORD")), int(drive.read("POSITION ACTUAL VALUE"))
    except BarewireError as error:
        return wrong(f"the drive was not read: {error}")
    state = state_of(status)
    if state is not State.OPERATION_ENABLED:
        return wrong(f"the drive is {state.value}; the motor has no current")
    if abs(position - _TARGET) > 10:
        return wrong(f"the motor is at {position}, not at {_TARGET}")
    return right(f"operation enabled, position {position}, read over {endpoint.scheme}")
