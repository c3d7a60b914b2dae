"""Servers of Modbus units and of nodes on a CAN bus.

The files, in reading order:

    base                how servers start and end; the log of a Modbus server
    limits              how many clients, how long one may be silent, without free descriptors, which datagrams
    units               what all servers of units have in common
    modbus              ModbusServer, AsyncModbusServer; by kind of port:
    tcp                 a thread without an event loop
    serial              a thread, or an event loop
    asyncio_network     connections with and without TLS, datagrams
    can                 a node on a CAN bus; a bus between processes
"""
