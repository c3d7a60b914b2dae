"""Frames, field by field: `api.explain` puts every byte of a frame into one field with its name, value and meaning.

    findings     the codes of a diagnosis, and what each says
    result       the explanation: fields, verdict, lines, dict
    input/       bytes from text: hexadecimal, source literals, hex dumps
    modbus/      Modbus PDUs and the three frames around them; exchanges on a line as text
    canopen/     CAN frames by service; SDO, LSS; descriptions of nodes

Every byte is in exactly one field, in order, however broken the frame is, and no input raises.
"""
