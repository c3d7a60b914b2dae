"""Diagnosis: what is wrong with bytes that are not a good frame. A finding is proved by a trial, never guessed.

    modbus/      one Modbus frame
    can          one CAN frame
    logs/        whole logs and live lines

Depends on: findings, canopen, explain.can_monitor, explain.canopen, modbus, rtu, wire. Used by: api, cli.
"""
