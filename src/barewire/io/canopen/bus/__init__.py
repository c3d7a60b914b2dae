"""CanBus: one CAN bus shared by many listeners of this program, for threads and asyncio.

    subscriber      receives frames of a shared bus for one thread or task
    reconnect       opens a port again that failed
    shared_bus      CanBus: one reader, many subscribers; the locks of SDO channels
    event_stream    streams: the events of a machine that listens
    node_runner     runs machines that also send, each in a thread
    async_bus       subscribers, streams and running machines for asyncio
    capture         the frames of a live bus

Depends on: the engines, ports; canopen.  Used by: clients, nodes, servers, cli.
"""
