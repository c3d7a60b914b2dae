"""What a gateway does without a line: its notices, and its PDOs.   [CiA 309-3, events, PDO configuration]

        1 5 BOOT_UP                         with `boot_up_indication enable`: node 5 of net 1 has booted
        1 5 EMCY 8130 11 0 0 0 0 0          with `_emcy_indication enable`: an emergency, its code and error
                                            register in hexadecimal, five bytes
        1 5 ERROR 203 #heartbeat lost       with `enable heartbeat`: 202 first received, 203 lost, 204 an unwanted state
        1 5 ERROR 201 #...                  with `enable guarding`: 200 a wrong toggle bit, 201 lost
        1 pdo 1 2 0x0637 0x0000             a PDO configured with `set rpdo`
        1 ERROR 301 #bus off                with `_bus_indication enable`: the CAN controller

There is no such line before a command asked for it. A machine: it is fed every frame of the net, and the time.

        [1] set rpdo 1 0x185 event 2 0x6041 0 u16 0x2005 0 u16
        1 pdo 1 2 0x0637 0x0000                    reported whenever one is received
        [2] read pdo 1                             the last values
        [3] set tpdo 1 0x205 sync1 1 0x6040 0 u16
        [4] write pdo 1 1 0x000F                   sent as the transmission type determines: here at the next SYNC

The types give the number of bits of each value; index and sub-index are only for readers of the line. The PDO engine of
a device sends and receives them; the values are in a small object dictionary of the gateway.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from barewire.canopen.emcy import EmcyConsumer
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.error_control import Guard, GuardEvent, GuardingMaster, HeartbeatConsumer, HeartbeatEvent
from barewire.canopen.object_dictionary import Entry, ObjectDictionary
from barewire.canopen.pdo.config import RTR_AT_ONCE, PdoConfig
from barewire.canopen.pdo.engine import PdoEngine
from barewire.codecs import Value
from barewire_workbench.ascii_gateway.lines import (
    TYPE_NAMES,
    GatewayCode,
    GatewayError,
    from_text,
    to_text,
    width,
    word_count,
)

# PDOs --------------------------------------------------------------------------------------------------------------

_INDEX = 0x2000
_OWN_NODE = 127
"""The gateway is not a node, but the records of the engine need a node-ID. It is in no frame that is sent."""

EVENT, RTR = 255, RTR_AT_ONCE
"""The transmission types of the words `event` and `rtr`."""


@dataclass(frozen=True, slots=True)
class PdoSettings:
    """What `set rpdo`, `set tpdo` or `set tpdox` says of a PDO: the gateway receives its RPDOs and sends its TPDOs."""

    send: bool
    number: int
    cob_id: int
    transmission: int
    types: tuple[str, ...]
    inhibit: int = 0
    timer: int = 0
    sync_start: int = 0


class GatewayPdo:
    """One PDO of the gateway. A machine: `feed` and `deadline`."""

    def __init__(self, settings: PdoSettings) -> None:
        self.settings = settings
        entries = [
            Entry(_INDEX, sub, f"value {sub}", TYPE_NAMES[type], default=False if type == "b" else 0)
            for sub, type in enumerate(settings.types, 1)
        ]
        self._objects = ObjectDictionary(entries)
        mapping = tuple(_INDEX << 16 | sub << 8 | width(type) for sub, type in enumerate(settings.types, 1))
        transmission = settings.transmission
        pdo = PdoConfig(
            "TPDO" if settings.send else "RPDO",
            1,
            mapping,
            # An RPDO cannot be requested: it is received as one of an event.
            transmission if settings.send or transmission != RTR else EVENT,
            settings.cob_id,
            settings.inhibit,
            settings.timer if settings.send else 0,
            settings.sync_start,
            slots=max(8, len(mapping)),
        )
        self._engine = PdoEngine(_OWN_NODE, self._objects, [pdo])
        # A started engine sends an event-driven TPDO at once; this one waits for its first values.
        if not settings.send or transmission != EVENT:
            self._engine.start()

    @property
    def deadline(self) -> float | None:
        """When the engine will send."""
        return self._engine.deadline

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return the PDOs to send now."""
        # The engine also returns emergencies about PDOs that are too short. The gateway is no node that could send one.
        return [sent for sent in self._engine.feed(frame, now) if sent.id == self.settings.cob_id]

    def receives(self, frame: CanFrame) -> bool:
        """Return whether this frame is this PDO, received completely."""
        settings = self.settings
        whole = len(frame.data) * 8 >= sum(map(width, settings.types))
        return not settings.send and not frame.remote and frame.key == (settings.cob_id, False) and whole

    def write(self, words: list[str]) -> None:
        """Set the values of a TPDO. Raise GatewayError."""
        if not self.settings.send:
            text = f"PDO {self.settings.number} is received by the gateway, not sent"
            raise GatewayError(GatewayCode.INTERNAL_STATE, text)
        expected = sum(word_count(type) for type in self.settings.types)
        if len(words) != expected:
            count = len(self.settings.types)
            text = f"PDO {self.settings.number} has {count} values in {expected} words, not {len(words)}"
            raise GatewayError(GatewayCode.SYNTAX, text)
        values: list[Value] = []  # all are read before one is set, so that a wrong one changes nothing
        position = 0
        for sub, type in enumerate(self.settings.types, 1):
            data = from_text(type, words[position : position + word_count(type)])
            values.append(self._objects.entry(_INDEX, sub).codec.decode(data))
            position += word_count(type)
        for sub, value in enumerate(values, 1):
            self._objects.set(_INDEX, sub, value)
        for pdo in self._engine.active:
            pdo.sent = None  # so the next values are sent even if they are the same
        if self.settings.transmission == EVENT and self._engine.deadline is None:
            self._engine.start()

    def text(self) -> str:
        """Return the number of values, and the values: integers in hexadecimal, others as in a read."""
        words = [str(len(self.settings.types))]
        for sub, type in enumerate(self.settings.types, 1):
            data = self._objects.read(_INDEX, sub)
            words.append(_hexadecimal(type, data))
        return " ".join(words)


def _hexadecimal(type: str, data: bytes) -> str:
    if type[0] in "iux":
        return f"0x{int.from_bytes(data, 'little'):0{2 * len(data)}X}"
    return to_text(type, data)


# Notices -----------------------------------------------------------------------------------------------------------

_GUARD_ERRORS = {
    "lost": (GatewayCode.LOST_CONNECTION, "no answer to guarding"),
    "toggle": (GatewayCode.LOST_GUARDING_MESSAGE, "the toggle bit did not alternate"),
}


class Notices:
    """The notices that one connection has enabled. `indications`: boot-ups, emergencies, bus errors from the start."""

    def __init__(self, net: int, *, indications: bool = False) -> None:
        self.net = net
        self.enabled: dict[Literal["boot_up", "emcy", "bus"], bool] = dict.fromkeys(
            ("boot_up", "emcy", "bus"), indications
        )
        self.pdos: dict[tuple[bool, int], GatewayPdo] = {}
        self._emcy = EmcyConsumer(history=1)
        self._heartbeats = HeartbeatConsumer({})
        self._guards: dict[int, Guard] = {}
        self._guarding = GuardingMaster({}, 0.0)

    @property
    def deadline(self) -> float | None:
        """When a heartbeat is overdue, a node must be guarded, or a PDO is sent."""
        deadlines = [self._heartbeats.deadline, self._guarding.deadline, *(pdo.deadline for pdo in self.pdos.values())]
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def heartbeat(self, node: int, seconds: float) -> None:
        """Report this node when no heartbeat arrived for that many seconds; 0 ends this."""
        times = {other: time for other, time in self._heartbeats.times.items() if other != node}
        self._heartbeats.watch(times | ({node: seconds} if seconds else {}))

    def guard(self, node: int, seconds: float, factor: int, now: float) -> None:
        """Guard this node every `seconds`; 0 ends this. The guarding of other nodes restarts."""
        self._guards.pop(node, None)
        if seconds:
            self._guards[node] = Guard(seconds, factor)
        self._guarding = GuardingMaster(self._guards, now)

    def set_pdo(self, settings: PdoSettings) -> None:
        """Replace the PDO of this number. Raise GatewayError if another one has its COB-ID."""
        key = settings.send, settings.number
        for other, pdo in self.pdos.items():
            if other != key and pdo.settings.cob_id == settings.cob_id:
                text = f"COB-ID {settings.cob_id:03X}h belongs to {'t' if other[0] else 'r'}pdo {other[1]}"
                raise GatewayError(GatewayCode.PDO_ALREADY_USED, text)
        if settings.types:
            self.pdos[key] = GatewayPdo(settings)
        else:
            self.pdos.pop(key, None)

    def pdo(self, number: int, *, send: bool) -> GatewayPdo:
        """Return a configured PDO. Raise GatewayError if there is none."""
        pdo = self.pdos.get((send, number))
        if pdo is None:
            text = f"there is no {'t' if send else 'r'}pdo {number}: set it first"
            raise GatewayError(GatewayCode.INTERNAL_STATE, text)
        return pdo

    def feed(self, frame: CanFrame | None, now: float) -> tuple[list[CanFrame], list[str]]:
        """Return the frames to send, and the lines to report."""
        frames: list[CanFrame] = []
        lines: list[str] = []
        for event in self._heartbeats.feed(frame, now):
            lines += self._heartbeat_lines(event)
        for result in self._guarding.feed(frame, now):
            if isinstance(result, CanFrame):
                frames.append(result)
            else:
                lines += self._guarding_lines(result)
        for emergency in self._emcy.feed(frame, now) if self.enabled["emcy"] else ():
            message = emergency.message
            info = " ".join(str(byte) for byte in message.info)
            lines.append(f"{self.net} {message.node} EMCY {message.code:04X} {message.register:02X} {info}")
        for pdo in self.pdos.values():
            frames += pdo.feed(frame, now)
            if frame is not None and pdo.receives(frame):
                lines.append(f"{self.net} pdo {pdo.settings.number} {pdo.text()}")
        return frames, lines

    def bus_error(self, code: GatewayCode, text: str) -> list[str]:
        """Return the line for a report of the CAN controller or the port, if it is enabled."""
        return [f"{self.net} ERROR {int(code)} #{' '.join(text.split())}"] if self.enabled["bus"] else []

    def _heartbeat_lines(self, event: HeartbeatEvent) -> list[str]:
        if event.kind in ("booted", "rebooted"):
            return [f"{self.net} {event.node} BOOT_UP"] if self.enabled["boot_up"] else []
        if event.node not in self._heartbeats.times:
            return []  # boot-ups are reported of every node, heartbeats of those with `enable heartbeat`
        if event.kind == "lost":
            return [self._error(event.node, GatewayCode.HEARTBEAT_LOST, "heartbeat lost")]
        if event.kind == "active":
            return [self._error(event.node, GatewayCode.HEARTBEAT_STARTED, "heartbeat started")]
        return [self._wrong_state(event.node, event.state or 0)]

    def _guarding_lines(self, event: GuardEvent) -> list[str]:
        if event.kind == "state":
            return [self._wrong_state(event.node, event.state or 0)]
        if event.kind in _GUARD_ERRORS:
            return [self._error(event.node, *_GUARD_ERRORS[event.kind])]
        return []

    def _wrong_state(self, node: int, state: int) -> str:
        return self._error(node, GatewayCode.WRONG_NMT_STATE, f"its NMT state is now {state:02X}h")

    def _error(self, node: int, code: GatewayCode, text: str) -> str:
        return f"{self.net} {node} ERROR {int(code)} #{text}"
