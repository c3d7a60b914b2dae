"""CANopen: what CAN frames say to each other about objects, states and process data.   [CiA 301]

        605h                    | 40       | 41 60   | 00        | 00 00 00 00 |
        identifier              | command  | index   | sub-index | data        |      an SDO asks for 6041h:00
        = function code + node

CAN delivers whole frames, so there is no envelope and no noise here. Which file for which question:

    frame        one CAN frame, and its line of text          cob          whose identifier is that?
    nmt          who may speak in which state                  nmt_master   command, and have it confirmed
    heartbeat    who is alive                                  guarding     the same, asked for
    sdo/         read and write any object of any length       emcy         what went wrong, in one message
    emcy_producer, emcy_consumer    which errors there are: in this device, in the others
    sync         the beat that PDOs follow                     time_stamp   what time it is
    pdo          which bits of a frame are which object        pdo_records  how a PDO is configured
    pdo_live, pdo_engine            when it travels            pdo_remote   the PDOs of another device
    mpdo         an object in a frame that says which it is
    pdo_listen   the same as named values                      nmt_wait     wait for what a node says of itself
    presence     who was heard, and when                       claims       who may talk now, where many want to
    lss          messages that give a node-ID                  lss_slave, lss_master, lss_scan    who says them
    survey       who is on the bus, and why we believe it
    datatypes, times    which type has how many bytes          dictionary   the objects of one device
    remote_objects      the objects of another, as values
    eds/         the same objects as a file, read and written without loss
    own_objects, error_control, device_sync, device_sdo, stored    its services, as their objects say
    device       all of it together: one node

Two nodes meet as two machines, or as a conversation and a machine; neither knows a bus or a clock.

I know: frames, nodes, objects.  I never know: Modbus, what an object means, ports, time except as a number.
Who may import me: devices, shells, cli, bench, tests.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.canopen.bus.scan import Found, Survey, scan
    from barewire.canopen.cob_ids import CobEntry, Service, check_node, classify, cob_id, is_restricted
    from barewire.canopen.communication_objects import standard_objects
    from barewire.canopen.device.device import LocalNode
    from barewire.canopen.device.sdo_channels import client_channel
    from barewire.canopen.device.storage import StoredParameters
    from barewire.canopen.emcy.consumer import EmcyConsumer, EmcyEvent
    from barewire.canopen.emcy.message import Emergency, error_text, register_names, register_of
    from barewire.canopen.emcy.producer import EmcyProducer
    from barewire.canopen.frame import CanFrame, ErrorFrame, FdFrame
    from barewire.canopen.lss.fastscan import Assigned, fastscan, find_all
    from barewire.canopen.lss.master import (
        activate_bit_timing,
        configure_bit_timing,
        configure_node,
        identify_slaves,
        identify_unconfigured,
        inquire_address,
        inquire_node,
        store_configuration,
        switch_global,
        switch_selective,
    )
    from barewire.canopen.lss.messages import Fastscan, LssAddress, LssMessage, LssRefused, LssService, LssState
    from barewire.canopen.lss.slave import LssSlave
    from barewire.canopen.nmt.heartbeat import (
        HeartbeatConsumer,
        HeartbeatEvent,
        HeartbeatProducer,
        NodeState,
        consumer_entry,
        guarding_request,
    )
    from barewire.canopen.nmt.master import NmtConfirmation, ask_state, tell_nmt
    from barewire.canopen.nmt.messages import NmtChange, NmtCommand, NmtMessage, NmtSlave, NmtState
    from barewire.canopen.nmt.node_guarding import Guard, GuardedNode, GuardEvent, GuardingMaster, LifeEvent
    from barewire.canopen.nmt.wait import wait_for_boot_up, wait_for_heartbeat, wait_for_state
    from barewire.canopen.object_dictionary import Entry, ObjectDictionary
    from barewire.canopen.pdo.config import Pdo, pdos_of
    from barewire.canopen.pdo.engine import PdoEngine
    from barewire.canopen.pdo.mapping import Mapped, PdoMapping
    from barewire.canopen.pdo.multiplexed import Mpdo
    from barewire.canopen.pdo.named_values import PdoListener, PdoReceived, RemotePdo, remote_pdo
    from barewire.canopen.pdo.remote_config import PdoConfigPolicy, mapping_of, read_pdo, write_pdo
    from barewire.canopen.sdo import (
        AZ3,
        STANDARD,
        AbortCode,
        BlockSettings,
        Channel,
        Dialect,
        SdoAbort,
        SdoServer,
        abort_text,
        download,
        fit,
        upload,
        upload_to,
    )
    from barewire.canopen.sdo.client.typed_access import read_object, write_object
    from barewire.canopen.sync import Sync, SyncEvent, SyncMonitor, SyncProducer
    from barewire.canopen.time_stamp import TimeConsumer, TimeHeard, TimeProducer, TimeStamp
    from barewire.canopen.time_types import TimeDifference, TimeOfDay

__all__ = [
    "CanFrame",
    "FdFrame",
    "ErrorFrame",
    "cob_id",
    "classify",
    "check_node",
    "is_restricted",
    "Service",
    "CobEntry",
    "upload",
    "upload_to",
    "download",
    "BlockSettings",
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
    "TimeOfDay",
    "TimeDifference",
    "NmtCommand",
    "NmtState",
    "NmtMessage",
    "NmtChange",
    "NmtSlave",
    "tell_nmt",
    "ask_state",
    "NmtConfirmation",
    "wait_for_boot_up",
    "wait_for_heartbeat",
    "wait_for_state",
    "NodeState",
    "HeartbeatProducer",
    "HeartbeatConsumer",
    "HeartbeatEvent",
    "consumer_entry",
    "guarding_request",
    "Guard",
    "GuardingMaster",
    "GuardEvent",
    "GuardedNode",
    "LifeEvent",
    "Emergency",
    "error_text",
    "register_names",
    "register_of",
    "EmcyProducer",
    "EmcyConsumer",
    "EmcyEvent",
    "Sync",
    "SyncProducer",
    "SyncMonitor",
    "SyncEvent",
    "TimeStamp",
    "TimeProducer",
    "TimeConsumer",
    "TimeHeard",
    "Mapped",
    "PdoMapping",
    "Mpdo",
    "Pdo",
    "pdos_of",
    "PdoEngine",
    "read_pdo",
    "write_pdo",
    "mapping_of",
    "PdoConfigPolicy",
    "remote_pdo",
    "RemotePdo",
    "PdoListener",
    "PdoReceived",
    "read_object",
    "write_object",
    "scan",
    "Survey",
    "Found",
    "LssAddress",
    "LssMessage",
    "LssService",
    "LssState",
    "LssRefused",
    "LssSlave",
    "Fastscan",
    "switch_global",
    "switch_selective",
    "identify_slaves",
    "identify_unconfigured",
    "inquire_address",
    "inquire_node",
    "configure_node",
    "configure_bit_timing",
    "activate_bit_timing",
    "store_configuration",
    "fastscan",
    "find_all",
    "Assigned",
    "LocalNode",
    "StoredParameters",
    "standard_objects",
    "client_channel",
]

# Which file holds what. Only that one is loaded, with what it needs: a bus shell asks for `CanFrame` and gets no node.
_FILES = {
    "cob_ids": "CobEntry Service check_node classify cob_id is_restricted",
    "device.device": "LocalNode",
    "device.sdo_channels": "client_channel",
    "object_dictionary": "Entry ObjectDictionary",
    "emcy.message": "Emergency error_text register_names register_of",
    "emcy.consumer": "EmcyConsumer EmcyEvent",
    "emcy.producer": "EmcyProducer",
    "frame": "CanFrame ErrorFrame FdFrame",
    "nmt.node_guarding": "Guard GuardedNode GuardEvent GuardingMaster LifeEvent",
    "nmt.heartbeat": "HeartbeatConsumer HeartbeatEvent HeartbeatProducer NodeState consumer_entry guarding_request",
    "lss.messages": "Fastscan LssAddress LssMessage LssRefused LssService LssState",
    "lss.master": (
        "activate_bit_timing configure_bit_timing configure_node identify_slaves identify_unconfigured "
        "inquire_address inquire_node store_configuration switch_global switch_selective"
    ),
    "lss.fastscan": "Assigned fastscan find_all",
    "lss.slave": "LssSlave",
    "pdo.multiplexed": "Mpdo",
    "nmt.messages": "NmtChange NmtCommand NmtMessage NmtSlave NmtState",
    "nmt.master": "NmtConfirmation ask_state tell_nmt",
    "nmt.wait": "wait_for_boot_up wait_for_heartbeat wait_for_state",
    "communication_objects": "standard_objects",
    "pdo.mapping": "Mapped PdoMapping",
    "pdo.engine": "PdoEngine",
    "pdo.named_values": "PdoReceived PdoListener RemotePdo remote_pdo",
    "pdo.config": "Pdo pdos_of",
    "pdo.remote_config": "PdoConfigPolicy mapping_of read_pdo write_pdo",
    "sdo.client.typed_access": "read_object write_object",
    "sdo": (
        "AZ3 STANDARD AbortCode BlockSettings Channel Dialect SdoAbort SdoServer abort_text download fit upload "
        "upload_to"
    ),
    "device.storage": "StoredParameters",
    "bus.scan": "Found Survey scan",
    "sync": "Sync SyncEvent SyncMonitor SyncProducer",
    "time_stamp": "TimeConsumer TimeHeard TimeProducer TimeStamp",
    "time_types": "TimeDifference TimeOfDay",
}

__getattr__ = lazy(__name__, _FILES)
