"""Recordings of Modbus as people have them: `read_modbus_log` takes the bytes of a file in any form.

The files, in reading order:

    model       what is read: LoggedBytes, Unread, ModbusLog
    envelope    RTU inside the frames of another protocol, Solarman V5
    octets      bytes at the end of a line, in any notation; times in lines
    programs    logs with words of their own: pymodbus, libmodbus, MinimalModbus, strace, interceptty, Saleae ...
    exports     text, JSON and CSV of Wireshark and tshark
    marked      lines with a direction in a word, entries of several lines: Modbus Poll, socat, Docklight, own logs ...
    posted      bytes within sentences and code, in any notation, and why they are bytes
    reader      recognises the form; captures: TCP segments in order, RTU in datagrams
"""

from barewire_workbench.recordings.modbus_log.model import LoggedBytes, ModbusLog
from barewire_workbench.recordings.modbus_log.reader import UNREADABLE, read_modbus_log, read_modbus_parts

__all__ = ["UNREADABLE", "LoggedBytes", "ModbusLog", "read_modbus_log", "read_modbus_parts"]
