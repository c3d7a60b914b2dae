"""The core of every simulated machine: its values, and the adapters through which the buses access them.

        Modbus  --> modbus.py --> register_image.py --> store.py <-- canopen.py <-- CANopen
                                                          ^
                       simulator.py: a machine = device + store + clock + adapters

Files in reading order:

    store             every parameter with its value, its rights and its hooks
    machine           the clock of a machine, and the protocol of a machine that the adapters depend on
    register_image    rows of registers and coils, composed of values
    modbus            function codes: a unit of a Modbus server
    canopen           the object dictionary and the PDOs: a CANopen node
    simulator         the machine that joins them; any device without behaviour of its own
"""
