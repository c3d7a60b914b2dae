"""The status words and control words of drives in a recording, for the picture of the state machine.

    CAN      6040h and 6041h in SDO transfers, and in PDOs whose mapping is known from a description or the recording
    Modbus   the registers that the description of the drive names, in answered requests

A word that says the same as the one before it is left out: a drive that is watched repeats its status many times.
"""

from __future__ import annotations

from collections.abc import Iterable

from barewire.canopen.frame import CanFrame
from barewire.devices.cia402 import command_of, state_of
from barewire.devices.device import Device, drive_roles
from barewire.devices.parameter import ModbusAt
from barewire.errors import DecodeError
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.sniffer import RequestSeen, ResponseSeen, SnifferEvent
from barewire_workbench.frames.canopen.known_node import KnownNode
from barewire_workbench.monitor.events import SdoTransferReport
from barewire_workbench.monitor.monitor import CanMonitor
from barewire_workbench.monitor.recording import BusMonitors
from barewire_workbench.pictures.states import DriveWord, WordKind
from barewire_workbench.recordings.model import Recorded, RecordedItem

WORD_OBJECTS: dict[int, WordKind] = {0x6040: "control", 0x6041: "status"}


class DriveWords:
    """The words of one drive, in their order, without repetitions.

    >>> words = DriveWords()
    >>> for word in (0x0250, 0x0650, 0x0231):
    ...     words.add("status", word, 0.5)
    >>> [f"{kept.word:04X}" for kept in words.kept]
    ['0250', '0231']
    """

    def __init__(self) -> None:
        self.kept: list[DriveWord] = []
        self._last: dict[WordKind, object] = {}
        self._control = 0

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.kept)} kept>"

    def add(self, kind: WordKind, word: int, at: float | None) -> None:
        """Take a word; it is kept if it shows another state or command than the last of its kind."""
        if kind == "status":
            try:
                shown: object = state_of(word)
            except DecodeError:
                shown = word & 0x6F
        else:
            shown, self._control = (command_of(word, self._control), word & 0x80), word
        if self._last.get(kind) != shown:
            self._last[kind] = shown
            self.kept.append(DriveWord(kind, word, at))


def can_drive_words(
    items: Iterable[RecordedItem], known: Iterable[KnownNode] = (), bus: str | None = None
) -> dict[int, DriveWords]:
    """Return the words of each drive in a recording of CAN, by its node-ID.

    >>> frames = [CanFrame.parse("605#2B40600006000000"), CanFrame.parse("585#6040600000000000")]
    >>> can_drive_words(Recorded(0.1 * place, "can0", frame) for place, frame in enumerate(frames))[5].kept
    [DriveWord(kind='control', word=6, at=0.1)]
    """
    monitors = BusMonitors(known, bus)
    found: dict[int, DriveWords] = {}
    for item in items:
        monitor = monitors.monitor(item.bus) if isinstance(item, Recorded) else None
        if monitor is not None and isinstance(item, Recorded) and isinstance(item.frame, CanFrame):
            _add_mapped(found, monitor, item.frame, item.at)
        for _, event in monitors.feed(item):
            if isinstance(event, SdoTransferReport) and event.outcome == "done" and event.data is not None:
                kind = WORD_OBJECTS.get(event.index or 0)
                wanted = "download" if kind == "control" else "upload"
                if kind is not None and event.sub == 0 and len(event.data) == 2 and event.direction == wanted:
                    word = int.from_bytes(event.data, "little")
                    found.setdefault(event.node, DriveWords()).add(kind, word, event.at)
    return found


def _add_mapped(found: dict[int, DriveWords], monitor: CanMonitor, frame: CanFrame, at: float) -> None:
    """Add the words in a PDO."""
    owner = monitor.pdos.owner(frame)
    mapping = None if owner is None else owner[2]
    if owner is None or mapping is None or frame.remote:
        return
    node = owner[0]
    try:
        values = mapping.unpack(frame.data)
    except DecodeError:
        return
    for entry in mapping.entries:
        kind, value = WORD_OBJECTS.get(entry.index), values.get(entry.name)
        if kind is not None and entry.sub == 0 and isinstance(value, int) and 0 <= value <= 0xFFFF:
            found.setdefault(node, DriveWords()).add(kind, value, at)


def modbus_drive_words(events: Iterable[SnifferEvent], device: Device) -> dict[int, DriveWords]:
    """Return the words of each drive in a recording of Modbus, by its unit. All units are taken to be this device.

    Raises EncodeError if the description has no table [drive].
    """
    roles = drive_roles(device)
    places: dict[WordKind, ModbusAt] = {}
    names: tuple[tuple[WordKind, str], ...] = (("control", roles.control_word), ("status", roles.status_word))
    for kind, name in names:
        place = device.find(name).modbus
        if place is not None and place.words == 1 and not place.partial:
            places[kind] = place
    found: dict[int, DriveWords] = {}
    for event in events:
        if not isinstance(event, ResponseSeen) or event.request is None or event.pdu[0] & EXCEPTION_BIT:
            continue
        for kind, place in places.items():
            word = _read(event, event.request, place) if kind == "status" else _written(event.request, place)
            if word is not None:
                found.setdefault(event.unit, DriveWords()).add(kind, word, event.at)
    return found


_READS = {"holding": 0x03, "input": 0x04}


def _read(event: ResponseSeen, request: RequestSeen, place: ModbusAt) -> int | None:
    """Return the register at this place, if the exchange has read it."""
    if request.pdu[0] != _READS.get(place.table):
        return None
    first, registers = getattr(request.message, "address", None), getattr(event.message, "registers", ())
    if first is None or not 0 <= place.address - first < len(registers):
        return None
    return int(registers[place.address - first])


def _written(request: RequestSeen, place: ModbusAt) -> int | None:
    """Return the register at this place, if the request writes it."""
    first = getattr(request.message, "address", None)
    if first is None or place.table != "holding" or request.pdu[0] not in (0x06, 0x10):
        return None
    single = getattr(request.message, "value", None)
    registers = getattr(request.message, "registers", ()) if single is None else (single,)
    return int(registers[place.address - first]) if 0 <= place.address - first < len(registers) else None
