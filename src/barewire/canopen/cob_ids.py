"""COB-IDs: the CAN identifier of each service of each node.   [CiA 301, predefined connection set]

        10  9  8  7 | 6  5  4  3  2  1  0
       function code|      node-ID              605h = 1100 | 0000101  = SDO request to node 5

On CAN the lowest identifier wins the arbitration, so the table below is also the order of priority.

Some manuals (such as that of the AZ3) print the COB-IDs of PDOs *without* the node-ID (200h, 180h ...), which is added
on the bus.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from barewire.canopen.frame import CanFrame
from barewire.errors import EncodeError, shown

NODE_MIN, NODE_MAX = 1, 127

ServiceName = Literal["NMT", "SYNC", "EMCY", "TIME", "TPDO1", "RPDO1", "TPDO2", "RPDO2", "TPDO3", "RPDO3", "TPDO4",
                      "RPDO4", "SDO answer", "SDO request", "error control", "LSS answer", "LSS request"]  # fmt: skip


class CobService(NamedTuple):
    """One row of the predefined connection set. A broadcast has one identifier for all nodes."""

    name: ServiceName
    base: int
    from_device: bool  # True: the device sends it
    broadcast: bool = False

    @property
    def function_code(self) -> int:
        """Bits 10 to 7 of the identifier."""
        return self.base >> 7


SERVICES: tuple[CobService, ...] = (
    CobService("NMT", 0x000, from_device=False, broadcast=True),
    CobService("SYNC", 0x080, from_device=False, broadcast=True),
    CobService("EMCY", 0x080, from_device=True),
    CobService("TIME", 0x100, from_device=False, broadcast=True),
    CobService("TPDO1", 0x180, from_device=True),
    CobService("RPDO1", 0x200, from_device=False),
    CobService("TPDO2", 0x280, from_device=True),
    CobService("RPDO2", 0x300, from_device=False),
    CobService("TPDO3", 0x380, from_device=True),
    CobService("RPDO3", 0x400, from_device=False),
    CobService("TPDO4", 0x480, from_device=True),
    CobService("RPDO4", 0x500, from_device=False),
    CobService("SDO answer", 0x580, from_device=True),
    CobService("SDO request", 0x600, from_device=False),
    CobService("error control", 0x700, from_device=True),
    CobService("LSS answer", 0x7E4, from_device=True, broadcast=True),
    CobService("LSS request", 0x7E5, from_device=False, broadcast=True),
)

PDO_SERVICES: dict[str, ServiceName] = {service.name: service.name for service in SERVICES if "PDO" in service.name}
"""The PDOs of the predefined connection set: a text -> the same text as a `ServiceName`."""
_BY_NAME = {service.name: service for service in SERVICES}
_BROADCASTS = {service.base: service for service in SERVICES if service.broadcast}
_BY_FUNCTION_CODE = {service.function_code: service for service in SERVICES if not service.broadcast}

# May not be used for a PDO, SYNC, EMCY or a further SDO channel.            [CiA 301, restricted CAN-IDs]
_RESTRICTED = ((0x000, 0x07F), (0x101, 0x180), (0x581, 0x5FF), (0x601, 0x67F), (0x6E0, 0x6FF), (0x701, 0x7FF))


def check_node(node: int) -> int:
    """Return the node-ID. Raise EncodeError for any other object, and outside 1..127: 0 is all nodes, in NMT only."""
    if isinstance(node, bool) or not isinstance(node, int) or not NODE_MIN <= node <= NODE_MAX:
        raise EncodeError(f"node {shown(node)}: expected {NODE_MIN}..{NODE_MAX}", "node")
    return node


def check_node_ids(name: str, nodes: object) -> None:
    """Raise EncodeError if the argument `name`, which takes several node-IDs, is something else, such as one."""
    if not isinstance(nodes, Iterable) or isinstance(nodes, (str, bytes)):
        example = f", such as [{nodes}]" if isinstance(nodes, int) else ""
        raise EncodeError(f"{name} = {shown(nodes)}: expected several node-IDs{example}", name)


def cob_id(service: ServiceName, node: int | None = None) -> int:
    """Return the identifier of a service of a node; a broadcast has no node. Raise EncodeError.

    >>> f"{cob_id('SDO request', 5):X}h", f"{cob_id('TPDO1', 15):X}h", f"{cob_id('SYNC'):X}h"
    ('605h', '18Fh', '80h')
    """
    row = _BY_NAME.get(service)
    if row is None:
        raise EncodeError(f"service {service!r}: expected one of {', '.join(_BY_NAME)}")
    if row.broadcast:
        if node:
            raise EncodeError(f"{service} has no node: got node {shown(node)}", "node")
        return row.base
    if node is None:
        raise EncodeError(f"{service} has one identifier for each node: expected a node")
    return row.base + check_node(node)


def classify(frame: CanFrame) -> tuple[CobService, int] | None:
    """Return the service and the node of a frame by the predefined connection set; node 0 for a broadcast.

    Return None for an identifier outside that set: an extended one, or one in a gap between the services.

    >>> service, node = classify(CanFrame(0x585)) or (None, 0)
    >>> service.name, node
    ('SDO answer', 5)
    """
    if frame.extended:
        return None
    broadcast = _BROADCASTS.get(frame.id)
    if broadcast is not None:
        return broadcast, 0
    service = _BY_FUNCTION_CODE.get(frame.id >> 7)
    node = frame.id & 0x7F
    return (service, node) if service is not None and node else None


SYNC_KEY = (cob_id("SYNC"), False)
TIME_KEY = (cob_id("TIME"), False)
"""Default (identifier, extended) of SYNC and TIME; a network may configure other COB-IDs."""


def is_restricted(identifier: int) -> bool:
    """Return whether this base identifier may never be configured for a PDO, SYNC, EMCY or SDO channel."""
    return any(first <= identifier <= last for first, last in _RESTRICTED)


class CobEntry(NamedTuple):
    """A COB-ID as the object dictionary stores it in 32 bits: two flags, the frame format, the identifier.

        31 | 30 | 29 | 28 ... 0
        a    b    x    identifier            x = 1: 29 bits

    The meaning of the flags depends on the object. Bit 31: *not in use* for a PDO, an SDO channel and EMCY, but
    *consumes* for TIME. Bit 30: no remote requests (PDO), produces (SYNC, TIME), dynamically assigned (SDO channel).

    >>> CobEntry.unpack(0xC000_0185)
    CobEntry(identifier=389, extended=False, bit30=True, bit31=True)
    """

    identifier: int
    extended: bool = False
    bit30: bool = False
    bit31: bool = False

    @classmethod
    def unpack(cls, word: int) -> CobEntry:
        """Decode the 32 bits of the object. Without bit 29 the identifier is the low 11 bits."""
        extended = bool(word >> 29 & 1)
        identifier = word & (0x1FFF_FFFF if extended else 0x7FF)
        return cls(identifier, extended, bool(word >> 30 & 1), bool(word >> 31 & 1))

    @property
    def is_restricted(self) -> bool:
        """Whether the identifier has 11 bits and may never be configured."""
        return not self.extended and is_restricted(self.identifier)

    @property
    def carries_sdo(self) -> bool:
        """Whether an SDO channel with this COB-ID is in use: bit 31 is 0, and the identifier is not restricted, or in
        581h to 6FFh, where devices have further servers and clients although CiA 301 restricts it."""
        return not self.bit31 and (not self.is_restricted or 0x580 < self.identifier < 0x700)

    @staticmethod
    def is_well_formed(word: int) -> bool:
        """Return whether bits 11 to 28 are 0 in a COB-ID of 11 bits, as CiA 301 requires."""
        return bool(word >> 29 & 1) or not word & 0x1FFF_F800

    def pack(self) -> int:
        """Return the 32 bits of the object. Raise EncodeError if the identifier does not fit 11 bits, or 29."""
        bits = 29 if self.extended else 11
        if self.identifier >> bits:
            raise EncodeError(f"identifier {self.identifier:X}h: expected {bits} bits", "identifier")
        return self.identifier | self.extended << 29 | self.bit30 << 30 | self.bit31 << 31


def default_sdo_channel(node: int) -> tuple[CobEntry, CobEntry]:
    """Return the COB-IDs of the default SDO channel of a node: client to server, server to client."""
    return CobEntry(cob_id("SDO request", node)), CobEntry(cob_id("SDO answer", node))
