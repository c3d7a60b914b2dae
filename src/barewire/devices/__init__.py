"""Devices: parameters of real machines by name, with unit, range and address, on Modbus and CANopen.

The files, in reading order:

                          load("az3").find("STATUS WORD")           catalog/az3/input.toml
                                        |
             ModbusAt("input", 24) -----+----- ObjectAt(0x6041)     u16, bits named, no unit
                     |                                 |
    read_modbus(bus, 1, az3, ["STATUS WORD"])    read_canopen(1, az3, ["STATUS WORD"])
                     '---> Reading("STATUS WORD", 0x0637) <---'

    parameter         one named value, its unit, its range and its addresses
    device            all parameters of a machine, and its settings on each bus
    description/      TOML -> Device, the checks of the format, Device -> EDS;  catalog/  three machines as TOML
    request_checks    typed text -> a value; checks before anything is sent
    modbus_access     read and write by name over Modbus, with the fewest requests
    canopen_access    the same over CANopen, one transfer for each object
    sdo_dialects      SDO variants of known devices
    cia402            states, status words and control words of a drive
    drive             moves any drive of CiA 402
    sim/              the three machines of the catalogue, simulated
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.devices.canopen_access import (
        CanopenAccess as CanopenAccess,
        read_canopen as read_canopen,
        write_canopen as write_canopen,
    )
    from barewire.devices.cia402 import (
        State as State,
        next_control_word as next_control_word,
        state_of as state_of,
    )
    from barewire.devices.description.check import DescriptionError as DescriptionError
    from barewire.devices.description.load import load as load, names as names
    from barewire.devices.device import (
        CanopenSettings as CanopenSettings,
        Device as Device,
        DevicePdo as DevicePdo,
        DriveRoles as DriveRoles,
        ModbusSettings as ModbusSettings,
        UnknownName as UnknownName,
    )
    from barewire.devices.drive import Drive as Drive, DriveStuck as DriveStuck
    from barewire.devices.modbus_access import (
        ModbusAccess as ModbusAccess,
        plan_reads as plan_reads,
        plan_writes as plan_writes,
        read_modbus as read_modbus,
        write_modbus as write_modbus,
    )
    from barewire.devices.parameter import (
        ModbusAt as ModbusAt,
        ObjectAt as ObjectAt,
        Parameter as Parameter,
        Reading as Reading,
    )

__getattr__, __dir__, __all__ = lazy(
    __name__,
    {
        "description.load": "load names",
        "device": "Device ModbusSettings CanopenSettings DriveRoles DevicePdo UnknownName",
        "parameter": "Parameter ModbusAt ObjectAt Reading",
        "description.check": "DescriptionError",
        "modbus_access": "read_modbus write_modbus plan_reads plan_writes ModbusAccess",
        "canopen_access": "read_canopen write_canopen CanopenAccess",
        "cia402": "State state_of next_control_word",
        "drive": "Drive DriveStuck",
    },
)
