"""Recordings of lines and buses, read and written. Bytes and text in, items out; no file access.

The files, in reading order:

    source                    the bytes of a recording as they come, in parts of whole lines
    model                     the items of a CAN recording
    candump, asc, blf, trc, python_can_text, conformance_log      file formats for CAN
    pcapng                    packets of capture files
    socketcan                 CAN frames in packets
    can_text, can_notes       one CAN frame, pasted; frames as people note them, one in each line
    modbus_packets            Modbus frames in packets
    bytelog                   logs of serial lines
    modbus_log/               recordings of Modbus in any form: logs of programs, exports, dumps, captures
    modbus_replay             any recording of Modbus, decoded by the sniffer
"""
