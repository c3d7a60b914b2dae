"""What is wrong with a CAN frame: each fault is tried, and the frame that was meant, or two numbers, are the proof.

        605#4341600000000000        43h is how a server answers; a read request is 40h
        605#2B40600007              2Bh announces 2 bytes of data, the frame ends after 1
        085#1042080000000000        error 4210h, and a register whose bit 0 says that there is no error
        600#4000100000000000        an SDO request to node 0: the node-ID was not added

Some faults are seen only with a description of the node: the size of an object, the bytes of a PDO. A device may
deviate from the standard on purpose (`KnownNode.commands`), which is no fault then.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from dataclasses import replace

from barewire.canopen.cob_ids import SERVICES, classify, is_restricted
from barewire.canopen.datatypes import object_codec
from barewire.canopen.emcy import Emergency, register_names
from barewire.canopen.frame import AnyFrame, CanFrame
from barewire.canopen.nmt.messages import STATE_AFTER, NmtCommand
from barewire.canopen.sdo.messages import ExpeditedDownload, ExpeditedUpload, InitiateUpload
from barewire.errors import DecodeError
from barewire_workbench.diagnosis.good import good_rtu, good_tcp, proof_of
from barewire_workbench.frames.can import PdoDescriptions, explain_can
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.result import Explanation, FrameRole, counted

_SIZE = 8
"""Bytes of an SDO frame."""
_OBJECTS = 0x1000, 0xBFFF
"""The first and the last index of an object with a value."""
_GENERIC, _RESERVED = 0x01, 0x40
"""Bits of the error register."""
_NO_DIALECTS: Mapping[int, Container[int]] = {}
_GFC = 0x001
"""The identifier of the global fail-safe command, the only one of the restricted ones with a use [CiA 304]."""


def diagnose_can(
    frame: AnyFrame, pdos: PdoDescriptions | None = None, dialects: Mapping[int, Container[int]] = _NO_DIALECTS
) -> list[Finding]:
    """Return what is wrong with one frame, the likeliest first; nothing for a good one, and where nothing is proved.

    >>> for finding in diagnose_can(CanFrame.parse("605#4341600000000000")):
    ...     print(finding.code, "|", finding.text, "|", finding.proof)
    sdo-read-command | 43h is how a server answers; a read request is 40h | 605#4041600000000000 is SDO request to \
node 5: initiate upload, 6041h:00

    `pdos` describes nodes, for names and sizes; `dialects` has the command bytes of each node that are its own.
    """
    if not isinstance(frame, CanFrame) or frame.remote or frame.extended:
        return []
    pdo = None if pdos is None else pdos.owner(frame)
    if pdo is not None and pdo.mapping is not None:
        return list(_short_pdo(frame, pdo.node, pdo.name, pdo.mapping.size))
    found = classify(frame)
    if found is None:
        return list(_foreign(frame))
    service, node = found
    match service.name:
        case "SDO request" | "SDO answer":
            return list(_sdo(frame, node, service.name == "SDO request", pdos, dialects.get(node, ())))
        case "EMCY":
            return [] if (finding := emergency_finding(frame)) is None else [finding]
        case "NMT":
            return list(_nmt(frame))
        case "error control":
            return list(_state(frame, node))
    return []


def explain_diagnosed_can(
    frame: AnyFrame, pdos: PdoDescriptions | None = None, dialects: Mapping[int, Container[int]] = _NO_DIALECTS
) -> Explanation:
    """Explain one CAN frame, with its diagnosis; the arguments are those of `diagnose_can`.

    >>> explain_diagnosed_can(CanFrame.parse("705#01")).lines()[-1]
    'diagnosis: 01h is an NMT command, not a state: the state is 05h [state]: 705#05 is error control from node 5: \
operational'
    """
    return replace(explain_can(frame, pdos), diagnosis=tuple(diagnose_can(frame, pdos, dialects)))


def modbus_on_can(data: bytes, role: FrameRole | None = None) -> Finding | None:
    """Return the finding that these bytes, read as identifier and data, are a good Modbus frame; None if they are not.

    >>> modbus_on_can(bytes.fromhex("01 03 00 00 00 0A C5 CD")).text
    'the bytes are a good RTU frame: to explain them so, give rtu in place of can'
    """
    for good in (good_rtu(data, role), good_tcp(data, role)):
        if good is not None:
            name = "RTU" if good.protocol == "rtu" else "Modbus TCP"
            text = f"the bytes are a good {name} frame: to explain them so, give {good.protocol} in place of can"
            return Finding("modbus-on-can", text, proof_of(data, good))
    return None


def _shown(frame: CanFrame) -> str:
    """Return the proof that a frame is good: its bytes, and what they say."""
    return f"{frame} is {explain_can(frame).summary}"


# SDO ------------------------------------------------------------------------------------------------------------------


def _sdo(
    frame: CanFrame, node: int, request: bool, pdos: PdoDescriptions | None, dialect: Container[int]
) -> Iterator[Finding]:
    data = frame.data
    if not data:
        return
    if request and InitiateUpload.pattern.matches(data[0]) and data[0] != 0x40 and data[0] not in dialect:
        yield from _read_command(frame, node, pdos)
        return
    if len(data) < _SIZE:
        yield from _cut(frame, request)
    elif pdos is not None:
        yield from _index_order(frame, node, pdos)
        if request:
            yield from _object_size(frame, node, pdos)


def _read_command(frame: CanFrame, node: int, pdos: PdoDescriptions | None) -> Iterator[Finding]:
    """40h to 5Fh asks for an object, but bits 4 to 0 are reserved: in an answer they say how many bytes follow.

    A segment of a block transfer can look the same, so the object must be one that a device can have.
    """
    command, rest = frame.data[0], frame.data[1:].ljust(_SIZE - 1, b"\0")
    index, sub = int.from_bytes(rest[:2], "little"), rest[2]
    if any(rest[3:]):
        answer = frame._replace(id=0x580 + node, data=bytes((command, *rest)))
        if pdos is not None and pdos.object(node, index, sub) is not None and explain_can(answer).valid:
            yield Finding("role", "an SDO answer, sent with the COB-ID of the requests", _shown(answer))
    elif _OBJECTS[0] <= index <= _OBJECTS[1]:
        text = f"{command:02X}h is how a server answers; a read request is 40h"
        yield Finding("sdo-read-command", text, _shown(frame._replace(data=bytes((0x40, *rest)))))


def _cut(frame: CanFrame, request: bool) -> Iterator[Finding]:
    """An SDO frame that ends early: it lacks data that it announces, or only the bytes behind them."""
    data, size = frame.data, None
    pattern = ExpeditedDownload.pattern if request else ExpeditedUpload.pattern
    if pattern.matches(data[0]):
        bits = pattern.decode(data[0])
        size = 4 - bits["n"] if bits.get("s") else None
    if size is not None and len(data) >= 4 and len(data) - 4 < size:
        text = f"the command {data[0]:02X}h announces {counted(size)} of data, the frame has {len(data) - 4}"
        yield Finding("sdo-size", text, f"{frame}: {len(data)} bytes, 4 before the data")
        return
    whole = frame._replace(data=data.ljust(_SIZE, b"\0"))
    if len(data) >= 4 and explain_can(whole).valid:
        text = f"an SDO frame has 8 bytes, the unused ones too; got {len(data)}"
        yield Finding("cut-frame", text, _shown(whole))


def _object_size(frame: CanFrame, node: int, pdos: PdoDescriptions) -> Iterator[Finding]:
    """A value that is written with another size than its object has. Some devices answer all reads with 4 bytes."""
    try:
        message = ExpeditedDownload.decode(frame.data)
    except DecodeError:
        return
    known = pdos.object(node, message.index, message.sub)
    if known is None or known.type == "text" or not message.indicated:
        return
    size, announced = object_codec(known.type).size, len(message.data)
    if size is not None and size != announced:
        place = f"{message.index:04X}h:{message.sub:02X} {known.name}"
        text = f"the command {frame.data[0]:02X}h announces {counted(announced)}, {place} has {size}"
        yield Finding("sdo-size", text, f"{place} of node {node} is {known.type}")


def _index_order(frame: CanFrame, node: int, pdos: PdoDescriptions) -> Iterator[Finding]:
    """The index high byte first: the node does not have that object, and it has the one of the other order."""
    command, data = frame.data[0], frame.data
    if command >> 5 not in (1, 2) or command == 0x80:
        return
    place, sub = int.from_bytes(data[1:3], "little"), data[3]
    meant = int.from_bytes(data[1:3], "big")
    known = pdos.object(node, meant, sub)
    if pdos.object(node, place, sub) is None and known is not None and explain_can(frame).valid:
        whole = frame._replace(data=bytes((data[0], data[2], data[1], *data[3:])))
        text = f"the index was sent high byte first: {place:04X}h, which the device does not have"
        yield Finding("address-byte-order", text, f"{whole} is {meant:04X}h:{sub:02X} {known.name}")


# Other services -------------------------------------------------------------------------------------------------------


def _short_pdo(frame: CanFrame, node: int, name: str, size: int) -> Iterator[Finding]:
    if len(frame.data) < size:
        text = f"{name} of node {node} has {counted(len(frame.data))}, {size} are mapped"
        yield Finding("short-pdo", text, f"{frame}, {counted(size - len(frame.data))} missing")


def emergency_finding(frame: CanFrame) -> Finding | None:
    """Return the finding of an emergency whose register contradicts its error code, None for any other frame.

    >>> emergency_finding(CanFrame.parse("085#1042080000000000")).text
    'error 4210h is reported, and bit 0 (generic) of the error register is 0'
    """
    try:
        message = Emergency.decode(frame)
    except DecodeError:
        return None
    register = f"the register {message.register:02X}h"
    set_bits = ", ".join(register_names(message.register)) or "no error"
    if message.code >> 8 and not message.register & _GENERIC:
        text = f"error {message.code:04X}h is reported, and bit 0 (generic) of the error register is 0"
        return Finding("emcy-register", text, f"{frame}: {register} says {set_bits}; any error sets bit 0")
    if message.register & _RESERVED:
        return Finding("emcy-register", "bit 6 of the error register is reserved, and 1", f"{frame}: {register}")
    return None


def _nmt(frame: CanFrame) -> Iterator[Finding]:
    """A state in place of a command (05 is operational, 01 starts a node), or command and node exchanged."""
    if len(frame.data) != 2 or frame.data[0] in STATE_AFTER:
        return
    first, second = frame.data
    if second in STATE_AFTER and first <= 127:
        whole = frame._replace(data=bytes((second, first)))
        yield Finding("role", "command and node-ID are exchanged: the command goes first", _shown(whole))
    for command in NmtCommand:
        if second <= 127 and STATE_AFTER[command] == first:
            text = f"{first:02X}h is a state, not a command: {command.value:02X}h commands a node to it"
            yield Finding("state", text, _shown(frame._replace(data=bytes((command.value, second)))))


def _state(frame: CanFrame, node: int) -> Iterator[Finding]:
    """A command in place of a state."""
    if len(frame.data) == 1 and frame.data[0] in (NmtCommand.START, NmtCommand.STOP):
        state = STATE_AFTER[NmtCommand(frame.data[0])]
        if state is not None:
            text = f"{frame.data[0]:02X}h is an NMT command, not a state: the state is {int(state):02X}h"
            yield Finding("state", text, _shown(frame._replace(data=bytes((int(state),)))))


def _foreign(frame: CanFrame) -> Iterator[Finding]:
    """An identifier of SDO or error control without a node-ID, or one that CiA 301 keeps free."""
    for service in SERVICES:
        if service.base == frame.id and not service.broadcast and service.name in ("SDO request", "SDO answer"):
            meant = frame._replace(id=frame.id + 1)
            if len(frame.data) == _SIZE and explain_can(meant).valid:
                text = f"{frame.id:03X}h is {service.name} without a node-ID, which is added to it"
                yield Finding("foreign-cob-id", text, f"for node 1: {_shown(meant)}")
            return
    if is_restricted(frame.id) and frame.id != _GFC:
        text = f"{frame.id:03X}h is a restricted identifier: no service uses it"
        yield Finding("foreign-cob-id", text, f"{frame}; CiA 301 lists it among the restricted CAN-IDs")
