"""MEANING: what a register or an object of a real machine is. One parameter, one name, wherever it lives.

                          load("az3").find("STATUS WORD")           catalog/az3/input.toml
                                        |
             ModbusAt("input", 24) -----+----- ObjectAt(0x6041)     u16, bits named, no unit
                     |                                 |
    read_modbus(bus, 1, az3, ["STATUS WORD"])    read_canopen(1, az3, ["STATUS WORD"])
                     '---> Reading("STATUS WORD", 0x0637) <---'

    parameter   one named value, its unit and its places     device    all of them, and what the machine says of itself
    load        TOML -> Device                               check, lines, rows    what is wrong with it, and where
    plan        names -> the fewest requests                 access, asked    read and write by name, over either bus
    cia402      the states of a drive                        drive, drive_*    one code that moves any of them
    parts       the table [drive] of a description           describe  a parameter as JSON
    catalog/    three machines as data                       sim/      the same three, behaving

I know: names, units, ranges, places, states of a drive.  I never know: envelopes, ports, clocks.  Shells and cli import
me; modbus and canopen do not.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.devices.access import (
        read_canopen as read_canopen,
        read_modbus as read_modbus,
        write_canopen as write_canopen,
        write_modbus as write_modbus,
    )
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
    from barewire.devices.parameter import (
        ModbusAt as ModbusAt,
        ObjectAt as ObjectAt,
        Parameter as Parameter,
        Reading as Reading,
    )
    from barewire.devices.plan import plan_reads as plan_reads, plan_writes as plan_writes

__getattr__, __all__ = lazy(
    __name__,
    {
        "description.load": "load names",
        "device": "Device ModbusSettings CanopenSettings DriveRoles DevicePdo UnknownName",
        "parameter": "Parameter ModbusAt ObjectAt Reading",
        "description.rules": "DescriptionError",
        "access": "read_modbus write_modbus read_canopen write_canopen",
        "plan": "plan_reads plan_writes",
        "drive.cia402": "State state_of next_control_word",
        "drive.drive": "Drive",
        "drive.report": "DriveStuck",
        "drive.access": "ModbusAccess CanopenAccess",
    },
)
