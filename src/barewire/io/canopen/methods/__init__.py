"""The methods of a CANopen client and of its nodes, by subject; each is written once, for blocking and asyncio.

The files, in reading order:

    operations    the decorators that make a blocking method and a coroutine of one definition
    sdo           node.sdo      upload, download, typed values, further SDO servers
    nmt           node.nmt, bus.nmt      commands, states, heartbeats, node guarding
    pdo           node.pdo      configuration, named values
    lss           bus.lss       node-IDs and bit rates
    sync_time     bus.sync, bus.time
    cyclic        cyclic frames, sent by Python or by the Linux kernel
"""
