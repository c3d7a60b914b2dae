"""The door of the room: every name in it leads to this room's own thing."""

from __future__ import annotations

import barewire.canopen as room


def test_every_name_leads_here() -> None:
    for name in room.__all__:
        thing = getattr(room, name)
        home = getattr(thing, "__module__", None) or type(thing).__module__
        assert home.startswith("barewire.canopen"), f"{name} comes from {home}"


def test_no_other_name() -> None:
    assert not hasattr(room, "modbus")
