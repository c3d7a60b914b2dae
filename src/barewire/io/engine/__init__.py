"""Engines: they carry out a conversation, or one exchange, on a port.

The files, in reading order:

    blocking        on a blocking port                  asyncio         on an asyncio port
    fast_path       one request and one response, without a conversation: nearly all exchanges
    methods         a blocking and an asyncio method of one definition
    backoff         pauses between attempts to connect  locking         one thread at a time in a machine
    forking         a child process does not use the connections of its parent
"""
