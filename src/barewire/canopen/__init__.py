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
    from barewire.canopen.bus.scan import ScannedNode as ScannedNode, ScanResult as ScanResult, scan as scan
    from barewire.canopen.cob_ids import (
        CobEntry as CobEntry,
        Service as Service,
        check_node as check_node,
        classify as classify,
        cob_id as cob_id,
        is_restricted as is_restricted,
    )
    from barewire.canopen.communication_objects import standard_objects as standard_objects
    from barewire.canopen.device.device import LocalNode as LocalNode
    from barewire.canopen.device.sdo_channels import client_channel as client_channel
    from barewire.canopen.device.storage import StoredParameters as StoredParameters
    from barewire.canopen.emcy.consumer import EmcyConsumer as EmcyConsumer, EmcyEvent as EmcyEvent
    from barewire.canopen.emcy.message import (
        Emergency as Emergency,
        error_text as error_text,
        register_names as register_names,
        register_of as register_of,
    )
    from barewire.canopen.emcy.producer import EmcyProducer as EmcyProducer
    from barewire.canopen.frame import CanFrame as CanFrame, ErrorFrame as ErrorFrame, FdFrame as FdFrame
    from barewire.canopen.lss.fastscan import (
        AssignedNode as AssignedNode,
        assign_node_ids as assign_node_ids,
        fastscan as fastscan,
    )
    from barewire.canopen.lss.master import (
        activate_bit_timing as activate_bit_timing,
        configure_bit_timing as configure_bit_timing,
        configure_node as configure_node,
        identify_slaves as identify_slaves,
        identify_unconfigured as identify_unconfigured,
        inquire_address as inquire_address,
        inquire_node as inquire_node,
        store_configuration as store_configuration,
        switch_global as switch_global,
        switch_selective as switch_selective,
    )
    from barewire.canopen.lss.messages import (
        Fastscan as Fastscan,
        LssAddress as LssAddress,
        LssMessage as LssMessage,
        LssRefused as LssRefused,
        LssService as LssService,
        LssState as LssState,
    )
    from barewire.canopen.lss.slave import LssSlave as LssSlave
    from barewire.canopen.nmt.heartbeat import (
        HeartbeatConsumer as HeartbeatConsumer,
        HeartbeatEvent as HeartbeatEvent,
        HeartbeatProducer as HeartbeatProducer,
        NodeState as NodeState,
        consumer_entry as consumer_entry,
        guarding_request as guarding_request,
    )
    from barewire.canopen.nmt.master import (
        NmtConfirmation as NmtConfirmation,
        request_state as request_state,
        send_nmt as send_nmt,
    )
    from barewire.canopen.nmt.messages import (
        NmtChange as NmtChange,
        NmtCommand as NmtCommand,
        NmtMessage as NmtMessage,
        NmtSlave as NmtSlave,
        NmtState as NmtState,
    )
    from barewire.canopen.nmt.node_guarding import (
        Guard as Guard,
        GuardedNode as GuardedNode,
        GuardEvent as GuardEvent,
        GuardingMaster as GuardingMaster,
        LifeEvent as LifeEvent,
    )
    from barewire.canopen.nmt.wait import (
        wait_for_boot_up as wait_for_boot_up,
        wait_for_heartbeat as wait_for_heartbeat,
        wait_for_state as wait_for_state,
    )
    from barewire.canopen.object_dictionary import Entry as Entry, ObjectDictionary as ObjectDictionary
    from barewire.canopen.pdo.config import PdoConfig as PdoConfig, pdos_of as pdos_of
    from barewire.canopen.pdo.engine import PdoEngine as PdoEngine
    from barewire.canopen.pdo.mapping import MappedObject as MappedObject, PdoMapping as PdoMapping
    from barewire.canopen.pdo.multiplexed import Mpdo as Mpdo
    from barewire.canopen.pdo.named_values import (
        PdoConsumer as PdoConsumer,
        PdoReceived as PdoReceived,
        RemotePdo as RemotePdo,
        remote_pdo as remote_pdo,
    )
    from barewire.canopen.pdo.remote_config import (
        PdoConfigPolicy as PdoConfigPolicy,
        mapping_of as mapping_of,
        read_pdo as read_pdo,
        write_pdo as write_pdo,
    )
    from barewire.canopen.sdo import (
        STANDARD as STANDARD,
        AbortCode as AbortCode,
        BlockSettings as BlockSettings,
        Channel as Channel,
        SdoAbort as SdoAbort,
        SdoDialect as SdoDialect,
        SdoServer as SdoServer,
        abort_text as abort_text,
        download as download,
        fit as fit,
        upload as upload,
        upload_to as upload_to,
    )
    from barewire.canopen.sdo.client.typed_access import read_object as read_object, write_object as write_object
    from barewire.canopen.sync import (
        SyncEvent as SyncEvent,
        SyncMessage as SyncMessage,
        SyncMonitor as SyncMonitor,
        SyncProducer as SyncProducer,
    )
    from barewire.canopen.time_stamp import (
        TimeConsumer as TimeConsumer,
        TimeProducer as TimeProducer,
        TimeReceived as TimeReceived,
        TimeStamp as TimeStamp,
    )
    from barewire.canopen.time_types import TimeDifference as TimeDifference, TimeOfDay as TimeOfDay

__getattr__, __all__ = lazy(
    __name__,
    {
        "frame": "CanFrame FdFrame ErrorFrame",
        "cob_ids": "cob_id classify check_node is_restricted Service CobEntry",
        "sdo": (
            "upload upload_to download BlockSettings Channel SdoDialect STANDARD fit SdoAbort AbortCode "
            "abort_text SdoServer"
        ),
        "object_dictionary": "Entry ObjectDictionary",
        "time_types": "TimeOfDay TimeDifference",
        "nmt.messages": "NmtCommand NmtState NmtMessage NmtChange NmtSlave",
        "nmt.master": "send_nmt request_state NmtConfirmation",
        "nmt.wait": "wait_for_boot_up wait_for_heartbeat wait_for_state",
        "nmt.heartbeat": (
            "NodeState HeartbeatProducer HeartbeatConsumer HeartbeatEvent consumer_entry guarding_request"
        ),
        "nmt.node_guarding": "Guard GuardingMaster GuardEvent GuardedNode LifeEvent",
        "emcy.message": "Emergency error_text register_names register_of",
        "emcy.producer": "EmcyProducer",
        "emcy.consumer": "EmcyConsumer EmcyEvent",
        "sync": "SyncMessage SyncProducer SyncMonitor SyncEvent",
        "time_stamp": "TimeStamp TimeProducer TimeConsumer TimeReceived",
        "pdo.mapping": "MappedObject PdoMapping",
        "pdo.multiplexed": "Mpdo",
        "pdo.config": "PdoConfig pdos_of",
        "pdo.engine": "PdoEngine",
        "pdo.remote_config": "read_pdo write_pdo mapping_of PdoConfigPolicy",
        "pdo.named_values": "remote_pdo RemotePdo PdoConsumer PdoReceived",
        "sdo.client.typed_access": "read_object write_object",
        "bus.scan": "scan ScanResult ScannedNode",
        "lss.messages": "LssAddress LssMessage LssService LssState LssRefused Fastscan",
        "lss.slave": "LssSlave",
        "lss.master": (
            "switch_global switch_selective identify_slaves identify_unconfigured inquire_address inquire_node "
            "configure_node configure_bit_timing activate_bit_timing store_configuration"
        ),
        "lss.fastscan": "fastscan assign_node_ids AssignedNode",
        "device.device": "LocalNode",
        "device.storage": "StoredParameters",
        "communication_objects": "standard_objects",
        "device.sdo_channels": "client_channel",
    },
)
