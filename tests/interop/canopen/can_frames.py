"""Every kind of single CANopen frame, by its service: the input of `test_tshark_can`.

Node 5. Segments of a block transfer are not here: they are recognised by their position in a transfer only.
"""

from __future__ import annotations

from collections.abc import Iterable

from barewire.canopen import AbortCode, LssService


def sdo(number: str, *texts: str) -> list[str]:
    """Whole SDO messages; blanks are ignored, and missing bytes are 00."""
    return [f"{number}#{text.replace(' ', '').ljust(16, '0')}" for text in texts]


def lss(number: str, services: Iterable[LssService]) -> list[str]:
    """LSS messages with more bytes than most need, so that every field is present."""
    rest = "01020304050607" if number == "7E5" else "01020304000000"
    return [f"{number}#{service:02X}{rest}" for service in services]


S = LssService
FRAMES: dict[str, list[str]] = {
    "SDO expedited download": [
        *sdo("605", "2F 002001 05", "2B 406000 0F00", "27 002000 010203", "23 FF6000 10270000", "22 002000 01020304"),
        *sdo("585", "60 002001"),
    ],
    "SDO expedited upload": [
        *sdo("605", "40 416000"),
        *sdo("585", "4F 002000 05", "4B 416000 3706", "47 002000 010203", "43 001000 91010F00", "42 001000 01020304"),
    ],
    "SDO segmented download": [
        *sdo("605", "21 081000 10", "20 081000", "00 434F4E", "1D 42", "0F"),
        *sdo("585", "60 081000", "20", "30"),
    ],
    "SDO segmented upload": [
        *sdo("605", "40 081000", "60", "70"),
        *sdo("585", "41 081000 10", "40 081000", "00 4341", "1D 42", "0F"),
    ],
    "SDO block download": [
        *sdo("605", "C0 002100", "C2 002100 10", "C4 002100", "C6 002100 0A", "C1 589C", "DD", "D1 589C"),
        *sdo("585", "A0 002100 7F", "A4 002100 7F", "A2 02 7F", "A1"),
    ],
    "SDO block upload": [
        *sdo("605", "A0 081000 14", "A4 081000 14 2A", "A3", "A2 14 7F", "A1"),
        *sdo("585", "C0 081000", "C6 081000 10", "C1 589C", "D5 F343"),
    ],
    "SDO abort": [
        *sdo("605", "80 416000 00000405"),
        *sdo("585", *(f"80 416000 {int(code).to_bytes(4, 'little').hex()}" for code in AbortCode)),
    ],
    "NMT command": [f"000#{word}{node}" for word in ("01", "02", "80", "81", "82") for node in ("00", "05", "7F")],
    "boot-up": ["705#00"],
    "heartbeat": ["705#04", "705#05", "705#7F"],
    "node guarding": ["705#84", "705#85", "705#FF"],
    "EMCY": [f"085#{code}{bits}0102030405" for code in ("3081", "0000", "1042", "50FF") for bits in ("00", "11", "81")],
    "SYNC": ["080#", "080#01", "080#F0"],
    "TIME": ["100#000000000000", "100#952CB3024D39", "100#FF5B26059F3C"],
    "TPDO": [f"{base + 5:03X}#0102030405" for base in (0x180, 0x280, 0x380, 0x480)],
    "RPDO": [f"{base + 5:03X}#0102030405" for base in (0x200, 0x300, 0x400, 0x500)],
    "LSS switch": [
        *("7E5#0400000000000000", "7E5#0401000000000000"),
        *lss("7E5", (S.SELECT_VENDOR, S.SELECT_PRODUCT, S.SELECT_REVISION, S.SELECT_SERIAL)),
        *lss("7E4", (S.SELECTED,)),
    ],
    "LSS identify": [
        *lss("7E5", (S.IDENTIFY_VENDOR, S.IDENTIFY_PRODUCT, S.IDENTIFY_REVISION_LOW, S.IDENTIFY_REVISION_HIGH)),
        *lss("7E5", (S.IDENTIFY_SERIAL_LOW, S.IDENTIFY_SERIAL_HIGH, S.IDENTIFY_UNCONFIGURED)),
        *lss("7E4", (S.IDENTIFIED, S.UNCONFIGURED_IDENTIFIED)),
    ],
    "LSS inquire": [
        *lss("7E5", (S.INQUIRE_VENDOR, S.INQUIRE_PRODUCT, S.INQUIRE_REVISION, S.INQUIRE_SERIAL, S.INQUIRE_NODE)),
        *lss("7E4", (S.INQUIRE_VENDOR, S.INQUIRE_PRODUCT, S.INQUIRE_REVISION, S.INQUIRE_SERIAL, S.INQUIRE_NODE)),
    ],
    "LSS configure": [
        *lss("7E5", (S.CONFIGURE_NODE, S.CONFIGURE_BIT_TIMING, S.ACTIVATE_BIT_TIMING, S.STORE)),
        *lss("7E4", (S.CONFIGURE_NODE, S.CONFIGURE_BIT_TIMING, S.STORE)),
    ],
    "LSS fastscan": ["7E5#51443322111F0102", "7E5#5100000000800000", *lss("7E4", (S.IDENTIFIED,))],
}
