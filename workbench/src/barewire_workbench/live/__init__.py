"""What runs on real ports: the batteries of `conform`, scans, listening in, the questions of the vectors, a gateway.

    modbus_conformance     a Modbus server, over any transport
    canopen_conformance    a CANopen device, on any bus
    scan_modbus            the units of a line, server or gateway, and their addresses
    scan_canopen           the nodes of a bus
    check_device           whether a machine is the one whose name is used
    save_settings          the settings of a machine, and what it says about itself
    restore_settings       saved settings back into a machine, in the order of its manual
    read_values            many values of a machine, of which a bad one costs only itself
    polling                named values of machines, read periodically
    disk                   the files of a log of values
    listen                 what others say on a serial line
    ports                  the serial ports and CAN interfaces of this machine
    results                the line of a case; the errors of a run that ended early, or did not begin; notes of errors
    vector_adapter         a program that answers the questions of the vectors
    ascii_gateway          the gateway of CiA 309-3 on a TCP port: many connections, one bus
    one_file/              parts of the files that `barewire vendor` makes

With `cli` the only room that has clocks and ports.
"""
