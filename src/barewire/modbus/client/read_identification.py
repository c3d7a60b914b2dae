"""The turn of talk that reads all a device says about itself: a question for each part until nothing follows.

client                                         unit
------                                         ----
2B/0E basic, from object 00      ----------->
                                 <-----------  00, 01; more follows, next is 02
2B/0E basic, from object 02      ----------->
                                 <-----------  02; this is all                     -> Identification
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, TypeVar

from barewire.conversation import Conversation
from barewire.errors import DecodeError
from barewire.modbus.messages.base import Request, Response, check_range
from barewire.modbus.messages.identification import (
    BASIC,
    EXTENDED,
    OBJECT_NAMES,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
)

R = TypeVar("R", bound="Response")


class Asker(Protocol):
    """Whoever can ask one question: a `Bus`."""

    def ask(self, unit: int, request: Request[R], *, timeout: float = 1.0) -> Conversation[bytes, R]: ...


class DeviceIdentification(NamedTuple):
    """What a device said: its conformity (01, 02, 03; with 80h added if it gives single objects too), its objects."""

    conformity: int
    objects: dict[int, bytes]

    def texts(self) -> dict[str, str]:
        """The objects by name, as text.

        >>> DeviceIdentification(1, {0: b"TEM", 0x80: b"42"}).texts()
        {'VendorName': 'TEM', 'object 80h': '42'}
        """
        return {
            OBJECT_NAMES.get(number, f"object {number:02X}h"): value.decode("latin-1")
            for number, value in self.objects.items()
        }


def read_device_identification(
    asker: Asker, unit: int, read_code: int = BASIC, *, timeout: float = 1.0
) -> Conversation[bytes, DeviceIdentification]:
    """Read the basic (01), regular (02) or extended (03) objects of a unit, however many answers that takes.

    The number of the next object must grow, so this ends after 256 questions at the latest, whatever the device says:
    DecodeError("value") if it does not. Raises what `ask` raises otherwise.
    """
    check_range("read_code", read_code, BASIC, EXTENDED)
    return _identify(asker, unit, read_code, timeout)


def _identify(asker: Asker, unit: int, read_code: int, timeout: float) -> Conversation[bytes, DeviceIdentification]:
    objects: dict[int, bytes] = {}
    first = 0
    while True:
        answer = yield from asker.ask(unit, ReadDeviceIdentification(read_code, first), timeout=timeout)
        objects.update(answer.objects)
        if not answer.more_follows:
            return DeviceIdentification(answer.conformity, objects)
        if answer.next_object <= max(first, *(number for number, _ in answer.objects), 0):
            raise _going_round(answer, first)
        first = answer.next_object


def _going_round(answer: ReadDeviceIdentificationResponse, first: int) -> DecodeError:
    pdu = answer.encode()
    text = f"after object {first:02X}h it says that {answer.next_object:02X}h follows: that would never end"
    return DecodeError("value", pdu, 5, text)
