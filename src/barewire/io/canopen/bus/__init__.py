"""CanBus: one CAN bus shared by many listeners of this program, for threads and asyncio.

The files, in reading order:

    subscriber      receives frames of a shared bus for one thread or task
    direct_port     reads the bus for one conversation, while nobody else listens
    reconnect       opens a port again that failed
    receiving       who reads the port of a bus, and where its frames go
    shared_bus      CanBus: one reader, many subscribers; the locks of SDO channels
    event_stream    streams: the events of a machine that listens
    node_runner     runs machines that also send, each in a thread
    async_bus       subscribers, streams and running machines for asyncio
    capture         the frames of a live bus
"""
