"""Recordings of Modbus as people have them: `read_modbus_log` takes the bytes of a file in any form.

The files, in reading order:

    model           what is read: LoggedBytes, Unread, ModbusLog
    stamps          times in lines
    octets          bytes at the end of a line, in any notation
    pymodbus, libmodbus, minimalmodbus      libraries
    wireshark, tables                       text, JSON and CSV of Wireshark and tshark
    blocks, bytewise, syscalls              serial sniffers: socat -x, jpnevulator, interceptty, slsnif ...; strace
    marked          lines with a direction in a word: Modbus Poll, QModMaster, Docklight, own logs ...
    segments        captures: TCP segments in order, RTU in datagrams
    direction       decimal or hexadecimal, which protocol, which side: decided by the frames of the whole log
    reader          recognises the form: `read_modbus_log`, and part by part `read_modbus_parts`
"""

from barewire_workbench.recordings.modbus_log.model import LoggedBytes, ModbusLog
from barewire_workbench.recordings.modbus_log.reader import UNREADABLE, read_modbus_log, read_modbus_parts

__all__ = ["UNREADABLE", "LoggedBytes", "ModbusLog", "read_modbus_log", "read_modbus_parts"]
