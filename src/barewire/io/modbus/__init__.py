"""Modbus on real ports: clients, listening in, and the conformance cases.

    options                         the options of clients and servers, as keywords
    carriers                        the framing state and the port that an endpoint means
    methods                         read_coils and all others, once for both clients
    connection, client              the blocking client
    async_connection, async_client  the asyncio client
    sniff                           listens in on a serial line
    conformance                     runs the conformance cases against a server

Depends on: `endpoint`, `ports`, `engine`.  Used by: `barewire`, servers (`carriers`), the commands.
"""
