"""Frames, field by field: `api.explain` puts every byte of a frame into one field with its name, value and meaning.

    findings           the codes of a diagnosis, and what each says
    result             the explanation: fields, verdict, lines, dict
    input              bytes from text: hexadecimal, source literals, hex dumps
    modbus             Modbus PDUs and the three frames around them
    modbus_exchanges   exchanges on a line as text, with the names of a device
    known_node         the description of a node: names, types, PDOs
    can                CAN frames by service; SDO and LSS

Every byte is in exactly one field, in order, however broken the frame is, and no input raises.
"""
