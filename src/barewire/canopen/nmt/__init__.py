"""NMT: network management and error control of nodes.   [CiA 301, NMT, heartbeat, node guarding, boot-up]

The files, in reading order:

        messages         the commands, the states of a node and their transitions, the state byte on 700h+n
        error_control    heartbeat producer and consumer; node guarding, by remote frames
        node_monitor     which nodes sent frames and when, to explain why a node did not respond
        master           send a command and await its confirmation; wait for a state or a boot-up message
"""
