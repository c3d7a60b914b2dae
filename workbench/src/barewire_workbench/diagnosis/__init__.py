"""Diagnosis: what is wrong with bytes that are not a good frame. A finding is proved by a trial, never guessed.

The files, in reading order:

    good             whether bytes are a good Modbus frame, and how many bytes are missing to one
    rtu              the trials of an RTU frame, in their order
    resample         the frame that a receiver with a wrong baud rate has read as other bytes
    ascii, tcp       the trials of the other two framings
    exchange         a response and its request; one frame in any framing
    can              one CAN frame
    iso_tp           messages of ISO-TP, where the bus has no CANopen

Whole logs and live lines: findings with their place and time, then verdicts on the line or bus.

        frames, times --> BusDiagnosis   (CAN)    --> LogFinding, LogFinding ...   each one is proved by itself
                          LineDiagnosis  (Modbus) --> LineVerdict                      proved by numbers over all of it

    verdict          findings with place and time, the closed list of verdicts
    can_log          a CAN bus, on the events of the monitor; what is counted on it
    modbus_pieces    the frames and the noise of a line, each with its place; the diagnosis of damaged ones
    modbus_noise     noise beside a frame, and damaged frames
    modbus_responses what a single response or damaged piece is, beside the requests and pieces before it
    modbus_counts    what is counted on a line, and the verdicts that follow
    fragments        bytes in a text that are no whole frame: data of SDO messages, floats
    texts            error messages and logs without bytes
    modbus_line      one Modbus line or connection
    modbus_log       all lines of a log, and one line as it is received
"""
