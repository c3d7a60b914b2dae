"""Servers of Modbus units and of nodes on a CAN bus.

The files, in reading order:

    base                 the base classes of servers: how they start and how they end
    server_log           the lines in the log of a Modbus server
    connection_limits    how many clients may be connected, and how long one may be silent
    accepting            accepting clients, also without free file descriptors
    datagram_limits      which datagrams a server on UDP refuses
    modbus               ModbusServer; by kind of port: tcp (without asyncio), serial, asyncio_stream
    asyncio_modbus       AsyncModbusServer; by kind of port: asyncio_stream, asyncio_ports
    tls_session          TLS of a connection, without a socket
    can                  a node on a CAN bus
"""
