"""Parts of the files that `barewire vendor` makes: what a small file has in place of a larger part of the stack.

registry                 a table in place of files that are loaded when needed
serial_counters          the counters of a unit, which no function reads
probe, rtu_shape         only what a client needs
serial_port, tcp_port    ports by the standard library alone, also can_port
carry_out                the engine
modbus_client            the methods of all clients; rtu_client, ascii_client and tcp_client open its ports
rtu_server, tcp_server   the loops of servers
sdo_transfers            upload and download without blocks; sdo_client has them as methods
adapter                  no part: the program that answers the questions of the vectors with a file
"""
