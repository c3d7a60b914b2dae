"""Answers for CANopen nodes over time: devices, and masters."""
