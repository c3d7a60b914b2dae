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
from barewire.devices.description.check import DescriptionError
from barewire.devices.description.describe import describe
from barewire.devices.description.load import load, names
from barewire.devices.device import CanopenSide, Device, DevicePdo, DriveSide, ModbusSide, UnknownName
from barewire.devices.parameter import ModbusAt, ObjectAt, Parameter, Reading

if TYPE_CHECKING:
    from barewire.devices.access import read_canopen, read_modbus, write_canopen, write_modbus
    from barewire.devices.drive.access import CanopenAccess, ModbusAccess
    from barewire.devices.drive.cia402 import State, next_control_word, state_of
    from barewire.devices.drive.drive import Drive
    from barewire.devices.drive.report import DriveStuck
    from barewire.devices.plan import plan_reads, plan_writes

__all__ = [
    "load",
    "names",
    "Device",
    "ModbusSide",
    "CanopenSide",
    "DriveSide",
    "DevicePdo",
    "Parameter",
    "ModbusAt",
    "ObjectAt",
    "Reading",
    "UnknownName",
    "DescriptionError",
    "read_modbus",
    "write_modbus",
    "read_canopen",
    "write_canopen",
    "plan_reads",
    "plan_writes",
    "describe",
    "State",
    "state_of",
    "next_control_word",
    "Drive",
    "DriveStuck",
    "ModbusAccess",
    "CanopenAccess",
]

# Which file holds what. Only that one is loaded, with what it needs: looking a parameter up loads no bus.
_FILES = {
    "access": "read_canopen read_modbus write_canopen write_modbus",
    "drive.cia402": "State next_control_word state_of",
    "drive.drive": "Drive",
    "drive.access": "CanopenAccess ModbusAccess",
    "drive.report": "DriveStuck",
    "plan": "plan_reads plan_writes",
}

__getattr__ = lazy(__name__, _FILES)
