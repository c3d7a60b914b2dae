"""SDO dialects of known devices, by the name that descriptions (`dialect = "az3"`), URLs and commands use.

The guide of the AZ3 requests an object with the command byte of the wanted response, and its worked example moves a
16-bit object in four bytes:

        C  43 40 60 00 00 00 00 00        S  43 40 60 00 06 00 00 00

Another device with a variant of its own is one more `SdoDialect` in `DIALECTS`.
"""

from __future__ import annotations

from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.errors import EncodeError

AZ3 = SdoDialect("az3", ((1, 0x4F), (2, 0x4B), (4, 0x43)), "in four")

DIALECTS = {dialect.name: dialect for dialect in (STANDARD, AZ3)}


def sdo_dialect(name: str) -> SdoDialect:
    """Return the dialect of that name. Raises EncodeError for an unknown one.

    >>> sdo_dialect("az3").lengths
    'in four'
    """
    if name not in DIALECTS:
        raise EncodeError(f"SDO dialect {name!r}: expected one of {', '.join(DIALECTS)}")
    return DIALECTS[name]
