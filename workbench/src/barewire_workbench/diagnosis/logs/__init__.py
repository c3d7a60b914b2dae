"""Diagnosis of a whole log, or of a live line: findings with their place and time, then verdicts on the line or bus.

The files, in reading order:

        frames, times --> BusDiagnosis   (CAN)    --> LogFinding, LogFinding ...   each one is proved by itself
                          LineDiagnosis  (Modbus) --> LineVerdict                      proved by numbers over all of it

    verdict          findings with place and time, the closed list of verdicts
    can_log          a CAN bus, on the events of the monitor
    can_verdict      what is counted on a bus, and the verdicts that follow
    modbus_pieces    the frames and the noise of a line, each with its place
    examine          the diagnosis of many damaged pieces, with a bound on its cost
    modbus_response  whether bytes are the response to a request
    modbus_line      one Modbus line or connection
    modbus_verdict   what is counted on a line, and the verdicts that follow
    modbus_log       a whole log of Modbus, and a live line
"""
