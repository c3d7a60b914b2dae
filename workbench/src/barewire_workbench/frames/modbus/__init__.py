"""Modbus frames and exchanges as text.

    field_text      the meanings of fields
    pdu             a PDU: function, direction, fields
    frames          RTU, ASCII and TCP frames around it
    named_registers registers as values of a device, with names and units
    exchange_text   the events of the sniffer: a line, or a dict

Depends on: modbus, rtu, ascii, tcp, devices, explain.result. Used by: explain.api, cli.
"""
