"""Public names read from the source: what is one, in which order, with which signature."""

from __future__ import annotations

import importlib
from pathlib import Path

from tools.website import source
from tools.website.api import linker, page_of
from tools.website.errors import family, raised_in, reasons

FILE = '''
"""What the file is."""
from os import sep
LIMIT: int = 5
"""How many."""
_hidden = 1

class Thing(ValueError):
    """A thing."""

    def __init__(self, name: str, *, size: int = 1) -> None: ...

    @property
    def place(self) -> str:
        """Where."""

    async def wait(self, until: float) -> None:
        """Wait."""

def _inner() -> None: ...
def outer(*parts: str) -> bool:
    """Do."""
'''


def test_public_objects_in_the_order_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "part.py"
    file.write_text(FILE)
    limit, thing, outer = source.module(file, "part").things
    assert (limit.kind, limit.name, limit.signature, limit.docstring) == ("data", "LIMIT", ": int = 5", "How many.")
    assert (thing.kind, thing.signature, thing.bases) == ("exception", "(name: str, *, size: int=1)", ("ValueError",))
    assert [(member.kind, member.name, member.signature) for member in thing.members] == [
        ("property", "place", ": str"),
        ("method", "wait", "(until: float) -> None"),
    ]
    assert (outer.signature, thing.members[1].is_async) == ("(*parts: str) -> bool", True)


def test_a_list_of_names_decides_what_is_public(tmp_path: Path) -> None:
    file = tmp_path / "part.py"
    file.write_text('__all__ = ["LIMIT"]\n' + FILE)
    assert [thing.name for thing in source.module(file, "part").things] == ["LIMIT"]


def test_the_rooms_stand_in_reading_order() -> None:
    names = [room.name for room in source.rooms()]
    assert names[:2] == ["barewire", "barewire.codecs"]
    assert names.index("barewire.modbus") < names.index("barewire.rtu") < names.index("barewire.canopen")
    client = next(room for room in source.rooms() if room.name == "barewire.modbus.client")
    assert [module.name.rpartition(".")[2] for module in client.modules][:2] == ["bus", "line_state"]


def test_every_link_leads_to_an_object_that_exists() -> None:
    link = linker(source.rooms())
    for name in ("Bus", "ModbusClient", "barewire.ModbusClient", "Bus.ask", "barewire.rtu", "modbus.client.bus"):
        target = link(name)
        assert target, name
        module, _, rest = target, "", ""
        while module:
            try:
                found: object = importlib.import_module(module)
                break
            except ModuleNotFoundError:
                module, _, part = module.rpartition(".")
                rest = f"{part}.{rest}".rstrip(".")
        for part in filter(None, rest.split(".")):
            found = getattr(found, part)
    assert link("no_such_name") is None
    assert page_of("barewire.canopen.sdo") == "reference/api/canopen.sdo"


def test_the_errors_are_those_of_the_package() -> None:
    import barewire

    names = [thing.name for _, thing in family(source.rooms())]
    assert names[0] == "BarewireError"
    assert {"NoAnswer", "WriteOutcomeUnknown", "SdoAbort", "DriveStuck"} <= set(names)
    assert names.index("NoAnswer") < names.index("WriteOutcomeUnknown")
    assert len(names) == len(set(names))
    public = {name for name in barewire.__all__ if isinstance(getattr(barewire, name), type)}
    assert {name for name in public if issubclass(getattr(barewire, name), Exception)} <= set(names)
    assert "barewire.devices.device" in raised_in()["UnknownName"]


def test_every_reason_has_its_meaning() -> None:
    from barewire.errors import REASONS

    assert tuple(reasons()) == REASONS


def test_a_room_offers_what_may_be_imported_from_it() -> None:
    import barewire.modbus

    found = {room.name: room.offers for room in source.rooms()}
    assert set(found["barewire"]) == set(barewire.__all__) - {"__version__"}
    assert found["barewire"]["ModbusClient"] == "barewire.io.modbus.client.ModbusClient"
    assert {"Bus", "Table", "Server"} <= set(found["barewire.modbus"]) <= set(barewire.modbus.__all__)
