"""2B/0D, which no other program supports: our client against our own server, over every carrier, in both dialects.

This proves no interoperability, as docs/reference/interop.md states. The independent evidence is the bytes of two
manuals (in `vectors/`), and tshark, which recognises the MEI type.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from barewire.modbus import CanopenReference
from barewire.modbus.messages.canopen_reference import ReferenceDialect
from tests.interop.our_side import RecordingClient, client_url, our_server, with_both
from tests.interop.services import CARRIERS

pytestmark = pytest.mark.needs("openssl")


def both_sides(carrier: str) -> Any:
    marks = [pytest.mark.evidence("ourselves", role, carrier, "2B/0D") for role in ("client", "server")]
    return pytest.param(carrier, marks=marks)


@pytest.mark.parametrize("carrier", [both_sides(carrier) for carrier in CARRIERS])
def test_canopen_objects_through_modbus(carrier: str, certificates: Path, exchanged: set[str]) -> None:
    async def talk(client: RecordingClient) -> None:
        dialects: tuple[ReferenceDialect, ...] = ("cia309", "schneider")
        for dialect in dialects:
            read = await client.ask(CanopenReference.read(5, 0x1018, 1, count=4, dialect=dialect))
            assert (read.node, read.index, read.sub_index, read.data) == (5, 0x1018, 1, b"\x00\x01\x02\x03")
            longest = await client.ask(CanopenReference.read(127, 0x2000, count=240, dialect=dialect))
            assert longest.data == bytes(range(240))
            wrote = await client.ask(CanopenReference.write_to(5, 0x6040, 0, b"\x06\0", dialect=dialect))
            assert (wrote.write, wrote.index, wrote.data) == (True, 0x6040, b"")

    with our_server(carrier, certificates, exchanged) as (place, _):
        with_both(client_url(carrier, place, certificates), exchanged, talk)
