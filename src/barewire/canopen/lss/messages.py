"""The LSS messages: they assign node-ID and bit rate to a device over the bus.   [CiA 305]

        7E5h | service | 7 bytes, numbers little-endian, unused 0 |      master -> every device
        7E4h | service | 7 bytes                                  |      device -> master

The LSS address of a device is unique: the four numbers of 1018h, 128 bits in all. With it the master switches one
device to the state *configuration* (the others stay in *waiting*), and configures or inquires it:

        vendor-ID    product code    revision    serial number
        1018h:01     1018h:02        1018h:03    1018h:04

    switch global 04         all devices, no answer            configure node-ID 11   bit timing 13   answer: 0 done
    switch selective 40..43  the device with this address      activate bit timing 15, no answer      store 17
    identify 46..4B, 4C      all devices within these limits   inquire address 5A..5D, node-ID 5E
    fastscan 51              compares bits of the address      to find devices whose address is unknown
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from barewire.canopen.cob_ids import cob_id
from barewire.canopen.frame import CanFrame
from barewire.codecs import Layout
from barewire.errors import DecodeError, EncodeError, Reason, Refused

REQUEST_KEY = (cob_id("LSS request"), False)
ANSWER_KEY = (cob_id("LSS answer"), False)
UNCONFIGURED = 0xFF
"""The node-ID of a device that has none yet."""

LSS_BIT_RATES = {0: 1_000_000, 1: 800_000, 2: 500_000, 3: 250_000, 4: 125_000, 6: 50_000, 7: 20_000, 8: 10_000}
"""Bit timing table 0: entry -> bit/s. Entry 5 is reserved, 9 is automatic bit rate detection."""
AUTOMATIC_BIT_RATE = 9


class LssService(IntEnum):
    """The command specifier, the first byte of a message."""

    SWITCH_GLOBAL = 0x04
    CONFIGURE_NODE = 0x11
    CONFIGURE_BIT_TIMING = 0x13
    ACTIVATE_BIT_TIMING = 0x15
    STORE = 0x17
    SELECT_VENDOR = 0x40
    SELECT_PRODUCT = 0x41
    SELECT_REVISION = 0x42
    SELECT_SERIAL = 0x43
    SELECTED = 0x44
    IDENTIFY_VENDOR = 0x46
    IDENTIFY_PRODUCT = 0x47
    IDENTIFY_REVISION_LOW = 0x48
    IDENTIFY_REVISION_HIGH = 0x49
    IDENTIFY_SERIAL_LOW = 0x4A
    IDENTIFY_SERIAL_HIGH = 0x4B
    IDENTIFY_UNCONFIGURED = 0x4C
    IDENTIFIED = 0x4F
    UNCONFIGURED_IDENTIFIED = 0x50
    FASTSCAN = 0x51
    INQUIRE_VENDOR = 0x5A
    INQUIRE_PRODUCT = 0x5B
    INQUIRE_REVISION = 0x5C
    INQUIRE_SERIAL = 0x5D
    INQUIRE_NODE = 0x5E


class LssState(IntEnum):
    """The two LSS states of a device, with their numbers in "switch global"."""

    WAITING = 0
    CONFIGURATION = 1


class LssAddress(NamedTuple):
    """The LSS address: the 128 bits of 1018h.

    >>> str(LssAddress(0x360, 1, 0x10002, 77))
    '00000360-00000001-00010002-0000004D'
    """

    vendor: int
    product: int
    revision: int
    serial: int

    def __str__(self) -> str:
        return "-".join(f"{part:08X}" for part in self)


@dataclass(frozen=True, slots=True)
class LssMessage:
    """One message: the service and up to 7 bytes, filled with zeros to 8 bytes in all.

    >>> str(LssMessage(LssService.CONFIGURE_NODE, b"\\x05").encode())
    '7E5#1105000000000000'
    """

    service: int
    body: bytes = b""
    answer: bool = False

    def encode(self) -> CanFrame:
        """Return the frame of the master, or of a device if `answer`. Raise EncodeError for more than 7 bytes."""
        if len(self.body) > 7:
            raise EncodeError(f"{len(self.body)} bytes behind the service: expected at most 7")
        data = bytes([self.service]) + self.body
        return CanFrame((ANSWER_KEY if self.answer else REQUEST_KEY)[0], data.ljust(8, b"\0"))

    @classmethod
    def decode(cls, frame: CanFrame) -> LssMessage:
        """Decode a frame. Raise DecodeError for another identifier or length, and for an unknown service."""
        if frame.key not in (REQUEST_KEY, ANSWER_KEY) or frame.remote:
            raise DecodeError("mismatch", frame.data, 0, f"{frame} is not an LSS message: expected COB-ID 7E5h or 7E4h")
        if len(frame.data) != 8:
            wrong: Reason = "short" if len(frame.data) < 8 else "long"
            raise DecodeError(wrong, frame.data, min(len(frame.data), 8), "an LSS message has 8 bytes")
        answer = frame.key == ANSWER_KEY
        if frame.data[0] not in (LSS_ANSWERS if answer else LSS_REQUESTS):
            raise DecodeError(
                "function", frame.data, 0, f"{frame.data[0]:02X}h is not an LSS service of this direction"
            )
        return cls(frame.data[0], frame.data[1:], answer)

    @property
    def number(self) -> int:
        """The 32 bits behind the service."""
        return int.from_bytes(self.body[:4], "little")


IDENTIFY_SERVICES = tuple(LssService(LssService.IDENTIFY_VENDOR + step) for step in range(6))
"""The six requests of "identify": vendor-ID, product code, and the limits of revision and serial number."""
LSS_ANSWERS = frozenset({0x11, 0x13, 0x17, 0x44, 0x4F, 0x50, *range(0x5A, 0x5F)})
LSS_REQUESTS = frozenset(int(service) for service in LssService) - {0x44, 0x4F, 0x50}


def with_number(service: LssService, number: int) -> LssMessage:
    """Return a request with a 32-bit number. Raise EncodeError if the number needs more bits."""
    return LssMessage(service, Layout("<I", "number").pack(number))


@dataclass(frozen=True, slots=True)
class Fastscan:
    """One request of a fastscan: devices answer if part `sub` of their address equals `number` from bit `bit` upwards.

        51 | number 4 | bit 1 | sub 1 | next 1

    Bit 80h starts a scan: every device without a node-ID answers. With bit 0, devices that match continue with part
    `next`; if that is smaller than `sub`, the device that matches all parts switches to configuration.

    >>> str(Fastscan(0x11223344, 31, 0, 0).encode())
    '7E5#51443322111F0000'
    """

    number: int
    bit: int
    sub: int
    next: int

    layout = Layout("<IBBB", "number", "bit", "sub", "next")

    def encode(self) -> CanFrame:
        """Return the frame. Raise EncodeError as `check` does."""
        self.check()
        body = self.layout.pack(self.number, self.bit, self.sub, self.next)
        return LssMessage(LssService.FASTSCAN, body).encode()

    @classmethod
    def of_body(cls, body: bytes) -> Fastscan:
        """Decode the bytes behind the service. Raise DecodeError for a bit or a part that does not exist."""
        request = cls(*cls.layout.unpack(body))
        try:
            request.check()
        except EncodeError as error:
            raise DecodeError("value", body, 4, str(error)) from None
        return request

    def check(self) -> None:
        """Raise EncodeError for a bit or a part that does not exist."""
        if not (self.bit <= 31 or self.bit == BEGIN):
            raise EncodeError(f"fastscan of bit {self.bit}: expected 0..31, or {BEGIN:02X}h")
        if self.sub > 3 or self.next > 3:
            raise EncodeError(f"fastscan of part {self.sub}, then {self.next}: expected 0..3")


BEGIN = 0x80
"""The `bit` that begins a fastscan."""
STORE_NOT_SUPPORTED = 1
"""The code of a device that cannot store its configuration, in the answer to 17h."""


class LssRefused(Refused):
    """The device refused. `code` is 1: out of range or not supported, 2 (store): no storage, FFh: see `detail`."""

    def __init__(self, service: LssService, code: int, detail: int) -> None:
        super().__init__(service, code, detail)
        self.service = service
        self.code = code
        self.detail = detail

    def __str__(self) -> str:
        words = {1: "not supported" if self.service is LssService.STORE else "out of range", 2: "no access to storage"}
        reason = words.get(self.code, f"code {self.code:02X}h, detail {self.detail:02X}h")
        return f"{self.service.name.lower().replace('_', ' ')}: {reason}"
