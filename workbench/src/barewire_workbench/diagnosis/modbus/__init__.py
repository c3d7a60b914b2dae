"""What is wrong with a Modbus frame that is not valid: each fault is tried, and a good frame is the proof.

The files, in reading order:

    good           whether bytes are a good frame, and how many bytes are missing to one
    crc_search     the one change of a byte that makes a CRC fit, found from both ends of the frame
    checksum       a checksum in the other byte order, over other bytes, of another kind
    frames_inside  good frames with other bytes around them
    content        what is wrong although the CRC fits: a byte count, bytes behind the PDU
    one_change     a byte count, a bit, a byte less or more, a number turned round
    resample       the frame that a receiver with a wrong baud rate has read as other bytes
    rtu            the trials of an RTU frame, in their order
    ascii, tcp     those of the other two framings
    frame          the diagnosis of one frame in any framing
    exchange       a response and its request
    expected       what a request asks a known device for
"""
