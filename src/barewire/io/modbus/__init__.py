"""Modbus on real ports: clients, and listening in.

The files, in reading order:

    carriers                        the framing state, the port and the options of an endpoint
    methods                         the base class of both clients: read_coils and all other methods
    client_log                      the lines in the log of a client
    connection, client              the blocking client
    async_connection, async_client  the asyncio client
    sniff                           listens in on a serial line
"""
