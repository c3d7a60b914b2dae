"""CANopen on real buses: clients, shared buses, local nodes, and tools that use a bus.

The files, in reading order:

    bus/            CanBus: one reader, many subscribers; streams of events; machines that run on a bus
    methods/        upload, fastscan, ...: each written once for both clients
    node            one node: bus.node(5, device="az3")
    dcf_node        one node with its configuration: bus.node(5, dcf="pump.dcf")
    fast_path, async_fast_path             expedited transfers without a conversation
    client_base, client, async_client      CanopenClient, AsyncCanopenClient
    gateway_server  the text gateway of CiA 309-3
    socketcand      a bus between processes
"""
