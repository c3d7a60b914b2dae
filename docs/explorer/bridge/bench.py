"""A simulated CiA 402 drive on a wire in memory: what the page's buttons write, what the plot reads, and every frame.

    page --act("control", 6)-->  write by name  --frames-->  simulated drive
         --sample(now)------->   read by name   <--frames--  (time is the page's)

Two drives of the catalogue, each on one of its wires: the CSD MT on Modbus TCP, the AZ3 on CANopen.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Generic

from barewire.canopen import CanFrame, Channel
from barewire.codecs import Value
from barewire.conversation import Conversation, Item, Wire
from barewire.devices.canopen_access import read_canopen, write_canopen
from barewire.devices.cia402 import DriveCommand, State, state_of
from barewire.devices.device import drive_roles
from barewire.devices.modbus_access import read_modbus, write_modbus
from barewire.devices.parameter import Reading
from barewire.devices.sim import MachineUnits, Simulator, simulator
from barewire.errors import DecodeError, EncodeError
from barewire.modbus import Bus, Server
from barewire.tcp import TcpLine
from barewire_workbench import explain
from barewire_workbench.frames.can import explain_can
from barewire_workbench.pictures.picture import html_fragment
from barewire_workbench.pictures.states import DriveWord, StatesPicture, WordKind

_FRAMES_KEPT = 200
_WORDS_KEPT = 60
_SLOWEST = 0.25
"""The longest step of the simulated time, in seconds: a page in the background asks rarely."""


class Bench(ABC, Generic[Item]):
    """A drive, the wire to it, and the frames that passed."""

    protocol: str

    def __init__(self, name: str) -> None:
        self.machine: Simulator = simulator(name)
        self.roles = drive_roles(self.machine.device)
        self.wire: Wire[Item] = Wire(self._passes)
        self.words: deque[DriveWord] = deque(maxlen=_WORDS_KEPT)
        """Status and control words, for the picture of the states."""
        self.words_seen = 0
        self._frames: deque[dict[str, Any]] = deque(maxlen=_FRAMES_KEPT)
        self._number = 0
        self._polls = False

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.machine.device.name}>"

    def write(self, values: Mapping[str, Value]) -> None:
        """Write values by name."""
        self._polls = False
        self.wire.play(self._writes(values))

    def read(self, names: list[str]) -> list[Reading]:
        """Read values by name; their frames are marked as those of the plot."""
        self._polls = True
        return self.wire.play(self._reads(names))

    def frames_after(self, number: int) -> list[dict[str, Any]]:
        """Return the frames with a greater number."""
        return [frame for frame in self._frames if frame["number"] > number]

    def _passes(self, item: Item, now: float) -> Iterator[tuple[float, Item]]:
        self._note(item, now, "request")
        for at, answer in self._answers(item, now):
            self._note(answer, at, "response")
            yield at, answer

    def _note(self, item: Item, now: float, role: str) -> None:
        self._number += 1
        text, said = self._said(item, role)
        entry = {"number": self._number, "at": now, "role": role, "text": text, "said": said, "polls": self._polls}
        self._frames.append({**entry, "protocol": self.protocol})

    @abstractmethod
    def _answers(self, item: Item, now: float) -> Iterable[tuple[float, Item]]: ...

    @abstractmethod
    def _said(self, item: Item, role: str) -> tuple[str, str]:
        """Return the frame as text, and what it says."""

    @abstractmethod
    def _reads(self, names: list[str]) -> Conversation[Item, list[Reading]]: ...

    @abstractmethod
    def _writes(self, values: Mapping[str, Value]) -> Conversation[Item, None]: ...


class ModbusBench(Bench[bytes]):
    """A drive on Modbus TCP."""

    protocol = "tcp"

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._bus = Bus(TcpLine())
        self._server = Server(TcpLine(), MachineUnits(self.machine), serial=False)

    def _answers(self, item: bytes, now: float) -> Iterable[tuple[float, bytes]]:
        return [(max(reply.at, now), reply.data) for reply in self._server.feed(item, now)]

    def _said(self, item: bytes, role: str) -> tuple[str, str]:
        return item.hex(" ").upper(), explain("tcp", item, "request" if role == "request" else "response").summary

    def _reads(self, names: list[str]) -> Conversation[bytes, list[Reading]]:
        return read_modbus(self._bus, self.machine.address, self.machine.device, names)

    def _writes(self, values: Mapping[str, Value]) -> Conversation[bytes, None]:
        return write_modbus(self._bus, self.machine.address, self.machine.device, values)


class CanopenBench(Bench[CanFrame]):
    """A drive on CANopen, by SDO."""

    protocol = "can"

    def __init__(self, name: str) -> None:
        super().__init__(name)
        settings = self.machine.device.canopen
        if settings is None or self.machine.canopen is None:
            raise EncodeError(f"{name} has no CANopen")
        self._node = self.machine.canopen
        self._channel = Channel(settings.node)

    def _answers(self, item: CanFrame, now: float) -> Iterable[tuple[float, CanFrame]]:
        return [(now, sent) for sent in self._node.feed(item, now)]

    def _said(self, item: CanFrame, role: str) -> tuple[str, str]:
        return str(item), explain_can(item).summary

    def _reads(self, names: list[str]) -> Conversation[CanFrame, list[Reading]]:
        return read_canopen(self._channel, self.machine.device, names)

    def _writes(self, values: Mapping[str, Value]) -> Conversation[CanFrame, None]:
        return write_canopen(self._channel, self.machine.device, values)


_BENCHES: dict[str, Callable[[str], Bench[Any]]] = {"csd-mt": ModbusBench, "az3": CanopenBench}
_COMMANDS = {
    "shutdown": DriveCommand.SHUTDOWN,
    "switch-on": DriveCommand.SWITCH_ON,
    "enable": DriveCommand.ENABLE_OPERATION,
    "disable": DriveCommand.DISABLE_VOLTAGE,
    "quick-stop": DriveCommand.QUICK_STOP,
}
_SETTINGS = ("mode", "target_position", "target_velocity", "profile_velocity", "acceleration", "deceleration")
_present: list[Bench[Any]] = []
"""The drive that the page shows, if it has asked for one."""


def drive(device: str) -> dict[str, Any]:
    """Switch on a drive and return what its controls need."""
    if device not in _BENCHES:
        raise EncodeError(f"device {device!r}: expected one of {', '.join(_BENCHES)}")
    bench = _BENCHES[device](device)
    _present[:] = [bench]
    names = [name for role in _SETTINGS[1:] if (name := getattr(bench.roles, role))]
    readings = bench.read(names)
    return {
        "device": device,
        "title": bench.machine.device.name,
        "protocol": bench.protocol,
        "modes": {name: number for name, number in bench.roles.modes.items() if name != "homing"},
        "settings": {role: _setting(reading) for role, reading in zip(_SETTINGS[1:], readings)},
        "units": {role: _unit(bench, role) for role in ("position", "velocity")},
    }


def _setting(reading: Reading) -> dict[str, Any]:
    return {"name": reading.name, "value": reading.value, "unit": reading.unit}


def _unit(bench: Bench[Any], role: str) -> str:
    return bench.machine.device.find(getattr(bench.roles, role)).unit


def act(action: str, values: Mapping[str, float] | None = None) -> None:
    """Do what a control of the page says: a command, a fault reset, settings, a movement, or another supply voltage."""
    bench = _bench()
    roles = bench.roles
    if action in _COMMANDS:
        _control(bench, int(_COMMANDS[action]))
    elif action == "reset":
        _control(bench, 0x0000)
        _control(bench, int(DriveCommand.FAULT_RESET))
    elif action == "set":
        bench.write({getattr(roles, role): number for role, number in (values or {}).items() if role in _SETTINGS})
    elif action in ("move", "move-relative"):
        _control(bench, 0x000F)
        _control(bench, 0x001F if action == "move" else 0x005F)
        _control(bench, 0x000F)
    elif action == "volts":
        bench.machine.set_environment(f"volts={(values or {}).get('volts', 0):g}")
    else:
        known = [*_COMMANDS, "reset", "set", "move", "move-relative", "volts"]
        raise EncodeError(f"action {action!r}: expected one of {', '.join(known)}")


def _control(bench: Bench[Any], word: int) -> None:
    _note_word(bench, "control", word)
    bench.write({bench.roles.control_word: word})
    bench.machine.tick(bench.wire.now)
    _status(bench)


def _status(bench: Bench[Any]) -> int:
    (reading,) = bench.read([bench.roles.status_word])
    word = int(reading.value)
    if word != next((entry.word for entry in reversed(bench.words) if entry.kind == "status"), None):
        _note_word(bench, "status", word)
    return word


def _note_word(bench: Bench[Any], kind: WordKind, word: int) -> None:
    bench.words.append(DriveWord(kind, word, bench.wire.now))
    bench.words_seen += 1


def sample(now: float, after: int = 0, path: int = -1) -> dict[str, Any]:
    """Let the drive run to the time `now`, at most a quarter of a second, and read it.

    The result has the frames since number `after`, and the picture of the states if its path is no longer the one with
    the number `path`.
    """
    bench = _bench()
    bench.wire.now = max(bench.wire.now, min(now, bench.wire.now + _SLOWEST))
    bench.machine.tick(bench.wire.now)
    word = _status(bench)
    position, velocity = bench.read([bench.roles.position, bench.roles.velocity])
    return {
        "now": bench.wire.now,
        "status_word": f"{word:04X}",
        "state": _state(word),
        "position": position.value,
        "velocity": velocity.value,
        "path": bench.words_seen,
        "states": html_fragment(StatesPicture(bench.words), "picture-states") if path != bench.words_seen else None,
        "frames": bench.frames_after(after),
    }


def _state(word: int) -> str:
    try:
        return state_of(word).value
    except DecodeError:
        return State.NOT_READY_TO_SWITCH_ON.value


def _bench() -> Bench[Any]:
    if not _present:
        raise EncodeError("no drive: switch one on first")
    return _present[0]
