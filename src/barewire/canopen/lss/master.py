"""The LSS master: each service is a conversation.   [CiA 305]

master                                   the devices
40 41 42 43 | address          ->
                               <-        44            the device with this address: True; no answer: False
11 | 05                        ->
                               <-        11 | 00       done, or LssRefused
17                             ->
                               <-        17 | 00       stored
04 | 00                        ->                      all back to waiting; a device with a new node-ID boots now

A bus has one LSS master, which sends one request at a time, so an answer belongs to the last request. Where no answer
means "no such device", the result is False, 0 or None. If a device in configuration does not answer, NoAnswer is
raised.
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
"""Default time-out in seconds. Devices answer within about a millisecond; a USB adapter adds up to 20 ms."""


def send_lss(message: LssMessage) -> Conversation[CanFrame, float]:
    """Send a message without waiting for an answer. Return the time at which it was sent."""
    sent: Heard[CanFrame] = yield Send(message.encode())
    return sent.now


def request_lss(
    message: LssMessage, wanted: int, timeout: float = LSS_TIMEOUT
) -> Conversation[CanFrame, LssMessage | None]:
    """Send a message and return the first answer of the service `wanted`, None if none came in time."""
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
    """Decode the frame as an answer of the service `wanted`. Return None for every other frame."""
    try:
        message = LssMessage.decode(frame)
    except DecodeError:
        return None
    return message if message.answer and message.service == wanted else None


def count_answers(message: LssMessage, wanted: int, timeout: float) -> Conversation[CanFrame, int]:
    """Send a message and count the answers until the time-out. Simultaneous answers merge into one frame."""
    now = yield from send_lss(message)
    until, count = now + timeout, 0
    while True:
        heard: Heard[CanFrame] = yield Listen(until)
        if heard.item is not None:
            count += read_answer(heard.item, wanted) is not None
        if heard.now >= until:
            return count


def switch_global(state: LssState) -> Conversation[CanFrame, None]:
    """Switch every device to waiting or configuration. Configuration is for a bus with one device only."""
    yield from send_lss(LssMessage(LssService.SWITCH_GLOBAL, bytes([state])))


def switch_selective(address: LssAddress, *, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, bool]:
    """Switch the device with this address to configuration. Return False if no device answered."""
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
    """Return the number of answers of devices within these limits, both ends included."""
    numbers = (vendor, product, *revisions, *serials)
    services = [LssService(LssService.IDENTIFY_VENDOR + step) for step in range(6)]
    for service, number in list(zip(services, numbers))[:-1]:
        yield from send_lss(with_number(service, number))
    return (yield from count_answers(with_number(services[-1], numbers[-1]), LssService.IDENTIFIED, timeout))


def identify_unconfigured(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, int]:
    """Return the number of answers of devices without a node-ID."""
    request = LssMessage(LssService.IDENTIFY_UNCONFIGURED)
    return (yield from count_answers(request, LssService.UNCONFIGURED_IDENTIFIED, timeout))


def inquire_address(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, LssAddress]:
    """Return the address of the device in configuration. Raise NoAnswer."""
    parts = []
    for step in range(4):
        answer = yield from _must_answer(LssMessage(LssService(LssService.INQUIRE_VENDOR + step)), timeout)
        parts.append(answer.number)
    return LssAddress(*parts)


def inquire_node(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, int | None]:
    """Return the node-ID of the device in configuration, None if it has none. Raise NoAnswer."""
    answer = yield from _must_answer(LssMessage(LssService.INQUIRE_NODE), timeout)
    return None if answer.body[0] == UNCONFIGURED else answer.body[0]


def configure_node(node: int | None, *, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, None]:
    """Set the pending node-ID of the device in configuration, or remove it. Raise LssRefused and NoAnswer."""
    number = UNCONFIGURED if node is None else check_node(node)
    yield from _must_accept(LssMessage(LssService.CONFIGURE_NODE, bytes([number])), timeout)


def configure_bit_timing(entry: int, table: int = 0, *, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, None]:
    """Set the bit rate of the device in configuration, an entry of `BIT_RATES`. Raise LssRefused and NoAnswer."""
    if not (0 <= entry <= 255 and 0 <= table <= 255):
        raise EncodeError(f"bit timing table {table}, entry {entry}: expected 0..255 for both")
    yield from _must_accept(LssMessage(LssService.CONFIGURE_BIT_TIMING, bytes([table, entry])), timeout)


def activate_bit_timing(delay: float) -> Conversation[CanFrame, float]:
    """Let all devices in configuration change their bit rate after `delay` seconds and stay silent for as long again.

    Return the time at which they send again; by then the caller must have changed the bit rate of its own port.
    Raise EncodeError for a delay outside 0..65.535 s.
    """
    milliseconds = round(delay * 1000)
    if not 0 <= milliseconds <= 0xFFFF:
        raise EncodeError(f"switch delay {delay} s: expected 0..65.535")
    body = milliseconds.to_bytes(2, "little")
    now = yield from send_lss(LssMessage(LssService.ACTIVATE_BIT_TIMING, body))
    return now + 2 * delay


def store_configuration(*, timeout: float = LSS_TIMEOUT) -> Conversation[CanFrame, None]:
    """Let the device in configuration store node-ID and bit rate. Raise LssRefused and NoAnswer."""
    yield from _must_accept(LssMessage(LssService.STORE), timeout)


def _must_answer(message: LssMessage, timeout: float) -> Conversation[CanFrame, LssMessage]:
    answer = yield from request_lss(message, message.service, timeout)
    if answer is None:
        name = LssService(message.service).name.lower().replace("_", " ")
        raise NoAnswer(f"no device in the LSS state configuration answered {name} within {timeout:g} s")
    return answer


def _must_accept(message: LssMessage, timeout: float) -> Conversation[CanFrame, None]:
    answer = yield from _must_answer(message, timeout)
    if answer.body[0]:
        raise LssRefused(LssService(message.service), answer.body[0], answer.body[1])
