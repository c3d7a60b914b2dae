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
    plan              parameters -> the fewest Modbus requests; registers -> values
    request_checks    typed text -> a value; checks before anything is sent
    modbus_access, canopen_access     read and write by name
    raw_address       parameters by address instead of a name
    sdo_dialects      SDO variants of known devices
    drive/            moves any drive of CiA 402
    sim/              the three machines of the catalogue, simulated
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.devices.canopen_access import read_canopen as read_canopen, write_canopen as write_canopen
    from barewire.devices.description.load import load as load, names as names
    from barewire.devices.description.rules import DescriptionError as DescriptionError
    from barewire.devices.device import (
        CanopenSettings as CanopenSettings,
        Device as Device,
        DevicePdo as DevicePdo,
        DriveRoles as DriveRoles,
        ModbusSettings as ModbusSettings,
        UnknownName as UnknownName,
    )
    from barewire.devices.drive.access import CanopenAccess as CanopenAccess, ModbusAccess as ModbusAccess
    from barewire.devices.drive.cia402 import (
        State as State,
        next_control_word as next_control_word,
        state_of as state_of,
    )
    from barewire.devices.drive.drive import Drive as Drive
    from barewire.devices.drive.report import DriveStuck as DriveStuck
    from barewire.devices.modbus_access import read_modbus as read_modbus, write_modbus as write_modbus
    from barewire.devices.parameter import (
        ModbusAt as ModbusAt,
        ObjectAt as ObjectAt,
        Parameter as Parameter,
        Reading as Reading,
    )
    from barewire.devices.plan import plan_reads as plan_reads, plan_writes as plan_writes

__getattr__, __dir__, __all__ = lazy(
    __name__,
    {
        "description.load": "load names",
        "device": "Device ModbusSettings CanopenSettings DriveRoles DevicePdo UnknownName",
        "parameter": "Parameter ModbusAt ObjectAt Reading",
        "description.rules": "DescriptionError",
        "modbus_access": "read_modbus write_modbus",
        "canopen_access": "read_canopen write_canopen",
        "plan": "plan_reads plan_writes",
        "drive.cia402": "State state_of next_control_word",
        "drive.drive": "Drive",
        "drive.report": "DriveStuck",
        "drive.access": "ModbusAccess CanopenAccess",
    },
)
