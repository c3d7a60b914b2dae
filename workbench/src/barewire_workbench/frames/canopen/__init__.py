"""CAN frames as text.

The files, in reading order:

    lss, sdo      the two services with tables of their own
    frame         a frame of any service: `explain_can`
    known_node    the description of a node: names, types, PDOs
"""
