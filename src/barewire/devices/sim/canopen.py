"""The CANopen adapter of a simulated machine: a node whose object dictionary reads and writes the machine's store.

        SDO, RPDO --> Entry.on_write --> Cell.check, Cell.put         (Declined -> abort code)
        SDO, TPDO <-- Entry.on_read  <-- Cell.shown                   raw numbers, little-endian

Only the state of the node itself is kept here: its NMT state and the records of its PDOs. The mandatory objects 1000h,
1001h and 1018h (vendor-ID 0) are added where the description does not list them.

The node-ID and the bit rate may change when the machine restarts (`take_address`). Where the bit rate of the bus is
given in `bus_bitrate`, a node with another bit rate receives nothing and sends nothing; a real one would send error
frames.

If two parameters have the same object, the first in the description owns it. An object with only its bits described is
composed of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.device.device import LocalNode
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtCommand, NmtState
from barewire.canopen.object_dictionary import Entry, ObjectAccess, ObjectDictionary
from barewire.canopen.pdo.config import PdoConfig
from barewire.canopen.sdo.dialect import STANDARD
from barewire.codecs import Value, get_bit, set_bit
from barewire.devices.device import CanopenSettings, DevicePdo
from barewire.devices.sdo_dialects import DIALECTS
from barewire.devices.sim.store import Cell, Declined, DeclineReason, SimulatedMachine

_ABORT_CODES: dict[DeclineReason, AbortCode] = {
    "place": AbortCode.NO_OBJECT,
    "value": AbortCode.INVALID_VALUE,
    "signature": AbortCode.NOT_STORED,
    "state": AbortCode.DEVICE_STATE,
}
_DEVICE_TYPE, _ERROR_REGISTER, _IDENTITY = 0x1000, 0x1001, 0x1018
_PDO_RECORDS = range(0x1400, 0x1C00)
_COMMUNICATION = range(0x1000, 0x2000)
_SERVO_402 = 0x0002_0192  # device profile 402, servo drive


class CanopenAdapter:
    """A machine as a node: CAN frames and time in, CAN frames out. The first `feed`, or `start`, sends the boot-up."""

    def __init__(self, machine: SimulatedMachine, settings: CanopenSettings) -> None:
        self.machine = machine
        entries = [*_entries(machine), Entry(_DEVICE_TYPE, 0, "device type", "u32", "const", _SERVO_402)]
        entries.append(Entry(_ERROR_REGISTER, 0, "error register", "u8", "ro"))
        if all(entry.index != _IDENTITY for entry in entries):
            entries.append(Entry(_IDENTITY, 1, "vendor-ID", "u32", "const", 0, object_name="identity object"))
        self.objects = ObjectDictionary({(entry.index, entry.sub): entry for entry in entries}.values())
        pdos = [_pdo(pdo, settings.node) for pdo in settings.pdos]
        self.node = LocalNode(
            settings.node, self.objects, pdos, dialect=DIALECTS.get(settings.dialect, STANDARD), on_reset=self._on_reset
        )
        self._add_missing_records()
        self.bitrate = settings.bitrate
        self.bus_bitrate: int | None = None
        """The bit rate of the bus; None: it is not compared."""
        self._boots_at: float | None = machine.clock.now
        self._pending: list[CanFrame] = []

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.machine!r}, node {self.node.node}>"

    def _add_missing_records(self) -> None:
        # Described sub-indices of PDO records that the node does not create: the compatibility entry, 04.
        for cell in self.machine.store:
            place = cell.parameter.object
            if place is None or place.index not in _PDO_RECORDS or (place.index, 0) not in self.objects:
                continue
            if (place.index, place.sub) not in self.objects:
                self.objects.add(_entry(cell))

    @property
    def state(self) -> NmtState:
        """The NMT state."""
        return self.node.state

    @property
    def deadline(self) -> float | None:
        """The time of the next frame that the node sends without a request."""
        if self._is_at_another_bitrate:
            return None
        if self._boots_at is not None:
            return self._boots_at
        # A heartbeat time that was written over Modbus takes effect at the next feed, which is due at once.
        return self.machine.clock.now if self._pending or self._heartbeat_changed() else self.node.deadline

    def _heartbeat_changed(self) -> bool:
        place = (0x1017, 0)
        return place in self.objects and int(self.objects.get(*place)) / 1000 != self.node.heartbeat.period

    @property
    def _is_at_another_bitrate(self) -> bool:
        return self.bus_bitrate is not None and self.bus_bitrate != self.bitrate

    def take_address(self, node: int | None, bitrate: int) -> None:
        """Use this node-ID and bit rate from now on: called while the machine is reset."""
        self.bitrate = bitrate
        if node != self.node.node:
            self.node.renumber(node)
            # The default COB-IDs are now those of the new node-ID; saved ones are kept.
            self.node.stored.restore(_PDO_RECORDS.start, _PDO_RECORDS.stop - 1)

    def save_records(self) -> None:
        """Save the PDO records for later resets. Those with default values are not saved: they follow the node-ID."""
        values = self.node.stored.values
        for entry in self.objects:
            if entry.index in _PDO_RECORDS and entry.access == "rw" and entry.on_read is None:
                place, value = (entry.index, entry.sub), self.objects.get(entry.index, entry.sub)
                values.pop(place, None)
                if value != entry.default:
                    values[place] = value

    def forget_records(self) -> None:
        """Delete the saved PDO records: from the next reset on the defaults count."""
        self.node.stored.values.clear()

    def power_on(self, now: float) -> None:
        """Switch the power on: the node boots at the next `feed`, with the saved PDO records."""
        self.node.stored.restore(_COMMUNICATION.start, 0xFFFF)
        self._pending.clear()
        self._boots_at = now

    def start(self, now: float) -> list[CanFrame]:
        """Boot, and return the boot-up message."""
        self._tick(now)
        self._boots_at = None
        return self.node.start(self.machine.clock.now)

    @property
    def on_failure(self) -> Callable[[str, Exception], None] | None:
        """Called with each error in the code of the machine, as that of `LocalNode`."""
        return self.node.on_failure

    @on_failure.setter
    def on_failure(self, function: Callable[[str, Exception], None] | None) -> None:
        self.node.on_failure = function

    def _tick(self, now: float) -> None:
        """Advance the machine. If its code fails, that is reported, and the node works on."""
        try:
            self.machine.tick(now)
        except Exception as error:
            self.machine.clock.advance(now)  # time goes on: heartbeats of the node depend on it
            self.node.report_failure("machine", error)

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return the frames that the node sends after a received frame, or after time has passed."""
        self._tick(now)
        if self._is_at_another_bitrate:
            return []
        sent = [] if self._boots_at is None else self.start(now)
        pending, self._pending = self._pending, []
        sent += pending + self.node.feed(frame, self.machine.clock.now)
        # The frame may have been a reset, after which the machine has another bit rate.
        return [] if self._is_at_another_bitrate else sent

    def error(self, code: int, register: int) -> None:
        """Report an error of the machine: an emergency is sent at the next `feed`."""
        self._pending += self.node.error(code, self.machine.clock.now, source="machine", register=register)

    def no_error(self) -> None:
        """Report that the machine has no error any more: emergency 0000h is sent at the next `feed`."""
        for code in self.node.errors.active:
            self._pending += self.node.error_gone(code, self.machine.clock.now, source="machine")

    def _on_reset(self, command: NmtCommand) -> None:
        # The dictionary has restored the PDO records; objects that lie in the store are restored here [CiA 301, NMT].
        if command is NmtCommand.RESET_NODE:
            self.machine.reset()
            return
        saved = self.machine.store.saved
        for cell in self.machine.store:
            place = cell.parameter.object
            if place is not None and place.index in _COMMUNICATION:
                cell.set(saved.get(cell.name, cell.default))
        self.machine.reset_communication()


def _pdo(described: DevicePdo, node: int) -> PdoConfig:
    """Return the factory setting of a PDO: the COB-ID of the description plus the node-ID."""
    mapping = tuple(index << 16 | sub << 8 | bits for index, sub, bits in described.map)
    # TPDO1 180h, RPDO1 200h, TPDO2 280h, RPDO2 300h ...: those of TPDOs have bit 7.
    if described.cob_id & 0x80:
        pdo = PdoConfig("TPDO", described.cob_id >> 8, mapping, type=described.transmission)
    else:
        pdo = PdoConfig("RPDO", (described.cob_id >> 8) - 1, mapping, type=described.transmission)
    # Without `cob_id` a PDO has the predefined COB-ID, which follows the node-ID; only another one is given.
    cob_id = described.cob_id + node
    return pdo if pdo.cob_entry(node).pack() == cob_id else replace(pdo, cob_id=cob_id)


def _entries(machine: SimulatedMachine) -> list[Entry]:
    """Return one entry for each object: the described ones, and those composed of described bits."""
    entries: dict[tuple[int, int], Entry] = {}
    bits: dict[tuple[int, int], list[Cell]] = {}
    for cell in machine.store:
        place = cell.parameter.object
        if place is None or place.index in _PDO_RECORDS:
            continue  # `LocalNode` makes the records of its PDOs
        if place.bit is not None:
            bits.setdefault((place.index, place.sub), []).append(cell)
        else:
            entries.setdefault((place.index, place.sub), _entry(cell))
    for (index, sub), cells in bits.items():
        if (index, sub) not in entries:
            entries[index, sub] = _composed(index, sub, cells)
    return list(entries.values())


def _entry(cell: Cell) -> Entry:
    """Return the entry of a whole object. Its limits are raw numbers, because the dictionary checks those."""
    parameter = cell.parameter
    place = parameter.object
    assert place is not None

    def read() -> Value:
        value = cell.shown()
        return bool(value) if parameter.type == "bool" else cell.free.to_raw(value)

    def write(raw: Value) -> None:
        value = cell.free.from_raw(raw)
        with _declined_as_abort(place.index, place.sub):
            cell.check(value)
        cell.put(value)

    def raw_limit(value: int | float | None, side: int) -> float | None:
        if value is None or parameter.type == "text":
            return None
        return float(parameter.limit(value, side) / parameter.scale)

    return Entry(
        place.index,
        place.sub,
        parameter.name,
        "string" if parameter.type == "text" else parameter.object_type,
        parameter.access,
        minimum=raw_limit(parameter.minimum, -1),
        maximum=raw_limit(parameter.maximum, 1),
        on_read=read,
        on_write=write,
    )


def _composed(index: int, sub: int, cells: list[Cell]) -> Entry:
    """Return the entry of a 16-bit word that is described bit by bit."""
    places = [(cell, cell.parameter.object.bit or 0) for cell in cells if cell.parameter.object is not None]

    def read() -> Value:
        word = 0
        for cell, bit in places:
            word = set_bit(word, bit, bool(cell.get()))
        return word

    def write(word: Value) -> None:
        bits = [(cell, get_bit(int(word), bit)) for cell, bit in places if cell.parameter.writable]
        with _declined_as_abort(index, sub):
            for cell, on in bits:
                cell.check(on)
        for cell, on in bits:  # all or none: no bit is stored before all are checked
            cell.put(on)

    access: ObjectAccess = "rw" if any(cell.parameter.writable for cell in cells) else "ro"
    return Entry(index, sub, f"{index:04X}h", "u16", access, on_read=read, on_write=write)


@contextmanager
def _declined_as_abort(index: int, sub: int) -> Iterator[None]:
    try:
        yield
    except Declined as declined:
        raise SdoAbort(_ABORT_CODES[declined.reason], index, sub) from declined
