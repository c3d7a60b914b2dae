"""CANopen on real buses: clients, shared buses, local nodes, and tools that use a bus.

    subscriber      the frames that one thread or task receives of a shared bus
    reconnect       a port that failed is opened again
    shared_bus      CanBus: one reader, many subscribers; the locks of SDO channels
    event_stream    events of a machine that listens, taken one by one
    node_runner     machines that send by themselves, each in a thread
    async_bus       the same three for asyncio
    methods/        upload, fastscan, ...: each written once for both clients
    node            one node: bus.node(5, device="az3")
    client_base, client, async_client      CanopenClient, AsyncCanopenClient
    capture         frames of a live bus          conformance       the conformance battery
    gateway_server  the text gateway of CiA 309-3          socketcand    a bus between processes

Depends on: the engines, ports; canopen, devices.  Used by: `barewire`, machines by name, servers, cli.
"""
