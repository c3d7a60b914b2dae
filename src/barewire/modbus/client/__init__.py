"""The client side of Modbus, as conversations: bytes in, times in, requests out. No sockets, no clocks.

    client                                       unit
    ------                                       ----
    wait until the line is idle
    request    ------------------------------->
               <-------------------------------  response, or exception response      -> value, or ModbusException
               <-------------------------------  anything else                        -> noted for the error, ignored
               .............. time-out .........                                      -> NoAnswer, with these notes

A frame that does not answer the request, comes from another unit or is damaged does not end the wait: the standard
keeps the timer running [MB-SERIAL 2.4.1], because the right response may still come.

    bus                    `Bus`: many requests on one line; late responses are told apart from those of later requests
    line_state             the state of the bus: pending answers, late replies, the state of each unit
    fair_queue             which of several waiting requests is next
    read_identification    2B/0E until all identification objects are read
"""
