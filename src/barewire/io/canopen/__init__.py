"""CANopen on real buses: clients, shared buses, local nodes, and tools that use a bus.

    subscriber      receives frames of a shared bus for one thread or task
    reconnect       opens a port again that failed
    shared_bus      CanBus: one reader, many subscribers; the locks of SDO channels
    event_stream    streams: the events of a machine that listens
    node_runner     runs machines that also send, each in a thread
    async_bus       subscribers, streams and running machines for asyncio
    methods/        upload, fastscan, ...: each written once for both clients
    node            one node: bus.node(5, device="az3")
    dcf_node        one node with its configuration: bus.node(5, dcf="pump.dcf")
    client_base, client, async_client      CanopenClient, AsyncCanopenClient
    capture         the frames of a live bus
    conformance     runs the conformance cases against a device
    gateway_server  the text gateway of CiA 309-3
    socketcand      a bus between processes

Depends on: the engines, ports; canopen, devices.  Used by: `barewire`, machines by name, servers, cli.
"""
