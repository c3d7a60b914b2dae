"""The pictures of a recording: a sequence diagram, or the state machine of a drive in it."""

from __future__ import annotations

from collections.abc import Container, Iterable
from typing import NamedTuple

from barewire.devices.device import Device
from barewire.errors import BarewireError
from barewire.modbus.sniffer import WINDOW
from barewire_workbench.frames.canopen.known_node import KnownNode
from barewire_workbench.frames.modbus.named_registers import UnitNames
from barewire_workbench.monitor.recording import is_can_recording, is_timed, read_recording
from barewire_workbench.pictures.drive_words import DriveWords, can_drive_words, modbus_drive_words
from barewire_workbench.pictures.exchanges import CLIENT, MASTER, can_messages, modbus_messages
from barewire_workbench.pictures.picture import Picture
from barewire_workbench.pictures.sequence import SequencePicture
from barewire_workbench.pictures.states import StatesPicture
from barewire_workbench.recordings.modbus_packets import MODBUS_PORTS
from barewire_workbench.recordings.modbus_replay import SerialProtocol, replay_log


class RecordingOptions(NamedTuple):
    """How a recording is read: one `bus` of several; the others are for Modbus, see `replay_log`."""

    bus: str | None = None
    window: float = WINDOW
    ports: Container[int] = MODBUS_PORTS
    protocol: SerialProtocol | None = None


def recording_picture(
    name: str,
    data: bytes,
    picture: str | None = None,
    options: RecordingOptions = RecordingOptions(),  # noqa: B008 - a value that cannot change
    *,
    known: Iterable[KnownNode] = (),
    device: Device | None = None,
    number: int | None = None,
    names: UnitNames | None = None,
) -> Picture:
    """Return the picture "sequence" of a recording, its messages, or "states", the state machine of a drive in it.

    >>> recording_picture("bus.log", b"(1.5) can0 705#05").lines()[1]
    '1.500000    |<--------------|       error control from node 5: operational   05'

    The drive is the node or unit `number`, or the first one. Its words are objects 6040h and 6041h on CAN; PDOs of
    `known` nodes have the mapping of their description. On Modbus the description of the `device` says which registers
    they are; `names` has those of the values of a sequence diagram.

    Raises DecodeError if the bytes are not a recording, BarewireError if there is no word of a drive in it.
    """
    is_can = is_can_recording(data, options.ports)
    if picture == "states":
        if not is_can and device is None:
            raise BarewireError(f"{name}: the states of a drive on Modbus need its description: --device NAME")
        return _states(name, data, options, tuple(known), device, number)
    if is_can:
        timed = is_timed(data)
        messages = can_messages(read_recording(data), options.bus, known)
        return SequencePicture(
            f"Messages in {name}", (message if timed else message._replace(at=None) for message in messages), [MASTER]
        )
    log, events = replay_log(data, window=options.window, ports=options.ports, protocol=options.protocol)
    return SequencePicture(f"Messages in {name}", modbus_messages(events, timed=log.timed, names=names), [CLIENT])


def _states(
    name: str,
    data: bytes,
    options: RecordingOptions,
    known: tuple[KnownNode, ...],
    device: Device | None,
    number: int | None,
) -> StatesPicture:
    if device is None or is_can_recording(data, options.ports):
        station, drives = "node", can_drive_words(read_recording(data), known, options.bus)
        timed = is_timed(data)
    else:
        log, events = replay_log(data, window=options.window, ports=options.ports, protocol=options.protocol)
        station, drives, timed = "unit", modbus_drive_words(events, device), log.timed
    place = _chosen(drives, number)
    if place is None:
        whom = f" of {station} {number}" if number is not None else ""
        raise BarewireError(f"{name}: no status word and no control word{whom} of a CiA 402 drive is in it")
    words = (word if timed else word._replace(at=None) for word in drives[place].kept)
    return StatesPicture(words, f"{station} {place}")


def _chosen(drives: dict[int, DriveWords], number: int | None) -> int | None:
    """Return the number of the drive: the given one, or the first with a status word, or the first."""
    places = [place for place in drives if number in (None, place)]
    with_status = [place for place in places if any(word.kind == "status" for word in drives[place].kept)]
    return next(iter(with_status or places), None)
