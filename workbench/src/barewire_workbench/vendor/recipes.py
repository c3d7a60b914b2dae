"""What each file is made of: its public names, the families of messages, and what small files do without.

    modbus-rtu-client   =   ModbusRtuClient, the registers, and all that they need; the coils with an option
                            without: methods that are only quicker, or only for `explain`, and what only a listener has

What is taken from `live/one_file` is the same as in the stack and shorter, because a file has no URLs, no lazy loading
and one kind of port. A patch removes a branch that the file never takes; it names the text, which must be there once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from barewire_workbench.vendor.patches import (
    CLIENT_OR_SERVER,
    NO_BLOCKS,
    NO_EXPLANATION,
    NO_FOLDING,
    NO_LISTENER,
    NO_MONITOR,
    NO_SHORTCUTS,
    NUMBERED,
    ONE_ENGINE,
    ONE_KIND_OF_UNIT,
    ONLY_RESPONSES,
    PLAIN_EXAMPLES,
    TABLE_WITHOUT,
    TWO_ROLES,
    Patch,
)
from barewire_workbench.vendor.sources import Place

PARTS = "barewire_workbench.live.one_file"
MESSAGES = "barewire.modbus.messages"

FAMILIES = {
    "registers": "ReadHoldingRegisters ReadInputRegisters WriteSingleRegister WriteMultipleRegisters",
    "coils": "ReadCoils ReadDiscreteInputs WriteSingleCoil WriteMultipleCoils",
    "combined": "MaskWriteRegister ReadWriteMultipleRegisters",
    "fifo": "ReadFifoQueue",
    "files": "ReadFileRecord WriteFileRecord",
    "diagnostics": "ReadExceptionStatus Diagnostics",
    "comm_events": "GetCommEventCounter GetCommEventLog",
    "identification": "ReportServerId ReadDeviceIdentification",
}
"""The families of messages, as `barewire.modbus.messages` has them, and the requests of each."""
NEVER_INSIDE = (f"{MESSAGES}.canopen_reference", f"{MESSAGES}.raw", "barewire.modbus.messages")

Patches = Mapping[str, tuple[Patch, ...]]


class Recipe(NamedTuple):
    """How a file is made.

    subject     what it is, for its first line
    file        what it is called in examples
    usage       a program that uses it
    families    the messages that it has without further options
    optional    the families that `--with` adds
    roots       its public names, by module; the requests of the families are public too
    in_place    names that are replaced by those of a module of `live/one_file`
    without     methods that are left out, as "Class.method" or "*.method"
    patches     by module: texts that are replaced
    absent      the same for a family that the file does not have
    kinds       the kinds of vectors that it answers
    """

    subject: str
    file: str
    usage: str
    families: tuple[str, ...]
    optional: tuple[str, ...]
    roots: tuple[Place, ...]
    in_place: Mapping[Place, Place]
    without: frozenset[Place]
    patches: Patches
    kinds: tuple[str, ...]
    absent: Mapping[str, Patches] = {}


def _replaced(module: str, part: str, *names: str) -> dict[Place, Place]:
    return {Place(module, name): Place(f"{PARTS}.{part}", name) for name in names}


_REGISTRY = _replaced(
    f"{MESSAGES}.registry",
    "registry",
    *("AnyRequest", "request_class", "response_class"),
    *("measure_request", "measure_response", "decode_request", "decode_response"),
)
_PROBE = _replaced(f"{MESSAGES}.diagnostics", "probe", "RETURN_QUERY_DATA", "Diagnostics")
_RESPONSES = _replaced("barewire.rtu.shape", "rtu_shape", "Shape")

_EXPLAINING = frozenset(
    Place(f"{MESSAGES}.{module}", "*.fields") for module in ("base", "exception_response", *FAMILIES)
)
"""The fields of a message with names and meanings, for `explain`; the offsets in errors do not need them."""
_QUICKER = frozenset(
    Place(f"{MESSAGES}.registers", f"ReadHoldingRegisters.{method}") for method in ("decode", "read_response")
)
"""Shortcuts of the most frequent request. Without them its base class does the same."""

_LINE, _CRC = "barewire.rtu.line", "barewire.rtu.crc"
_SETTING = frozenset(
    {
        Place(f"{MESSAGES}.base", "Message.__init_subclass__"),
        *(Place(module, "*.__repr__") for module in ("barewire.codecs.layout", _LINE, "barewire.modbus.client.bus")),
    }
)
"""A better text of the error for setting a field of a message, which is frozen; and short texts of objects."""

TEXTS = {
    "barewire.rtu.crc": """CRC-16 of Modbus RTU: polynomial x^16 + x^15 + x^2 + 1, reflected, from FFFFh.

    02 07  ->  1241h, sent as  41 12, low byte first                                [MB-SERIAL 6.2.2]

One step for each byte, with a table of 256 remainders. (barewire folds long frames, which is up to eight times faster.)
""",
    "barewire.codecs.bits": "Rows of bits: coil 0 of a packed row is bit 0 of byte 0.                    [MB-APP 6.1]",
    "barewire.codecs.order": "Registers: 16 bits each, the more significant byte first.                  [MB-APP 4.2]",
    "barewire.modbus.framing": "What a line, the framing state of one connection, makes of received bytes.",
    "barewire.modbus.server.table": "A unit kept in memory: coils, discrete inputs, holding and input registers.",
    "barewire.canopen.sdo.client": "The segments of a transfer, each with its confirmation; the toggle bit alternates.",
    "barewire.io.ports.base": "What the engine needs of a port: any object with these three methods.",
    "barewire.io.ports.network": "Sizes and texts that all ports share.",
}
"""The docstrings of modules of which a file has one or two things only, in place of their own."""

_MESSAGES = _EXPLAINING | _QUICKER | _SETTING
_ALWAYS: Patches = {
    f"{MESSAGES}.base": NO_EXPLANATION,
    f"{MESSAGES}.registers": NO_SHORTCUTS,
    "barewire.conversation": ONE_ENGINE,
}
_OF_CLIENTS = ("combined", "fifo", "files", "diagnostics", "comm_events", "identification")


def _client(
    framing: str, usage: str, in_place: Mapping[Place, Place], line: Place, patches: Patches, *kinds: str
) -> Recipe:
    return Recipe(
        f"A Modbus {framing.upper()} client",
        f"modbus_{framing}.py",
        usage,
        ("registers",),
        ("coils", *_OF_CLIENTS),
        (Place(f"{PARTS}.{framing}_client", f"Modbus{framing.title()}Client"),),
        {**_REGISTRY, **_PROBE, **in_place, Place("barewire.modbus.framing", "Line"): line},
        _MESSAGES | {Place(line.module, f"{line.name}.response")},
        {**_ALWAYS, **patches},
        (*kinds, f"{framing}-frame", f"{framing}-talk", "pdu", "exchange", "client"),
    )


def _server(
    framing: str, usage: str, in_place: Mapping[Place, Place], line: Place, patches: Patches, *kinds: str
) -> Recipe:
    room = "barewire.modbus.server"
    counters = _replaced(f"{room}.serial_counters", "serial_counters", "ANSWERED", "SerialCounters")
    roots = (Place(f"{PARTS}.{framing}_server", f"Modbus{framing.title()}Server"), Place(f"{room}.table", "Table"))
    return Recipe(
        f"A Modbus {framing.upper()} server",
        f"modbus_{framing}_server.py",
        usage,
        ("registers", "coils"),
        ("combined", "fifo", "files", "identification"),
        roots,
        {**_REGISTRY, **counters, **in_place, Place("barewire.modbus.framing", "Line"): line},
        _MESSAGES,
        {f"{room}.server": ONE_KIND_OF_UNIT, f"{room}.table": PLAIN_EXAMPLES, **_ALWAYS, **patches},
        (*kinds, f"{framing}-frame", f"{framing}-talk", "pdu", "server"),
        {family: {f"{room}.table": texts} for family, texts in TABLE_WITHOUT.items()},
    )


_READ = "client.read_holding_registers(107, 3)          # (555, 0, 100)"
_SERVE = "table = Table(holding_registers={{107: [555, 0, 100]}})\n{}.serve()"
RECIPES = {
    "modbus-rtu-client": _client(
        "rtu",
        f'with ModbusRtuClient("/dev/ttyUSB0", baudrate=19200, unit=1) as client:\n    {_READ}',
        _RESPONSES,
        Place(_LINE, "RtuLine"),
        {_LINE: NO_LISTENER + ONLY_RESPONSES, _CRC: NO_FOLDING},
        *("crc16", "rtu-timing"),
    ),
    "modbus-tcp-client": _client(
        "tcp",
        f'with ModbusTcpClient("192.0.2.7", unit=1) as client:\n    {_READ}',
        {},
        Place("barewire.tcp.line", "TcpLine"),
        {"barewire.modbus.client.bus": NUMBERED},
    ),
    "modbus-ascii-client": _client(
        "ascii",
        f'with ModbusAsciiClient("/dev/ttyUSB0", baudrate=9600, bytesize=7, unit=1) as client:\n    {_READ}',
        {},
        Place("barewire.ascii.line", "AsciiLine"),
        {},
        "lrc",
    ),
    "modbus-rtu-server": _server(
        "rtu",
        _SERVE.format('ModbusRtuServer("/dev/ttyUSB0", {1: table}, baudrate=19200)'),
        {},
        Place(_LINE, "RtuLine"),
        {_LINE: NO_LISTENER + CLIENT_OR_SERVER, "barewire.rtu.shape": TWO_ROLES, _CRC: NO_FOLDING},
        *("crc16", "rtu-timing"),
    ),
    "modbus-tcp-server": _server(
        "tcp",
        _SERVE.format('ModbusTcpServer("0.0.0.0", 502, {255: table})'),
        {},
        Place("barewire.tcp.line", "TcpLine"),
        {},
    ),
    "sdo-client": Recipe(
        "A CANopen SDO client",
        "sdo_client.py",
        'with SdoClient("can0", 5) as client:\n    client.read_number(0x6041, "u16")          # 1591',
        (),
        (),
        (Place(f"{PARTS}.sdo_client", "SdoClient"),),
        {},
        frozenset(),
        {
            "barewire.canopen.sdo.messages": NO_BLOCKS,
            "barewire.canopen.sdo.channel": NO_MONITOR,
            "barewire.conversation": ONE_ENGINE,
        },
        ("sdo", "sdo-talk"),
    ),
}
