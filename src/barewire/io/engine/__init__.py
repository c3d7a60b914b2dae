"""Engines: they carry out a conversation, or one exchange, on a port.

The files, in reading order:

    blocking, asyncio   carry out a conversation, or one request and one response: nearly all exchanges of Modbus
    methods             a blocking and an asyncio method of one definition
    connections         pauses between attempts to connect; a child process does not use those of its parent
    callbacks           exchanges of Modbus without a task for each: what a gateway uses
    locking             one thread at a time in a machine
"""
