"""The server side of Modbus, as a machine: received bytes in, bytes to send out. No sockets, no clocks.

The files, in reading order:

    server             `Server`: from bytes to units and back; `Unit`, the protocol of a unit
    serial_counters    counters and event log of a unit on a serial line (functions 08, 0B, 0C)
    authorization      roles and their permissions, for TLS; the role in a certificate
    identity           the identification objects of a unit (2B/0E)
    table              a unit of four tables in memory
    blocks             the values of a table, checked when they are assigned
    handlers           a unit of plain functions
"""
