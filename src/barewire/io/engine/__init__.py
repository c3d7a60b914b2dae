"""Engines: how a conversation, or one exchange, is carried out on a port.

    blocking        on a blocking port                  asyncio         on an asyncio port
    fast_path       the one exchange that nearly all are, without a conversation
    methods         one definition, a method of the blocking and of the asyncio client
    backoff         when to connect again               locking         one thread at a time in a machine
    conformance     common parts of the conformance runs on both protocols

Depends on: `ports`.  Used by: clients and servers of both protocols.
"""
