"""Cases on real ports: the batteries of `conform`, and the questions of the vectors.

    modbus_conformance     a Modbus server, over any transport
    canopen_conformance    a CANopen device, on any bus
    results                the line of a case; the errors of a run that ended early, or did not begin
    vector_adapter         a program that answers the questions of the vectors

With `cli` the only room that has clocks and ports.
"""
