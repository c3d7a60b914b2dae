"""Notices: the lines of a gateway that no command requested.   [CiA 309-3, events]

        1 5 BOOT_UP                         with `boot_up_indication enable`: node 5 of net 1 has booted
        1 5 EMCY 8130 11 0 0 0 0 0          with `_emcy_indication enable`: an emergency, its code and error
                                            register in hexadecimal, five bytes
        1 5 ERROR 203 #heartbeat lost       with `enable heartbeat`: 202 first received, 203 lost, 204 an unwanted state
        1 5 ERROR 201 #...                  with `enable guarding`: 200 a wrong toggle bit, 201 lost
        1 pdo 1 2 0x0637 0x0000             a PDO configured with `set rpdo`
        1 ERROR 301 #bus off                with `_bus_indication enable`: the CAN controller

There is no such line before a command asked for it. A machine: it is fed every frame of the net, and the time.
"""

from __future__ import annotations

from typing import Literal

from barewire.canopen.emcy import EmcyConsumer
from barewire.canopen.frame import CanFrame
from barewire.canopen.gateway.commands import GatewayCode, GatewayError, SetPdo
from barewire.canopen.gateway.pdos import GatewayPdo
from barewire.canopen.nmt.heartbeat import HeartbeatConsumer, HeartbeatEvent
from barewire.canopen.nmt.node_guarding import Guard, GuardEvent, GuardingMaster

_GUARD_CODES = {"lost": GatewayCode.LOST_CONNECTION, "toggle": GatewayCode.LOST_GUARDING_MESSAGE}
_GUARD_TEXTS = {"lost": "no answer to guarding", "toggle": "the toggle bit did not alternate"}


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
        dues = [self._heartbeats.deadline, self._guarding.deadline]
        dues += [pdo.deadline for pdo in self.pdos.values()]
        return min((due for due in dues if due is not None), default=None)

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

    def set_pdo(self, settings: SetPdo) -> None:
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

    def pdo(self, send: bool, number: int) -> GatewayPdo:
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

    def _error(self, node: int, code: GatewayCode, text: str) -> str:
        return f"{self.net} {node} ERROR {int(code)} #{text}"

    def _heartbeat_lines(self, event: HeartbeatEvent) -> list[str]:
        if event.kind in ("booted", "rebooted"):
            return [f"{self.net} {event.node} BOOT_UP"] if self.enabled["boot_up"] else []
        if event.node not in self._heartbeats.times:
            return []
        if event.kind == "lost":
            return [self._error(event.node, GatewayCode.HEARTBEAT_LOST, "heartbeat lost")]
        if event.kind == "active":
            return [self._error(event.node, GatewayCode.HEARTBEAT_STARTED, "heartbeat started")]
        return [self._error(event.node, GatewayCode.WRONG_NMT_STATE, f"its NMT state is now {event.state:02X}h")]

    def _guarding_lines(self, event: GuardEvent) -> list[str]:
        if event.kind == "booted" or event.kind == "answered":
            return []
        if event.kind == "state":
            text = f"its NMT state is now {event.state or 0:02X}h"
            return [self._error(event.node, GatewayCode.WRONG_NMT_STATE, text)]
        return [self._error(event.node, _GUARD_CODES[event.kind], _GUARD_TEXTS[event.kind])]
