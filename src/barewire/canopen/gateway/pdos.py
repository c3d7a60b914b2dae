"""The gateway's own PDOs: those it receives and tells, and those it is told to send.   [CiA 309-3, PDO configuration]

        [1] set rpdo 1 0x185 event 2 0x6041 0 u16 0x2005 0 u16
        1 pdo 1 2 0x0637 0x0000                    told whenever one comes
        [2] read pdo 1                             the last values
        [3] set tpdo 1 0x205 sync1 1 0x6040 0 u16
        [4] write pdo 1 1 0x000F                   goes out when the transmission type says so: here at the next SYNC

Indices and sub-indices are for people, the types say how many bits each value has. The engine is the one of a device
(`pdo_engine`): the values lie in a little dictionary of the gateway's own.
"""

from __future__ import annotations

from barewire.canopen.frame import CanFrame
from barewire.canopen.gateway.codes import GatewayCode, GatewayError
from barewire.canopen.gateway.requests import SetPdo
from barewire.canopen.gateway.values import TYPE_NAMES, from_text, to_text, width, words_of
from barewire.canopen.object_dictionary import Entry, ObjectDictionary
from barewire.canopen.pdo.config import PdoConfig
from barewire.canopen.pdo.engine import PdoEngine
from barewire.codecs import Value

_INDEX = 0x2000
_OWN_NODE = 127
"""The gateway is no node; the engine wants a number for its records and says nothing under it."""

_EVENT, _RTR = 255, 253


class GatewayPdo:
    """One PDO of the gateway, as `set rpdo` or `set tpdo` made it. A machine: `feed` and `deadline`."""

    def __init__(self, request: SetPdo) -> None:
        self.request = request
        entries = [
            Entry(_INDEX, sub, f"value {sub}", TYPE_NAMES[type], default=False if type == "b" else 0)
            for sub, type in enumerate(request.types, 1)
        ]
        self._objects = ObjectDictionary(entries)
        mapping = tuple(_INDEX << 16 | sub << 8 | width(type) for sub, type in enumerate(request.types, 1))
        transmission = {"event": _EVENT, "rtr": _RTR}.get(request.transmission)
        if transmission is None:
            transmission = int(request.transmission.removeprefix("sync"))
        # The gateway's RPDO comes to it, so for the engine it is an RPDO too; likewise the TPDO.
        pdo = PdoConfig(
            "TPDO" if request.send else "RPDO",
            1,
            mapping,
            transmission if request.send or transmission != _RTR else _EVENT,
            request.cob_id,
            request.inhibit,
            request.timer if request.send else 0,
            request.sync_start,
            slots=max(8, len(mapping)),
        )
        self._engine = PdoEngine(_OWN_NODE, self._objects, [pdo])
        if not request.send or transmission != _EVENT:
            self._engine.start()

    @property
    def deadline(self) -> float | None:
        """When the engine has something to send."""
        return self._engine.deadline

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """What goes out now. The engine's emergencies are not ours to send: a short PDO is simply not told."""
        return [said for said in self._engine.feed(frame, now) if said.id == self.request.cob_id]

    def came(self, frame: CanFrame) -> bool:
        """Whether this frame is a PDO that the gateway receives here, whole."""
        request = self.request
        whole = len(frame.data) * 8 >= sum(map(width, request.types))
        return not request.send and not frame.remote and frame.key == (request.cob_id, False) and whole

    def write(self, words: tuple[str, ...]) -> None:
        """New values for a TPDO. Raises GatewayError."""
        if not self.request.send:
            text = f"PDO {self.request.number} is one that the gateway receives"
            raise GatewayError(GatewayCode.INTERNAL_STATE, text)
        wanted = sum(words_of(type) for type in self.request.types)
        if len(words) != wanted:
            text = f"PDO {self.request.number} has {len(self.request.types)} values in {wanted} words, not {len(words)}"
            raise GatewayError(GatewayCode.SYNTAX, text)
        values: list[Value] = []
        at = 0
        for sub, type in enumerate(self.request.types, 1):
            data = from_text(type, list(words[at : at + words_of(type)]))
            values.append(self._objects.entry(_INDEX, sub).codec.decode(data))
            at += words_of(type)
        for sub, value in enumerate(values, 1):
            self._objects.set(_INDEX, sub, value)
        for pdo in self._engine.active:
            pdo.sent = None  # so the next values are sent even if they are the same
        if self.request.transmission == "event" and self._engine.deadline is None:
            self._engine.start()

    def told(self) -> str:
        """The count and the values, in hexadecimal as other gateways tell them; a real or a time as it is read."""
        words = [str(len(self.request.types))]
        for sub, type in enumerate(self.request.types, 1):
            data = self._objects.read(_INDEX, sub)
            words.append(_hexadecimal(type, data))
        return " ".join(words)


def _hexadecimal(type: str, data: bytes) -> str:
    if type[0] in "iux":
        return f"0x{int.from_bytes(data, 'little'):0{2 * len(data)}X}"
    return to_text(type, data)
