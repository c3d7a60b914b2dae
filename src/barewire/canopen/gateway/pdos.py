"""The PDOs of the gateway: received ones, which it reports, and sent ones.   [CiA 309-3, PDO configuration]

        [1] set rpdo 1 0x185 event 2 0x6041 0 u16 0x2005 0 u16
        1 pdo 1 2 0x0637 0x0000                    reported whenever one is received
        [2] read pdo 1                             the last values
        [3] set tpdo 1 0x205 sync1 1 0x6040 0 u16
        [4] write pdo 1 1 0x000F                   sent as the transmission type determines: here at the next SYNC

The types give the number of bits of each value; index and sub-index are only for readers of the line. The PDO engine of
a device sends and receives them; the values are in a small object dictionary of the gateway.
"""

from __future__ import annotations

from barewire.canopen.frame import CanFrame
from barewire.canopen.gateway.commands import GatewayCode, GatewayError, SetPdo
from barewire.canopen.gateway.values import TYPE_NAMES, from_text, to_text, width, word_count
from barewire.canopen.object_dictionary import Entry, ObjectDictionary
from barewire.canopen.pdo.config import PdoConfig
from barewire.canopen.pdo.engine import PdoEngine
from barewire.codecs import Value

_INDEX = 0x2000
_OWN_NODE = 127
"""The gateway is not a node, but the records of the engine need a node-ID. It is in no frame that is sent."""

_EVENT, _RTR = 255, 253


class GatewayPdo:
    """One PDO of the gateway, made by `set rpdo` or `set tpdo`. A machine: `feed` and `deadline`."""

    def __init__(self, settings: SetPdo) -> None:
        self.settings = settings
        entries = [
            Entry(_INDEX, sub, f"value {sub}", TYPE_NAMES[type], default=False if type == "b" else 0)
            for sub, type in enumerate(settings.types, 1)
        ]
        self._objects = ObjectDictionary(entries)
        mapping = tuple(_INDEX << 16 | sub << 8 | width(type) for sub, type in enumerate(settings.types, 1))
        transmission = {"event": _EVENT, "rtr": _RTR}.get(settings.transmission)
        if transmission is None:
            transmission = int(settings.transmission.removeprefix("sync"))
        pdo = PdoConfig(
            "TPDO" if settings.send else "RPDO",
            1,
            mapping,
            transmission if settings.send or transmission != _RTR else _EVENT,
            settings.cob_id,
            settings.inhibit,
            settings.timer if settings.send else 0,
            settings.sync_start,
            slots=max(8, len(mapping)),
        )
        self._engine = PdoEngine(_OWN_NODE, self._objects, [pdo])
        if not settings.send or transmission != _EVENT:
            self._engine.start()

    @property
    def deadline(self) -> float | None:
        """When the engine will send."""
        return self._engine.deadline

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return the PDOs to send now. Emergencies of the engine, about PDOs that are too short, are not sent."""
        return [sent for sent in self._engine.feed(frame, now) if sent.id == self.settings.cob_id]

    def receives(self, frame: CanFrame) -> bool:
        """Return whether this frame is this PDO, received completely."""
        settings = self.settings
        whole = len(frame.data) * 8 >= sum(map(width, settings.types))
        return not settings.send and not frame.remote and frame.key == (settings.cob_id, False) and whole

    def write(self, words: tuple[str, ...]) -> None:
        """Set the values of a TPDO. Raise GatewayError."""
        if not self.settings.send:
            text = f"PDO {self.settings.number} is received by the gateway, not sent"
            raise GatewayError(GatewayCode.INTERNAL_STATE, text)
        wanted = sum(word_count(type) for type in self.settings.types)
        if len(words) != wanted:
            count = len(self.settings.types)
            text = f"PDO {self.settings.number} has {count} values in {wanted} words, not {len(words)}"
            raise GatewayError(GatewayCode.SYNTAX, text)
        values: list[Value] = []
        position = 0
        for sub, type in enumerate(self.settings.types, 1):
            data = from_text(type, list(words[position : position + word_count(type)]))
            values.append(self._objects.entry(_INDEX, sub).codec.decode(data))
            position += word_count(type)
        for sub, value in enumerate(values, 1):
            self._objects.set(_INDEX, sub, value)
        for pdo in self._engine.active:
            pdo.sent = None  # so the next values are sent even if they are the same
        if self.settings.transmission == "event" and self._engine.deadline is None:
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
