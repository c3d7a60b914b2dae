"""CAN frames as text.

    lss, sdo      the two services with tables of their own
    frame         a frame of any service: `explain_can`
    known_node    the description of a node: names, types, PDOs

Depends on: canopen, devices, explain.result. Used by: explain.capture, explain.can_monitor, explain.api, cli.
"""
