"""The answers of barewire to the questions of the vectors: one function for each kind and operation.

The files, in reading order:

    texts        hexadecimal, registers and bits as the vectors write them
    codecs       number, bits, register-part, text
    messages     pdu, exchange
    frames       crc16, lrc, rtu-timing, the three frame kinds, tls-role
    modbus/      server, server-conformance, gateway
    lines        the three talk kinds of lines
    canopen      frames and messages of CANopen
    transfers    sdo-talk, object-value, node-talk
    devices      parameter, drive-state, drive-command
    table        `own_answer`: question -> answer
"""
