"""Diagnosis: what is wrong with bytes that are not a good frame. A finding is proved by a trial, never guessed.

The files, in reading order:

    modbus/      one Modbus frame
    can          one CAN frame
    logs/        whole logs and live lines
"""
