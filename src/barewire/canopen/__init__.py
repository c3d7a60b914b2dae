"""CANopen: what CAN frames say to each other about objects, states and process data.   [CiA 301]

        605h                    | 40       | 41 60   | 00        | 00 00 00 00 |
        identifier              | command  | index   | sub-index | data        |      an SDO asks for 6041h:00
        = function code + node

CAN delivers whole frames, so there is no envelope and no noise here. Which file for which question:

    frame        one CAN frame, and its line of text          cob         whose identifier is that?
    nmt          who may speak in which state                  heartbeat   who is alive
    sdo/         read and write any object, confirmed          emcy        what went wrong
    pdo          which bits of a frame are which object        sync        the beat that PDOs follow
    pdo_records  how a PDO is configured                       pdo_engine  when it travels
    datatypes    which type has how many bytes                 dictionary  the objects of one device
    device       all of it together: one node

Two nodes meet as two machines, or as a conversation and a machine; neither knows a bus or a clock.

I know: frames, nodes, objects.  I never know: Modbus, what an object means, ports, time except as a number.
Who may import me: devices, shells, cli, bench, tests.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from barewire.canopen.cob import CobEntry, Service, check_node, classify, cob_id, is_restricted
    from barewire.canopen.device import Device
    from barewire.canopen.dictionary import Entry, ObjectDictionary
    from barewire.canopen.emcy import Emergency, error_text, register_names
    from barewire.canopen.frame import CanFrame
    from barewire.canopen.heartbeat import (
        HeartbeatConsumer,
        HeartbeatEvent,
        HeartbeatProducer,
        NodeState,
        consumer_entry,
        guarding_request,
    )
    from barewire.canopen.nmt import NmtChange, NmtCommand, NmtMessage, NmtSlave, NmtState
    from barewire.canopen.pdo import Mapped, PdoMapping
    from barewire.canopen.pdo_engine import PdoEngine
    from barewire.canopen.pdo_records import Pdo
    from barewire.canopen.sdo import (
        AZ3,
        STANDARD,
        AbortCode,
        Channel,
        Dialect,
        SdoAbort,
        SdoServer,
        abort_text,
        download,
        fit,
        upload,
    )
    from barewire.canopen.sync import Sync

__all__ = [
    "CanFrame",
    "cob_id",
    "classify",
    "check_node",
    "is_restricted",
    "Service",
    "CobEntry",
    "upload",
    "download",
    "Channel",
    "Dialect",
    "STANDARD",
    "AZ3",
    "fit",
    "SdoAbort",
    "AbortCode",
    "abort_text",
    "SdoServer",
    "Entry",
    "ObjectDictionary",
    "NmtCommand",
    "NmtState",
    "NmtMessage",
    "NmtChange",
    "NmtSlave",
    "NodeState",
    "HeartbeatProducer",
    "HeartbeatConsumer",
    "HeartbeatEvent",
    "consumer_entry",
    "guarding_request",
    "Emergency",
    "error_text",
    "register_names",
    "Sync",
    "Mapped",
    "PdoMapping",
    "Pdo",
    "PdoEngine",
    "Device",
]

# Loaded when asked for, the light ones first: a bus shell needs `frame` only and must not pay for a whole node.
_FILES = (
    "frame",
    "cob",
    "nmt",
    "heartbeat",
    "sync",
    "emcy",
    "sdo",
    "pdo",
    "dictionary",
    "pdo_records",
    "pdo_engine",
    "device",
)


def __getattr__(name: str) -> Any:
    if name in __all__:
        for file in _FILES:
            module = import_module(f"{__name__}.{file}")
            if name in vars(module):
                return vars(module)[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
