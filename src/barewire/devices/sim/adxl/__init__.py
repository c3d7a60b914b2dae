"""The ADXL soft starter on Modbus.

The files, in reading order:

    motor      phases of a start and a stop; current, torque, power, temperatures
    modbus     function codes 03, 04, 06, 07 and 17; the parameters of the menus, and the list of events
    machine    the starter that joins them; its head lists what is simulated and what is only stored
"""
