"""CanBus: one CAN bus shared by many listeners of this program, for threads and asyncio.

The files, in reading order:

    port            how a port is read, and opened again after it failed; listening to a live bus
    subscriber      the receivers of frames: subscribers, and streams of the events of a machine that listens
    direct_port     reads the bus for one conversation, while nothing else listens
    shared_bus      CanBus: what reads the port, where frames go, the locks of SDO channels
    node_runner     runs machines that also send, each in a thread
    async_bus       a reader, subscribers, streams and running machines for asyncio
"""
