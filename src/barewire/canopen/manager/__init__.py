"""The CANopen manager: it checks, configures and starts the nodes of its network.   [CiA 302-2, 302-3]

Files, in reading order:

    network_list   the nodes, what each must be, and how they are started: 1F80h to 1F89h
    boot_slave     the boot slave process of one node, and the letters of its errors; the download of its program
    boot_network   all nodes in parallel, their start, and error control afterwards; the dry run; what is reported
"""
