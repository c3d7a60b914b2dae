"""CANopen: network management, SDO, PDO, emergencies, SYNC, TIME, LSS as values and machines.   [CiA 301]

        605h                    | 40       | 41 60   | 00        | 00 00 00 00 |
        identifier              | command  | index   | sub-index | data        |      an SDO request for 6041h:00
        = function code + node

CAN delivers whole frames, so there is no framing here. The rooms and files, in reading order:

    frame                  one CAN frame, and its text             cob_ids         the identifiers of services and nodes
    datatypes              the types of objects                    object_dictionary        the objects of one device
    abort_codes            why an access to an object is refused
    communication_objects  reading and validating 1000h-1FFFh      sync, time_stamp         SYNC and TIME messages
    cyclic                 frames that are sent again and again
    nmt/                   states, commands, heartbeats            sdo/     read and write objects of any length
    emcy                   emergency messages                      pdo/     process data
    lss/                   assign node-IDs                         bus_scan          find the nodes on a bus
    channel_locks          which transfers may run at the same time
    device/                `LocalNode`, a whole device             eds/     EDS and DCF files
    configuration/         a device and its DCF: compared, written
    manager/               boots a network: checks, configures, starts its nodes

Two nodes communicate as two machines, or as a conversation and a machine; neither has a bus or a clock.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.canopen.abort_codes import AbortCode as AbortCode, SdoAbort as SdoAbort, abort_text as abort_text
    from barewire.canopen.bus_scan import ScannedNode as ScannedNode, ScanResult as ScanResult, scan as scan
    from barewire.canopen.cob_ids import (
        CobEntry as CobEntry,
        CobService as CobService,
        check_node as check_node,
        classify as classify,
        cob_id as cob_id,
        is_restricted as is_restricted,
    )
    from barewire.canopen.communication_objects import standard_objects as standard_objects
    from barewire.canopen.configuration.configure import (
        ConciseValue as ConciseValue,
        ConfigurationFailed as ConfigurationFailed,
        ConfigurationResult as ConfigurationResult,
        compare_device as compare_device,
        concise_dcf as concise_dcf,
        concise_values as concise_values,
        configure_device as configure_device,
        decode_concise_dcf as decode_concise_dcf,
        encode_concise_dcf as encode_concise_dcf,
    )
    from barewire.canopen.configuration.settings import (
        DeviceConfiguration as DeviceConfiguration,
        Difference as Difference,
        Setting as Setting,
        device_configuration as device_configuration,
    )
    from barewire.canopen.cyclic import CyclicProducer as CyclicProducer
    from barewire.canopen.datatypes import TimeDifference as TimeDifference, TimeOfDay as TimeOfDay
    from barewire.canopen.device.device import LocalNode as LocalNode
    from barewire.canopen.device.node_group import NodeGroup as NodeGroup
    from barewire.canopen.device.services import client_channel as client_channel
    from barewire.canopen.device.storage import StoredParameters as StoredParameters
    from barewire.canopen.emcy import (
        EmcyConsumer as EmcyConsumer,
        EmcyEvent as EmcyEvent,
        EmcyProducer as EmcyProducer,
        Emergency as Emergency,
        error_text as error_text,
        register_names as register_names,
        register_of as register_of,
    )
    from barewire.canopen.frame import CanFrame as CanFrame, ErrorFrame as ErrorFrame, FdFrame as FdFrame
    from barewire.canopen.lss.master import (
        AssignedNode as AssignedNode,
        activate_bit_timing as activate_bit_timing,
        assign_node_ids as assign_node_ids,
        configure_bit_timing as configure_bit_timing,
        configure_node as configure_node,
        fastscan as fastscan,
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
    from barewire.canopen.manager.boot_network import (
        BootEvent as BootEvent,
        BootManager as BootManager,
        NetworkBoot as NetworkBoot,
        boot_network as boot_network,
        check_network as check_network,
    )
    from barewire.canopen.manager.boot_slave import (
        BootError as BootError,
        BootResult as BootResult,
        boot_slave as boot_slave,
    )
    from barewire.canopen.manager.network_list import (
        BootSlave as BootSlave,
        NetworkList as NetworkList,
        network_list as network_list,
        slave_of as slave_of,
    )
    from barewire.canopen.nmt.error_control import (
        Guard as Guard,
        GuardedNode as GuardedNode,
        GuardEvent as GuardEvent,
        GuardingMaster as GuardingMaster,
        HeartbeatConsumer as HeartbeatConsumer,
        HeartbeatEvent as HeartbeatEvent,
        HeartbeatProducer as HeartbeatProducer,
        LifeEvent as LifeEvent,
    )
    from barewire.canopen.nmt.master import (
        NmtConfirmation as NmtConfirmation,
        request_state as request_state,
        send_nmt as send_nmt,
        wait_for_boot_up as wait_for_boot_up,
        wait_for_heartbeat as wait_for_heartbeat,
        wait_for_state as wait_for_state,
    )
    from barewire.canopen.nmt.messages import (
        NmtChange as NmtChange,
        NmtCommand as NmtCommand,
        NmtMessage as NmtMessage,
        NmtSlave as NmtSlave,
        NmtState as NmtState,
        NodeState as NodeState,
        consumer_entry as consumer_entry,
        guarding_request as guarding_request,
    )
    from barewire.canopen.object_dictionary import Entry as Entry, ObjectDictionary as ObjectDictionary
    from barewire.canopen.pdo.config import PdoConfig as PdoConfig, pdos_of as pdos_of
    from barewire.canopen.pdo.engine import PdoEngine as PdoEngine
    from barewire.canopen.pdo.mapping import MappedObject as MappedObject, PdoMapping as PdoMapping
    from barewire.canopen.pdo.multiplexed import Mpdo as Mpdo
    from barewire.canopen.pdo.remote import (
        PdoConfigPolicy as PdoConfigPolicy,
        PdoConsumer as PdoConsumer,
        PdoReceived as PdoReceived,
        RemotePdo as RemotePdo,
        mapping_of as mapping_of,
        read_pdo as read_pdo,
        remote_pdo as remote_pdo,
        write_pdo as write_pdo,
    )
    from barewire.canopen.sdo import (
        STANDARD as STANDARD,
        BlockSettings as BlockSettings,
        Channel as Channel,
        SdoDialect as SdoDialect,
        SdoServer as SdoServer,
        download as download,
        fit as fit,
        upload as upload,
        upload_to as upload_to,
    )
    from barewire.canopen.sdo.client import read_object as read_object, write_object as write_object
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

__getattr__, __dir__, __all__ = lazy(
    __name__,
    {
        "frame": "CanFrame FdFrame ErrorFrame",
        "cob_ids": "cob_id classify check_node is_restricted CobService CobEntry",
        "abort_codes": "AbortCode SdoAbort abort_text",
        "sdo": "upload upload_to download BlockSettings Channel SdoDialect STANDARD fit SdoServer",
        "object_dictionary": "Entry ObjectDictionary",
        "datatypes": "TimeOfDay TimeDifference",
        "nmt.messages": "NmtCommand NmtState NmtMessage NmtChange NmtSlave NodeState consumer_entry guarding_request",
        "nmt.master": "NmtConfirmation request_state send_nmt wait_for_boot_up wait_for_heartbeat wait_for_state",
        "nmt.error_control": (
            "HeartbeatProducer HeartbeatConsumer HeartbeatEvent Guard GuardingMaster GuardEvent GuardedNode LifeEvent"
        ),
        "emcy": "Emergency error_text register_names register_of EmcyProducer EmcyConsumer EmcyEvent",
        "cyclic": "CyclicProducer",
        "sync": "SyncMessage SyncProducer SyncMonitor SyncEvent",
        "time_stamp": "TimeStamp TimeProducer TimeConsumer TimeReceived",
        "pdo.mapping": "MappedObject PdoMapping",
        "pdo.multiplexed": "Mpdo",
        "pdo.config": "PdoConfig pdos_of",
        "pdo.engine": "PdoEngine",
        "pdo.remote": "read_pdo write_pdo mapping_of PdoConfigPolicy remote_pdo RemotePdo PdoConsumer PdoReceived",
        "sdo.client": "read_object write_object",
        "bus_scan": "scan ScanResult ScannedNode",
        "lss.messages": "LssAddress LssMessage LssService LssState LssRefused Fastscan",
        "lss.slave": "LssSlave",
        "lss.master": (
            "switch_global switch_selective identify_slaves identify_unconfigured inquire_address inquire_node "
            "configure_node configure_bit_timing activate_bit_timing store_configuration "
            "fastscan assign_node_ids AssignedNode"
        ),
        "device.device": "LocalNode",
        "device.node_group": "NodeGroup",
        "device.storage": "StoredParameters",
        "communication_objects": "standard_objects",
        "device.services": "client_channel",
        "configuration.settings": "device_configuration DeviceConfiguration Setting Difference",
        "manager.network_list": "BootSlave NetworkList network_list slave_of",
        "manager.boot_network": "BootEvent NetworkBoot boot_network BootManager check_network",
        "manager.boot_slave": "boot_slave BootResult BootError",
        "configuration.configure": (
            "concise_dcf ConciseValue encode_concise_dcf decode_concise_dcf concise_values "
            "compare_device configure_device ConfigurationResult ConfigurationFailed"
        ),
    },
)
