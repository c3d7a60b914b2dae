"""CANopen on real buses: clients, shared buses, and nodes that run on them.

The files, in reading order:

    bus/            CanBus: one reader, many subscribers; streams of events; machines that run on a bus
    operations      the decorators that make a blocking method and a coroutine of one definition
    objects         node.sdo, node.pdo
    nmt             node.nmt, bus.nmt
    bus_methods     bus.lss, bus.sync, bus.time; cyclic frames, sent by Python or by the Linux kernel
    node            one node: bus.node(5, device="az3"), also with an EDS or a DCF
    client_base, client, async_client      CanopenClient, AsyncCanopenClient
"""
