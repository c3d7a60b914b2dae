"""The client side of Modbus, as conversations: bytes in, times in, requests out. No sockets, no clocks.

    exchange               one request and its response, drawn; `ask` and `broadcast` for a line that is used once
    bus                    `Bus`: many requests on one line, and no late response taken for another one's
    line_state             the state of the bus: pending answers, late replies, the state of each unit
    fair_queue             which of several waiting requests is next
    read_identification    2B/0E until all identification objects are read

Depends on: conversation, modbus.messages, modbus.framing. Used by: io.modbus, devices (access), explain.
"""
