"""Modbus on real ports: clients.

The files, in reading order:

    carriers                the framing state, the port and the options of an endpoint
    methods                 the base class of both clients: read_coils and all other methods
    connection              what the connections of both clients have in common: log, pauses, errors
    client, async_client    the blocking and the asyncio client, each with its connection
"""
