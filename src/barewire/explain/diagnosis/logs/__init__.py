"""Diagnosis of a whole log, or of a live line: findings with their place and time, then verdicts on the line or bus.

        frames, times --> BusDiagnosis   (CAN)    --> LogFinding, LogFinding ...   each one is proved by itself
                          LineDiagnosis  (Modbus) --> LineVerdict                      proved by numbers over all of it

    verdict        findings with place and time, the closed list of verdicts
    can_log        a CAN bus, on the events of the monitor
    can_verdict    what is counted on a bus, and the verdicts that follow

Depends on: findings, explain.can_monitor, explain.capture, the other files of diagnosis. Used by: cli.
"""
