"""Scan a CAN bus: its nodes, and what each of them is.

    listen                  heartbeats, boot-ups and emergencies show nodes before anything is sent
    1000h of each node      `barewire.canopen.scan`: four requests under way at most
    1018h, 1008h, 1009h, 100Ah of those that answered, one after the other

Every request on the default SDO channel has one response. If a node-ID gives more responses than it had requests, two
devices have it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Literal

from barewire import CanopenClient
from barewire.canopen import CanFrame, ScannedNode, ScanResult
from barewire.devices import Device
from barewire.errors import DecodeError, NoAnswer, Refused
from barewire.io.endpoint import Endpoint
from barewire_workbench.scan.identity import DeviceIdentity, device_of, known_devices

_NUMBERS = {"vendor": 1, "product": 2, "revision": 3, "serial": 4}
"""The sub-indices of 1018h."""
_DEVICE_TYPE, _IDENTITY = 0x1000, 0x1018
_TEXTS = {"name": 0x1008, "hardware": 0x1009, "software": 0x100A}
_LONGEST_TEXT = 255
"""Bytes of a text or number; a node that sends more, or without an end, is not listened to."""

_REQUESTS, _RESPONSES = range(0x601, 0x680), range(0x581, 0x600)
_NODE = 0x7F


@dataclass(slots=True)
class FoundNode:
    """A node with the URL to use it, the evidence for it, and what it is, as far as it says so."""

    url: str
    scanned: ScannedNode
    identity: DeviceIdentity = field(default_factory=DeviceIdentity)
    device: Device | None = None
    is_doubled: bool = False
    is_silent: bool = False
    """It was asked and did not answer."""

    @property
    def node(self) -> int:
        """Its node-ID."""
        return self.scanned.node

    @property
    def why(self) -> str:
        """The evidence in words."""
        parts = [self.scanned.why]
        if self.scanned.state is not None:
            parts.append(f"state {self.scanned.state.name}")
        if self.is_silent:
            parts.append("does not answer SDO requests")
        if self.is_doubled:
            parts.append(f"two devices answer as node {self.node}")
        return "; ".join(parts)

    def as_dict(self) -> dict[str, object]:
        """The node, for JSON."""
        after = self.scanned.answered_after
        return {
            "node": self.node,
            "url": self.url,
            "why": self.why,
            "answered_after": None if after is None else round(after, 4),
            "two_devices": self.is_doubled,
            "device": self.device.name if self.device else None,
            "identity": self.identity.as_dict(),
        }


class _Responses:
    """Counts requests and responses of each node, also those of other clients on the bus."""

    def __init__(self) -> None:
        self._surplus: Counter[int] = Counter()

    def __call__(self, direction: Literal["sent", "received"], frame: CanFrame) -> None:
        """Count a frame, as `watch` of a client."""
        if frame.extended or frame.remote:
            return
        if frame.id in _REQUESTS and frame.data[:1] != b"\x80":  # an abort has no response
            self._surplus[frame.id & _NODE] -= 1
        elif frame.id in _RESPONSES and direction == "received":
            self._surplus[frame.id & _NODE] += 1

    def has_surplus(self, node: int) -> bool:
        """Return whether the node-ID gave more responses than it had requests."""
        return self._surplus[node] > 0


def scan_canopen(
    url: str,
    nodes: Collection[int] = range(1, 128),
    *,
    listen: float = 2.0,
    timeout: float = 0.1,
    bitrate: int | None = None,
    descriptions: Iterable[str] = (),
    progress: Callable[[int, ScanResult], None] | None = None,
) -> Iterator[FoundNode]:
    """Yield the nodes on a bus, in the order of their node-IDs, each when it is known what it is.

    nodes          the node-IDs that are asked; others are found if they send by themselves
    listen         seconds to listen before the first request
    timeout        seconds that a node has to respond
    bitrate        that of the interface, in place of the one in the URL
    descriptions   directories of device descriptions beside the catalogue, to name what is found
    progress       called with each node-ID before it is asked, and the result so far

    Raises EncodeError for wrong arguments, PortError if the bus cannot be used.
    """
    devices, responses = known_devices(descriptions), _Responses()
    endpoint = Endpoint.parse(url, {"bitrate": bitrate})
    options = {key: text for key, text in endpoint.options.items() if key != "node"}
    base = str(endpoint._replace(options=options))
    with CanopenClient(base, timeout=max(timeout, 0.5), watch=responses) as client:
        result = client.scan(nodes, listen=listen, timeout=timeout, progress=progress)
        for number, scanned in result.nodes.items():
            found = FoundNode(str(Endpoint.parse(base, {"node": number})), scanned)
            if scanned.device_type is not None:
                found.identity.numbers["device_type"] = scanned.device_type
            found.is_silent = scanned.answered_after is None and number in nodes
            if scanned.answered_after is not None:
                identify(client, number, found.identity)
                found.device = device_of(found.identity, devices)
                found.is_doubled = responses.has_surplus(number)
            yield found


def identify(client: CanopenClient, node: int, identity: DeviceIdentity) -> None:
    """Ask a node what it is: 1018h, 1008h, 1009h, 100Ah. What it refuses, or does not answer, stays empty."""
    upload = client.node(node).sdo.upload
    for key in (*_NUMBERS, *_TEXTS):
        with suppress(Refused, NoAnswer, DecodeError):
            ask(upload, key, identity)


def ask(upload: Callable[..., bytes], key: str, identity: DeviceIdentity) -> None:
    """Ask a node for one thing that it says about itself, and keep that. `upload` is that of its SDO client, whose
    errors it raises."""
    if key in _TEXTS:
        identity.texts[key] = upload(_TEXTS[key], 0, limit=_LONGEST_TEXT).decode("latin-1")
    else:
        index, sub = (_IDENTITY, _NUMBERS[key]) if key in _NUMBERS else (_DEVICE_TYPE, 0)
        identity.numbers[key] = int.from_bytes(upload(index, sub, limit=_LONGEST_TEXT)[:4], "little")
