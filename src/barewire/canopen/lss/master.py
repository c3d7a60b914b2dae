"""The master's side of LSS, service by service. Each is a conversation.   [CiA 305]

master                                   the devices
40 41 42 43 | address          ->
                               <-        44            the one with this address: True, or silence: False
11 | 05                        ->
                               <-        11 | 00       done, or LssRefused
17                             ->
                               <-        17 | 00       stored
04 | 00                        ->                      all back to waiting; a device that got its node-ID now boots

There is one master on a bus and it asks one thing at a time, so an answer belongs to the last question. Silence is a
usual answer here: where it means "nobody", the result says so; where a device in configuration must answer, it is
NoAnswer.
"""

from __future__ import annotations

from barewire.canopen.cob_ids import check_node
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import (
    UNCONFIGURED,
    LssAddress,
    LssMessage,
    LssRefused,
    LssService,
    LssState,
    with_number,
)
from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import DecodeError, EncodeError, NoAnswer

LSS_TIMEOUT = 0.5
"""Seconds to wait for an answer. Devices need about a millisecond; an adapter behind USB needs up to 20."""


def send_lss(message: LssMessage) -> Conversation[CanFrame, float]:
    """Say something that nobody answers. Returns when it was out."""
    sent: Heard[CanFrame] = yield Send(message.encode())
    return sent.now


def request_lss(
    message: LssMessage, wanted: int, timeout: float = LSS_TIMEOUT
) -> Conversation[CanFrame, LssMessage | None]:
    """Say something and return the first answer of the service `wanted`, None if none came in time."""
    now = yield from send_lss(message)
    until = now + timeout
    while True:
        heard: Heard[CanFrame] = yield Listen(until)
        if heard.item is not None:
            answer = read_answer(heard.item, wanted)
            if answer is not None:
                return answer
        if heard.now >= until:
            return None


def read_answer(frame: CanFrame, wanted: int) -> LssMessage | None:
    """The frame as an answer of this service, None for whatever else it is."""
    try:
        message = LssMessage.decode(frame)
    except DecodeError:
        return None
    return message if message.answer and message.service == wanted else None


def count_answers(message: LssMessage, wanted: int, timeout: float) -> Conversation[CanFrame, int]:
    """Say something and count the answers until the time is up. On a wire answers of one moment are one frame."""
    now = yield from send_lss(message)
    until, count = now + timeout, 0
    while True:
        heard: Heard[CanFrame] = yield Listen(until)
        if heard.item is not None:
            count += read_answer(heard.item, wanted) is not None
        if heard.now >= until:
            return count


def switch_global(state: LssState) -> Conversation[CanFrame, None]:
    """Every device to waiting or to configuration. Configuration for all is for a bus with one device on it."""
    yield from send_lss(LssMessage(LssService.SWITCH_GLOBAL, bytes([state])))


def switch_selective(address: LssAddress, *, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, bool]:
    """The device with this address to configuration. False: nobody said that it is him."""
    parts = (LssService.SELECT_VENDOR, LssService.SELECT_PRODUCT, LssService.SELECT_REVISION)
    for service, number in zip(parts, address):
        yield from send_lss(with_number(service, number))
    last = with_number(LssService.SELECT_SERIAL, address.serial)
    return (yield from request_lss(last, LssService.SELECTED, timeout)) is not None


def identify_slaves(
    vendor: int,
    product: int,
    revisions: tuple[int, int] = (0, 0xFFFF_FFFF),
    serials: tuple[int, int] = (0, 0xFFFF_FFFF),
    *,
    timeout: float = LSS_TIMEOUT,
) -> Conversation[CanFrame, int]:
    """How many answers came from devices within these limits, both ends included."""
    numbers = (vendor, product, *revisions, *serials)
    services = [LssService(LssService.IDENTIFY_VENDOR + step) for step in range(6)]
    for service, number in list(zip(services, numbers))[:-1]:
        yield from send_lss(with_number(service, number))
    return (yield from count_answers(with_number(services[-1], numbers[-1]), LssService.IDENTIFIED, timeout))


def identify_unconfigured(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, int]:
    """How many answers came from devices that have no node-ID."""
    question = LssMessage(LssService.IDENTIFY_UNCONFIGURED)
    return (yield from count_answers(question, LssService.UNCONFIGURED_IDENTIFIED, timeout))


def inquire_address(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, LssAddress]:
    """The address of the one device in configuration. Raises NoAnswer."""
    parts = []
    for step in range(4):
        answer = yield from _must_answer(LssMessage(LssService(LssService.INQUIRE_VENDOR + step)), timeout)
        parts.append(answer.number)
    return LssAddress(*parts)


def inquire_node(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, int | None]:
    """The node-ID of the device in configuration, None if it has none. Raises NoAnswer."""
    answer = yield from _must_answer(LssMessage(LssService.INQUIRE_NODE), timeout)
    return None if answer.body[0] == UNCONFIGURED else answer.body[0]


def configure_node(node: int | None, *, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, None]:
    """Give the device in configuration this node-ID, or none. Raises LssRefused and NoAnswer."""
    number = UNCONFIGURED if node is None else check_node(node)
    yield from _must_agree(LssMessage(LssService.CONFIGURE_NODE, bytes([number])), timeout)


def configure_bit_timing(entry: int, table: int = 0, *, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, None]:
    """Give the device in configuration this bit rate, an entry of `BIT_RATES`. Raises LssRefused and NoAnswer."""
    if not (0 <= entry <= 255 and 0 <= table <= 255):
        raise EncodeError(f"bit timing {table}, {entry}: expected two numbers in 0..255")
    yield from _must_agree(LssMessage(LssService.CONFIGURE_BIT_TIMING, bytes([table, entry])), timeout)


def activate_bit_timing(delay: float) -> Conversation[CanFrame, float]:
    """All devices in configuration change their bit rate `delay` seconds from now, and are silent as long once more.

    Returns the time at which they speak again; until then the caller must have changed the rate of his own port.
    """
    milliseconds = round(delay * 1000)
    if not 0 <= milliseconds <= 0xFFFF:
        raise EncodeError(f"a switch delay of {delay} s: expected 0..65.535")
    body = milliseconds.to_bytes(2, "little")
    now = yield from send_lss(LssMessage(LssService.ACTIVATE_BIT_TIMING, body))
    return now + 2 * delay


def store_configuration(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, None]:
    """Let the device in configuration keep what it was given. Raises LssRefused and NoAnswer."""
    yield from _must_agree(LssMessage(LssService.STORE), timeout)


def _must_answer(message: LssMessage, timeout: float) -> Conversation[CanFrame, LssMessage]:
    answer = yield from request_lss(message, message.service, timeout)
    if answer is None:
        what = LssService(message.service).name.lower().replace("_", " ")
        raise NoAnswer(f"nobody in the LSS state configuration answered {what} within {timeout:g} s")
    return answer


def _must_agree(message: LssMessage, timeout: float) -> Conversation[CanFrame, None]:
    answer = yield from _must_answer(message, timeout)
    if answer.body[0]:
        raise LssRefused(LssService(message.service), answer.body[0], answer.body[1])
