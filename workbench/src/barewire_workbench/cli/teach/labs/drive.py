"""Lab 9: the states of a drive, enabled and moved by Modbus and by CANopen."""

from __future__ import annotations

from barewire import connect
from barewire.canopen.sdo.messages import ExpeditedDownload, decode_sdo_request
from barewire.devices import load
from barewire.devices.cia402 import STATUS_PATTERNS, State, after, command_of, state_of
from barewire.errors import BarewireError, EncodeError
from barewire.io.endpoint import Endpoint
from barewire.modbus import WriteMultipleRegisters, WriteSingleRegister, decode_request
from barewire_workbench import explain
from barewire_workbench.cli.teach.labs.model import AnswerCheck, Lab, LabExercise, right, wrong
from barewire_workbench.cli.teach.labs.reading import any_number, checked_length
from barewire_workbench.cli.teach.labs.register import typed_request
from barewire_workbench.cli.teach.labs.sdo import answered_text, played_request

_STATUS = 0x0233
_TARGET = 3000
_TIMEOUT = 3.0
"""Seconds that the check of the motor waits for an answer, if the URL does not say it."""


def _control_address() -> int:
    place = load("az3").find("CONTROL WORD").modbus
    assert place is not None
    return place.address


def _state(answer: str) -> AnswerCheck:
    typed = " ".join(checked_length(answer).lower().replace("-", " ").replace("_", " ").split())
    states = {state.value: state for state in State}
    if typed not in states:
        return wrong(f"expected one of {', '.join(states)}")
    mask, value = STATUS_PATTERNS[states[typed]]
    if states[typed] is state_of(_STATUS):
        return right(f"{_STATUS:04X}h and {mask:04X}h is {value:04X}h")
    return wrong(
        f"{typed}: the bits {mask:04X}h of the status word would be {value:04X}h; here they are {_STATUS & mask:04X}h"
    )


def _enabling(answer: str) -> AnswerCheck:
    # Words of 16 bits are usually written in hexadecimal; 15 and 31 in decimal give the same state as 0Fh and 1Fh.
    reached: list[str] = []
    for word in sorted(any_number(answer)):
        state, command = after(State.SWITCHED_ON, word), command_of(word)
        if state is State.OPERATION_ENABLED and 0 <= word <= 0xFFFF:
            return right(f"{word:04X}h is the command enable operation")
        reached.append(
            f"{word:04X}h is {command.name.lower().replace('_', ' ') if command is not None else 'no command'}: "
            f"{state.value}"
        )
    return wrong("after " + "; ".join(reached))


def _by_modbus(answer: str) -> AnswerCheck:
    frame, hint = typed_request(answer)
    if hint is not None:
        return hint
    request = decode_request(frame[1:-2])
    match request:
        case WriteSingleRegister(address, value):
            pass
        case WriteMultipleRegisters(address, (value,)):
            pass
        case _:
            return wrong(f"{explain('rtu', frame, 'request').summary}; to write one register there is function 06")
    if address != _control_address():
        return wrong(f"this writes register {address}; the control word is holding register {_control_address()}")
    return _shut_down(value)


def _by_canopen(answer: str) -> AnswerCheck:
    frame, hint = played_request(answer)
    if hint is not None:
        return hint
    request = decode_sdo_request(frame.data)
    if not isinstance(request, ExpeditedDownload) or (request.index, request.sub) != (0x6040, 0):
        return wrong(f"{answered_text(frame)}; the task asks to write, and the control word is object 6040h:00")
    if len(request.data) != 2:
        return wrong(f"this writes {len(request.data)} bytes; a u16 has 2; {answered_text(frame)}")
    return _shut_down(int.from_bytes(request.data, "little"))


def _shut_down(word: int) -> AnswerCheck:
    state, command = after(State.SWITCH_ON_DISABLED, word), command_of(word)
    text = (
        f"{word:04X}h is {command.name.lower().replace('_', ' ') if command is not None else 'no command'}; "
        f"the drive is {state.value} after it"
    )
    return right(text) if state is State.READY_TO_SWITCH_ON else wrong(text)


def checked_endpoint(answer: str, *schemes: str) -> Endpoint:
    """Return the endpoint of an answer that is a URL. Raises EncodeError for another text or scheme."""
    endpoint = Endpoint.parse(checked_length(answer))
    if endpoint.scheme not in schemes:
        raise EncodeError(f"{endpoint.scheme}://: expected {' or '.join(f'{scheme}://' for scheme in schemes)}")
    return endpoint


def _moved(answer: str) -> AnswerCheck:
    try:
        endpoint = checked_endpoint(answer, "rtu", "can")
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


DRIVE_LAB = Lab(
    9,
    "A drive, enabled and moved",
    "Take a servo drive through its states by hand, over Modbus and over CANopen, and move its motor.",
    25,
    "09-a-drive-moved.md",
    ("barewire simulate az3 rtu:///tmp/az3 'can://socketcand/127.0.0.1:29536/can0?node=5'",),
    (
        LabExercise(
            "9.1", f"The status word of a drive is {_STATUS:04X}h. In which state is it?", "the name of a state", _state
        ),
        LabExercise(
            "9.2", "A drive is switched on. Which control word enables it?", "a word in hexadecimal", _enabling
        ),
        LabExercise(
            "9.3",
            "Which RTU frame writes the control word, holding register "
            f"{_control_address()} of unit 1, so that a drive in "
            "switch on disabled becomes ready to switch on?",
            "the bytes of a request; the CRC may be left out",
            _by_modbus,
        ),
        LabExercise(
            "9.4", "Which CAN frame does the same with object 6040h:00, u16, of node 5?", "a CAN frame", _by_canopen
        ),
        LabExercise(
            "9.5",
            f"Move the motor to position {_TARGET} and leave the drive enabled. At which URL is it?",
            "the URL of the drive, rtu:// or can://",
            _moved,
        ),
    ),
)
