"""`barewire.canopen` exports only names that this package defines."""

from __future__ import annotations

from barewire import canopen


def test_every_name_is_defined_in_this_package() -> None:
    for name in canopen.__all__:
        thing = getattr(canopen, name)
        home = getattr(thing, "__module__", None) or type(thing).__module__
        assert home.startswith("barewire.canopen"), f"{name} comes from {home}"


def test_other_rooms_are_not_exported() -> None:
    assert not hasattr(canopen, "modbus")
