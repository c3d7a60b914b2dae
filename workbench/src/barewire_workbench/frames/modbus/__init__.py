"""Modbus frames and exchanges as text.

The files, in reading order:

    field_text      the meanings of fields
    pdu             a PDU: function, direction, fields
    frames          RTU, ASCII and TCP frames around it
    named_registers registers as values of a device, with names and units
    exchange_text   the events of the sniffer: a line, or a dict
"""
