"""Read all identification objects of a unit (2B/0E): one request for each part, until nothing follows.   [MB-APP 6.21]

client                                         unit
------                                         ----
2B/0E basic, from object 00      ----------->
                                 <-----------  00, 01; more follows, next is 02
2B/0E basic, from object 02      ----------->
                                 <-----------  02; nothing follows          -> DeviceIdentification
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from barewire.conversation import DEFAULT_TIMEOUT, Conversation
from barewire.errors import DecodeError
from barewire.modbus.messages.base import check_range
from barewire.modbus.messages.identification import (
    BASIC,
    EXTENDED,
    ReadDeviceIdentification,
    object_texts,
)

if TYPE_CHECKING:
    from barewire.modbus.client.bus import Bus


class DeviceIdentification(NamedTuple):
    """The identification objects of a unit, and its conformity level: 01, 02 or 03, plus 80h for individual access."""

    conformity: int
    objects: dict[int, bytes]

    def texts(self) -> dict[str, str]:
        """Return the objects as text, by name.

        >>> DeviceIdentification(1, {0: b"TEM", 0x80: b"42"}).texts()
        {'VendorName': 'TEM', 'object 80h': '42'}
        """
        return object_texts(self.objects)

    def __repr__(self) -> str:
        return f"<DeviceIdentification: {', '.join(f'{name} {text!r}' for name, text in self.texts().items())}>"

    def _repr_html_(self) -> str:
        from barewire._html import html_table  # only a notebook needs it

        return html_table(("object", "text"), self.texts().items())


def read_device_identification(
    bus: Bus, unit: int, read_code: int = BASIC, *, timeout: float = DEFAULT_TIMEOUT
) -> Conversation[bytes, DeviceIdentification]:
    """Read the basic (01), regular (02) or extended (03) objects of a unit, in as many requests as it takes.

    `timeout`, in seconds, is for each request. Raises the errors of `Bus.ask`, and DecodeError("value") if the number
    of the next object does not grow, so that there are never more than 256 requests.
    """
    check_range("read_code", read_code, BASIC, EXTENDED)  # here: in a generator it would wait for the first step
    return _read_all(bus, unit, read_code, timeout)


def _read_all(bus: Bus, unit: int, read_code: int, timeout: float) -> Conversation[bytes, DeviceIdentification]:
    objects: dict[int, bytes] = {}
    first = 0
    while True:
        response = yield from bus.ask(unit, ReadDeviceIdentification(read_code, first), timeout=timeout)
        objects.update(response.objects)
        if not response.more_follows:
            return DeviceIdentification(response.conformity, objects)
        # Above all that were read: a unit that says "more follows" with the same object again would never end.
        highest = max([first, *(number for number, _ in response.objects)])
        if response.next_object <= highest:
            text = f"after object {first:02X}h the next one given is {response.next_object:02X}h: that would never end"
            raise DecodeError("value", response.encode(), 5, text)
        first = response.next_object
